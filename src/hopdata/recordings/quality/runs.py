"""Stretches of frames in which something holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def runs(holds: BoolArray) -> IntArray:
    """Return the stretches of True in an (N,) mask.

    Returns
    -------
    (K, 2) array
        First frame of each stretch and the frame after its last.
    """
    padded = np.concatenate([[False], holds, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges.reshape(-1, 2).astype(np.int64)
