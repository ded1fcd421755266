# ruff: noqa: ARG001, ARG002 (Numba prescribes signatures)
"""A Numba type of numbers that record on a tape how they were computed.

A user's function compiles for such numbers as it is. Each operation gives the same
value as for plain numbers, to the bit, and appends a record to the tape: the places of
its operands, and its derivatives by them. They come from the same operation on dual
numbers (`numbers.duals`), whose rules at kinks hold here, too. Read backward, the tape
gives the derivative of one result by all inputs, at a cost that does not depend on
their number.

A tape is a row of 8-byte cells: the number of places in use, the number of places that
there are, and then four cells for each place: two operands, and two derivatives. Place
0 stands for constants; what is written there is never read. If the tape is full, the
count goes on, and results get place 0, so that the caller notices.
"""

import builtins
import math
import operator
from itertools import product
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import (
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
)

from hopdata.hybrid.compiled.memory import FirstTried, NumberLike, ask_first
from hopdata.hybrid.numbers import duals
from hopdata.hybrid.numbers.moving import plain
from hopdata.hybrid.numbers.vectors import bare

FLOAT = types.float64
INT = types.int64
LONG = ir.IntType(64)
DOUBLE = ir.DoubleType()
Value = Any  # of LLVM

CELLS = 3  # of a number in an array: its value, its place, and its tape's address
HEAD = 2  # cells of a tape before its records
RECORD = 4  # cells of a record
#: Most operands of one operation.
#: Unit: 1. Origin: derived: the widest dual number.
MOST_OPERANDS = duals.WIDTHS[-1]


class Traced(NumberLike):
    """The type of a number with its place on a tape."""

    def __init__(self) -> None:
        super().__init__(name="Traced")


TRACED = Traced()


@register_model(Traced)
class _TracedModel(models.StructModel):
    """A value, its place, and the address of the tape; 0 if it is a constant."""

    def __init__(self, manager: Any, kind: Traced) -> None:
        members = [("value", FLOAT), ("place", INT), ("tape", INT)]
        super().__init__(manager, kind, members)


make_attribute_wrapper(Traced, "value", "value")


def _plain(x: Any) -> Any:
    if isinstance(x, Traced):
        return lambda x: x.value
    return None


overload(plain)(bare(_plain))


def _number(context: Any, value: Value, place: Value, tape: Value, builder: Any) -> Any:
    """Build a traced number from its parts."""
    whole = ir.Constant(context.get_value_type(TRACED), ir.Undefined)
    for index, part in enumerate((value, place, tape)):
        whole = builder.insert_value(whole, part, index)
    return whole


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = context.cast(builder, value, types.unliteral(given), FLOAT)
    none = ir.Constant(LONG, 0)
    return _number(context, number, none, none, builder)


for _kind in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_kind, Traced)(_cast)


def _cell(builder: Any, tape: Value, index: Value, kind: Any) -> Value:
    """Build the pointer to a cell of a tape."""
    start = builder.inttoptr(tape, LONG.as_pointer())
    return builder.bitcast(builder.gep(start, [index]), kind.as_pointer())


def _record(
    builder: Any, tape: Value, operands: list[Value], slopes: list[Value]
) -> Value:
    """Build the record of one operation with two operands, and return its place.

    Constants have no tape: theirs is written beside.
    """
    with builder.goto_entry_block():
        spare = builder.alloca(LONG, HEAD + RECORD)
    zero = ir.Constant(LONG, 0)
    one = ir.Constant(LONG, 1)
    beside = builder.ptrtoint(spare, LONG)
    builder.store(zero, _cell(builder, beside, zero, LONG))
    builder.store(zero, _cell(builder, beside, one, LONG))
    is_constant = builder.icmp_signed("==", tape, zero)
    tape = builder.select(is_constant, beside, tape)
    count = builder.load(_cell(builder, tape, zero, LONG))
    most = builder.load(_cell(builder, tape, one, LONG))
    builder.store(builder.add(count, one), _cell(builder, tape, zero, LONG))
    place = builder.select(builder.icmp_signed("<", count, most), count, zero)
    first = builder.mul(place, ir.Constant(LONG, RECORD))
    cells = [*((one, LONG) for one in operands), *((one, DOUBLE) for one in slopes)]
    for number, (content, kind) in enumerate(cells):
        index = builder.add(first, ir.Constant(LONG, HEAD + number))
        builder.store(content, _cell(builder, tape, index, kind))
    return place


def _append(builder: Any, tape: Value, operands: list[Value], slopes: Value) -> Value:
    """Build the records of an operation, two operands at a time; return its place."""
    parts = []
    for number in range(len(operands)):
        place = ir.Constant(ir.IntType(32), number)
        parts.append(builder.extract_element(slopes, place))
    if len(operands) == 1:
        nothing = [ir.Constant(LONG, 0)], [ir.Constant(DOUBLE, 0.0)]
        return _record(builder, tape, operands + nothing[0], parts + nothing[1])
    place = _record(builder, tape, operands[:2], parts[:2])
    for operand, part in zip(operands[2:], parts[2:], strict=True):
        whole = [ir.Constant(DOUBLE, 1.0), part]
        place = _record(builder, tape, [place, operand], whole)
    return place


def _dual_for(kinds: Any) -> Any:
    """Return the type of duals with a direction for each traced number."""
    count = sum(isinstance(kind, Traced) for kind in kinds)
    return duals.Dual(duals.width_for(count))


def _lowered(key: Any) -> Any:
    """Return what builds an operation: that on duals, and its record."""

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        dual = _dual_for(sign.args)
        code = duals.Builder(context, builder, dual.width)
        tape = ir.Constant(LONG, 0)
        kinds = []
        given = []
        operands: list[Value] = []
        for kind, value in zip(sign.args, values, strict=True):
            if not isinstance(kind, Traced):
                kinds.append(kind)
                given.append(value)
                continue
            direction = [0.0] * dual.width
            direction[len(operands)] = 1.0
            number = builder.extract_value(value, 0)
            kinds.append(dual)
            given.append(code.dual(number, ir.Constant(code.vector, direction)))
            operands.append(builder.extract_value(value, 1))
            tape = builder.or_(tape, builder.extract_value(value, 2))
        result, returned = code.called(key, kinds, given)
        if not isinstance(returned, duals.Dual):
            return context.cast(builder, result, returned, sign.return_type)
        number = builder.extract_value(result, 0)
        slopes = builder.extract_value(result, 1)
        place = _append(builder, tape, operands, slopes)
        return _number(context, number, place, tape, builder)

    return lower


def _defined(key: Any, counts: tuple[int, ...], literal: bool = False) -> None:
    """Define an operation on traced numbers by that on duals."""

    class Template(FirstTried):
        prefer_literal = literal

        def generic(self, args: Any, kws: Any) -> Any:
            plain = tuple(map(types.unliteral, args))
            count = sum(isinstance(kind, Traced) for kind in plain)
            if not 0 < count <= MOST_OPERANDS or len(plain) not in counts:
                return None
            dual = _dual_for(plain)
            pairs = zip(args, plain, strict=True)
            kinds = [dual if isinstance(one, Traced) else kind for kind, one in pairs]
            function = self.context.resolve_value_type(key)
            found = self.context.resolve_function_type(function, tuple(kinds), {})
            if found is None:
                return None

            def traced(kind: Any) -> Any:
                return TRACED if isinstance(kind, duals.Dual) else kind

            return traced(found.return_type)(*map(traced, found.args))

    ask_first(key, Template)
    for count in counts:
        for kinds in product((Traced, types.Any), repeat=count):
            if Traced in kinds:
                lower_builtin(key, *kinds)(_lowered(key))


def _functions_of_one() -> list[Any]:
    """Return the functions of one number that duals have."""
    found: list[Any] = []
    for name in duals.DERIVATIVES:
        found.append(getattr(math, name, None))
        for in_numpy in duals.IN_NUMPY.get(name, (name,)):
            found.append(getattr(np, in_numpy, None))
    return [one for one in found if one is not None]


OF_ONE = (
    *_functions_of_one(),
    operator.neg, operator.pos, operator.not_, np.negative, np.positive, float, bool,
    abs, np.abs, math.fabs, np.fabs, int, round,
    math.isnan, math.isinf, math.isfinite, np.isnan, np.isinf, np.isfinite,
    math.floor, math.ceil, math.trunc, np.floor, np.ceil, np.trunc, np.rint, np.sign,
)  # fmt: skip
OF_TWO = (
    operator.add, operator.iadd, np.add, operator.sub, operator.isub, np.subtract,
    operator.mul, operator.imul, np.multiply,
    operator.truediv, operator.itruediv, np.divide,
    operator.mod, operator.imod, np.mod, np.fmod,
    operator.floordiv, operator.ifloordiv, np.floor_divide,
    operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne,
    np.minimum, np.fmin, np.maximum, np.fmax,
    math.hypot, np.hypot, math.atan2, np.arctan2, math.copysign, np.copysign,
)  # fmt: skip
POWERS = (operator.pow, operator.ipow, pow, math.pow, np.power)
for _key in OF_ONE:
    _defined(_key, (1,))
for _key in OF_TWO:
    _defined(_key, (2,))
for _key in POWERS:
    _defined(_key, (2,), literal=True)
for _key in (np.where, np.interp):
    _defined(_key, (3,))
for _key in (builtins.min, builtins.max):
    _defined(_key, (2, 3, 4, 5))
