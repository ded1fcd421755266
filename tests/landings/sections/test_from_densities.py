"""Sections at knees of densities, as the dissertation prints them."""

import numpy as np
import pytest
from scipy.stats import norm

from hopdata.errors import AnalysisError
from hopdata.landings.sections.densities import grid_of
from hopdata.landings.sections.frames import Frames
from hopdata.landings.sections.from_densities import heights_from_densities, upper_knee


@pytest.mark.parametrize("bandwidth_m", [0.5e-3, 1e-3, 3e-3])
def test_the_threshold_is_where_the_ground_mode_bends_most(bandwidth_m):
    rng = np.random.default_rng(1)
    ground = 0.001 * rng.standard_normal(40_000)
    air = rng.uniform(0.0, 0.3, 20_000)
    found = upper_knee(np.concatenate([ground, air, [np.nan]]), bandwidth_m)
    # A normal curve bends most, upwards, at the root of three deviations.
    expected = np.sqrt(3) * np.hypot(0.001, bandwidth_m)
    assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("bandwidth_m", [0.5e-3, 1e-3, 3e-3])
def test_the_knee_of_a_normal_curve_is_at_the_nearest_node(bandwidth_m):
    heights = 0.001 * norm.ppf((np.arange(20_000) + 0.5) / 20_000)
    grid = grid_of(heights, bandwidth_m)
    expected = np.sqrt(3) * np.hypot(0.001, bandwidth_m)
    nearest = grid[np.argmin(np.abs(grid - expected))]
    assert upper_knee(heights, bandwidth_m) == nearest


def test_a_higher_mode_of_feet_in_the_air_is_not_the_ground():
    rng = np.random.default_rng(1)
    ground = 0.001 * rng.standard_normal(10_000)
    air = 0.2 + 0.005 * rng.standard_normal(30_000)
    assert upper_knee(np.concatenate([ground, air]), 0.002) < 0.01


def frames_between(low_m, high_m, number=50_000):
    """Return frames whose body is anywhere, with feet up above and down below these heights."""
    body = np.random.default_rng(1).uniform(0.2, 0.6, number)
    return Frames(body=body, all_up=body > high_m, all_down=body < low_m)


@pytest.mark.parametrize("bandwidth_m", [1e-3, 4e-3, 16e-3])
def test_sections_are_where_the_densities_have_left_zero(bandwidth_m):
    pre_m, post_m = heights_from_densities(frames_between(0.3, 0.5), bandwidth_m)
    # The edge of a uniform density falls to 2 % at 2.05 bandwidths.
    assert pre_m == pytest.approx(0.5 + 2.05 * bandwidth_m, abs=0.25 * bandwidth_m)
    assert post_m == pytest.approx(0.3 - 2.05 * bandwidth_m, abs=0.25 * bandwidth_m)


def test_both_sections_are_found_by_one_rule():
    """Upside down, with feet up where they were down, each section is the other."""
    frames = frames_between(0.3, 0.5)
    mirrored = Frames(
        body=0.8 - frames.body, all_up=frames.all_down, all_down=frames.all_up
    )
    pre_m, post_m = heights_from_densities(frames, 0.004)
    pre_of_mirrored, post_of_mirrored = heights_from_densities(mirrored, 0.004)
    # A node of the grid is 0.25 mm from the next.
    assert pre_of_mirrored == pytest.approx(0.8 - post_m, abs=1e-9)
    assert post_of_mirrored == pytest.approx(0.8 - pre_m, abs=1e-9)


def test_a_sparse_tail_has_left_zero():
    frames = frames_between(0.3, 0.5)
    odd = np.linspace(0.25, 0.3, 20)  # a few frames with some foot up below
    with_tail = Frames(
        body=np.concatenate([frames.body, odd]),
        all_up=np.concatenate([frames.all_up, np.zeros(20, bool)]),
        all_down=np.concatenate([frames.all_down, np.zeros(20, bool)]),
    )
    expected = heights_from_densities(frames, 0.004)
    assert heights_from_densities(with_tail, 0.004) == pytest.approx(expected, abs=1e-3)


def test_a_bandwidth_finer_than_the_grid_is_refused():
    with pytest.raises(
        AnalysisError, match=r"sections\.bandwidth_m: expected at least"
    ):
        heights_from_densities(frames_between(0.3, 0.5), 1e-7)
