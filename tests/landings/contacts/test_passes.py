"""Which windows and which law the passes of the kink fit end with."""

from dataclasses import replace

import numpy as np
import pytest
from falling_feet import NOISE_M, falls

from hopdata.landings.contacts import descents, kink_law
from hopdata.landings.contacts.approach import approaches
from hopdata.landings.contacts.law import FRAMES_AFTER, FootHeights, Trials
from hopdata.landings.contacts.passes import (
    LONG_WINDOWS_S,
    SHORT_WINDOWS_S,
    fit_contacts,
    windows_of_at_least,
)


def fitted(made, heights):
    near, earliest, status = approaches(
        made.time,
        heights,
        made.transitions,
        noise_m=NOISE_M,
        down_height_m=0.02,
        lead_s=0.04,
        trail_s=0.03,
    )
    feet = FootHeights(
        made.time, heights, LONG_WINDOWS_S, earliest, leaves_m=8 * NOISE_M
    )
    found, _ = fit_contacts(
        Trials.of([feet], [len(near)]),
        near,
        status == descents.LANDED,
        short_windows_s=[SHORT_WINDOWS_S],
        noise_m=np.array([NOISE_M]),
        gravity="learned",
    )
    return found


def test_feet_that_fly_and_stand_are_fitted_by_one_law_in_long_windows():
    made = falls(60, seed=3)
    found = fitted(made, made.heights)
    assert found.trials.feet[0].windows_s == LONG_WINDOWS_S
    assert not np.any(found.rises)
    assert np.abs(found.fits.instant - made.contacts).max() < 0.003


def test_feet_that_leave_at_once_are_fitted_alone_in_short_windows():
    made = falls(60, seed=3, stands_s=0.012)
    found = fitted(made, made.heights)
    assert found.trials.feet[0].windows_s == SHORT_WINDOWS_S
    assert found.trials.feet[0].leaves_m == np.inf


def test_a_single_foot_that_leaves_at_once_is_fitted_alone_and_not_lost():
    made = falls(60, seed=3)
    leaves = falls(60, seed=3, stands_s=0.012)
    of_landing = np.repeat(np.arange(60), len(made.time) // 60)
    is_this = (of_landing == 7)[:, None] & (np.arange(3) == 0)
    found = fitted(made, np.where(is_this, leaves.heights, made.heights))
    assert np.argwhere(found.rises).tolist() == [[7, 0]]
    assert found.fits.n_after[7, 0] >= FRAMES_AFTER
    assert abs(found.fits.instant[7, 0] - made.contacts[7, 0]) < 0.003


def test_odd_landings_teach_no_law_and_are_fitted_alone():
    made = falls(100, seed=1)
    swings = np.random.default_rng(1).random((100, 1, 3)) < 0.08
    before = made.contacts[:, None] - made.time.reshape(100, -1, 1)
    above = 0.06 * swings * np.clip((before - 0.042) / 0.02, 0, 1)
    found = fitted(made, made.heights + above.reshape(-1, 3))
    odd = np.broadcast_to(found.trials.odd, (100, 1))[:, 0]
    swinging = swings[:, 0].any(axis=1)
    assert found.trials.feet[0].windows_s == LONG_WINDOWS_S
    assert odd[swinging].mean() > 0.9
    assert odd[~swinging].mean() < 0.05
    assert np.abs(found.fits.instant - made.contacts)[swings[:, 0]].max() < 0.01


def test_a_search_that_began_too_late_is_repeated_from_the_earliest_instant():
    made = falls(60, seed=2)
    near, earliest, status = approaches(
        made.time,
        made.heights,
        made.transitions,
        noise_m=NOISE_M,
        down_height_m=0.02,
        lead_s=0.04,
        trail_s=0.03,
    )
    late = np.where(np.arange(60)[:, None] % 10 == 0, near + 0.05, near)
    # A foot that rises after its contact has a kink upwards there.
    heights = made.heights + 0.004 * np.sin(
        40 * np.maximum(made.time.reshape(60, -1, 1) - made.contacts[:, None], 0.0)
    ).reshape(-1, 3)
    feet = FootHeights(made.time, heights, LONG_WINDOWS_S, earliest)
    found, _ = fit_contacts(
        Trials.of([replace(feet, leaves_m=np.inf)], [60]),
        late,
        status == descents.LANDED,
        short_windows_s=[SHORT_WINDOWS_S],
        noise_m=np.array([NOISE_M]),
        gravity="learned",
    )
    moved = found.near != late
    assert moved.any()
    np.testing.assert_array_equal(found.near[moved], earliest[moved])


@pytest.mark.parametrize(
    ("rate_hz", "asked_s", "expected_s"),
    [
        (500.0, (None, None), (0.04, 0.027)),
        (100.0, (None, None), (0.05, 0.03)),
        (100.0, (0.2, None), (0.2, 0.03)),
        (500.0, (None, 0.1), (0.04, 0.1)),
        (100.0, (0.01, 0.01), (0.05, 0.03)),
    ],
)
def test_windows_hold_at_least_five_frames_before_and_three_after(
    rate_hz, asked_s, expected_s
):
    time = np.arange(100) / rate_hz
    found = windows_of_at_least(time, asked_s, SHORT_WINDOWS_S)
    np.testing.assert_allclose(found, expected_s)


def test_errors_that_contacts_share_are_computed_for_the_kept_fits_alone(monkeypatch):
    asked = []
    of_law = kink_law.partly_errors
    monkeypatch.setattr(
        kink_law, "partly_errors", lambda *given: asked.append(1) or of_law(*given)
    )
    made = falls(60, seed=3)
    near = made.contacts + 1e-4
    feet = FootHeights(
        made.time, made.heights, LONG_WINDOWS_S, np.full(near.shape, -np.inf)
    )
    found, common_errors = fit_contacts(
        Trials.of([feet], [len(near)]),
        near,
        np.ones(near.shape, dtype=bool),
        short_windows_s=[SHORT_WINDOWS_S],
        noise_m=np.array([NOISE_M]),
        gravity="learned",
    )
    assert np.isfinite(found.fits.instant).all()
    assert not asked
    errors_s = common_errors()
    assert asked == [1]
    assert errors_s.shape == (1, 3)
    assert (errors_s > 0).all()
    assert (errors_s < 1e-3).all()
