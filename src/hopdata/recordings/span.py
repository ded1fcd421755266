"""How much of a recording there is to see, and how far its markers spread."""

from __future__ import annotations

import numpy as np

from hopdata.recordings.raw import FloatArray
from hopdata.recordings.recording import Recording

SAMPLE_FRAMES = 2000


def fraction_seen(recording: Recording) -> FloatArray:
    """Fraction of the frames in which each marker was seen, (M,)."""
    fraction: FloatArray = (~np.isnan(recording.positions).any(axis=2)).mean(axis=0)
    return fraction


def extent(positions: FloatArray) -> float:
    """Median over frames of the diagonal of the box around all markers seen.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit, along any axes.

    Returns
    -------
    float
        In the unit of `positions`; NaN if no frame shows two markers.
    """
    frames = sampled(positions)
    frames = frames[(~np.isnan(frames).any(axis=2)).sum(axis=1) >= 2]
    if not len(frames):
        return float("nan")
    span = np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1)
    with np.errstate(over="ignore"):  # an absurd size may be infinite
        return float(np.median(np.sqrt((span**2).sum(axis=1))))


def body_over_feet(recording: Recording) -> FloatArray:
    """Median over frames of the mean body position less the mean foot position, (3,), m."""
    difference = sampled(recording.body).mean(axis=1) - sampled(recording.feet).mean(axis=1)
    difference = difference[~np.isnan(difference).any(axis=1)]
    if not len(difference):
        return np.full(3, np.nan)
    offset: FloatArray = np.median(difference, axis=0)
    return offset


def sampled(positions: FloatArray) -> FloatArray:
    """Return at most `SAMPLE_FRAMES` of the frames (N, ...), evenly spaced."""
    return positions[:: max(1, len(positions) // SAMPLE_FRAMES)]
