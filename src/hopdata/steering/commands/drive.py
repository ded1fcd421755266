"""``hopdata drive`` steers a hopper live; ``hopdata replay`` plays its log again."""

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
    from hopdata.steering.models.process import FrameChangeProcess
    from hopdata.steering.observation.geometry import HopperGeometry

GEOMETRY = "geometry.json"
MODEL = "model.npz"
# The simulated hopper: hops that its model is learned from, hops made beyond them since
# some cannot be used, seed, and the pose at which it begins, m, m, rad.
LEARNED_HOPS = 100
SPARE_HOPS = 20
SEED = 1
START = (1.0, 0.0, 0.0)
DRAW_S = 0.25  # time between pictures on a terminal
LOG = "drive.h5"  # the first log of a folder
# Columns of the table of a rehearsal.
ACT_WIDTH = 50
REST_WIDTH = 37


def drive(options: argparse.Namespace) -> int:
    """Drive until the time is up, a fault ends it, or the operator does."""
    from hopdata.steering.live.drive import drive as driven
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.safety import Limits

    if options.rehearse:
        return _rehearse(options)
    _require_whole(options)
    path = _log_path(options.log)
    with terminal.progress_line() as progress:
        files = _files(options.model, progress)
        progress("planning ahead")
        limits = Limits(swing_rad=options.swing_limit, fence_m=options.fence)
        setup = {
            "simulated": options.host is None,
            "dry_run": options.dry_run,
            "to": options.to,
            "adaptive": options.adaptive,
            "heading_deg": options.heading,
            "rate_hz": options.rate,
            "limits": vars(limits),
        }
        geometry, controller = _parts(setup, files)
    boom, stream = _robot(options)
    log = DriveLog(path, len(geometry.body_names) + 1, setup=setup, files=files)
    print(f"log: {path}")
    stop = threading.Event()
    screen = Screen(_title(options), options.seconds, limits.command_s, log)
    try:
        done = driven(
            geometry,
            controller,
            boom,
            host=options.host or "",
            port=options.port,
            stream=stream,
            stop=stop,
            seconds=options.seconds,
            rate_hz=options.rate,
            limits=limits,
            on_decision=screen.decided,
            on_look=screen.look,
            log=log,
            rest_without_log=options.log_full == "rest",
        )
    finally:
        if log.failure:
            print(f"log: {path} holds the drive up to when {log.failure}")
        print(f"log: {path}; hopdata replay {path} plays it again")
    stances = counted(len(done.decisions), "stance")
    print(f"{stances}, {counted(len(done.rests), 'rest')}:")
    for rest in done.rests:
        print(f"  {rest.cause}")
    return terminal.OK


def _robot(options: argparse.Namespace) -> tuple[Boom, Stream | None]:
    """Return the boom, and the stream unless it is that of a camera system."""
    from hopdata.steering.live.safety import NoBoom, UdpBoom
    from hopdata.steering.live.simulated import (
        LiveHopper,
        SimulatedBoom,
        SimulatedStream,
    )
    from hopdata.steering.robot import SteeredHopper

    boom: Boom = NoBoom()
    stream: Stream | None = None
    if options.host is None:
        simulated = SimulatedBoom()
        hopper = LiveHopper(
            SteeredHopper(),
            simulated.newest,
            pose=START,
            rate_hz=options.rate,
            seed=SEED,
        )
        stream = SimulatedStream(hopper)
        if not options.dry_run:
            boom = simulated
    elif not options.dry_run:
        host, _, port = options.boom.rpartition(":")
        boom = UdpBoom(int(port), host=host)
    return boom, stream


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


BY_HAND = """\
With the robot on a rope, and a hand on the emergency stop. Begin each act while it
hops, or while you lift it and set it down: without a stance no swing is sent.
"""


def _rehearse(options: argparse.Namespace) -> int:
    """Perform each act that must bring the boom to rest, or list them for a robot."""
    from hopdata.steering.live.rehearsal import acts, perform, simulated_geometry
    from hopdata.steering.live.safety import Limits

    limits = Limits(swing_rad=options.swing_limit, fence_m=options.fence)
    if options.host is not None:
        geometry = _named_geometry(options.model)
        names = (*geometry.body_names, str(geometry.boom_name))
        print(BY_HAND)
        print(f"  {'do this':{ACT_WIDTH}}  the boom must rest, and the screen must say")
        for act in acts(names, limits):
            if act.by_hand:
                print(f"  {act.by_hand:{ACT_WIDTH}}  {act.rest}")
        return terminal.OK
    with terminal.progress_line() as progress:
        progress("learning the geometry of the simulated hopper")
        geometry = simulated_geometry()
    print("SIMULATED hopper; there is no robot\n")
    expected = f"{'rest expected':{REST_WIDTH}}"
    print(f"  {'act':{ACT_WIDTH}}  {expected}  {'ms':>5}  what happened")
    missing = 0
    logging.disable(logging.ERROR)  # the table says what the loop would log
    try:
        for done in perform(geometry, limits):
            print(_row(done), flush=True)
            if not done.is_right:
                missing += 1
    finally:
        logging.disable(logging.NOTSET)
    if missing:
        print(f"\n{counted(missing, 'act')} without the rest expected: do not drive")
        return terminal.PROBLEM
    print("\neach act has brought the boom to rest")
    return terminal.OK


def _row(done: Performed) -> str:
    """Return a row of the table of a rehearsal.

    A "!" marks an act without the rest expected.
    """
    act = done.act
    mark = " " if done.is_right else "!"
    after = "-" if math.isnan(done.after_s) else f"{1e3 * done.after_s:.0f}"
    happened = done.cause or "NO REST"
    if done.moved:
        happened = f"MOVED after its rest: {happened}"
    elif done.after_s > act.within_s:
        happened = f"TOO LATE, beyond {1e3 * act.within_s:.0f} ms: {happened}"
    named = f"{act.name:{ACT_WIDTH}}  {act.rest:{REST_WIDTH}}"
    return f"{mark} {named}  {after:>5}  {happened}"


def _named_geometry(folder: Path | None) -> HopperGeometry:
    """Read the geometry in the folder that is named."""
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
    observers = observers_of(geometry, log.setup["rate_hz"])
    limits = Limits(**log.setup["limits"])
    plans = replayed(log, observers, controller, limits=limits)
    what = "simulated hopper" if log.setup["simulated"] else "recorded robot"
    print(f"{options.log}: {what}, {counted(len(log.frames), 'frame')}, ", end="")
    print(f"{counted(len(log.decisions), 'stance')}, {counted(len(plans), 'plan')}")
    for event in log.events[log.events["kind"] == "rest"].itertuples():
        print(f"  at rest at {event.sent_s:.3f} s: {event.text}")
    differ = plans[~plans["same"]]
    for plan in differ.itertuples():
        swings = f"{plan.then_rad!r} then, {plan.now_rad!r} now"
        print(f"  {plan.told_s:.3f} s: planned {swings}")
    n_same = len(plans) - len(differ)
    print(f"{n_same} of {counted(len(plans), 'plan')} the same to the bit")
    return terminal.PROBLEM if len(differ) else terminal.OK


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
    if options.boom is None:
        return
    if not real:
        raise ConfigError(
            "--boom: expected --host with it; the simulated hopper has its own boom"
        )
    port = options.boom.rpartition(":")[2]
    require(port.isdecimal(), "--boom", "HOST:PORT", f"{options.boom!r}")


def _files(folder: Path | None, progress: Any) -> dict[str, bytes]:
    """Return the model's files; without a folder, those of the simulated hopper."""
    from hopdata.steering.models.process import load_process, save_process
    from hopdata.steering.observation.geometry import load_geometry

    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            progress("learning from the simulated hopper")
            geometry, process = _learned()
            folder = Path(temporary)
            geometry.save(folder / GEOMETRY)
            save_process(folder / MODEL, process)
        # These report what is wrong, and with which file.
        load_geometry(folder / GEOMETRY)
        load_process(folder / MODEL)
        return {name: (folder / name).read_bytes() for name in (GEOMETRY, MODEL)}


def _learned() -> tuple[HopperGeometry, FrameChangeProcess]:
    """Learn geometry and model of the simulated hopper from a recording of it."""
    import numpy as np

    from hopdata.steering.models.process import trained_process
    from hopdata.steering.observation.observe import observe_recordings
    from hopdata.steering.robot import SteeredHopper
    from hopdata.steering.trial import ControlGrid, eulerian_excitation, record_trial

    robot = SteeredHopper()
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    swings = eulerian_excitation(ControlGrid(), rng)[: LEARNED_HOPS + SPARE_HOPS]
    recording = record_trial(robot, swings, seed=SEED).recording
    seen = observe_recordings([recording], swing_limit_rad=robot.swing_limit_rad)
    hops = seen.changes.used().rows(np.arange(LEARNED_HOPS))
    return seen.geometry, trained_process(hops)


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
        geometry = load_geometry(f"{folder}/{GEOMETRY}")
        process = load_process(f"{folder}/{MODEL}")
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
    """Say which hopper is seen, and where the swings go."""
    if options.host is None:
        return "SIMULATED hopper; there is no robot"
    sent = "dry run, nothing is sent" if options.dry_run else f"boom at {options.boom}"
    return f"robot seen by {options.host}:{options.port}; {sent}"


class Screen:
    """Shows pose, hop, plan, time left and faults.

    It is a picture on a terminal, else a line per hop. On a terminal, Enter is the
    operator's stop key: the boom rests and the drive is over.
    """

    def __init__(
        self, title: str, seconds: float | None, command_s: float, log: DriveLog
    ) -> None:
        self._title = title
        self._seconds = seconds
        self._command_s = command_s
        self._log = log
        self._begun = time.monotonic()
        self._drawn = self._begun
        self._hops = 0
        self._rests = 0  # shown so far
        self._last = "no stance yet"
        self._live = sys.stdout.isatty() and sys.stdin.isatty()
        self._lines = 0  # of the last picture
        print(title)
        if self._live:
            print("Enter or Ctrl-C: the boom rests, and it ends")

    def decided(self, decision: Decision) -> None:
        """Record the decision at a stance; called in the loop's thread."""
        self._hops += 1
        x, y, heading = decision.pose
        heading_deg = math.degrees(heading) % 360
        boom_deg = math.degrees(decision.boom_angle_rad) % 360
        planning_ms = 1e3 * decision.planning_s
        spare_ms = 1e3 * (self._command_s - decision.since_stance_s)
        where = (
            f"hop {self._hops:3d}  x {x:+.2f} m, y {y:+.2f} m, "
            f"heading {heading_deg:3.0f} deg, boom {boom_deg:3.0f} deg"
        )
        what = (
            f"{decision.outcome}: swing {decision.command_rad:+.2f} rad, "
            f"plan took {planning_ms:.1f} ms, {spare_ms:.0f} ms to spare"
        )
        if decision.reason:
            what += f"; {decision.reason}"
        self._last = f"{where}\n         {what}"
        if not self._live:
            print(" ".join(self._last.split()), flush=True)

    def look(self, loop: ControlLoop, stream: Stream) -> None:
        """React to the operator's key and update the display."""
        if self._live and _enter_pressed():
            loop.rest("the operator's key")
        if not self._live:
            self._tell_rests(loop)
            return
        now = time.monotonic()
        if now < self._drawn + DRAW_S:
            return
        self._drawn = now
        lines = self._picture(loop, stream, now - self._begun)
        up = f"\033[{self._lines}A" if self._lines else ""
        width = os.get_terminal_size().columns - 1  # wrapped lines would leave remains
        print(up + "\n".join(f"\033[K{line[:width]}" for line in lines), flush=True)
        self._lines = len(lines)

    def _tell_rests(self, loop: ControlLoop) -> None:
        """Print a line for each new rest."""
        rests = loop.watch.rests
        for rest in rests[self._rests :]:
            print(f"the boom rests: {rest.cause}", flush=True)
        self._rests = len(rests)

    def _picture(self, loop: ControlLoop, stream: Stream, passed_s: float) -> list[str]:
        """Return the lines of the picture."""
        rests = loop.watch.rests
        counts = stream.counts
        clock = f"{passed_s:6.0f} s"
        if self._seconds is not None:
            clock += f", {max(0.0, self._seconds - passed_s):.0f} s left"
        faults = f"{loop.watch.cause or 'none now'}; rests so far: {len(rests)}"
        if rests:
            faults += f", the last: {rests[-1].cause}"
        lines = [
            f"{clock}; stream {stream.states.status.state}, {counts.frames} frames, "
            f"{counts.missing} missing, {counts.garbled} garbled",
            *self._last.splitlines(),
            f"faults   {faults}",
        ]
        if self._log.failure:  # otherwise the logger has said it
            lines.append(f"log      {self._log.failure}")
        return lines


def _enter_pressed() -> bool:
    """Tell whether the operator has pressed Enter, without waiting."""
    import select

    if sys.platform == "win32":
        return False
    ready = select.select([sys.stdin], [], [], 0.0)[0]
    return bool(ready) and sys.stdin.readline() != ""
