"""Tables: exact at their nodes and for cubics, smooth in between, periodic."""

import numpy as np
import pytest
from frame_change_models import tabulation_error
from steered_hops import LIMIT, chained_hops, smooth_change

from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.stride_table import StrideTable, tabulated
from hopdata.steering.models.training import trained_process
from hopdata.steering.strides import turn_nodes


class Smooth:
    """The smooth map of the test hops."""

    axes = hopper_axes(LIMIT)
    next_state = axes.next_state

    def change(self, state, inputs):
        return smooth_change(np.ravel(state), np.ravel(inputs))


def table_of(values):
    """Return a table of the hopper."""
    return StrideTable.evenly_spaced(hopper_axes(LIMIT), values)


def points(n=200, seed=0):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return (
        rng.uniform(-10, 10, n),
        rng.uniform(-LIMIT, LIMIT, n),
        rng.uniform(-LIMIT, LIMIT, n),
    )


def test_nodes_are_exact():
    values = np.random.default_rng(1).standard_normal((8, 5, 3))
    table = table_of(values)
    angle, swing = np.meshgrid(*table.nodes, indexing="ij")
    found = table.change(angle.ravel(), swing.ravel())
    np.testing.assert_allclose(found, values.reshape(-1, 3), atol=1e-12)


def test_the_error_falls_with_the_fourth_power_of_the_spacing():
    angle, swing, _ = points()
    errors = []
    for nodes in (16, 32, 64):
        table = tabulated(Smooth(), periodic_nodes=nodes, linear_nodes=nodes // 2 + 1)
        errors.append(
            np.abs(table.change(angle, swing) - smooth_change(angle, swing)).max()
        )
    assert errors[0] / errors[1] > 10
    assert errors[1] / errors[2] > 10


def test_the_turn_is_closed_smoothly():
    values = np.random.default_rng(2).standard_normal((9, 6, 3))
    table = table_of(values)
    angle, swing, _ = points()
    found = table.change(angle, swing)
    turned = table.change(angle + 6 * np.pi, swing)
    np.testing.assert_allclose(turned, found, atol=1e-11)
    # Slope and curvature are the same on both sides of the seam.
    near = table.change(1e-3 * np.arange(-3, 4), 0.1)
    for order in (1, 2):
        differences = np.diff(near, order, axis=0) / 1e-3**order
        np.testing.assert_allclose(differences[0], differences[-1], atol=0.3)


def test_a_hop_leads_to_the_next_boom_angle():
    table = table_of(np.zeros((4, 4, 3)))
    after = table.next_state([6.0, 0.1], [0.5, -0.2])
    np.testing.assert_allclose(after, [[6.5 - 2 * np.pi], [2 * np.pi - 0.1]])


NOISE = np.array([2e-3, 2e-3, 1e-2])


def test_a_tabulated_process_is_near_the_process_and_nearer_on_a_finer_grid():
    model = trained_process(chained_hops(60, noise=NOISE))
    spread = model.outputs.std(axis=0)
    limit = np.array([LIMIT])

    def error(angles, swings):
        table = tabulated(
            model,
            lower=-limit,
            upper=limit,
            periodic_nodes=angles,
            linear_nodes=swings,
        )
        return tabulation_error(table, model, points=500)

    coarse = error(64, 17)
    fine = error(256, 65)
    assert (coarse / spread).max() < 1e-2
    assert np.all(fine < coarse / 3)


def test_a_table_of_the_true_map_has_its_grid():
    angles = turn_nodes(4)
    table = table_of(np.zeros((4, 7, 3)))
    np.testing.assert_array_equal(table.nodes[0], angles)
    np.testing.assert_allclose(
        table.nodes[1][[0, 3, 6]], [-LIMIT, 0, LIMIT], atol=1e-15
    )


def test_swings_beyond_the_limit_are_an_error():
    table = table_of(np.zeros((4, 4, 3)))
    table.change(0.0, LIMIT)
    for swing in (LIMIT + 0.01, -2.0, np.nan):
        with pytest.raises(AnalysisError, match="expected inputs within"):
            table.change(0.0, swing)


@pytest.mark.parametrize("values", [np.zeros((4, 3, 3)), np.full((4, 4, 3), np.nan)])
def test_bad_tables_are_errors(values):
    with pytest.raises(ValueError):
        table_of(values).change(0.0, 0.0)
