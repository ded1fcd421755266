"""Digests of source code, by which the cache tells stale machine code from fresh."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

DIGITS = 16


DRIVER_FOLDERS = ("compiled", "driver")


def driver_digest() -> str:
    """Return a digest of all sources that the driver is made of, as 16 hexadecimal digits."""
    package, digest = Path(__file__).parent.parent, hashlib.sha256()
    for path in sorted(p for folder in DRIVER_FOLDERS for p in (package / folder).glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:DIGITS]


def function_digest(function: Callable[..., Any]) -> str:
    """Return a digest of a function and of all functions and constants that it reaches.

    Parameters
    ----------
    function : callable
        A Python function or a Numba dispatcher.

    Returns
    -------
    str
        16 hexadecimal digits. They change with the code of the function, of each function that
        it reaches by a global name, a module's attribute or a closure, and with the numbers,
        strings, tuples and arrays reached in the same way, in whichever file they stand.
    """
    digest = hashlib.sha256()
    for part in _parts(function, set()):
        digest.update(part)
    return digest.hexdigest()[:DIGITS]


def with_digest(function: Any, **names: Any) -> FunctionType:
    """Return a copy of a function whose name holds its digest, with these global names added.

    Machine code from the cache is linked by names: two functions of one name, as a factory makes
    them, would be taken for each other. And unlike what a closure holds, what stands in globals
    does not keep Numba from caching.
    """
    known = {**function.__globals__, **names}
    copy = FunctionType(
        function.__code__, known, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__kwdefaults__, copy.__module__ = function.__kwdefaults__, function.__module__
    copy.__qualname__ = f"{function.__qualname__}_{function_digest(copy)}"
    return copy


def _parts(value: Any, seen: set[int]) -> Iterator[bytes]:
    function = getattr(value, "py_func", value)
    if not isinstance(function, FunctionType):
        yield _constant_bytes(value)
    elif id(function) not in seen:
        seen.add(id(function))
        yield from _code_parts(function.__code__)
        yield repr(function.__defaults__).encode()
        for name, reached in _references(function):
            yield name.encode()
            yield from _parts(reached, seen)


def _code_parts(code: CodeType) -> Iterator[bytes]:
    yield code.co_code
    yield repr((code.co_names, code.co_varnames)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant)
        else:
            yield repr(constant).encode()


def _references(function: FunctionType) -> Iterator[tuple[str, Any]]:
    names = function.__code__.co_names
    for name in names:
        value = function.__globals__.get(name)
        if isinstance(value, ModuleType):
            inside = vars(value)
            yield from ((item, inside[item]) for item in names if item in inside)
        else:
            yield name, value
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _constant_bytes(value: Any) -> bytes:
    if isinstance(value, np.ndarray):
        return value.tobytes() + repr((value.dtype, value.shape)).encode()
    if isinstance(value, bool | int | float | complex | str | tuple | frozenset | np.number):
        return repr(value).encode()
    return b""
