"""Which fits can be trusted, and what is told of the others."""

from types import SimpleNamespace

import numpy as np
import pytest
from falling_feet import falls

from hopdata.landings.contacts.descents import (
    LANDED,
    MISSING,
    NOT_LANDED,
    POOR_FIT,
    RISES,
    THIN,
)
from hopdata.landings.contacts.judged import frames_missing, is_odd, judge_fits


def fits_of(instant, **changed):
    """Return fits with these instants that nothing speaks against, but for what is changed."""
    shape = instant.shape
    fields = {
        "n_before": np.full(shape, 9),
        "n_after": np.full(shape, 9),
        "dof": np.full(shape, 10.0),
        "unit_se": np.full(shape, 0.5),
        "misfit": np.full(shape, 10.0),
        "velocity": -np.ones(shape),
        "instant": instant,
    }
    return SimpleNamespace(**fields | changed)


def judged(fits, *, hidden=False, status=LANDED, noise_m=1.0, maximum_misfit=3.0):
    shape = fits.instant.shape
    return judge_fits(
        fits,
        np.full(shape, status),
        np.full(shape, hidden),
        noise_m=noise_m,
        maximum_misfit=maximum_misfit,
    )


def test_a_landing_with_few_frames_and_none_missing_is_told_so():
    made = falls(40, seed=1)
    fits = fits_of(
        made.contacts,
        n_before=np.full((40, 3), 2),
        dof=np.ones((40, 3)),
        misfit=np.ones((40, 3)),
    )
    heights = made.heights.copy()
    at = np.searchsorted(made.time, made.contacts)
    heights[at[5, 1] - 3 : at[5, 1], 1] = np.nan
    hidden = frames_missing(made.time, heights, made.contacts, (0.05, 0.02))
    found = judge_fits(
        fits, np.full((40, 3), LANDED), hidden, noise_m=1.0, maximum_misfit=3.0
    )
    assert np.argwhere(found.status == MISSING).tolist() == [[5, 1]]
    assert (found.status == THIN).sum() == 119
    assert np.isnan(found.instant).all()


@pytest.mark.parametrize(
    ("changed", "status", "is_timed"),
    [
        ({}, LANDED, True),
        ({"misfit": 10.0 * 3.1**2}, POOR_FIT, True),
        ({"misfit": 10.0 * 2.9**2}, LANDED, True),
        ({"velocity": 0.1}, RISES, True),
        ({"n_before": 2}, THIN, False),
        ({"n_before": 3}, LANDED, True),
        ({"n_after": 1}, THIN, False),
        ({"n_after": 2}, LANDED, True),
        ({"dof": 0.0}, THIN, False),
        ({"unit_se": np.inf}, THIN, False),
    ],
)
def test_each_reason_not_to_trust_a_fit(changed, status, is_timed):
    instant = np.full((2, 3), 0.7)
    arrays = {name: np.full((2, 3), value) for name, value in changed.items()}
    found = judged(fits_of(instant, **arrays))
    assert (found.status == status).all()
    assert (np.isfinite(found.instant) == is_timed).all()
    assert (np.isfinite(found.se) == is_timed).all()


def test_what_was_known_before_the_fit_is_not_judged_again():
    poor = fits_of(np.zeros((1, 2)), misfit=np.full((1, 2), 1e3))
    assert (judged(poor, status=NOT_LANDED).status == NOT_LANDED).all()


def test_errors_are_widened_by_misfits_beyond_chance_alone():
    instant = np.zeros((1, 2))
    beyond = 1 + 3 / np.sqrt(20)  # three standard deviations of an rms of ten
    misfit = 10.0 * np.array([[0.99 * beyond, 1.01 * beyond]]) ** 2
    se = judged(fits_of(instant, misfit=misfit), noise_m=2.0).se
    np.testing.assert_allclose(se, [[1.0, 1.0]])
    se = judged(fits_of(instant, misfit=4 * misfit), noise_m=2.0).se
    np.testing.assert_allclose(se, [[1.0, 1.01 * beyond]])


def test_a_contact_is_odd_if_it_misfits_twice_as_much_as_the_others():
    misfit = np.full((20, 3), 10.0)
    misfit[4, 2] = 10.0 * 2.2**2
    misfit[5, 2] = 10.0 * 1.8**2
    fits = fits_of(np.zeros((20, 3)), misfit=misfit)
    assert np.argwhere(is_odd(fits, np.ones((20, 1)))).tolist() == [[4, 2]]


def test_frames_are_missing_up_to_the_end_of_a_recording_and_nowhere_without_a_contact():
    time = 0.01 * np.arange(10)
    near = np.array([[0.085, 0.085, np.nan]])
    heights = np.zeros((10, 3))
    heights[9, 0] = np.nan  # within the window, which ends after the recording
    heights[4, 1] = np.nan  # before the window
    heights[9, 2] = np.nan
    found = frames_missing(time, heights, near, (0.03, 0.05))
    assert found.tolist() == [[True, False, False]]
