"""A stress case: the call of the integrator, the right answer, and the deviation from it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from hopdata.hybrid import Solution, System, solve

EPS = 2.0**-52
PATIENCE = 200_000  # steps and events after which a case counts as hanging


@dataclass(frozen=True)
class Expected:
    """A right answer: events as (time, guard, direction), final state, and tolerances.

    `state_tolerance` may have one number per component, for states with several units.
    Both tolerances are multiplied by `back` if the case is integrated from its end to
    its start.
    """

    events: tuple[tuple[float, int, int], ...]
    y_end: Any
    time_tolerance: float
    state_tolerance: Any
    status: int = 0
    mode: tuple[int, ...] | None = None  # None: not checked
    back: float = 1.0


@dataclass(frozen=True)
class Case:
    """A call of `solve` and its right answers (several if rounding decides)."""

    name: str
    parameter: str
    system: System
    t_span: tuple[float, float]
    y0: Any
    answers: tuple[Expected, ...]
    options: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.name}-{self.parameter}"


@dataclass(frozen=True)
class Verdict:
    """Comparison of a solution with the nearest right answer."""

    expected: int
    missed: int
    spurious: int
    error: float  # of the final state, in units of its tolerance
    error_max: float  # in the case's own units
    status: int
    right_status: bool
    right_mode: bool
    time_us: float = np.nan

    @property
    def right(self) -> bool:
        """Whether nothing is wrong."""
        counts = self.missed == 0 and self.spurious == 0
        return counts and self.right_status and self.right_mode and self.error <= 1.0


def matched(found: list[float], wanted: list[float], tolerance: float) -> int:
    """Count the pairs of found and wanted times, in order, that agree within the tolerance."""
    pairs, j = 0, 0
    for instant in sorted(wanted):
        while j < len(found) and found[j] < instant - tolerance:
            j += 1
        if j < len(found) and found[j] <= instant + tolerance:
            pairs, j = pairs + 1, j + 1
    return pairs


def compare(solution: Solution, answer: Expected) -> Verdict:
    """Count missed and spurious events by guard and direction."""
    log, kinds = solution.events, {event[1:] for event in answer.events}
    kinds |= set(zip(log.guard.tolist(), log.direction.tolist(), strict=True))
    pairs = 0
    for guard, direction in kinds:
        found = log.time[(log.guard == guard) & (log.direction == direction)].tolist()
        wanted = [t for t, g, d in answer.events if (g, d) == (guard, direction)]
        pairs += matched(sorted(found), wanted, answer.time_tolerance)
    off = np.abs(solution.y_end - np.asarray(answer.y_end, dtype=np.float64))
    allowed = np.maximum(answer.state_tolerance, 1e-300)
    return Verdict(
        expected=len(answer.events), missed=len(answer.events) - pairs,
        spurious=len(log) - pairs, error=float((off / allowed).max()), error_max=float(off.max()),
        status=solution.status, right_status=solution.status == answer.status,
        right_mode=answer.mode is None or solution.mode.tolist() == list(answer.mode),
    )  # fmt: skip


def judge(case: Case) -> Verdict:
    """Solve a case and compare it with its nearest right answer."""
    start = time.perf_counter()
    options = {"max_steps": PATIENCE, "max_events": PATIENCE, **case.options}
    solution = solve(case.system, case.t_span, case.y0, **options)
    elapsed = 1e6 * (time.perf_counter() - start)
    verdicts = [compare(solution, answer) for answer in case.answers]
    best = min(verdicts, key=lambda v: (not v.right, v.missed + v.spurious, v.error))
    return Verdict(**{**best.__dict__, "time_us": elapsed})


def check(case: Case) -> None:
    """Assert that a case ends in one of its right answers."""
    verdict = judge(case)
    assert verdict.right, f"{case}: {verdict}"


def params_of(cases: list[Case]) -> list[Any]:
    """Return the cases as parameters of a test."""
    import pytest  # the benchmark of these cases runs without it

    return [pytest.param(case, id=str(case)) for case in cases]


@cache
def undone(system: System) -> System:
    """Return a system whose handler undoes itself; each call returns the same cached one."""
    return replace(system, undo=system.on_event)


def turned_back(case: Case) -> Case:
    """Return the case from its (only) right end back to its start, whose state is then the answer.

    The effect of its handler must not matter.
    """
    (answer,) = case.answers
    events = tuple(
        (t, guard, -direction) for t, guard, direction in reversed(answer.events)
    )
    expected = replace(
        answer, events=events, y_end=case.y0, mode=None,
        time_tolerance=answer.back * answer.time_tolerance,
        state_tolerance=answer.back * np.asarray(answer.state_tolerance),
    )  # fmt: skip
    return replace(
        case,
        system=undone(case.system),
        t_span=case.t_span[::-1],
        y0=answer.y_end,
        answers=(expected,),
    )
