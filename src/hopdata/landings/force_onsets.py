"""When a force plate says that a foot came down."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def force_onsets(
    time: ArrayLike, force: ArrayLike, *, least_n: float = 50.0, sure_n: float = 400.0
) -> FloatArray:
    """Instants at which the vertical force of each stance rises above a threshold.

    A stance is a run of samples above the threshold that reaches `sure_n`; one that has already
    begun in the first sample has no onset. The instant is interpolated between two samples.

    Parameters
    ----------
    time : (N,) array
        Times of the samples, s.
    force : (N,) array
        Vertical force, N, positive in stance; NaN counts as none.
    least_n : float
        Threshold of the onset, N; above the noise of the unloaded plate.
    sure_n : float
        Force that a stance reaches and noise does not, N.

    Returns
    -------
    (S,) array
        Onsets, s.

    Raises
    ------
    ValueError
        If the two arrays differ in length, or the thresholds are out of order.
    """
    t, f = np.asarray(time, float), np.nan_to_num(np.asarray(force, float))
    if t.shape != f.shape:
        raise ValueError(f"force: expected {t.shape} samples as in time, found {f.shape}")
    if not least_n < sure_n:
        raise ValueError(f"thresholds: expected least_n below sure_n, found {least_n}, {sure_n}")
    above = f >= least_n
    rises = np.flatnonzero(~above[:-1] & above[1:])
    ends = np.append(rises, len(f) - 1)[1 : len(rises) + 1]
    sure = [f[rise : end + 1].max() >= sure_n for rise, end in zip(rises, ends, strict=True)]
    first = rises[np.array(sure, dtype=bool)]
    share = (least_n - f[first]) / (f[first + 1] - f[first])
    return t[first] + share * (t[first + 1] - t[first])
