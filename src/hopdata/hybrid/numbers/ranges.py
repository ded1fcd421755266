# ruff: noqa: ARG001, ARG005, PLW0108 (Numba prescribes signatures)
"""A Numba type of ranges, for which a user's guards compile as they are.

A `Range` says that over a piece of a step a quantity lies between `lo` and `hi`, and
its rate of change between `dlo` and `dhi`. The rate is a generalised derivative: where
the quantity has a kink, it contains the slopes of both sides, so the mean value theorem
holds. Where the quantity may jump, the rate is anything. Each range carries the address
`at` of the memory of answers (`numbers.answers`).

This module has the type, its arrays and its conversions; `numbers.operators` says what
operators and functions mean for it, and `numbers.library` has the longer of them.
NaN in a range stands for "anything".
"""

import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import (
    lower_builtin,
    lower_cast,
    models,
    overload,
    overload_attribute,
    register_model,
)

from hopdata.hybrid.compiled import terms
from hopdata.hybrid.compiled.digest import sources_digest
from hopdata.hybrid.compiled.memory import NumberLike, built, is_scalar
from hopdata.hybrid.compiled.terms import BYTES, DOUBLE, LANE, LONG
from hopdata.private_numba import tried_first

Function = Callable[..., Any]

# Changes with the sources of the ranges' operations.
DIGEST = sources_digest(Path(__file__).parents[1], "numbers")
INF = float("inf")
FLOAT = types.float64
INT = types.int64
FOUR = ir.VectorType(DOUBLE, 4)
VALUE = ir.LiteralStructType([FOUR, LONG])
# In memory, which need not be aligned as a vector.
STORED = ir.LiteralStructType([ir.ArrayType(DOUBLE, 4), LONG])
ENDS = {"lo": 0, "hi": 1, "dlo": 2, "dhi": 3}


class _OfSources(types.Type):
    """A type that differs from that of other sources of its operations.

    A function that Numba keeps for it is then compiled anew: what it calls is gone.
    """

    is_kept = False  # see `code_cache`

    def __init__(self, name: str) -> None:
        self.sources = DIGEST
        super().__init__(name)

    @property
    def key(self) -> Any:
        """What makes two types equal; one kept by an older version has no sources."""
        return self.name, vars(self).get("sources", "")


class _Range(_OfSources, NumberLike):
    """The type of a range."""


class _Rows(_OfSources):
    """The type of `n` ranges by address.

    Their four rows are `stride` numbers apart. `rated` is 1; or, if their rates are not
    known, 0, or -1 for the same ranges with the other sign.
    """

    @property
    def numbers(self) -> Any:
        """The type of its numbers."""
        return RANGE


class _Sink(_OfSources):
    """The type of an array that forgets what is written to it.

    So it need not be computed.
    """


RANGE = _Range("Range")
ROWS = _Rows("RangeRows")  # are only read
RESULTS = _Rows("RangeResults")
# The same, only written. Instead of `rated` it has the address of a number for each of
# them; where that is 0, nothing is written. The compiler then moves what computes it to
# where it is written.
CHOSEN = _Rows("RangeChosen")
SINK = _Sink("RangeSink")
ARRAYS = (ROWS, RESULTS, CHOSEN, SINK)
ROW_MEMBERS = ("data", "n", "stride", "rated", "at")
MEMBERS = {
    ROWS: ROW_MEMBERS,
    RESULTS: ROW_MEMBERS,
    CHOSEN: ROW_MEMBERS,
    SINK: ("n", "at"),
}


@register_model(_Range)
class _RangeModel(models.PrimitiveModel):
    """A vector of the four ends, and an address."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VALUE)

    def get_data_type(self) -> Any:
        return STORED

    def as_data(self, builder: Any, value: Any) -> Any:
        four, at = parts(builder, value)
        stored = ir.Constant(STORED, ir.Undefined)
        for place in range(4):
            one = builder.extract_element(four, LANE(place))
            stored = builder.insert_value(stored, one, [0, place])
        return builder.insert_value(stored, at, 1)

    def from_data(self, builder: Any, value: Any) -> Any:
        ends = [builder.extract_value(value, [0, place]) for place in range(4)]
        return joined(builder, four_of(builder, ends), builder.extract_value(value, 1))


def _model(members: tuple[str, ...]) -> Any:
    def make(self: Any, manager: Any, kind: Any) -> None:
        items = [(name, INT) for name in members]
        models.StructModel.__init__(self, manager, kind, items)

    return type("Model", (models.StructModel,), {"__init__": make})


register_model(_Rows)(_model(ROW_MEMBERS))
register_model(_Sink)(_model(MEMBERS[SINK]))


# Parts of a range, in generated code.


def parts(builder: Any, value: Any) -> tuple[Any, Any]:
    """Build the four ends of a range, and its address."""
    four, at = terms.parts_of(builder, value, 2)
    return four, at


def joined(builder: Any, four: Any, at: Any) -> Any:
    """Build a range from its four ends and its address."""
    return terms.joined(builder, VALUE, four, at)


def four_of(builder: Any, ends: Any) -> Any:
    """Build the vector of four ends."""
    return terms.vector_of(builder, FOUR, ends)


def end(builder: Any, four: Any, name: str) -> Any:
    """Build one of four ends."""
    return builder.extract_element(four, LANE(ENDS[name]))


def _make(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return joined(builder, four_of(builder, values[:4]), values[4])


make = built(5, lambda *_: (RANGE(FLOAT, FLOAT, FLOAT, FLOAT, INT), _make))


def _read(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    four = terms.Cells(builder, values[0]).load(0, FOUR)
    return joined(builder, four, values[1])


def _write(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    four, _ = parts(builder, values[0])
    terms.Cells(builder, values[1]).store(four, 0)
    return context.get_dummy_value()


range_at = built(2, lambda *_: (RANGE(INT, INT), _read))  # of four ends side by side
put_range = built(2, lambda *_: (types.none(RANGE, INT), _write))


def _attribute(name: str) -> Any:
    """Return a function for compiled code that takes one part of a range."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        four, at = parts(builder, values[0])
        return at if name == "at" else end(builder, four, name)

    kind = INT if name == "at" else FLOAT
    return built(1, lambda _: (kind(RANGE), generate))


def _give_attribute(kind: Any, name: str, function: Any) -> None:
    """Give a type an attribute, which is a function of the value."""
    overload_attribute(kind, name)(lambda x: lambda x: function(x))


for _name in (*ENDS, "at"):
    _give_attribute(_Range, _name, _attribute(_name))


# Numbers as ranges.


def number(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build a float from a number of any type."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Array):
        value = builder.load(context.make_array(kind)(context, builder, value).data)
        kind = kind.dtype
    return context.cast(builder, value, kind, FLOAT)


def as_range(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build a range from a range, or from a number, which needs no address."""
    if kind == RANGE:
        return value
    one = number(context, builder, kind, value)
    zero = DOUBLE(0.0)
    return joined(builder, four_of(builder, (one, one, zero, zero)), LONG(0))


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return as_range(context, builder, given, value)


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, _Range)(_cast)


# Arrays of ranges.


class Members:
    """The members of an array of ranges, in generated code.

    They may be replaced before the array is `packed` again.
    """

    def __init__(self, builder: Any, value: Any) -> None:
        self.data: Any
        self.n: Any
        self.stride: Any
        self.rated: Any
        self.at: Any
        self._builder = builder
        for place, name in enumerate(ROW_MEMBERS):
            setattr(self, name, builder.extract_value(value, place))

    def packed(self) -> Any:
        """Build the array."""
        return _packed(self._builder, [getattr(self, name) for name in ROW_MEMBERS])


def _packed(builder: Any, values: Any) -> Any:
    """Build a structure of integers."""
    kind = ir.LiteralStructType(len(values) * [LONG])
    made = ir.Constant(kind, ir.Undefined)
    for place, value in enumerate(values):
        made = builder.insert_value(made, value, place)
    return made


def _maker(kind: Any) -> Any:
    """Return a function for compiled code that makes an array from its members."""
    names = MEMBERS[kind]

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return _packed(builder, values)

    return built(len(names), lambda *_: (kind(*(INT for _ in names)), generate))


rows_at = _maker(ROWS)
results_at = _maker(RESULTS)
chosen_at = _maker(CHOSEN)
sink = _maker(SINK)


def _is_index(kind: Any) -> bool:
    return isinstance(kind, types.Integer)


def _typed_get(owner: Any, i: Any) -> Any:
    if owner in ARRAYS and owner != CHOSEN and _is_index(i):
        return RANGE(owner, INT)
    return None


def _typed_set(owner: Any, i: Any, x: Any) -> Any:
    kind = types.unliteral(x)
    if owner == SINK:
        return types.none(owner, types.unliteral(i), kind)
    is_written = owner in (RESULTS, CHOSEN)
    if is_written and _is_index(i) and (kind == RANGE or is_scalar(kind)):
        return types.none(owner, INT, kind)
    return None


def _pointer(builder: Any, rows: Any, i: Any, step: Any) -> Any:
    """Build the address of a number `step` numbers after the least end of range i."""
    from_end = builder.icmp_signed("<", i, LONG(0))
    place = builder.select(from_end, builder.add(i, rows.n), i)
    bytes_on = builder.mul(builder.add(place, step), LONG(BYTES))
    return builder.inttoptr(builder.add(rows.data, bytes_on), DOUBLE.as_pointer())


def _steps(builder: Any, rows: Any, is_rated: Any) -> list[Any]:
    """Build how far the four ends are apart; unknown rates are not read."""
    twice = builder.add(rows.stride, rows.stride)
    to_rates = builder.select(is_rated, twice, LONG(0))
    return [LONG(0), rows.stride, to_rates, builder.add(rows.stride, to_rates)]


def _item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    rows = Members(builder, values[0])
    is_rated = builder.icmp_signed("==", rows.rated, LONG(1))
    ends = []
    for step in _steps(builder, rows, is_rated):
        pointer = _pointer(builder, rows, values[1], step)
        ends.append(builder.load(pointer))
    lo, hi, dlo, dhi = ends
    is_turned = builder.icmp_signed("<", rows.rated, LONG(0))
    least = builder.select(is_turned, builder.fneg(hi), lo)
    most = builder.select(is_turned, builder.fneg(lo), hi)
    least_rate = builder.select(is_rated, dlo, DOUBLE(-INF))
    most_rate = builder.select(is_rated, dhi, DOUBLE(INF))
    four = four_of(builder, (least, most, least_rate, most_rate))
    return joined(builder, four, rows.at)


def _store(builder: Any, rows: Any, i: Any, four: Any) -> None:
    """Build what writes four ends as range i of the rows."""
    for name, step in zip(ENDS, _steps(builder, rows, ir.IntType(1)(1)), strict=True):
        pointer = _pointer(builder, rows, i, step)
        builder.store(end(builder, four, name), pointer)


def _put(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    rows = Members(builder, values[0])
    i = values[1]
    four, _ = parts(builder, as_range(context, builder, sign.args[2], values[2]))
    if sign.args[0] != CHOSEN:
        _store(builder, rows, i, four)
        return context.get_dummy_value()
    from_end = builder.icmp_signed("<", i, LONG(0))
    place = builder.select(from_end, builder.add(i, rows.n), i)
    where = builder.add(rows.rated, builder.mul(place, LONG(BYTES)))
    chosen = builder.load(builder.inttoptr(where, LONG.as_pointer()))
    with builder.if_then(builder.icmp_signed("!=", chosen, LONG(0))):
        _store(builder, rows, i, four)
    return context.get_dummy_value()


def _forgotten(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    at = builder.extract_value(values[0], MEMBERS[SINK].index("at"))
    return joined(builder, ir.Constant(FOUR, [-INF, INF, -INF, INF]), at)


def _forget(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return context.get_dummy_value()


tried_first(operator.getitem, _typed_get)
tried_first(operator.setitem, _typed_set)
lower_builtin(operator.getitem, _Rows, types.Integer)(_item)
lower_builtin(operator.getitem, _Sink, types.Integer)(_forgotten)
lower_builtin(operator.setitem, _Rows, types.Integer, types.Any)(_put)
lower_builtin(operator.setitem, _Sink, types.Any, types.Any)(_forget)


def _length(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return builder.extract_value(values[0], MEMBERS[sign.args[0]].index("n"))


def _shape(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    made = ir.Constant(ir.ArrayType(LONG, 1), ir.Undefined)
    return builder.insert_value(made, _length(context, builder, sign, values), 0)


tried_first(len, lambda owner: INT(owner) if owner in ARRAYS else None)
lower_builtin(len, _Rows)(_length)
lower_builtin(len, _Sink)(_length)
_length_of = built(1, lambda owner: (INT(owner), _length))
_shape_of = built(1, lambda owner: (types.UniTuple(INT, 1)(owner), _shape))
for _array in (_Rows, _Sink):
    _give_attribute(_array, "size", _length_of)
    _give_attribute(_array, "shape", _shape_of)


def _part(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build the rows from one index on, up to another."""
    rows = Members(builder, values[0])
    _, first, last = values
    rows.data = builder.add(rows.data, builder.mul(first, LONG(BYTES)))
    rows.n = builder.sub(last, first)
    return rows.packed()


def _turned(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build the rows with the other sign; their rates must not be known."""
    rows = Members(builder, values[0])
    is_turned = builder.icmp_signed("<", rows.rated, LONG(0))
    rows.rated = builder.select(is_turned, LONG(0), LONG(-1))
    return rows.packed()


_part_of_rows = built(3, lambda *_: (ROWS(ROWS, INT, INT), _part))
_turned_rows = built(1, lambda *_: (ROWS(ROWS), _turned))


def part(rows: Any, first: Any, last: Any) -> Any:
    """Return the ranges from one index on, up to another, for compiled code."""


def turned(rows: Any) -> Any:
    """Return ranges with the other sign; if they stand in rows, without known rates."""


def _typed_part(rows: Any, first: Any, last: Any) -> Any:
    if rows == ROWS:
        return lambda rows, first, last: _part_of_rows(rows, first, last)
    return lambda rows, first, last: rows[first:last]


def _typed_turned(rows: Any) -> Any:
    if rows == ROWS:
        return lambda rows: _turned_rows(rows)
    if not getattr(rows, "known", True):
        # Rows of lanes of which nothing is known (`lanes.ranges`).
        return lambda rows: rows
    return lambda rows: -rows


overload(part)(lambda rows, first, last: _typed_part(rows, first, last))
overload(turned)(lambda rows: _typed_turned(rows))


def part_of_results(rows: Any, first: Any, last: Any) -> Any:
    """Return the results from one index on, up to another, for compiled code."""


_part_of_results = built(3, lambda *_: (RESULTS(RESULTS, INT, INT), _part))


def _typed_part_of_results(rows: Any, first: Any, last: Any) -> Any:
    if rows == RESULTS:
        return lambda rows, first, last: _part_of_results(rows, first, last)
    return lambda rows, first, last: rows[first:last]


overload(part_of_results)(
    lambda rows, first, last: _typed_part_of_results(rows, first, last)
)
