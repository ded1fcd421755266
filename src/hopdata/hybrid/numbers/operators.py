# ruff: noqa: ARG001, PLW0108 (Numba prescribes signatures and their names)
"""What the operators and functions of Python and NumPy mean for ranges.

Sums, products and comparisons are a few instructions on vectors of four ends, by the
formulas that stand here first; so they take next to no time to compile. The others are
calls of `numbers.library`. Numbers among the arguments become ranges.
"""

import builtins
import itertools
import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, overload

from hopdata.hybrid.compiled.memory import built
from hopdata.hybrid.compiled.terms import (
    TRUTH,
    Cells,
    Code,
    Term,
    Value,
    declared,
    room,
    where,
)
from hopdata.hybrid.numbers.arithmetic import EPS
from hopdata.hybrid.numbers.library import ONE, TWO, place_of
from hopdata.hybrid.numbers.names import (
    ADD,
    DIVIDE,
    MULTIPLY,
    NEGATE,
    POWER,
    REMAINDER,
    SAME,
    SUBTRACT,
    functions_named,
)
from hopdata.hybrid.numbers.ranges import (
    DOUBLE,
    ENDS,
    FOUR,
    LONG,
    RANGE,
    _Range,
    as_range,
    four_of,
    is_scalar,
    joined,
    number,
    parts,
)
from hopdata.private_numba import array_start, tried_first

Formula = Callable[..., Any]
NIBBLE = ir.IntType(4)
KINDS = (_Range, types.Float, types.Integer, types.Boolean, types.Array)


class Span(NamedTuple):
    """A range of a formula: its four ends, as a vector, and its address."""

    ends: Term
    at: Value

    @property
    def lo(self) -> Term:
        """Its least value."""
        return self.ends.lane(ENDS["lo"])

    @property
    def hi(self) -> Term:
        """Its largest value."""
        return self.ends.lane(ENDS["hi"])


def span_of(code: Code, built: Value) -> Span:
    """Return a range of the code as one of a formula."""
    four, at = parts(code.llvm, built)
    return Span(Term(code, four), at)


# Four ends at a time. A formula returns the ends of its result.

WIDER = [-EPS, EPS, -EPS, EPS]
OF_VALUE = ir.Constant(ir.VectorType(TRUTH, 4), [1, 1, 0, 0])
VALUES, RATES = 0, 2  # where the two ends of a value, and of a rate, begin


def swapped(ends: Term) -> Term:
    """Exchange least and most."""
    return ends.picked([1, 0, 3, 2])


def vector_of_ends(*ends: Any) -> Term:
    """Return the vector of four ends."""
    code = next(one.code for one in ends if isinstance(one, Term))
    values = [one.built if isinstance(one, Term) else DOUBLE(one) for one in ends]
    return Term(code, four_of(code.llvm, values))


def widened(ends: Term) -> Term:
    """Widen ends by the rounding of one operation.

    A value that is a single number is what the guard itself computes.
    """
    wider_by = Term(ends.code, ir.Constant(FOUR, WIDER))
    wider = ends + ends.intrinsic("fabs") * wider_by
    is_one = ends.equals(swapped(ends)) & Term(ends.code, OF_VALUE)
    return where(is_one, ends, wider)


def _negative(x: Span) -> Term:
    return -swapped(x.ends)


def _same(x: Span) -> Term:
    return x.ends


def _add(x: Span, y: Span) -> Term:
    return widened(x.ends + y.ends)


def _subtract(x: Span, y: Span) -> Term:
    return widened(x.ends - swapped(y.ends))


def _scaled(factor: Term, x: Span) -> Term:
    """Multiply a range by a number."""
    product = x.ends * factor
    return widened(where(factor >= 0.0, product, swapped(product)))


def _extremes(four: Term) -> tuple[Term, Term]:
    """Return the least and the most of four numbers; NaN for both if one of them is."""
    other = four.picked([2, 3, 0, 1])
    is_less = four < other
    least = where(is_less, four, other)
    most = where(is_less, other, four)
    least = _first_if(least.lane(0), "<", least.lane(1))
    most = _first_if(most.lane(0), ">", most.lane(1))
    builder = four.code.llvm
    bad = builder.fcmp_unordered("uno", four.built, four.built)
    is_bad = builder.icmp_unsigned("!=", builder.bitcast(bad, NIBBLE), NIBBLE(0))
    found = Term(four.code, is_bad)
    return where(found, math.nan, least), where(found, math.nan, most)


def _first_if(one: Term, sign: str, other: Term) -> Term:
    """Return the first of two numbers if it compares so with the other."""
    return where(one.compared(sign, other), one, other)


def _product(x: Span, of_x: int, y: Span, of_y: int) -> tuple[Term, Term]:
    """Return the product of the values or the rates of two ranges."""
    left = x.ends.picked([of_x, of_x, of_x + 1, of_x + 1])
    right = y.ends.picked([of_y, of_y + 1, of_y, of_y + 1])
    return _extremes(left * right)


def _multiply(x: Span, y: Span) -> Term:
    value = _product(x, VALUES, y, VALUES)
    first = _product(x, RATES, y, VALUES)
    second = _product(x, VALUES, y, RATES)
    value_and_first = widened(vector_of_ends(*value, *first))
    total = widened(value_and_first + widened(vector_of_ends(0.0, 0.0, *second)))
    # The value was widened by its own rounding already.
    return value_and_first.picked([0, 1, 6, 7], total)


def _square(x: Span) -> Term:
    squares = Span(x.ends * x.ends, x.at)
    is_less = squares.lo < squares.hi
    least = where(is_less, squares.lo, squares.hi)
    most = where(is_less, squares.hi, squares.lo)
    contains_zero = (x.lo < 0.0) & (x.hi > 0.0)
    least = where(contains_zero, 0.0, least)
    twice = Span(x.ends + x.ends, x.at)
    rate = _product(twice, VALUES, x, RATES)
    return widened(vector_of_ends(least, most, *rate))


# Calls of the longer operations.


def _at_address(ends: Term) -> Value:
    """Build the storing of ends, and their address."""
    builder = ends.code.llvm
    pointer = room(builder, ir.ArrayType(DOUBLE, 4))
    address = builder.ptrtoint(pointer, LONG)
    Cells(builder, address).store(ends.built, 0)
    return address


def _call(code: Code, name: str, x_at: Value, y_at: Value, at: Value) -> Term:
    """Call an operation on ends at addresses; its result is four ends."""
    builder = code.llvm
    native = ir.FunctionType(ir.VoidType(), 5 * [LONG])
    symbol, number = place_of(name)
    apply = declared(builder, native, symbol)
    into = builder.ptrtoint(room(builder, ir.ArrayType(DOUBLE, 4)), LONG)
    builder.call(apply, [LONG(number), x_at, y_at, at, into])
    return Term(code, Cells(builder, into).load(0, FOUR))


def _call_one(name: str) -> Formula:
    def formula(x: Span) -> Term:
        x_at = _at_address(x.ends)
        return _call(x.ends.code, name, x_at, x_at, x.at)

    return formula


def _call_two(name: str) -> Formula:
    def formula(x: Span, y: Span) -> Term:
        addresses = _at_address(x.ends), _at_address(y.ends)
        return _call(x.ends.code, name, *addresses, _either(x, y))

    return formula


def _either(*spans: Span) -> Value:
    """Build the address of those ranges that have one; numbers have 0."""
    at = spans[0].at
    for one in spans[1:]:
        at = one.ends.code.llvm.or_(at, one.at)
    return at


# Comparisons: true, false, or open.


def _decided_or_asked(x: Span, y: Span, yes: Term, no: Term) -> Term:
    """Return a truth value; where neither is sure, the caller has the answer."""
    code = x.ends.code
    builder = code.llvm
    answer = room(builder, TRUTH)
    builder.store(yes.built, answer)
    with builder.if_then((~(yes | no)).built, likely=False):
        asked = _call_two("opened")(x, y)
        told = asked.lane(ENDS["lo"]) > 0.0
        builder.store(told.built, answer)
    return Term(code, builder.load(answer, typ=TRUTH))


def _below(x: Span, y: Span) -> Term:
    return _decided_or_asked(x, y, x.hi < y.lo, x.lo >= y.hi)


def _at_most(x: Span, y: Span) -> Term:
    return _decided_or_asked(x, y, x.hi <= y.lo, x.lo > y.hi)


def _equal(x: Span, y: Span) -> Term:
    no = (x.hi < y.lo) | (x.lo > y.hi)
    are_numbers = x.lo.equals(x.hi) & y.lo.equals(y.hi)
    return _decided_or_asked(x, y, are_numbers & x.lo.equals(y.lo), no)


def _unequal(x: Span, y: Span) -> Term:
    return ~_equal(x, y)


def _above(x: Span, y: Span) -> Term:
    return _below(y, x)


def _at_least(x: Span, y: Span) -> Term:
    return _at_most(y, x)


def _is_zero(x: Span) -> Term:
    zeros = Term(x.ends.code, ir.Constant(FOUR, 4 * [0.0]))
    return _equal(x, Span(zeros, LONG(0)))


def _is_not_zero(x: Span) -> Term:
    return ~_is_zero(x)


def _never(x: Span) -> Term:
    return Term(x.ends.code, TRUTH(0))


def _has_finite_ends(x: Span) -> Term:
    return (x.lo > -math.inf) & (x.hi < math.inf)


def _finite(x: Span) -> Term:
    return _decided_or_asked(x, x, _has_finite_ends(x), _never(x))


def _not_finite(x: Span) -> Term:
    return _decided_or_asked(x, x, _never(x), _has_finite_ends(x))


# Registration.


def _fit(*kinds: Any) -> bool:
    """Return whether one of the types is a range, and all are ranges or numbers."""
    return RANGE in kinds and all(one == RANGE or is_scalar(one) for one in kinds)


def _register(count: int, formula: Formula, *keys: Any, result: Any = RANGE) -> None:
    """Give functions of `count` arguments a meaning, by a formula of ranges."""

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        spans = _spans(context, builder, sign.args, values)
        return _built(formula(*spans), spans)

    _install(count, lower, keys, result)


def _spans(context: Any, builder: Any, kinds: Any, values: Any) -> list[Span]:
    """Return ranges and numbers as ranges of a formula."""
    code = Code(context, builder)
    spans = []
    for kind, value in zip(kinds, values, strict=True):
        spans.append(span_of(code, as_range(context, builder, kind, value)))
    return spans


def _built(found: Term, spans: list[Span]) -> Value:
    """Build the result of a formula: a range, if it found ends."""
    if found.built.type == FOUR:
        return joined(found.code.llvm, found.built, _either(*spans))
    return found.built


def _install(count: int, lower: Any, keys: tuple[Any, ...], result: Any) -> None:
    """Give functions a meaning where an argument is a range, the others numbers."""

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        if len(plain) == count and _fit(*plain):
            return result(*plain)
        return None

    for key in keys:
        tried_first(key, typed)
        for kinds in itertools.product(KINDS, repeat=count):
            if _Range in kinds:
                lower_builtin(key, *kinds)(lower)


_whole_power = _call_two("whole_power")
_real_power = _call_two("real_power")


def _lower_product(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build a product; one with a number is short."""
    code = Code(context, builder)
    for place in range(2):
        kind = sign.args[place]
        if kind != RANGE:
            factor = Term(code, number(context, builder, kind, values[place]))
            x = span_of(code, values[1 - place])
            return _built(_scaled(factor, x), [x])
    spans = [span_of(code, one) for one in values]
    return _built(_multiply(*spans), spans)


def _lower_power(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build a power; one with an integer is known at negative numbers, too."""
    spans = _spans(context, builder, sign.args, values)
    if not isinstance(sign.args[1], types.Integer):
        return _built(_real_power(*spans), spans)
    if getattr(values[1], "constant", None) == 2:
        return _built(_square(spans[0]), spans[:1])
    return _built(_whole_power(*spans), spans)


def _times(factor: float) -> Formula:
    """Return the formula of a product with a known number."""
    return lambda x: _scaled(Term(x.ends.code, DOUBLE(factor)), x)


def _whole_of(name: str) -> Formula:
    """Return the formula of an integer from a range."""
    call = _call_one(name)

    def whole(x: Span) -> Term:
        code = x.ends.code
        least = call(x).lane(ENDS["lo"])
        return Term(code, code.llvm.fptosi(least.built, LONG))

    return whole


_TRUTH = types.boolean
_register(1, _negative, *NEGATE)
_register(1, _same, *SAME)
_register(1, _square, np.square)
_register(2, _add, *ADD)
_register(2, _subtract, *SUBTRACT)
_install(2, _lower_product, MULTIPLY, RANGE)
_install(2, _lower_power, POWER, RANGE)
_register(1, _times(math.pi / 180.0), *functions_named("radians"))
_register(1, _times(180.0 / math.pi), *functions_named("degrees"))
_register(2, _call_two("divide"), *DIVIDE)
_register(2, _call_two("rest"), *REMAINDER)
# `np.floor_divide` is a function of the library.
_register(2, _call_two("whole_quotient"), operator.floordiv, operator.ifloordiv)
for _name, _one in ONE.items():
    _register(1, _call_one(_name), *_one.keys)
for _name, _two in TWO.items():
    _register(2, _call_two(_name), *_two.keys)
_register(2, _below, operator.lt, np.less, result=_TRUTH)
_register(2, _at_most, operator.le, np.less_equal, result=_TRUTH)
_register(2, _above, operator.gt, np.greater, result=_TRUTH)
_register(2, _at_least, operator.ge, np.greater_equal, result=_TRUTH)
_register(2, _equal, operator.eq, np.equal, result=_TRUTH)
_register(2, _unequal, operator.ne, np.not_equal, result=_TRUTH)
_register(1, _is_not_zero, bool, operator.truth, result=_TRUTH)
_register(1, _is_zero, operator.not_, result=_TRUTH)
_register(1, _finite, math.isfinite, np.isfinite, result=_TRUTH)
_BAD = (math.isnan, math.isinf, np.isnan, np.isinf)
_register(1, _not_finite, *_BAD, result=_TRUTH)
_register(1, _whole_of("integer"), int, result=types.int64)
_register(1, _whole_of("nearest_integer"), round, result=types.int64)


# Functions that are made of others.


def _of_three(function: Any) -> Any:
    """Return what a function of two numbers means for three, one of them a range."""

    def typed(x: Any, y: Any, z: Any) -> Any:
        if _fit(x, y, z):
            return lambda x, y, z: function(function(x, y), z)
        return None

    return lambda x, y, z: typed(x, y, z)  # Numba compares annotations, too


overload(builtins.min)(_of_three(min))
overload(builtins.max)(_of_three(max))


def _to_range(typing: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return as_range(context, builder, sign.args[0], values[0])

    return RANGE(types.unliteral(x)), generate


wide = built(1, lambda x: _to_range(None, x))


def _where(condition: Any, x: Any, y: Any) -> Any:
    if isinstance(condition, types.Boolean) and _fit(x, y):
        return lambda condition, x, y: wide(x) if condition else wide(y)
    return None


overload(np.where)(lambda condition, x, y: _where(condition, x, y))


# Tables.


def _is_column(kind: Any) -> bool:
    """Return whether a type is that of a plain array of floats."""
    is_plain = isinstance(kind, types.Array) and kind.ndim == 1 and kind.layout == "C"
    return is_plain and kind.dtype == types.float64


def _typed_look_up(x: Any, places: Any, values: Any, n: Any) -> Any:
    def generate(context: Any, builder: Any, sign: Any, given: Any) -> Any:
        code = Code(context, builder)
        x = span_of(code, given[0])
        # The table, as its function takes it: two addresses, and the length.
        table_at = builder.ptrtoint(room(builder, ir.ArrayType(LONG, 3)), LONG)
        table = Cells(builder, table_at)
        for place in range(2):
            kind = sign.args[1 + place]
            start = array_start(context, builder, kind, given[1 + place])
            table.store(builder.ptrtoint(start, LONG), place)
        table.store(given[3], 2)
        x_at = _at_address(x.ends)
        return _built(_call(code, "table", x_at, table_at, x.at), [x])

    return RANGE(x, places, values, types.int64), generate


look_up = built(4, _typed_look_up)


def _interp(x: Any, xp: Any, fp: Any) -> Any:
    if x == RANGE and _is_column(xp) and _is_column(fp):
        return lambda x, xp, fp: look_up(x, xp, fp, min(len(xp), len(fp)))
    return None


overload(np.interp)(lambda x, xp, fp: _interp(x, xp, fp))
