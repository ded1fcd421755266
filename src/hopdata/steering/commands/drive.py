"""``hopdata drive``: steer a simulated or real hopper live; ``hopdata replay``: replay its log."""

from __future__ import annotations

import argparse
import logging
import math
import os
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.errors import ConfigError, counted, require

if TYPE_CHECKING:
    from hopdata.steering.control.objectives import Controller
    from hopdata.steering.live.buffer import Stream
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.loop import ControlLoop, Decision
    from hopdata.steering.live.rehearsal import Performed
    from hopdata.steering.live.safety import Boom
    from hopdata.steering.observation.geometry import HopperGeometry

GEOMETRY, MODEL = "geometry.json", "model.npz"
LEARNED_HOPS, SEED = 100, 1
START = (1.0, 0.0, 0.0)  # pose of the simulated hopper: m, m, rad
DRAW_S = 0.25
LOG = "drive.h5"  # the first log of a folder
ACT_WIDTH, REST_WIDTH = 50, 37  # columns of the table of a rehearsal


def drive(options: argparse.Namespace) -> int:
    """Drive until the time is up, a fault ends it, or the operator does."""
    from hopdata.steering.live.drive import drive as driven
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.safety import Limits, NoBoom, UdpBoom
    from hopdata.steering.live.simulated import (
        LiveHopper,
        SimulatedBoom,
        SimulatedStream,
    )
    from hopdata.steering.robot import SteeredHopper

    if options.rehearse:
        return _rehearse(options)
    _require_whole(options)
    path = _log_path(options.log)
    with terminal.progress_line() as progress:
        files = _files(options.model, progress)
        progress("planning ahead")
        limits = Limits(swing_rad=options.swing_limit, fence_m=options.fence)
        setup = {
            "simulated": options.host is None, "dry_run": options.dry_run, "to": options.to,
            "adaptive": options.adaptive, "heading_deg": options.heading,
            "rate_hz": options.rate, "limits": vars(limits),
        }  # fmt: skip
        geometry, controller = _parts(setup, files)
    boom: Boom
    stream: Stream | None = None
    if options.host is None:
        boom = simulated = SimulatedBoom()
        hopper = LiveHopper(
            SteeredHopper(),
            simulated.newest,
            pose=START,
            rate_hz=options.rate,
            seed=SEED,
        )
        stream = SimulatedStream(hopper)
    if options.dry_run:
        boom = NoBoom()
    elif options.boom is not None:
        host, _, port = options.boom.rpartition(":")
        boom = UdpBoom(int(port), host=host)
    log = DriveLog(path, len(geometry.body_names) + 1, setup=setup, files=files)
    print(f"log: {path}")
    stop = threading.Event()
    screen = Screen(_title(options), options.seconds, limits.command_s, log)
    try:
        done = driven(
            geometry, controller, boom, host=options.host or "", port=options.port, stream=stream,
            stop=stop, seconds=options.seconds, rate_hz=options.rate, limits=limits,
            on_decision=screen.decided, on_look=screen.look, log=log,
            rest_without_log=options.log_full == "rest",
        )  # fmt: skip
    finally:
        if log.failure:
            print(f"log: {path} holds the drive up to when {log.failure}")
        print(f"log: {path}; hopdata replay {path} plays it again")
    print(
        f"{counted(len(done.decisions), 'stance')}, {counted(len(done.rests), 'rest')}:"
    )
    for rest in done.rests:
        print(f"  {rest.cause}")
    return terminal.OK


def _log_path(named: Path | None) -> Path:
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


def _rehearse(options: argparse.Namespace) -> int:
    """Perform each act that must bring the boom to rest, or list them for a robot."""
    from hopdata.steering.live.rehearsal import acts, perform, simulated_geometry
    from hopdata.steering.live.safety import Limits

    limits = Limits(swing_rad=options.swing_limit, fence_m=options.fence)
    if options.host is not None:
        geometry = _named_geometry(options.model)
        names = (*geometry.body_names, str(geometry.boom_name))
        print(
            "With the robot on a rope, and a hand on the emergency stop. Begin each act while it"
        )
        print(
            "hops, or while you lift it and set it down: without a stance no swing is sent.\n"
        )
        print(f"  {'do this':{ACT_WIDTH}}  the boom must rest, and the screen must say")
        for act in acts(names, limits):
            if act.by_hand:
                print(f"  {act.by_hand:{ACT_WIDTH}}  {act.rest}")
        return terminal.OK
    with terminal.progress_line() as progress:
        progress("learning the geometry of the simulated hopper")
        geometry = simulated_geometry()
    print("SIMULATED hopper; there is no robot\n")
    print(
        f"  {'act':{ACT_WIDTH}}  {'rest expected':{REST_WIDTH}}  {'ms':>5}  what happened"
    )
    missing = 0
    logging.disable(logging.ERROR)  # the table says what the loop would log
    try:
        for done in perform(geometry, limits):
            print(_row(done), flush=True)
            missing += not done.is_right
    finally:
        logging.disable(logging.NOTSET)
    if missing:
        print(f"\n{counted(missing, 'act')} without the rest expected: do not drive")
        return terminal.PROBLEM
    print("\neach act has brought the boom to rest")
    return terminal.OK


def _row(done: Performed) -> str:
    """Return a row of the table of a rehearsal; a "!" marks an act without the rest expected."""
    act = done.act
    mark = " " if done.is_right else "!"
    after = "-" if math.isnan(done.after_s) else f"{1e3 * done.after_s:.0f}"
    happened = done.cause or "NO REST"
    if done.moved:
        happened = f"MOVED after its rest: {happened}"
    elif done.after_s > act.within_s:
        happened = f"TOO LATE, beyond {1e3 * act.within_s:.0f} ms: {happened}"
    return f"{mark} {act.name:{ACT_WIDTH}}  {act.rest:{REST_WIDTH}}  {after:>5}  {happened}"


def _named_geometry(folder: Path | None) -> HopperGeometry:
    from hopdata.steering.observation.geometry import load_geometry

    if folder is None:
        raise ConfigError(
            "--model: expected the folder of what was learned from this robot"
        )
    return load_geometry(folder / GEOMETRY)


def replay(options: argparse.Namespace) -> int:
    """Feed a log to the same controller; exit code 1 if a plan differs."""
    from hopdata.steering.live.log import read_log
    from hopdata.steering.live.log import replay as replayed
    from hopdata.steering.live.loop import observers_of
    from hopdata.steering.live.safety import Limits

    log = read_log(options.log)
    geometry, controller = _parts(log.setup, log.files)
    observers, limits = (
        observers_of(geometry, log.setup["rate_hz"]),
        Limits(**log.setup["limits"]),
    )
    plans = replayed(log, observers, controller, limits=limits)
    what = "simulated hopper" if log.setup["simulated"] else "recorded robot"
    print(f"{options.log}: {what}, {counted(len(log.frames), 'frame')}, ", end="")
    print(f"{counted(len(log.decisions), 'stance')}, {counted(len(plans), 'plan')}")
    for event in log.events[log.events["kind"] == "rest"].itertuples():
        print(f"  at rest at {event.sent_s:.3f} s: {event.text}")
    for plan in (other := plans[~plans["same"]]).itertuples():
        print(
            f"  {plan.told_s:.3f} s: planned {plan.then_rad!r} then, {plan.now_rad!r} now"
        )
    print(
        f"{len(plans) - len(other)} of {counted(len(plans), 'plan')} the same to the bit"
    )
    return terminal.PROBLEM if len(other) else terminal.OK


def _require_whole(options: argparse.Namespace) -> None:
    """Refuse options that would move nothing, or something that nobody has named."""
    real = options.host is not None
    if real and options.model is None:
        raise ConfigError(
            "--model: expected the folder of what was learned from this robot"
        )
    if real and (options.boom is None) != options.dry_run:
        raise ConfigError(
            "--host: expected either --boom HOST:PORT or --dry-run with it"
        )
    if not real and options.boom is not None:
        raise ConfigError(
            "--boom: expected --host with it; the simulated hopper has its own boom"
        )
    port = "" if options.boom is None else options.boom.rpartition(":")[2]
    require(
        options.boom is None or port.isdecimal(),
        "--boom",
        "HOST:PORT",
        f"{options.boom!r}",
    )


def _files(folder: Path | None, progress: Any) -> dict[str, bytes]:
    """Return the model's files; without a folder, those of a model of the simulated hopper."""
    from hopdata.steering.models.process import load_process, save_process
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            progress("learning from the simulated hopper")
            geometry, process = _learned()
            folder = Path(temporary)
            geometry.save(folder / GEOMETRY)
            save_process(folder / MODEL, process)
        load_geometry(
            folder / GEOMETRY
        )  # these report what is wrong, and with which file
        load_process(folder / MODEL)
        return {name: (folder / name).read_bytes() for name in (GEOMETRY, MODEL)}


def _learned() -> tuple[Any, Any]:
    import numpy as np

    from hopdata.steering.models.process import trained_process
    from hopdata.steering.observation.observe import observe_recordings
    from hopdata.steering.robot import SteeredHopper
    from hopdata.steering.trial import ControlGrid, eulerian_excitation, record_trial

    robot, rng = SteeredHopper(), np.random.default_rng(np.random.SeedSequence(SEED))
    swings = eulerian_excitation(ControlGrid(), rng)[: LEARNED_HOPS + 20]
    recording = record_trial(robot, swings, seed=SEED).recording
    seen = observe_recordings([recording], swing_limit_rad=robot.swing_limit_rad)
    return seen.geometry, trained_process(
        seen.changes.used().rows(np.arange(LEARNED_HOPS))
    )


def _parts(
    setup: Mapping[str, Any], files: Mapping[str, bytes]
) -> tuple[HopperGeometry, Controller]:
    """Return geometry and controller, which are the same for a drive and its replay."""
    from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint
    from hopdata.steering.control.planner import AdaptivePlanner, planner
    from hopdata.steering.models.process import load_process
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        geometry, process = (
            load_geometry(f"{folder}/{GEOMETRY}"),
            load_process(f"{folder}/{MODEL}"),
        )
    goal: ToPoint | ToHeading = ToPoint(point_m=tuple(setup["to"]))
    if setup["heading_deg"] is not None:
        goal = ToHeading(heading_rad=math.radians(setup["heading_deg"]))
    limit = setup["limits"]["swing_rad"]
    controller = planner(process, goal, horizon=Horizon(hops=2, swing_limit_rad=limit))
    controller.plan(START, math.pi)  # loads what it needs
    if setup["adaptive"]:
        return geometry, AdaptivePlanner(controller, process.chance)
    return geometry, controller


def _title(options: argparse.Namespace) -> str:
    if options.host is None:
        return "SIMULATED hopper; there is no robot"
    sent = "dry run, nothing is sent" if options.dry_run else f"boom at {options.boom}"
    return f"robot seen by {options.host}:{options.port}; {sent}"


class Screen:
    """Shows pose, hop, plan, time left and faults: a picture on a terminal, else a line per hop.

    On a terminal, Enter is the operator's stop key: the boom rests and the drive is
    over.
    """

    def __init__(
        self, title: str, seconds: float | None, command_s: float, log: DriveLog
    ) -> None:
        self._title, self._seconds, self._command_s = title, seconds, command_s
        self._log = log
        self._begun = self._drawn = time.monotonic()
        self._hops, self._rests, self._last = 0, 0, "no stance yet"
        self._live, self._lines = sys.stdout.isatty() and sys.stdin.isatty(), 0
        print(
            title
            + ("\nEnter or Ctrl-C: the boom rests, and it ends" if self._live else "")
        )

    def decided(self, decision: Decision) -> None:
        """Record the decision at a stance; called in the loop's thread."""
        self._hops += 1
        x, y, heading = decision.pose
        spare = 1e3 * (self._command_s - decision.since_stance_s)
        self._last = (
            f"hop {self._hops:3d}  x {x:+.2f} m, y {y:+.2f} m, "
            f"heading {math.degrees(heading) % 360:3.0f} deg, "
            f"boom {math.degrees(decision.boom_angle_rad) % 360:3.0f} deg\n"
            f"         {decision.outcome}: swing {decision.command_rad:+.2f} rad, plan took "
            f"{1e3 * decision.planning_s:.1f} ms, {spare:.0f} ms to spare"
            + (f"; {decision.reason}" if decision.reason else "")
        )
        if not self._live:
            print(" ".join(self._last.split()), flush=True)

    def look(self, loop: ControlLoop, stream: Stream) -> None:
        """React to the operator's key and update the display."""
        if self._live and _enter_pressed():
            loop.rest("the operator's key")
        rests, now = loop.watch.rests, time.monotonic()
        if not self._live:
            for rest in rests[self._rests :]:
                print(f"the boom rests: {rest.cause}", flush=True)
            self._rests = len(rests)
            return
        if now < self._drawn + DRAW_S:
            return
        self._drawn, passed = now, now - self._begun
        left = (
            ""
            if self._seconds is None
            else f", {max(0.0, self._seconds - passed):.0f} s left"
        )
        counts = stream.counts
        lines = [
            f"{passed:6.0f} s{left}; stream {stream.states.status.state}, {counts.frames} frames, "
            f"{counts.missing} missing, {counts.garbled} garbled",
            *self._last.splitlines(),
            f"faults   {loop.watch.cause or 'none now'}; rests so far: {len(rests)}"
            + (f", the last: {rests[-1].cause}" if rests else ""),
        ]
        if self._log.failure:  # otherwise the logger has said it
            lines.append(f"log      {self._log.failure}")
        up = f"\033[{self._lines}A" if self._lines else ""
        width = os.get_terminal_size().columns - 1  # wrapped lines would leave remains
        print(up + "\n".join(f"\033[K{line[:width]}" for line in lines), flush=True)
        self._lines = len(lines)


def _enter_pressed() -> bool:
    import select

    ready = (
        select.select([sys.stdin], [], [], 0.0)[0] if sys.platform != "win32" else []
    )
    return bool(ready) and sys.stdin.readline() != ""
