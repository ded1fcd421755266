"""Landings that single feet show: a contact that two rows hold is kept in one of them."""

import numpy as np

from hopdata.landings.contacts.descents import LANDED, POOR_FIT
from hopdata.landings.contacts.steps import NO_OTHER, Steps, found_twice

# Three feet come down once. The feet's row holds two of them, the body's all three.
STEPS = Steps(
    foot=np.arange(3), apex=np.zeros(3), half_way=np.full(3, 0.5), down=np.full(3, 0.9)
)
INSTANT = np.array([[1.0, 1.01, np.nan], [1.0002, 1.0099, 1.02]])
SE = np.array([[1e-4, 3e-4, np.nan], [2e-4, 2e-4, 2e-4]])


def test_of_two_rows_the_surer_contact_of_each_foot_is_kept():
    """Though it is the third foot's row that tells of more feet."""
    status = np.full((2, 3), LANDED)
    for order in ([0, 1], [1, 0]):
        found, _, _ = found_twice(STEPS, INSTANT[order], SE[order], status)
        expected = [[False, True, False], [True, False, False]]
        np.testing.assert_array_equal(found[order], expected)


def test_a_contact_that_can_be_trusted_is_kept_before_one_that_says_it_is_surer():
    status = np.full((2, 3), LANDED)
    status[0, 0] = POOR_FIT
    found, _, _ = found_twice(STEPS, INSTANT, SE[::-1], status)
    np.testing.assert_array_equal(found[:, 0], [True, False])


def test_the_choice_between_two_contacts_far_apart_is_an_error():
    instant = np.array([[1.0], [1.004]])
    se = np.array([[0.001], [0.0005]])
    step = STEPS.take(np.array([True, False, False]))
    landed = np.full((2, 1), LANDED)
    _, choice_s, other = found_twice(step, instant, se, landed)
    expected_s = np.sqrt((0.004**2 - 0.001**2) / 2)
    np.testing.assert_allclose(choice_s, [[0.0], [expected_s]])
    assert other.tolist() == [[NO_OTHER], [0]]
    # One without a kink says itself that it may be elsewhere, as does one that is near.
    _, choice_s, other = found_twice(
        step, instant, np.array([[0.02], [0.0005]]), landed
    )
    assert not choice_s.any()
    assert (other == NO_OTHER).all()
    _, choice_s, other = found_twice(
        step, instant, np.array([[0.005], [0.0005]]), landed
    )
    assert not choice_s.any()
    assert (other == NO_OTHER).all()
