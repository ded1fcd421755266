from dataclasses import replace

import numpy as np
import pytest

from hopdata.landings.contacts import descents
from hopdata.landings.contacts.judged import NO_MARKER, Contacts
from hopdata.landings.contacts.steps import TOGETHER_S
from hopdata.landings.contacts.together import landed_together

NAN = np.nan


def contacts_at(instants, status=None):
    """Return contacts (L, n) at these instants; NaN for a foot that did not land."""
    instant = np.array(instants, float)
    if status is None:
        status = np.where(np.isnan(instant), descents.NOT_LANDED, descents.LANDED)
    return Contacts(
        instant=instant,
        se=np.where(np.isnan(instant), NAN, 0.001),
        status=np.array(status),
        noise_m=0.001,
        common=np.zeros(instant.shape[1]),
    )


def test_rows_that_need_no_change_stay_as_they_are():
    """Each descent is a landing of its own: nothing is joined or split."""
    spans = np.array([[0.2, 0.6], [1.2, 1.6]])
    hidden = np.array([False, True])
    status = [[0, 0, descents.ALREADY_DOWN], [0, descents.MISSING, 0]]
    given = contacts_at([[0.5, 0.52, NAN], [1.5, NAN, 1.51]], status)
    again, is_hidden, found = landed_together(spans, hidden, given)
    np.testing.assert_array_equal(again, spans)
    np.testing.assert_array_equal(is_hidden, hidden)
    np.testing.assert_array_equal(found.instant, given.instant)
    np.testing.assert_array_equal(found.se, given.se)
    np.testing.assert_array_equal(found.status, given.status)


def test_markers_go_with_the_contacts_that_they_make():
    spans = np.array([[0.1, 0.6], [0.2, 0.7]])
    given = replace(
        contacts_at([[0.500, NAN, NAN], [NAN, 0.501, NAN]]),
        marker=np.array([[2, 0, 1], [1, 0, 1]]),
        marker_probability=np.array([[0.9, NAN, 0.7], [0.8, 0.6, 0.5]]),
    )
    _, _, found = landed_together(spans, np.array([False, True]), given)
    assert found.marker.tolist() == [[2, 0, NO_MARKER]]
    np.testing.assert_array_equal(found.marker_probability, [[0.9, 0.6, NAN]])


def test_a_pair_that_was_sought_in_two_descents_is_one_landing():
    spans = np.array([[0.1, 0.6], [0.2, 0.7]])
    given = contacts_at([[0.500, NAN], [NAN, 0.501]])
    again, is_hidden, found = landed_together(spans, np.array([False, True]), given)
    np.testing.assert_array_equal(again, [[0.1, 0.7]])
    assert is_hidden.tolist() == [False]
    np.testing.assert_array_equal(found.instant, [[0.500, 0.501]])


@pytest.mark.parametrize(("apart_s", "n_landings"), [(0.9, 1), (1.1, 2)])
def test_feet_far_apart_in_one_descent_are_two_landings(apart_s, n_landings):
    """Fore feet, and hind feet after them: whatever the body's descent holds."""
    late_s = apart_s * TOGETHER_S
    given = contacts_at([[0.5, 0.5 + late_s]])
    again, _, found = landed_together(np.array([[0.1, 0.9]]), np.array([False]), given)
    assert len(again) == n_landings
    known = found.instant[np.isfinite(found.instant)]
    assert sorted(known.tolist()) == [0.5, 0.5 + late_s]


def test_a_foot_lands_once_in_a_landing():
    given = contacts_at([[0.50, 0.51], [0.58, NAN]])
    again, _, found = landed_together(
        np.array([[0.1, 0.6], [0.55, 0.6]]), np.zeros(2, bool), given
    )
    np.testing.assert_array_equal(found.instant, [[0.50, 0.51], [0.58, NAN]])
    assert len(again) == 2


def test_a_foot_that_may_have_landed_unseen_is_told_once():
    """It stays with the first of the landings that its descent holds."""
    status = [[0, descents.MISSING, 0]]
    given = contacts_at([[0.5, NAN, 0.5 + 2 * TOGETHER_S]], status)
    _, _, found = landed_together(np.array([[0.1, 0.9]]), np.array([False]), given)
    assert found.status.tolist() == [
        [descents.LANDED, descents.MISSING, descents.NOT_LANDED],
        [descents.NOT_LANDED, descents.NOT_LANDED, descents.LANDED],
    ]


def test_a_row_without_a_contact_is_kept_in_its_place():
    status = [[descents.POOR_FIT, descents.NOT_LANDED], [0, 0]]
    given = contacts_at([[NAN, NAN], [1.5, 1.51]], status)
    again, _, found = landed_together(
        np.array([[0.1, 0.6], [1.1, 1.6]]), np.zeros(2, bool), given
    )
    np.testing.assert_array_equal(again, [[0.1, 0.6], [1.1, 1.6]])
    np.testing.assert_array_equal(found.status, given.status)


def test_nothing_is_made_of_nothing():
    given = contacts_at(np.empty((0, 2)))
    again, hidden, found = landed_together(np.empty((0, 2)), np.zeros(0, bool), given)
    assert again.shape == (0, 2)
    assert hidden.shape == (0,)
    assert found.instant.shape == (0, 2)
