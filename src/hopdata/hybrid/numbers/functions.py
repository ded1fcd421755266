"""Ranges and rates of smooth functions, widened by 4 units in the last place.

They are as those of `numbers.arithmetic`. At the end of a domain a slope may be
infinite; beyond it nothing is known.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.numbers.arithmetic import (
    EPS,
    INF,
    LIBM,
    TURN,
    Pair,
    absolute,
    anything,
    is_constant,
    jump,
    jumping,
    kink,
    multiply,
    product,
    quotient,
    rounded,
    square_of,
    total,
    unknown,
    whole_power,
    with_slope,
)
from hopdata.hybrid.numbers.ranges import make

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
            kink(x, low if x.lo == low else high)
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
        kink(y if is_constant(x) else x, 0.0)
        return make(lo, hi, -fastest, fastest, where)
    # (x x' + y y') / length
    of_x = product(x.lo, x.hi, x.dlo, x.dhi)
    of_y = product(y.lo, y.hi, y.dlo, y.dhi)
    dlo, dhi = quotient(total(of_x, of_y), lo, hi)
    return make(lo, hi, max(dlo, -fastest), min(dhi, fastest), where)


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
        kink(x, 0.0)
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
