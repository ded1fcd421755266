"""``hopdata drive``: steer a simulated or real robot."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.errors import ConfigError, counted, require
from hopdata.messages import Message
from hopdata.steering.commands import excite
from hopdata.steering.commands.excite import GEOMETRY, SCORES
from hopdata.steering.commands.parts import (
    SEED,
    START,
    axes_of,
    files_of,
    limits_of,
    no_model,
    parts_of,
    robot_of,
)
from hopdata.steering.commands.rehearse import rehearse
from hopdata.steering.commands.screen import Screen, is_on_terminal

if TYPE_CHECKING:
    from hopdata.steering.control.interface import Controller
    from hopdata.steering.live.actuator import Driven
    from hopdata.steering.live.buffer import Stream
    from hopdata.steering.live.drive import Drive
    from hopdata.steering.live.excited import Excitation
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.loop import ControlLoop, Decision
    from hopdata.steering.live.robots import DrivenRobot
    from hopdata.steering.observation.geometry import HopperGeometry

# The first log of a folder.
LOG = "drive.h5"
# Longest drive to a goal, s.
LONGEST_S = 60.0

# Causes to rest of a simulated robot that only a slow computer has.
OF_A_SLOW_COMPUTER = (
    "steering.no_frame",
    "steering.plan_came_late",
    "steering.plan_late",
    "steering.unacknowledged",
)


def drive(options: argparse.Namespace) -> int:
    """Drive until the time is up, a fault ends it, or the operator does."""
    excite.require_whole(options)
    if options.rehearse:
        return rehearse(options)
    _require_whole(options)
    path = log_path(options.log)
    robot = robot_of(options.robot)
    limits = limits_of(options, robot)
    setup = _setup(options, limits)
    if options.excite is None:
        with terminal.progress_line() as progress:
            files = files_of(options.model, progress, robot)
            progress("planning ahead")
            geometry, controller = parts_of(setup, files, robot)
        _drive(options, path, setup, files, (geometry, controller))
        return terminal.OK
    folder = excite.folder_of(path)
    with terminal.progress_line("reading the geometry"):
        axes = axes_of(robot, limits)
        setup["excitation"] = excite.drawn(options, axes).tolist()
        files = excite.geometry_files(options.geometry, robot)
        geometry, controller = parts_of(setup, files, robot)
    decisions: list[Decision] = []
    has_ended = False
    try:
        _drive(options, path, setup, files, (geometry, controller), decisions)
        has_ended = True
    finally:
        # A drive that could not begin leaves no folder, so that it can be repeated.
        if has_ended or decisions:
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
    robot = robot_of(options.robot)
    limits = limits_of(options, robot)
    boom, stream = _boom_and_stream(options, geometry, robot)
    n_markers = len(_markers(geometry))
    log_axes = {} if robot is None else {"axes": robot.axes}
    log = DriveLog(path, n_markers, setup=setup, files=files, **log_axes)
    print(f"log: {path}")
    _warn_of(options.model)
    seconds = _seconds(options)
    axes = axes_of(robot, limits)
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
        print(f"log: {path}; {_replay_of(path, options.robot)} plays it again")
    stances = counted(len(done.decisions), "stance")
    print(f"{stances}, {counted(len(done.rests), 'rest')}:")
    for rest in done.rests:
        print(f"  {rest.cause}")
    in_real_time = options.host is None and not _in_simulated_time(options)
    if in_real_time and _was_too_slow(done):
        print("  the robot is simulated in real time, and this computer was too slow:")
        print("  something else keeps it busy, or --rate is too high for it")


def _replay_of(path: Path, robot: str | None) -> str:
    """Return the command that plays a log, with what it asks for."""
    # The module of a robot is run only where the user names it again.
    named = f" --robot {robot}" if robot is not None and ":" in robot else ""
    return f"hopdata replay {path}{named}"


def _was_too_slow(done: Drive) -> bool:
    """Return whether a drive of a simulated robot shows that plans were late."""
    causes = {rest.cause.code for rest in done.rests}
    is_overtaken = any(one.outcome == "overtaken" for one in done.decisions)
    return is_overtaken or not causes.isdisjoint(OF_A_SLOW_COMPUTER)


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
    robot = robot_of(options.robot)
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
    elif armed and loop.state == "resting" and not is_on_terminal():
        loop.end(Message("steering.nobody_arms"))


def _require_whole(options: argparse.Namespace) -> None:
    """Refuse options that would move nothing, or something that nobody has named."""
    is_robot = options.host is not None
    is_boom_named = options.boom is not None
    if is_robot and options.model is None and options.excite is None:
        raise no_model()
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
    if not options.armed and not is_on_terminal():
        wanted = "a terminal, on which an operator arms the drive with a and Enter"
        raise ConfigError(f"--armed: expected it, or {wanted}")
    if is_robot:
        _require_client(options.source)


def _require_client(source: str) -> None:
    """Require the library of a source before the work, not after it."""
    from hopdata.steering.live import sources

    sources.require_client(source)


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
        dry = ", and --dry-run changes nothing" if options.dry_run else ""
        return f"SIMULATED {options.robot or 'hopper'}; there is no robot{dry}{what}"
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
