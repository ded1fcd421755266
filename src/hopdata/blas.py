"""One thread of BLAS while hopdata works: its matrices are too small to be shared out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock, local
from typing import Any


class _Depth(local):
    """How deep a thread is in `one_blas_thread`."""

    value = 0


_LOCK = Lock()
_depth = _Depth()
_inside = 0  # threads
_before: dict[str, int] = {}  # file of a library -> its threads


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every BLAS (OpenBLAS, MKL, BLIS) to one thread.

    A context, and a decorator of functions that are no generators. It nests, and several threads
    may be in it: of a library with one number for all of them the last to leave gives it back,
    which threadpoolctl alone leaves to the first. A library that is first imported inside is seen
    at the next entry, so what imports SciPy enters again afterwards.
    """
    global _inside
    with _LOCK:
        _inside += not _depth.value
        _depth.value += 1
        for library in _libraries():
            _before.setdefault(library.filepath, library.get_num_threads())
            library.set_num_threads(1)
    try:
        yield
    finally:
        with _LOCK:
            _depth.value -= 1
            _inside -= not _depth.value
            if not _depth.value:
                _give_back()


def _give_back() -> None:
    from threadpoolctl import OpenBLASController

    # Else only the thread that was first to set OpenBLAS's number may set it again.
    OpenBLASController.clear_controlling_thread(force=True)
    for library in _libraries():
        is_own = library.internal_api == "mkl" or library.threading_layer == "openmp"
        if library.filepath in _before and (is_own or not _inside):
            library.set_num_threads(_before[library.filepath])
    OpenBLASController.clear_controlling_thread(force=True)
    if not _inside:
        _before.clear()


def _libraries() -> list[Any]:
    from threadpoolctl import get_cached_controller

    return [one for one in get_cached_controller().lib_controllers if one.user_api == "blas"]
