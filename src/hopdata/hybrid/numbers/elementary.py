# ruff: noqa: ARG001 (all operations have the same arguments)
"""Ranges and rates of the longer operations, compiled once for all guards.

The guards' code calls them through one function of C, `apply`, by the number of the
operation. A result is widened by the rounding of the operations that the guard itself
takes, with 4 units in the last place for elementary functions; underflow is neglected.
Where a number may not be one (outside of a function's domain), its range is NaN, and
so is that of all that is made of it.

Every function here takes ranges and returns one. The rate of f(x) is the range of f'
over x times the rate of x. `jump` and `kink` note in the memory of answers where a
value, or its rate, jumps.
"""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from numba import cfunc, types

from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid.compiled.digest import sources_digest
from hopdata.hybrid.compiled.kernel import ENTRY, kernel
from hopdata.hybrid.compiled.memory import float_vector, int_vector
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.numbers import answers as at
from hopdata.hybrid.numbers.ranges import make, put_range, range_at

Pair = tuple[float, float]

EPS = 2.0**-52
#: Relative error by which the range of an elementary function is widened.
#: Unit: 1. Origin: rounding: 4 units in the last place, which is assumed of the C
#: library (docs/integrator.md, Limits).
LIBM = 4.0 * EPS
INF = math.inf
NAN = math.nan
TURN = 2.0 * math.pi
LARGEST_WHOLE = 2.0**53  # floats below it hold every whole number

#: Widest range of numbers from which `int` still takes the middle; a loop may be as
#: long as that number.
#: Unit: 1. Origin: chosen.
MOST_WHOLE = 1024.0


class Operation(NamedTuple):
    """An operation: what it computes, and the functions that mean it."""

    function: Any
    keys: tuple[Any, ...]


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
def jump(x: Any, middle: float) -> None:
    """Note a jump where x - middle changes sign."""
    if x.at != 0:
        note_first(x, middle)
        int_vector(x.at, at.N_INTEGERS)[at.JUMPED] += 1


@kernel
def kink(where: int) -> None:
    """Note a kink."""
    if where != 0:
        int_vector(where, at.N_INTEGERS)[at.KINKED] += 1


@kernel
def opened(x: Any, y: Any) -> Any:
    """Return the answer, 1 or 0, to a comparison that the ranges leave open."""
    apart = sound(subtract(x, y))
    if apart.at == 0:  # of numbers, which differ only by what they are widened
        return exactly(1.0 if x.lo + x.hi < y.lo + y.hi else 0.0, 0)
    if math.isnan(apart.lo):
        apart = anything(apart.at)
    note_first(apart, 0.0)
    counted = int_vector(apart.at, at.N_INTEGERS)
    place = counted[at.OPENED]
    counted[at.OPENED] += 1
    if place >= at.N_ANSWERS:
        return exactly(float((place * 2654435761 >> 16) & 1), 0)
    return exactly(float((counted[at.ANSWERS] >> place) & 1), 0)


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


@kernel
def real_power(x: Any, y: Any) -> Any:
    """Return x to a power that need not be whole; it is not known at x < 0."""
    where = x.at | y.at
    is_number = is_constant(y)
    if is_number and y.lo == math.floor(y.lo) and abs(y.lo) < 2.0**31:
        return whole_power(x, y)
    if x.lo < 0.0 or (x.lo == 0.0 and not y.lo > 0.0) or math.isinf(x.hi):
        jump(x, 0.0)
        return unknown(where)
    a = x.lo**y.lo
    b = x.lo**y.hi
    c = x.hi**y.lo
    d = x.hi**y.hi
    lo, hi = rounded(min(a, b, c, d), max(a, b, c, d), LIBM)
    if x.lo == 0.0:
        kink(where)
    if is_number:  # y x^(y - 1) x'
        e = a / x.lo
        if x.lo == 0.0:
            e = 0.0 if y.lo > 1.0 else INF
        f = c / x.hi
        e, f = rounded(min(e, f), max(e, f), 2.0 * LIBM)
        slope = product(y.lo, y.lo, e, f)
        return with_slope(make(x.lo, x.hi, x.dlo, x.dhi, where), (lo, hi), slope)
    # (x^y)' = x^y (y log(x))'
    exponent = multiply(y, natural_logarithm(x))
    dlo, dhi = product(lo, hi, exponent.dlo, exponent.dhi)
    return make(lo, hi, dlo, dhi, where)


# Kinks.


@kernel
def least(x: Any, y: Any) -> Any:
    """Return the lesser of x and y."""
    where = x.at | y.at
    if x.hi <= y.lo:
        return make(x.lo, x.hi, x.dlo, x.dhi, where)
    if y.hi <= x.lo:
        return make(y.lo, y.hi, y.dlo, y.dhi, where)
    kink(where)
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
    kink(x.at)
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
    """Return a whole number for an index or a count; all is lost if it may vary."""
    if wholes.lo == wholes.hi and abs(wholes.lo) < LARGEST_WHOLE:
        return wholes
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
    for k in range(first_piece(x.lo, places, n), n - 1):
        if places[k] > x.hi:
            break
        width = places[k + 1] - places[k]
        slope = (values[k + 1] - values[k]) / width
        if not abs(slope) < INF:  # of a table with a jump
            jump(x, places[k])
            return unknown(x.at)
        pieces += 1
        start = values[k] + slope * (max(x.lo, places[k]) - places[k])
        end = values[k] + slope * (min(x.hi, places[k + 1]) - places[k])
        size = max(abs(values[k]), abs(values[k + 1]))
        lo = min(lo, min(start, end) - 2.0 * LIBM * size)
        hi = max(hi, max(start, end) + 2.0 * LIBM * size)
        slope_lo = min(slope_lo, slope)
        slope_hi = max(slope_hi, slope)
    if pieces > 1 or x.lo < places[0] or x.hi > places[n - 1]:
        kink(x.at)
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


# Smooth functions.

# How the derivative goes over a function's domain.
RISES = 1
FALLS = 2
CREST_AT_ZERO = 3
TROUGH_AT_ZERO = 4


def _rising(
    function: Callable[[float], float],
    derivative: Callable[[float], float],
    way: int,
    low: float = -INF,
    high: float = INF,
) -> Any:
    """Return a rising function between two numbers; beyond them nothing is known."""
    slope_of = kernel(derivative)

    @kernel
    def rising(x: Any) -> Any:
        if not (x.lo >= low and x.hi <= high):
            jump(x, low if x.lo < low else high)
            return unknown(x.at)
        if x.lo == low or x.hi == high:
            kink(x.at)
        lo, hi = rounded(function(x.lo), function(x.hi), LIBM)
        a = slope_of(x.lo)
        b = slope_of(x.hi)
        slope = (min(a, b), max(a, b))
        if x.lo < 0.0 < x.hi:
            if way == CREST_AT_ZERO:
                slope = (slope[0], slope_of(0.0))
            if way == TROUGH_AT_ZERO:
                slope = (slope_of(0.0), slope[1])
        # Rounding within a derivative such as exp(-x * x) grows with its argument.
        size = min(max(abs(x.lo), abs(x.hi)), 32.0)
        error = LIBM * (4.0 + size * size)
        return with_slope(x, (lo, hi), rounded(slope[0], slope[1], error))

    return rising


_exp = math.exp
_cosh = math.cosh
_sqrt = math.sqrt
_cbrt = np.cbrt
LOG_2 = math.log(2.0)
LOG_10 = math.log(10.0)
OF_ERF = 2.0 / math.sqrt(math.pi)


def _slope_of_exp(x: float) -> float:
    return math.exp(x)


def _slope_of_sinh(x: float) -> float:
    return math.cosh(x)


exponential = _rising(math.exp, _slope_of_exp, RISES)
exponential_less_1 = _rising(math.expm1, _slope_of_exp, RISES)
hyperbolic_sine = _rising(math.sinh, _slope_of_sinh, TROUGH_AT_ZERO)
hyperbolic_tangent = _rising(
    math.tanh, lambda x: 1.0 / (_cosh(x) * _cosh(x)), CREST_AT_ZERO
)
arc_tangent = _rising(math.atan, lambda x: 1.0 / (1.0 + x * x), CREST_AT_ZERO)
area_sine = _rising(math.asinh, lambda x: 1.0 / _sqrt(1.0 + x * x), CREST_AT_ZERO)


def _power_of_2(x: float) -> float:
    return 2.0**x


def _slope_of_power_of_2(x: float) -> float:
    return LOG_2 * 2.0**x


power_of_2 = _rising(kernel(_power_of_2), _slope_of_power_of_2, RISES)
error_function = _rising(math.erf, lambda x: OF_ERF * _exp(-x * x), CREST_AT_ZERO)
cube_root = _rising(np.cbrt, lambda x: 1.0 / (3.0 * _cbrt(x) * _cbrt(x)), CREST_AT_ZERO)
natural_logarithm = _rising(math.log, lambda x: 1.0 / x, FALLS, 0.0)
binary_logarithm = _rising(math.log2, lambda x: 1.0 / (LOG_2 * x), FALLS, 0.0)
decimal_logarithm = _rising(math.log10, lambda x: 1.0 / (LOG_10 * x), FALLS, 0.0)
logarithm_of_1_more = _rising(math.log1p, lambda x: 1.0 / (1.0 + x), FALLS, -1.0)
square_root = _rising(math.sqrt, lambda x: 0.5 / _sqrt(x), FALLS, 0.0)
arc_sine = _rising(
    math.asin, lambda x: 1.0 / _sqrt((1.0 - x) * (1.0 + x)), TROUGH_AT_ZERO, -1.0, 1.0
)
area_cosine = _rising(
    math.acosh, lambda x: 1.0 / _sqrt((x - 1.0) * (x + 1.0)), FALLS, 1.0
)
area_tangent = _rising(
    math.atanh, lambda x: 1.0 / ((1.0 - x) * (1.0 + x)), TROUGH_AT_ZERO, -1.0, 1.0
)


@kernel
def complement_of_it(x: Any) -> Any:
    """Return erfc(x)."""
    turned = error_function(x)
    lo, hi = rounded(math.erfc(x.hi), math.erfc(x.lo), LIBM)
    return make(lo, hi, -turned.dhi, -turned.dlo, x.at)


@kernel
def arc_cosine(x: Any) -> Any:
    """Return acos(x)."""
    turned = arc_sine(x)
    if math.isnan(turned.lo):
        return turned
    lo, hi = rounded(math.acos(x.hi), math.acos(x.lo), LIBM)
    return make(lo, hi, -turned.dhi, -turned.dlo, x.at)


@kernel
def hyperbolic_cosine(x: Any) -> Any:
    """Return cosh(x)."""
    a = math.cosh(x.lo)
    b = math.cosh(x.hi)
    lo, hi = rounded(min(a, b), max(a, b), LIBM)
    if x.lo < 0.0 < x.hi:
        lo = 1.0
    return with_slope(x, (lo, hi), rounded(math.sinh(x.lo), math.sinh(x.hi), LIBM))


@kernel
def wave(x: Any, a: float, b: float, crest: float) -> Pair:
    """Return the range of a wave of this value at both ends, and a crest there."""
    if not x.hi - x.lo < TURN:
        return -1.0, 1.0
    lo, hi = rounded(min(a, b), max(a, b), LIBM)
    grain = 8.0 * EPS * (1.0 + abs(x.lo) + abs(x.hi))
    first = (x.lo - crest) / TURN - grain
    last = (x.hi - crest) / TURN + grain
    # A trough or a crest in between?
    if math.floor(last + 0.5) > math.floor(first + 0.5):
        lo = -1.0
    if math.floor(last) > math.floor(first):
        hi = 1.0
    return max(lo, -1.0), min(hi, 1.0)


@kernel
def sine_and_cosine(x: Any) -> tuple[Pair, Pair]:
    """Return the ranges of sin(x) and cos(x)."""
    sine_of = wave(x, math.sin(x.lo), math.sin(x.hi), 0.5 * math.pi)
    cosine_of = wave(x, math.cos(x.lo), math.cos(x.hi), 0.0)
    return sine_of, cosine_of


@kernel
def sine(x: Any) -> Any:
    """Return sin(x)."""
    sine_of, cosine_of = sine_and_cosine(x)
    return with_slope(x, sine_of, cosine_of)


@kernel
def cosine(x: Any) -> Any:
    """Return cos(x)."""
    sine_of, cosine_of = sine_and_cosine(x)
    return with_slope(x, cosine_of, (-sine_of[1], -sine_of[0]))


@kernel
def tangent(x: Any) -> Any:
    """Return tan(x), which jumps across a pole."""
    grain = 8.0 * EPS * (1.0 + abs(x.lo) + abs(x.hi))
    first = math.floor(x.lo / math.pi + 0.5 - grain)
    last = math.floor(x.hi / math.pi + 0.5 + grain)
    if first != last or not x.hi - x.lo < math.pi:
        jump(x, (first + 0.5) * math.pi)
        return anything(x.at)
    lo, hi = rounded(math.tan(x.lo), math.tan(x.hi), LIBM)
    a, b = square_of(lo, hi)
    return with_slope(x, (lo, hi), rounded(1.0 + a, 1.0 + b, EPS))


@kernel
def angle(y: Any, x: Any) -> Any:
    """Return atan2(y, x), which jumps across the negative x axis."""
    where = x.at | y.at
    if not (x.lo > 0.0 or y.lo > 0.0 or y.hi < 0.0):
        jump(y, 0.0)
        return jumping(-math.pi * (1.0 + LIBM), math.pi * (1.0 + LIBM), where)
    a = math.atan2(y.lo, x.lo)
    b = math.atan2(y.lo, x.hi)
    c = math.atan2(y.hi, x.lo)
    d = math.atan2(y.hi, x.hi)
    lo, hi = rounded(min(a, b, c, d), max(a, b, c, d), LIBM)
    # (x y' - y x') / (x^2 + y^2)
    size = total(square_of(x.lo, x.hi), square_of(y.lo, y.hi))
    of_y = product(x.lo, x.hi, y.dlo, y.dhi)
    of_x = product(y.lo, y.hi, x.dlo, x.dhi)
    turning = rounded(of_y[0] - of_x[1], of_y[1] - of_x[0], EPS)
    dlo = -INF
    dhi = INF
    if size[0] > 0.0:
        dlo, dhi = quotient(turning, size[0], size[1])
    return make(lo, hi, dlo, dhi, where)


@kernel
def length(x: Any, y: Any) -> Any:
    """Return the hypotenuse of x and y."""
    where = x.at | y.at
    across = absolute(make(x.lo, x.hi, 0.0, 0.0, 0))
    along = absolute(make(y.lo, y.hi, 0.0, 0.0, 0))
    lo, hi = rounded(
        math.hypot(across.lo, along.lo), math.hypot(across.hi, along.hi), LIBM
    )
    fastest_x = max(x.dhi, -x.dlo)
    fastest_y = max(y.dhi, -y.dlo)
    fastest = math.hypot(fastest_x, fastest_y) * (1.0 + LIBM)
    if not lo > 0.0:
        kink(where)
        return make(lo, hi, -fastest, fastest, where)
    # (x x' + y y') / length
    of_x = product(x.lo, x.hi, x.dlo, x.dhi)
    of_y = product(y.lo, y.hi, y.dlo, y.dhi)
    dlo, dhi = quotient(total(of_x, of_y), lo, hi)
    return make(lo, hi, max(dlo, -fastest), min(dhi, fastest), where)


# The operations, and what they stand for. Their order is their number.


def _of_math(name: str) -> tuple[Any, ...]:
    """Return a function of `math` that not all versions of Python have."""
    found = getattr(math, name, None)
    return () if found is None else (found,)


ONE = {
    "absolute": Operation(absolute, (abs, np.abs, np.fabs, math.fabs)),
    "sign": Operation(sign, (np.sign,)),
    "floor": Operation(floor, (math.floor, np.floor)),
    "ceil": Operation(ceil, (math.ceil, np.ceil)),
    "trunc": Operation(trunc, (math.trunc, np.trunc)),
    "rint": Operation(rint, (np.rint,)),
    "exponential": Operation(exponential, (math.exp, np.exp)),
    "power_of_2": Operation(power_of_2, (np.exp2, *_of_math("exp2"))),
    "exponential_less_1": Operation(exponential_less_1, (math.expm1, np.expm1)),
    "hyperbolic_sine": Operation(hyperbolic_sine, (math.sinh, np.sinh)),
    "hyperbolic_cosine": Operation(hyperbolic_cosine, (math.cosh, np.cosh)),
    "hyperbolic_tangent": Operation(hyperbolic_tangent, (math.tanh, np.tanh)),
    "arc_sine": Operation(arc_sine, (math.asin, np.arcsin)),
    "arc_cosine": Operation(arc_cosine, (math.acos, np.arccos)),
    "arc_tangent": Operation(arc_tangent, (math.atan, np.arctan)),
    "area_sine": Operation(area_sine, (math.asinh, np.arcsinh)),
    "area_cosine": Operation(area_cosine, (math.acosh, np.arccosh)),
    "area_tangent": Operation(area_tangent, (math.atanh, np.arctanh)),
    "error_function": Operation(error_function, (math.erf,)),
    "complement_of_it": Operation(complement_of_it, (math.erfc,)),
    "square_root": Operation(square_root, (math.sqrt, np.sqrt)),
    "cube_root": Operation(cube_root, (np.cbrt, *_of_math("cbrt"))),
    "natural_logarithm": Operation(natural_logarithm, (math.log, np.log)),
    "binary_logarithm": Operation(binary_logarithm, (math.log2, np.log2)),
    "decimal_logarithm": Operation(decimal_logarithm, (math.log10, np.log10)),
    "logarithm_of_1_more": Operation(logarithm_of_1_more, (math.log1p, np.log1p)),
    "sine": Operation(sine, (math.sin, np.sin)),
    "cosine": Operation(cosine, (math.cos, np.cos)),
    "tangent": Operation(tangent, (math.tan, np.tan)),
}
TWO = {
    "divide": Operation(divide, ()),
    "whole_power": Operation(whole_power, ()),
    "real_power": Operation(real_power, ()),
    "least": Operation(least, (min, np.minimum, np.fmin)),
    "largest": Operation(largest, (max, np.maximum, np.fmax)),
    "with_sign": Operation(with_sign, (math.copysign, np.copysign)),
    "rest": Operation(rest, ()),
    "rest_like_x": Operation(rest_like_x, (math.fmod, np.fmod)),
    "whole_quotient": Operation(whole_quotient, (np.floor_divide,)),
    "angle": Operation(angle, (math.atan2, np.arctan2)),
    "length": Operation(length, (math.hypot, np.hypot)),
}
# These have a result even for what may not be a number.
OF_ANYTHING = {
    "integer": Operation(integer, ()),
    "nearest_integer": Operation(nearest_integer, ()),
    "opened": Operation(opened, ()),
}
NAMES = (*ONE, *TWO, *OF_ANYTHING, "table")
NUMBERS = {name: place for place, name in enumerate(NAMES)}


# All of them in one function of C.

APPLY_NATIVE = types.void(*(5 * [types.int64]))


@kernel
def read(address: int, where: int) -> Any:
    """Return the range at an address."""
    return sound(range_at(address, where))


@kernel
def write(x: Any, address: int) -> None:
    """Write a range to an address."""
    put_range(sound(x), address)


@kernel
def look_up(x: Any, given: int) -> Any:
    """Return a table's value: addresses of places and values, and their number."""
    table_at = int_vector(given, 3)
    n = table_at[2]
    if n < 1:
        return unknown(x.at)
    places = float_vector(table_at[0], n)
    values = float_vector(table_at[1], n)
    return table(x, places, values, n)


# Each operation with addresses for arguments. So its caller needs no room for results,
# which Numba would clear for all operations at each call.


def _with_one(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        x = read(x_at, where)
        if math.isnan(x.lo):
            write(unknown(where), result)
        else:
            write(function(x), result)

    return run


def _with_two(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        x = read(x_at, where)
        y = read(y_at, where)
        if math.isnan(x.lo) or math.isnan(y.lo):
            write(unknown(where), result)
        else:
            write(function(x, y), result)

    return run


def _with_anything(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        write(function(read(x_at, where), read(y_at, where)), result)

    return run


@kernel
def _with_table(x_at: int, y_at: int, where: int, result: int) -> None:
    x = read(x_at, where)
    if math.isnan(x.lo):
        write(unknown(where), result)
    else:
        write(look_up(x, y_at), result)


ARGUMENTS = "number, x_at, y_at, where, result"
GROUP = 8  # operations in one function: few, because each clears some memory


def _runs() -> list[Any]:
    """Return all operations, in the order of their numbers."""
    runs = [_with_one(one.function) for one in ONE.values()]
    runs += [_with_two(two.function) for two in TWO.values()]
    runs += [_with_anything(one.function) for one in OF_ANYTHING.values()]
    return [*runs, _with_table]


def _choice(name: str, value: str, chosen: list[Any], arguments: str) -> Any:
    """Return a function that calls one of some functions, by a number."""
    body = []
    for place in range(len(chosen)):
        body.append(f"if {value} == {place}: run_{place}({arguments})")
    known = {f"run_{place}": run for place, run in enumerate(chosen)}
    return compose(name, ARGUMENTS, body, known)


def _apply() -> Any:
    """Return the function of C, before it is compiled.

    It takes the number of an operation; addresses of one or two ranges (or of the parts
    of a table); the address of the memory of answers; and the address of the result.
    """
    runs = _runs()
    groups = []
    for first in range(0, len(runs), GROUP):
        some = runs[first : first + GROUP]
        value = f"number % {GROUP}"
        groups.append(kernel(_choice("some", value, some, "x_at, y_at, where, result")))
    return _choice("apply", f"number // {GROUP}", groups, ARGUMENTS)


@cache
def library() -> str:
    """Load the function of C, and return the name by which the guards' code calls it.

    The name changes with its sources, so that kept code calls no other.
    """
    digest = sources_digest(Path(__file__).parents[1], "numbers")
    function = _apply()

    def compile_it(cached: bool) -> Any:
        return cfunc(APPLY_NATIVE, cache=cached, **ENTRY)(function)

    compiled = compiled_in_cache(function, digest, compile_it)
    name = f"hopdata_ranges_{digest}"
    llvm.add_symbol(name, compiled.address)
    _LOADED.append(compiled)
    return name


_LOADED: list[Any] = []  # keeps the machine code in memory
