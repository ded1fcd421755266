"""Right answers for piecewise constant fields: exact rational arithmetic, and its sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from stress_case import EPS, Expected

ROUNDINGS = 16  # in units of EPS: what the arithmetic of one event may cost
FAR = 1e300  # an offset of a plane that is out of play


@dataclass(frozen=True)
class Run:
    """Events (time, guard, direction), the states there, final state, locks at start and end."""

    events: list[tuple[float, int, int]]
    points: list[list[float]]
    y_end: list[float]
    start: list[int]
    end: list[int]


@dataclass(frozen=True)
class Piecewise:
    """A `selected` system in floats: offsets (K,), normals (K, n), constants (2^K, n), matrices."""

    offsets: np.ndarray
    normals: np.ndarray
    constants: np.ndarray
    matrices: np.ndarray | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of states and guards."""
        return self.normals.shape[1], self.normals.shape[0]


def mode_row(locks: list[int]) -> int:
    """Return the row of the mode's field."""
    return sum(1 << k for k, lock in enumerate(locks) if lock > 0)


def rational(array: np.ndarray) -> list[Any]:
    """Return nested lists of the exact values of floats."""
    if array.ndim == 0:
        return Fraction(float(array))  # type: ignore[return-value]
    return [rational(part) for part in array]


def dot(a: list[Any], b: list[Any]) -> Any:
    """Return the scalar product."""
    return sum((x * y for x, y in zip(a, b, strict=True)), start=0 * a[0])


def along(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return scalar products along the last axis, by sums in a fixed order."""
    return np.asarray((a * b).sum(axis=-1))


def locks_of(values: list[Any], rates: list[Any]) -> list[int]:
    """Return the locks at the start: the sign of h, or on the surface that of its rate."""
    return [
        1 if h > 0 or (h == 0 and d > 0) else -1
        for h, d in zip(values, rates, strict=True)
    ]


def constant_events(system: Piecewise, y0: list[float], t0: float, t_end: float) -> Run:
    """Propagate piecewise constant fields exactly.

    Guards that are crossed at exactly the same instant flip together, as in `solve`.
    """
    offsets, normals = rational(system.offsets), rational(system.normals)
    fields, y = rational(system.constants), rational(np.array(y0, dtype=float))
    now, end, events, points = Fraction(t0), Fraction(t_end), [], []
    values = [dot(n, y) - c for n, c in zip(normals, offsets, strict=True)]
    locks = [1 if h > 0 else -1 for h in values]
    for _ in range(len(locks) + 1):  # rates at the start depend on the other locks
        rates = [dot(n, fields[mode_row(locks)]) for n in normals]
        locks = locks_of(values, rates)
    start = list(locks)
    while True:
        f = fields[mode_row(locks)]
        waits = {}
        for k, n in enumerate(normals):
            margin, rate = locks[k] * (dot(n, y) - offsets[k]), locks[k] * dot(n, f)
            if rate < 0:
                waits[k] = max(-margin / rate, Fraction(0))
        wait = min(waits.values(), default=end - now + 1)
        span = min(wait, end - now)
        y, now = [a + span * b for a, b in zip(y, f, strict=True)], now + span
        if wait > span:
            return Run(events, points, [float(a) for a in y], start, locks)
        for k in [k for k, w in waits.items() if w == wait]:
            locks[k] = -locks[k]
            events.append((float(now), k, locks[k]))
            points.append([float(a) for a in y])


def velocity(system: Piecewise, locks: list[int], y: list[float]) -> np.ndarray:
    """Return the field at a point, in floats."""
    row = mode_row(locks)
    flow = (
        0.0 if system.matrices is None else along(system.matrices[row], np.asarray(y))
    )
    return system.constants[row] + flow


def amplification(
    system: Piecewise, run: Run, span: float, *, back: bool = False
) -> float:
    """Return the largest factor by which an error at any event or step grows until the end.

    It is the product of the saltation matrices I + (f+ - f-) n / (n f-), times a bound
    on the flow's growth. For a run back, which ends at the start, f+ and f- are
    exchanged.
    """
    n, passed = system.shape[0], list(zip(run.events, run.points, strict=True))
    locks, product, most = list(run.start if back else run.end), np.eye(n), 1.0
    for (_, k, direction), point in passed if back else reversed(passed):
        after = velocity(system, locks, point)
        locks[k] = direction if back else -direction
        before, normal = velocity(system, locks, point), system.normals[k]
        product = product @ (
            np.eye(n) + np.outer(after - before, normal) / (normal @ before)
        )
        most = max(most, float(np.linalg.norm(product, 2)))
    if system.matrices is None:
        return most
    return most * float(
        np.exp(np.linalg.norm(system.matrices, 2, axis=(1, 2)).max() * span)
    )


def constant_answer(
    system: Piecewise,
    y0: list[float],
    t_span: tuple[float, float],
    *,
    slack: float = 0.0,
) -> Expected:
    """Return the right answer for piecewise constant fields, with tolerances for rounding.

    Runge-Kutta steps are exact there, so only rounding is allowed: at each event a few
    units of rounding of the state and of the time (in which the field moves it),
    amplified by what follows. `slack` is the time, s, within which close events may
    change their order.
    """
    run = constant_events(system, y0, *t_span)
    speed = np.abs(system.constants).sum(axis=1).max()
    size = max(np.abs(y0).max(), np.abs(run.y_end).max(), max(np.abs(t_span)) * speed)
    size = max(
        size,
        np.abs([offset for offset in system.offsets if offset < FAR]).max(initial=0),
    )
    span = t_span[1] - t_span[0]
    growth, back = (amplification(system, run, span, back=way) for way in (False, True))
    rounding = (
        ROUNDINGS * EPS * (len(run.events) + 1) * size * growth + slack * speed * growth
    )
    reach = np.abs(system.normals).sum(axis=1).max() / min_rate(system)
    time_tolerance = rounding * reach + ROUNDINGS * EPS * max(np.abs(t_span)) + slack
    return Expected(
        tuple(run.events), run.y_end, time_tolerance, rounding, mode=tuple(run.end),
        back=max(back / growth, 1.0),
    )  # fmt: skip


def min_rate(system: Piecewise) -> float:
    """Return the least nonzero |n f| over all guards and modes."""
    rates = np.abs(system.constants @ system.normals.T)
    return float(rates[rates > 0].min())
