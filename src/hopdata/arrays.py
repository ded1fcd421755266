"""Types of arrays, pandas, and the one constant of nature that several rooms need."""

from __future__ import annotations

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

__all__ = ["GRAVITY_M_S2", "BoolArray", "FloatArray", "IntArray", "pd"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

GRAVITY_M_S2 = 9.80665  # the standard acceleration of free fall (3rd CGPM, 1901)
