"""Right answers: exact rational arithmetic, long Taylor series, and the mass on a floor."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
from stress_case import EPS, Expected

DIGITS = 30
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


def locks_of(values: list[Any], rates: list[Any]) -> list[int]:
    """Return the locks at the start: the sign of h, on the surface of its rate."""
    return [1 if h > 0 or (h == 0 and d > 0) else -1 for h, d in zip(values, rates, strict=True)]


def constant_events(system: Piecewise, y0: list[float], t0: float, t_end: float) -> Run:
    """Propagate piecewise constant fields exactly.

    Guards that are crossed at the very same instant flip together, as in `solve`.
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
    flow = 0.0 if system.matrices is None else system.matrices[row] @ np.asarray(y)
    return system.constants[row] + flow


def amplification(system: Piecewise, run: Run, span: float) -> float:
    """Return by how much, at most, an error made at any event or step grows until the end.

    Products of the saltation matrices I + (f+ - f-) n / (n f-), times a bound on the flow's growth.
    """
    n = system.shape[0]
    locks, product, most = list(run.end), np.eye(n), 1.0
    for (_, k, direction), point in zip(reversed(run.events), reversed(run.points), strict=True):
        after = velocity(system, locks, point)
        locks[k] = -direction
        before, normal = velocity(system, locks, point), system.normals[k]
        product = product @ (np.eye(n) + np.outer(after - before, normal) / (normal @ before))
        most = max(most, float(np.linalg.norm(product, 2)))
    if system.matrices is None:
        return most
    return most * float(np.exp(np.linalg.norm(system.matrices, 2, axis=(1, 2)).max() * span))


def constant_answer(
    system: Piecewise, y0: list[float], t_span: tuple[float, float], *, slack: float = 0.0
) -> Expected:
    """Return the right answer for piecewise constant fields, good to rounding.

    Runge-Kutta steps are exact there, so only rounding is allowed: a few units of it at each event,
    of the state, of the time (in which the field moves it), and amplified by what follows. `slack`
    is time, s, by which events that are so near to each other may change their order.
    """
    run = constant_events(system, y0, *t_span)
    speed = np.abs(system.constants).sum(axis=1).max()
    size = max(np.abs(y0).max(), np.abs(run.y_end).max(), max(np.abs(t_span)) * speed)
    size = max(size, np.abs([offset for offset in system.offsets if offset < FAR]).max(initial=0))
    growth = amplification(system, run, t_span[1] - t_span[0])
    rounding = ROUNDINGS * EPS * (len(run.events) + 1) * size * growth + slack * speed * growth
    reach = np.abs(system.normals).sum(axis=1).max() / min_rate(system)
    time_tolerance = rounding * reach + ROUNDINGS * EPS * max(np.abs(t_span)) + slack
    return Expected(tuple(run.events), run.y_end, time_tolerance, rounding, mode=tuple(run.end))


def min_rate(system: Piecewise) -> float:
    """Return the least |n f| over all guards and modes that is not zero."""
    rates = np.abs(system.constants @ system.normals.T)
    return float(rates[rates > 0].min())


def series(a: list[Any], b: list[Any], y: list[Any], terms: int) -> list[list[Any]]:
    """Return the Taylor coefficients of the solution of y' = a y + b, one list a component."""
    rows = [list(row) for row in a]
    now, out = list(y), [[value] for value in y]
    for order in range(1, terms + 1):
        now = [(mpmath.fdot(row, now) + (b[i] if order == 1 else 0)) for i, row in enumerate(rows)]
        now = [value / order for value in now]
        for i, value in enumerate(now):
            out[i].append(value)
    return out


def value_at(coefficients: list[Any], t: Any) -> Any:
    """Return the value of a polynomial, lowest power first (Horner)."""
    value = 0 * t
    for coefficient in reversed(coefficients):
        value = value * t + coefficient
    return value


def first_zero(coefficients: list[Any], span: Any) -> Any | None:
    """Return the zero within the span of a polynomial that rises from below; None if there is none.

    The polynomial is monotone (the guard is live), so Newton's iteration may be kept in a bracket.
    """
    if value_at(coefficients, span) < 0:
        return None
    slopes = [order * c for order, c in enumerate(coefficients)][1:]
    low, high, x = mpmath.mpf(0), span, span / 2
    for _ in range(60):
        value, slope = value_at(coefficients, x), value_at(slopes, x)
        low, high = (x, high) if value < 0 else (low, x)
        new = x - value / slope
        if abs(new - x) < mpmath.mpf(10) ** (4 - DIGITS):
            return new
        x = new if low <= new <= high else (low + high) / 2
    return x


def affine_events(system: Piecewise, y0: list[float], t_end: float, terms: int) -> Run:
    """Propagate piecewise affine fields with live, rising guards, by Taylor series of 30 digits."""
    with mpmath.workdps(DIGITS):
        offsets, normals, y = exact(system.offsets), exact(system.normals), exact(y0)
        locks = [1 if mpmath.fdot(n, y) >= c else -1 for n, c in zip(normals, offsets, strict=True)]
        now, end, events, points, start = mpmath.mpf(0), mpmath.mpf(t_end), [], [], list(locks)
        while True:
            row = mode_row(locks)
            flow = series(exact(system.matrices[row]), exact(system.constants[row]), y, terms)
            wait, first = end - now, -1
            for k in [k for k, lock in enumerate(locks) if lock < 0]:
                h = [mpmath.fdot(normals[k], c) for c in zip(*flow, strict=True)]
                h[0] -= offsets[k]
                zero = mpmath.mpf(0) if h[0] >= 0 else first_zero(h, wait)
                if zero is not None and zero <= wait:
                    wait, first = zero, k
            y = [value_at(c, wait) for c in flow]
            now += wait
            if first < 0:
                return Run(events, points, [float(v) for v in y], start, locks)
            locks[first] = 1
            events.append((float(now), first, 1))
            points.append([float(v) for v in y])


def exact(x: Any) -> Any:
    """Return nested lists of floats as exact numbers of mpmath."""
    return [exact(part) for part in x] if np.ndim(x) else mpmath.mpf(float(x))
