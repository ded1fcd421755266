"""Kernel densities against their exact sum, SciPy's and the normal rule."""

import numpy as np
import pytest
from scipy.fft import next_fast_len
from scipy.stats import gaussian_kde

from hopdata.landings.sections.densities import (
    fast_length,
    finite,
    kde,
    normal_bandwidth,
)


def exact(samples, bandwidth, grid):
    scaled = (grid[:, None] - samples) / bandwidth
    return np.exp(-0.5 * scaled**2).sum(axis=1) / (
        len(samples) * bandwidth * np.sqrt(2 * np.pi)
    )


@pytest.fixture(scope="module")
def heights():
    rng = np.random.default_rng(1)
    return np.concatenate([rng.normal(0, 0.0007, 2000), rng.uniform(0, 0.25, 2000)])


@pytest.mark.parametrize("bandwidth", [1e-4, 3e-4, 1e-3, 2.46e-3, 1e-2, 5e-2, 1.0])
def test_agrees_with_the_exact_sum(heights, bandwidth):
    peak = exact(heights, bandwidth, np.sort(heights)).max()
    for nodes in (2, 37, 1024):
        grid = np.linspace(-0.02, 0.27, nodes)
        expected = exact(heights, bandwidth, grid)
        error = np.abs(kde(heights, bandwidth=bandwidth, grid=grid) - expected)
        assert error.max() < 1e-8 * peak


def test_values_that_are_not_finite_are_left_out(heights):
    grid = np.linspace(0.01, 0.27, 512)
    samples = np.concatenate([[np.nan], heights, [np.inf, -np.inf]])
    expected = kde(heights, bandwidth=2.46e-3, grid=grid)
    assert np.array_equal(kde(samples, bandwidth=2.46e-3, grid=grid), expected)


def test_agrees_with_scipy(heights):
    grid = np.linspace(-0.02, 0.27, 400)
    peer = gaussian_kde(heights, bw_method=0.01)
    ours = kde(heights, bandwidth=float(np.sqrt(peer.covariance[0, 0])), grid=grid)
    np.testing.assert_allclose(ours, peer(grid), rtol=0, atol=1e-8 * ours.max())


def test_is_the_exact_kernel_for_one_sample_between_nodes():
    grid = np.linspace(-1, 1, 301)
    density = kde([0.1234], bandwidth=0.05, grid=grid)
    np.testing.assert_allclose(
        density,
        exact(np.array([0.1234]), 0.05, grid),
        rtol=0,
        atol=1e-8 * density.max(),
    )
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=1e-9)


def test_samples_off_the_grid_reach_into_it_and_count_in_the_total():
    grid = np.linspace(0.0, 1.0, 101)
    samples = np.array([-0.05, 0.5, 7.0, -300.0])
    density = kde(samples, bandwidth=0.1, grid=grid)
    np.testing.assert_allclose(density, exact(samples, 0.1, grid), rtol=0, atol=1e-8)
    assert density[0] > 0.5
    assert np.trapezoid(density, grid) < 0.4


def test_nothing_wraps_around_from_one_end_to_the_other():
    density = kde([1.0], bandwidth=0.02, grid=np.linspace(0.0, 1.0, 501))
    assert density[0] == pytest.approx(0.0, abs=1e-9)
    assert density[-1] == pytest.approx(1 / (0.02 * np.sqrt(2 * np.pi)), rel=1e-6)


def test_moving_samples_and_grid_together_changes_nothing(heights):
    grid = np.linspace(-0.02, 0.27, 300)
    here = kde(heights, bandwidth=1e-3, grid=grid)
    there = kde(heights + 5.0, bandwidth=1e-3, grid=grid + 5.0)
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-6 * here.max())


def test_values_that_are_not_finite_are_ignored(heights):
    grid = np.linspace(0, 0.25, 100)
    with_gaps = np.concatenate([heights, [np.nan, np.inf, -np.inf]])
    np.testing.assert_array_equal(
        kde(with_gaps, bandwidth=1e-3, grid=grid),
        kde(heights, bandwidth=1e-3, grid=grid),
    )
    assert finite(with_gaps).size == heights.size


def test_says_that_a_bandwidth_is_too_small():
    with pytest.raises(ValueError, match="too small for a grid"):
        kde([0.0], bandwidth=1e-9, grid=[0, 1])


def test_normal_bandwidth_of_a_normal_sample():
    values = np.random.default_rng(2).normal(3.0, 2.0, 10000)
    assert normal_bandwidth(values) == pytest.approx(0.9 * 2.0 * 10000**-0.2, rel=0.02)


def test_normal_bandwidth_is_not_widened_by_a_few_far_away():
    values = np.random.default_rng(2).normal(0.0, 1.0, 1000)
    far = np.concatenate([values, np.full(10, 1e3)])
    assert normal_bandwidth(far) == pytest.approx(normal_bandwidth(values), rel=0.05)


def test_lengths_of_transforms_are_those_of_scipy():
    for least in (
        *range(1, 2000),
        *np.random.default_rng(3).integers(2000, 2**23, 500).tolist(),
    ):
        assert fast_length(least) == next_fast_len(least, real=True)
