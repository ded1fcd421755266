# ruff: noqa: ARG001, ARG005, PLW0108 (Numba prescribes signatures and their names)
"""Functions of Python and NumPy that Numba lacks, made of functions that it has.

They take numbers of any type: floats, ranges, duals, and numbers in lanes where these
know the functions that are used. So a guard may clip a number, or ask whether any of a
list holds, as in Python.
"""

import builtins
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from hopdata.hybrid.compiled.memory import NumberLike, is_number

Function = Callable[..., Any]
FOR_ALL: dict[str, Any] = {"target": "cpu"}  # asked before Numba's own
SEQUENCES = types.Array | types.List | types.UniTuple


def is_ours(kind: Any) -> bool:
    """Return whether a Numba type is that of one number of ours."""
    return isinstance(kind, NumberLike) or bool(getattr(kind, "is_number", False))


def are_numbers(*kinds: Any) -> bool:
    """Return whether Numba types are those of single numbers."""
    return all(is_number(one) or is_ours(one) for one in kinds)


def are_ours(*kinds: Any) -> bool:
    """Return whether types are those of numbers, at least one of them ours."""
    return are_numbers(*kinds) and any(is_ours(one) for one in kinds)


def _is_row(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.ndim == 1


def _is_our_row(kind: Any) -> bool:
    return _is_row(kind) and isinstance(kind.dtype, NumberLike)


def _is_none(kind: Any) -> bool:
    return kind is None or isinstance(kind, types.NoneType)


def _given(*names: str, when: Function, code: Function, key: Any) -> None:
    """Give a function a meaning by `code` where its types satisfy `when`."""
    scope: dict[str, Any] = {"when": when, "code": code}
    listed = ", ".join(names)
    exec(f"def typed({listed}): return code if when({listed}) else None", scope)
    overload(key, **FOR_ALL)(scope["typed"])


# Numbers.


@overload(np.clip, **FOR_ALL)
def _clip(a, a_min, a_max):  # type: ignore[no-untyped-def]  # Numba compares them
    ends = [one for one in (a_min, a_max) if not _is_none(one)]
    if not are_numbers(a, *ends) or not ends:
        return None
    if _is_none(a_min):
        return lambda a, a_min, a_max: min(a, a_max)
    if _is_none(a_max):
        return lambda a, a_min, a_max: max(a, a_min)
    return lambda a, a_min, a_max: min(max(a, a_min), a_max)


def _is_plain_pair(x: Any, y: Any) -> bool:
    return is_number(x) and is_number(y)


_given("x", "y", when=_is_plain_pair, code=lambda x, y: np.fmod(x, y), key=math.fmod)
_given(
    "x", "y", when=are_numbers, code=lambda x, y: x - y * np.rint(x / y),
    key=math.remainder,
)  # fmt: skip
_given(
    "x", "y", "z", when=are_numbers, code=lambda x, y, z: np.hypot(np.hypot(x, y), z),
    key=math.hypot,
)  # fmt: skip
_given(
    "x", "base", when=are_numbers, code=lambda x, base: math.log(x) / math.log(base),
    key=math.log,
)  # fmt: skip
_given("x", when=are_numbers, code=lambda x: np.trunc(x), key=np.fix)
_given(
    "x", when=lambda x: isinstance(x, types.Boolean),
    code=lambda x: 1.0 if x else 0.0, key=builtins.float,
)  # fmt: skip


def _step(x1, x2):  # type: ignore[no-untyped-def]
    if x1 < 0.0:
        return 0.0
    if x1 > 0.0:
        return 1.0
    return float(x2)


def _of_number_and_constant(x1: Any, x2: Any) -> bool:
    return are_numbers(x1) and is_number(x2)


_given("x1", "x2", when=_of_number_and_constant, code=_step, key=np.heaviside)


# Numbers of ours, of which Numba knows only the floats.


def _rounded(number, ndigits):  # type: ignore[no-untyped-def]
    unit = 10.0**ndigits
    return np.rint(number * unit) / unit


_given("number", "ndigits", when=are_ours, code=_rounded, key=builtins.round)
for _key in (np.round, np.around):
    _given("a", when=are_ours, code=lambda a: np.rint(a), key=_key)
    _given(
        "a", "decimals", when=are_ours,
        code=lambda a, decimals: round(a, decimals), key=_key,
    )  # fmt: skip
_given("x", "y", when=are_ours, code=lambda x, y: (x // y, x % y), key=divmod)


def _is_table(x: Any, xp: Any, fp: Any) -> bool:
    """Return whether our number is looked up in lists, or in columns of a matrix."""
    if not is_ours(x) or not all(isinstance(one, SEQUENCES) for one in (xp, fp)):
        return False
    is_plain = is_number(xp.dtype) and is_number(fp.dtype)
    return is_plain and not (_is_column(xp) and _is_column(fp))


def _is_column(kind: Any) -> bool:
    return _is_row(kind) and kind.layout == "C" and kind.dtype == types.float64


def _looked_up(x, xp, fp):  # type: ignore[no-untyped-def]
    # Floats, where `np.zeros` would make an array of our numbers.
    places = np.arange(len(xp)) * 1.0
    values = np.arange(len(fp)) * 1.0
    for i in range(len(xp)):
        places[i] = xp[i]
        values[i] = fp[i]
    return np.interp(x, places, values)


_given("x", "xp", "fp", when=_is_table, code=_looked_up, key=np.interp)


# Numbers of ours among sorted floats, by comparisons.


def _first_at_least(a, v, side="left"):  # type: ignore[no-untyped-def]
    low = 0
    high = len(a)
    while low < high:
        middle = (low + high) // 2
        if a[middle] < v:
            low = middle + 1
        else:
            high = middle
    return low


def _first_above(a, v, side="left"):  # type: ignore[no-untyped-def]
    low = 0
    high = len(a)
    while low < high:
        middle = (low + high) // 2
        if a[middle] <= v:
            low = middle + 1
        else:
            high = middle
    return low


@overload(np.searchsorted, prefer_literal=True, **FOR_ALL)
def _sorted_in(a, v, side="left"):  # type: ignore[no-untyped-def]
    if not is_ours(v) or not isinstance(a, SEQUENCES) or not is_number(a.dtype):
        return None
    if getattr(side, "literal_value", getattr(side, "value", side)) == "right":
        return _first_above
    return _first_at_least


@overload(np.digitize, **FOR_ALL)
def _bin_of(x, bins, right=False):  # type: ignore[no-untyped-def]
    if not is_ours(x) or not isinstance(bins, SEQUENCES) or not is_number(bins.dtype):
        return None

    def found(x, bins, right=False):  # type: ignore[no-untyped-def]
        if bins[0] > bins[-1]:
            # They fall: as many are above.
            above = 0
            for one in bins:
                if one > x or (right and one == x):
                    above += 1
            return above
        if right:
            return np.searchsorted(bins, x)
        return np.searchsorted(bins, x, "right")

    return found


# Sequences.


def _horner(p, x):  # type: ignore[no-untyped-def]
    total = 0.0 * x
    for factor in p:
        total = total * x + factor
    return total


def _is_polynomial(p: Any, x: Any) -> bool:
    return isinstance(p, SEQUENCES) and are_numbers(p.dtype, x)


def _every(iterable):  # type: ignore[no-untyped-def]
    for one in iterable:  # noqa: SIM110 (which would call itself)
        if not one:
            return False
    return True


def _some(iterable):  # type: ignore[no-untyped-def]
    for one in iterable:  # noqa: SIM110 (which would call itself)
        if one:
            return True
    return False


def _is_sequence(iterable: Any) -> bool:
    return isinstance(iterable, SEQUENCES) and are_numbers(iterable.dtype)


def _distance(p, q):  # type: ignore[no-untyped-def]
    size = abs(p[0] - q[0])
    for i in range(1, len(p)):
        size = np.hypot(size, p[i] - q[i])
    return size


def _are_places(p: Any, q: Any) -> bool:
    return _is_sequence(p) and _is_sequence(q)


_given("p", "x", when=_is_polynomial, code=_horner, key=np.polyval)
_given("iterable", when=_is_sequence, code=_every, key=builtins.all)
_given("iterable", when=_is_sequence, code=_some, key=builtins.any)
_given("p", "q", when=_are_places, code=_distance, key=math.dist)
_given(
    "a", "b", when=lambda a, b: _is_row(a) and _is_row(b),
    code=lambda a, b: np.dot(a, b), key=np.inner,
)  # fmt: skip


# Rows of our numbers.


def _norm(x, ord):  # type: ignore[no-untyped-def]
    if ord == np.inf:
        return np.max(np.abs(x))
    if ord == -np.inf:
        return np.min(np.abs(x))
    if ord == 1:
        return np.sum(np.abs(x))
    if ord == 2:
        return np.linalg.norm(x)
    return np.sum(np.abs(x) ** float(ord)) ** (1.0 / ord)


def _spread(a):  # type: ignore[no-untyped-def]
    away = a - np.mean(a)
    return np.mean(away * away)


_given(
    "x", "ord", when=lambda x, ord: _is_our_row(x) and is_number(ord),
    code=_norm, key=np.linalg.norm,
)  # fmt: skip
_given("a", when=_is_our_row, code=_spread, key=np.var)
_given("a", when=_is_our_row, code=lambda a: np.sqrt(np.var(a)), key=np.std)


# Tables: sums and lengths of their rows and columns.


def _is_matrix(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.ndim == 2


def _is_our_matrix(kind: Any) -> bool:
    return _is_matrix(kind) and isinstance(kind.dtype, NumberLike)


def _is_array(kind: Any) -> bool:
    return isinstance(kind, types.Array) and are_numbers(kind.dtype)


def _summed(a, axis):  # type: ignore[no-untyped-def]
    if axis == 0:
        total = np.copy(a[0, :])
        for i in range(1, len(a)):
            total = total + a[i, :]
        return total
    total = np.copy(a[:, 0])
    for j in range(1, a.shape[1]):
        total = total + a[:, j]
    return total


@overload(np.linalg.norm, **FOR_ALL)
def _lengths(x, ord=None, axis=None):  # type: ignore[no-untyped-def]
    is_number_of_axis = isinstance(axis, types.Integer)
    if not _is_matrix(x) or not is_number_of_axis or not _is_none(ord):
        return None
    return lambda x, ord=None, axis=None: np.sqrt(np.sum(x * x, axis))


def _diagonal(a):  # type: ignore[no-untyped-def]
    total = a[0, 0]
    for i in range(1, len(a)):
        total = total + a[i, i]
    return total


_given(
    "a", "axis", code=_summed, key=np.sum,
    when=lambda a, axis: _is_our_matrix(a) and isinstance(axis, types.Integer),
)  # fmt: skip
_given("x", when=_is_array, code=lambda x: np.abs(x), key=builtins.abs)
_given("a", when=_is_our_matrix, code=_diagonal, key=np.trace)
_given(
    "a", "b", when=lambda a, b: _is_our_row(a) and _is_row(b),
    code=lambda a, b: np.dot(a, b), key=np.vdot,
)  # fmt: skip


# Closeness.


@overload(np.isclose, **FOR_ALL)
def _near(a, b, rtol=1e-05, atol=1e-08):  # type: ignore[no-untyped-def]
    if not are_ours(a, b):
        return None
    return lambda a, b, rtol=1e-05, atol=1e-08: abs(a - b) <= atol + rtol * abs(b)


@overload(math.isclose, **FOR_ALL)
def _near_each_other(a, b, rel_tol=1e-09, abs_tol=0.0):  # type: ignore[no-untyped-def]
    if not are_numbers(a, b):
        return None
    return lambda a, b, rel_tol=1e-09, abs_tol=0.0: (
        abs(a - b) <= max(rel_tol * max(abs(a), abs(b)), abs_tol)
    )
