# ruff: noqa: ARG001, PLW0108 (Numba prescribes signatures and their names)
"""Parts, sums and products of arrays of ranges, as NumPy writes them for vectors."""

import operator
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import lower_builtin, overload, overload_method

from hopdata.hybrid.compiled.memory import is_number
from hopdata.hybrid.numbers import vectors
from hopdata.hybrid.numbers.arithmetic import EPS
from hopdata.hybrid.numbers.new_arrays import make_arrays_of
from hopdata.hybrid.numbers.operators import wide
from hopdata.hybrid.numbers.ranges import (
    BYTES,
    INF,
    LONG,
    RANGE,
    RESULTS,
    ROWS,
    Members,
    _Range,
    _Rows,
    make,
)
from hopdata.private_numba import tried_first

VECTORS = (ROWS, RESULTS)


def _is_vector(kind: Any) -> bool:
    """Return whether a type is that of a vector of ranges or of numbers."""
    return kind in VECTORS or (isinstance(kind, types.Array) and kind.ndim == 1)


# Slices without a step.


def _typed_slice(owner: Any, i: Any) -> Any:
    if owner in VECTORS and isinstance(i, types.SliceType) and not i.has_step:
        return owner(owner, types.slice2_type)
    return None


def _within(builder: Any, place: Any, n: Any) -> Any:
    """Build a place between 0 and n, counted from the end if it is negative."""
    from_end = builder.icmp_signed("<", place, LONG(0))
    place = builder.select(from_end, builder.add(place, n), place)
    is_low = builder.icmp_signed("<", place, LONG(0))
    place = builder.select(is_low, LONG(0), place)
    return builder.select(builder.icmp_signed(">", place, n), n, place)


def _slice(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    rows = Members(builder, values[0])
    first = _within(builder, builder.extract_value(values[1], 0), rows.n)
    last = _within(builder, builder.extract_value(values[1], 1), rows.n)
    count = builder.sub(last, first)
    is_empty = builder.icmp_signed("<", count, LONG(0))
    rows.n = builder.select(is_empty, LONG(0), count)
    rows.data = builder.add(rows.data, builder.mul(first, LONG(BYTES)))
    return rows.packed()


tried_first(operator.getitem, _typed_slice)
lower_builtin(operator.getitem, _Rows, types.SliceType)(_slice)


def _typed_fill(owner: Any, i: Any, x: Any) -> Any:
    kind = types.unliteral(x)
    is_part = isinstance(i, types.SliceType) and not i.has_step
    if owner == RESULTS and is_part and (kind == RANGE or is_number(kind)):
        return types.none(owner, types.slice2_type, kind)
    if owner == RESULTS and is_part and _is_vector(kind):
        return types.none(owner, types.slice2_type, kind)
    return None


def _fill(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build the writing of one value to all of a slice, or of a vector to it."""

    def fill(rows: Any, i: Any, x: Any) -> None:
        part = rows[i]
        for k in range(len(part)):
            part[k] = x

    def copy(rows: Any, i: Any, x: Any) -> None:
        part = rows[i]
        for k in range(len(part)):
            part[k] = x[k]

    chosen = copy if _is_vector(sign.args[2]) else fill
    return context.compile_internal(builder, chosen, sign, values)


tried_first(operator.setitem, _typed_fill)
lower_builtin(operator.setitem, _Rows, types.SliceType, types.Any)(_fill)


# Elements of an array of numbers by what `math.floor` returns, say.


def _typed_element(owner: Any, i: Any) -> Any:
    if isinstance(owner, types.Array) and owner.ndim == 1 and i == RANGE:
        return owner.dtype(owner, i)
    return None


def _element(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    def element(array: Any, x: Any) -> Any:
        return array[int(x)]

    return context.compile_internal(builder, element, sign, values)


tried_first(operator.getitem, _typed_element)
lower_builtin(operator.getitem, types.Array, _Range)(_element)


# Sums and extremes.


@njit
def _total(a: Any) -> Any:
    total = wide(0.0)
    for i in range(len(a)):
        total = total + a[i]
    return total


@njit
def _least(a: Any) -> Any:
    least = wide(a[0])
    for i in range(1, len(a)):
        least = min(least, a[i])
    return least


@njit
def _largest(a: Any) -> Any:
    largest = wide(a[0])
    for i in range(1, len(a)):
        largest = max(largest, a[i])
    return largest


@njit
def _norm(a: Any) -> Any:
    size = abs(wide(a[0]))
    for i in range(1, len(a)):
        size = np.hypot(size, a[i])
    return size


@njit
def _dot(a: Any, b: Any) -> Any:
    """Return the sum of products, which NumPy may add in any order."""
    total = wide(0.0)
    size = 0.0
    fastest = 0.0
    for i in range(len(a)):
        product = wide(a[i] * b[i])
        total = total + product
        size += max(abs(product.lo), abs(product.hi))
        fastest += max(abs(product.dlo), abs(product.dhi))
    error = EPS * len(a) * size
    if not size < INF:
        error = INF
    return make(total.lo - error, total.hi + error, total.dlo, total.dhi, total.at)


def _of_one(function: Any) -> Any:
    """Return what a function of one array means for ranges."""

    def typed(a: Any) -> Any:
        return (lambda a: function(a)) if a in VECTORS else None

    return lambda a: typed(a)  # Numba compares annotations, too


def _product(a: Any, b: Any) -> Any:
    if _is_vector(a) and _is_vector(b) and (a in VECTORS or b in VECTORS):
        return lambda a, b: _dot(a, b)
    return None


for _key, _function in (
    (np.sum, _total),
    (np.min, _least),
    (np.max, _largest),
    (np.linalg.norm, _norm),
):
    overload(_key)(_of_one(_function))
for _name, _function in (("sum", _total), ("min", _least), ("max", _largest)):
    overload_method(_Rows, _name)(_of_one(_function))
overload(np.dot)(lambda a, b: _product(a, b))
overload(operator.matmul)(lambda a, b: _product(a, b))


# Arrays of ranges that a function makes itself.

make_arrays_of(RANGE)
vectors.ROUNDED[RANGE] = vectors.bare(_dot.py_func)


# Python could not take an array of ranges.
ONLY_COMPILED: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


@njit(**ONLY_COMPILED)
def as_array(rows: Any) -> Any:
    """Return an array of the ranges that stand in rows."""
    made = np.zeros(len(rows))  # of ranges, as the rows are
    for i in range(len(rows)):
        made[i] = rows[i]
    return made
