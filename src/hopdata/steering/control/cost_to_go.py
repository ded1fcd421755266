"""The cost-to-go: what it costs to go on optimally from a state, by policy iteration.

Let z be the remaining pose (that of the goal relative to the robot), s the robot's
state and u its inputs. A stride leads to z' = d(s, u)^-1 z and s' = f(s, u), where the
model says d and f. A stride does not end exactly where it is predicted to, so let
z'_1 ... z'_6 be six samples about z'. With the share a(z) by which a stance is no
arrival (0 at the goal, 1 away from it), the cost-to-go of a stance that is predicted at
z, s solves Bellman's equation

    V(z, s) = mean over the samples z_i of  a(z_i) (1 + DISCOUNT W(z_i, s)),
    W(z, s) = min over u of  V(d(s, u)^-1 z, f(s, u)).

So V is the discounted number of strides until the first arrival, and there is nothing
to gain by lingering just outside the goal. On the grid V is linear between the nodes;
beyond the grid's last distance the tail cost is added.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.rigid import relative
from hopdata.steering.control.grids import (
    N_SAMPLES,
    Grid,
    StateNodes,
    not_arrived,
    state_nodes,
)
from hopdata.steering.control.prediction import next_state, predicted_change
from hopdata.steering.models.stride_table import StrideTable

#: Weight of the next stance relative to this one.
#: Unit: 1. Origin: chosen.
DISCOUNT = 0.98
#: Largest change of the cost-to-go in the last sweep.
#: Unit: strides. Origin: chosen.
TOLERANCE = 1e-3
#: Most improvements of the policy; more mean that it does not converge.
#: Unit: 1. Origin: chosen.
MOST_SWEEPS = 200
#: Evaluations of the current policy before it is improved again.
#: Unit: 1. Origin: chosen.
SWEEPS_BETWEEN = 24


@dataclass(frozen=True)
class CostToGo:
    """Cost-to-go on a grid.

    Parameters
    ----------
    values : (D, B, N) or (E, N) array
        Expected cost of a stance predicted there, including all later ones; by
        distance, bearing and state, or by heading error and state. Bearings and errors
        are evenly spaced from -pi.
    grid : PointGrid or HeadingGrid
    states : StateNodes
        The N nodes of the robot's state.
    """

    values: FloatArray
    grid: Grid
    states: StateNodes

    @cached_property
    def _closed(self) -> FloatArray:
        return closed(self.values, self.grid, self.states)

    def at(self, remaining: FloatArray, state: FloatArray) -> FloatArray:
        """Return the cost of stances predicted at remaining poses (..., 3).

        The states are (..., S). It is linear between the nodes.
        """
        of_state = self.states.locations(state)
        locations = np.stack((*self.grid.locations(remaining), of_state))
        return interpolated(self._closed, locations) + self.grid.tail_cost(remaining)


def closed(values: FloatArray, grid: Grid, states: StateNodes) -> FloatArray:
    """Repeat the first value of each periodic axis after its last."""
    periodic = (*grid.periodic, states.kind == "periodic")
    added = [(0, int(is_periodic)) for is_periodic in periodic]
    return np.pad(values, added, mode="wrap")


def interpolated(values: FloatArray, locations: FloatArray) -> FloatArray:
    """Interpolate linearly at fractional node indices (axes, ...)."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(values, locations, order=1, mode="nearest"))


def input_nodes(lower: FloatArray, upper: FloatArray, number: int) -> FloatArray:
    """Return all combinations (number^U, U) of evenly spaced inputs."""
    spaced = np.linspace(lower, upper, number)
    combined = np.meshgrid(*spaced.T, indexing="ij")
    return np.stack(combined, axis=-1).reshape(-1, len(lower))


@cache
def _averages(grid: Grid) -> tuple[FloatArray, Any]:
    """Return a (N, 1) and sparse B (N, N) with which a + B w is the expected cost.

    It is that of a stance predicted at each node, and w (N, ...) the cost after a
    stance at each node. The stance may be at any of the grid's samples about the node,
    between nodes.
    """
    from scipy.sparse import csr_array

    nodes = grid.nodes()
    samples = grid.samples(nodes).reshape(-1, N_SAMPLES, 3)
    share = not_arrived(grid, samples) / N_SAMPLES
    locations = np.stack(grid.locations(samples))
    n_nodes = len(samples)
    row = np.repeat(np.arange(n_nodes), N_SAMPLES)
    average = csr_array((n_nodes, n_nodes))
    for weight, column in _corners(locations, nodes.shape[:-1], grid.periodic):
        of_costs = DISCOUNT * share * weight
        average += csr_array((of_costs.ravel(), (row, column.ravel())), average.shape)
    costs = share * (1.0 + DISCOUNT * grid.tail_cost(samples))
    return costs.sum(axis=1, keepdims=True), average


def _corners(
    locations: FloatArray, shape: tuple[int, ...], periodic: Sequence[bool]
) -> Iterator[tuple[FloatArray, IntArray]]:
    """Yield weight and index of each node around fractional indices (axes, ...).

    Beyond the last distance the last one counts; angles begin again.
    """
    modes: Any = tuple("wrap" if turns else "clip" for turns in periodic)
    low = np.floor(locations).astype(int)
    for corner in product((0, 1), repeat=len(locations)):
        offset = np.reshape(corner, (-1, *[1] * (locations.ndim - 1)))
        node = low + offset
        weight = np.prod(1.0 - np.abs(locations - node), axis=0)
        yield weight, np.ravel_multi_index(tuple(node), shape, mode=modes)


def _interpolation(
    locations: FloatArray, shape: tuple[int, ...], periodic: Sequence[bool]
) -> Any:
    """Return a sparse matrix that interpolates values of this shape, at (axes, ...).

    It takes a tenth of the time of `interpolated`, if the locations stay the same.
    """
    from scipy.sparse import csr_array

    weights, columns = zip(*_corners(locations, shape, periodic), strict=True)
    n_corners = len(weights)
    weight = np.stack(weights, axis=-1).ravel()
    column = np.stack(columns, axis=-1).ravel()
    starts = np.arange(0, len(weight) + 1, n_corners)
    return csr_array((weight, column, starts), (len(starts) - 1, math.prod(shape)))


def _after_strides(
    model: StrideTable, grid: Grid, states: StateNodes
) -> tuple[FloatArray, FloatArray]:
    """Return tail costs and node indices after strides from all nodes.

    The axes are those of the nodes, the state, and last the inputs to choose from;
    before them, of the node indices, there is one for the axes of the grid.
    """
    axes = model.axes
    inputs = input_nodes(axes.lower, axes.upper, grid.inputs)
    state = states.nodes()[:, None, :]
    change = predicted_change(model, state, inputs)
    after = next_state(model, state, inputs)
    remaining = relative(change, grid.nodes()[..., None, None, :])
    tail = grid.tail_cost(remaining)
    of_state = np.broadcast_to(states.locations(after), tail.shape)
    return tail, np.stack([*grid.locations(remaining), of_state])


def cost_to_go(
    model: StrideTable, grid: Grid, *, begin: CostToGo | None = None
) -> CostToGo:
    """Compute the cost-to-go on a grid by policy iteration.

    The best inputs are chosen, their cost is evaluated over several strides, and they
    are chosen again. Where each stride leads is computed only once, since it does not
    change.

    Parameters
    ----------
    model : StrideTable
        Of a robot with at most one state.
    grid : PointGrid or HeadingGrid
    begin : CostToGo, optional
        Cost-to-go on the same grid for a slightly different model. One policy
        improvement of it is returned, whether or not it has converged.

    Raises
    ------
    AnalysisError
        If it does not converge, unless `begin` is given.
    ConfigError
        If the robot has more than one state.
    """
    states = state_nodes(model, grid.states)
    tail, locations = _after_strides(model, grid, states)
    mean, average = _averages(grid)

    def expected(after: FloatArray) -> FloatArray:
        """Return the expected cost at predicted nodes, by that after a stance."""
        found = np.asarray(mean + average @ after.reshape(len(mean), -1))
        return found.reshape(after.shape)

    periodic = (*grid.periodic, states.kind == "periodic")
    if begin is None:
        values = np.zeros(tail.shape[:-1])
        n_sweeps = MOST_SWEEPS
    else:
        values = begin.values
        n_sweeps = 1
    for _ in range(n_sweeps):
        before = values
        costs = tail + interpolated(closed(before, grid, states), locations)
        best = costs.argmin(axis=-1)[..., None]
        values = expected(np.take_along_axis(costs, best, axis=-1)[..., 0])
        if np.abs(values - before).max() < TOLERANCE:
            return CostToGo(values, grid, states)
        best_tail = np.take_along_axis(tail, best, axis=-1)[..., 0]
        best_locations = np.take_along_axis(locations, best[None], axis=-1)[..., 0]
        ahead = _interpolation(best_locations, values.shape, periodic)
        for _ in range(SWEEPS_BETWEEN):
            after = (ahead @ values.ravel()).reshape(values.shape)
            values = expected(best_tail + after)
    if begin is not None:
        return CostToGo(values, grid, states)
    raise AnalysisError(
        f"cost-to-go: expected changes below {TOLERANCE} within {MOST_SWEEPS} sweeps"
    )
