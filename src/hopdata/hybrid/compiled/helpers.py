"""Functions that a user's function calls, made callable from machine code.

Numba calls only functions that are decorated for it. People write others: a function
that is used by both field and guards, for instance. In a copy of the user's function,
each of them is replaced by one that Numba compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from types import CellType, CodeType, FunctionType
from typing import Any, TypeGuard

import numba
from numba.extending import is_jitted

from hopdata.hybrid.compiled.digest import with_digest

Function = Callable[..., Any]

# Packages whose functions Numba knows, or does not; and this one, whose functions are
# decorated where they need it.
KNOWN = frozenset(("numpy", "numba", "scipy", "math", "builtins"))
OWN = "hopdata.hybrid."


def with_helpers(
    function: FunctionType,
    above: frozenset[CodeType] = frozenset(),
    *,
    decorated: bool = False,
) -> FunctionType:
    """Return a function whose helpers are compiled, or itself if it has none.

    Parameters
    ----------
    function : FunctionType
        A Python function that is about to be compiled.
    above : frozenset
        Code of the functions that call this one. A function that calls itself is left
        as it is.
    decorated : bool
        Whether helpers that the user has decorated are compiled once more, too, without
        an entry for Python, which could not take arrays of our own numbers.
    """
    inside = above | {function.__code__}
    found: dict[str, Any] = {}
    for name in names_in(function.__code__):
        helper = _helper(function.__globals__.get(name), decorated)
        if helper is not None and helper.__code__ not in inside:
            found[name] = _compiled(helper, inside, decorated)
    cells = list(function.__closure__ or ())
    is_new = bool(found)
    for place, cell in enumerate(cells):
        try:
            helper = _helper(cell.cell_contents, decorated)
        except ValueError:  # it has no value yet
            continue
        if helper is not None and helper.__code__ not in inside:
            cells[place] = CellType(_compiled(helper, inside, decorated))
            is_new = True
    if not is_new:
        return function
    made = FunctionType(
        function.__code__,
        {**function.__globals__, **found},
        function.__name__,
        function.__defaults__,
        tuple(cells),
    )
    made.__kwdefaults__ = function.__kwdefaults__
    made.__module__ = function.__module__
    made.__qualname__ = function.__qualname__
    return made


def _compiled(helper: FunctionType, above: frozenset[CodeType], decorated: bool) -> Any:
    return within(with_digest(with_helpers(helper, above, decorated=decorated)))


def within(function: FunctionType) -> Any:
    """Return a function compiled for calls from code in Numba alone.

    Code by which Python or C calls it is left out: a quarter of its time to compile.
    """
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(error_model="numpy", **options)(function)


def _helper(value: Any, decorated: bool) -> FunctionType | None:
    """Return the Python function of a helper, or None if it is none."""
    if decorated and is_jitted(value):
        value = value.py_func
    return value if _is_helper(value) else None


def _is_helper(value: Any) -> TypeGuard[FunctionType]:
    """Return whether a value is a Python function of the user's."""
    if not isinstance(value, FunctionType):
        return False
    module = value.__module__ or ""
    return module.partition(".")[0] not in KNOWN and not module.startswith(OWN)


def names_in(code: CodeType) -> set[str]:
    """Return the names in a function's code and in that of functions inside it."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= names_in(constant)
    return names
