"""What was decided at each stance, and why; and the table of it."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hopdata.jobs import guarded, whole_file
from hopdata.steering.live.counts import LoopCounts, StreamCounts
from hopdata.steering.live.states import Status

Outcome = Literal["planned", "cut", "held", "overtaken"]


@dataclass(frozen=True)
class Decision:
    """One stance, and the command that followed.

    Parameters
    ----------
    stance_s : float
        Instant of the stance, camera time, s.
    told_s : float
        Camera time of the frame that established it, s.
    epoch : int
        Which camera clock that is; see `hopdata.steering.live.buffer.Frame`.
    pose : (x_m, y_m, heading_rad)
        Newest pose; NaN if there was none.
    boom_angle_rad : float
        Newest boom angle.
    pose_age_s, boom_age_s : float
        How old they were at planning, s.
    outcome : str
        "planned": the command is the controller's. "cut": it is, but cut to the limit. "held": the
        boom was told to stay, for `reason`. "overtaken": nothing was sent, since another stance
        had been seen in the meantime.
    command_rad : float
        Swing that was sent, rad; NaN if none.
    planning_s : float
        Time that the controller took, s; NaN if it was not asked.
    latency_s : float
        From the arrival of the frame that established the stance to the command, s.
    since_stance_s : float
        From the stance itself to the command, s.
    reason : str
        Why it was not simply planned and sent.
    """

    stance_s: float
    told_s: float
    epoch: int
    pose: tuple[float, float, float]
    boom_angle_rad: float
    pose_age_s: float
    boom_age_s: float
    outcome: Outcome
    command_rad: float
    planning_s: float
    latency_s: float
    since_stance_s: float
    reason: str


DECISION_COLUMNS = (
    "stance_s",
    "told_s",
    "epoch",
    "x_m",
    "y_m",
    "heading_rad",
    "boom_angle_rad",
    "pose_age_s",
    "boom_age_s",
    "outcome",
    "command_rad",
    "planning_s",
    "latency_s",
    "since_stance_s",
    "reason",
)


def write_decisions(path: str | Path, decisions: Iterable[Decision]) -> None:
    """Write the log of a run as CSV, one row a stance; columns as in `Decision`."""
    rows = []
    for decision in decisions:
        values = dict(vars(decision))
        values |= zip(("x_m", "y_m", "heading_rad"), values.pop("pose"), strict=True)
        rows.append([values[column] for column in DECISION_COLUMNS])
    _write(path, DECISION_COLUMNS, rows)


def write_states(path: str | Path, states: Iterable[Status]) -> None:
    """Write the states of a stream as CSV, one row a change; times on the monotonic clock."""
    _write(path, ("at_s", "state", "message"), [[s.at_s, s.state, s.message] for s in states])


def write_counts(path: str | Path, stream: StreamCounts, loop: LoopCounts) -> None:
    """Write what was counted as CSV, one row a count: whose it is, its name and its value."""
    parts = {"stream": stream, "loop": loop}
    rows = [[part, *item] for part, counts in parts.items() for item in vars(counts).items()]
    _write(path, ("part", "count", "value"), rows)


def _write(path: str | Path, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(map(guarded, row) for row in rows)
