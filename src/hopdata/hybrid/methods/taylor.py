# ruff: noqa: ARG001, F401 (methods are all called alike; names stand in the code of a step)
"""Taylor series of the flow of an affine mode, y' = A y + b, exact but for rounding.

The derivatives follow from one another by a product with A, so a step of degree 32 costs 32 small
products and no evaluation of the field, and the series is its own dense output. `refresh` fetches
A and b; it is called at the start and whenever the mode or the parameters may have changed.

`refresh` and `interpolant` are templates: AFFINE and N are put in for each scene.
The step is made by `series`.

The order for step control is that of the first term left out, 33. The error obeys this power
over many decades, so a step may be chosen very long and is cut to size by one or two rejections, if
the controller may shrink it as far as it proposes. Half the error costs a fiftieth of the step, so
steps are as short as rounding wants them, whatever the tolerance: half a swing is one step all the
same. The degree that was needed is left in INFO.
"""

from math import factorial, inf, nan, sqrt
from types import FunctionType
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel, kernel_in_loop
from hopdata.hybrid.compiled.memory import FloatTable, FloatVector, fma, row, square
from hopdata.hybrid.layout import END, K1, KEND, LARGEST_DEGREE, P1, SCRATCH, SLOPE, W1, Y
from hopdata.hybrid.methods.explicit import INDENT, compose_part

# The fastest motion of a linear flow: by its matrix, whatever the state does.


@kernel_in_loop
def fastest_motion(table: FloatTable, first: int) -> float:
    """Return the fastest motion squared, 1/s^2, of the square matrix from row `first` on.

    By its diagonal and by pairs of entries: the largest abs(a_ij a_ji), which no choice of units
    changes.
    """
    fastest = 0.0
    for i in range(table.width):
        fastest_of_row = 0.0  # the processor works on several rows at a time
        for j in range(i + 1):
            fastest_of_row = max(fastest_of_row, abs(table[first + i, j] * table[first + j, i]))
        fastest = max(fastest, fastest_of_row)
    return fastest


# The step of Taylor's method: the series of y' = A y + b, written out for a number of states.
#
# Each term needs the one before it, so a step takes as long as this chain of products. For a small
# system it is written out: matrix and term are numbers that stay in the processor's registers. For
# a larger one they are rows of the table, in loops. Both come from the same lines.
#
# The chain is of the derivatives times powers of the step; each is divided by its factorial beside
# the chain, not within it.

DEGREE = LARGEST_DEGREE
ORDER = DEGREE + 1
B, WEIGHT, INFO, LONGEST, A = W1, W1 + 1, W1 + 2, W1 + 3, W1 + 4

EPS = 2.0**-52
SHARP = 64 * EPS  # relative tolerance to which looser ones are tightened
# Terms after which a step that is so many times as wrong as allowed shows it: they still grow, and
# the rest tells nothing.
EARLY, FAR_TOO_LONG = 8, 1e15
TINY = 1e-300
FACTORIALS = np.array([float(factorial(k)) for k in range(ORDER + 1)])
SHARES = 1.0 / FACTORIALS

MOST_WRITTEN_OUT = 4  # states: of more, matrix and term no longer fit into the registers


@kernel
def weight(s: FloatTable, i: int, term: float, rtol: float, atol: FloatVector) -> float:
    """Return one over the tolerance of state `i`, by the state and the first term."""
    return 1.0 / max(rtol * max(abs(s[Y, i]), abs(term)) + atol[i], TINY)


@kernel
def left_out(k: int, last: float, before: float, older: float) -> float:
    """Return the first term beyond the highest degree, by the last three of k terms.

    They fall like z^k / k!, with z from every second of them: they may alternate.
    """
    if last == 0.0:
        return 0.0
    squared = k * (k - 1) * last / older
    z, pairs = sqrt(squared), (ORDER - k) // 2
    reached = k + 2 * pairs
    error = max(last, before * z / k) * (FACTORIALS[k] * SHARES[reached])
    for _ in range(pairs):
        error *= squared
    return error if reached == ORDER else error * z / ORDER


@kernel
def sum_of_terms(s: FloatTable, k: int, i: int) -> float:
    """Return the sum of k terms of state `i`, the smallest first.

    Two neighbours are added before: where terms alternate, those of one sign would only add up to
    what those of the other take away.
    """
    first = k - 1 if k % 2 == 0 else k - 2
    total = 0.0 if k % 2 == 0 else s[P1 + k - 1, i]
    for m in range(first, 0, -2):
        total += s[P1 + m, i] + s[P1 + m - 1, i]
    return total


def step_function(n: int) -> FunctionType:
    """Return ``step(t, dt, rtol, s, mode, params, atol, field)`` for `n` states.

    It sums the series at `dt`, and returns the first term left out, in units of the sharper
    tolerance. Terms are added until two in a row are below an eighth of the rounding error of the
    state. The returned error is that of degree 32 all the same, which is what limits a step.
    """
    return compose_part("step", _step_code(n), {**globals(), "N": n})


def _each(n: int, *lines: str) -> list[str]:
    """Return lines for each state i; x, y and w stand for its term, its next one, its weight."""
    if n <= MOST_WRITTEN_OUT:
        return [
            line.format(i=i, x=f"x{i}", y=f"y{i}", w=f"w{i}") for i in range(n) for line in lines
        ]
    names = {"i": "i", "x": "s[SCRATCH, i]", "y": "s[SLOPE, i]", "w": "s[WEIGHT, i]"}
    return ["for i in range(N):", *(INDENT + line.format(**names) for line in lines)]


def _product(n: int) -> list[str]:
    """Return lines that put the product of A dt and each x into y."""
    if n > MOST_WRITTEN_OUT:
        return _each(
            n,
            "total = s[A + i, 0] * s[SCRATCH, 0]",
            "for j in range(1, N):",
            INDENT + "total = fma(s[A + i, j], s[SCRATCH, j], total)",
            "{y} = dt * total",
        )
    lines = []
    for i in range(n):
        total = f"a{i}_0 * x0"
        for j in range(1, n):
            total = f"fma(a{i}_{j}, x{j}, {total})"
        lines.append(f"y{i} = {total}")
    return lines


def _step_code(n: int) -> list[str]:
    written_out = range(n if n <= MOST_WRITTEN_OUT else 0)
    # Sums, not maxima, as NaN survives in them; and two terms, as one kind of state may rest.
    one_more = [
        "wrong = left_out(k, last, before, older) * sharper if k == EARLY else 0.0",
        "if wrong > FAR_TOO_LONG and last > older:",
        INDENT + "break",
        "share, older, before, last = SHARES[k + 1], before, last, 0.0",
        *_product(n),
        *_each(
            n,
            "{x} = {y}",
            "term = share * {x}",
            "s[P1 + k, {i}] = term",
            "last = fma(abs(term), {w}, last)",
        ),
        "k += 1",
    ]
    return [
        "last, before, older, k = 0.0, inf, inf, 1",
        "sharper, negligible = max(rtol / SHARP, 1.0), EPS / 8.0 / max(rtol, EPS)",
        *_each(
            n,
            "{x} = dt * s[K1, {i}]",
            "s[P1, {i}] = {x}",
            "{w} = weight(s, {i}, {x}, rtol, atol)",
            "last = fma(abs({x}), {w}, last)",
        ),
        *(f"a{i}_{j} = dt * s[A + {i}, {j}]" for i in written_out for j in written_out),
        "while k < DEGREE and last != 0.0 and not (last + before <= negligible):",
        *(INDENT + line for line in one_more),
        "s[INFO, 0] = k",
        *_each(n, "s[END, {i}] = s[Y, {i}] + sum_of_terms(s, k, {i})"),
        *_each(
            n,
            "total = s[B, {i}]",
            "for j in range(N):",
            INDENT + "total = fma(s[A + {i}, j], s[END, j], total)",
            "s[KEND, {i}] = total",
        ),
        "return left_out(k, last, before, older) * sharper",
    ]


FARTHEST_TURN = 4.5  # radians: nine tenths of z with z^33 / 33! = 64 EPS, the tolerance of a step

AFFINE: Any = None
N: int = 0


def work_rows(n: int) -> int:
    """Return the number of work rows for `n` states."""
    return 4 + n


def refresh(s: FloatTable, mode: Any, params: Any) -> float:
    """Fetch A and b of the mode; entries that the user's function leaves alone are zero.

    The fastest motion tells how long a first step may be. Returns by how much K1, the field at Y,
    differs from A Y + b, relative to the terms of these: more than rounding means that the user's
    two functions are not the same field.
    """
    square(s, A)[:] = 0.0
    row(s, B)[:] = 0.0
    AFFINE(mode, params, square(s, A), row(s, B))
    fastest = fastest_motion(s, A)
    s[LONGEST, 0] = FARTHEST_TURN / sqrt(fastest) if 0.0 < fastest < inf else inf
    worst = 0.0
    for i in range(N):
        difference, size = s[B, i] - s[K1, i], abs(s[B, i]) + abs(s[K1, i])
        for j in range(N):
            difference += s[A + i, j] * s[Y, j]
            size += abs(s[A + i, j] * s[Y, j])
        if difference != 0.0:
            worst = max(worst, abs(difference) / size)
    return worst


def interpolant(t: float, dt: float, s: FloatTable, mode: Any, params: Any, field: int) -> int:
    """Return the degree that the series needed: its coefficients are in place."""
    return int(s[INFO, 0])


def tangent(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any,
    field: int, jacobian: int,
) -> float:  # fmt: skip
    """Write exp(A dt) Phi into the block after Phi; return the error, which is 0 but for rounding.

    NaN if the series does not end: the step is too long for it.
    """
    square(phi, N)[:] = square(phi, 0)
    square(phi, 2 * N)[:] = square(phi, 0)
    for k in range(1, 2 * DEGREE):
        largest, size = 0.0, 0.0
        for j in range(N):
            for i in range(N):
                total = 0.0
                for m in range(N):
                    total += s[A + i, m] * phi[2 * N + m, j]
                s[WEIGHT, i] = total * dt / k
            for i in range(N):
                phi[2 * N + i, j] = s[WEIGHT, i]
                phi[N + i, j] += s[WEIGHT, i]
                largest = max(largest, abs(s[WEIGHT, i]))
                size = max(size, abs(phi[N + i, j]))
        if largest <= EPS / 8.0 * size:
            return 0.0
    return nan
