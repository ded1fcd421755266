# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""Products of small matrices that stand in one table, in vector instructions.

A compiler that does not know that two blocks of a table are apart must write each sum to memory
before it reads the next factor. Here rows are loaded as vectors once, and stay in registers. Sums
are taken in the order of the indices, each product and sum rounded once (see `fused`), whatever the
width of the machine's vectors.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

DOUBLE, INDEX, LANE = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
ALIGNMENT = 8  # of a row, in bytes
WIDEST = 8  # columns that are worked on at a time


class _Block:
    """Some columns of n rows of a table, from a row on."""

    def __init__(self, builder: Any, data: Any, row: Any, n: int, columns: range) -> None:
        self._builder, self._n, self._first = builder, n, columns.start
        self._start = builder.gep(data, [builder.mul(row, ir.Constant(INDEX, n))])
        self.kind = ir.VectorType(DOUBLE, len(columns))

    def _place(self, i: int) -> Any:
        offset = ir.Constant(INDEX, i * self._n + self._first)
        place = self._builder.gep(self._start, [offset])
        return self._builder.bitcast(place, self.kind.as_pointer())

    def load(self, i: int) -> Any:
        return self._builder.load(self._place(i), align=ALIGNMENT)

    def store(self, i: int, value: Any) -> None:
        self._builder.store(value, self._place(i), align=ALIGNMENT)


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    """Return a vector with this number in each place."""
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(LANE, 0))
    places = ir.Constant(ir.VectorType(LANE, kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, nothing, places)


def _fma(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c of vectors, rounded once."""
    kind = c.type
    name = f"llvm.fma.v{kind.count}f64"
    signature = ir.FunctionType(kind, [kind] * 3)
    return builder.call(cgutils.get_or_insert_function(builder.module, signature, name), [a, b, c])


def _product_of_columns(
    builder: Any,
    data: Any,
    rows: list[Any],
    added_to: tuple[Any, Any] | None,
    n: int,
    columns: range,
) -> None:
    target, right = (_Block(builder, data, rows[k], n, columns) for k in (0, 2))
    left = builder.gep(data, [builder.mul(rows[1], ir.Constant(INDEX, n))])
    factors = [right.load(k) for k in range(n)]
    for i in range(n):
        total = None
        for k in range(n):
            one = builder.load(builder.gep(left, [ir.Constant(INDEX, i * n + k)]))
            one = _spread(builder, one, target.kind)
            first = total is None
            total = (
                builder.fmul(one, factors[k]) if first else _fma(builder, one, factors[k], total)
            )
        if added_to is not None:
            base = _Block(builder, data, added_to[0], n, columns)
            scale = _spread(builder, added_to[1], target.kind)
            total = _fma(builder, scale, total, base.load(i))
        target.store(i, total)


def _product(
    context: Any, builder: Any, kind: Any, table: Any, rows: list[Any], added_to: Any, n: int
) -> Any:
    data = cgutils.create_struct_proxy(kind)(context, builder, table).data
    for first in range(0, n, WIDEST):
        columns = range(first, min(first + WIDEST, n))
        _product_of_columns(builder, data, rows, added_to, n, columns)
    return context.get_dummy_value()


@intrinsic(prefer_literal=True)
def _multiply(typing: Any, table: Any, target: Any, left: Any, right: Any, n: Any) -> Any:
    """Write left right into the block `target`, which is neither; all are (n, n)."""
    if not isinstance(n, types.IntegerLiteral):
        return None
    size, row = n.literal_value, types.int64

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return _product(context, builder, sign.args[0], values[0], values[1:4], None, size)

    return types.none(table, row, row, row, n), generate


@intrinsic(prefer_literal=True)
def _add_product(
    typing: Any, table: Any, target: Any, base: Any, left: Any, right: Any, factor: Any, n: Any
) -> Any:
    """Write base + factor left right into the block `target`; all are (n, n), n is a constant.

    Blocks are named by their first rows. The target is none of the others.
    """
    if not isinstance(n, types.IntegerLiteral):
        return None
    size, row = n.literal_value, types.int64

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        rows, added_to = [values[1], *values[3:5]], (values[2], values[5])
        return _product(context, builder, sign.args[0], values[0], rows, added_to, size)

    return types.none(table, row, row, row, row, types.float64, n), generate


multiply: Any = _multiply
add_product: Any = _add_product
