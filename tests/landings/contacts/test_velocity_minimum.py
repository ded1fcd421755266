"""The printed method."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.signal import savgol_filter
from synthetic_landings import PRE_HEIGHT_M, simulate, transitions_of

from hopdata.landings.contacts.velocity_minimum import (
    derivative_weights,
    filter_window,
    savitzky_golay_velocity,
    velocity_minima,
)


def test_velocity_agrees_with_scipy():
    values = np.random.default_rng(0).normal(size=(50, 3))
    ours = savitzky_golay_velocity(values, 200.0, window=7)
    theirs = savgol_filter(values, 7, 3, deriv=1, delta=1 / 200, axis=0)
    np.testing.assert_allclose(ours[3:-3], theirs[3:-3], atol=1e-10)
    assert np.isnan(ours[:3]).all()
    assert np.isnan(ours[-3:]).all()


@pytest.mark.parametrize("window", [5, 7, 35])
def test_weights_are_the_nearest_numbers_to_the_exact_fractions(window):
    """Thus they are the same with any machine's linear algebra."""
    frames = [Fraction(k - window // 2) for k in range(window)]
    s2, s4, s6 = (sum(k**power for k in frames) for power in (2, 4, 6))
    exact = [float((s6 * k - s4 * k**3) / (s2 * s6 - s4**2)) for k in frames]
    assert derivative_weights(window).tolist() == exact


def test_the_filter_lasts_as_long_at_every_rate():
    assert filter_window(100.0) == filter_window(1 / 0.010000000001) == 7
    assert [filter_window(rate) for rate in (50.0, 200.0, 500.0, 2000.0)] == [
        5,
        15,
        35,
        141,
    ]
    noise = np.random.default_rng(0).normal(0, 6e-4, (4000, 3))
    errors = [
        savitzky_golay_velocity(noise, r)[100:-100].std()
        for r in (100.0, 500.0, 2000.0)
    ]
    assert errors[2] < errors[1] < errors[0] < 0.04, "m/s"


def test_velocity_of_a_cubic_is_exact_and_gaps_stay_gaps():
    t = np.arange(30) / 100
    values = (t**3 - 2 * t)[:, None]
    values[20] = np.nan
    velocity = savitzky_golay_velocity(values, 100.0)[:, 0]
    np.testing.assert_allclose(velocity[3:17], 3 * t[3:17] ** 2 - 2, atol=1e-12)
    assert np.isnan(velocity[17:24]).all()
    assert np.isfinite(velocity[24:27]).all()


@pytest.fixture(scope="module")
def landings():
    scene = simulate(300, seed=4)
    return scene, transitions_of(
        scene, PRE_HEIGHT_M + 0.04
    )  # the minimum leads the contact


def errors(landings, *, parabola):
    scene, transitions = landings
    recording = scene.recording
    instant, se = velocity_minima(
        recording.time,
        recording.feet[:, :, 2],
        transitions,
        noise_m=6e-4,
        parabola=parabola,
    )
    return instant - scene.contact_times, se


def test_whole_frames_are_good_to_a_frame(landings):
    error, se = errors(landings, parabola=False)
    assert (error - error.mean()).std() == pytest.approx(0.003, abs=0.0006)
    np.testing.assert_allclose(se, 0.01 / np.sqrt(12))


def test_the_parabola_is_better(landings):
    whole, _ = errors(landings, parabola=False)
    error, se = errors(landings, parabola=True)
    assert (error - error.mean()).std() < 0.5 * (whole - whole.mean()).std()
    assert 0.0002 < np.median(se) < 0.002


def test_a_gap_in_the_transition_gives_no_instant(landings):
    scene, transitions = landings
    heights = scene.recording.feet[:, :, 2].copy()
    at = np.searchsorted(scene.recording.time, scene.contact_times[0, 0])
    heights[at, 0] = np.nan
    instant, _ = velocity_minima(
        scene.recording.time, heights, transitions, noise_m=6e-4, parabola=True
    )
    assert np.isnan(instant[0]).tolist() == [True, False, False]


@pytest.mark.parametrize("side", ["t_pre", "t_post"])
def test_a_minimum_outside_the_transition_is_found_there_not_at_its_end(landings, side):
    """So the touchdown is excluded, as Sec. 2.2.3 asks."""
    scene, transitions = landings
    recording = scene.recording

    def minima(of):
        found, _ = velocity_minima(
            recording.time,
            recording.feet[:, :, 2],
            of,
            noise_m=6e-4,
            parabola=False,
        )
        return found

    usual = minima(transitions)
    # An end of each transition is moved past the minimum of the first foot, by 0.02 s.
    shift = {"t_pre": 0.02, "t_post": -0.02}[side]
    cut = replace(transitions, **{side: usual[:, 0] + shift})
    outside = minima(cut)[:, 0]
    known = np.isfinite(outside)
    assert known.mean() > 0.7
    if side == "t_post":
        is_outside = outside[known] > cut.t_post[known]
    else:
        is_outside = outside[known] < cut.t_pre[known]
    assert is_outside.mean() > 0.95
    assert (outside == usual[:, 0])[known].mean() > 0.95
