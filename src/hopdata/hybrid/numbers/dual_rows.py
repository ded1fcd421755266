# ruff: noqa: ARG001, ARG005 (Numba prescribes signatures)
"""Duals from rows of numbers, and back: a value and its slopes, side by side.

The functions are for compiled code, which calls a user's function for duals and has
only numbers. Their arguments are addresses of 8-byte numbers.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir
from numba import types

from hopdata.hybrid.compiled.memory import built
from hopdata.hybrid.compiled.terms import (
    DOUBLE,
    LONG,
    Cells,
    Code,
    Term,
    Value,
    lanes_of,
    room,
    vector_of,
)
from hopdata.hybrid.numbers.dual_type import (
    WIDTHS,
    Dual,
    Slopes,
    axis,
    dual_of,
    zeros_of,
)
from hopdata.hybrid.numbers.new_arrays import make_arrays_of
from hopdata.private_numba import array_shape, array_start

FLOAT = types.float64
INT = types.int64

for _width in WIDTHS:
    make_arrays_of(Dual(_width))


def dual_at(width: int) -> Any:
    """Return a function that reads a dual from its address."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Code(context, builder)
        cells = Cells(builder, values[0])
        zeros = zeros_of(code, width)
        value = Term(code, cells.load(0))
        slopes = Term(code, cells.load(1, zeros.built.type))
        return dual_of(value, Slopes(zeros, slopes))

    return built(1, lambda address: (Dual(width)(INT), generate))


def number_along(direction: int, width: int) -> Any:
    """Return a function that makes a dual which is one of the directions."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Code(context, builder)
        return dual_of(Term(code, values[0]), axis(code, width, direction))

    return built(1, lambda value: (Dual(width)(FLOAT), generate))


def stack(count: int) -> Any:
    """Return a function that gives the address of room for numbers on the stack."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return builder.ptrtoint(room(builder, DOUBLE, max(count, 1)), LONG)

    return built(0, lambda: (INT(), generate))


# Along one direction.


@contextmanager
def _each(builder: Any, count: Value) -> Iterator[Value]:
    """Build a loop over `count` indices, whose body is built meanwhile."""
    before = builder.block
    inside = builder.append_basic_block("each")
    after = builder.append_basic_block("after")
    some = builder.icmp_signed(">", count, ir.Constant(count.type, 0))
    builder.cbranch(some, inside, after)
    builder.position_at_end(inside)
    index = builder.phi(count.type)
    index.add_incoming(ir.Constant(count.type, 0), before)
    yield index
    following = builder.add(index, ir.Constant(count.type, 1))
    index.add_incoming(following, builder.block)
    more = builder.icmp_signed("<", following, count)
    builder.cbranch(more, inside, after)
    builder.position_at_end(after)


def _transfer(context: Any, builder: Any, sign: Any, values: Any, into: bool) -> Any:
    """Build the copy of two arrays, values and slopes, into duals, or out of them."""
    cells = Cells(builder, values[0])
    kinds = sign.args[1:]
    arrays = values[1:]
    count = array_shape(context, builder, kinds[0], arrays[0])[0]
    with _each(builder, count) as index:
        twice = builder.add(index, index)
        for part in range(2):  # value and slope
            start = array_start(context, builder, kinds[part], arrays[part])
            item = builder.gep(start, [index])
            place = builder.add(twice, LONG(part))
            if into:
                cells.store(builder.load(item), place)
            else:
                builder.store(cells.load(place), item)
    return context.get_dummy_value()


def _pack(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return _transfer(context, builder, sign, values, True)


def _unpack(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return _transfer(context, builder, sign, values, False)


# Duals at an address from an array of values and one of slopes, and back.
pack = built(3, lambda room, y, dy: (types.none(INT, y, dy), _pack))
unpack = built(3, lambda room, h, hdot: (types.none(INT, h, hdot), _unpack))
# The time, whose rate is 1.
moving = number_along(0, 1)


# Along many. All is written out, so that the duals of few states need no memory.


def seed_all(n: int, width: int) -> Any:
    """Return a function that makes duals of n states, with seeds (n, n) for slopes.

    It takes the addresses of room for them, of the states, and of the seeds.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        duals, y, seeds = (Cells(builder, one) for one in values)
        vector = zeros_of(Code(context, builder), width).built.type
        for i in range(n):
            row = [seeds.load(i * n + j) for j in range(n)]
            first = i * (1 + width)
            duals.store(y.load(i), first)
            duals.store(vector_of(builder, vector, row), first + 1)
        return context.get_dummy_value()

    return built(3, lambda room, y, seeds: (types.none(INT, INT, INT), generate))


def each_alone(n: int, width: int) -> Any:
    """Return a function that makes duals of n states, which are the directions.

    It takes the addresses of room for them and of the states.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        duals, y = (Cells(builder, one) for one in values)
        code = Code(context, builder)
        for i in range(n):
            first = i * (1 + width)
            duals.store(y.load(i), first)
            duals.store(axis(code, width, i).all.built, first + 1)
        return context.get_dummy_value()

    return built(2, lambda room, y: (types.none(INT, INT), generate))


def harvest_all(n: int, width: int, *, timed: bool) -> Any:
    """Return a function that writes the slopes of n duals as a matrix (n, n).

    It takes the addresses of the duals, of the matrix, and of room for the slopes along
    direction n, which are written if `timed`.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        duals, into, into_last = (Cells(builder, one) for one in values)
        vector = zeros_of(Code(context, builder), width).built.type
        n_read = n + 1 if timed else n
        for i in range(n):
            slopes = duals.load(i * (1 + width) + 1, vector)
            lanes = lanes_of(builder, slopes, n_read)
            for j in range(n):
                into.store(lanes[j], i * n + j)
            if timed:
                into_last.store(lanes[n], i)
        return context.get_dummy_value()

    return built(3, lambda room, into, last: (types.none(INT, INT, INT), generate))
