import numpy as np
import pytest

from hopdata.synthesis.floor import CurvedFloor, draw_floor
from hopdata.synthesis.options import FloorOptions


def arena(n=41):
    side = np.linspace(-0.9, 0.9, n)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def test_the_floor_is_curved_by_a_few_millimetres_and_no_cubic():
    xy = arena()
    height = draw_floor(FloorOptions(), np.random.default_rng(1)).height(xy)
    assert 0.002 < np.ptp(height) < 0.010
    x, y = xy.T
    cubic = np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])
    residual = height - cubic @ np.linalg.lstsq(cubic, height)[0]
    assert 1e-6 < residual.std() < 0.0006
    assert np.linalg.matrix_rank(np.column_stack([cubic, height])) == cubic.shape[1] + 1


def test_bowl_rises_to_half_its_depth_at_its_radius():
    flat = np.zeros((0, 2))
    bowl = CurvedFloor(0.004, 1.2, flat, np.zeros(0), 0.001)
    points = np.array([[0.0, 0.0], [1.2, 0.0], [0.0, -1.2]])
    np.testing.assert_allclose(bowl.height(points), [0, 0.002, 0.002])


def test_waves_add_up_and_repeat_after_their_length():
    floor = draw_floor(FloorOptions(bowl_depth_m=0.0, waves=1), np.random.default_rng(2))
    k = floor.wave_vectors[0]
    period = 2 * np.pi * k / (k @ k)
    assert 2.4 <= np.linalg.norm(period) <= 3.6
    xy = arena(5)
    np.testing.assert_allclose(floor.height(xy), floor.height(xy + period), atol=1e-15)
    assert np.abs(floor.height(xy)).max() <= 0.001


def test_a_floor_of_no_depth_and_no_waves_is_flat():
    floor = draw_floor(FloorOptions(bowl_depth_m=0.0, waves=0), np.random.default_rng(3))
    np.testing.assert_array_equal(floor.height(arena()), 0)


def test_floor_height_keeps_the_shape_of_its_points():
    floor = draw_floor(FloorOptions(), np.random.default_rng(4))
    assert floor.height(np.zeros((5, 3, 2))).shape == (5, 3)
    assert floor.height(np.zeros(2)) == pytest.approx(0.001 * np.sin(floor.phases).sum())
