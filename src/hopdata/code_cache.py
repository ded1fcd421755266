"""Cache of compiled machine code that outlives a process.

Numba's own cache notices a change in the file that defines a function, but not in the
functions and constants that the function uses from other files. Here each compiled
function gets a folder named by a digest of everything that it is made from, so any
change leads to a new folder.

The folders are in the first of these places that is writable: ``NUMBA_CACHE_DIR`` if
the user has set it, otherwise ``__pycache__`` beside the source; the user's cache
folder; and a private folder of the user among the temporary files. If none is writable,
functions are compiled in every process. Removing the folders is always safe. Each file
ends in its checksum (`hopdata.seal`); a damaged one is removed and its function
compiled anew.

What lies in a cache is run, and Numba's index is a pickle, so that reading it can run
code too. The checksum is no key: it tells damage, and not who wrote a file. Therefore
only folders and files of this user are read, in folders that no other user can write.
Who can write as this user can run code without a cache. Numba compares its own version
before it reads the rest of an index, and takes machine code of this processor alone.

A wheel may include machine code (made by ``packaging/machine_code.py``) for C functions
that are called by their address. It is used if the digest, the versions of Numba and
llvmlite, the system and the processor match.
"""

import gc
import hashlib
import json
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import RLock
from types import CodeType, FunctionType, ModuleType, SimpleNamespace
from typing import Any, BinaryIO

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba import NumbaError, config, njit

from hopdata.private_numba import CacheFiles, cache_of, load_numba_arrays
from hopdata.seal import Seal, seal_for, seal_of

logger = logging.getLogger("hopdata")
DIGITS = 16
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
BROUGHT = Path(__file__).parent / "_machine_code"  # included in a wheel
_LOCK = RLock()  # guards Numba's setting of the cache folder, which all threads share
Function = Callable[..., Any]
# Types whose values a function's machine code may contain.
CONSTANT = (bool, int, float, complex, str, bytes, frozenset, np.generic)


def kept_njit(types: Any = None, **options: Any) -> Callable[[Function], Any]:
    """Return a `numba.njit` decorator with these options that caches machine code.

    With `types` the function is compiled at once instead of at its first call; other
    threads and processes that need it wait meanwhile.
    """

    def decorate(function: Function) -> Any:
        def compile_it(cached: bool) -> Any:
            return njit(types, cache=cached, **options)(function)

        return compiled_in_cache(function, function_digest(function), compile_it)

    return decorate


@contextmanager
def cache_directory(function: Function, digest: str) -> Iterator[Path | None]:
    """Point Numba's cache to the folder for `function` while it is being decorated.

    Parameters
    ----------
    function : callable
        The Python function that is about to be compiled.
    digest : str
        Digest of the sources that the function depends on; it names the folder.

    Yields
    ------
    Path or None
        The folder; None if no place is writable.
    """
    with _LOCK:
        before = config.CACHE_DIR  # type: ignore[attr-defined]
        # Not Numba's own value: that may come from a file .numba_config.yaml in the
        # working folder, and what lies in a cache is run.
        chosen_by_user = os.environ.get("NUMBA_CACHE_DIR", "")
        folder = None
        for base in _candidates(function, chosen_by_user):
            if _can_be_written(base) and _is_own(base / f"hopdata-{digest}"):
                folder = base / f"hopdata-{digest}"
                config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
                break
        try:
            with cache_of(_SealedFiles):
                yield folder
        finally:
            config.CACHE_DIR = before  # type: ignore[attr-defined]


class _SealedFiles(CacheFiles):
    """Numba's files of one function, each with a checksum at its end.

    Numba runs what it finds in its files: a damaged one ends in any error, or ends the
    process. So each file is compared with its checksum first. A damaged one is removed,
    and as Numba does not find it, it compiles the function anew.
    """

    def may_be_kept(self, key: Any) -> bool:
        """Return whether machine code for the types in `key` may be in the cache."""
        return _may_be_kept(key)

    def is_sound(self, path: Path) -> bool:
        """Tell whether a file is as this user wrote it; else remove it."""
        return _is_sound(path)

    def finish(self, file: BinaryIO) -> None:
        """Write the checksum of what stands in a file behind it."""
        file.flush()
        file.write(seal_for(Path(file.name)))


def _may_be_kept(key: Any) -> bool:
    """Return whether a function's machine code for the types in `key` may be kept.

    The digest is that of the function. A type whose operations are code of their own,
    which may change meanwhile, has an attribute `is_kept` that is False: its code is
    kept with the function that is called from outside, whose digest knows of it.
    """
    kinds = list(getattr(key[0], "args", key[0]))
    while kinds:
        kind = kinds.pop()
        if not getattr(kind, "is_kept", True):
            return False
        kinds += getattr(kind, "types", ())
    return True


def _is_sound(path: Path) -> bool:
    """Tell whether a file of the cache is as this user wrote it; else remove it."""
    try:
        if not _is_of_user(path):
            logger.warning("%s: of another user; it is removed and not run", path)
            path.unlink()
            return False
        if seal_of(path) is Seal.WHOLE:
            return True
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            ends_as_pickle = file.read() == b"."
    except FileNotFoundError:
        return False
    except OSError:  # empty, or it cannot be read
        ends_as_pickle = False
    if not ends_as_pickle:  # older versions wrote no seal, which is no damage
        logger.warning(
            "%s: damaged; it is removed, and the function compiled anew", path
        )
    with suppress(OSError):
        path.unlink()
    return False


def compiled_in_cache(
    function: Function, digest: str, compile_it: Callable[[bool], Any]
) -> Any:
    """Return the compiled function: from the wheel, the cache, or ``compile_it(True)``.

    Where caching fails (a full disk, a module that cannot be imported by its name),
    return ``compile_it(False)``, which compiles without a cache.
    """
    brought = brought_code(function, digest)
    if brought is not None:
        return brought
    load_numba_arrays()
    with (
        cache_directory(function, digest) as folder,
        _alone_in(folder),
        _without_collector(),
    ):
        try:
            return compile_it(folder is not None)
        except NumbaError:
            raise
        except Exception:
            if folder is None:
                raise
        return compile_it(False)


def made_with() -> list[str]:
    """Return the versions and the system for which machine code is valid."""
    return [numba.__version__, llvmlite.__version__, llvm.get_default_triple()]


def brought_code(function: Function, digest: str) -> SimpleNamespace | None:
    """Return the `address` of a C function from the wheel, or None if it does not fit.

    The result also holds the `engine` that keeps the code in memory.

    The file is a line of JSON followed by an object file. The line holds the value of
    `made_with`, the function's symbol, the processor features that the code uses, and
    the symbols that it needs: a missing symbol would end the process. The file is
    ignored if Numba is set to a certain processor.
    """
    file = BROUGHT / f"{function.__name__}-{digest}"
    numba_settings: Any = config
    for_certain_processor = (
        numba_settings.CPU_NAME
        or numba_settings.CPU_FEATURES
        or not numba_settings.ENABLE_AVX
    )
    if for_certain_processor or not file.is_file():
        return None
    if seal_of(file) is not Seal.WHOLE:
        return None
    line, code = file.read_bytes().split(b"\n", 1)
    versions, symbol, features, needed = json.loads(line)
    here = llvm.get_host_cpu_features()
    fits = versions == made_with() and all(here.get(feature) for feature in features)
    if not fits or not all(llvm.address_of_symbol(name) for name in needed):
        return None
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return SimpleNamespace(address=engine.get_function_address(symbol), engine=engine)


@contextmanager
def _alone_in(folder: Path | None) -> Iterator[None]:
    """Wait while another process compiles into this folder, and load its result."""
    with ExitStack() as stack:
        # Windows and some file servers lack these locks.
        with suppress(ImportError, OSError):
            import fcntl

            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                lock = stack.enter_context((folder / "lock").open("a"))
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def _without_collector() -> Iterator[None]:
    """Suspend garbage collection, which takes a tenth of Numba's compile time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def is_in_cache(function: Function, digest: str) -> bool:
    """Return whether the folder of this digest holds an index of machine code."""
    with cache_directory(function, digest) as folder:
        return folder is not None and any(True for _ in folder.glob("*/*.nbi"))


def _candidates(function: Function, chosen_by_user: str) -> Iterator[Path]:
    """Yield the places where machine code may be kept, the best first."""
    source = Path(function.__code__.co_filename)
    # What was typed at a prompt has no file for Numba to check the cache against.
    if not source.exists():
        return
    yield Path(chosen_by_user or source.parent / "__pycache__")
    yield from _users()
    yield from _temporary()


def _users() -> Iterator[Path]:
    """Yield the user's cache folder, if there is a home and a package that knows it."""
    try:
        from platformdirs import user_cache_path
    except ModuleNotFoundError:  # the integrator on its own does not need it
        return
    users = user_cache_path("hopdata", appauthor=False)
    if users.is_absolute():  # without a home it is relative to the working directory
        yield users


def _temporary() -> Iterator[Path]:
    """Yield a temporary folder into which no other user can have put code."""
    with suppress(OSError):
        temporary = Path(tempfile.gettempdir())
        if not hasattr(os, "getuid"):  # Windows: each user has a folder of their own
            folder = temporary / "hopdata"
            folder.mkdir(mode=0o700, exist_ok=True)
            yield folder
            return
        user = os.getuid()
        folder = temporary / f"hopdata-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        others_may_write = found.st_mode & _OTHERS_WRITE != 0
        if found.st_uid == user and not others_may_write:
            yield folder


def _is_own(folder: Path) -> bool:
    """Make a folder that only this user can write, or tell that there is another's.

    A folder of this user into which others could write is emptied first.
    """
    if not hasattr(os, "getuid"):  # Windows keeps others out of a user's folders
        return True
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        if found.st_uid != os.getuid() or not stat.S_ISDIR(found.st_mode):
            return False
        if found.st_mode & _OTHERS_WRITE:
            shutil.rmtree(folder)
            folder.mkdir(mode=0o700)
    except OSError:
        return False
    return True


def _is_of_user(path: Path) -> bool:
    """Tell whether a file is a plain one of this user."""
    found = path.lstat()
    if not hasattr(os, "getuid"):
        return True
    return found.st_uid == os.getuid() and stat.S_ISREG(found.st_mode)


def _can_be_written(folder: Path) -> bool:
    """Tell whether a folder takes files, and not those of all users.

    Where all users may write, one could put a folder in the place of another's, unless
    only owners may rename theirs (as in ``/tmp``).
    """
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        mode = folder.stat().st_mode
        if os.name != "nt" and mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return False
        tempfile.TemporaryFile(dir=folder).close()
        return True
    return False


def function_digest(function: Function) -> str:
    """Return a digest of a function and of all functions and constants that it uses.

    Parameters
    ----------
    function : callable
        A Python function or a Numba dispatcher.

    Returns
    -------
    str
        16 hexadecimal digits. They change with the code of the function and with the
        functions, numbers, strings, tuples and arrays that it reaches by a global name,
        a module's attribute or a closure, in whichever file these are.
    """
    digest = hashlib.sha256()
    for part in _parts(function, set()):
        digest.update(part)
    return digest.hexdigest()[:DIGITS]


def _parts(value: Any, seen: set[int]) -> Iterator[bytes]:
    function = getattr(value, "py_func", value)
    made_by = getattr(function, "__wrapped__", None)
    if isinstance(made_by, FunctionType) and not isinstance(function, FunctionType):
        # An intrinsic: its whole module counts.
        yield _source(made_by.__code__.co_filename)
    elif isinstance(value, tuple):
        yield repr(type(value)).encode()
        for item in value:
            yield from _parts(item, seen)
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
    if not Path(path).is_file():
        return b""
    return Path(path).read_bytes()


def _code_parts(code: CodeType) -> Iterator[bytes]:
    yield code.co_code
    yield repr((code.co_names, code.co_varnames)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant)
        else:
            yield repr(constant).encode()


def _references(function: FunctionType) -> Iterator[tuple[str, Any]]:
    code = function.__code__
    names = tuple(dict.fromkeys(_names_in(code)))
    for name in names:
        yield from _reached(name, function.__globals__.get(name), names)
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield from _reached(name, cell.cell_contents, names)


def _names_in(code: CodeType) -> Iterator[str]:
    """Yield the names in a function's code and in that of functions defined in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names_in(constant)


def _reached(
    name: str, value: Any, names: tuple[str, ...]
) -> Iterator[tuple[str, Any]]:
    """Yield a value or, of a module, its attributes that have one of the names."""
    if not isinstance(value, ModuleType):
        yield name, value
        return
    inside = vars(value)
    for item in names:
        found: Any = inside.get(item)
        is_module = isinstance(found, ModuleType)
        if is_module and found.__name__.startswith(f"{value.__name__}."):
            yield from _reached(item, found, names)
        elif item in inside:
            yield item, found


def _constant_bytes(value: Any) -> bytes:
    if isinstance(value, np.ndarray):
        return value.tobytes() + repr((value.dtype, value.shape)).encode()
    if isinstance(value, CONSTANT):
        return repr(value).encode()
    return b""
