"""A planner that keeps learning: it corrects its model of the hopper at each stance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import ConfigError
from hopdata.rigid import relative, wrapped
from hopdata.steering.control import objectives
from hopdata.steering.control.cost_to_go import cost_to_go
from hopdata.steering.control.grids import Grid, HeadingGrid, PointGrid
from hopdata.steering.control.interface import Plan, checked_state
from hopdata.steering.control.planner import Planner
from hopdata.steering.models import tabulated as tables

# Grids on which the cost-to-go follows the map during a flight.
COARSE: dict[type, Grid] = {
    PointGrid: PointGrid(distances=20, bearings=24, states=16, inputs=9),
    HeadingGrid: HeadingGrid(heading_errors=90, states=32, inputs=17),
}
# Size of the table of the corrected map.
COARSE_TABLE = {"angles": 64, "swings": 17}


class AdaptivePlanner:
    """Plans with a map that it corrects at each stance by the hop just made.

    At each hop, one policy improvement on a coarse grid adapts the cost-to-go to the
    map. A planner remembers what it has learned, so each run needs its own.

    Parameters
    ----------
    known : Planner
        Planner to start from.
    noise : (3,) array
        Standard deviation of a hop's random part, m, m, rad.
    """

    def __init__(self, known: Planner, noise: FloatArray) -> None:
        model = known.model
        if not isinstance(model, tables.TabulatedMap):
            found = f"one of {', '.join(model.axes.columns)}"
            raise ConfigError.at("adaptive planner", "a model of the hopper", found)
        limit = model.swing_limit_rad
        self.correction = tables.Correction(limit, np.asarray(noise, dtype=float))
        self._table = tables.tabulated(model, limit, **COARSE_TABLE)
        booms, swings = np.meshgrid(
            self._table.boom_angle_rad, self._table.swing_rad, indexing="ij"
        )
        # Basis functions of the correction at the nodes of the table.
        self._functions = self.correction.functions(booms, swings)
        coarse = cost_to_go(self._table, COARSE[type(known.cost_to_go.grid)])
        self._planner = replace(known, cost_to_go=coarse)
        # Pose and boom angle at the last stance.
        self._before: tuple[FloatArray, float] | None = None

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
        """Learn from the previous hop, if its swing is known, then plan."""
        here, states = checked_state(pose, state, self._table.axes)
        boom = float(states[0])
        if self._before is not None and previous_inputs is not None:
            start, boom_before = self._before
            swing = float(np.ravel(previous_inputs)[0])
            self._learn(start, boom_before, swing, here)
        self._before = (here, boom)
        return self._planner.plan(here, boom)

    @one_blas_thread()
    def _learn(
        self, start: FloatArray, boom: float, swing: float, here: FloatArray
    ) -> None:
        """Correct the map and the cost-to-go from an observed hop."""
        table = self._table
        limit = table.swing_limit_rad
        swing = float(np.clip(swing, -limit, limit))
        missed = relative(start, here) - table.change(boom, swing)[0]
        missed[2] = wrapped(missed[2])
        self.correction.learn(boom, swing, missed)
        corrected = table.values + self.correction.added(self._functions)
        model = tables.TabulatedMap(corrected, limit)
        before = self._planner.cost_to_go
        improved = cost_to_go(model, before.grid, begin=before)
        self._planner = replace(self._planner, model=model, cost_to_go=improved)
