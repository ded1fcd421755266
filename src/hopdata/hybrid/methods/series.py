"""The step of Taylor's method: the series of y' = A y + b, written out for a number of states.

Each term needs the one before it, so a step takes as long as this chain of products. For a small
system it is written out: matrix and term are numbers that stay in the processor's registers. For a
larger one they are rows of the table, in loops. Both come from the same lines.

The chain is of the derivatives times powers of the step; each is divided by its factorial beside
the chain, not within it.
"""

from __future__ import annotations

from math import factorial, inf, sqrt
from types import FunctionType

import numpy as np

from hopdata.hybrid.compiled.fused import fma
from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import FloatTable, FloatVector
from hopdata.hybrid.methods.explicit import INDENT, compose
from hopdata.hybrid.methods.rows import (
    END,
    K1,
    KEND,
    MOST_COEFFICIENTS,
    P1,
    SCRATCH,
    SLOPE,
    W1,
    Y,
)

DEGREE = MOST_COEFFICIENTS
ORDER = DEGREE + 1
B, WEIGHT, INFO, LONGEST, A = W1, W1 + 1, W1 + 2, W1 + 3, W1 + 4

EPS = 2.0**-52
SHARP = 64 * EPS  # relative tolerance to which looser ones are tightened
EARLY = 8  # terms, after which a step that is
FAR_TOO_LONG = 1e15  # times as wrong as allowed shows it
TINY = 1e-300
FACTORIALS = np.array([float(factorial(k)) for k in range(ORDER + 1)])
SHARES = 1.0 / FACTORIALS

MOST_WRITTEN_OUT = 4  # states: of more, matrix and term no longer fit into the registers


@kernel
def weight(s: FloatTable, i: int, term: float, rtol: float, atol: FloatVector) -> float:
    """Return one over the tolerance of state `i`, by the state and the first term."""
    return 1.0 / max(rtol * max(abs(s[Y, i]), abs(term)) + atol[i], TINY)


@kernel
def may_end_early(last: float, before: float, older: float, sharper: float) -> bool:
    """Tell whether a step, after its first terms, is so much too long that the rest tells nothing.

    Of one that is, the terms still grow.
    """
    return last > older and left_out(EARLY, last, before, older) * sharper > FAR_TOO_LONG


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
    """Return ``step(t, dt, rtol, s, mode, params, atol)`` for `n` states.

    It sums the series at `dt`, and returns the first term left out, in units of the sharper
    tolerance. Terms are added until two in a row are below an eighth of the rounding error of the
    state. The returned error is that of degree 32 all the same, which is what limits a step.
    """
    return compose("step", "t, dt, rtol, s, mode, params, atol", _step_code(n), {"N": n, **KNOWN})


KNOWN = {
    "A": A,
    "B": B,
    "DEGREE": DEGREE,
    "EARLY": EARLY,
    "END": END,
    "EPS": EPS,
    "INFO": INFO,
    "K1": K1,
    "KEND": KEND,
    "P1": P1,
    "SCRATCH": SCRATCH,
    "SHARES": SHARES,
    "SHARP": SHARP,
    "SLOPE": SLOPE,
    "WEIGHT": WEIGHT,
    "Y": Y,
    "fma": fma,
    "inf": inf,
    "left_out": left_out,
    "may_end_early": may_end_early,
    "sum_of_terms": sum_of_terms,
    "weight": weight,
}


def _each(n: int, *lines: str) -> list[str]:
    """Return lines for each state i; x, y and w stand for its term, its next one, its weight."""
    if n <= MOST_WRITTEN_OUT:
        return [
            line.format(i=i, x=f"x{i}", y=f"y{i}", w=f"w{i}") for i in range(n) for line in lines
        ]
    names = {"i": "i", "x": "s[SCRATCH, i]", "y": "s[SLOPE, i]", "w": "s[WEIGHT, i]"}
    return ["for i in range(N):", *(INDENT + line.format(**names) for line in lines)]


def _matrix(n: int) -> list[str]:
    """Return lines that take A dt out of the table, if it is written out."""
    if n > MOST_WRITTEN_OUT:
        return []
    return [f"a{i}_{j} = dt * s[A + {i}, {j}]" for i in range(n) for j in range(n)]


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
    # Sums, not maxima, as NaN survives in them; and two terms, as one kind of state may rest.
    one_more = [
        "if k == EARLY and may_end_early(last, before, older, sharper):",
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
        *_matrix(n),
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
