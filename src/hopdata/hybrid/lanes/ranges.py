# ruff: noqa: ARG001, ARG002, ARG005, PLW0108 (Numba prescribes signatures and their names)
"""A Numba type of ranges in lanes, for which guards compile as they are.

Each lane has a range of a value and one of its rate of change, as in `numbers.ranges`.
A guard that needs other operations than those below, or branches, has no such code, and
each of its steps is proven by the driver's kernel. NaN stands for anything: a product
with infinity, a quotient by a range that contains zero.

At a single place, all ranges of values are points, and their rates are exact: so guards
that return only values have their rates from here, too.
"""

import builtins
import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import (
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    overload_attribute,
    register_model,
)

from hopdata.hybrid.compiled.memory import NumberLike, built, is_number
from hopdata.hybrid.lanes.vectors import (
    ALIGNMENT,
    INDEX,
    VECTOR,
    absolute,
    ceil,
    cosine,
    exponential,
    floor,
    lanes,
    largest,
    least,
    logarithm,
    number_for_all,
    sine,
    spread,
    square_root,
    where,
)
from hopdata.private_numba import tried_first

EPS = 2.0**-52
TINY = 1e-300

#: Error of a sine of lanes.
#: Unit: 1. Origin: rounding: 16 units in the last place of one; it errs by two.
SINE_ERROR = 16.0 * EPS

#: Error of an exponential or a logarithm of the C library, as a fraction of its value.
#: Unit: 1. Origin: rounding: 4 units in the last place; they err by one.
LIBRARY_ERROR = 4.0 * EPS

ENDS = ("lo", "hi", "dlo", "dhi")


def _is_number(kind: Any) -> bool:
    """Return whether a type is that of numbers, of one or of all lanes."""
    return is_number(kind) or kind == lanes


class _LaneRange(NumberLike):
    is_kept = False  # see `code_cache`

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Return whether another type converts to this one, as numbers do."""
        kind = types.float64 if other == lanes else other
        return super().can_convert_from(context, kind)

    def unify(self, context: Any, other: Any) -> Any:
        """Return the type of a variable that holds values of both types."""
        return self if _is_number(other) else None


class RangeRows(types.Type):
    """The type of ranges by address, four rows of lanes each.

    If not `known`, all of them are anything.
    """

    is_kept = False

    def __init__(self, length: int, known: bool = True) -> None:
        self.length = length
        self.known = known
        super().__init__(name=f"RangeRows({length}, {known})")


class Unread(types.Type):
    """The type of an array of this length that forgets what is written to it."""

    is_kept = False

    def __init__(self, length: int) -> None:
        self.length = length
        super().__init__(name=f"Unread({length})")


lane_range = _LaneRange("LaneRange")


@register_model(_LaneRange)
class _RangeModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [(name, lanes) for name in ENDS])


@register_model(RangeRows)
class _RowsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR.as_pointer())


@register_model(Unread)
class _UnreadModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.IntType(64))


for _name in ENDS:
    make_attribute_wrapper(_LaneRange, _name, _name)


def _make(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    made = ir.Constant(context.get_value_type(lane_range), ir.Undefined)
    for place, value in enumerate(values):
        made = builder.insert_value(made, value, place)
    return made


make = built(4, lambda *_: (lane_range(lanes, lanes, lanes, lanes), _make))


def _rows(length: int, known: bool = True) -> Any:
    """Return a function that takes lanes by address as ranges."""
    kind = RangeRows(length, known)
    return built(
        1, lambda one: (kind(one), lambda context, builder, sign, values: values[0])
    )


ranges_of = _rows


def _no_rows(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return ir.Constant(ir.IntType(64), 0)


def nothing_of(length: int) -> Any:
    """Return a function of any number that gives an array to forget."""
    kind = Unread(length)
    return built(1, lambda one: (kind(one), _no_rows))


def _typed_get(owner: Any, index: Any) -> Any:
    if isinstance(owner, RangeRows) and isinstance(index, types.Integer):
        return lane_range(owner, INDEX)
    return None


def _typed_set(owner: Any, index: Any, value: Any) -> Any:
    kind = types.unliteral(value)
    if not isinstance(index, types.Integer):
        return None
    if isinstance(owner, Unread):
        return types.none(owner, INDEX, kind)
    if isinstance(owner, RangeRows) and (kind == lane_range or _is_number(kind)):
        return types.none(owner, INDEX, kind)
    return None


tried_first(operator.getitem, _typed_get)
tried_first(operator.setitem, _typed_set)


def _slots(builder: Any, rows: Any, address: Any, index: Any) -> Any:
    length = ir.Constant(index.type, rows.length)
    negative = builder.icmp_signed("<", index, ir.Constant(index.type, 0))
    index = builder.select(negative, builder.add(index, length), index)
    first = builder.mul(index, ir.Constant(index.type, len(ENDS)))
    for place in range(len(ENDS)):
        one = builder.add(first, ir.Constant(index.type, place))
        yield builder.gep(address, [one], inbounds=True)


@lower_builtin(operator.getitem, RangeRows, types.Integer)
def _get_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    ends = []
    for slot in _slots(builder, sign.args[0], *values):
        value = builder.load(slot)
        value.align = ALIGNMENT // 2
        if not sign.args[0].known:
            value = ir.Constant(VECTOR, [math.nan] * VECTOR.count)
        ends.append(value)
    return _make(context, builder, sign, ends)


def _as_range(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build a range from a range, or from numbers that do not vary."""
    if kind == lane_range:
        return value
    one = number_for_all(builder, types.unliteral(kind), value)
    zero = ir.Constant(VECTOR, [0.0] * VECTOR.count)
    return _make(context, builder, None, (one, one, zero, zero))


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _as_range(context, builder, given, value)


_NUMBERS = (types.Float, types.Integer, types.IntegerLiteral, types.Boolean)
for _number in (*_NUMBERS, type(lanes)):
    lower_cast(_number, _LaneRange)(_cast)


@lower_builtin(operator.setitem, RangeRows, types.Integer, types.Any)
def _set_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    ranged = _as_range(context, builder, sign.args[2], values[2])
    for place, slot in enumerate(_slots(builder, sign.args[0], *values[:2])):
        stored = builder.store(builder.extract_value(ranged, place), slot)
        stored.align = ALIGNMENT // 2
    return context.get_dummy_value()


@lower_builtin(operator.setitem, Unread, types.Integer, types.Any)
def _forget_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return context.get_dummy_value()


def _length(rows: Any) -> Any:
    if not isinstance(rows, RangeRows | Unread):
        return None
    count = rows.length
    return lambda rows: count


overload(len)(lambda rows: _length(rows))
overload_attribute(RangeRows, "size")(lambda rows: _length(rows))
overload_attribute(Unread, "size")(lambda rows: _length(rows))


# Intervals: pairs of lanes. Each result is one unit in the last place wider, which is
# more than its rounding.


@njit
def wider(lo: Any, hi: Any) -> Any:
    """Return an interval that is wider by rounding."""
    return lo - (EPS * absolute(lo) + TINY), hi + (EPS * absolute(hi) + TINY)


@njit
def product(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return the product of the intervals [a, b] and [c, d]."""
    p = a * c
    q = a * d
    r = b * c
    s = b * d
    anything = 0.0 * (p + q + r + s)  # NaN if one of them is not finite
    lo = least(least(p, q), least(r, s)) + anything
    hi = largest(largest(p, q), largest(r, s)) + anything
    return wider(lo, hi)


@njit
def multiple(a: Any, b: Any, y: Any) -> Any:
    """Return the product of the interval [a, b] and lanes or a number."""
    p = a * y
    q = b * y
    anything = 0.0 * (p + q)
    return wider(least(p, q) + anything, largest(p, q) + anything)


@njit
def total(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return the sum of the intervals [a, b] and [c, d]."""
    return wider(a + c, b + d)


@njit
def scaled(x: Any, lo: Any, hi: Any, dlo: Any, dhi: Any) -> Any:
    """Return the range with this value, and with the rate of x times [dlo, dhi]."""
    low, high = product(x.dlo, x.dhi, dlo, dhi)
    return make(lo, hi, low, high)


@njit
def added(x: Any, y: Any) -> Any:
    """Return the sum of two ranges."""
    lo, hi = total(x.lo, x.hi, y.lo, y.hi)
    dlo, dhi = total(x.dlo, x.dhi, y.dlo, y.dhi)
    return make(lo, hi, dlo, dhi)


@njit
def negated(x: Any) -> Any:
    """Return a range with the other sign."""
    return make(-x.hi, -x.lo, -x.dhi, -x.dlo)


@njit
def subtracted(x: Any, y: Any) -> Any:
    """Return the difference of two ranges."""
    return added(x, negated(y))


@njit
def multiplied(x: Any, y: Any) -> Any:
    """Return the product of two ranges."""
    lo, hi = product(x.lo, x.hi, y.lo, y.hi)
    a, b = product(x.dlo, x.dhi, y.lo, y.hi)
    c, d = product(x.lo, x.hi, y.dlo, y.dhi)
    dlo, dhi = total(a, b, c, d)
    return make(lo, hi, dlo, dhi)


@njit
def shifted(x: Any, y: Any) -> Any:
    """Return the sum of a range and lanes or a number."""
    lo, hi = wider(x.lo + y, x.hi + y)
    return make(lo, hi, x.dlo, x.dhi)


@njit
def stretched(x: Any, y: Any) -> Any:
    """Return the product of a range and lanes or a number."""
    lo, hi = multiple(x.lo, x.hi, y)
    dlo, dhi = multiple(x.dlo, x.dhi, y)
    return make(lo, hi, dlo, dhi)


@njit
def inverse(x: Any) -> Any:
    """Return one over a range; anything, if it contains zero."""
    has_sign = (x.lo > 0.0) | (x.hi < 0.0)
    lo, hi = wider(1.0 / x.hi, 1.0 / x.lo)
    lo = where(has_sign, lo, math.nan)
    hi = where(has_sign, hi, math.nan)
    a, b = product(lo, hi, lo, hi)
    return scaled(x, lo, hi, -b, -a)


@njit
def square(x: Any) -> Any:
    """Return the square of a range."""
    nearest = least(absolute(x.lo), absolute(x.hi))
    nearest = where((x.lo > 0.0) | (x.hi < 0.0), nearest, 0.0)
    farthest = largest(absolute(x.lo), absolute(x.hi))
    anything = 0.0 * (x.lo + x.hi)
    lo, hi = wider(nearest * nearest, farthest * farthest)
    return scaled(x, lo + anything, hi + anything, 2.0 * x.lo, 2.0 * x.hi)


@njit
def whole_power(x: Any, n: int) -> Any:
    """Return a range to the power of an integer; anything, if that is negative."""
    result = make(spread(1.0), spread(1.0), spread(0.0), spread(0.0))
    for _ in range(n // 2):
        result = multiplied(result, square(x))
    if n % 2 == 1:
        result = multiplied(result, x)
    if n < 0:
        return stretched(result, math.nan)
    return result


@njit
def size(x: Any) -> Any:
    """Return the absolute value of a range."""
    nearest = least(absolute(x.lo), absolute(x.hi))
    nearest = where((x.lo > 0.0) | (x.hi < 0.0), nearest, 0.0)
    farthest = largest(absolute(x.lo), absolute(x.hi))
    anything = 0.0 * (x.lo + x.hi)
    low = where(x.lo > 0.0, 1.0, -1.0)
    high = where(x.hi < 0.0, -1.0, 1.0)
    return scaled(x, nearest + anything, farthest + anything, low, high)


@njit
def wave(x: Any, middle: Any, slope: Any) -> Any:
    """Return a sine or cosine of a range, from value and slope in its middle."""
    half = 0.5 * (x.hi - x.lo) * (1.0 + 4.0 * EPS) + EPS * (
        absolute(x.lo) + absolute(x.hi)
    )
    steepest = absolute(slope) + half + SINE_ERROR
    reach = half * least(steepest, 1.0) * (1.0 + 4.0 * EPS) + SINE_ERROR
    anything = 0.0 * half
    lo = largest(middle - reach, -1.0) + anything
    hi = least(middle + reach, 1.0) + anything
    low = largest(slope - half - SINE_ERROR, -1.0) + anything
    high = least(slope + half + SINE_ERROR, 1.0) + anything
    return scaled(x, lo, hi, low, high)


@njit
def range_sine(x: Any) -> Any:
    """Return the sine of a range."""
    middle = 0.5 * (x.lo + x.hi)
    return wave(x, sine(middle), cosine(middle))


@njit
def range_cosine(x: Any) -> Any:
    """Return the cosine of a range."""
    middle = 0.5 * (x.lo + x.hi)
    return wave(x, cosine(middle), -sine(middle))


@njit
def range_root(x: Any) -> Any:
    """Return the square root of a range; anything, if it is not positive."""
    positive = x.lo > 0.0
    lo, hi = wider(square_root(x.lo), square_root(x.hi))
    lo = where(positive, lo, math.nan)
    hi = where(positive, hi, math.nan)
    low, high = wider(0.5 / hi, 0.5 / lo)
    return scaled(x, lo, hi, low, high)


@njit
def range_tangent(x: Any) -> Any:
    """Return the tangent of a range."""
    return multiplied(range_sine(x), inverse(range_cosine(x)))


@njit
def range_exponential(x: Any) -> Any:
    """Return the exponential of a range."""
    lo = exponential(x.lo)
    hi = exponential(x.hi)
    lo = lo - (LIBRARY_ERROR * lo + TINY)
    hi = hi + (LIBRARY_ERROR * hi + TINY)
    return scaled(x, lo, hi, lo, hi)


@njit
def range_logarithm(x: Any) -> Any:
    """Return the logarithm of a range; anything, if it is not positive."""
    positive = x.lo > 0.0
    lo = logarithm(where(positive, x.lo, math.nan))
    hi = logarithm(where(positive, x.hi, math.nan))
    lo = lo - (LIBRARY_ERROR * absolute(lo) + TINY)
    hi = hi + (LIBRARY_ERROR * absolute(hi) + TINY)
    slopes = inverse(x)
    return scaled(x, lo, hi, slopes.lo, slopes.hi)


@njit
def jumping(lo: Any, hi: Any) -> Any:
    """Return a range of whole numbers; its rate is anything, unless it is one."""
    rate = where(lo == hi, 0.0, math.nan)
    return make(lo, hi, rate, rate)


@njit
def range_floor(x: Any) -> Any:
    """Return the largest whole number up to a range."""
    return jumping(floor(x.lo), floor(x.hi))


@njit
def range_ceil(x: Any) -> Any:
    """Return the least whole number from a range on."""
    return jumping(ceil(x.lo), ceil(x.hi))


@njit
def range_rest(x: Any, y: Any) -> Any:
    """Return x % y: between zero and y, also where it jumps."""
    wholes = range_floor(multiplied(x, inverse(y)))
    left = subtracted(x, multiplied(wholes, y))
    lo = where(y.lo > 0.0, least(largest(left.lo, 0.0), y.hi), left.lo)
    hi = where(y.lo > 0.0, largest(least(left.hi, y.hi), 0.0), left.hi)
    lo = where(y.hi < 0.0, least(largest(left.lo, y.lo), 0.0), lo)
    hi = where(y.hi < 0.0, largest(least(left.hi, 0.0), y.lo), hi)
    anything = 0.0 * (left.lo + left.hi)  # NaN if one of them is not finite
    return make(lo + anything, hi + anything, left.dlo, left.dhi)


@njit
def length(x: Any, y: Any) -> Any:
    """Return the root of the sum of two squares."""
    return range_root(added(square(x), square(y)))


@njit
def larger(x: Any, y: Any) -> Any:
    """Return the larger of two ranges; where either may be, it has either rate."""
    first = x.lo > y.hi
    second = y.lo > x.hi
    low = least(x.dlo, y.dlo) + 0.0 * (x.dlo + y.dlo)
    high = largest(x.dhi, y.dhi) + 0.0 * (x.dhi + y.dhi)
    return make(
        largest(x.lo, y.lo) + 0.0 * (x.lo + y.lo),
        largest(x.hi, y.hi) + 0.0 * (x.hi + y.hi),
        where(first, x.dlo, where(second, y.dlo, low)),
        where(first, x.dhi, where(second, y.dhi, high)),
    )


@njit
def smaller(x: Any, y: Any) -> Any:
    """Return the smaller of two ranges."""
    return negated(larger(negated(x), negated(y)))


@njit
def constant(x: Any) -> Any:
    """Return a range of numbers that do not vary."""
    one = spread(x)
    return make(one, one, spread(0.0), spread(0.0))


# What the operators mean.


def _of_two(both: Callable[..., Any], first: Any, second: Any) -> Any:
    """Return a choice between two ranges, and one of them with a number."""

    def choose(x: Any, y: Any) -> Any:
        if x == lane_range and y == lane_range:
            return lambda x, y: both(x, y)
        if x == lane_range and _is_number(y):
            return lambda x, y: first(x, y)
        if y == lane_range and _is_number(x):
            return lambda x, y: second(x, y)
        return None

    return choose


@njit
def _minus_number(x: Any, y: Any) -> Any:
    return shifted(x, -y)


@njit
def _number_minus(x: Any, y: Any) -> Any:
    return shifted(negated(y), x)


@njit
def _shifted_too(x: Any, y: Any) -> Any:
    return shifted(y, x)


@njit
def _stretched_too(x: Any, y: Any) -> Any:
    return stretched(y, x)


@njit
def _divided(x: Any, y: Any) -> Any:
    return multiplied(x, inverse(y))


@njit
def _divided_by_number(x: Any, y: Any) -> Any:
    lo, hi = wider(1.0 / spread(y), 1.0 / spread(y))
    return multiplied(x, make(lo, hi, spread(0.0), spread(0.0)))


@njit
def _number_divided(x: Any, y: Any) -> Any:
    return stretched(inverse(y), x)


_MEANINGS = {
    "add": _of_two(added, shifted, _shifted_too),
    "sub": _of_two(subtracted, _minus_number, _number_minus),
    "mul": _of_two(multiplied, stretched, _stretched_too),
    "truediv": _of_two(_divided, _divided_by_number, _number_divided),
}


def _give(key: Any, choose: Any) -> None:
    overload(key)(lambda x, y: choose(x, y))


for _name, _choose in _MEANINGS.items():
    _give(getattr(operator, _name), _choose)
    _give(getattr(operator, f"i{_name}"), _choose)


def _power_of(x: Any, y: Any) -> Any:
    if x == lane_range and isinstance(y, types.Integer):
        return lambda x, y: whole_power(x, y)
    return None


for _raise in (operator.pow, operator.ipow, pow):
    _give(_raise, _power_of)


def _give_two(key: Any, both: Any) -> None:
    """Give a function of two ranges a meaning, if one of them is numbers, too."""

    @njit
    def first(x: Any, y: Any) -> Any:
        return both(x, constant(y))

    @njit
    def second(x: Any, y: Any) -> Any:
        return both(constant(x), y)

    _give(key, _of_two(both, first, second))


for _of_both, _pair in (
    (builtins.max, larger),
    (np.maximum, larger),
    (builtins.min, smaller),
    (np.minimum, smaller),
    (math.hypot, length),
    (np.hypot, length),
    (operator.mod, range_rest),
    (operator.imod, range_rest),
    (np.mod, range_rest),
    (np.remainder, range_rest),
):
    _give_two(_of_both, _pair)


def _give_one(key: Any, made: Any) -> None:
    def choose(x: Any) -> Any:
        return (lambda x: made(x)) if x == lane_range else None

    overload(key)(lambda x: choose(x))


for _key, _one in (
    (operator.neg, negated),
    (abs, size),
    (np.abs, size),
    (math.fabs, size),
    (math.sin, range_sine),
    (np.sin, range_sine),
    (math.cos, range_cosine),
    (np.cos, range_cosine),
    (math.sqrt, range_root),
    (np.sqrt, range_root),
    (math.tan, range_tangent),
    (np.tan, range_tangent),
    (math.exp, range_exponential),
    (np.exp, range_exponential),
    (math.log, range_logarithm),
    (np.log, range_logarithm),
    (math.floor, range_floor),
    (np.floor, range_floor),
    (math.ceil, range_ceil),
    (np.ceil, range_ceil),
):
    _give_one(_key, _one)
