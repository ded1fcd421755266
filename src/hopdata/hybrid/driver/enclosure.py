"""Ranges of states and slopes over a piece of a step, from its interpolant.

The interpolant is written in powers of theta, from the start of the piece on. Over the
piece, terms of high degree are small, and only their size counts. The others become a
Bernstein polynomial, whose least and largest coefficient enclose its values, and whose
differences enclose its slope.
"""

from math import comb

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.problem import EPS, Problem
from hopdata.hybrid.layout import Memory

#: Bound on the rounding of an interpolant, as a fraction of the sum of its terms.
#: Unit: 1. Origin: rounding: 64 units in the last place of a double, some two for each
#: degree.
GRAIN = 64.0 * EPS

#: Share of the terms of a slope that may be left to their sizes.
#: Unit: 1. Origin: chosen.
LEFT_OUT = 2.0**-6

# PER_COMB[n, k] is one over the number of ways to choose k of n.
_N = at.LARGEST_DEGREE + 1
PER_COMB = np.array([[1.0 / max(comb(n, k), 1) for k in range(_N)] for n in range(_N)])


@kernel_apart
def begin_enclosing(p: Problem, m: Memory) -> None:
    """Write the step's interpolant in powers of theta, and the rounding of its values.

    Its coefficients are in the rows from P1 on.
    """
    s = m.states
    degree = m.counts[at.DEGREE]
    free = p.methods[m.counts[at.METHOD], at.ENCLOSED_AT]
    m.counts[at.PIECE_AT] = free
    m.counts[at.SHIFTED_AT] = free + degree + 1
    for i in range(s.width):
        s[at.P0, i] = s[at.Y, i]
    m.counts[at.POWERS_AT] = at.P0
    if p.methods[m.counts[at.METHOD], at.IN_POWERS] == 0:
        m.counts[at.POWERS_AT] = free + 2 * (degree + 1)
        to_powers(m, degree)
    m.counts[at.TERMS_AT] = m.counts[at.POWERS_AT]
    row = m.counts[at.POWERS_AT]
    for i in range(s.width):
        value = 0.0
        slope = 0.0
        for j in range(1, degree + 1):
            size = abs(s[row + j, i])
            value += size
            slope += j * size
        # What rests has no rounding.
        whole = value + abs(s[at.Y, i]) if value > 0.0 else 0.0
        s[at.VALUE_GRAIN, i] = GRAIN * whole
        s[at.SLOPE_GRAIN, i] = GRAIN * slope


@kernel
def to_powers(m: Memory, degree: int) -> None:
    """Write y = Y + x (P1 + r (P2 + x (P3 + ...))), r = 1 - x, in powers of x."""
    s = m.states
    constant = m.counts[at.POWERS_AT]
    v = constant + 1  # first row of what is multiplied by x at last
    for i in range(s.width):
        s[constant, i] = s[at.Y, i]
        s[v, i] = s[at.P1 + degree - 1, i]
        for k in range(1, degree):  # degree after this factor
            number = degree - k  # of the coefficient that is added: P1 is number 1
            added = s[at.P1 + number - 1, i]
            if number % 2 == 0:  # a factor x
                for j in range(k, 0, -1):
                    s[v + j, i] = s[v + j - 1, i]
                s[v, i] = added
            else:
                s[v + k, i] = -s[v + k - 1, i]
                for j in range(k - 1, 0, -1):
                    s[v + j, i] -= s[v + j - 1, i]
                s[v, i] += added


@kernel_apart
def shift_to(m: Memory, a: float) -> None:
    """Write the interpolant in powers of theta - a."""
    s = m.states
    degree = m.counts[at.DEGREE]
    row = m.counts[at.POWERS_AT]
    into = m.counts[at.SHIFTED_AT]
    m.counts[at.TERMS_AT] = into
    for j in range(degree + 1):
        for i in range(s.width):
            s[into + j, i] = s[row + j, i]
    for k in range(degree):
        for j in range(degree - 1, k - 1, -1):
            for i in range(s.width):  # inside: the states do not wait for each other
                s[into + j, i] += a * s[into + j + 1, i]


@kernel_in_loop
def enclose_one(m: Memory, i: int, row: int, width: float, per_s: float) -> None:
    """Enclose state i and its slope over a piece of this width from `row` on."""
    s = m.states
    c = m.counts[at.PIECE_AT]
    n = m.counts[at.DEGREE]
    power = 1.0
    slopes = 0.0
    for j in range(1, n + 1):
        power *= width
        term = s[row + j, i] * power
        s[c + j, i] = term
        slopes += j * abs(term)
    left = 0.0
    slopes_left = 0.0
    while n > 1:
        size = abs(s[c + n, i])
        if not slopes_left + n * size <= LEFT_OUT * slopes:
            break
        left += size
        slopes_left += n * size
        n -= 1
    for j in range(1, n + 1):
        s[c + j, i] *= PER_COMB[n, j]
    s[c, i] = 0.0
    for k in range(1, n + 1):
        for j in range(n, k - 1, -1):
            s[c + j, i] += s[c + j - 1, i]
    least = 0.0
    most = 0.0
    before = s[c + 1, i]
    least_slope = before
    most_slope = before
    least = min(least, before)
    most = max(most, before)
    for j in range(2, n + 1):
        one = s[c + j, i]
        least = min(least, one)
        most = max(most, one)
        least_slope = min(least_slope, one - before)
        most_slope = max(most_slope, one - before)
        before = one
    start = s[row, i]
    left += s[at.VALUE_GRAIN, i]
    s[at.LEAST, i] = start + (least - left)
    s[at.MOST, i] = start + (most + left)
    per_width = per_s / width
    left = slopes_left * per_width + s[at.SLOPE_GRAIN, i] * per_s
    s[at.LEAST_SLOPE, i] = n * least_slope * per_width - left
    s[at.MOST_SLOPE, i] = n * most_slope * per_width + left


@kernel_apart
def enclose(m: Memory, dt: float, a: float, z: float) -> None:
    """Write ranges of states and of slopes (per second) over a piece of the step.

    They go into the rows LEAST to MOST_SLOPE. The interpolant is written in powers of
    theta - a.
    """
    row = m.counts[at.TERMS_AT]
    for i in range(m.states.width):
        enclose_one(m, i, row, z - a, 1.0 / dt)
