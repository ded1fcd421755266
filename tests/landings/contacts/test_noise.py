"""The noise of heights, its correlation, and what this does to contacts."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from synthetic_landings import simulate

from hopdata.landings.contacts.noise import (
    LEAST_NOISE_M,
    height_noise,
    noise_correlation,
    widening,
)


@pytest.mark.parametrize("noise_m", [2e-4, 6e-4])
def test_noise_of_a_moving_foot(noise_m):
    scene = simulate(60, seed=6, noise_m=noise_m, rate_hz=200)
    heights = scene.recording.feet[:, :, 2].copy()
    heights[::17] = np.nan
    assert height_noise(heights) == pytest.approx(noise_m, rel=0.15)
    assert np.isnan(height_noise(heights * np.nan))


def test_noise_where_every_third_frame_is_seen_and_where_there_is_none():
    scene = simulate(60, seed=6, rate_hz=600)
    heights = scene.recording.feet[:, :, 2].copy()
    heights[np.arange(len(heights)) % 3 > 0] = np.nan
    assert height_noise(heights) == pytest.approx(6e-4, rel=0.15)
    assert height_noise(np.zeros((50, 2))) == LEAST_NOISE_M
    rare = np.full((100, 2), np.nan)
    rare[[1, 50, 99]] = 0.1
    assert np.isnan(height_noise(rare))


# Descents through the two sections.

SECTIONS = {"pre_height_m": 0.3, "post_height_m": -0.3}


def autoregressive(rng, shape, correlation):
    """Return noise of unit variance that is autoregressive along the first axis."""
    noise = rng.standard_normal(shape)
    for k in range(1, len(noise)):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    return noise


@pytest.mark.parametrize("correlation", [0.4, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_how_noise_is_correlated_is_seen_beside_the_motion(correlation, seed):
    motion = 0.3 * np.sin(2 * np.pi * 2 * np.arange(4000) / 200)[:, None, None]
    noise = 3e-4 * autoregressive(
        np.random.default_rng(seed), (4000, 3, 3), correlation
    )
    assert noise_correlation(motion + noise) == pytest.approx(correlation, abs=0.12)


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_and_mere_motion_are_not_correlated(seed):
    white = 3e-4 * np.random.default_rng(seed).standard_normal((4000, 3, 3))
    motion = 0.3 * np.sin(2 * np.pi * 2 * np.arange(4000) / 200)[:, None, None]
    smoothed = sosfiltfilt(butter(2, 15, fs=200, output="sos"), white, axis=0)
    for body in (
        white + motion,
        motion + 0 * white,
        motion + smoothed,
        white[:6],
        np.nan * white,
    ):
        assert noise_correlation(body) == 0.0


@pytest.mark.parametrize("correlation", [0.0, 0.4, 0.8])
def test_errors_of_contacts_are_widened_by_what_correlated_noise_does(correlation):
    before, after = 16, 10
    frame = np.arange(-before, after) + 0.5
    law = np.stack(
        [frame < 0, (frame < 0) * frame, (frame < 0) * frame**2, frame > 0], axis=1
    )
    noise = autoregressive(np.random.default_rng(1), (len(frame), 20_000), correlation)
    fitted, squares, *_ = np.linalg.lstsq(law.astype(float), noise, rcond=None)
    of_contact = (
        np.linalg.inv(law.T.astype(float) @ law) @ [1, 0, 0, -1] @ [1, 0, 0, -1]
    )
    stated = np.sqrt(of_contact * squares.mean() / (len(frame) - 4))
    found = (fitted[0] - fitted[3]).std()
    assert widening(correlation, before, after) == pytest.approx(
        found / stated, rel=0.03
    )
