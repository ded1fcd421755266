"""Models of strides as tables with cubic splines between the nodes, fast to look up.

Learned models and the true map of a simulated robot are tabulated.
"""

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
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.strides import COMPONENTS, TURN, StrideAxes, turn_nodes

#: Number of nodes of a periodic state.
#: Unit: 1. Origin: chosen.
PERIODIC_NODES = 128
#: Number of nodes of a linear state, and of an input.
#: Unit: 1. Origin: chosen.
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
    """Changes of pose and next states on a grid of states and inputs; a `StrideModel`.

    Parameters
    ----------
    axes : StrideAxes
    nodes : tuple of (n,) array
        Nodes of each state and each input, ascending. Those of a periodic state are
        evenly spaced over a turn from 0, those of an input from limit to limit. Beyond
        the outermost nodes of a linear state the outermost count.
    values : (n_1, ..., n_d, 3 + L) array
        Changes of pose, m, m, rad, then by how much the L states change whose next
        value does not follow from the axes.
    noise_sd : (3,) array, optional
        Standard deviation of the random part of a change of pose, if it is known.
    """

    axes: StrideAxes
    nodes: tuple[FloatArray, ...]
    values: FloatArray
    noise_sd: FloatArray | None = None

    @classmethod
    def evenly_spaced(cls, axes: StrideAxes, values: FloatArray) -> StrideTable:
        """Return the table of values on evenly spaced nodes.

        Only of a robot without linear states, whose limits are not known.
        """
        sizes = values.shape[:-1]
        n_periodic = len(axes.periodic)
        nodes = [turn_nodes(size) for size in sizes[:n_periodic]]
        for axis, size in zip(axes.inputs, sizes[n_periodic:], strict=True):
            nodes.append(np.linspace(axis.lower, axis.upper, size))
        return cls(axes, tuple(nodes), values)

    @property
    def state_limits(self) -> list[tuple[float, float]]:
        """Least and largest value of each linear state."""
        first = len(self.axes.periodic)
        linear = self.nodes[first : len(self.axes.states)]
        return [(float(nodes[0]), float(nodes[-1])) for nodes in linear]

    @cached_property
    def _spline(self) -> Any:
        return spline_of(self.values, self.nodes, n_periodic=len(self.axes.periodic))

    @property
    def spline_parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Knots of the input and of the periodic state, and coefficients (U', S', 3).

        For code that is compiled, of a table over one of each.
        """
        of_input, of_state = self._spline.t
        return of_input, of_state, self._spline.c

    def change(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the changes of pose (n, 3) by states (n, S) and inputs (n, U).

        Raises
        ------
        AnalysisError
            If an input is beyond its limits.
        ValueError
            From scipy, if an axis has fewer than four nodes or the values are not all
            finite.
        """
        values = self._at(self.axes.points(state, inputs))
        return values[:, : len(COMPONENTS)]

    def next_state(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the states (n, S) after strides; see `change`."""
        axes = self.axes
        after = axes.next_state(state, inputs)
        is_learned = ~axes.is_known
        if not is_learned.any():
            return after
        points = axes.points(state, inputs)
        before = points[:, : len(axes.states)]
        steps = self._at(points)[:, len(COMPONENTS) :]
        after[:, is_learned] = before[:, is_learned] + steps
        return axes.wrapped(after)

    def within(self, lower: FloatArray, upper: FloatArray) -> StrideTable:
        """Return the table between other limits of the inputs, (U,) each.

        Itself, if they are the same. A process has this, too.
        """
        if self.axes.has_limits(lower, upper):
            return self
        limits = self.state_limits
        return tabulated(self, state_limits=limits, lower=lower, upper=upper)

    def _at(self, points: FloatArray) -> FloatArray:
        """Return the interpolated values (n, 3 + L) at points (n, S + U)."""
        axes = self.axes
        places = points.copy()
        n_periodic = len(axes.periodic)
        n_states = len(axes.states)
        places[:, :n_periodic] %= TURN
        for k in range(n_periodic, n_states):
            places[:, k] = np.clip(places[:, k], self.nodes[k][0], self.nodes[k][-1])
        lower = axes.lower
        upper = axes.upper
        margin = MARGIN * (upper - lower) / 2
        inputs = places[:, n_states:]
        within = (inputs >= lower - margin) & (inputs <= upper + margin)
        if not within.all():
            limits = list(zip(lower.tolist(), upper.tolist(), strict=True))
            farthest = inputs[~within.all(axis=1)][0].tolist()
            raise AnalysisError.at("table", f"inputs within {limits}", farthest)
        return np.asarray(self._spline(places[:, ::-1]))


def tabulated(
    model: StrideModel,
    *,
    state_limits: Sequence[tuple[float, float]] = (),
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    periodic_nodes: int = PERIODIC_NODES,
    linear_nodes: int = LINEAR_NODES,
) -> StrideTable:
    """Tabulate a model of strides.

    Parameters
    ----------
    model : StrideModel
        It may have a `noise_sd`.
    state_limits : sequence of (float, float)
        Least and largest value of each linear state.
    lower, upper : (U,) array, optional
        Limits of the inputs; by default those of the model's axes.
    periodic_nodes : int
        Number of nodes of each periodic state.
    linear_nodes : int
        Number of nodes of each linear state and of each input.
    """
    axes = model.axes
    if lower is not None and upper is not None:
        axes = axes.between(lower, upper)
    n_states = len(axes.states)
    n_periodic = len(axes.periodic)
    spans = [*state_limits, *zip(axes.lower, axes.upper, strict=True)]
    spaced = [np.linspace(*span, linear_nodes) for span in spans]
    turns = [turn_nodes(periodic_nodes) for _ in axes.periodic]
    nodes = (*turns, *spaced)
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    points = grid.reshape(-1, len(nodes))
    state = points[:, :n_states]
    inputs = points[:, n_states:]
    values = model.change(state, inputs)
    is_learned = ~axes.is_known
    if is_learned.any():
        steps = np.asarray(model.next_state(state, inputs)) - state
        steps[:, :n_periodic] = wrapped(steps[:, :n_periodic])
        values = np.concatenate([values, steps[:, is_learned]], axis=1)
    values = values.reshape(*grid.shape[:-1], values.shape[-1])
    return StrideTable(axes, nodes, values, getattr(model, "noise_sd", None))
