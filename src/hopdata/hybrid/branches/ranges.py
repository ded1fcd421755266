# ruff: noqa: ARG001, PLW0108 (Numba prescribes signatures and their names)
"""A Numba type of ranges, for which a user's guards compile as they are.

A `Range` says that a quantity lies between `lo` and `hi` over a piece of a step. Where
a comparison of ranges has no single answer, or a function has a jump or a kink within
them (`floor`, `%`, `abs`, `max`, a pole), the guards may follow another formula in a
part of the piece. Such an *open branch* is noted in the integer at the address `at`,
which each range carries with it. What the guards then return does not matter: the
caller divides the piece.

Ranges are widened by the rounding of each operation, with 4 units in the last place for
elementary functions.
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
    register_model,
)

from hopdata.hybrid.compiled.memory import (
    NumberLike,
    built,
    float_vector,
    int_vector,
    is_number,
    tried_first,
)

Function = Callable[..., Any]

EPS = 2.0**-52
#: Relative error by which the range of an elementary function is widened.
#: Unit: 1. Origin: rounding: 4 units in the last place, which is assumed of the C
#: library (docs/integrator.md, Limits).
LIBM = 4.0 * EPS
INF = math.inf
TURN = 2.0 * math.pi
BYTES = 8  # of a number
LARGEST_WHOLE = 2.0**53  # floats below it hold every whole number


class _Range(NumberLike):
    """The type of a range."""


class _Rows(types.Type):
    """The type of `n` ranges by address.

    Each upper end is `stride` numbers after the lower.
    """


class _Sink(types.Type):
    """The type of an array that forgets what is written to it.

    So it need not be computed.
    """


RANGE = _Range("Range")
ROWS = _Rows("RangeRows")
SINK = _Sink("RangeSink")
INT = types.int64
FLOAT = types.float64
MEMBERS: dict[Any, dict[str, Any]] = {
    RANGE: {"lo": FLOAT, "hi": FLOAT, "at": INT},
    ROWS: {"data": INT, "n": INT, "stride": INT, "at": INT},
    SINK: {"n": INT, "at": INT},
}


def _model(members: dict[str, Any]) -> Any:
    def make(self: Any, manager: Any, kind: Any) -> None:
        models.StructModel.__init__(self, manager, kind, list(members.items()))

    return type("Model", (models.StructModel,), {"__init__": make})


for _kind, _members in MEMBERS.items():
    register_model(type(_kind))(_model(_members))
    for _name in _members:
        make_attribute_wrapper(type(_kind), _name, _name)


def _packed(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    """Build a structure from its members."""
    made = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for place, value in enumerate(values):
        made = builder.insert_value(made, value, place)
    return made


def _maker(kind: Any) -> Any:
    """Return a function for compiled code that makes a value from its members."""
    members = tuple(MEMBERS[kind].values())

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return _packed(context, builder, kind, values)

    return built(len(members), lambda *_: (kind(*members), generate))


make = _maker(RANGE)
rows_at = _maker(ROWS)
sink = _maker(SINK)


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    """Build the range of a number; it needs no place to note an open branch."""
    number = context.cast(builder, value, types.unliteral(given), FLOAT)
    nowhere = ir.Constant(ir.IntType(64), 0)
    return _packed(context, builder, RANGE, (number, number, nowhere))


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, _Range)(_cast)


def wide(x: Any) -> Any:
    """Return a number as a range."""
    return x


def _is_scalar(kind: Any) -> bool:
    """Return whether a type is that of a number, or of an array without axes.

    `np.where` returns such arrays.
    """
    return is_number(kind) or (isinstance(kind, types.Array) and kind.ndim == 0)


def _wide(x: Any) -> Any:
    if x == RANGE:
        return lambda x: x
    if isinstance(x, types.Boolean):
        return lambda x: make(1.0, 1.0, 0) if x else make(0.0, 0.0, 0)
    if is_number(x):
        return lambda x: make(float(x), float(x), 0)
    if _is_scalar(x):
        return lambda x: make(float(x[()]), float(x[()]), 0)
    return None


overload(wide)(lambda x: _wide(x))


# Arrays of ranges.


def _item(rows: Any, i: int) -> Any:
    place = i if i >= 0 else i + rows.n
    ends = float_vector(rows.data, 2 * rows.stride)
    return make(ends[place], ends[place + rows.stride], rows.at)


def _forgotten(rows: Any, i: int) -> Any:
    return make(-INF, INF, rows.at)


def _put(rows: Any, i: int, x: Any) -> None:
    place = i if i >= 0 else i + rows.n
    ends = float_vector(rows.data, 2 * rows.stride)
    one = wide(x)
    ends[place] = one.lo
    ends[place + rows.stride] = one.hi


def _forget(rows: Any, i: int, x: Any) -> None:
    return None


def _typed_get(owner: Any, i: Any) -> Any:
    if owner in (ROWS, SINK) and isinstance(i, types.Integer):
        return RANGE(owner, INT)
    return None


def _typed_set(owner: Any, i: Any, x: Any) -> Any:
    kind = types.unliteral(x)
    fits = isinstance(i, types.Integer) and (kind == RANGE or _is_scalar(kind))
    if owner in (ROWS, SINK) and fits:
        return types.none(owner, INT, kind)
    return None


def _lower(key: Any, kinds: tuple[Any, ...], function: Function) -> None:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return context.compile_internal(builder, function, sign, values)

    lower_builtin(key, *kinds)(lower)


tried_first(operator.getitem, _typed_get)
tried_first(operator.setitem, _typed_set)
_lower(operator.getitem, (_Rows, types.Integer), _item)
_lower(operator.getitem, (_Sink, types.Integer), _forgotten)
_lower(operator.setitem, (_Rows, types.Integer, types.Any), _put)
_lower(operator.setitem, (_Sink, types.Integer, types.Any), _forget)


@njit
def part(rows: Any, first: int, last: int) -> Any:
    """Return the rows from `first` on, up to `last`."""
    return rows_at(rows.data + BYTES * first, last - first, rows.stride, rows.at)


def _length(owner: Any) -> Any:
    if owner in (ROWS, SINK):
        return lambda owner: owner.n
    return None


overload(len)(lambda owner: _length(owner))


# Open branches.


@njit
def note(at: int) -> bool:
    """Note an open branch, and return an answer, which does not matter."""
    if at != 0:
        int_vector(at, 1)[0] = 1
    return False


@njit
def is_below(x: Any, y: Any) -> bool:
    """Return whether x < y."""
    if x.hi < y.lo:
        return True
    if x.lo >= y.hi:
        return False
    return note(x.at | y.at)


@njit
def is_at_most(x: Any, y: Any) -> bool:
    """Return whether x <= y."""
    if x.hi <= y.lo:
        return True
    if x.lo > y.hi:
        return False
    return note(x.at | y.at)


@njit
def equals(x: Any, y: Any) -> bool:
    """Return whether x == y."""
    if x.hi < y.lo or x.lo > y.hi:
        return False
    if x.lo == x.hi and y.lo == y.hi and x.lo == y.lo:
        return True
    return note(x.at | y.at)


# Arithmetic.


@njit
def rounded(lo: float, hi: float, error: float, at: int) -> Any:
    """Return a range widened by a relative error."""
    return make(lo - error * abs(lo), hi + error * abs(hi), at)


@njit
def negative(x: Any) -> Any:
    """Return -x."""
    return make(-x.hi, -x.lo, x.at)


@njit
def add(x: Any, y: Any) -> Any:
    """Return x + y."""
    return rounded(x.lo + y.lo, x.hi + y.hi, EPS, x.at | y.at)


@njit
def subtract(x: Any, y: Any) -> Any:
    """Return x - y."""
    return rounded(x.lo - y.hi, x.hi - y.lo, EPS, x.at | y.at)


@njit
def hull(a: float, b: float, c: float, d: float, error: float, at: int) -> Any:
    """Return the range of four numbers, widened; that of all numbers if one is NaN."""
    if math.isnan(a + b + c + d):
        return make(-INF, INF, at)
    return rounded(min(a, b, c, d), max(a, b, c, d), error, at)


@njit
def multiply(x: Any, y: Any) -> Any:
    """Return x y."""
    return hull(x.lo * y.lo, x.lo * y.hi, x.hi * y.lo, x.hi * y.hi, EPS, x.at | y.at)


@njit
def divide(x: Any, y: Any) -> Any:
    """Return x / y; across a pole the branch is open."""
    if not (y.lo > 0.0 or y.hi < 0.0):
        note(x.at | y.at)
        return make(-INF, INF, x.at | y.at)
    return hull(x.lo / y.lo, x.lo / y.hi, x.hi / y.lo, x.hi / y.hi, EPS, x.at | y.at)


@njit
def whole_power(x: Any, n: int) -> Any:
    """Return x to an integer power."""
    if n < 0:
        return divide(make(1.0, 1.0, x.at), whole_power(x, -n))
    a = x.lo**n
    b = x.hi**n
    if n % 2 == 0 and n > 0 and x.lo < 0.0 < x.hi:
        return rounded(0.0, max(a, b), (n + 4) * EPS, x.at)
    return rounded(min(a, b), max(a, b), (n + 4) * EPS, x.at)


@njit
def power(x: Any, y: Any) -> Any:
    """Return x to a power that need not be whole; the branch is open at x <= 0."""
    if not x.lo > 0.0:
        note(x.at | y.at)
        return make(-INF, INF, x.at | y.at)
    a = x.lo**y.lo
    b = x.lo**y.hi
    c = x.hi**y.lo
    d = x.hi**y.hi
    return hull(a, b, c, d, LIBM, x.at | y.at)


# Functions with kinks and jumps.


@njit
def least(x: Any, y: Any) -> Any:
    """Return the lesser of x and y."""
    if x.hi <= y.lo:
        return make(x.lo, x.hi, x.at | y.at)
    if y.hi <= x.lo:
        return make(y.lo, y.hi, x.at | y.at)
    note(x.at | y.at)
    return make(min(x.lo, y.lo), min(x.hi, y.hi), x.at | y.at)


@njit
def largest(x: Any, y: Any) -> Any:
    """Return the larger of x and y."""
    return negative(least(negative(x), negative(y)))


@njit
def absolute(x: Any) -> Any:
    """Return |x|."""
    return largest(x, negative(x))


@njit
def sign(x: Any) -> Any:
    """Return the sign of x, -1, 0 or 1."""
    if x.lo > 0.0 or x.hi < 0.0:
        one = math.copysign(1.0, x.lo)
        return make(one, one, x.at)
    if x.lo == 0.0 and x.hi == 0.0:
        return make(0.0, 0.0, x.at)
    note(x.at)
    return make(-1.0, 1.0, x.at)


@njit
def copysign(x: Any, y: Any) -> Any:
    """Return |x| with the sign of y."""
    return multiply(absolute(x), sign(y))


def _stair(whole: Function) -> Any:
    """Return a function that is constant but for jumps."""

    @njit
    def stair(x: Any) -> Any:
        lo = float(whole(x.lo))
        hi = float(whole(x.hi))
        if lo != hi:
            note(x.at)
        return make(lo, hi, x.at)

    return stair


floor = _stair(np.floor)
ceil = _stair(np.ceil)
trunc = _stair(np.trunc)
rint = _stair(np.rint)


@njit
def rest(x: Any, y: Any) -> Any:
    """Return x % y."""
    return subtract(x, multiply(y, floor(divide(x, y))))


@njit
def rest_like_x(x: Any, y: Any) -> Any:
    """Return the rest of x / y with the sign of x, as `math.fmod`."""
    return subtract(x, multiply(y, trunc(divide(x, y))))


@njit
def whole_quotient(x: Any, y: Any) -> Any:
    """Return x // y."""
    return floor(divide(x, y))


@njit
def integer(x: Any) -> int:
    """Return int(x)."""
    if abs(x.lo) < LARGEST_WHOLE:
        return int(trunc(x).lo)
    return 0


@njit
def table(x: Any, places: Any, values: Any) -> Any:
    """Return the piecewise linear interpolation of a table, as `np.interp`."""
    first = np.searchsorted(places, x.lo)
    last = np.searchsorted(places, x.hi)
    a = np.interp(x.lo, places, values)
    b = np.interp(x.hi, places, values)
    lo = min(a, b)
    hi = max(a, b)
    for k in range(first, last):  # the kinks in between
        note(x.at)
        lo = min(lo, values[k])
        hi = max(hi, values[k])
    return rounded(lo, hi, 2.0 * LIBM, x.at)


# Smooth functions.


def _rising(function: Function, low: float, high: float) -> Any:
    """Return a rising function between two numbers; beyond them the branch is open."""

    @njit
    def rising(x: Any) -> Any:
        if not (x.lo >= low and x.hi <= high):
            note(x.at)
        a = function(max(x.lo, low))
        b = function(min(x.hi, high))
        if a <= b:
            return rounded(a, b, LIBM, x.at)
        return make(-INF, INF, x.at)

    return rising


# Between which numbers each rising function is defined.
RISING = {
    "exp": (-INF, INF),
    "expm1": (-INF, INF),
    "sinh": (-INF, INF),
    "tanh": (-INF, INF),
    "atan": (-INF, INF),
    "asinh": (-INF, INF),
    "erf": (-INF, INF),
    "log": (0.0, INF),
    "log2": (0.0, INF),
    "log10": (0.0, INF),
    "sqrt": (0.0, INF),
    "log1p": (-1.0, INF),
    "asin": (-1.0, 1.0),
    "acosh": (1.0, INF),
    "atanh": (-1.0, 1.0),
}
MADE = {name: _rising(getattr(math, name), *ends) for name, ends in RISING.items()}
_asin = MADE["asin"]
_sqrt = MADE["sqrt"]
_cosh = math.cosh
_tan = math.tan


@njit
def arc_cosine(x: Any) -> Any:
    """Return acos(x)."""
    return subtract(make(0.5 * math.pi, 0.5 * math.pi, 0), _asin(x))


@njit
def hyperbolic_cosine(x: Any) -> Any:
    """Return cosh(x)."""
    a = _cosh(x.lo)
    b = _cosh(x.hi)
    lo = min(a, b)
    if x.lo < 0.0 < x.hi:
        lo = 1.0
    return rounded(lo, max(a, b), LIBM, x.at)


@njit
def wave(x: Any, shift: float) -> Any:
    """Return cos(x - shift)."""
    if not x.hi - x.lo < TURN:
        return make(-1.0, 1.0, x.at)
    error = 2.0 * LIBM * (1.0 + abs(x.lo) + abs(x.hi))
    first = (x.lo - shift) / TURN
    last = (x.hi - shift) / TURN
    a = math.cos(x.lo - shift)
    b = math.cos(x.hi - shift)
    lo = max(min(a, b) - error, -1.0)
    hi = min(max(a, b) + error, 1.0)
    # A trough or a crest in between?
    if math.floor(last + 0.5 + error) > math.floor(first + 0.5 - error):
        lo = -1.0
    if math.floor(last + error) > math.floor(first - error):
        hi = 1.0
    return make(lo, hi, x.at)


@njit
def sine(x: Any) -> Any:
    """Return sin(x)."""
    return wave(x, 0.5 * math.pi)


@njit
def cosine(x: Any) -> Any:
    """Return cos(x)."""
    return wave(x, 0.0)


@njit
def tangent(x: Any) -> Any:
    """Return tan(x); across a pole the branch is open."""
    error = 2.0 * LIBM * (1.0 + abs(x.lo) + abs(x.hi))
    first = x.lo / math.pi + 0.5 - error
    last = x.hi / math.pi + 0.5 + error
    if math.floor(first) != math.floor(last):
        note(x.at)
        return make(-INF, INF, x.at)
    return rounded(_tan(x.lo) - error, _tan(x.hi) + error, LIBM, x.at)


@njit
def angle(y: Any, x: Any) -> Any:
    """Return atan2(y, x); across the negative x axis the branch is open."""
    if not (x.lo > 0.0 or y.lo > 0.0 or y.hi < 0.0):
        note(x.at | y.at)
        return make(-math.pi, math.pi, x.at | y.at)
    a = math.atan2(y.lo, x.lo)
    b = math.atan2(y.lo, x.hi)
    c = math.atan2(y.hi, x.lo)
    d = math.atan2(y.hi, x.hi)
    return hull(a, b, c, d, LIBM, x.at | y.at)


@njit
def length(x: Any, y: Any) -> Any:
    """Return the hypotenuse of x and y."""
    return _sqrt(add(whole_power(x, 2), whole_power(y, 2)))


# What the operators and functions of Python and NumPy mean for ranges.


def _one(made: Any) -> Function:
    """Return what a function of one argument is for ranges: `made`."""

    def typed(x: Any) -> Any:
        if x == RANGE:
            return lambda x: made(x)
        return None

    return lambda x: typed(x)  # without annotations, which Numba would compare


def _two(made: Any) -> Function:
    """Return what a function of two arguments is for ranges: `made`."""

    def typed(x: Any, y: Any) -> Any:
        if _fit(x, y):
            return lambda x, y: made(wide(x), wide(y))
        return None

    return lambda x, y: typed(x, y)


def _fit(x: Any, y: Any) -> bool:
    """Return whether one of two types is a range, and the other a range or a number."""
    return RANGE in (x, y) and all(one == RANGE or _is_scalar(one) for one in (x, y))


def _register(typed: Function, *functions: Any) -> None:
    for function in functions:
        overload(function)(typed)


@njit
def _is_above(x: Any, y: Any) -> bool:
    return is_below(y, x)


@njit
def _is_at_least(x: Any, y: Any) -> bool:
    return is_at_most(y, x)


@njit
def _differs(x: Any, y: Any) -> bool:
    return not equals(x, y)


@njit
def _same(x: Any) -> Any:
    return x


_register(_two(add), operator.add, operator.iadd)
_register(_two(subtract), operator.sub, operator.isub)
_register(_two(multiply), operator.mul, operator.imul)
_register(_two(divide), operator.truediv, operator.itruediv)
_register(_two(rest), operator.mod, operator.imod, np.mod, np.remainder)
_register(_two(rest_like_x), math.fmod, np.fmod)
_register(_two(whole_quotient), operator.floordiv, operator.ifloordiv)
_register(_two(is_below), operator.lt)
_register(_two(is_at_most), operator.le)
_register(_two(_is_above), operator.gt)
_register(_two(_is_at_least), operator.ge)
_register(_two(equals), operator.eq)
_register(_two(_differs), operator.ne)
_register(_two(least), builtins.min, np.minimum)
_register(_two(largest), builtins.max, np.maximum)
_register(_two(angle), math.atan2, np.arctan2)
_register(_two(length), math.hypot, np.hypot)
_register(_two(copysign), math.copysign, np.copysign)
_register(_one(negative), operator.neg)
_register(_one(_same), operator.pos, float)
_register(_one(absolute), abs, np.abs, math.fabs)
_register(_one(sign), np.sign)
_register(_one(floor), math.floor, np.floor)
_register(_one(ceil), math.ceil, np.ceil)
_register(_one(trunc), math.trunc, np.trunc)
_register(_one(rint), np.rint)
_register(_one(integer), int)
_register(_one(sine), math.sin, np.sin)
_register(_one(cosine), math.cos, np.cos)
_register(_one(tangent), math.tan, np.tan)
_register(_one(arc_cosine), math.acos, np.arccos)
_register(_one(hyperbolic_cosine), math.cosh, np.cosh)
_NAMES_IN_NUMPY = {
    "asin": "arcsin",
    "asinh": "arcsinh",
    "acosh": "arccosh",
    "atan": "arctan",
    "atanh": "arctanh",
}
for _name, _function in MADE.items():
    _register(_one(_function), getattr(math, _name))
    _in_numpy = _NAMES_IN_NUMPY.get(_name, _name)
    if hasattr(np, _in_numpy):  # it has no erf
        _register(_one(_function), getattr(np, _in_numpy))


def _typed_power(x: Any, y: Any) -> Any:
    if x == RANGE and isinstance(y, types.Integer):
        return lambda x, y: whole_power(x, y)
    return _two(power)(x, y)


_register(
    lambda x, y: _typed_power(x, y), operator.pow, operator.ipow, math.pow, np.power
)


def _where(m: Any, x: Any, y: Any) -> Any:
    if isinstance(m, types.Boolean) and RANGE in (x, y):
        return lambda m, x, y: wide(x) if m else wide(y)
    return None


overload(np.where)(lambda m, x, y: _where(m, x, y))


def _interp(x: Any, xp: Any, fp: Any) -> Any:
    if x == RANGE:
        return lambda x, xp, fp: table(x, xp, fp)
    return None


overload(np.interp)(lambda x, xp, fp: _interp(x, xp, fp))
