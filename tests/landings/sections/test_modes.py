import numpy as np
import pytest
from scipy.stats import norm

from hopdata.errors import AnalysisError
from hopdata.landings.sections.modes import ground_mode


def feet(rng, n=30000, sigma=0.0006, ground=0.0):
    return np.concatenate(
        [rng.normal(ground, sigma, n // 2), ground + rng.uniform(0, 0.25, n - n // 2)]
    )


@pytest.mark.parametrize("ground", [-0.3, 0.0, 0.044])
def test_finds_ground_and_noise(ground):
    mode = ground_mode(feet(np.random.default_rng(0), ground=ground))
    assert mode.height_m == pytest.approx(ground, abs=1e-4)
    assert mode.sigma_m == pytest.approx(0.0006, rel=0.1)
    assert mode.knee(3.0) == mode.height_m + 3 * mode.sigma_m


@pytest.mark.parametrize("ground", [-0.3, 0.0, 0.044])
def test_the_mode_of_a_symmetric_density_is_its_middle(ground):
    """Found between the nodes of its grid, which are 20 micrometres apart."""
    heights = ground + 0.0006 * norm.ppf((np.arange(30_000) + 0.5) / 30_000)
    mode = ground_mode(heights)
    assert mode.height_m == pytest.approx(ground, abs=1e-6)
    assert mode.sigma_m == pytest.approx(0.0006, rel=2e-3)


def test_takes_the_lower_of_two_large_modes_even_if_the_upper_is_larger():
    rng = np.random.default_rng(2)
    heights = np.concatenate([rng.normal(0, 0.001, 3000), rng.normal(0.2, 0.001, 6000)])
    assert ground_mode(heights).height_m == pytest.approx(0.0, abs=2e-4)


def test_a_few_glitches_below_the_ground_are_no_mode():
    rng = np.random.default_rng(3)
    heights = np.concatenate([feet(rng), rng.normal(-0.1, 0.001, 200)])
    mode = ground_mode(heights)
    assert mode.height_m == pytest.approx(0.0, abs=1e-4)
    assert mode.sigma_m == pytest.approx(0.0006, rel=0.1)


def test_data_without_noise_keep_a_finest_sigma():
    heights = np.concatenate([np.zeros(500), np.linspace(0, 0.2, 500)])
    mode = ground_mode(heights)
    assert mode.height_m == pytest.approx(0.0, abs=2e-5)
    assert mode.sigma_m == pytest.approx(1e-5)


def test_heights_in_whole_millimetres_have_at_least_half_their_step():
    rng = np.random.default_rng(4)
    fine = feet(rng, sigma=5e-5)
    coarse = ground_mode(np.round(fine, 3))
    assert coarse.sigma_m >= 5e-4
    assert coarse.height_m == pytest.approx(0.0, abs=5e-4)
    assert ground_mode(np.round(fine, 6)).sigma_m == pytest.approx(5e-5, rel=0.2)


def test_too_few_heights():
    with pytest.raises(AnalysisError, match="at least 20 frames"):
        ground_mode(np.append(np.zeros(19), np.nan))
