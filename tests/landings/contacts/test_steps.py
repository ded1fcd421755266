"""Landings that single feet show: a contact that two rows hold is kept in one of them."""

import numpy as np

from hopdata.landings.contacts.descents import LANDED, POOR_FIT
from hopdata.landings.contacts.steps import Steps, found_twice

# Three feet come down once. The feet's row holds two of them, the body's all three.
STEPS = Steps(
    foot=np.arange(3), apex=np.zeros(3), half_way=np.full(3, 0.5), down=np.full(3, 0.9)
)
INSTANT = np.array([[1.0, 1.01, np.nan], [1.0002, 1.0099, 1.02]])
SE = np.array([[1e-4, 3e-4, np.nan], [2e-4, 2e-4, 2e-4]])
FEET_S_ROW = [[True, True, False], [False, False, False]]


def test_a_landing_is_not_split_though_each_row_has_a_surer_contact():
    status = np.full((2, 3), LANDED)
    for order in ([0, 1], [1, 0]):
        found, _ = found_twice(STEPS, INSTANT[order], SE[order], status)
        np.testing.assert_array_equal(found[order], FEET_S_ROW)


def test_a_contact_that_can_be_trusted_is_kept_before_the_landing_is_whole():
    status = np.full((2, 3), LANDED)
    status[1, 0] = POOR_FIT
    found, _ = found_twice(STEPS, INSTANT, SE, status)
    expected = [[False, True, False], [True, False, False]]
    # The body's row then has two trusted contacts, as the feet's: the surer one counts.
    np.testing.assert_array_equal(found, expected)


def test_of_two_rows_with_as_many_feet_the_surer_contact_is_kept():
    status = np.full((2, 2), LANDED)
    found, _ = found_twice(STEPS, INSTANT[:, :2], SE[:, :2], status)
    np.testing.assert_array_equal(found, [[False, True], [True, False]])


def test_the_choice_between_two_contacts_far_apart_is_an_error():
    instant = np.array([[1.0], [1.004]])
    se = np.array([[0.001], [0.0005]])
    step = STEPS.take(np.array([True, False, False]))
    landed = np.full((2, 1), LANDED)
    _, choice_s = found_twice(step, instant, se, landed)
    expected_s = np.sqrt((0.004**2 - 0.001**2) / 2)
    np.testing.assert_allclose(choice_s, [[0.0], [expected_s]])
    # One without a kink says itself that it may be elsewhere, as does one that is near.
    _, choice_s = found_twice(step, instant, np.array([[0.02], [0.0005]]), landed)
    assert not choice_s.any()
    _, choice_s = found_twice(step, instant, np.array([[0.005], [0.0005]]), landed)
    assert not choice_s.any()
