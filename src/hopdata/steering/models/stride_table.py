"""Models of any robot as tables with cubic splines between the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.rigid import wrapped
from hopdata.steering.strides import TURN, StrideAxes, turn_nodes

#: Number of nodes of a periodic state.
#: Unit: 1. Origin: chosen: as in the table of the hopper.
PERIODIC_NODES = 128
#: Number of nodes of a linear state, and of an input.
#: Unit: 1. Origin: chosen: as in the table of the hopper.
LINEAR_NODES = 33
#: How far an input may be beyond its limits, as a share of half their distance.
#: Unit: 1. Origin: chosen: a margin for finite differences at the bounds.
MARGIN = 1e-3


def spline_of(
    values: FloatArray, nodes: Sequence[FloatArray], *, n_periodic: int
) -> Any:
    """Return a cubic spline of values (n_1, ..., n_d, k) at nodes.

    The first axes are periodic with a turn, the others not-a-knot. The spline takes
    points (n, d) whose coordinates are in the opposite order.
    """
    from scipy.interpolate import NdBSpline, make_interp_spline

    coefficients = values
    knots: tuple[FloatArray, ...] = ()
    for axis, places in enumerate(nodes):
        # Each spline moves its own axis to the front.
        if axis < n_periodic:
            first = np.take(coefficients, [0], axis=axis)
            closed = np.concatenate([coefficients, first], axis=axis)
            places = np.append(places, TURN)
            spline = make_interp_spline(places, closed, axis=axis, bc_type="periodic")
        else:
            spline = make_interp_spline(places, coefficients, axis=axis)
        knots = (spline.t, *knots)
        coefficients = spline.c
    return NdBSpline(knots, coefficients, 3)


@dataclass(frozen=True)
class StrideTable:
    """Changes of pose and next states on a grid of states and inputs.

    Parameters
    ----------
    axes : StrideAxes
    nodes : tuple of (n,) array
        Nodes of each state and each input, ascending. Those of a periodic state are
        evenly spaced over a turn from 0, those of an input from limit to limit. Beyond
        the outermost nodes of a linear state the outermost count.
    values : (n_1, ..., n_d, 3 + S) array
        Changes of pose, m, m, rad, then by how much the states change; of the states
        whose next value follows from the axes, anything.
    noise_sd : (3,) array, optional
        Standard deviation of the random part of a change of pose, if it is known.
    """

    axes: StrideAxes
    nodes: tuple[FloatArray, ...]
    values: FloatArray
    noise_sd: FloatArray | None = None

    @cached_property
    def _spline(self) -> Any:
        return spline_of(self.values, self.nodes, n_periodic=len(self.axes.periodic))

    def change(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the changes of pose (n, 3) by states (n, S) and inputs (n, U).

        Raises
        ------
        AnalysisError
            If an input is beyond its limits.
        """
        return self._at(self.axes.points(state, inputs))[:, :3]

    def next_state(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the states (n, S) after strides; see `change`."""
        axes = self.axes
        known = axes.next_state(state, inputs)
        if axes.is_known.all():
            return known
        points = self.axes.points(state, inputs)
        n_states = len(axes.states)
        learned = points[:, :n_states] + self._at(points)[:, 3:]
        return axes.wrapped(np.where(axes.is_known, known, learned))

    def _at(self, points: FloatArray) -> FloatArray:
        """Return the interpolated values (n, 3 + S) at points (n, S + U)."""
        axes = self.axes
        places = points.copy()
        n_periodic = len(axes.periodic)
        n_states = len(axes.states)
        places[:, :n_periodic] %= TURN
        for k in range(n_periodic, n_states):
            places[:, k] = np.clip(places[:, k], self.nodes[k][0], self.nodes[k][-1])
        margin = MARGIN * (axes.upper - axes.lower) / 2
        inputs = places[:, n_states:]
        within = (inputs >= axes.lower - margin) & (inputs <= axes.upper + margin)
        if not within.all():
            limits = list(zip(axes.lower.tolist(), axes.upper.tolist(), strict=True))
            farthest = inputs[~within.all(axis=1)][0].tolist()
            raise AnalysisError.at("table", f"inputs within {limits}", farthest)
        return np.asarray(self._spline(places[:, ::-1]))


def stride_table(
    model: Any, state_limits: Sequence[tuple[float, float]] = ()
) -> StrideTable:
    """Tabulate a model of strides.

    Parameters
    ----------
    model : object
        With `axes`, `change` and, if not all next states follow from the axes,
        `next_state`; it may have a `noise_sd`.
    state_limits : sequence of (float, float)
        Least and largest value of each linear state.
    """
    axes: StrideAxes = model.axes
    n_states = len(axes.states)
    spans = [*state_limits, *zip(axes.lower, axes.upper, strict=True)]
    spaced = [np.linspace(*span, LINEAR_NODES) for span in spans]
    turns = [turn_nodes(PERIODIC_NODES) for _ in axes.periodic]
    nodes = (*turns, *spaced)
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    points = grid.reshape(-1, len(nodes))
    state = points[:, :n_states]
    inputs = points[:, n_states:]
    steps = np.zeros(state.shape)
    if not axes.is_known.all():
        steps = np.asarray(model.next_state(state, inputs)) - state
        n_periodic = len(axes.periodic)
        steps[:, :n_periodic] = wrapped(steps[:, :n_periodic])
        steps[:, axes.is_known] = 0.0
    values = np.concatenate([model.change(state, inputs), steps], axis=1)
    values = values.reshape(*grid.shape[:-1], values.shape[-1])
    return StrideTable(axes, nodes, values, getattr(model, "noise_sd", None))
