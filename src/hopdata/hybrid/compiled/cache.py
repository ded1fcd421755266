"""Where compiled machine code is kept from one process to the next.

Numba's own cache notices a change of the file that holds a function, not of the functions and
constants which that function takes from other files. So each compiled function gets a directory
named by a digest of all that it is made from: a change anywhere leads to a fresh directory.

The directories stand in ``NUMBA_CACHE_DIR`` if the user has set it, else in ``__pycache__``
beside the source, else (sources not writable) in the user's cache directory. Where none of them
can be written to, functions are compiled anew in each process. Removing them is always safe.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import NumbaError
from numba.core.extending import _Intrinsic


@contextmanager
def cache_directory(function: Callable[..., Any], digest: str) -> Iterator[bool]:
    """Point Numba's cache to the directory for `function` while it is being decorated.

    Parameters
    ----------
    function : callable
        The Python function that is about to be compiled.
    digest : str
        Names the state of the sources that it depends on.

    Yields
    ------
    bool
        Whether there is a directory to cache in.
    """
    with global_compiler_lock:  # the setting is Numba's, and there is one for all threads
        yield from _pointing(function, digest)


def compiled_in_cache(
    function: Callable[..., Any], digest: str, compile_it: Callable[[bool], Any]
) -> Any:
    """Return ``compile_it(True)``, loaded from the cache if it is there.

    Where caching fails (a full disk, a module that cannot be imported by its name), it is
    ``compile_it(False)``: compiled without.
    """
    with cache_directory(function, digest) as cached:
        try:
            return compile_it(cached)
        except NumbaError:
            raise
        except Exception:
            if not cached:
                raise
        return compile_it(False)


def is_in_cache(function: Callable[..., Any], digest: str) -> bool:
    """Tell whether a directory of this name holds the index of some machine code."""
    chosen_by_user = config.CACHE_DIR  # type: ignore[attr-defined]
    folders = (base / f"hopdata-{digest}" for base in _candidates(function, chosen_by_user))
    return any(True for folder in folders for _ in folder.glob("*/*.nbi"))


def _pointing(function: Callable[..., Any], digest: str) -> Iterator[bool]:
    chosen_by_user = config.CACHE_DIR  # type: ignore[attr-defined]
    base = _first_writable(_candidates(function, chosen_by_user))
    if base is None:
        yield False
        return
    config.CACHE_DIR = str(base / f"hopdata-{digest}")  # type: ignore[attr-defined]
    try:
        yield True
    finally:
        config.CACHE_DIR = chosen_by_user  # type: ignore[attr-defined]


def _candidates(function: Callable[..., Any], chosen_by_user: str) -> Iterator[Path]:
    source = Path(function.__code__.co_filename)
    if not source.exists():  # typed at a prompt: there is no file to compare the cache with
        return
    if chosen_by_user:
        yield Path(chosen_by_user)
    else:
        from numba.misc.appdirs import AppDirs

        yield source.parent / "__pycache__"
        yield Path(AppDirs(appname="hopdata", appauthor=False).user_cache_dir)


def _first_writable(candidates: Iterator[Path]) -> Path | None:
    for path in candidates:
        try:
            path.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=path).close()
        except OSError:
            continue
        return path
    return None


# Digests of source code, by which the cache tells stale machine code from fresh.

DIGITS = 16


PACKAGE = "hopdata.hybrid"
IMPORT = re.compile(rf"^from ({re.escape(PACKAGE)}[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
NOT_IN_CODE = ("compiled/cache.py",)  # they say where code is kept, not what


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
