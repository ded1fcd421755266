"""Where each marker was not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.runs import IntArray, runs

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerGaps:
    """The gaps of one marker.

    Parameters
    ----------
    marker : str
        Its name.
    stretches : (K, 2) array
        First frame of each gap, and the frame after its last; frames count from 0.
    n_frames : int
        Frames of the recording.
    """

    marker: str
    stretches: IntArray
    n_frames: int

    @property
    def count(self) -> int:
        """Number of gaps."""
        return len(self.stretches)

    @property
    def longest(self) -> int:
        """Length of the longest gap, frames; 0 without gaps."""
        return int(np.diff(self.stretches, axis=1).max(initial=0))

    @property
    def missing(self) -> int:
        """Frames in which the marker was not seen."""
        return int(np.diff(self.stretches, axis=1).sum())

    @property
    def share(self) -> float:
        """Share of the frames in which the marker was not seen."""
        return self.missing / self.n_frames if self.n_frames else 0.0


def seen(positions: FloatArray) -> NDArray[np.bool_]:
    """Tell in which frames each marker of (N, M, 3) positions was seen, (N, M)."""
    x, y, z = np.moveaxis(np.isfinite(positions), 2, 0)  # faster than `all` along a short axis
    return np.asarray(x & y & z)


def marker_gaps(positions: FloatArray, markers: tuple[str, ...]) -> tuple[MarkerGaps, ...]:
    """Find the gaps of every marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    markers : tuple of str
        The M names.
    """
    unseen = ~seen(positions)
    return tuple(
        MarkerGaps(name, runs(unseen[:, m]), len(positions)) for m, name in enumerate(markers)
    )
