"""What drives, rehearsals and replays have in common: robot, geometry, controller."""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.errors import ConfigError, require
from hopdata.steering.commands.excite import GEOMETRY, MODEL

if TYPE_CHECKING:
    from hopdata.steering.control.interface import Controller
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.robots import DrivenRobot
    from hopdata.steering.observation.geometry import HopperGeometry
    from hopdata.steering.strides import StrideAxes

# The simulated hopper: hops that its model is learned from, seed, pose (m, m, rad).
LEARNED_HOPS = 100
SEED = 1
START = (1.0, 0.0, 0.0)

# Hops that are predicted by a plan.
PLANNED_HOPS = 2


def robot_of(name: str | None, *, by_user: bool = True) -> DrivenRobot | None:
    """Return the robot that is driven; None is the hopper."""
    if name is None:
        return None
    from hopdata.steering.live.robots import driven_robot

    return driven_robot(name, by_user=by_user)


def axes_of(robot: DrivenRobot | None, limits: Limits) -> StrideAxes:
    """Return the states of the robot, and its inputs with the limits of the drive."""
    if robot is not None:
        return robot.axes
    from hopdata.steering.frame_changes import hopper_axes

    return hopper_axes(limits.swing_rad)


def limits_of(options: argparse.Namespace, robot: DrivenRobot | None = None) -> Limits:
    """Return the limits of the drive, with those of its robot."""
    from hopdata.steering.live.limits import Limits

    if robot is not None:
        return replace(robot.limits, fence_m=options.fence)
    return Limits(swing_rad=options.swing_limit, fence_m=options.fence)


def no_model() -> ConfigError:
    """Return the error for a robot of which nothing was learned."""
    wanted = "expected the folder of what was learned from this robot"
    return ConfigError(f"--model: {wanted}")


def files_of(
    folder: Path | None,
    progress: Callable[[str], None],
    robot: DrivenRobot | None = None,
) -> dict[str, bytes]:
    """Return the model's files; without a folder, those of the simulated robot."""
    from hopdata.steering.models.process_file import load_process, save_process
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            progress("learning from the simulated robot")
            geometry, process = _learned() if robot is None else _learned_of(robot)
            folder = Path(temporary)
            geometry.save(folder / GEOMETRY)
            save_process(folder / MODEL, process)
        # They are loaded to report what is wrong, and with which file.
        load_geometry(folder / GEOMETRY)
        load_process(folder / MODEL)
        return {name: (folder / name).read_bytes() for name in (GEOMETRY, MODEL)}


def _learned() -> tuple[Any, Any]:
    """Return geometry and frame changes of the simulated hopper."""
    import numpy as np

    from hopdata.steering.excitation import ControlGrid, eulerian_excitation
    from hopdata.steering.models.training import trained_process
    from hopdata.steering.observation.observe import observe_recordings
    from hopdata.steering.robot import SteeredHopper
    from hopdata.steering.trial import record_trial

    robot = SteeredHopper()
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    # Some hops more, since not each hop is observed.
    swings = eulerian_excitation(ControlGrid(), rng)[: LEARNED_HOPS + 20]
    recording = record_trial(robot, swings, seed=SEED).recording
    seen = observe_recordings([recording], swing_limit_rad=robot.swing_limit_rad)
    first_hops = seen.changes.used().rows(np.arange(LEARNED_HOPS))
    return seen.geometry, trained_process(first_hops)


def _learned_of(robot: DrivenRobot) -> tuple[Any, Any]:
    """Return geometry and model of a simulated robot that is not the hopper."""
    import numpy as np

    from hopdata.steering.excitation import excitation
    from hopdata.steering.models.training import trained_process
    from hopdata.steering.robots.interface import Simulation, excited

    inputs = excitation(robot.axes, LEARNED_HOPS + 20, SEED)
    made = excited(Simulation(robot.simulation(), seed=SEED), inputs).strides().used()
    process = trained_process(made.rows(np.arange(LEARNED_HOPS)))
    return robot.geometry, process


def parts_of(
    setup: Mapping[str, Any],
    files: Mapping[str, bytes],
    robot: DrivenRobot | None,
) -> tuple[HopperGeometry, Controller]:
    """Return geometry and controller, the same for a drive and its replay."""
    if setup.get("excitation") is not None:
        return _excited_parts(setup, files, robot)
    from hopdata.steering.control.adaptive import AdaptivePlanner
    from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint
    from hopdata.steering.control.planner import planner
    from hopdata.steering.frame_changes import is_hopper
    from hopdata.steering.models.process_file import load_process
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as folder:
        for name in (GEOMETRY, MODEL):  # a log may hold other names
            Path(folder, name).write_bytes(files.get(name, b""))
        geometry = load_geometry(f"{folder}/{GEOMETRY}")
        process = load_process(f"{folder}/{MODEL}")
    goal: ToPoint | ToHeading
    if setup["heading_deg"] is None:
        goal = ToPoint(point_m=tuple(setup["to"]))
    else:
        goal = ToHeading(heading_rad=math.radians(setup["heading_deg"]))
    horizon = Horizon(hops=PLANNED_HOPS, swing_limit_rad=setup["limits"]["swing_rad"])
    model: Any = process
    first_state = [0.0] * len(process.axes.states)
    if robot is None:
        columns = ", ".join(process.axes.columns)
        wanted = f"--robot with a model of {columns}, which is not the hopper's"
        require(is_hopper(process.axes), "--model", wanted, "none")
        model = process.within(*horizon.limits(process.axes))
        first_state = [math.pi]
    else:
        _require_axes(robot, process.axes)
    controller = planner(model, goal, horizon=horizon)
    # The first plan loads what it needs, which would delay the first hop.
    controller.plan(START, first_state)
    if setup["adaptive"]:
        return geometry, AdaptivePlanner(controller, process.noise_sd)
    return geometry, controller


def _require_axes(robot: DrivenRobot, found: StrideAxes) -> None:
    """Require a model of the robot that is driven."""
    expected = robot.axes.columns
    wanted = f"a model of {', '.join(expected)}"
    of_other = f"one of {', '.join(found.columns)}"
    require(found.columns == expected, "--model", wanted, of_other)


def _excited_parts(
    setup: Mapping[str, Any],
    files: Mapping[str, bytes],
    robot: DrivenRobot | None,
) -> tuple[HopperGeometry, Controller]:
    """Return the same for an excitation, which needs no model."""
    from hopdata.steering.frame_changes import HOPPER
    from hopdata.steering.live.excited import Excitation
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, GEOMETRY)
        path.write_bytes(files.get(GEOMETRY, b""))
        geometry = load_geometry(path)
    limits = Limits(**setup["limits"])
    axes = HOPPER if robot is None else robot.axes
    return geometry, Excitation(axes, setup["excitation"], limits)
