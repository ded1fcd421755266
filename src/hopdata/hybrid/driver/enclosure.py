"""Ranges of states and slopes over a piece of a step, from its interpolant.

Over a whole step, the interpolant of an explicit method is its cubic and some terms
x^a (1 - x)^b: the cubic's Bernstein coefficients enclose it and its slope, and each
other term lies between zero and its largest value. Elsewhere the interpolant is written
in powers of theta, from the start of the piece on. Over the piece, terms of high degree
are small, and only their size counts. The others become a Bernstein polynomial, whose
least and largest coefficient enclose its values, and whose differences enclose its
slope.
"""

from math import comb, sqrt

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import (
    kernel,
    kernel_apart,
    kernel_in_loop,
    kernel_into_other,
)
from hopdata.hybrid.compiled.memory import FloatTable, fma
from hopdata.hybrid.driver.problem import EPS, Problem
from hopdata.hybrid.layout import Memory

#: Bound on the rounding of an interpolant, as a fraction of the sum of its terms.
#: Unit: 1. Origin: rounding: 64 units in the last place of a double, some two for each
#: degree.
GRAIN = 64.0 * EPS

#: Share of the terms of a slope that may be left to their sizes.
#: Unit: 1. Origin: chosen.
SHARE_BY_SIZE = 2.0**-6

#: Terms from the start of a piece that are computed before the sizes of the others are
#: looked at.
#: Unit: 1. Origin: chosen.
FIRST_TERMS = 8

AT_ONCE = 4  # terms that are computed at once

# Degrees of the interpolants of explicit methods.
OF_DOPRI5 = 4
OF_DOP853 = 7

# PER_COMB[n, k] is one over the number of ways to choose k of n.
_N = at.LARGEST_DEGREE + 1
PER_COMB = np.array([[1.0 / max(comb(n, k), 1) for k in range(_N)] for n in range(_N)])


# The terms x^a r^b of an interpolant, r = 1 - x, in [0, 1].


def _largest_term(a: int, b: int) -> float:
    """Return the largest value of x^a (1 - x)^b between 0 and 1, at a / (a + b)."""
    x = a / (a + b)
    return x**a * (1.0 - x) ** b


def _extreme_slopes(a: int, b: int) -> tuple[float, float]:
    """Return the least and the largest slope of x^a (1 - x)^b, for a, b > 1.

    Its second derivative vanishes at (a +- sqrt(a b / (a + b - 1))) / (a + b).
    """
    n = a + b
    slopes = []
    for way in (-1.0, 1.0):
        x = (a + way * sqrt(a * b / (n - 1))) / n
        slopes.append(x ** (a - 1) * (1.0 - x) ** (b - 1) * (a - n * x))
    return min(slopes), max(slopes)


# Indexed by the number of a coefficient. The first three are those of the cubic.
_AFTER_CUBIC = range(4, at.LOW_DEGREE + 1)
_POWERS = {j: ((j + 1) // 2, j // 2) for j in _AFTER_CUBIC}
_ROUNDED_UP = 1.0 + 8.0 * EPS
LARGEST_TERM = np.zeros(at.LOW_DEGREE + 1)
LEAST_SLOPE_OF_TERM = np.zeros(at.LOW_DEGREE + 1)
MOST_SLOPE_OF_TERM = np.zeros(at.LOW_DEGREE + 1)
for _j, (_a, _b) in _POWERS.items():
    LARGEST_TERM[_j] = _ROUNDED_UP * _largest_term(_a, _b)
    _least, _most = _extreme_slopes(_a, _b)
    LEAST_SLOPE_OF_TERM[_j] = _ROUNDED_UP * _least
    MOST_SLOPE_OF_TERM[_j] = _ROUNDED_UP * _most


@kernel_in_loop
def enclose_states(s: FloatTable, into: FloatTable, per_s: float, degree: int) -> None:
    """Enclose states and slopes over the whole step, from the interpolant as it comes.

    It is Y + x (P1 + r (P2 + x (P3 + r (...)))), r = 1 - x, of degree 3 at least.
    `into` is the same table: what is read from `s` is not written to it.
    """
    for i in range(s.width):
        start = s[at.Y, i]
        rise = s[at.P1, i]
        bend = s[at.P1 + 1, i]
        twist = s[at.P1 + 2, i]
        # The cubic and its slope, as Bernstein polynomials.
        first_slope = rise + bend
        middle_slope = rise + twist
        last_slope = rise - bend - twist
        first = first_slope / 3.0
        last = rise - last_slope / 3.0
        least = min(0.0, rise, first, last)
        most = max(0.0, rise, first, last)
        least_slope = min(first_slope, middle_slope, last_slope)
        most_slope = max(first_slope, middle_slope, last_slope)
        size = abs(rise) + abs(bend) + abs(twist)
        slope_size = abs(rise) + 2.0 * abs(bend) + 3.0 * abs(twist)
        for j in range(4, degree + 1):
            one = s[at.P1 + j - 1, i]
            above = max(one, 0.0)
            below = min(one, 0.0)
            least += below * LARGEST_TERM[j]
            most += above * LARGEST_TERM[j]
            to_least = LEAST_SLOPE_OF_TERM[j]
            to_most = MOST_SLOPE_OF_TERM[j]
            least_slope += above * to_least + below * to_most
            most_slope += above * to_most + below * to_least
            size += abs(one)
            slope_size += j * abs(one)
        # What rests has no rounding; what is not a number remains so.
        grain = 0.0 if size == 0.0 else GRAIN * (size + abs(start))
        slope_grain = GRAIN * slope_size
        into[at.LEAST, i] = start + (least - grain)
        into[at.MOST, i] = start + (most + grain)
        into[at.LEAST_SLOPE, i] = (least_slope - slope_grain) * per_s
        into[at.MOST_SLOPE, i] = (most_slope + slope_grain) * per_s


# The loop over the states becomes vector instructions only if the compiler unrolls that
# over the coefficients, whose number must be known to it.


@kernel_into_other
def enclose_by_dopri5(s: FloatTable, into: FloatTable, per_s: float) -> None:
    """Enclose all states by the interpolant of DOPRI5."""
    enclose_states(s, into, per_s, OF_DOPRI5)


@kernel_into_other
def enclose_by_dop853(s: FloatTable, into: FloatTable, per_s: float) -> None:
    """Enclose all states by the interpolant of DOP853."""
    enclose_states(s, into, per_s, OF_DOP853)


@kernel_into_other
def enclose_by_other(
    s: FloatTable, into: FloatTable, per_s: float, degree: int
) -> None:
    """Enclose all states by any other interpolant that is not in powers."""
    enclose_states(s, into, per_s, degree)


@kernel
def enclose_whole(m: Memory, per_s: float) -> None:
    """Enclose all states over the whole step, from the interpolant as it comes."""
    s = m.states
    degree = m.counts[at.DEGREE]
    if degree == OF_DOPRI5:
        enclose_by_dopri5(s, s, per_s)
    elif degree == OF_DOP853:
        enclose_by_dop853(s, s, per_s)
    else:
        enclose_by_other(s, s, per_s, degree)


# The interpolant in powers of theta.


@kernel
def begin_enclosing(p: Problem, m: Memory) -> None:
    """Forget the ranges of the last step."""
    c = m.counts
    free = p.methods[c[at.METHOD], at.ENCLOSED_AT]
    c[at.PIECE_AT] = free
    c[at.SHIFTED_AT] = free + c[at.DEGREE] + 1
    c[at.POWERS_AT] = 0
    c[at.ARE_WHOLE] = 0
    c[at.ARE_POWERS] = p.methods[c[at.METHOD], at.IN_POWERS]


@kernel_apart
def write_powers(m: Memory) -> None:
    """Write the step's interpolant in powers of theta, and the rounding of its values.

    Its coefficients are in the rows from POWERS_AT on. The rounding of its slopes is
    written, too.
    """
    s = m.states
    degree = m.counts[at.DEGREE]
    for i in range(s.width):
        s[at.P0, i] = s[at.Y, i]
    m.counts[at.POWERS_AT] = at.P0
    if m.counts[at.ARE_POWERS] == 0:
        m.counts[at.POWERS_AT] = m.counts[at.PIECE_AT] + 2 * (degree + 1)
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
        s[at.PASSES, i] = degree


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


# Pieces of the step.


@kernel
def begin_pieces(m: Memory) -> None:
    """Let the next pieces start at another place."""
    m.counts[at.TERMS_AT] = 0


@kernel
def remainder(
    m: Memory, i: int, row: int, passes: int, x: float
) -> tuple[float, float]:
    """Return bounds of a polynomial and of its slope up to x, from sizes of its terms.

    Its coefficients are those of state i from row `row + passes` on.
    """
    value = 0.0
    slope = 0.0
    for j in range(m.counts[at.DEGREE], passes - 1, -1):
        slope = slope * x + value
        value = value * x + abs(m.states[row + j, i])
    return value, slope


@kernel
def divide_four_times(m: Memory, i: int, row: int, first: int, a: float) -> None:
    """Divide a polynomial of state i by theta - a, four times.

    Its coefficients are those from row `row + first` on. Four remainders and the last
    quotient take their place. All divisions go on at once, since each waits for the
    last sum of its own.
    """
    s = m.states
    one = 0.0
    two = 0.0
    three = 0.0
    four = 0.0
    for j in range(m.counts[at.DEGREE], first + 2, -1):
        one = fma(a, one, s[row + j, i])
        two = fma(a, two, one)
        three = fma(a, three, two)
        four = fma(a, four, three)
        s[row + j, i] = four
    one = fma(a, one, s[row + first + 2, i])
    two = fma(a, two, one)
    s[row + first + 2, i] = fma(a, three, two)
    one = fma(a, one, s[row + first + 1, i])
    s[row + first + 1, i] = fma(a, two, one)
    s[row + first, i] = fma(a, one, s[row + first, i])


@kernel
def shift_one(m: Memory, i: int, a: float, z: float) -> None:
    """Write the interpolant of state i as powers of x = theta - a, up to z.

    After n divisions by x, it is the sum of n terms and of x^n times a polynomial in
    powers of theta, whose coefficients stand behind the terms. There are as many
    divisions as make that small.
    """
    s = m.states
    degree = m.counts[at.DEGREE]
    from_row = m.counts[at.POWERS_AT]
    row = m.counts[at.SHIFTED_AT]
    for j in range(degree + 1):
        s[row + j, i] = s[from_row + j, i]
    passes = 0
    power = 1.0
    slopes = 0.0
    while passes + AT_ONCE <= degree:
        divide_four_times(m, i, row, passes, a)
        for k in range(passes, passes + AT_ONCE):
            slopes += k * abs(s[row + k, i]) * power
            power *= z - a
        passes += AT_ONCE
        if passes >= FIRST_TERMS:
            value, slope = remainder(m, i, row, passes, z)
            if power * (passes * value + (z - a) * slope) <= SHARE_BY_SIZE * slopes:
                s[at.PASSES, i] = passes
                return
    for k in range(passes, degree):
        for j in range(degree - 1, k - 1, -1):
            s[row + j, i] += a * s[row + j + 1, i]
    s[at.PASSES, i] = degree


@kernel_in_loop
def enclose_one(
    m: Memory, i: int, row: int, a: float, width: float, per_s: float
) -> None:
    """Enclose state i and its slope over a piece of this width.

    Its interpolant stands in the rows from `row` on, as `shift_one` writes it.
    """
    s = m.states
    piece = m.counts[at.PIECE_AT]
    degree = m.counts[at.DEGREE]
    passes = int(s[at.PASSES, i])
    n = degree if passes == degree else passes - 1
    power = 1.0
    slopes = 0.0
    for j in range(1, n + 1):
        power *= width
        term = s[row + j, i] * power
        s[piece + j, i] = term
        slopes += j * abs(term)
    left = 0.0
    slopes_left = 0.0
    if passes < degree:
        value, slope = remainder(m, i, row, passes, a + width)
        left = power * width * value
        slopes_left = power * width * (passes * value + width * slope)
    # The highest terms are left to their sizes, too, as long as these are small.
    while n > 1:
        size = abs(s[piece + n, i])
        if not slopes_left + n * size <= SHARE_BY_SIZE * slopes:
            break
        left += size
        slopes_left += n * size
        n -= 1
    # To Bernstein coefficients: number j is the sum of the terms k, times the ways to
    # choose k of j over those to choose k of n. Without the start, number 0 is zero.
    for j in range(1, n + 1):
        s[piece + j, i] *= PER_COMB[n, j]
    s[piece, i] = 0.0
    for k in range(1, n + 1):
        for j in range(n, k - 1, -1):
            s[piece + j, i] += s[piece + j - 1, i]
    least = 0.0
    most = 0.0
    before = s[piece + 1, i]
    least_slope = before
    most_slope = before
    least = min(least, before)
    most = max(most, before)
    for j in range(2, n + 1):
        one = s[piece + j, i]
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
    slope_left = slopes_left * per_width + s[at.SLOPE_GRAIN, i] * per_s
    s[at.LEAST_SLOPE, i] = n * least_slope * per_width - slope_left
    s[at.MOST_SLOPE, i] = n * most_slope * per_width + slope_left


@kernel_apart
def enclose(m: Memory, dt: float, a: float, z: float) -> None:
    """Write ranges of states and of slopes (per second) over a piece of the step.

    They go into the rows LEAST to MOST_SLOPE. Pieces start at the same place until
    `begin_pieces`.
    """
    c = m.counts
    is_whole = a == 0.0 and z == 1.0
    if is_whole and c[at.ARE_WHOLE] != 0:
        return
    c[at.ARE_WHOLE] = 1 if is_whole else 0
    if is_whole and c[at.ARE_POWERS] == 0 and c[at.DEGREE] > 2:
        enclose_whole(m, 1.0 / dt)
        return
    if c[at.POWERS_AT] == 0:
        write_powers(m)
    if c[at.TERMS_AT] == 0:
        c[at.TERMS_AT] = c[at.SHIFTED_AT]
        for i in range(m.states.width):
            shift_one(m, i, a, z)
    row = c[at.TERMS_AT]
    for i in range(m.states.width):
        enclose_one(m, i, row, a, z - a, 1.0 / dt)
