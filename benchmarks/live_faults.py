"""Ten thousand hops under faults, on a clock of its own, and whether the boom rests in time.

    python benchmarks/live_faults.py --out live_faults.csv [--hops 10000]

The loop that drives a robot (`hopdata.steering.live`), its watch, the stream's judgement of frames
and the simulated hopper at 500 Hz, without threads: time is a number that goes on by itself, so
that a night passes in minutes and each seed gives the same. Of a busy machine there are pauses of
the loop (40 ms at most) and of the watch (20 ms). One fault after the other
befalls what the loop sees, plans or sends. This program, which knows when it did and where the
hopper is, notes each swing that reaches the boom. Nothing of what it notes is told to the loop.

One row a kind of fault: how often it occurred; `rest_ms_p50`, `rest_ms_max`: from the cause to the
boom's rest, for those that must bring it to rest (a cause is the end of the 100 ms without a frame,
the third frame of exchanged markers, 200 ms without a plan, else the first frame that shows it);
`moved`: swings other than 0 that were sent while the cause lasted, from 50 ms on. The row `all`
counts stances: `seen` are those about which at most single frames are missing, `lost` of them were
not told, `invented` ones were not made. Each swing that was sent is judged by the true stance at
the time of its own: `off_m`, `off_rad` are how far pose (and boom angle) that it was planned with
were from that stance at most. `unsafe` are swings beyond the limit, those with no true stance
within 50 ms, those that were off by more than 0.1 m or 0.2 rad, and all that `moved`.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from live_loop import LIMITS, SQUARE, WayPointFollower, identified, recorded

from hopdata.jobs import write_table
from hopdata.rigid import wrapped
from hopdata.steering.control.planner import Planner
from hopdata.steering.live.loop import ControlLoop, Decision
from hopdata.steering.live.packets import StreamParameters
from hopdata.steering.live.safety import LOOK_S
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, TrueHop
from hopdata.steering.live.stream import MarkerStream
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import StanceDetector
from hopdata.steering.observation.tracking import HopperTracker
from hopdata.steering.robot import SteeredHopper

RATE_HZ, DELAY_S = 500.0, 0.003
ALLOWED_S, NEAR_S, ANEW_S = 0.05, 0.05, 1.0
AWAY_M, TURNED_RAD = 0.1, 0.2  # farther from its stance a plan is unsafe
BEFORE_S, AFTER_S = 0.5, 0.1  # of a stance, in which it must be seen

# Each kind: shortest and longest span, s; what must follow: nothing, rest, or the end of the drive.
KINDS = {
    "frames dropped": (1.0, 3.0, ""),
    "marker hidden": (0.1, 0.45, ""),
    "frames repeated": (0.15, 1.0, "rest"),
    "frames held up": (0.15, 0.6, "rest"),
    "server gone": (0.3, 2.0, "rest"),
    "markers exchanged": (0.1, 1.0, "rest"),
    "one frame absurd": (0.0, 0.0, ""),
    "camera clock anew": (0.0, 0.0, ""),
    "plan late": (0.7, 0.7, "rest"),
    "controller fails": (0.7, 2.0, ""),
    "boom fails": (0.7, 0.7, ""),
    "leaves the arena": (0.05, 0.3, "over"),
    "tips over": (0.05, 0.3, "over"),
    "operator's key": (0.0, 0.0, "over"),
}
UNSEEN = {"frames repeated", "frames held up", "server gone", "markers exchanged",
          "camera clock anew", "leaves the arena", "tips over"}  # fmt: skip


@dataclass
class Fault:
    """One fault, from when to when on the hopper's clock; what it did, and when the boom rested."""

    kind: str
    begin_s: float
    end_s: float
    cause_s: float = np.nan
    rest_s: float = np.nan
    moved: int = 0
    frames: int = 0
    refused: bool = False


@dataclass
class Rehearsal:
    """The hopper, the loop and the clock."""

    geometry: HopperGeometry
    learned: Planner
    seed: int
    now_s: float = 0.0
    faults: list[Fault] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    told_s: list[float] = field(default_factory=list)  # instants of stances, hopper's clock
    begun_s: list[float] = field(default_factory=list)  # of each drive
    off: list[tuple[float, float]] = field(default_factory=list)  # of swings sent, m and rad
    unsafe: int = 0

    def __post_init__(self) -> None:
        streams = np.random.SeedSequence(self.seed).spawn(2)
        self.chance, self.pauses = (np.random.default_rng(s) for s in streams)
        self.boom = SimulatedBoom()
        self.hopper = LiveHopper(SteeredHopper(), self.boom.newest, rate_hz=RATE_HZ, seed=self.seed)
        self.follower = WayPointFollower(self.learned, SQUARE)
        self.names = (*self.geometry.body_names, str(self.geometry.boom_name))
        self.stream = MarkerStream(self.names, rate_hz=RATE_HZ, capacity=4096)
        self.stream._begin_epoch(StreamParameters(self.names, RATE_HZ, "+Z"))
        self.fault, self.arrivals, self.shift_s = Fault("", 0.0, 2.0), self._arrivals(), 0.0
        self.next, self.look_s = next(self.arrivals), 0.0
        self.begin_drive()

    def begin_drive(self) -> None:
        """Start the loop, as an operator would."""
        self.begun_s.append(self.now_s)
        self.loop = ControlLoop(
            self.stream.buffer,
            lambda: (
                HopperTracker(self.geometry, self.names),
                StanceDetector.of(self.geometry, rate_hz=RATE_HZ),
            ),
            SimpleNamespace(plan=self._plan),
            SimpleNamespace(swing=self._swing),
            on_decision=self._told,
            fault=self._lost,
            clock=lambda: self.now_s,
        )
        self.taken = self.stream.buffer.written

    def run(self, hops: int) -> None:
        """Let the hopper make so many hops."""
        while len(self.hopper.hops) < hops:
            pause = self.pauses.exponential(0.01) if self.pauses.random() < 0.002 else 0.0
            self.advance(max(self.next[0], self.now_s) + min(pause, 0.04))
            frames = self.stream.buffer.since(self.taken)
            if frames:
                self.taken = frames[-1].index + 1
                self.loop.take(frames)
            self._next_fault()

    def advance(self, to_s: float) -> None:
        """Let time pass: frames arrive, and the watch looks."""
        while min(self.next[0], self.look_s) <= to_s:
            if self.next[0] <= self.look_s:
                arrival_s, number, time_s, markers = self.next
                self.now_s = max(self.now_s, arrival_s)
                self.stream._keep(number, time_s, self.now_s, markers)
                self.next = next(self.arrivals)
            else:
                self.now_s = max(self.now_s, self.look_s)
                self.loop.watch.look()
                late = self.pauses.exponential(0.01) if self.pauses.random() < 0.02 else 0.0
                self.look_s = self.now_s + LOOK_S + min(late, 0.02)
        self.now_s = max(self.now_s, to_s)

    def _arrivals(self) -> Iterator[tuple[float, int, float, np.ndarray]]:
        """Yield when each frame arrives, its number, its camera time and its markers."""
        number, last = 0, np.zeros((4, 3))
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
                self._caused(fault, fault.begin_s + DELAY_S + LIMITS.pose_age_s)
                yield arrival_s, *last
                continue
            if kind == "frames held up":
                self._caused(fault, fault.begin_s + DELAY_S + LIMITS.pose_age_s)
                arrival_s = fault.end_s + DELAY_S
            if kind:
                markers = self._shown(kind, fault, markers, arrival_s)
            last = (number, true_s + self.shift_s, markers)
            yield arrival_s, *last

    def _shown(self, kind: str, fault: Fault, markers: np.ndarray, now_s: float) -> np.ndarray:
        """Return the markers as a fault shows them."""
        if kind == "marker hidden":
            markers[1] = np.nan
        if kind == "one frame absurd" and fault.frames == 1:
            markers = self.chance.uniform(-5, 5, markers.shape)
        if kind == "camera clock anew" and fault.frames == 1:
            self.shift_s -= 1000.0
        if kind == "markers exchanged":
            markers = markers[[1, 3, 2, 0]]
            self._caused(fault, now_s if fault.frames == 3 else np.nan)
        if kind == "leaves the arena":
            markers = markers + np.array([LIMITS.fence_m + 1.5, 0.0, 0.0])
            self._caused(fault, now_s)
        if kind == "tips over":
            middle, c, s = markers[:3].mean(axis=0), 0.5, np.sqrt(0.75)
            markers = middle + (markers - middle) @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
            self._caused(fault, now_s)
        return markers

    def _caused(self, fault: Fault, cause_s: float) -> None:
        """Note the first cause; a boom that rests already needs no telling."""
        if np.isnan(fault.cause_s):
            fault.cause_s = cause_s

    def _lost(self) -> str:
        fault = self.fault
        gone = fault.kind == "server gone" and fault.begin_s < self.now_s - DELAY_S < fault.end_s
        return "the stream is lost: the server has hung up" if gone else ""

    def _plan(self, pose: np.ndarray, boom: float, swung: float | None, /) -> object:
        plan, kind = self.follower.plan(pose, boom, swung), self._active()
        if kind == "controller fails":
            raise ValueError("no way out")
        asked_s = self.now_s
        if kind == "plan late":
            self._caused(self.fault, self.loop._due_s)
            self.advance(asked_s + 0.3)
        self.advance(asked_s + 0.002)
        return plan

    def _active(self) -> str:
        fault = self.fault
        return fault.kind if fault.begin_s <= self.now_s <= fault.end_s else ""

    def _swing(self, rad: float) -> None:
        """Take a swing as the boom, and judge it."""
        fault = self.fault
        if self._active() == "boom fails" and not fault.refused:
            fault.refused = True
            raise OSError("not connected")
        self.boom.swing(rad)
        must, caused = KINDS.get(fault.kind, (0, 0, ""))[2], not np.isnan(fault.cause_s)
        if must and caused and self.now_s >= fault.cause_s - 1e-9:
            if rad == 0.0 and np.isnan(fault.rest_s):
                fault.rest_s = self.now_s
            # A frame shown in time to rest; that of the end has still to arrive.
            lasting = must == "over" or self.now_s <= fault.end_s
            fault.moved += rad != 0.0 and lasting and self.now_s > fault.cause_s + ALLOWED_S
        self.unsafe += abs(rad) > LIMITS.swing_rad

    def _told(self, decision: Decision) -> None:
        self.decisions.append(decision)
        self.told_s.append(self.now_s - decision.since_stance_s - DELAY_S)
        if decision.outcome not in ("planned", "cut") or decision.command_rad == 0:
            return
        self.off.append(off_by(decision, self.told_s[-1], self.hopper.hops[-3:]))
        self.unsafe += bool(self.off[-1][0] > AWAY_M or self.off[-1][1] > TURNED_RAD)

    def _next_fault(self) -> None:
        """Note what became of a fault that is over, and draw the next."""
        fault = self.fault
        pressed = fault.kind == "operator's key" and self.now_s >= fault.begin_s
        if pressed and np.isnan(fault.cause_s):
            self._caused(fault, self.now_s)
            self.loop.rest("the operator's key")
        if self.now_s < fault.end_s + ANEW_S:
            return
        if fault.kind:
            self.faults.append(fault)
        if self.loop._over:
            self.begin_drive()
        kind = list(KINDS)[self.chance.integers(len(KINDS))]
        shortest, longest, _ = KINDS[kind]
        begin_s = self.now_s + self.chance.uniform(1.0, 4.0)
        single = 1.0 / RATE_HZ
        long = self.chance.uniform(shortest, longest) if longest else single
        self.fault = Fault(kind, begin_s, begin_s + long)


def off_by(decision: Decision, told_s: float, hops: list[TrueHop]) -> tuple[float, float]:
    """Return how far a plan's pose and angles are from those of its stance, told at so many s.

    Infinite if there was no stance then.
    """
    hop = min(hops, key=lambda h: abs(np.nan_to_num(h.stance_s) - told_s))
    if not abs(hop.stance_s - told_s) < NEAR_S:
        return np.inf, np.inf
    x, y, turned = np.subtract(decision.pose, hop.pose)
    angles = wrapped(np.array([turned, decision.boom_angle_rad - hop.boom_angle_rad]))
    return float(np.hypot(x, y)), float(np.abs(angles).max())


def rows(done: Rehearsal, took_s: float) -> Iterator[dict[str, object]]:
    for kind, (_, _, must) in KINDS.items():
        those = [f for f in done.faults if f.kind == kind]
        caused = [f for f in those if must and not np.isnan(f.cause_s)]
        # Where the boom rests already no command is sent, and none is needed.
        delays = [1e3 * (f.rest_s - f.cause_s) for f in caused if not np.isnan(f.rest_s)]
        yield {
            "fault": kind, "must": must or "go on", "number": len(those),
            "rest_ms_p50": np.median(delays) if delays else np.nan,
            "rest_ms_max": max(delays, default=np.nan),
            "moved": sum(f.moved for f in those),
        }  # fmt: skip
    hops = done.hopper.hops[:-2]
    stance_s, told_s = np.array([h.stance_s for h in hops]), np.array(done.told_s)
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
        "invented": int(invented), "sent": sum(d.command_rad != 0 for d in done.decisions),
        **dict(zip(("off_m", "off_rad"), np.max(done.off, axis=0, initial=0.0), strict=True)),
        "unsafe": done.unsafe + sum(f.moved for f in done.faults),
        "times_real_time": done.now_s / took_s,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--hops", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=20261125)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)  # the watch says each rest
    recording = recorded()
    geometry = calibrate(recording)
    done = Rehearsal(geometry, identified(recording, geometry), arguments.seed)
    begun = time.monotonic()
    for hops in (*range(1000, arguments.hops, 1000), arguments.hops):
        done.run(hops)
        table = pd.DataFrame(rows(done, time.monotonic() - begun))
        write_table(arguments.out, table)
        print(table.to_string(), flush=True)


if __name__ == "__main__":
    main()
