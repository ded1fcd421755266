"""When a force plate says that a foot came down."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

UNLOADED_S = 0.01  # a force that is gone for less than this is a rattle within a contact


def force_onsets(
    time: ArrayLike, force: ArrayLike, *, least_n: float = 50.0, sure_n: float = 400.0
) -> FloatArray:
    """Instants at which the vertical force rises through a threshold, once for each stance.

    A stance reaches `sure_n` after the force has been below the threshold for `UNLOADED_S`: so a
    rattle of the plate is no contact, and a dip during the rise or in stance no new one. One that
    has already begun in the first sample has no onset, nor has one beside a missing sample. Two
    feet that are on the plate together make one. The instant is interpolated between two samples.

    Parameters
    ----------
    time : (N,) array
        Times of the samples, s.
    force : (N,) array
        Vertical force, N (or another unit, that of the thresholds), positive in stance; NaN where
        missing.
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
    t, f = np.asarray(time, float), np.asarray(force, float)
    if t.shape != f.shape:
        raise ValueError(f"force: expected {t.shape} samples as in time, found {f.shape}")
    if not least_n < sure_n:
        raise ValueError(f"thresholds: expected least_n below sure_n, found {least_n}, {sure_n}")
    last = _last_unloaded(t, f, least_n, sure_n)
    share = (least_n - f[last]) / (f[last + 1] - f[last])
    return t[last] + share * (t[last + 1] - t[last])


def _last_unloaded(t: FloatArray, f: FloatArray, least_n: float, sure_n: float) -> IntArray:
    """Last unloaded sample before each rise to `sure_n`; its neighbour is above the threshold."""
    loaded = np.flatnonzero(f >= sure_n)
    if len(loaded) == 0:
        return loaded
    below = np.concatenate([[False], f < least_n, [False]])
    first, after = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    long = t[after - 1] - t[first] >= UNLOADED_S - np.median(np.diff(t))
    last = after[long] - 1
    reached = loaded[np.minimum(np.searchsorted(loaded, last), len(loaded) - 1)]
    until = np.append(last[1:], len(f))  # the next unloaded stretch ends the attempt
    rises = last[(reached > last) & (reached < until)]
    return rises[f[rises + 1] >= least_n]  # not so beside a missing sample
