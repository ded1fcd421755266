"""Right answers for piecewise affine fields: Taylor series with many digits."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from stress_reference import Piecewise, Run, mode_row

DIGITS = 30


def series(a: list[Any], b: list[Any], y: list[Any], terms: int) -> list[list[Any]]:
    """Return the Taylor coefficients of the solution of y' = a y + b, one list per component."""
    rows = [list(row) for row in a]
    now, out = list(y), [[value] for value in y]
    for order in range(1, terms + 1):
        now = [
            (mpmath.fdot(row, now) + (b[i] if order == 1 else 0))
            for i, row in enumerate(rows)
        ]
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
    """Return the zero, within the span, of a polynomial that rises from below, or None.

    The polynomial is monotone (the guard is live), so Newton's iteration can be
    bracketed.
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
    """Propagate piecewise affine fields with live, rising guards by Taylor series of 30 digits."""
    with mpmath.workdps(DIGITS):
        offsets, normals, y = exact(system.offsets), exact(system.normals), exact(y0)
        locks = [
            1 if mpmath.fdot(n, y) >= c else -1
            for n, c in zip(normals, offsets, strict=True)
        ]
        now, end, events, points, start = (
            mpmath.mpf(0),
            mpmath.mpf(t_end),
            [],
            [],
            list(locks),
        )
        while True:
            row = mode_row(locks)
            flow = series(
                exact(system.matrices[row]), exact(system.constants[row]), y, terms
            )
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
