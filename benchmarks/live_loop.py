"""The loop of Fig. 3.4 over loopback, in real time: stances, commands and how long they take.

    python benchmarks/live_loop.py --out live_loop.csv [--seconds 600]

A process of its own simulates the hopper and streams its markers by Qualisys' real-time protocol at
100 Hz, with faults; this process reads the stream with the unmodified client, tells stances, plans
and sends each swing back. The planner has learned the hopper's frame changes from 100 hops of a
recording, and goes round a square. The first case lasts `--seconds`, the others at most 60 s each.
All processes are scheduled before the other work of the machine (`scheduling` "round robin", as by
`chrt --rr 10`) where the system allows it, but in the last case.

One row a case. Stances: `stances_true` that the simulated hopper made while there was a
connection, of these `stances_told` within 50 ms of their true time, `stances_lost`, and
`stances_invented` that were told but not made. `stances_unconnected` were made with no connection,
or so soon after it was back that the fall before was not seen, and count for nothing else.
`reconnected_ms`: longest time from the return of the server to the next frame. `crashes`: frames
and decisions that raised an exception (had a thread ended, all later stances would be lost).
`latency_*`: from the arrival of the frame that established the stance to the command that was
sent; `since_stance_*`: from the stance itself, on the hopper's own clock. `commands_executed`:
sent swings that the hopper executed in the next flight. `planned_with_stale_pose` is to be 0.
`machine_*`: how long a process of its own, which does nothing but sleep for 10 ms and then compute
for 0.2 ms, takes from when it was to wake up: what the machine and its other work alone cost.
Times in ms.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pandas as pd
from loopback_server import Faults, LoopbackServer, Outage, UdpSwings
from numpy.typing import ArrayLike

from hopdata.jobs import write_table
from hopdata.recording import Recording
from hopdata.steering.control.objectives import Plan, ToPoint, checked_state, errors_left
from hopdata.steering.control.planner import Planner, planner
from hopdata.steering.frame_changes import frame_changes
from hopdata.steering.live.buffer import Status
from hopdata.steering.live.drive import Drive, drive
from hopdata.steering.live.loop import Decision
from hopdata.steering.live.safety import Limits, UdpBoom
from hopdata.steering.live.simulated import LiveHopper
from hopdata.steering.models.process import trained_process
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.observe import observe_stances
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.trial import record_trial

# Way-points: one point after the other.


@dataclass(frozen=True, kw_only=True)
class WayPoints:
    """Visit points of the floor one after the other, and stay at the last.

    Parameters
    ----------
    points_m : tuple of (x, y)
        Points in the world frame, m.
    arrival_m : float
        Distance at which a point counts as visited, m.
    """

    points_m: tuple[tuple[float, float], ...]
    arrival_m: float = 0.15

    def legs(self) -> tuple[ToPoint, ...]:
        """Return the objectives of the single points, in order."""
        return tuple(ToPoint(point_m=point) for point in self.points_m)


class WayPointFollower:
    """Steers to the first of the way-points that has not been visited, and stays at the last.

    It remembers which have been visited, so each run needs one of its own.

    Parameters
    ----------
    controller : Planner
    way_points : WayPoints
    """

    def __init__(self, controller: Planner, way_points: WayPoints) -> None:
        self._legs = way_points.legs()
        self._controllers = [controller.towards(leg) for leg in self._legs]
        self._arrival_m = way_points.arrival_m
        self.visited = 0

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan towards the present way-point; one that is within reach counts as visited."""
        here, boom = checked_state(pose, boom_angle_rad)
        while self.visited < len(self._legs) and self._arrived(here):
            self.visited += 1
        leg = min(self.visited, len(self._legs) - 1)
        return self._controllers[leg].plan(here, boom, previous_swing_rad)

    def _arrived(self, pose: ArrayLike) -> bool:
        return bool(np.all(errors_left(self._legs[self.visited], pose) <= self._arrival_m))


# The cases, and what is counted in each.

SEED = 20261121
RATE_HZ = 100.0
NEAR_S = 0.05  # a stance told farther from a true one than this is invented
FALL_S = 0.45  # from high in flight to the stance: seen in part if frames begin in it
LIMITS = Limits()
CORNERS = ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5))
SQUARE = WayPoints(points_m=CORNERS * 100, arrival_m=0.2)


@dataclass(frozen=True)
class Case:
    """What befalls the stream, and for how long."""

    name: str
    seconds: float
    faults: Faults
    outages: tuple[Outage, ...] = ()
    first: bool = True  # before the other work of the machine


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
        Case("server vanishes for 1 s", short, singly, tuple(Outage(t, 1.0) for t in every)),
        Case(
            "stream stalls for 0.4 s", short, singly, tuple(Outage(t, 0.4, "stall") for t in every)
        ),
        Case(
            "garbage between packets", short, singly, tuple(Outage(t, 0, "garbage") for t in every)
        ),
        Case("1 % of frames dropped, 1 % of markers hidden", short, singly, first=False),
    ]


def recorded() -> Recording:
    """Record some two minutes of the hopper, with random swings of its boom."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    swings = rng.uniform(-1, 1, 200) * LIMITS.swing_rad
    return record_trial(SteeredHopper(), swings, seed=SEED).recording


def identified(recording: Recording, geometry: HopperGeometry) -> Planner:
    """Learn the frame change from 100 hops of the recording, and return a planner that uses it."""
    seen = observe_stances(recording, geometry)
    changes = frame_changes(
        seen.time_s,
        seen.pose,
        seen.boom_angle_rad,
        seen.pairs,
        swing_limit_rad=LIMITS.swing_rad,
    )
    learned = planner(trained_process(changes.used().rows(np.arange(100))))
    learned.plan(np.zeros(3), np.pi)  # compiles
    return learned


def serve(case: Case, pipe: Connection) -> None:
    """Stream the hopper until told to stop; then report what it truly did."""
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
    """Sleep and compute until told to stop; then report how long each time took, s."""
    block, took = np.eye(48), []
    while not pipe.poll():
        due = time.monotonic() + 0.01
        time.sleep(0.01)
        begun = time.thread_time()
        while time.thread_time() - begun < 0.0002:
            block @ block
        took.append(time.monotonic() - due)
    pipe.send(took)


def run(case: Case, geometry: HopperGeometry, controller: WayPointFollower) -> dict[str, object]:
    """Drive the hopper of another process, and compare with what it says."""
    (here, there), (clock, idle) = mp.Pipe(), mp.Pipe()
    fresh = mp.get_context("spawn")
    robot = fresh.Process(target=serve, args=(case, there))
    sleeper = fresh.Process(target=pauses, args=(idle,))
    schedule(first=case.first)
    robot.start()
    sleeper.start()
    clocks: list[float] = []  # this machine's clock less that of the hopper, at each decision

    def compare_clocks(decision: Decision) -> None:
        clocks.append(time.monotonic() - decision.stance_s - decision.since_stance_s)

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
                on_decision=compare_clocks,
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
    back = [gap[1] - end for gap in gaps for begin, end in spans if gap[0] - 1 < begin < gap[1]]
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
    """Put this thread, and those and processes that it starts from here on, first or not."""
    if hasattr(os, "sched_setscheduler"):
        policy, priority = (os.SCHED_RR, 10) if first else (os.SCHED_OTHER, 0)
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, os.sched_param(priority))


def scheduling() -> str:
    """How the operating system schedules this process."""
    policy = os.sched_getscheduler(0) if hasattr(os, "sched_getscheduler") else 0
    return "round robin" if policy else "shared"


def unconnected(states: tuple[Status, ...], clock_s: float) -> list[tuple[float, float]]:
    """Return when there was no connection, on the hopper's clock, s."""
    gaps, begun = [], None
    for status in states[3:]:  # after idle, connecting, streaming
        if status.state == "lost" and begun is None:
            begun = status.at_s - clock_s
        if status.state in ("streaming", "closed") and begun is not None:
            gaps.append((begun, status.at_s - clock_s))
            begun = None
    return gaps


def row(done: Drive, hops: list, served: object, gaps: list) -> dict[str, object]:
    decisions = pd.DataFrame([vars(d) for d in done.decisions])
    true, told = np.array([h.stance_s for h in hops]), decisions.stance_s.to_numpy()
    # The first hop, and a last one of which the end was perhaps not seen, do not count.
    counted = np.isfinite(true) & (true > FALL_S) & (true < served.frames / RATE_HZ - FALL_S)
    away = np.zeros(len(true), dtype=bool)
    for begin, end in gaps:
        away |= (true > begin - NEAR_S) & (true < end + FALL_S)
    found = np.array([np.abs(told - t).min() < NEAR_S for t in true])
    invented = sum(np.nanmin(np.abs(true - t)) >= NEAR_S for t in told)
    sent = decisions[decisions.outcome.isin(["planned", "cut"])]
    stale = sent[(sent.pose_age_s > LIMITS.pose_age_s) | (sent.boom_age_s > LIMITS.pose_age_s)]
    return {
        "frames_made": served.frames,
        "frames_dropped": served.dropped,
        "markers_hidden": served.hidden_markers,
        "frames_read": done.stream.frames,
        "frames_late": done.stream.late,
        "packets_garbled": done.stream.garbled,
        "connections": done.stream.connections,
        "losses": done.stream.losses,
        "crashes": done.loop.failed + int(decisions.reason.str.contains("failed").sum()),
        "stances_true": int((counted & ~away).sum()),
        "stances_told": int((counted & ~away & found).sum()),
        "stances_lost": int((counted & ~away & ~found).sum()),
        "stances_invented": int(invented),
        "stances_unconnected": int((counted & away).sum()),
        "falls": int(np.isnan(true).sum()),
        **executed(sent, hops),
        "held": int((decisions.outcome == "held").sum()),
        "overtaken": int((decisions.outcome == "overtaken").sum()),
        "planned_with_stale_pose": len(stale),
        **quantiles("latency", sent.latency_s),
        **quantiles("planning", sent.planning_s),
        **quantiles("since_stance", sent.since_stance_s),
    }


def executed(sent: pd.DataFrame, hops: list) -> dict[str, int]:
    """Return how many commands are the swing of the flight that began next, if any did."""
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


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--only", type=int, help="number of a case, from 0")
    arguments = parser.parse_args()
    begun, recording = time.monotonic(), recorded()
    geometry = calibrate(recording)
    learned = identified(recording, geometry)
    chosen = cases(arguments.seconds)
    chosen = chosen if arguments.only is None else [chosen[arguments.only]]
    rows = [run(case, geometry, WayPointFollower(learned, SQUARE)) for case in chosen]
    write_table(arguments.out, pd.DataFrame(rows))
    print(pd.DataFrame(rows).T.to_string(), f"\n{time.monotonic() - begun:.0f} s")


if __name__ == "__main__":
    main()
