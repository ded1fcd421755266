"""Tables: exact at their nodes and for cubics, smooth in between, periodic."""

import numpy as np
import pytest
from frame_change_models import change_and_gradient, tabulation_errors
from steered_hops import LIMIT, chained_hops, smooth_change

from hopdata.errors import AnalysisError
from hopdata.steering.models.process import trained_process
from hopdata.steering.models.tabulated import (
    TabulatedMap,
    tabulated,
    turn_nodes,
)


class Smooth:
    """The smooth map of the test hops."""

    def change(self, angle, swing):
        return smooth_change(angle, swing)


def points(n=200, seed=0):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return (
        rng.uniform(-10, 10, n),
        rng.uniform(-LIMIT, LIMIT, n),
        rng.uniform(-LIMIT, LIMIT, n),
    )


def test_nodes_are_exact():
    values = np.random.default_rng(1).standard_normal((8, 5, 3))
    table = TabulatedMap(values, LIMIT)
    angle, swing = np.meshgrid(table.boom_angle_rad, table.swing_rad, indexing="ij")
    found = table.change(angle.ravel(), swing.ravel())
    np.testing.assert_allclose(found, values.reshape(-1, 3), atol=1e-12)


def test_the_error_falls_with_the_fourth_power_of_the_spacing():
    angle, swing, _ = points()
    errors = []
    for nodes in (16, 32, 64):
        table = tabulated(Smooth(), LIMIT, angles=nodes, swings=nodes // 2 + 1)
        errors.append(
            np.abs(table.change(angle, swing) - smooth_change(angle, swing)).max()
        )
    assert errors[0] / errors[1] > 10
    assert errors[1] / errors[2] > 10


def test_gradients_are_those_of_differences_and_the_turn_is_closed():
    values = np.random.default_rng(2).standard_normal((9, 6, 3))
    table = TabulatedMap(values, LIMIT)
    angle, swing, _ = points()
    swing = swing * 0.99
    gradient = change_and_gradient(table, angle, swing)[1]
    for axis, step in enumerate(([1e-6, 0], [0, 1e-6])):
        ahead = table.change(angle + step[0], swing + step[1])
        behind = table.change(angle - step[0], swing - step[1])
        np.testing.assert_allclose(
            gradient[:, :, axis], (ahead - behind) / 2e-6, atol=1e-7
        )
    turned = change_and_gradient(table, angle + 6 * np.pi, swing)
    np.testing.assert_allclose(turned[0], table.change(angle, swing), atol=1e-11)
    seam = change_and_gradient(table, np.array([-1e-12, 1e-12]), np.zeros(2))[1]
    np.testing.assert_allclose(seam[0], seam[1], atol=1e-9)


NOISE = np.array([2e-3, 2e-3, 1e-2])


def test_a_tabulated_process_is_near_the_process_and_nearer_on_a_finer_grid():
    model = trained_process(chained_hops(60, noise=NOISE))
    spread = model.outputs.std(axis=0)
    coarse = tabulation_errors(
        tabulated(model, LIMIT, angles=64, swings=17), model, points=500
    )
    fine = tabulation_errors(
        tabulated(model, LIMIT, angles=256, swings=65), model, points=500
    )
    assert (coarse[0] / spread).max() < 1e-2
    for rough, close in zip(coarse, fine, strict=True):
        assert np.all(close < rough / 3)


def test_a_table_of_the_true_map_has_its_grid():
    angles = turn_nodes(4)
    table = TabulatedMap(np.zeros((4, 7, 3)), LIMIT)
    np.testing.assert_array_equal(table.boom_angle_rad, angles)
    np.testing.assert_allclose(
        table.swing_rad[[0, 3, 6]], [-LIMIT, 0, LIMIT], atol=1e-15
    )


def test_swings_beyond_the_limit_are_an_error():
    table = TabulatedMap(np.zeros((4, 4, 3)), LIMIT)
    table.change(0.0, LIMIT)
    for swing in (LIMIT + 0.01, -2.0, np.nan):
        with pytest.raises(AnalysisError, match="expected swings within"):
            table.change(0.0, swing)


@pytest.mark.parametrize("values", [np.zeros((4, 3, 3)), np.full((4, 4, 3), np.nan)])
def test_bad_tables_are_errors(values):
    with pytest.raises(ValueError):
        TabulatedMap(values, LIMIT).change(0.0, 0.0)
