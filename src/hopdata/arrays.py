"""Types of arrays, pandas and h5py, one thread of BLAS, and the one constant that rooms share."""

from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from threading import Lock, local
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import Told

if TYPE_CHECKING:
    import h5py
    import pandas as pd
else:

    class _Late:
        """Stands for a module that is slow to load, and is loaded by those alone who use it."""

        def __init__(self, module: str) -> None:
            self.module = module

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self.module), name)

    h5py, pd = _Late("h5py"), _Late("pandas")

__all__ = ["GRAVITY_M_S2", "BoolArray", "FloatArray", "IntArray", "Shown", "h5py", "pd"]
__all__ += ["one_blas_thread"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Shown(Told):
    """A result that a notebook shows in a line and a small table; a dataclass with ``repr=False``.

    A class of it says the line in `told`, and may say the table in `rows`.
    """

    def told(self) -> str:
        """Return what it is, in a line."""
        raise NotImplementedError

    def rows(self) -> dict[str, Any]:
        """Return columns of a table, none by default."""
        return {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.told()}>"

    def _repr_html_(self) -> str:
        columns = self.rows()
        table = pd.DataFrame(columns).to_html(index=False, float_format="{:.4g}".format)
        return f"<p>{escape(repr(self))}</p>{table if columns else ''}"


GRAVITY_M_S2 = 9.80665  # the standard acceleration of free fall (3rd CGPM, 1901)


# One thread of BLAS while hopdata works: its matrices are too small to be shared out.


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
