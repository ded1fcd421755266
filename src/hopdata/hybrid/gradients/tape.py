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
from itertools import product
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
)

from hopdata.hybrid.compiled.memory import NumberLike
from hopdata.hybrid.compiled.terms import (
    DOUBLE,
    LONG,
    Cells,
    Code,
    Term,
    Value,
    called,
    joined,
    lanes_of,
    parts_of,
    room,
)
from hopdata.hybrid.numbers import duals
from hopdata.hybrid.numbers.dual_type import axis, dual_of
from hopdata.hybrid.numbers.moving import plain
from hopdata.hybrid.numbers.names import POWER
from hopdata.hybrid.numbers.vectors import bare
from hopdata.private_numba import FirstTried, ask_first

FLOAT = types.float64
INT = types.int64

CELLS = 3  # of a number in an array: its value, its place, and its tape's address
HEAD = 2  # cells of a tape before its records:
IN_USE, THERE_ARE = range(HEAD)  # numbers of places
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


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = context.cast(builder, value, types.unliteral(given), FLOAT)
    return joined(builder, context.get_value_type(TRACED), number, LONG(0), LONG(0))


for _kind in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_kind, Traced)(_cast)


def _record(
    builder: Any, tape: Value, operands: list[Value], slopes: list[Value]
) -> Value:
    """Build the record of one operation with two operands, and return its place.

    Constants have no tape: theirs is written beside.
    """
    zero = LONG(0)
    spare = Cells(builder, builder.ptrtoint(room(builder, LONG, HEAD + RECORD), LONG))
    spare.store(zero, IN_USE)
    spare.store(zero, THERE_ARE)
    is_constant = builder.icmp_signed("==", tape, zero)
    cells = Cells(builder, builder.select(is_constant, spare.address, tape))
    count = cells.load(IN_USE, LONG)
    most = cells.load(THERE_ARE, LONG)
    cells.store(builder.add(count, LONG(1)), IN_USE)
    place = builder.select(builder.icmp_signed("<", count, most), count, zero)
    first = builder.mul(place, LONG(RECORD))
    for number, content in enumerate((*operands, *slopes)):
        cells.store(content, builder.add(first, LONG(HEAD + number)))
    return place


def _append(builder: Any, tape: Value, operands: list[Value], slopes: Value) -> Value:
    """Build the records of an operation, two operands at a time; return its place."""
    parts = lanes_of(builder, slopes, len(operands))
    if len(operands) == 1:
        operands = [*operands, LONG(0)]
        parts = [*parts, DOUBLE(0.0)]
    place = _record(builder, tape, operands[:2], parts[:2])
    for operand, part in zip(operands[2:], parts[2:], strict=True):
        place = _record(builder, tape, [place, operand], [DOUBLE(1.0), part])
    return place


def _dual_for(kinds: Any) -> Any:
    """Return the type of duals with a direction for each traced number."""
    count = sum(isinstance(kind, Traced) for kind in kinds)
    return duals.Dual(duals.width_for(count))


def _lowered(key: Any) -> Any:
    """Return what builds an operation: that on duals, and its record."""

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        dual = _dual_for(sign.args)
        code = Code(context, builder)
        tape = LONG(0)
        kinds = []
        given = []
        operands: list[Value] = []
        for kind, value in zip(sign.args, values, strict=True):
            if not isinstance(kind, Traced):
                kinds.append(kind)
                given.append(value)
                continue
            number, place, its_tape = parts_of(builder, value, 3)
            slopes = axis(code, dual.width, len(operands))
            kinds.append(dual)
            given.append(dual_of(Term(code, number), slopes))
            operands.append(place)
            tape = builder.or_(tape, its_tape)
        result, returned = called(code, key, kinds, given)
        if not isinstance(returned, duals.Dual):
            return context.cast(builder, result, returned, sign.return_type)
        number, slopes = parts_of(builder, result, 2)
        place = _append(builder, tape, operands, slopes)
        return joined(builder, context.get_value_type(TRACED), number, place, tape)

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


for _key, _count, _ in duals.OPERATIONS:
    if _key not in (builtins.min, builtins.max):
        _defined(_key, (_count,))
for _key in POWER:
    _defined(_key, (2,), literal=True)
for _key in (np.where, np.interp):
    _defined(_key, (3,))
for _key in (builtins.min, builtins.max):
    _defined(_key, (2, 3, 4, 5))
