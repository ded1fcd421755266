"""A planner that keeps learning: it corrects its model of the robot at each stance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.rigid import relative, wrapped
from hopdata.steering.control import objectives
from hopdata.steering.control.correction import Correction
from hopdata.steering.control.cost_to_go import cost_to_go
from hopdata.steering.control.grids import coarse
from hopdata.steering.control.interface import Plan, checked_state
from hopdata.steering.control.planner import Planner
from hopdata.steering.models.stride_table import tabulated

#: Nodes of a periodic state in the table of the corrected map.
#: Unit: 1. Origin: chosen: half of those of the model.
PERIODIC_NODES = 64
#: Nodes of a linear state, and of an input.
#: Unit: 1. Origin: chosen: half of those of the model.
LINEAR_NODES = 17


class AdaptivePlanner:
    """Plans with a map that it corrects at each stance by the stride just made.

    At each stride, one policy improvement on a coarse grid adapts the cost-to-go to the
    map. A planner remembers what it has learned, so each run needs its own. How a state
    goes on that must be learned is not corrected.

    Parameters
    ----------
    known : Planner
        Planner to start from, of any robot.
    noise : (3,) array
        Standard deviation of a stride's random part, m, m, rad.
    """

    def __init__(self, known: Planner, noise: ArrayLike) -> None:
        model = known.model
        axes = model.axes
        limits = model.state_limits
        self.correction = Correction(axes, np.asarray(noise, dtype=float), limits)
        self._table = tabulated(
            model,
            state_limits=limits,
            periodic_nodes=PERIODIC_NODES,
            linear_nodes=LINEAR_NODES,
        )
        grid = np.meshgrid(*self._table.nodes, indexing="ij")
        # Basis functions of the correction at the nodes of the table.
        self._functions = self.correction.functions(np.stack(grid, axis=-1))
        known_grid = known.cost_to_go.grid
        self._planner = replace(
            known, cost_to_go=cost_to_go(self._table, coarse(known_grid))
        )
        # Pose and states at the last stance.
        self._before: tuple[FloatArray, FloatArray] | None = None

    def towards(self, objective: objectives.Objective) -> AdaptivePlanner:
        """Switch to another objective of the same kind; what was learned is kept."""
        self._planner = self._planner.towards(objective)
        return self

    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Learn from the previous stride, if its inputs are known, then plan."""
        here, states = checked_state(pose, state, self._table.axes)
        if self._before is not None and previous_inputs is not None:
            start, states_before = self._before
            inputs = np.asarray(previous_inputs, dtype=float).reshape(-1)
            self._learn(start, states_before, inputs, here)
        self._before = (here, states)
        return self._planner.plan(here, states)

    @one_blas_thread()
    def _learn(
        self,
        start: FloatArray,
        states: FloatArray,
        inputs: FloatArray,
        here: FloatArray,
    ) -> None:
        """Correct the map and the cost-to-go from an observed stride."""
        table = self._table
        inputs = np.clip(inputs, table.axes.lower, table.axes.upper)
        missed = relative(start, here) - table.change(states, inputs)[0]
        missed[2] = wrapped(missed[2])
        self.correction.learn(np.concatenate([states, inputs]), missed)
        corrected = table.values.copy()
        corrected[..., : len(missed)] += self.correction.added(self._functions)
        model = replace(table, values=corrected)
        before = self._planner.cost_to_go
        improved = cost_to_go(model, before.grid, begin=before)
        self._planner = replace(self._planner, model=model, cost_to_go=improved)
