"""MuJoCo as a peer: fixed time steps in place of tolerances."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper
from peers import Found, Problem, Run, Solver

try:
    from hopdata.dissertation.mujoco_models import (
        Setting,
        hopper_simulation,
        plate_simulation,
        steps,
    )
except ImportError as error:  # then nothing is simulated, and the tables say so
    ABSENT = f"absent: {error}"
else:
    ABSENT = ""

TIMESTEPS_S = tuple(2e-3 / 2**k for k in range(7))
WAYS = (
    ("contact", "implicitfast"),
    ("callback", "RK4"),
)  # its own contact; the scene's springs


def solvers(problem: Problem) -> list[Solver]:
    """Return its soft contact and our springs; nothing if the scene is not mechanical."""
    if ABSENT:
        raise ImportError(ABSENT.removeprefix("absent: "))
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
    """Return a function that takes all steps from start to end in one call of C."""
    setting = Setting(spring, integrator, timestep_s)
    simulation: Any = (
        plate_simulation(Plate(), setting)
        if problem.name == "plate"
        else hopper_simulation(VerticalHopper(), setting)
    )
    count = steps(setting, problem.t_span[1] - problem.t_span[0])

    def run() -> Found:
        simulation.start(problem.y0)
        simulation.step_in_c(count)
        return np.array(simulation.state()), None

    return run
