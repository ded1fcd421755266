"""Which touchdown found is which true landing: one to one, by time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: A touchdown and a true landing are the same if their mean contact instants are this close.
MATCH_WITHIN_S = 0.1

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def match_landings(found: Floats, true: Floats) -> Indices:
    """Match touchdowns with landings by their mean contact instants.

    Parameters
    ----------
    found : (m, n) array
        Contact instants of the touchdowns, s; NaN where a foot has none.
    true : (L, n) array
        Contact instants of the landings, s.

    Returns
    -------
    (m,) array
        Number of the landing, -1 for a touchdown without one. Of several touchdowns near one
        landing only the closest is matched.
    """
    landing = np.full(len(found), -1)
    if not (len(found) and len(true)):
        return landing
    gaps = np.abs(_mean_instant(found)[:, np.newaxis] - _mean_instant(true)[np.newaxis, :])
    gaps = np.where(np.isnan(gaps), np.inf, gaps)
    nearest = gaps.argmin(axis=1)
    gap = gaps[np.arange(len(found)), nearest]
    for row in np.argsort(gap, kind="stable")[::-1]:  # the closest claims last, and so keeps it
        if gap[row] <= MATCH_WITHIN_S:
            landing[landing == nearest[row]] = -1
            landing[row] = nearest[row]
    return landing


def _mean_instant(instants: Floats) -> Floats:
    count = np.isfinite(instants).sum(axis=1)
    total = np.nansum(instants, axis=1)
    return np.divide(total, count, out=np.full(len(instants), np.nan), where=count > 0)
