"""Where compiled machine code is kept from one process to the next.

Numba's own cache notices a change of the file that holds a function, not of the functions and
constants which that function takes from other files. So each compiled function gets a directory
named by a digest of all that it is made from: a change anywhere leads to a fresh directory.

The directories stand in ``NUMBA_CACHE_DIR`` if the user has set it, else in ``__pycache__``
beside the source, else (sources not writable) in the user's cache directory. Where none of them
can be written to, functions are compiled anew in each process. Removing them is always safe.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba import config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import NumbaError


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
