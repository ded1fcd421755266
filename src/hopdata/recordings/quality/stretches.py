"""Stretches of frames in which a condition holds, and the gaps of each marker."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray


def runs(holds: BoolArray) -> IntArray:
    """Return the stretches of True values in an (N,) mask.

    Returns
    -------
    (K, 2) array
        First frame of each stretch and the frame after its last.
    """
    padded = np.concatenate([[False], holds, [False]])
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2).astype(np.int64)


def near(holds: BoolArray, reach: int) -> BoolArray:
    """Tell which frames of a mask (N, ...) are at most `reach` from a True one."""
    found = holds.copy()
    for shift in range(1, reach + 1):
        found[shift:] |= holds[:-shift]
        found[:-shift] |= holds[shift:]
    return found


def quantiles(values: FloatArray, levels: Sequence[float]) -> FloatArray:
    """Return quantiles of the columns of (N, M) values, (K, M), for K levels.

    They are of the finite values; NaN if a column has none.
    """
    n_columns = values.shape[1]
    result = np.full((len(levels), n_columns), np.nan)
    for m in range(n_columns):
        known = values[np.isfinite(values[:, m]), m]
        if len(known):
            result[:, m] = np.quantile(known, levels)
    return result


def seen(positions: FloatArray) -> BoolArray:
    """Tell in which frames each marker of (N, M, 3) positions was seen, (N, M)."""
    # Faster than `all` along a short axis.
    x, y, z = np.moveaxis(np.isfinite(positions), 2, 0)
    return np.asarray(x & y & z)


@dataclass(frozen=True)
class MarkerGaps:
    """The gaps of one marker.

    Parameters
    ----------
    marker : str
        Its name.
    stretches : (K, 2) array
        First frame of each gap, and the frame after its last; frame numbers start at 0.
    n_frames : int
        Number of frames of the recording.
    """

    marker: str
    stretches: IntArray
    n_frames: int

    @property
    def count(self) -> int:
        """Return the number of gaps."""
        return len(self.stretches)

    @property
    def longest(self) -> int:
        """Return the length of the longest gap, frames; 0 without gaps."""
        return int(np.diff(self.stretches, axis=1).max(initial=0))

    @property
    def missing(self) -> int:
        """Return the number of frames in which the marker was not seen."""
        return int(np.diff(self.stretches, axis=1).sum())

    @property
    def share(self) -> float:
        """Return the share of frames in which the marker was not seen."""
        if not self.n_frames:
            return 0.0
        return self.missing / self.n_frames


def marker_gaps(
    positions: FloatArray, markers: tuple[str, ...]
) -> tuple[MarkerGaps, ...]:
    """Find the gaps of every marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    markers : tuple of str
        The M names.
    """
    unseen = ~seen(positions)
    gaps = []
    for name, mask in zip(markers, unseen.T, strict=True):
        gaps.append(MarkerGaps(name, runs(mask), len(mask)))
    return tuple(gaps)
