"""Stretches in which two markers keep each other's distances to a rigid cluster."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.rigid import Cluster, PairDistances
from hopdata.recordings.quality.runs import runs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OFF = 6.0  # spreads: a distance further off is not the marker's own
FITS = 3.0  # spreads, rms: exchanged distances further off are not the other's either
LEAST_FRAMES = 2
NEAR = 3  # frames within which both markers must jump, or be unseen, where a stretch ends


def exchanged_stretches(
    positions: FloatArray,
    pairs: PairDistances,
    clusters: tuple[Cluster, ...],
    *,
    breaks: BoolArray,
) -> Iterator[tuple[int, int, int, int]]:
    """Yield both markers, the first frame of a stretch, and the frame after its last.

    Names can be exchanged only where both tracks break, so a stretch must begin and end at breaks.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    pairs : PairDistances
        Of all M markers.
    clusters : tuple of Cluster
        A marker of a cluster may have been exchanged with another of it, or with any other marker.
    breaks : (N, M) bool array
        Frames in which a marker jumps or is not seen.
    """
    for cluster in clusters:
        for a in cluster.markers:
            if not (suspicious := _away_from_home(positions, pairs, cluster, a)).any():
                continue
            for b in range(positions.shape[1]):
                if b == a or (b in cluster.markers and b < a):
                    continue
                mask = suspicious & _exchanged(positions, pairs, cluster, a, b)
                for start, stop in runs(mask | (_unknown(mask, breaks[:, a] | breaks[:, b]))):
                    start, stop = _trimmed(mask, int(start), int(stop))
                    is_long = mask[start:stop].sum() >= LEAST_FRAMES
                    if is_long and all(_broken(breaks[:, [a, b]], end) for end in (start, stop)):
                        yield a, b, start, stop


def _unknown(mask: BoolArray, broken: BoolArray) -> BoolArray:
    """Frames (N,) that break a track, if there is anything in `mask` that they could split."""
    return broken if mask.any() else np.zeros_like(mask)


def _trimmed(mask: BoolArray, start: int, stop: int) -> tuple[int, int]:
    """Cut a stretch down to the first and the last frame of `mask` in it."""
    inside = np.flatnonzero(mask[start:stop])
    return (start + int(inside[0]), start + int(inside[-1]) + 1) if len(inside) else (start, start)


def _broken(breaks: BoolArray, end: int) -> bool:
    """Tell whether both tracks (N, 2) break near an end, or the recording does."""
    if end == 0 or end == len(breaks):
        return True
    return bool(breaks[max(0, end - NEAR) : end + NEAR].any(axis=0).all())


def _away_from_home(
    positions: FloatArray, pairs: PairDistances, cluster: Cluster, a: int
) -> BoolArray:
    """Frames (N,) in which some distance of marker `a` to its cluster is not its own."""
    away = np.zeros(len(positions), dtype=bool)
    for c in cluster.markers:
        if c != a:
            distance = np.linalg.norm(positions[:, a] - positions[:, c], axis=1)
            with np.errstate(invalid="ignore"):
                away |= np.abs(distance - pairs.median[a, c]) > OFF * pairs.spread[a, c]
    return away


def _exchanged(
    positions: FloatArray, pairs: PairDistances, cluster: Cluster, a: int, b: int
) -> BoolArray:
    """Frames (N,) in which the exchanged names fit the cluster's distances, the own do not."""
    others = [c for c in cluster.markers if c not in (a, b)]
    both = b in cluster.markers
    if len(others) < (1 if both else 2):
        return np.zeros(len(positions), dtype=bool)
    terms = [(a, b, c) for c in others] + ([(b, a, c) for c in others] if both else [])
    own, exchanged = np.zeros(len(positions)), np.zeros(len(positions))
    for m, other, c in terms:
        scale = max(pairs.spread[m, c], 1e-12)
        for total, marker in ((own, m), (exchanged, other)):
            distance = np.linalg.norm(positions[:, marker] - positions[:, c], axis=1)
            total += ((distance - pairs.median[m, c]) / scale) ** 2
    with np.errstate(invalid="ignore"):
        fits: BoolArray = (own > OFF**2 * len(terms)) & (exchanged < FITS**2 * len(terms))
    return fits
