"""``hopdata drive``: steer a simulated or real robot; ``hopdata replay``: its log."""

from __future__ import annotations

import argparse
import logging
import math
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.errors import ConfigError, counted, printable, require
from hopdata.messages import Message
from hopdata.steering.commands import excite
from hopdata.steering.commands.excite import GEOMETRY, MODEL, SCORES

if TYPE_CHECKING:
    from hopdata.steering.control.interface import Controller
    from hopdata.steering.live.actuator import Driven
    from hopdata.steering.live.buffer import Stream
    from hopdata.steering.live.drive import Drive
    from hopdata.steering.live.excited import Excitation
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.loop import ControlLoop, Decision, Observers
    from hopdata.steering.live.rehearsal import Performed
    from hopdata.steering.live.robots import DrivenRobot
    from hopdata.steering.observation.geometry import HopperGeometry
    from hopdata.steering.strides import Input, State, StrideAxes

# The first log of a folder.
LOG = "drive.h5"

# The simulated hopper: hops that its model is learned from, seed, pose (m, m, rad).
LEARNED_HOPS = 100
SEED = 1
START = (1.0, 0.0, 0.0)

# Longest drive to a goal, s.
LONGEST_S = 60.0

# Hops that are predicted by a plan.
PLANNED_HOPS = 2

# Time between two pictures on the screen, s.
DRAW_S = 0.25

# Columns of the table of a rehearsal.
ACT_WIDTH = 50
REST_WIDTH = 37

# Time of an act of a rehearsal on a free machine, on the average, s.
ACT_S = 2.0

# Causes to rest of a simulated robot that only a slow computer has.
OF_A_SLOW_COMPUTER = (
    "steering.no_frame",
    "steering.plan_came_late",
    "steering.plan_late",
    "steering.unacknowledged",
)

# What the operator types to arm the drive.
ARM_KEY = "a"


def drive(options: argparse.Namespace) -> int:
    """Drive until the time is up, a fault ends it, or the operator does."""
    excite.require_whole(options)
    if options.rehearse:
        return _rehearse(options)
    _require_whole(options)
    path = log_path(options.log)
    robot = _robot(options.robot)
    limits = _limits(options, robot)
    setup = _setup(options, limits)
    if options.excite is None:
        with terminal.progress_line() as progress:
            files = _files(options.model, progress, robot)
            progress("planning ahead")
            geometry, controller = _parts(setup, files, robot)
        _drive(options, path, setup, files, (geometry, controller))
        return terminal.OK
    folder = excite.folder_of(path)
    with terminal.progress_line("reading the geometry"):
        axes = _axes(robot, limits)
        setup["excitation"] = excite.drawn(options, axes).tolist()
        files = excite.geometry_files(options.geometry, robot)
        geometry, controller = _parts(setup, files, robot)
    decisions: list[Decision] = []
    try:
        _drive(options, path, setup, files, (geometry, controller), decisions)
    finally:
        made = excite.write_strides(
            folder, decisions, axes, options.excite, limits, files[GEOMETRY]
        )
        seed = excite.seed_of(options)
        for line in excite.what_next(folder, made, options.excite, seed):
            print(line)
    return terminal.OK


def _setup(options: argparse.Namespace, limits: Limits) -> dict[str, Any]:
    """Return the settings that the log keeps."""
    return {
        "robot": options.robot,
        "simulated": options.host is None,
        "dry_run": options.dry_run,
        "armed": options.armed,
        "to": options.to,
        "adaptive": options.adaptive,
        "heading_deg": options.heading,
        "rate_hz": options.rate,
        "limits": vars(limits),
    }


def _drive(
    options: argparse.Namespace,
    path: Path,
    setup: Mapping[str, Any],
    files: Mapping[str, bytes],
    parts: tuple[HopperGeometry, Controller],
    decisions: list[Decision] | None = None,
) -> None:
    """Drive with geometry and controller, and say how it went.

    Decisions are added to the list as they are made.
    """
    from hopdata.steering.live.drive import drive as driven
    from hopdata.steering.live.excited import Excitation
    from hopdata.steering.live.log import DriveLog

    geometry, controller = parts
    robot = _robot(options.robot)
    limits = _limits(options, robot)
    boom, stream = _boom_and_stream(options, geometry, robot)
    n_markers = len(_markers(geometry))
    log_axes = {} if robot is None else {"axes": robot.axes}
    log = DriveLog(path, n_markers, setup=setup, files=files, **log_axes)
    print(f"log: {path}")
    _warn_of(options.model)
    seconds = _seconds(options)
    axes = _axes(robot, limits)
    screen = Screen(_title(options), seconds, limits.command_s, log, axes)
    kept: list[Decision] = [] if decisions is None else decisions

    def decided(decision: Decision) -> None:
        kept.append(decision)
        screen.decided(decision)

    def look(loop: ControlLoop, stream: Stream) -> None:
        screen.look(loop, stream)
        if isinstance(controller, Excitation):
            _end_excitation(loop, controller, armed=options.armed)

    try:
        if _in_simulated_time(options):
            done = _simulate(options, parts, (boom, stream), log, decided, limits)
        else:
            done = driven(
                geometry,
                controller,
                boom,
                stream=stream,
                stop=threading.Event(),
                seconds=seconds,
                rate_hz=options.rate,
                limits=limits,
                armed=options.armed,
                on_decision=decided,
                on_look=look,
                log=log,
                rest_without_log=options.log_full == "rest",
                **_of_robot(robot, geometry, options.rate),
            )
    finally:
        if log.failure:
            print(f"log: {path} holds the drive up to when {log.failure}")
        print(f"log: {path}; hopdata replay {path} plays it again")
    stances = counted(len(done.decisions), "stance")
    print(f"{stances}, {counted(len(done.rests), 'rest')}:")
    for rest in done.rests:
        print(f"  {rest.cause}")
    in_real_time = options.host is None and not _in_simulated_time(options)
    if in_real_time and any(
        rest.cause.code in OF_A_SLOW_COMPUTER for rest in done.rests
    ):
        print("  the robot is simulated in real time, and this computer was too slow:")
        print("  something else keeps it busy, or --rate is too high for it")


def _in_simulated_time(options: argparse.Namespace) -> bool:
    """Return whether the drive has a time of its own.

    That of a simulated robot for whose excitation no operator is needed.
    """
    return options.excite is not None and options.host is None and options.armed


def _simulate(
    options: argparse.Namespace,
    parts: tuple[HopperGeometry, Controller],
    simulated: tuple[Driven, Any],
    log: DriveLog,
    decided: Callable[[Decision], None],
    limits: Limits,
) -> Drive:
    """Excite a simulated robot in simulated time."""
    from hopdata.steering.live.simulated_time import drive_in_simulated_time

    geometry, controller = parts
    boom, stream = simulated
    print("in simulated time: how busy the computer is does not matter")
    robot = _robot(options.robot)
    return drive_in_simulated_time(
        geometry,
        controller,
        boom,
        stream.source,
        seconds=_seconds(options),
        rate_hz=options.rate,
        limits=limits,
        log=log,
        on_decision=decided,
        is_over=lambda: bool(getattr(controller, "is_over", False)),
        **_of_robot(robot, geometry, options.rate),
    )


def _seconds(options: argparse.Namespace) -> float:
    """Return the longest drive, s."""
    if options.seconds is not None:
        return float(options.seconds)
    if options.excite is not None:
        return excite.longest_s(options.excite)
    return LONGEST_S


def _end_excitation(loop: ControlLoop, excitation: Excitation, *, armed: bool) -> None:
    """End a drive whose excitation is over, or that nobody can arm again."""
    if excitation.is_over:
        loop.end(Message("steering.excitation_over"))
    elif armed and loop.state == "resting" and not _is_on_terminal():
        loop.end(Message("steering.nobody_arms"))


def _require_whole(options: argparse.Namespace) -> None:
    """Refuse options that would move nothing, or something that nobody has named."""
    is_robot = options.host is not None
    is_boom_named = options.boom is not None
    if is_robot and options.model is None and options.excite is None:
        raise _no_model()
    if is_robot and is_boom_named == options.dry_run:
        wanted = "expected either --boom HOST:PORT or --dry-run with it"
        raise ConfigError(f"--host: {wanted}")
    if is_boom_named and not is_robot:
        wanted = "expected --host with it; the simulated hopper has its own boom"
        raise ConfigError(f"--boom: {wanted}")
    if is_boom_named:
        _, _, port = options.boom.rpartition(":")
        require(port.isdecimal(), "--boom", "HOST:PORT", f"{options.boom!r}")
    if options.armed and is_boom_named:
        wanted = "no --boom with it: a robot is armed by its operator, with a and Enter"
        raise ConfigError(f"--armed: expected {wanted}")
    if not options.armed and not _is_on_terminal():
        wanted = "a terminal, on which an operator arms the drive with a and Enter"
        raise ConfigError(f"--armed: expected it, or {wanted}")
    if is_robot:
        _require_client(options.source)


def _require_client(source: str) -> None:
    """Require the library of a source before the work, not after it."""
    from hopdata.steering.live import sources

    sources.require_client(source)


def _no_model() -> ConfigError:
    wanted = "expected the folder of what was learned from this robot"
    return ConfigError(f"--model: {wanted}")


def log_path(named: Path | None) -> Path:
    """Return the file of the log: the one named, or the next free one."""
    if named is not None:
        how = "a file that exists already; name another one, or leave --log out"
        require(not named.exists(), f"--log {named}", "a new file", how)
        return named
    path = Path(LOG)
    number = 1
    while path.exists():
        number += 1
        path = Path(LOG).with_stem(f"{Path(LOG).stem}-{number}")
    return path


def _robot(name: str | None, *, by_user: bool = True) -> DrivenRobot | None:
    """Return the robot that is driven; None is the hopper."""
    if name is None:
        return None
    from hopdata.steering.live.robots import driven_robot

    return driven_robot(name, by_user=by_user)


def _axes(robot: DrivenRobot | None, limits: Limits) -> StrideAxes:
    """Return the states of the robot, and its inputs with the limits of the drive."""
    if robot is not None:
        return robot.axes
    from hopdata.steering.frame_changes import hopper_axes

    return hopper_axes(limits.swing_rad)


def _of_robot(
    robot: DrivenRobot | None, geometry: HopperGeometry, rate_hz: float
) -> dict[str, Any]:
    """Return what a drive is given of a robot that is not the hopper."""
    if robot is None:
        return {}
    observers = robot.observers(geometry, rate_hz)
    return {"axes": robot.axes, "observers": observers}


def _markers(geometry: HopperGeometry) -> tuple[str, ...]:
    """Return the names of the markers that are seen, the boom's last."""
    if geometry.boom_name is None:
        return geometry.body_names
    return (*geometry.body_names, geometry.boom_name)


def _limits(options: argparse.Namespace, robot: DrivenRobot | None = None) -> Limits:
    from hopdata.steering.live.limits import Limits

    if robot is not None:
        return replace(robot.limits, fence_m=options.fence)
    return Limits(swing_rad=options.swing_limit, fence_m=options.fence)


def _boom_and_stream(
    options: argparse.Namespace, geometry: HopperGeometry, robot: DrivenRobot | None
) -> tuple[Driven, Stream]:
    """Return what moves, and what is seen."""
    if options.host is None:
        if robot is not None:
            return _simulated(options, robot)
        return _simulated_hopper(options)
    from hopdata.steering.live import sources
    from hopdata.steering.live.actuator import NoActuator, NoBoom, UdpBoom

    seen = sources.stream_of(
        options.source,
        _markers(geometry),
        host=options.host,
        port=options.port,
        rate_hz=options.rate,
    )
    if options.dry_run:
        return NoBoom() if robot is None else NoActuator(), seen
    if robot is not None:
        return robot.actuator_at(options.boom), seen
    host, _, port = options.boom.rpartition(":")
    return UdpBoom(int(port), host=host), seen


def _simulated(
    options: argparse.Namespace, robot: DrivenRobot
) -> tuple[Driven, Stream]:
    """Return actuator and stream of a simulated robot that is not the hopper."""
    from hopdata.steering.live.actuator import NoActuator
    from hopdata.steering.live.seen_robots import SeenRobot, released
    from hopdata.steering.live.simulated import SimulatedStream

    simulation = robot.simulation()
    held = released(simulation)
    with terminal.progress_line("a first stride, which may compile code"):
        tried = robot.simulation()
        SeenRobot(tried, released(tried), seed=SEED, rate_hz=options.rate).next_frames()
    seen = SeenRobot(simulation, held, pose=START, seed=SEED, rate_hz=options.rate)
    stream = SimulatedStream(seen)
    if options.dry_run:
        return NoActuator(), stream
    return held, stream


def _simulated_hopper(options: argparse.Namespace) -> tuple[Driven, Stream]:
    """Return boom and stream of the simulated hopper."""
    from hopdata.steering.live.actuator import NoBoom
    from hopdata.steering.live.simulated import (
        LiveHopper,
        SimulatedBoom,
        SimulatedStream,
    )
    from hopdata.steering.robot import SteeredHopper

    boom = SimulatedBoom()
    hopper = LiveHopper(
        SteeredHopper(),
        boom.newest,
        pose=START,
        rate_hz=options.rate,
        seed=SEED,
    )
    stream = SimulatedStream(hopper)
    if options.dry_run:
        return NoBoom(), stream
    return boom, stream


def _title(options: argparse.Namespace) -> str:
    what = ""
    if options.excite is not None:
        what = f"; excitation of {counted(options.excite, 'stride')}"
    if options.host is None:
        return f"SIMULATED {options.robot or 'hopper'}; there is no robot{what}"
    moved = "boom" if options.robot is None else "actuator"
    sent = f"{moved} at {options.boom}"
    if options.dry_run:
        sent = "dry run, nothing is sent"
    seen_by = f"{options.source} {options.host}"
    if options.source == "qualisys":
        seen_by = f"{options.host}:{options.port}"
    return f"robot seen by {seen_by}; {sent}{what}"


def _warn_of(folder: Path | None) -> None:
    """Say so if the model will probably not take the robot to a point."""
    from hopdata.jobs import read_table
    from hopdata.steering.control.forecast import warning

    if folder is None or not (folder / SCORES).is_file():
        return
    said = warning(read_table(folder / SCORES))
    if said is not None:
        print(f"warning: {said}")


# What a drive and its replay have in common: geometry and controller.


def _files(
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


def _parts(
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


# The rehearsal.


def _rehearse(options: argparse.Namespace) -> int:
    """Perform each act that must bring the boom to rest, or list them for a robot."""
    if options.host is not None:
        _list_acts(options)
        return terminal.OK
    return _perform_acts(options)


def _list_acts(options: argparse.Namespace) -> None:
    from hopdata.steering.live.rehearsal import all_acts
    from hopdata.steering.observation.geometry import load_geometry

    robot = _robot(options.robot)
    limits = _limits(options, robot)
    if options.model is None:
        raise _no_model()
    geometry = load_geometry(options.model / GEOMETRY)
    print(
        "With the robot on a rope, and a hand on the emergency stop. "
        "Begin each act while it"
    )
    print(
        "hops, or while you lift it and set it down: "
        "without a stance no swing is sent.\n"
    )
    what = _what_moves(robot)
    print(f"  {'do this':{ACT_WIDTH}}  the {what} must rest, and the screen must say")
    for act in all_acts(geometry, limits, robot):
        if act.by_hand:
            print(f"  {act.by_hand:{ACT_WIDTH}}  {act.rest}")


def _perform_acts(options: argparse.Namespace) -> int:
    from hopdata.steering.live.rehearsal import all_acts, perform, simulated_geometry

    robot = _robot(options.robot)
    limits = _limits(options, robot)
    if robot is None:
        with terminal.progress_line("learning the geometry of the simulated hopper"):
            geometry = simulated_geometry()
    else:
        robot.simulation()  # refused at once if there is none
        geometry = robot.geometry
    print(f"SIMULATED {options.robot or 'hopper'}; there is no robot")
    n_acts = len(all_acts(geometry, limits, robot))
    print(f"{counted(n_acts, 'act')}, some {n_acts * ACT_S:.0f} s on a free machine\n")
    columns = f"{'act':{ACT_WIDTH}}  {'rest expected':{REST_WIDTH}}"
    print(f"  {columns}  {'ms':>5}  what happened")
    wrong = 0
    logging.disable(logging.ERROR)  # the table says what the loop would log
    try:
        with terminal.progress_line(f"act 1 of {n_acts}") as progress:
            for number, done in enumerate(perform(geometry, limits, robot), 1):
                print(_row(done), flush=True)
                if not done.is_right:
                    wrong += 1
                if number < n_acts:
                    progress(f"act {number + 1} of {n_acts}")
    finally:
        logging.disable(logging.NOTSET)
    if wrong:
        print(f"\n{counted(wrong, 'act')} without the rest expected: do not drive")
        return terminal.PROBLEM
    what = _what_moves(robot)
    print(f"\neach act has brought the {what} to rest, until it was armed again")
    return terminal.OK


def _what_moves(robot: DrivenRobot | None) -> str:
    """Return what messages call the part that the inputs move."""
    from hopdata.steering.frame_changes import HOPPER
    from hopdata.steering.live.decisions import moved_part

    return moved_part(HOPPER if robot is None else robot.axes)


def _row(done: Performed) -> str:
    """Return a row of the table; a "!" marks an act without the rest expected."""
    act = done.act
    mark = " " if done.is_right else "!"
    after_ms = "-" if math.isnan(done.after_s) else f"{1e3 * done.after_s:.0f}"
    happened = str(done.cause or "NO REST")
    if done.moved:
        happened = f"MOVED after its rest: {happened}"
    elif done.resumed:
        happened = f"WENT ON by itself: {happened}"
    elif not done.obeyed:
        arming = "COULD be armed again" if act.is_over else "COULD NOT be armed again"
        happened = f"{arming}: {happened}"
    elif done.after_s > act.within_s:
        happened = f"TOO LATE, beyond {1e3 * act.within_s:.0f} ms: {happened}"
    columns = f"{act.name:{ACT_WIDTH}}  {act.rest:{REST_WIDTH}}"
    return f"{mark} {columns}  {after_ms:>5}  {happened}"


# The replay.


def replay(options: argparse.Namespace) -> int:
    """Feed a log to the same controller; exit code 1 if a plan differs."""
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.log_reading import read_log
    from hopdata.steering.live.loop import checks_of, observers_of
    from hopdata.steering.live.replay import replay as replayed

    log = read_log(options.log)
    _require_settings(options.log, log.setup)
    named = options.robot or log.setup.get("robot")
    robot = _robot(named, by_user=options.robot is not None)
    geometry, controller = _parts(log.setup, log.files, robot)
    rate_hz = log.setup["rate_hz"]
    limits = Limits(**log.setup["limits"])
    observers: Observers = observers_of(geometry, rate_hz)
    if robot is not None:
        observers = robot.observers(geometry, rate_hz)
    plans = replayed(
        log,
        observers,
        controller,
        limits=limits,
        checks=checks_of(geometry, rate_hz, limits),
    )
    parts = [
        f"simulated {named or 'hopper'}"
        if log.setup["simulated"]
        else "recorded robot",
        counted(len(log.frames), "frame"),
        counted(len(log.decisions), "stance"),
        counted(len(plans), "plan"),
    ]
    print(f"{options.log}: {', '.join(parts)}")
    for event in log.events[log.events["kind"] == "rest"].itertuples():
        print(f"  at rest at {event.sent_s:.3f} s: {event.text}")
    other = plans[~plans["same"]]
    for plan in other.to_dict("records"):
        inputs = f"planned {_listed(plan['then'])} then, {_listed(plan['now'])} now"
        print(f"  {plan['told_s']:.3f} s: {inputs}")
    n_same = len(plans) - len(other)
    print(f"{n_same} of {counted(len(plans), 'plan')} the same to the bit")
    return terminal.PROBLEM if len(other) else terminal.OK


def _listed(inputs: Sequence[float]) -> str:
    return ", ".join(map(repr, inputs))


def _require_settings(log: Path, setup: Mapping[str, Any]) -> None:
    """Require the settings that a drive stores in its log, each of its kind.

    Raises
    ------
    ConfigError
        If one is missing or of another kind.
    """
    from hopdata.steering.live.limits import Limits

    place = f"{log}: setup"
    heading = setup.get("heading_deg")
    is_goal = heading is None or _is_number(heading)
    if heading is None:
        to: Any = setup.get("to")
        is_pair = isinstance(to, list) and len(to) == 2
        is_goal = is_pair and all(map(_is_number, to))
    require(is_goal, place, "a goal: heading_deg, or to", f"{setup.get('to')!r}"[:40])
    named = setup.get("robot")
    is_name = named is None or isinstance(named, str)
    require(is_name, f"{place}.robot", "a name", f"{named!r}"[:40])
    for key in ("adaptive", "simulated"):
        value = setup.get(key)
        require(isinstance(value, bool), f"{place}.{key}", "true or false", value)
    rate_hz: Any = setup.get("rate_hz")
    is_rate = _is_number(rate_hz) and 0 < rate_hz < MOST_HZ
    require(is_rate, f"{place}.rate_hz", "a frame rate", f"{rate_hz!r}"[:40])
    limits = setup.get("limits")
    known = {one.name for one in fields(Limits)}
    is_sound = (
        isinstance(limits, dict)
        and {"swing_rad"} <= {*limits} <= known
        and all(map(_is_number, limits.values()))
    )
    wanted = f"numbers for {', '.join(sorted(known))}"
    require(is_sound, f"{place}.limits", wanted, f"{limits!r}"[:40])


# A frame rate that no camera reaches; JSON may hold any number.
MOST_HZ = 1e6


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value)


# The operator's screen.


class Screen:
    """Shows state, pose, hop, plan, time left and faults: a picture, or a line per hop.

    The picture is drawn on a terminal. There, a and Enter arm the drive. Enter alone,
    or after anything else, is the operator's stop key: the boom rests and the drive is
    over.
    """

    def __init__(
        self,
        title: str,
        seconds: float | None,
        command_s: float,
        log: DriveLog,
        axes: StrideAxes,
    ) -> None:
        self._axes = axes
        self._seconds = seconds
        self._command_s = command_s
        self._log = log
        self._begun = time.monotonic()
        self._drawn = self._begun
        self._hops = 0
        self._n_rests_told = 0
        self._n_steps_told = 0
        self._boom_told = False
        self._refusal = ""
        self._last_hop = "no stance yet"
        self._is_live = _is_on_terminal()
        self._n_lines_drawn = 0
        print(title)
        if self._is_live:
            print("a and Enter: arm it, at first and after each rest")
            print("Enter or Ctrl-C: the robot rests, and it ends")

    def decided(self, decision: Decision) -> None:
        """Record the decision at a stance; called in the loop's thread."""
        self._hops += 1
        x, y, heading = decision.pose
        last_hop = (
            f"hop {self._hops:3d}  {_metres('x', x)}, {_metres('y', y)}, "
            f"{_degrees('heading', heading)}{self._states_of(decision)}\n"
            f"         {decision.outcome}: {self._swing_of(decision)}"
        )
        if decision.reason is not None:
            last_hop += f"; {decision.reason}"
        self._last_hop = last_hop
        if not self._is_live:
            print(" ".join(last_hop.split()), flush=True)

    def _states_of(self, decision: Decision) -> str:
        """Return the states of the robot at the stance."""
        from hopdata.steering.live.decisions import is_hopper

        if is_hopper(self._axes):
            return f", {_degrees('boom', decision.boom_angle_rad)}"
        values = zip(self._axes.states, decision.state, strict=True)
        return "".join(f", {_in_unit(one, value)}" for one, value in values)

    def _swing_of(self, decision: Decision) -> str:
        """Return what was sent, and how long the plan took, if there was one."""
        if math.isnan(decision.command[0]):
            names = " or ".join(self._axes.input_names).replace("_", " ")
            return f"no {names} is sent"
        values = zip(self._axes.inputs, decision.command, strict=True)
        sent = ", ".join(_in_unit(one, value) for one, value in values)
        if math.isnan(decision.planning_s):
            return sent
        planning_ms = 1e3 * decision.planning_s
        spare_ms = 1e3 * (self._command_s - decision.since_stance_s)
        return f"{sent}, plan took {planning_ms:.1f} ms, {spare_ms:.0f} ms to spare"

    def look(self, loop: ControlLoop, stream: Stream) -> None:
        """React to the operator's keys and update the display."""
        if not self._boom_told:
            self._boom_told = True
            print(loop.watch.says_of_boom(), flush=True)
        typed = _typed_line() if self._is_live else None
        if typed == ARM_KEY:
            refused = loop.arm()
            self._refusal = "" if refused is None else f"NOT ARMED: {refused}"
        elif typed is not None:
            loop.end(Message("steering.operators_key"))
        if self._is_live:
            self._draw(loop, stream)
        else:
            self._tell_rests(loop)

    def _tell_rests(self, loop: ControlLoop) -> None:
        """Print the rests and the states since the last look."""
        rests = loop.watch.rests
        for rest in rests[self._n_rests_told :]:
            print(f"the {loop.watch.what} rests: {rest.cause}", flush=True)
        self._n_rests_told = len(rests)

    def _draw(self, loop: ControlLoop, stream: Stream) -> None:
        """Draw the picture over the last one, unless that is too young."""
        now = time.monotonic()
        if now < self._drawn + DRAW_S:
            return
        self._drawn = now
        lines = self._picture(loop, stream, now - self._begun)
        up = f"\033[{self._n_lines_drawn}A" if self._n_lines_drawn else ""
        columns = os.get_terminal_size().columns or 80  # 0 where nobody has set it
        width = columns - 1  # wrapped lines would leave remains
        drawn = [f"\033[K{printable(line[:width])}" for line in lines]
        screen = terminal.raw_stream(sys.stdout)
        print(up + "\n".join(drawn), file=screen, flush=True)
        self._n_lines_drawn = len(lines)

    def _picture(self, loop: ControlLoop, stream: Stream, passed_s: float) -> list[str]:
        left = ""
        if self._seconds is not None:
            left = f", {max(0.0, self._seconds - passed_s):.0f} s left"
        counts = stream.counts
        frames = f"{counts.frames} frames, {counts.missing} missing"
        state = f"stream {stream.states.status.state}"
        rests = loop.watch.rests
        lasting = "; ".join(map(str, list(loop.watch.machine.lasting.values())))
        last_rest = f", the last: {rests[-1].cause}" if rests else ""
        lines = [
            f"{passed_s:6.0f} s{left}; {state}, {frames}, {counts.garbled} garbled",
            f"{str(loop.state).upper()}  {self._what_next(loop)}",
            *self._last_hop.splitlines(),
            f"faults   {lasting or 'none now'}; rests so far: {len(rests)}{last_rest}",
        ]
        if self._log.failure:  # otherwise the logger has said it
            lines.append(f"log      {self._log.failure}")
        return lines

    def _what_next(self, loop: ControlLoop) -> str:
        """Return what the operator can do in this state."""
        state = loop.state
        if state == "armed":
            return "the first swing is sent at the next stance"
        if state not in ("waiting", "resting"):
            return str(loop.watch.cause or "")
        if self._refusal and loop.watch.machine.lasting:
            return self._refusal
        why = f"{loop.watch.cause}; " if state == "resting" else ""
        return f"{why}a and Enter to arm it"


def _metres(name: str, place_m: float) -> str:
    if math.isnan(place_m):
        return f"{name} not seen"
    return f"{name} {place_m:+.2f} m"


def _degrees(name: str, angle_rad: float) -> str:
    if math.isnan(angle_rad):
        return f"{name} not seen"
    return f"{name} {math.degrees(angle_rad) % 360:3.0f} deg"


def _in_unit(axis: Input | State, value: float) -> str:
    """Return a state or an input with its unit."""
    name = axis.name.replace("_", " ")
    if math.isnan(value):
        return f"{name} not known"
    return f"{name} {value:+.2f} {axis.unit.replace('_', '/')}"


def _is_on_terminal() -> bool:
    return sys.stdout.isatty() and sys.stdin.isatty()


def _typed_line() -> str | None:
    """Return the line that was typed since the last call, if one was; never wait."""
    if sys.platform == "win32":
        return _typed_on_windows()
    import select

    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    if not ready:
        return None
    line = sys.stdin.readline()
    return line.strip() if line else None  # None at the end of the input


# Keys that were typed on Windows, up to Enter.
_typed: list[str] = []


def _typed_on_windows() -> str | None:
    import msvcrt

    while msvcrt.kbhit():  # type: ignore[attr-defined, unused-ignore]
        key = msvcrt.getwch()  # type: ignore[attr-defined, unused-ignore]
        if key in "\r\n":
            line = "".join(_typed).strip()
            _typed.clear()
            return line
        _typed.append(key)
    return None
