"""Vector instructions for the compiled kernels: eight doubles at a time, said outright.

LLVM vectorises loops over arrays only after it has asked at run time whether they overlap, which
costs more than the short rows of a normal matrix. These few functions are written as vector code
instead. They neither fuse nor reorder: each sum runs over its terms in the order given, so that the
bytes are the same on every processor.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

#: Doubles in a vector; rows that these functions work on are padded to a multiple of it.
WIDTH = 8
#: Rows of a tile: as many sums as the processor can keep in registers.
TILE_ROWS = 4 if get_host_cpu_features().get("avx512f", False) else 2

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_WORD = ir.IntType(64)


@intrinsic  # type: ignore[misc]
def gram_tile(typing, rows, index, a, b, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Fill ``out[a:a + TILE_ROWS, b:b + 8]`` with the products of columns of ``rows[index]``."""
    return types.void(rows, index, a, b, out), _gram_tile(1)


@intrinsic  # type: ignore[misc]
def gram_tile_wide(typing, rows, index, a, b, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """As `gram_tile`, for 16 columns."""
    return types.void(rows, index, a, b, out), _gram_tile(2)


@intrinsic  # type: ignore[misc]
def gram_tile_widest(typing, rows, index, a, b, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """As `gram_tile`, for 24 columns."""
    return types.void(rows, index, a, b, out), _gram_tile(3)


@intrinsic  # type: ignore[misc]
def subtract_row(typing, matrix, i, k, factor, first):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Do ``matrix[i, first:] -= factor * matrix[k, first:]``; `first` is a multiple of 8."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        matrix = _Matrix(context, builder, signature.args[0], args[0])
        _, i, k, factor, first = args
        spread = _splat(builder, factor)
        with _blocks(builder, first, matrix.columns) as column:
            there, here = matrix.place(k, column), matrix.place(i, column)
            product = builder.fmul(spread, _load(builder, there))
            _store(builder, builder.fsub(_load(builder, here), product), here)
        return context.get_dummy_value()

    return types.void(matrix, i, k, types.float64, first), generate


@intrinsic  # type: ignore[misc]
def squared_misses(typing, rows, index, slopes, count, first, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Fill ``out[first:]`` with the sums of squares of ``rows - rows[:, :count] @ slopes``.

    Over the rows `index`; `first` is a multiple of 8.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows = _Matrix(context, builder, signature.args[0], args[0])
        index = _Matrix(context, builder, signature.args[1], args[1])
        slopes = _Matrix(context, builder, signature.args[2], args[2])
        count, first = args[3], args[4]
        out = _Matrix(context, builder, signature.args[5], args[5])
        total = cgutils.alloca_once(builder, _VECTOR)
        misses = [cgutils.alloca_once(builder, _VECTOR) for _ in range(TILE_ROWS)]
        last = builder.sub(index.rows, _WORD(1))
        with _blocks(builder, first, rows.columns) as column:
            builder.store(_VECTOR(None), total)
            with cgutils.for_range_slice(
                builder, _WORD(0), index.rows, _WORD(TILE_ROWS), _WORD
            ) as (place, _):
                places = [builder.add(place, _WORD(r)) for r in range(TILE_ROWS)]
                inside = [builder.icmp_signed("<=", at, last) for at in places]
                tested = [
                    builder.load(index.place(builder.select(one, at, last)))
                    for one, at in zip(inside, places, strict=True)
                ]
                for row, miss in zip(tested, misses, strict=True):
                    builder.store(_load(builder, rows.place(row, column)), miss)
                with cgutils.for_range(builder, count) as term:
                    slope = _load(builder, slopes.place(term.index, column))
                    for row, miss in zip(tested, misses, strict=True):
                        spread = _splat(builder, builder.load(rows.place(row, term.index)))
                        part = builder.fmul(spread, slope)
                        builder.store(builder.fsub(builder.load(miss), part), miss)
                for one, miss in zip(inside, misses, strict=True):
                    value = builder.load(miss)
                    square = builder.select(one, builder.fmul(value, value), _VECTOR(None))
                    builder.store(builder.fadd(builder.load(total), square), total)
            _store(builder, builder.load(total), out.place(column))
        return context.get_dummy_value()

    return types.void(rows, index, slopes, count, first, out), generate


def _gram_tile(vectors: int) -> Any:
    """Return the code generator of a tile that is `vectors` wide."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows = _Matrix(context, builder, signature.args[0], args[0])
        index = _Matrix(context, builder, signature.args[1], args[1])
        out = _Matrix(context, builder, signature.args[4], args[4])
        a, b = args[2], args[3]
        columns = [builder.add(b, _WORD(WIDTH * v)) for v in range(vectors)]
        lines = [builder.add(a, _WORD(r)) for r in range(TILE_ROWS)]
        sums = {
            (r, v): cgutils.alloca_once(builder, _VECTOR)
            for r in range(TILE_ROWS)
            for v in range(vectors)
        }
        for place in sums.values():
            builder.store(_VECTOR(None), place)
        with cgutils.for_range(builder, index.rows) as each:
            row = builder.load(index.place(each.index))
            right = [_load(builder, rows.place(row, column)) for column in columns]
            left = [_splat(builder, builder.load(rows.place(row, line))) for line in lines]
            for (r, v), place in sums.items():
                product = builder.fmul(left[r], right[v])
                builder.store(builder.fadd(builder.load(place), product), place)
        for (r, v), place in sums.items():
            _store(builder, builder.load(place), out.place(lines[r], columns[v]))
        return context.get_dummy_value()

    return generate


class _Matrix:
    """Address arithmetic of a contiguous array of one or two axes."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        array = cgutils.create_struct_proxy(kind)(context, builder, value=value)
        shape = cgutils.unpack_tuple(builder, array.shape)
        self._builder, self._data = builder, array.data
        self.rows, self.columns = shape[0], shape[-1]

    def place(self, *indices: Any) -> Any:
        """Return the address of an element."""
        flat = indices[0]
        if len(indices) == 2:
            flat = self._builder.add(self._builder.mul(flat, self.columns), indices[1])
        return self._builder.gep(self._data, [flat])


@contextmanager
def _blocks(builder: Any, first: Any, end: Any) -> Iterator[Any]:
    """Loop over the first columns of the blocks of 8 from `first` to `end`."""
    with cgutils.for_range_slice(builder, first, end, _WORD(WIDTH), _WORD) as (column, _):
        yield column


def _splat(builder: Any, scalar: Any) -> Any:
    single = builder.insert_element(_VECTOR(ir.Undefined), scalar, ir.IntType(32)(0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(single, _VECTOR(ir.Undefined), lanes)


def _load(builder: Any, place: Any) -> Any:
    return builder.load(builder.bitcast(place, _VECTOR.as_pointer()), align=8)


def _store(builder: Any, value: Any, place: Any) -> None:
    builder.store(value, builder.bitcast(place, _VECTOR.as_pointer()), align=8)
