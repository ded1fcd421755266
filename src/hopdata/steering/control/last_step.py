"""A planner for a robot whose speed carries over: it knows the last step, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import require
from hopdata.rigid import relative
from hopdata.steering.control.interface import Plan, checked_state
from hopdata.steering.control.objectives import Objective
from hopdata.steering.control.planner import Planner
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.models.last_step import has_last_step


class LastStepPlanner:
    """Predicts its strides with the last step as a state, and goes on as another.

    Within the horizon it uses a model that knows the last step. What comes after, it
    leaves to the cost-to-go of a planner that does not, whose model is of strides as
    they are on the way: neither right after a release nor at rest.

    It remembers the last stance, so each run needs its own. Before the first stance
    the robot was at rest.

    Parameters
    ----------
    known : Planner
        Planner of the robot by its own states.
    model : StrideModel
        Model whose last states are the last step: learned from strides that
        `hopdata.steering.models.last_step.with_last_step` returned.

    Raises
    ------
    ConfigError
        If the last step is not among the states of the model.
    """

    def __init__(self, known: Planner, model: StrideModel) -> None:
        found = ", ".join(state.name for state in model.axes.states) or "none"
        wanted = "a model with the last step among its states"
        require(has_last_step(model.axes), "last-step planner", wanted, found)
        self._axes = known.model.axes
        self._planner = replace(known, near_model=model)
        self._before: FloatArray | None = None
        self._last_step = np.zeros(3)

    def towards(self, objective: Objective) -> LastStepPlanner:
        """Switch to another objective of the same kind."""
        self._planner = self._planner.towards(objective)
        return self

    @one_blas_thread()
    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Plan from a pose and the states of the robot.

        Without previous inputs, no plan was asked for at the stance before this one, or
        it was missed. The last step is then the last one that was seen.
        """
        here, states = checked_state(pose, state, self._axes)
        if self._before is not None and previous_inputs is not None:
            self._last_step = relative(self._before, here)
        self._before = here
        return self._planner.plan(here, np.concatenate([states, self._last_step]))
