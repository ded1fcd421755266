# ruff: noqa: ARG001 (Numba prescribes signatures)
"""Arrays of ranges and of duals: what NumPy's functions and operators mean for them.

Arithmetic of whole arrays and NumPy's functions of each element are those of single
numbers: here they only get a type, and Numba makes the loop, as it does for floats.
Sums and products are written out; `numbers.new_arrays` makes arrays.
"""

import builtins
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    lower_builtin,
    overload,
    register_jitable,
)

from hopdata.hybrid.compiled.memory import NumberLike, is_number
from hopdata.private_numba import FirstTried, ask_first, method_first

Function = Callable[..., Any]


def overload_first(key: Any) -> Any:
    """Return Numba's `overload`, asked before what Numba defines for every target."""
    options: dict[str, Any] = {"target": "cpu"}
    return overload(key, **options)


def bare(function: Function) -> Function:
    """Return a function without annotations, which Numba would compare."""
    function.__annotations__ = {}
    return function


# Which types are ours.


def ours_of(kind: Any) -> Any:
    """Return the type of our numbers that a type consists of, or None."""
    if isinstance(kind, NumberLike):
        return kind
    if isinstance(kind, types.Array | types.List | types.UniTuple):
        return ours_of(kind.dtype)
    if isinstance(kind, types.BaseTuple):
        return ours_among(kind)
    return getattr(kind, "numbers", None)


def ours_among(kinds: Any) -> Any:
    """Return the type of our numbers that one of the types consists of, or None."""
    for kind in kinds:
        found = ours_of(kind)
        if found is not None:
            return found
    return None


def is_array(kind: Any, ndim: int | None = None) -> bool:
    """Return whether a type is that of an array of our numbers."""
    if not isinstance(kind, types.Array) or not isinstance(kind.dtype, NumberLike):
        return False
    return ndim is None or kind.ndim == ndim


def holds_numbers(kind: Any) -> bool:
    """Return whether a type is that of an array of numbers, ours or Numba's."""
    if not isinstance(kind, types.Array):
        return False
    return isinstance(kind.dtype, NumberLike) or is_number(kind.dtype)


def _is_row(kind: Any) -> bool:
    return holds_numbers(kind) and kind.ndim == 1


# Arithmetic and functions of each element.

OPERATORS = {
    operator.add: "+", operator.sub: "-", operator.mul: "*", operator.truediv: "/",
    operator.floordiv: "//", operator.mod: "%", operator.pow: "**", operator.lt: "<",
    operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "==",
    operator.ne: "!=",
}  # fmt: skip
UFUNCS = {one for one in vars(np).values() if isinstance(one, np.ufunc)}


def _elementwise(key: Any) -> None:
    """Give an operator or a function a type for arrays of our numbers.

    Numba replaces it by a loop over the elements.
    """

    class Elementwise(FirstTried):
        def generic(self, args: Any, kws: Any) -> Any:
            if kws or not any(map(is_array, args)):
                return None
            if any(isinstance(one, NumberLike) for one in args):
                return None
            items = [one.dtype if isinstance(one, types.Array) else one for one in args]
            sign = self.context.resolve_function_type(key, tuple(items), {})
            if sign is None:
                return None
            ndim = max(getattr(one, "ndim", 0) for one in args)
            return types.Array(sign.return_type, ndim, "C")(*args)

    ask_first(key, Elementwise)


for _key in (*OPERATORS, operator.neg, operator.pos, *UFUNCS):
    _elementwise(_key)


def _with_number(key: Any, sign: str) -> None:
    """Give an operator a meaning for an array and one of our numbers.

    Numba's loops know only numbers of its own, so the number becomes an array.
    """
    scope: dict[str, Any] = {"np": np}
    exec(f"def left(a, b): return np.full(1, a) {sign} b", scope)
    exec(f"def right(a, b): return a {sign} np.full(1, b)", scope)

    @bare
    def typed(a: Any, b: Any) -> Any:
        if isinstance(a, NumberLike) and holds_numbers(b) and b.ndim > 0:
            return scope["left"]
        if isinstance(b, NumberLike) and holds_numbers(a) and a.ndim > 0:
            return scope["right"]
        return None

    overload_first(key)(typed)


for _key, _sign in OPERATORS.items():
    _with_number(_key, _sign)


def _in_place(key: Any, sign: str) -> None:
    scope: dict[str, Any] = {}
    exec(f"def changed(a, b):\n    a[...] = a {sign} b\n    return a", scope)

    @bare
    def typed(a: Any, b: Any) -> Any:
        return scope["changed"] if is_array(a) else None

    overload_first(key)(typed)


for _key, _sign in (
    (operator.iadd, "+"), (operator.isub, "-"), (operator.imul, "*"),
    (operator.itruediv, "/"), (operator.ifloordiv, "//"), (operator.imod, "%"),
    (operator.ipow, "**"),
):  # fmt: skip
    _in_place(_key, _sign)


def _where(condition: Any, x: Any, y: Any) -> Any:
    """Choose element by element."""
    is_choice = isinstance(condition, types.Array) and condition.dtype == types.boolean
    if not is_choice or condition.ndim != 1 or ours_among((x, y)) is None:
        return None

    @bare
    def chosen(condition: Any, x: Any, y: Any) -> Any:
        # A number, or an array of one element, stands for all of them.
        zeros = np.zeros(len(condition))
        one = x + zeros
        other = y + zeros
        made = np.copy(one + other)  # for its type and length; all is overwritten
        for i in range(len(condition)):
            made[i] = one[i] if condition[i] else other[i]
        return made

    return chosen


def _clip(a: Any, a_min: Any, a_max: Any) -> Any:
    if is_array(a):
        return lambda a, a_min, a_max: np.minimum(np.maximum(a, a_min), a_max)
    return None


overload_first(np.where)(bare(_where))
overload_first(np.clip)(bare(_clip))


# Sums and extremes.


@bare
def _total(a: Any) -> Any:
    total = a.flat[0] * 0.0
    for v in a.flat:
        total = total + v
    return total


@bare
def _least(a: Any) -> Any:
    least = a.flat[0]
    for v in a.flat:
        least = min(least, v)
    return least


@bare
def _largest(a: Any) -> Any:
    largest = a.flat[0]
    for v in a.flat:
        largest = max(largest, v)
    return largest


@bare
def _all_times(a: Any) -> Any:
    product = a.flat[0]
    for i in range(1, a.size):
        product = product * a.flat[i]
    return product


@bare
def _mean(a: Any) -> Any:
    return np.sum(a) / a.size


@bare
def _norm(a: Any) -> Any:
    size = abs(a.flat[0])
    for i in range(1, a.size):
        size = np.hypot(size, a.flat[i])
    return size


@bare
def _running(a: Any) -> Any:
    made = np.copy(a)
    for i in range(1, len(a)):
        made[i] = made[i - 1] + a[i]
    return made


@bare
def _steps(a: Any) -> Any:
    return a[1:] - a[:-1]


def _of_array(function: Function, ndim: int | None = None) -> Function:
    """Return what a function of one array means for our numbers."""

    @bare
    def typed(a: Any) -> Any:
        return function if is_array(a, ndim) else None

    return typed


for _key, _function in (
    (np.sum, _total), (np.min, _least), (np.max, _largest), (np.prod, _all_times),
    (np.mean, _mean), (np.linalg.norm, _norm),
):  # fmt: skip
    overload_first(_key)(_of_array(_function))
for _key, _function in (
    (np.cumsum, _running), (np.diff, _steps), (builtins.sum, _total),
    (builtins.min, _least), (builtins.max, _largest),
):  # fmt: skip
    overload_first(_key)(_of_array(_function, ndim=1))


# Products. `inner` of two rows may add in any order, as NumPy does.

# By type: `inner` for numbers that account for the rounding of any order (the ranges).
ROUNDED: dict[Any, Function] = {}


def inner(a: Any, b: Any) -> Any:
    """Return the sum of products of two rows, for compiled code."""


@bare
def _added(a: Any, b: Any) -> Any:
    total = a[0] * b[0]
    for i in range(1, len(a)):
        total = total + a[i] * b[i]
    return total


@bare
def _of_rows(a: Any, b: Any) -> Any:
    return inner(a, b)


@bare
def _of_matrix(a: Any, b: Any) -> Any:
    made = np.full(len(a), inner(a[0], b))
    for i in range(1, len(a)):
        made[i] = inner(a[i], b)
    return made


@bare
def _by_matrix(a: Any, b: Any) -> Any:
    made = np.full(b.shape[1], inner(a, b[:, 0]))
    for i in range(1, b.shape[1]):
        made[i] = inner(a, b[:, i])
    return made


@bare
def _of_matrices(a: Any, b: Any) -> Any:
    made = np.full((len(a), b.shape[1]), inner(a[0], b[:, 0]))
    for i in range(len(a)):
        for j in range(b.shape[1]):
            made[i, j] = inner(a[i], b[:, j])
    return made


PRODUCTS = {
    (1, 1): _of_rows, (2, 1): _of_matrix, (1, 2): _by_matrix, (2, 2): _of_matrices,
}  # fmt: skip


@bare
def _product(a: Any, b: Any) -> Any:
    if not (holds_numbers(a) and holds_numbers(b)) or ours_among((a, b)) is None:
        return None
    return PRODUCTS.get((a.ndim, b.ndim))


@bare
def _typed_inner(a: Any, b: Any) -> Any:
    if not (_is_row(a) and _is_row(b)):
        return None
    return ROUNDED.get(ours_among((a, b)), _added)


@bare
def _outer(a: Any, b: Any) -> Any:
    if not (_is_row(a) and _is_row(b)) or ours_among((a, b)) is None:
        return None

    @bare
    def outer(a: Any, b: Any) -> Any:
        made = np.full((len(a), len(b)), a[0] * b[0])
        for i in range(len(a)):
            for j in range(len(b)):
                made[i, j] = a[i] * b[j]
        return made

    return outer


@bare
def _cross(a: Any, b: Any) -> Any:
    if not (_is_row(a) and _is_row(b)) or ours_among((a, b)) is None:
        return None

    @bare
    def cross(a: Any, b: Any) -> Any:
        made = np.full(3, a[1] * b[2] - a[2] * b[1])
        made[1] = a[2] * b[0] - a[0] * b[2]
        made[2] = a[0] * b[1] - a[1] * b[0]
        return made

    return cross


overload_first(inner)(_typed_inner)
overload_first(np.dot)(_product)
overload_first(operator.matmul)(_product)
overload_first(np.outer)(_outer)
overload_first(np.cross)(_cross)


# Linear systems, by elimination. Ranges, the types in ROUNDED, have none: the choice of
# a pivot would be open.


@register_jitable
@bare
def _eliminated(a: Any, b: Any) -> Any:
    n = len(a)
    m = np.copy(a * (b.flat[0] * 0.0 + 1.0))
    x = np.copy(b * (a[0, 0] * 0.0 + 1.0)).reshape((n, b.size // n))
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(m[i, k]) > abs(m[best, k]):
                best = i
        for j in range(n):
            m[k, j], m[best, j] = m[best, j], m[k, j]
        for j in range(x.shape[1]):
            x[k, j], x[best, j] = x[best, j], x[k, j]
        for i in range(k + 1, n):
            factor = m[i, k] / m[k, k]
            for j in range(k + 1, n):
                m[i, j] = m[i, j] - factor * m[k, j]
            for j in range(x.shape[1]):
                x[i, j] = x[i, j] - factor * x[k, j]
    for i in range(n - 1, -1, -1):
        for j in range(x.shape[1]):
            total = x[i, j]
            for k in range(i + 1, n):
                total = total - m[i, k] * x[k, j]
            x[i, j] = total / m[i, i]
    return x.reshape(b.shape)


@bare
def _inverse(a: Any) -> Any:
    return _eliminated(a, np.eye(len(a)))


@bare
def _solve(a: Any, b: Any) -> Any:
    fit = holds_numbers(a) and holds_numbers(b) and a.ndim == 2
    ours = ours_among((a, b))
    return _eliminated if fit and ours is not None and ours not in ROUNDED else None


@bare
def _inv(a: Any) -> Any:
    if not is_array(a, 2) or ours_of(a) in ROUNDED:
        return None
    return _inverse


overload_first(np.linalg.solve)(_solve)
overload_first(np.linalg.inv)(_inv)


# Methods, which are NumPy's functions of the same names.


def _method(name: str, function: Function) -> None:
    def typed(context: Any, kind: Any, args: Any) -> Any:
        sign = context.resolve_function_type(function, (kind, *args), {})
        return None if sign is None else sign.return_type

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        scope: dict[str, Any] = {"function": function}
        given = "a, b"[: 3 * len(values) - 2]
        # Numba keeps what it compiles here by its code, of which the name is a part: so
        # each method needs a name of its own.
        exec(f"def method_{name}({given}): return function({given})", scope)
        method = scope[f"method_{name}"]
        return context.compile_internal(builder, method, sign, values)

    key = method_first(types.Array, name, is_array, typed)
    lower_builtin(key, types.Array)(lower)
    lower_builtin(key, types.Array, types.Any)(lower)


for _function in (
    np.sum, np.min, np.max, np.prod, np.mean, np.cumsum, np.dot, np.var, np.std,
    np.trace,
):  # fmt: skip
    _method(_function.__name__, _function)
