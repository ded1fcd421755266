"""Arguments of maps: as many inputs as the map has, a number or an array of one a hop each."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import AnalysisError

FloatArray = NDArray[np.float64]


def input_rows(inputs: tuple[ArrayLike, ...], wanted: int) -> FloatArray:
    """Return the inputs as rows (d, n); a single number holds for all hops.

    Raises
    ------
    AnalysisError
        If there are more inputs or fewer, or of different lengths.
    """
    if len(inputs) != wanted:
        raise AnalysisError(f"frame change: expected {wanted} inputs, found {len(inputs)}")
    arrays = [np.asarray(values, dtype=float).ravel() for values in inputs]
    sizes = {array.size for array in arrays} - {1} or {1}
    if len(sizes) > 1:
        raise AnalysisError(f"frame change: expected inputs of one length, found {sorted(sizes)}")
    rows = np.empty((wanted, sizes.pop()))
    for row, array in zip(rows, arrays, strict=True):
        row[:] = array
    return rows
