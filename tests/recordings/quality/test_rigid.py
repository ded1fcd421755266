import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.quality.processing import (
    cut_off,
    frames_of_pattern,
    low_pass,
    treated,
)
from hopdata.recordings.quality.rigid import frame_noise, pair_distances, rigid_clusters


def clusters(positions):
    return rigid_clusters(pair_distances(positions), frame_noise(positions))


@pytest.mark.parametrize("noise_m", [3e-4, 6e-4, 2e-3])
def test_the_noise_is_found_from_distances_and_from_frame_to_frame(noise_m):
    positions = hopping(1, n_frames=4000, noise_m=noise_m)[1]
    body = next(c for c in clusters(positions) if 0 in c.markers)
    assert body.noise == pytest.approx(noise_m, rel=0.15)
    # This includes contacts and the curvature of the flight.
    np.testing.assert_allclose(frame_noise(positions), noise_m, rtol=0.25)


def test_the_body_is_a_cluster_and_a_fixed_post_is_not_of_it():
    found = [{MARKERS[m] for m in c.markers} for c in clusters(hopping(2)[1])]
    assert {"hip1", "hip2", "hip3"} in found
    assert not any("post" in names for names in found)


def test_markers_that_wander_are_no_cluster():
    walk = np.cumsum(np.random.default_rng(3).normal(0, 0.01, (2000, 5, 3)), axis=0)
    assert clusters(walk) == ()


def test_a_marker_whose_frames_are_mixed_up_is_on_no_rigid_body():
    positions = hopping(6)[1]
    mixed = positions.copy()
    mixed[:, 1] = np.random.default_rng(6).permutation(mixed[:, 1])
    with_spare = np.concatenate([mixed, positions[:, 1:2]], axis=1)
    found = [set(c.markers) for c in clusters(with_spare)]
    assert {0, 2, 7} in found
    assert not any(1 in markers for markers in found)


def test_noise_alone_makes_no_body_less_rigid():
    positions = hopping(7, noise_m=3e-3)[1]
    assert {0, 1, 2} in [set(c.markers) for c in clusters(positions)]


def test_two_markers_are_no_cluster():
    assert clusters(hopping(4)[1][:, :2]) == ()


def test_a_marker_never_seen_joins_none():
    positions = hopping(5)[1]
    positions[:, 2] = np.nan
    assert all(2 not in c.markers for c in clusters(positions))
    assert np.isnan(frame_noise(positions)[2])


def at_another_rate(body, times, how):
    from scipy.interpolate import CubicSpline

    at = np.arange(times * (len(body) - 1)) / times
    if how == "held":
        return body[np.floor(at).astype(int)]
    if how == "spline":
        return CubicSpline(np.arange(len(body)), body)(at)
    low, share = np.floor(at).astype(int), (at % 1)[:, None, None]
    return (1 - share) * body[low] + share * body[low + 1]


@pytest.mark.parametrize("how", ["held", "straight", "spline"])
@pytest.mark.parametrize(("times", "frames"), [(2, 2), (3, 3), (1.25, 5)])
def test_positions_brought_to_another_rate_are_told(how, times, frames):
    body = hopping(5, n_frames=2000)[1][:, :3]
    body[700:730, 1] = np.nan
    assert treated(body, 100.0) == []
    changed = np.round(at_another_rate(body[800:], times, how), 6)
    assert np.round(frames_of_pattern(changed), 2) in (frames, frames / 2)
    (told,) = treated(changed, 100.0 * times)
    assert told.code == "recordings.resampled"
    assert f"{100 * times:g} Hz from another rate" in str(told)


@pytest.mark.parametrize("poles", [2, 4])
@pytest.mark.parametrize(("hz", "rate_hz"), [(6, 100), (12, 100), (10, 200), (15, 250)])
def test_a_low_pass_is_told_with_its_cut_off(hz, rate_hz, poles):
    from scipy.signal import butter, filtfilt

    body = hopping(6, n_frames=3000, rate_hz=rate_hz)[1][:, :3]
    assert treated(body, rate_hz) == []
    assert cut_off(body) == low_pass(body) == 0
    smooth = np.round(filtfilt(*butter(poles, hz / rate_hz * 2), body, axis=0), 6)
    assert cut_off(smooth) * rate_hz == pytest.approx(hz, rel=0.15)
    assert low_pass(smooth) == cut_off(smooth)
    (told,) = treated(smooth, rate_hz)
    assert told.code == "recordings.low_pass"
    assert told.values["cut_off_hz"] == pytest.approx(hz, rel=0.15)
    assert "export them unfiltered" in str(told)
    assert (
        treated(0.02 * body, rate_hz, scale=1 / 64) == []
    )  # an insect under better cameras


def test_the_noise_of_a_marker_does_not_depend_on_the_axes():
    rng = np.random.default_rng(np.random.SeedSequence(21))
    steps = rng.normal(size=(5_000, 2, 3)) * [3e-4, 1e-4, 2e-4]
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        frame_noise(steps @ turn), frame_noise(steps), rtol=1e-12
    )
    alike = rng.normal(scale=2e-4, size=(20_000, 2, 3))
    np.testing.assert_allclose(frame_noise(alike), 2e-4, rtol=0.03)
