"""Types of arrays, pandas, and the one constant of nature that several rooms need."""

from __future__ import annotations

from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd
else:

    class _Pandas:
        """Stands for pandas, which is slow to load, and is loaded by those alone who use it."""

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module("pandas"), name)

    pd = _Pandas()

__all__ = ["GRAVITY_M_S2", "BoolArray", "FloatArray", "IntArray", "Shown", "pd"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Shown:
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
