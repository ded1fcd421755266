"""Ranges and rates of arithmetic, of kinks and of jumps.

Every function here takes ranges and returns one. The rate of f(x) is the range of f'
over x times the rate of x. A result is widened by the rounding of the operations that
the guard itself takes; underflow is neglected. Where a number may not be one (outside
of a function's domain), its range is NaN, and so is that of all that is made of it.
`jump` and `kink` note in the memory of answers where a value, or its rate, jumps.
"""

import math
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.memory import float_vector, int_vector
from hopdata.hybrid.numbers import answers as at
from hopdata.hybrid.numbers.ranges import make

Pair = tuple[float, float]

EPS = 2.0**-52
#: Relative error by which the range of an elementary function is widened.
#: Unit: 1. Origin: rounding: 4 units in the last place, which is assumed of the C
#: library (docs/integrator_proof.md, The assumptions).
LIBM = 4.0 * EPS
INF = math.inf
NAN = math.nan
TURN = 2.0 * math.pi
LARGEST_WHOLE = 2.0**53  # floats below it hold every whole number

#: Widest range of numbers from which `int` still takes the middle; a loop may be as
#: long as that number.
#: Unit: 1. Origin: chosen.
MOST_WHOLE = 1024.0


# What is noted.


@kernel
def note_first(x: Any, middle: float) -> None:
    """Note where x - middle changes sign, unless something was noted before."""
    counted = int_vector(x.at, at.N_INTEGERS)
    if counted[at.OPENED] + counted[at.JUMPED] == 0:
        first = float_vector(x.at, at.N_SLOTS)
        first[at.FIRST_LEAST] = x.lo - middle
        first[at.FIRST_MOST] = x.hi - middle
        first[at.FIRST_LEAST_RATE] = x.dlo
        first[at.FIRST_MOST_RATE] = x.dhi


@kernel
def note_time(x: Any, middle: float, is_kink: float) -> None:
    """Note where x - middle changes sign, if its rate is known and not zero.

    `is_kink` is 1 if there is a kink, and 0 if there may be a jump.
    """
    if not (x.dlo > -INF and x.dhi < INF) or (x.dlo == 0.0 and x.dhi == 0.0):
        return
    counted = int_vector(x.at, at.N_INTEGERS)
    if counted[at.TIMED] == counted[at.WHICH]:
        first = float_vector(x.at, at.N_SLOTS)
        first[at.TIMED_LEAST] = x.lo - middle
        first[at.TIMED_MOST] = x.hi - middle
        first[at.TIMED_LEAST_RATE] = x.dlo
        first[at.TIMED_MOST_RATE] = x.dhi
        first[at.TIMED_KINK] = is_kink
    counted[at.TIMED] += 1


@kernel
def jump(x: Any, middle: float) -> None:
    """Note a jump where x - middle changes sign."""
    if x.at != 0:
        note_first(x, middle)
        note_time(x, middle, 0.0)
        int_vector(x.at, at.N_INTEGERS)[at.JUMPED] += 1


@kernel
def kink(x: Any, middle: float) -> None:
    """Note a kink where x - middle changes sign."""
    if x.at != 0:
        note_time(x, middle, 1.0)
        int_vector(x.at, at.N_INTEGERS)[at.KINKED] += 1


@kernel
def opened(x: Any, y: Any) -> Any:
    """Return the answer, 1 or 0, to a comparison that the ranges leave open."""
    apart = sound(subtract(x, y))
    if apart.at == 0:  # of numbers, which differ only by what they are widened
        return exactly(1.0 if x.lo + x.hi < y.lo + y.hi else 0.0, 0)
    if math.isnan(apart.lo):
        apart = anything(apart.at)
    note_first(apart, 0.0)
    note_time(apart, 0.0, 0.0)
    return exactly(next_answer(apart.at), 0)


@kernel
def next_answer(where: int) -> float:
    """Return the caller's next answer, 1 or 0, and count the question."""
    counted = int_vector(where, at.N_INTEGERS)
    place = counted[at.OPENED]
    counted[at.OPENED] += 1
    if place >= at.N_ANSWERS:
        return float((place * 2654435761 >> 16) & 1)
    return float((counted[at.ANSWERS] >> place) & 1)


# Pieces of ranges.


@kernel
def exactly(value: float, where: int) -> Any:
    """Return a constant."""
    return make(value, value, 0.0, 0.0, where)


@kernel
def anything(where: int) -> Any:
    """Return the range of all numbers and rates."""
    return make(-INF, INF, -INF, INF, where)


@kernel
def unknown(where: int) -> Any:
    """Return the range of what may not be a number."""
    return make(NAN, NAN, -INF, INF, where)


@kernel
def sound(x: Any) -> Any:
    """Return a range in which NaN stands for both ends, and for no rate."""
    if not x.lo <= x.hi:
        return unknown(x.at)
    if not x.dlo <= x.dhi:
        return make(x.lo, x.hi, -INF, INF, x.at)
    return x


@kernel
def rounded(lo: float, hi: float, error: float) -> Pair:
    """Return ends widened by a relative error."""
    return lo - error * abs(lo), hi + error * abs(hi)


@kernel
def closed(lo: float, hi: float) -> Pair:
    """Return the ends of a value after one operation, widened by its rounding.

    A single number is what the guard itself computes.
    """
    if lo == hi:
        return lo, hi
    return rounded(lo, hi, EPS)


@kernel
def is_constant(x: Any) -> bool:
    """Return whether a range is a single number that does not change."""
    return x.lo == x.hi and x.dlo == 0.0 and x.dhi == 0.0


@kernel
def product(a: float, b: float, c: float, d: float) -> Pair:
    """Return the product of [a, b] and [c, d]."""
    p = a * c
    q = a * d
    r = b * c
    s = b * d
    if math.isnan(p) or math.isnan(q) or math.isnan(r) or math.isnan(s):
        return NAN, NAN
    return closed(min(p, q, r, s), max(p, q, r, s))


@kernel
def total(x: Pair, y: Pair) -> Pair:
    """Return the sum of two ranges."""
    return rounded(x[0] + y[0], x[1] + y[1], EPS)


@kernel
def quotient(x: Pair, a: float, b: float) -> Pair:
    """Return x over [a, b], which has one sign."""
    p = x[0] / a
    q = x[0] / b
    r = x[1] / a
    s = x[1] / b
    if math.isnan(p) or math.isnan(q) or math.isnan(r) or math.isnan(s):
        return NAN, NAN
    return closed(min(p, q, r, s), max(p, q, r, s))


@kernel
def with_slope(x: Any, value: Pair, slope: Pair) -> Any:
    """Return f(x) from the ranges of f and its derivative over x."""
    dlo, dhi = product(slope[0], slope[1], x.dlo, x.dhi)
    return make(value[0], value[1], dlo, dhi, x.at)


@kernel
def square_of(a: float, b: float) -> Pair:
    """Return the square of [a, b]."""
    p = a * a
    q = b * b
    lo, hi = rounded(min(p, q), max(p, q), EPS)
    if a < 0.0 < b:
        lo = 0.0
    return lo, hi


# Arithmetic.


@kernel
def subtract(x: Any, y: Any) -> Any:
    """Return x - y."""
    lo, hi = closed(x.lo - y.hi, x.hi - y.lo)
    dlo, dhi = rounded(x.dlo - y.dhi, x.dhi - y.dlo, EPS)
    return make(lo, hi, dlo, dhi, x.at | y.at)


@kernel
def multiply(x: Any, y: Any) -> Any:
    """Return x y."""
    lo, hi = product(x.lo, x.hi, y.lo, y.hi)
    of_x = product(x.dlo, x.dhi, y.lo, y.hi)
    of_y = product(x.lo, x.hi, y.dlo, y.dhi)
    dlo, dhi = total(of_x, of_y)
    return make(lo, hi, dlo, dhi, x.at | y.at)


@kernel
def divide(x: Any, y: Any) -> Any:
    """Return x / y, which jumps across a pole."""
    if not (y.lo > 0.0 or y.hi < 0.0):
        jump(y, 0.0)
        if x.lo <= 0.0 <= x.hi:  # 0 / 0
            return unknown(x.at | y.at)
        return anything(x.at | y.at)
    lo, hi = quotient((x.lo, x.hi), y.lo, y.hi)
    # (x / y)' = (x' - (x / y) y') / y
    a, b = product(lo, hi, y.dlo, y.dhi)
    above = rounded(x.dlo - b, x.dhi - a, EPS)
    dlo, dhi = quotient(above, y.lo, y.hi)
    return make(lo, hi, dlo, dhi, x.at | y.at)


@kernel
def natural_power(a: float, b: float, n: int) -> Pair:
    """Return [a, b] to the power n >= 0."""
    p = a**n
    q = b**n
    lo, hi = rounded(min(p, q), max(p, q), (n + 4) * EPS)
    if n % 2 == 0 and n > 0 and a < 0.0 < b:
        lo = 0.0
    return lo, hi


@kernel
def whole_power(x: Any, exponent: Any) -> Any:
    """Return x to the power of an integer."""
    n = int(exponent.lo)
    if n == 0:
        return exactly(1.0, x.at)
    m = abs(n)
    below = natural_power(x.lo, x.hi, m - 1)
    slope = rounded(m * below[0], m * below[1], EPS)
    power = with_slope(x, natural_power(x.lo, x.hi, m), slope)
    if n > 0:
        return power
    if not (x.lo > 0.0 or x.hi < 0.0):
        jump(x, 0.0)
        return anything(x.at)
    return divide(exactly(1.0, x.at), power)


# Kinks.


@kernel
def least(x: Any, y: Any) -> Any:
    """Return the lesser of x and y."""
    where = x.at | y.at
    if x.hi <= y.lo:
        return make(x.lo, x.hi, x.dlo, x.dhi, where)
    if y.hi <= x.lo:
        return make(y.lo, y.hi, y.dlo, y.dhi, where)
    kink(subtract(x, y), 0.0)
    lo = min(x.lo, y.lo)
    hi = min(x.hi, y.hi)
    return make(lo, hi, min(x.dlo, y.dlo), max(x.dhi, y.dhi), where)


@kernel
def negative(x: Any) -> Any:
    """Return -x."""
    return make(-x.hi, -x.lo, -x.dhi, -x.dlo, x.at)


@kernel
def largest(x: Any, y: Any) -> Any:
    """Return the larger of x and y."""
    return negative(least(negative(x), negative(y)))


@kernel
def absolute(x: Any) -> Any:
    """Return |x|."""
    if x.lo >= 0.0:
        return x
    if x.hi <= 0.0:
        return negative(x)
    kink(x, 0.0)
    steepest = max(x.dhi, -x.dlo)
    return make(0.0, max(-x.lo, x.hi), -steepest, steepest, x.at)


# Jumps.


@kernel
def jumping(lo: float, hi: float, where: int) -> Any:
    """Return what jumps between two values."""
    return make(lo, hi, -INF, INF, where)


@kernel
def sign(x: Any) -> Any:
    """Return the sign of x, -1, 0 or 1."""
    if x.lo > 0.0 or x.hi < 0.0:
        return exactly(math.copysign(1.0, x.lo), x.at)
    if x.lo == 0.0 and x.hi == 0.0:
        return exactly(0.0, x.at)
    jump(x, 0.0)
    return jumping(-1.0, 1.0, x.at)


@kernel
def with_sign(x: Any, y: Any) -> Any:
    """Return |x| with the sign of y."""
    size = absolute(x)
    where = x.at | y.at
    if y.lo > 0.0:
        return make(size.lo, size.hi, size.dlo, size.dhi, where)
    if y.hi < 0.0:
        return make(-size.hi, -size.lo, -size.dhi, -size.dlo, where)
    jump(y, 0.0)
    return jumping(-size.hi, size.hi, where)


@kernel
def stair(x: Any, lo: float, hi: float, first: float) -> Any:
    """Return what is constant but for jumps, the first of them at `first`."""
    if lo == hi:
        return exactly(lo, x.at)
    jump(x, first)
    return jumping(lo, hi, x.at)


@kernel
def floor(x: Any) -> Any:
    """Return the largest whole number up to x."""
    lo = float(np.floor(x.lo))
    return stair(x, lo, float(np.floor(x.hi)), lo + 1.0)


@kernel
def ceil(x: Any) -> Any:
    """Return the least whole number from x on."""
    lo = float(np.ceil(x.lo))
    return stair(x, lo, float(np.ceil(x.hi)), lo)


@kernel
def trunc(x: Any) -> Any:
    """Return x without its fraction."""
    lo = float(np.trunc(x.lo))
    first = lo + 1.0
    if x.lo <= -1.0:
        first = lo
    return stair(x, lo, float(np.trunc(x.hi)), first)


@kernel
def rint(x: Any) -> Any:
    """Return the nearest whole number."""
    lo = float(np.rint(x.lo))
    return stair(x, lo, float(np.rint(x.hi)), lo + 0.5)


@kernel
def ratio(x: Any, y: Any) -> Any:
    """Return x / y, from which whole numbers are taken."""
    q = divide(x, y)
    lo, hi = rounded(q.lo, q.hi, EPS)
    return make(lo, hi, q.dlo, q.dhi, q.at)


@kernel
def without_wholes(x: Any, y: Any, wholes: Any) -> Any:
    """Return x - y n, where the whole number n jumps if its rate is unknown."""
    if wholes.lo == wholes.hi:
        return subtract(x, multiply(y, wholes))
    return jumping(-INF, INF, x.at | y.at)


@kernel
def rest(x: Any, y: Any) -> Any:
    """Return x % y."""
    if is_constant(x) and is_constant(y):
        return exactly(x.lo % y.lo, x.at | y.at)
    left = without_wholes(x, y, floor(ratio(x, y)))
    lo = left.lo
    hi = left.hi
    if y.lo > 0.0:
        lo = min(max(lo, 0.0), y.hi)
        hi = max(min(hi, y.hi), 0.0)
    elif y.hi < 0.0:
        lo = min(max(lo, y.lo), 0.0)
        hi = max(min(hi, 0.0), y.lo)
    return make(lo, hi, left.dlo, left.dhi, left.at)


@kernel
def rest_like_x(x: Any, y: Any) -> Any:
    """Return the rest of x / y with the sign of x, as `math.fmod`."""
    if is_constant(x) and is_constant(y):
        return exactly(np.fmod(x.lo, y.lo), x.at | y.at)
    left = without_wholes(x, y, trunc(ratio(x, y)))
    size = max(abs(y.lo), abs(y.hi))
    lo = -size
    hi = size
    if x.lo >= 0.0:
        lo = 0.0
    if x.hi <= 0.0:
        hi = 0.0
    lo = min(max(lo, left.lo), hi)
    hi = max(min(hi, left.hi), lo)
    return make(lo, hi, left.dlo, left.dhi, left.at)


@kernel
def whole_quotient(x: Any, y: Any) -> Any:
    """Return x // y."""
    if is_constant(x) and is_constant(y):
        return exactly(x.lo // y.lo, x.at | y.at)
    return floor(ratio(x, y))


@kernel
def one_whole(x: Any, wholes: Any) -> Any:
    """Return a whole number for an index or a count.

    Of two that are next to each other, the caller has the answer. All is lost if there
    may be more.
    """
    if wholes.lo == wholes.hi and abs(wholes.lo) < LARGEST_WHOLE:
        return wholes
    if x.at != 0 and wholes.hi - wholes.lo == 1.0 and abs(wholes.lo) < LARGEST_WHOLE:
        return exactly(wholes.lo + next_answer(x.at), x.at)
    if x.at != 0:
        int_vector(x.at, at.N_INTEGERS)[at.LOST] = 1
    if x.hi - x.lo < MOST_WHOLE:
        return exactly(float(np.trunc(0.5 * (x.lo + x.hi))), x.at)
    return exactly(0.0, x.at)


@kernel
def integer(x: Any, _: Any) -> Any:
    """Return int(x)."""
    return one_whole(x, trunc(x))


@kernel
def nearest_integer(x: Any, _: Any) -> Any:
    """Return round(x)."""
    return one_whole(x, rint(x))


@kernel
def table(x: Any, places: Any, values: Any, n: int) -> Any:
    """Return the piecewise linear interpolation of a table, as `np.interp`."""
    lo = INF
    hi = -INF
    slope_lo = INF
    slope_hi = -INF
    if x.lo < places[0] or n == 1:
        lo = values[0]
        hi = values[0]
        slope_lo = 0.0
        slope_hi = 0.0
    if x.hi > places[n - 1]:
        lo = min(lo, values[n - 1])
        hi = max(hi, values[n - 1])
        slope_lo = min(slope_lo, 0.0)
        slope_hi = max(slope_hi, 0.0)
    pieces = 0
    knot = places[0] if x.lo < places[0] else places[n - 1]
    for k in range(first_piece(x.lo, places, n), n - 1):
        if places[k] > x.hi:
            break
        width = places[k + 1] - places[k]
        slope = (values[k + 1] - values[k]) / width
        if not abs(slope) < INF:  # of a table with a jump
            jump(x, places[k])
            return unknown(x.at)
        if pieces == 0 and x.lo >= places[0]:
            knot = places[k + 1]
        pieces += 1
        start = values[k] + slope * (max(x.lo, places[k]) - places[k])
        end = values[k] + slope * (min(x.hi, places[k + 1]) - places[k])
        size = max(abs(values[k]), abs(values[k + 1]))
        lo = min(lo, min(start, end) - 2.0 * LIBM * size)
        hi = max(hi, max(start, end) + 2.0 * LIBM * size)
        slope_lo = min(slope_lo, slope)
        slope_hi = max(slope_hi, slope)
    goes_beyond = x.lo < places[0] or x.hi > places[n - 1]
    if pieces > 1 or (pieces > 0 and goes_beyond):
        kink(x, knot)
    return with_slope(x, (lo, hi), rounded(slope_lo, slope_hi, LIBM))


@kernel
def first_piece(x: float, places: Any, n: int) -> int:
    """Return the first piece of a table, k to k + 1, that ends at or after x."""
    low = 0
    high = n - 1
    while low < high:
        middle = (low + high) // 2
        if places[middle + 1] < x:
            low = middle + 1
        else:
            high = middle
    return low
