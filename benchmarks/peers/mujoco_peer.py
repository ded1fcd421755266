"""MuJoCo: fixed time steps in place of tolerances, and springs in the ways of `mujoco_models`."""

from __future__ import annotations

from functools import partial
from typing import Any

import mujoco  # noqa: F401  # without it this peer is absent
import numpy as np
from mujoco_models import Setting, hopper_simulation, plate_simulation, steps
from plate_scene import Plate

from hopdata.scenes.small import VerticalHopper
from peers.problems import Problem
from peers.solver import FloatArray, Run, Solver

TIMESTEPS_S = tuple(2e-3 / 2**k for k in range(7))
WAYS = (("contact", "implicitfast"), ("callback", "RK4"))  # its contact; the scene's own springs


def solvers(problem: Problem) -> list[Solver]:
    """Return its soft contact and our springs; nothing where the scene is not mechanical."""
    if problem.name not in ("vertical_hopper", "plate"):
        return []
    return [
        Solver(
            "MuJoCo", "MuJoCo", f"{integrator}, {spring}",
            partial(prepare, problem, spring, integrator), settings=TIMESTEPS_S,
        )
        for spring, integrator in WAYS
    ]  # fmt: skip


def prepare(problem: Problem, spring: str, integrator: str, timestep_s: float) -> Run:
    """Return the steps from start to end, in one call of C."""
    setting = Setting(spring, integrator, timestep_s)
    simulation: Any = (
        plate_simulation(Plate(), setting)
        if problem.name == "plate"
        else hopper_simulation(VerticalHopper(), setting)
    )
    count = steps(setting, problem.t_span[1] - problem.t_span[0])

    def run() -> FloatArray:
        simulation.start(problem.y0)
        simulation.step_in_c(count)
        return np.array(simulation.state())

    return run
