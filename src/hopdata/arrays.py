"""Array types, late imports of pandas and h5py, one thread of BLAS, and gravity."""

from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from pkgutil import resolve_name
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
        """Stand-in for a module that is slow to load: it is imported on first use."""

        def __init__(self, module: str) -> None:
            self.module = module

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self.module), name)

    h5py = _Late("h5py")
    pd = _Late("pandas")

__all__ = [
    "GRAVITY_M_S2",
    "SD_PER_MAD",
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Shown",
    "figure_function",
    "h5py",
    "one_blas_thread",
    "pd",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def figure_function(place: str) -> Any:
    """Return the function ``module:function`` of `hopdata.figures`.

    It is imported only when something is drawn. The stages of a study depend on this
    module, but no result of theirs depends on a figure.
    """
    return resolve_name(f"hopdata.figures.{place}")


class Shown(Told):
    """A result that a notebook shows as one line and a small table.

    Subclasses are dataclasses with ``repr=False``. They return the line from `_told`
    and may return the table from `_rows`. `str` gives the line alone.
    """

    def _told(self) -> str:
        """Return a description in one line."""
        raise NotImplementedError

    def _rows(self) -> dict[str, Any]:
        """Return the columns of the table; there are none by default."""
        return {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._told()}>"

    def __str__(self) -> str:
        return self._told()

    def _repr_html_(self) -> str:
        line = f"<p>{escape(repr(self))}</p>"
        columns = self._rows()
        if not columns:
            return line
        table = pd.DataFrame(columns)
        return line + table.to_html(index=False, float_format="{:.4g}".format)


#: Acceleration of free fall, with which bodies in flight and weights are computed.
#: Unit: m/s^2. Origin: convention: the standard acceleration (3rd CGPM, 1901).
GRAVITY_M_S2 = 9.80665

#: Standard deviations of a normal distribution in one median absolute deviation.
#: Unit: 1. Origin: derived: the inverse of its quartile, 0.6745.
SD_PER_MAD = 1.4826


# BLAS is limited to one thread while hopdata works: its matrices are too small to be
# split.


class _Depth(local):
    """Nesting depth of the current thread in `one_blas_thread`."""

    value = 0


_LOCK = Lock()
_depth = _Depth()
_inside = 0  # number of threads in `one_blas_thread`
_before: dict[str, int] = {}  # file of a library -> its number of threads before


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every BLAS (OpenBLAS, MKL, BLIS) to one thread.

    Use it as a context or as a decorator of functions that are not generators. It can
    be nested and entered by several threads. If a library has one limit for all
    threads, the last thread to leave restores it; threadpoolctl alone would let the
    first one do so. A library that is first imported inside is limited only at the next
    entry, so code that imports SciPy enters again afterwards.
    """
    global _inside
    with _LOCK:
        if _depth.value == 0:
            _inside += 1
        _depth.value += 1
        for library in _libraries():
            _before.setdefault(library.filepath, library.get_num_threads())
            library.set_num_threads(1)
    try:
        yield
    finally:
        with _LOCK:
            _depth.value -= 1
            if _depth.value == 0:
                _inside -= 1
                _give_back()


def _give_back() -> None:
    """Restore the number of threads where no other thread still needs the limit."""
    from threadpoolctl import OpenBLASController

    # Without this, only the thread that first set OpenBLAS's limit may set it again.
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

    return [
        one for one in get_cached_controller().lib_controllers if one.user_api == "blas"
    ]
