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
        A marker of a cluster may have been exchanged with another of it or with any other; two
        markers outside of it are told apart by where they usually are beside it.
    breaks : (N, M) bool array
        Frames in which a marker jumps or is not seen.
    """
    n_markers = positions.shape[1]
    for cluster in clusters:
        inside = set(cluster.markers)
        away = [_away_from_home(positions, pairs, cluster, m) for m in range(n_markers)]
        for a in range(n_markers):
            for b in range(a + 1, n_markers):
                first, second = (b, a) if b in inside and a not in inside else (a, b)
                if not away[first].any():
                    continue
                mask = np.zeros(len(positions), dtype=bool)
                here = np.flatnonzero(away[first])
                mask[here] = _exchanged(positions[here], pairs, cluster, first, second)
                for start, stop in _stretches(mask, breaks[:, [a, b]]):
                    yield a, b, start, stop


def _stretches(mask: BoolArray, breaks: BoolArray) -> Iterator[tuple[int, int]]:
    """Yield the stretches of a mask (N,) between breaks of both tracks (N, 2)."""
    if not mask.any():
        return
    for start, stop in runs(mask | breaks.any(axis=1)):
        inside = start + np.flatnonzero(mask[start:stop])
        if len(inside) >= LEAST_FRAMES:
            ends = int(inside[0]), int(inside[-1]) + 1
            if all(_broken(breaks, end) for end in ends):
                yield ends


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
            distance = _distance(positions, a, c)
            with np.errstate(invalid="ignore"):
                away |= np.abs(distance - pairs.median[a, c]) > OFF * pairs.spread[a, c]
    return away


def _exchanged(
    positions: FloatArray, pairs: PairDistances, cluster: Cluster, a: int, b: int
) -> BoolArray:
    """Frames (N,) in which the exchanged names fit the cluster's distances, the own do not."""
    inside = set(cluster.markers)
    others = [c for c in cluster.markers if c not in (a, b)]
    if len(others) < (1 if {a, b} <= inside else 2 if a in inside else 3):
        return np.zeros(len(positions), dtype=bool)
    terms = [(a, b, c) for c in others]
    if (a in inside) == (b in inside):  # else nothing is known of where `b` should be
        terms += [(b, a, c) for c in others]
    own, exchanged = np.zeros(len(positions)), np.zeros(len(positions))
    for m, other, c in terms:
        scale = max(pairs.spread[m, c], 1e-12)
        for total, marker in ((own, m), (exchanged, other)):
            distance = _distance(positions, marker, c)
            total += ((distance - pairs.median[m, c]) / scale) ** 2
    with np.errstate(invalid="ignore"):
        fits: BoolArray = (own > OFF**2 * len(terms)) & (exchanged < FITS**2 * len(terms))
    return fits


def _distance(positions: FloatArray, a: int, b: int) -> FloatArray:
    """Distance (N,) between two of the markers."""
    apart = positions[:, a] - positions[:, b]
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", apart, apart)))
