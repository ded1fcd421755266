"""How far linear maps are from each other, for the inputs that a study has.

A difference counts by what it does to predictions: its rms over the inputs, relative to the rms of
what a map predicts, with each output in its own unit. It has no unit and does not change with the
coordinates of the inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def input_root(x: Floats) -> Floats:
    """Return a root R (p, p) of the covariance of inputs (n, p), R R' = cov."""
    centred = x - x.mean(axis=0)
    _, singular, right = np.linalg.svd(centred, full_matrices=False)
    root: Floats = right.T * (singular / np.sqrt(max(len(x) - 1, 1)))
    return root


def relative_difference(a: Floats, b: Floats, *, root: Floats, units: Floats) -> float:
    """Return the rms difference of the predictions of two maps over the rms of those of `b`.

    Parameters
    ----------
    a, b
        (q, p) maps.
    root
        (p, p) root of the covariance of the inputs.
    units
        (q,) unit of each output.
    """
    size = float(np.linalg.norm((b / units[:, None]) @ root))
    return float(np.linalg.norm(((a - b) / units[:, None]) @ root)) / size


def largest_difference(maps: Floats, *, root: Floats, units: Floats) -> float:
    """Return the largest relative difference between maps (S, q, p), over the mean map's size."""
    mean = maps.mean(axis=0)
    pairs = (
        relative_difference(mean + a - b, mean, root=root, units=units)
        for i, a in enumerate(maps)
        for b in maps[:i]
    )
    return max(pairs, default=0.0)
