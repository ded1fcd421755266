"""The real-time loop of Fig. 3.4 over loopback: stances, commands and delays.

    python benchmarks/steering/live_loop.py --out live_loop.csv [--seconds 600] [--hops 10000]

A separate process simulates the hopper and streams its markers by Qualisys' real-time
protocol at 100 Hz, with faults. This process reads the stream with the unmodified
client, detects stances, plans, and sends each swing back. The planner has learned the
hopper's frame changes from 100 hops of a recording, and goes round a square. The first
case lasts `--seconds`, the others at most 60 s each. If the system allows it, all
processes are scheduled before the other work of the machine (`scheduling` "round
robin", as by `chrt --rr 10`), except in the last case.

There is one row per case. `stances_true` counts stances of the simulated hopper during
a connection; `stances_told` those of them reported within 50 ms of their true time,
`stances_lost` the others, and `stances_invented` reported stances that did not happen.
`stances_unconnected` happened without a connection, or so soon after its return that
the preceding fall was not seen; they count for nothing else. `reconnected_ms` is the
longest time from the return of the server to the next frame. `crashes` counts frames
and decisions that raised an exception (if a thread had ended, all later stances would
be lost). `latency_*` is the time from the arrival of the frame that established the
stance to the command; `since_stance_*` starts at the stance itself, on the hopper's own
clock. `rests` are the causes of all rests, the last of which is the end; the drive is
armed again as soon as it can be. `commands_executed` counts sent swings that the hopper executed in the next
flight. `planned_with_stale_pose` must be 0. `machine_*` shows the delay due to the
machine and its other work alone: a separate process sleeps for 10 ms and then computes
for 0.2 ms, and is timed from its scheduled wake-up. Times are in ms.

`live_faults.csv`, beside it, holds ten thousand hops under faults, on a simulated
clock, and whether the boom rests in time.

This part runs the loop that drives a robot (`hopdata.steering.live`), its watch, the
stream's checks of frames, and the simulated hopper at 500 Hz, without threads. Time is
a number that this program advances, so a night passes in minutes and each seed gives
the same result. As on a busy machine, the loop pauses (40 ms at most) and so does the
watch (20 ms). One fault after another affects what the loop sees, plans or sends. This
program knows the time of each fault and the hopper's position, and records each swing
that reaches the boom. The loop learns nothing of these records.

There is one row per kind of fault: how often it occurred; `rest_ms_p50` and
`rest_ms_max`, the time from the cause to the boom's rest, for faults that must bring it
to rest; how many of these took more than 50 ms (`late`), brought no rest (`no_rest`) or
were named by another code than theirs (`misnamed`); and `moved`, swings other than 0
that were sent from 50 ms after the cause until the operator armed the drive again. A
cause is the end of 100 ms without a frame or without a marker that is needed, the third
frame of exchanged, mirrored or frozen markers, 200 ms without a plan, the end of 200 ms
after the first heartbeat without an answer, or otherwise the first frame or call that
shows the fault; for a boom that does not move it is not known, so that row has no
times, and `unfelt` counts those to which fewer than two swings were sent that are
large enough for the loop to compare: they need bring no rest. The row `all` counts stances: `seen` stances have at most single frames missing
about them; `lost` of these were not reported, and `invented` ones did not happen. Each
sent swing is judged by the true stance at its own time: `off_m` and `off_rad` are the
largest deviations from that stance of the pose (and boom angle) used for planning.
`unsafe` counts swings beyond the limit, swings with no true stance within 50 ms, swings
that were off by more than 0.1 m or 0.2 rad, and all that `moved`. `wrong_ends` counts
drives that ended, and `needless` rests that came, though no fault required it; `stuck`
faults after which the drive could not be armed for 5 s, and `armed` how often it was.
"""

from __future__ import annotations

import argparse
import logging
import multiprocessing as mp
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from loopback_server import Faults, LoopbackServer, Outage, UdpSwings

from hopdata.jobs import write_table
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.rigid import wrapped
from hopdata.steering.control.planner import Planner, planner
from hopdata.steering.control.waypoints import WayPointFollower, WayPoints
from hopdata.steering.frame_changes import frame_changes
from hopdata.steering.live.actuator import UdpBoom
from hopdata.steering.live.buffer import Status
from hopdata.steering.live.drive import Drive, drive
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import (
    LEAST_SWING_RAD,
    ControlLoop,
    Decision,
    checks_of,
    observers_of,
)
from hopdata.steering.live.machine import DriveState
from hopdata.steering.live.packets import StreamParameters
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, TrueHop
from hopdata.steering.live.stream import MarkerStream
from hopdata.steering.live.watch import WATCH_S
from hopdata.steering.models.training import trained_process
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.observe import observe_stances
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.trial import record_trial

# The cases, and the quantities counted in each.

SEED = 20261121
RATE_HZ = 100.0
NEAR_S = 0.05  # a reported stance farther from any true one is invented, s
FALL_S = (
    0.45  # from high in flight to the stance: only partly seen if frames begin in it
)
LIMITS = Limits()
CORNERS = ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5))
SQUARE = WayPoints(points_m=CORNERS * 100, arrival_m=0.2)


@dataclass(frozen=True)
class Case:
    """Faults of the stream, and their duration."""

    name: str
    seconds: float
    faults: Faults
    outages: tuple[Outage, ...] = ()
    first: bool = True  # scheduled before the other work of the machine


def cases(seconds: float) -> list[Case]:
    short = min(60.0, seconds)
    singly = Faults(dropped=0.01, hidden=0.01)
    every = np.arange(0.1, 1.0, 0.18) * short
    return [
        Case("1 % of frames dropped, 1 % of markers hidden", seconds, singly),
        Case("no faults", short, Faults()),
        Case(
            "1 % of frames dropped in bursts of 5, 5 % of markers hidden",
            short,
            Faults(dropped=0.01, burst_frames=5, hidden=0.05),
        ),
        Case("2 % of frames garbled", short, Faults(garbled=0.02)),
        Case(
            "server vanishes for 1 s",
            short,
            singly,
            tuple(Outage(t, 1.0) for t in every),
        ),
        Case(
            "stream stalls for 0.4 s",
            short,
            singly,
            tuple(Outage(t, 0.4, "stall") for t in every),
        ),
        Case(
            "garbage between packets",
            short,
            singly,
            tuple(Outage(t, 0, "garbage") for t in every),
        ),
        Case(
            "1 % of frames dropped, 1 % of markers hidden", short, singly, first=False
        ),
    ]


def recorded() -> Recording:
    """Record about two minutes of the hopper, with random swings of its boom."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    swings = rng.uniform(-1, 1, 200) * LIMITS.swing_rad
    return record_trial(SteeredHopper(), swings, seed=SEED).recording


def identified(recording: Recording, geometry: HopperGeometry) -> Planner:
    """Learn the frame change from 100 hops of the recording, and return a planner that uses it."""
    seen = observe_stances(recording, geometry)
    changes = frame_changes(seen, swing_limit_rad=LIMITS.swing_rad)
    learned = planner(trained_process(changes.used().rows(np.arange(100))))
    learned.plan(np.zeros(3), np.pi)  # compile
    return learned


def serve(case: Case, pipe: Connection) -> None:
    """Stream the hopper until told to stop; then report its true motion."""
    swings = UdpSwings()
    hopper = LiveHopper(SteeredHopper(), swings.newest, rate_hz=RATE_HZ, seed=SEED)
    server = LoopbackServer(
        hopper,
        hopper.labels,
        rate_hz=RATE_HZ,
        faults=case.faults,
        outages=case.outages,
        seed=SEED,
    )
    with server:
        pipe.send((server.port, swings.port))
        pipe.recv()
    swings.close()
    pipe.send((hopper.hops, server.counts, server.outage_spans))


def pauses(pipe: Connection) -> None:
    """Sleep and compute until told to stop; then report the duration of each turn, s."""
    block, took = np.eye(48), []
    while not pipe.poll():
        due = time.monotonic() + 0.01
        time.sleep(0.01)
        begun = time.thread_time()
        while time.thread_time() - begun < 0.0002:
            block @ block
        took.append(time.monotonic() - due)
    pipe.send(took)


def run(
    case: Case, geometry: HopperGeometry, controller: WayPointFollower
) -> dict[str, object]:
    """Drive the hopper of another process, and compare with its report."""
    (here, there), (clock, idle) = mp.Pipe(), mp.Pipe()
    fresh = mp.get_context("spawn")
    robot = fresh.Process(target=serve, args=(case, there))
    sleeper = fresh.Process(target=pauses, args=(idle,))
    schedule(first=case.first)
    robot.start()
    sleeper.start()
    clocks: list[
        float
    ] = []  # this machine's clock minus the hopper's, at each decision

    def compare_clocks(decision: Decision) -> None:
        clocks.append(time.monotonic() - decision.stance_s - decision.since_stance_s)

    def operate(loop: ControlLoop, _: object) -> None:
        """Arm the drive again as soon as the fault is gone."""
        if loop.state is DriveState.RESTING:
            loop.arm()

    try:
        port, swing_port = here.recv()
        with UdpBoom(swing_port) as boom:
            done = drive(
                geometry,
                controller,
                boom,
                port=port,
                stop=threading.Event(),
                seconds=case.seconds,
                armed=True,
                on_decision=compare_clocks,
                on_look=operate,
            )
        here.send("stop")
        clock.send("stop")
        hops, served, spans = here.recv()
        took = clock.recv()
    finally:
        for process in (robot, sleeper):
            process.join(30)
            process.kill()
    print(f"{case.name}: {served}\n{done.stream}", flush=True)
    gaps = unconnected(done.states, min(clocks))
    back = [
        gap[1] - end
        for gap in gaps
        for begin, end in spans
        if gap[0] - 1 < begin < gap[1]
    ]
    return {
        "case": case.name,
        "seconds": case.seconds,
        "scheduling": scheduling(),
        **row(done, hops, served, gaps),
        "way_points_visited": controller.visited,
        **quantiles("machine", pd.Series(took)),
        "reconnected_ms": 1e3 * max(back, default=np.nan),
    }


def schedule(*, first: bool) -> None:
    """Schedule this thread, and threads and processes it starts from now on, first or normally."""
    if hasattr(os, "sched_setscheduler"):
        policy, priority = (os.SCHED_RR, 10) if first else (os.SCHED_OTHER, 0)
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, os.sched_param(priority))


def scheduling() -> str:
    """Return how the operating system schedules this process."""
    policy = os.sched_getscheduler(0) if hasattr(os, "sched_getscheduler") else 0
    return "round robin" if policy else "shared"


def unconnected(
    states: tuple[Status, ...], clock_s: float
) -> list[tuple[float, float]]:
    """Return the spans without a connection, on the hopper's clock, s."""
    gaps, begun = [], None
    for status in states[3:]:  # after idle, connecting, streaming
        if status.state == "lost" and begun is None:
            begun = status.at_s - clock_s
        if status.state in ("streaming", "closed") and begun is not None:
            gaps.append((begun, status.at_s - clock_s))
            begun = None
    return gaps


def row(done: Drive, hops: list, served: object, gaps: list) -> dict[str, object]:
    rows = [vars(d) | {"command_rad": d.command_rad} for d in done.decisions]
    decisions = pd.DataFrame(rows)
    true, told = (
        np.array([h.stance.time_s for h in hops]),
        decisions.stance_s.to_numpy(),
    )
    # Do not count the first hop, nor a last one whose end may not have been seen.
    counted = (
        np.isfinite(true) & (true > FALL_S) & (true < served.frames / RATE_HZ - FALL_S)
    )
    away = np.zeros(len(true), dtype=bool)
    for begin, end in gaps:
        away |= (true > begin - NEAR_S) & (true < end + FALL_S)
    found = np.array([np.abs(told - t).min() < NEAR_S for t in true])
    invented = sum(np.nanmin(np.abs(true - t)) >= NEAR_S for t in told)
    sent = decisions[decisions.outcome.isin(["planned", "cut"])]
    stale = sent[
        (sent.pose_age_s > LIMITS.pose_age_s) | (sent.state_age_s > LIMITS.pose_age_s)
    ]
    return {
        "frames_made": served.frames,
        "frames_dropped": served.dropped,
        "markers_hidden": served.hidden_markers,
        "frames_read": done.stream.frames,
        "frames_late": done.stream.late,
        "packets_garbled": done.stream.garbled,
        "connections": done.stream.connections,
        "losses": done.stream.losses,
        "crashes": done.loop.failed
        + sum("failed" in one.reason.code for one in done.decisions if one.reason),
        "stances_true": int((counted & ~away).sum()),
        "stances_told": int((counted & ~away & found).sum()),
        "stances_lost": int((counted & ~away & ~found).sum()),
        "stances_invented": int(invented),
        "stances_unconnected": int((counted & away).sum()),
        "falls": int(np.isnan(true).sum()),
        **executed(sent, hops),
        "held": int((decisions.outcome == "held").sum()),
        "overtaken": int((decisions.outcome == "overtaken").sum()),
        "rests": " ".join(
            sorted(rest.cause.code.removeprefix("steering.") for rest in done.rests)
        ),
        "planned_with_stale_pose": len(stale),
        **quantiles("latency", sent.latency_s),
        **quantiles("planning", sent.planning_s),
        **quantiles("since_stance", sent.since_stance_s),
    }


def executed(sent: pd.DataFrame, hops: list) -> dict[str, int]:
    """Return how many commands were sent before a flight, and how many that flight executed."""
    starts, swings = np.array([(h.start_s, h.swing_rad) for h in hops]).T
    following = np.searchsorted(starts, sent.stance_s)
    flown = following < len(hops)
    same = np.isclose(swings[following[flown]], sent.command_rad[flown], atol=1e-12)
    return {"commands_sent": int(flown.sum()), "commands_executed": int(same.sum())}


def quantiles(name: str, seconds: pd.Series) -> dict[str, float]:
    if not len(seconds):
        return {f"{name}_{q}_ms": np.nan for q in ("p50", "p99", "max")}
    p50, p99, most = 1e3 * np.percentile(seconds, [50, 99, 100])
    return {f"{name}_p50_ms": p50, f"{name}_p99_ms": p99, f"{name}_max_ms": most}


# Hops under faults, on a simulated clock.

FAULTS_HZ, DELAY_S = 500.0, 0.003
ALLOWED_S, ANEW_S = 0.05, 1.0
AWAY_M, TURNED_RAD = 0.1, 0.2  # a plan farther from its stance is unsafe
BEFORE_S, AFTER_S = 0.5, 0.1  # span about a stance in which it must be seen

# Each kind: shortest and longest span, s, the required reaction (none, rest, or the end
# of the drive), and the codes by one of which it must be named.
KINDS = {
    "frames dropped": (1.0, 3.0, "", ()),
    "marker hidden": (0.15, 0.45, "rest", ("markers_unseen",)),
    "frames repeated": (0.15, 1.0, "rest", ("no_frame",)),
    "frames held up": (0.15, 0.6, "rest", ("no_frame",)),
    "coordinates frozen": (0.1, 1.0, "rest", ("markers_frozen",)),
    "server gone": (0.3, 2.0, "rest", ("stream_lost",)),
    "markers exchanged": (0.1, 1.0, "rest", ("markers_exchanged",)),
    "markers mirrored": (0.1, 1.0, "rest", ("markers_mirrored",)),
    "one frame absurd": (0.0, 0.0, "", ()),
    "camera clock anew": (0.0, 0.0, "", ()),
    "plan late": (0.7, 0.7, "rest", ("plan_late", "plan_came_late")),
    "controller fails": (0.7, 2.0, "rest", ("controller_failed",)),
    "boom fails": (0.7, 0.7, "rest", ("boom_failed",)),
    "answers lost": (0.3, 1.0, "rest", ("unacknowledged",)),
    "boom does not move": (4.5, 4.5, "over", ("does_not_follow",)),
    "leaves the arena": (0.05, 0.3, "over", ("left_arena",)),
    "tips over": (0.05, 0.3, "over", ("tips_over",)),
    "operator's key": (0.0, 0.0, "over", ("operators_key",)),
}
UNSEEN = {"frames repeated", "frames held up", "server gone", "markers exchanged",
          "markers mirrored", "coordinates frozen", "camera clock anew",
          "leaves the arena", "tips over"}  # fmt: skip
# The operator arms the drive this long after a fault, and tries this often.
OPERATOR_S, TRY_S, STUCK_S = 0.3, 0.2, 5.0
# Swings above this can be told from none: the loop's least one, and as much for errors of
# the boom angle.
COMPARED_RAD = 2 * LEAST_SWING_RAD


@dataclass
class Fault:
    """One fault: its span on the hopper's clock, its effect, and when the boom rested.

    `cause_s` is when it can be known. `armed_s` is when the operator armed the drive
    again, and `code` how it was named. `n_unfollowed` is the number of swings that a
    boom that does not move should have made, and that are large enough to compare.
    """

    kind: str
    begin_s: float
    end_s: float
    cause_s: float = np.nan
    rest_s: float = np.nan
    armed_s: float = np.nan
    moved: int = 0
    frames: int = 0
    refused: bool = False
    pair: tuple[int, int] = (0, 1)
    code: str = ""
    n_unfollowed: int = 0

    @property
    def is_unfelt(self) -> bool:
        """Whether a boom did not move, but was hardly told to."""
        is_dead = self.kind == "boom does not move"
        return is_dead and self.n_unfollowed < LIMITS.wrong_swings


@dataclass
class Rehearsal:
    """The hopper, the loop and the clock of a rehearsal."""

    geometry: HopperGeometry
    learned: Planner
    seed: int
    now_s: float = 0.0
    faults: list[Fault] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    told_s: list[float] = field(
        default_factory=list
    )  # reported stances, hopper's clock
    begun_s: list[float] = field(default_factory=list)  # start of each drive
    off: list[tuple[float, float]] = field(
        default_factory=list
    )  # errors of sent swings, m and rad
    unsafe: int = 0
    wrong_ends: int = 0  # drives that ended though no fault required it
    needless: int = 0  # rests that no fault required
    stuck: int = 0  # faults after which the drive could not be armed again
    armed: int = 0  # how often the operator armed it

    def __post_init__(self) -> None:
        streams = np.random.SeedSequence(self.seed).spawn(2)
        self.chance, self.pauses = (np.random.default_rng(s) for s in streams)
        self.boom = SimulatedBoom()
        self.hopper = LiveHopper(
            SteeredHopper(), self.boom.newest, rate_hz=FAULTS_HZ, seed=self.seed
        )
        self.follower = WayPointFollower(self.learned, SQUARE)
        self.names = (*self.geometry.body_names, str(self.geometry.boom_name))
        self.stream = MarkerStream(self.names, rate_hz=FAULTS_HZ, capacity=4096)
        self.stream._begin_epoch(StreamParameters(self.names, FAULTS_HZ, "+Z"))
        self.fault, self.arrivals, self.shift_s = (
            Fault("", 0.0, 2.0),
            self._arrivals(),
            0.0,
        )
        self.next, self.look_s, self.try_s = next(self.arrivals), 0.0, 0.0
        self.beat = 0
        self.begin_drive()

    def begin_drive(self) -> None:
        """Start the loop as an operator would."""
        self.begun_s.append(self.now_s)
        self.loop = ControlLoop(
            self.stream.buffer,
            observers_of(self.geometry, FAULTS_HZ),
            SimpleNamespace(plan=self._plan),
            SimpleNamespace(
                swing=self._swing, alive=self._alive, heard=lambda: self.beat
            ),
            limits=LIMITS,
            checks=checks_of(self.geometry, FAULTS_HZ, LIMITS),
            on_decision=self._told,
            fault=self._lost,
            clock=lambda: self.now_s,
        )
        self.beat = 0
        self.n_rests = 0

    def run(self, hops: int) -> None:
        """Let the hopper make `hops` hops."""
        while len(self.hopper.hops) < hops:
            pause = (
                self.pauses.exponential(0.01) if self.pauses.random() < 0.002 else 0.0
            )
            self.advance(max(self.next[0], self.now_s) + min(pause, 0.04))
            self.loop.step()
            self._note_rests()
            self._operate()
            self._next_fault()

    def _note_rests(self) -> None:
        """Note how the loop names a fault, and rests that no fault requires."""
        rests = self.loop.watch.rests
        for rest in rests[self.n_rests :]:
            fault = self.fault
            is_due = bool(fault.kind and KINDS[fault.kind][2])
            if not is_due or rest.sent_s < fault.begin_s:
                self.needless += 1
            elif not fault.code:
                fault.code = rest.cause.code.removeprefix("steering.")
        self.n_rests = len(rests)

    def _operate(self) -> None:
        """Arm the drive as an operator does, some time after a fault is over."""
        fault = self.fault
        is_over = not fault.kind or self.now_s > fault.end_s + OPERATOR_S
        is_early = self.now_s < fault.begin_s
        is_idle = self.loop.state in (DriveState.WAITING, DriveState.RESTING)
        if not is_idle or self.now_s < self.try_s or not (is_over or is_early):
            return
        self.try_s = self.now_s + TRY_S
        if self.loop.arm() is None:
            self.armed += 1
            if is_over:
                fault.armed_s = self.now_s

    def _alive(self, number: int) -> None:
        if self._active() == "answers lost":
            self._caused(self.fault, self.now_s + LIMITS.heard_s)
        else:
            self.beat = number

    def advance(self, to_s: float) -> None:
        """Let time pass: frames arrive and the watch checks."""
        while min(self.next[0], self.look_s) <= to_s:
            if self.next[0] <= self.look_s:
                arrival_s, number, time_s, markers = self.next
                self.now_s = max(self.now_s, arrival_s)
                self.stream._keep(number, time_s, self.now_s, markers)
                self.next = next(self.arrivals)
            else:
                self.now_s = max(self.now_s, self.look_s)
                self.loop.watch.look()
                late = (
                    self.pauses.exponential(0.01)
                    if self.pauses.random() < 0.02
                    else 0.0
                )
                self.look_s = self.now_s + WATCH_S + min(late, 0.02)
        self.now_s = max(self.now_s, to_s)

    def _arrivals(self) -> Iterator[tuple[float, int, float, np.ndarray]]:
        """Yield each frame's arrival time, number, camera time and markers."""
        number, shown_s, last = 0, 0.0, (0, 0.0, np.zeros((4, 3)))
        for true_s, markers in self.hopper:
            number += 1
            fault, arrival_s = self.fault, true_s + DELAY_S
            kind = fault.kind if fault.begin_s <= true_s <= fault.end_s else ""
            fault.frames += bool(kind)
            if kind == "frames dropped" and self.chance.random() < 0.1:
                continue
            if kind == "server gone":
                self._caused(fault, fault.begin_s + DELAY_S)
                continue
            if kind == "frames repeated":
                self._caused(fault, shown_s + LIMITS.pose_age_s)
                yield arrival_s, *last
                continue
            if kind == "coordinates frozen":
                self._caused(fault, arrival_s if fault.frames == 3 else np.nan)
                markers = last[2]
            if kind == "frames held up":
                self._caused(fault, shown_s + LIMITS.pose_age_s)
                arrival_s = fault.end_s + DELAY_S
            if kind:
                markers = self._shown(kind, fault, markers, arrival_s)
            last, shown_s = (number, true_s + self.shift_s, markers), arrival_s
            yield arrival_s, *last

    def _shown(
        self, kind: str, fault: Fault, markers: np.ndarray, now_s: float
    ) -> np.ndarray:
        """Return the markers as the fault shows them."""
        if kind == "marker hidden":
            markers[1] = np.nan
            self._caused(fault, now_s + LIMITS.pose_age_s)
        if kind == "one frame absurd" and fault.frames == 1:
            markers = self.chance.uniform(-5, 5, markers.shape)
        if kind == "camera clock anew" and fault.frames == 1:
            self.shift_s -= 1000.0
        if kind == "markers mirrored":
            markers = markers * np.array([-1.0, 1.0, 1.0])
            self._caused(fault, now_s if fault.frames == 3 else np.nan)
        if kind == "markers exchanged":
            order = np.arange(len(markers))
            order[list(fault.pair)] = fault.pair[::-1]
            markers = markers[order]
            self._caused(fault, now_s if fault.frames == 3 else np.nan)
        if kind == "leaves the arena":
            markers = markers + np.array([LIMITS.fence_m + 1.5, 0.0, 0.0])
            self._caused(fault, now_s)
        if kind == "tips over":
            middle, c, s = markers[:3].mean(axis=0), 0.5, np.sqrt(0.75)
            markers = middle + (markers - middle) @ np.array(
                [[1, 0, 0], [0, c, s], [0, -s, c]]
            )
            self._caused(fault, now_s)
        return markers

    def _caused(self, fault: Fault, cause_s: float) -> None:
        """Record the first cause of a fault."""
        if np.isnan(fault.cause_s):
            fault.cause_s = cause_s

    def _lost(self) -> Message | None:
        fault = self.fault
        gone = (
            fault.kind == "server gone"
            and fault.begin_s < self.now_s - DELAY_S < fault.end_s
        )
        values = {"state": "lost", "reason": "the server has hung up"}
        return Message("steering.stream_lost", values) if gone else None

    def _plan(self, pose: np.ndarray, boom: float, swung: float | None, /) -> object:
        plan, kind = self.follower.plan(pose, boom, swung), self._active()
        if kind == "controller fails":
            self._caused(self.fault, self.now_s)
            raise ValueError("no way out")
        asked_s = self.now_s
        if kind == "plan late":
            due = self.loop.watch.machine._deadlines["plan"]
            self._caused(self.fault, due.due_s)
            self.advance(asked_s + 0.3)
        self.advance(asked_s + 0.002)
        return plan

    def _active(self) -> str:
        fault = self.fault
        return fault.kind if fault.begin_s <= self.now_s <= fault.end_s else ""

    def _swing(self, rad: float) -> None:
        """Receive a swing in place of the boom, and judge it."""
        fault = self.fault
        if self._active() == "boom fails" and not fault.refused:
            fault.refused = True
            self._caused(fault, self.now_s)
            raise OSError("not connected")
        dead = self._active() == "boom does not move"
        self.boom.swing(0.0 if dead else rad)
        fault.n_unfollowed += dead and abs(rad) > COMPARED_RAD
        self.unsafe += abs(rad) > LIMITS.swing_rad
        must = KINDS[fault.kind][2] if fault.kind else ""
        if not must or self.now_s < fault.begin_s:
            return
        if rad == 0.0:
            if np.isnan(fault.rest_s):
                fault.rest_s = self.now_s
            return
        if np.isnan(fault.armed_s):  # until the operator arms it again
            fault.rest_s = np.nan
            late = self.now_s > fault.cause_s + ALLOWED_S  # False if not known
            fault.moved += bool(late)

    def _told(self, decision: Decision) -> None:
        self.decisions.append(decision)
        self.told_s.append(self.now_s - decision.since_stance_s - DELAY_S)
        if decision.outcome not in ("planned", "cut") or decision.command_rad == 0:
            return
        self.off.append(off_by(decision, self.told_s[-1], self.hopper.hops[-3:]))
        self.unsafe += bool(self.off[-1][0] > AWAY_M or self.off[-1][1] > TURNED_RAD)

    def _next_fault(self) -> None:
        """Record the outcome of a fault that is over, and draw the next."""
        fault = self.fault
        pressed = fault.kind == "operator's key" and self.now_s >= fault.begin_s
        if pressed and np.isnan(fault.cause_s):
            self._caused(fault, self.now_s)
            self.loop.end(Message("steering.operators_key"))
        if self.now_s < fault.end_s + ANEW_S:
            return
        must = KINDS[fault.kind][2] if fault.kind else ""
        if self.loop.state is DriveState.STOPPED:
            self.wrong_ends += must != "over"
            self.begin_drive()
            return
        if self.loop.state not in (DriveState.ARMED, DriveState.RUNNING):
            if self.now_s < fault.end_s + STUCK_S:
                return
            self.stuck += 1
        if fault.kind:
            self.faults.append(fault)
        kind = list(KINDS)[self.chance.integers(len(KINDS))]
        shortest, longest, _, _ = KINDS[kind]
        begin_s = self.now_s + self.chance.uniform(1.0, 4.0)
        single = 1.0 / FAULTS_HZ
        long = self.chance.uniform(shortest, longest) if longest else single
        first, second = self.chance.choice(4, size=2, replace=False)
        pair = (int(first), int(second))
        self.fault = Fault(kind, begin_s, begin_s + long, pair=pair)


def off_by(
    decision: Decision, told_s: float, hops: list[TrueHop]
) -> tuple[float, float]:
    """Return the errors of a plan's pose and angles relative to its stance, reported at `told_s`.

    They are infinite if there was no stance at that time.
    """
    hop = min(hops, key=lambda h: abs(np.nan_to_num(h.stance.time_s) - told_s))
    if not abs(hop.stance.time_s - told_s) < NEAR_S:
        return np.inf, np.inf
    x, y, turned = np.subtract(decision.pose, hop.stance.pose)
    angles = wrapped(
        np.array([turned, decision.boom_angle_rad - hop.stance.boom_angle_rad])
    )
    return float(np.hypot(x, y)), float(np.abs(angles).max())


def fault_rows(done: Rehearsal, took_s: float) -> Iterator[dict[str, object]]:
    for kind, (_, _, must, codes) in KINDS.items():
        those = [f for f in done.faults if f.kind == kind]
        felt = [f for f in those if must and not f.is_unfelt]
        caused = [f for f in those if must and not np.isnan(f.cause_s)]
        # The boom may have been told to stay for another reason just before.
        delays = [1e3 * max(0.0, f.rest_s - f.cause_s) for f in caused]
        known = [delay for delay in delays if not np.isnan(delay)]
        yield {
            "fault": kind, "must": must or "go on", "number": len(those),
            "rest_ms_p50": np.median(known) if known else np.nan,
            "rest_ms_max": max(known, default=np.nan),
            "late": sum(delay > 1e3 * ALLOWED_S for delay in known),
            "no_rest": sum(np.isnan(f.rest_s) for f in felt),
            "misnamed": sum(f.code not in codes for f in felt),
            "unfelt": sum(f.is_unfelt for f in those),
            "moved": sum(f.moved for f in those),
        }  # fmt: skip
    hops = done.hopper.hops[:-2]
    stance_s, told_s = np.array([h.stance.time_s for h in hops]), np.array(done.told_s)
    hidden = np.zeros(len(hops), dtype=bool)
    for f in [f for f in done.faults if f.kind in UNSEEN]:
        hidden |= (stance_s > f.begin_s - AFTER_S) & (stance_s < f.end_s + BEFORE_S)
    for begun_s in done.begun_s:
        hidden |= (stance_s > begun_s - AFTER_S) & (stance_s < begun_s + BEFORE_S)
    seen = np.isfinite(stance_s) & (stance_s > 1.0) & ~hidden
    lost = np.array([np.abs(told_s - s).min() > NEAR_S for s in stance_s[seen]])
    invented = sum(np.nanmin(np.abs(stance_s - s)) > NEAR_S for s in told_s[:-2])
    yield {
        "fault": "all", "number": len(done.faults), "hops": len(hops), "drives": len(done.begun_s),
        "falls": int(np.isnan(stance_s).sum()), "seen": int(seen.sum()), "lost": int(lost.sum()),
        "invented": int(invented), "sent": len(done.off),
        **dict(zip(("off_m", "off_rad"), np.max(done.off, axis=0, initial=0.0), strict=True)),
        "unsafe": done.unsafe + sum(f.moved for f in done.faults),
        "wrong_ends": done.wrong_ends, "needless": done.needless, "stuck": done.stuck,
        "armed": done.armed,
        "times_real_time": done.now_s / took_s,
    }  # fmt: skip


def live_faults(
    geometry: HopperGeometry, learned: Planner, given: argparse.Namespace
) -> None:
    """Write the table of faults after every 250 hops."""
    logging.disable(logging.WARNING)  # the watch logs each rest
    done = Rehearsal(geometry, learned, given.seed)
    begun = time.monotonic()
    for hops in (*range(250, given.hops, 250), given.hops):
        done.run(hops)
        table = pd.DataFrame(fault_rows(done, time.monotonic() - begun))
        write_table(given.out.with_name("live_faults.csv"), table)
        print(table.to_string(), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--only", type=int, help="run only this case, from 0")
    parser.add_argument(
        "--faults", action="store_true", help="write only live_faults.csv"
    )
    parser.add_argument("--hops", type=int, default=10_000, help="hops under faults")
    parser.add_argument("--seed", type=int, default=20261125, help="seed of the faults")
    arguments = parser.parse_args()
    begun, recording = time.monotonic(), recorded()
    geometry = calibrate(recording)
    learned = identified(recording, geometry)
    if not arguments.faults:
        chosen = cases(arguments.seconds)
        chosen = chosen if arguments.only is None else [chosen[arguments.only]]
        rows = [
            run(case, geometry, WayPointFollower(learned, SQUARE)) for case in chosen
        ]
        write_table(arguments.out, pd.DataFrame(rows))
        print(pd.DataFrame(rows).T.to_string(), f"\n{time.monotonic() - begun:.0f} s")
    if arguments.only is None:
        live_faults(geometry, learned, arguments)


if __name__ == "__main__":
    main()
