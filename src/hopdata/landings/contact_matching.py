"""Which contact of one list is which of another: one to one, within a window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LARGEST_TABLE = 4_000_000  # differences of pairs, for the search of an offset


def match_instants(
    first: FloatArray, second: FloatArray, *, window_s: float
) -> tuple[IntArray, IntArray]:
    """Match two lists of instants: as many pairs as there can be, then the nearest ones.

    Parameters
    ----------
    first : (A,) array
        Instants, s, in any order.
    second : (B,) array
        Instants, s, in any order.
    window_s : float
        Largest difference within a pair, s.

    Returns
    -------
    in_first, in_second : (P,) int arrays
        Indices of the pairs in order of time; each entry of either list is in one pair at most.
    """
    pairs: list[tuple[int, int]] = []
    for rows, columns in _clusters(first, second, window_s):
        pairs += _assigned(first, second, rows, columns, window_s)
    pairs.sort(key=lambda pair: float(first[pair[0]]))
    table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _clusters(
    first: FloatArray, second: FloatArray, window_s: float
) -> list[tuple[IntArray, IntArray]]:
    """Split into groups further apart than the window, where both lists have an instant."""
    together = np.concatenate([first, second])
    order = np.argsort(together, kind="stable")
    ends = np.flatnonzero(np.diff(together[order]) > window_s) + 1
    groups = [(group[group < len(first)], group[group >= len(first)] - len(first))
              for group in np.split(order, ends)]  # fmt: skip
    return [(rows, columns) for rows, columns in groups if len(rows) and len(columns)]


def _assigned(
    first: FloatArray, second: FloatArray, rows: IntArray, columns: IntArray, window_s: float
) -> list[tuple[int, int]]:
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(first[rows][:, None] - second[columns])
    price = 1.0 + len(apart) + len(columns)  # one pair more is worth any sum of differences
    cost = np.where(apart <= window_s, apart / window_s, price)
    chosen = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(rows[i]), int(columns[j])) for i, j in chosen if apart[i, j] <= window_s]


def likely_offset(first: FloatArray, second: FloatArray, *, window_s: float) -> float | None:
    """Shift of `second` that brings most instants together, s; None if none stands out.

    Two clocks that were not started together differ by a constant: the differences of all pairs
    then pile up at it.

    Parameters
    ----------
    first, second : (A,), (B,) arrays
        Instants, s.
    window_s : float
        Width within which differences count as the same, s.
    """
    if not 0 < len(first) * len(second) <= LARGEST_TABLE:
        return None
    apart = np.sort((first[:, None] - second).ravel())
    inside = np.searchsorted(apart, apart + window_s, side="right") - np.arange(len(apart))
    best = int(np.argmax(inside))
    if inside[best] < max(3, 0.5 * min(len(first), len(second))):
        return None
    return float(np.median(apart[best : best + inside[best]]))
