import numpy as np
import pytest

from hopdata.synthesis.capture import observe
from hopdata.synthesis.floor import draw_floor
from hopdata.synthesis.options import FloorOptions

FLOOR = draw_floor(FloorOptions(), np.random.default_rng(1))
TRUE = np.random.default_rng(2).uniform(-1, 1, (20_000, 4, 3))
NOBODY = np.zeros(TRUE.shape[:2], dtype=bool)


def seen(noise_m=0.0006, resolution_m=0.0, hidden=NOBODY):
    return observe(
        TRUE,
        floor=FLOOR,
        noise_m=noise_m,
        resolution_m=resolution_m,
        hidden=hidden,
        rng=np.random.default_rng(3),
    )


def test_without_noise_only_the_floor_is_added_and_only_to_z():
    error = seen(noise_m=0.0) - TRUE
    np.testing.assert_array_equal(error[..., :2], 0)
    np.testing.assert_allclose(error[..., 2], FLOOR.height(TRUE[..., :2]), atol=1e-15)


def test_noise_is_per_coordinate_and_a_distance_varies_by_sqrt_two_of_it():
    error = seen() - seen(noise_m=0.0)
    np.testing.assert_allclose(error.std(axis=0), 0.0006, rtol=0.03)
    assert abs(np.corrcoef(error[:, 0, 0], error[:, 0, 1])[0, 1]) < 0.03

    def distance(positions):
        return np.linalg.norm(positions[:, 0] - positions[:, 1], axis=-1)

    assert (distance(seen()) - distance(seen(noise_m=0.0))).std() == pytest.approx(
        0.0006 * np.sqrt(2), rel=0.03
    )


def test_positions_are_multiples_of_the_resolution():
    step = 2.0**-12
    coarse = seen(resolution_m=step)
    np.testing.assert_array_equal(coarse / step, np.round(coarse / step))
    assert np.abs(coarse - seen()).max() <= step / 2
    fine = seen() / step
    assert np.any(fine != np.round(fine))


def test_hidden_markers_are_missing_in_all_coordinates_and_the_true_ones_are_kept():
    hidden = NOBODY.copy()
    hidden[10:20, 2] = True
    positions = seen(hidden=hidden)
    np.testing.assert_array_equal(np.isnan(positions).all(axis=-1), hidden)
    np.testing.assert_array_equal(np.isnan(positions).any(axis=-1), hidden)
    assert not np.isnan(TRUE).any()
