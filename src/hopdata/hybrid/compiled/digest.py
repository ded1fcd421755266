"""Digests of source code, by which the cache tells stale machine code from fresh."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.extending import _Intrinsic

DIGITS = 16


PACKAGE = "hopdata.hybrid"
IMPORT = re.compile(rf"^ *from ({re.escape(PACKAGE)}[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
NOT_IN_CODE = ("compiled/cache.py", "compiled/digest.py")  # they say where code is kept, not what


@cache
def driver_digest() -> str:
    """Return a digest of all sources that the driver is made of, as 16 hexadecimal digits."""
    return sources_digest(Path(__file__).parent.parent)


def sources_digest(package: Path) -> str:
    """Return a digest of the driver in a package: its folder, and whatever that imports."""
    digest = hashlib.sha256()
    for name, source in sorted(driver_sources(package).items()):
        digest.update(name.encode())
        digest.update(source)
    return digest.hexdigest()[:DIGITS]


def driver_sources(package: Path) -> dict[str, bytes]:
    """Return the sources of the driver, by their paths within the package."""
    found: dict[str, bytes] = {}
    waiting = [f"driver/{path.name}" for path in (package / "driver").glob("*.py")]
    while waiting:
        name = waiting.pop()
        if name in found or name in NOT_IN_CODE or not (package / name).is_file():
            continue
        found[name] = (package / name).read_bytes()
        waiting += _imported(found[name].decode())
    return found


def _imported(source: str) -> Iterator[str]:
    """Yield the paths of the modules that a source may import from the package."""
    for module, names in IMPORT.findall(source):
        path = module.removeprefix(PACKAGE).strip(".").replace(".", "/")
        yield f"{path}.py"
        yield from (f"{path}/{name}.py" for name in re.findall(r"\w+", names))


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
    if isinstance(value, _Intrinsic):  # builds code by whatever stands in its module
        yield _source(value._defn.__code__.co_filename)
    elif not isinstance(function, FunctionType):
        yield _constant_bytes(value)
    elif id(function) not in seen:
        seen.add(id(function))
        yield from _code_parts(function.__code__)
        yield repr(function.__defaults__).encode()
        for name, reached in _references(function):
            yield name.encode()
            yield from _parts(reached, seen)


@cache
def _source(path: str) -> bytes:
    return Path(path).read_bytes() if Path(path).is_file() else b""


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
