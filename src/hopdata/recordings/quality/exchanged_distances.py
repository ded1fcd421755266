"""Stretches in which two markers keep each other's distances to a rigid cluster."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.rigid import Cluster, PairDistances
from hopdata.recordings.quality.runs import IntArray, runs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OFF = 6.0  # spreads: a distance further off is not the marker's own
FITS = 3.0  # spreads, rms: exchanged distances further off are not the other's either
EXACT = 1e-12  # m: no spread is smaller
MOST_REFERENCES = 12
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
    near = _near_breaks(breaks)
    edges = near[:-1] | near[1:]  # frames that may be the first of a stretch or its last
    for cluster in clusters:
        inside = set(cluster.markers)
        known = _references(cluster)
        away = [_away(positions, pairs, known, m, np.flatnonzero(e)) for m, e in enumerate(edges.T)]
        for a, b in combinations(range(len(away)), 2):
            first, second = (b, a) if b in inside and a not in inside else (a, b)
            if not len(away[first]):
                continue
            both = near[:, a] & near[:, b]
            ends = away[first][both[away[first]] | both[away[first] + 1]]
            if not _exchanged(positions[ends], pairs, inside, known, first, second).any():
                continue
            here = _away(positions, pairs, known, first, np.arange(len(positions)))
            mask = np.zeros(len(positions), dtype=bool)
            mask[here] = _exchanged(positions[here], pairs, inside, known, first, second)
            for start, stop in _stretches(mask, breaks[:, [a, b]]):
                yield a, b, start, stop


def _references(cluster: Cluster) -> list[int]:
    """Markers of a cluster by which places are known: of many, so many evenly spaced ones."""
    stride = -(-len(cluster.markers) // MOST_REFERENCES)
    return list(cluster.markers[::stride])


def _near_breaks(breaks: BoolArray) -> BoolArray:
    """Tell before which frame a track breaks nearby, (N + 1, M); at both ends all do."""
    near = np.zeros((len(breaks) + 1, breaks.shape[1]), dtype=bool)
    for shift in range(-NEAR + 1, NEAR + 1):
        inner = breaks[max(0, -shift) : len(breaks) + min(0, 1 - shift)]
        near[max(0, shift) : max(0, shift) + len(inner)] |= inner
    near[0] = near[-1] = True
    return near


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


def _away(
    positions: FloatArray, pairs: PairDistances, known: list[int], a: int, frames: IntArray
) -> IntArray:
    """Those of the frames (K,) in which some distance of marker `a` to the known is not its own."""
    away = np.zeros(len(frames), dtype=bool)
    track = positions[:, a][frames]
    for c in known:
        if c != a:
            off = np.abs(_distance(track, positions[:, c][frames]) - pairs.median[a, c])
            away |= off > OFF * max(pairs.spread[a, c], EXACT)
    return frames[away]


def _exchanged(
    positions: FloatArray,
    pairs: PairDistances,
    inside: set[int],
    known: list[int],
    a: int,
    b: int,
) -> BoolArray:
    """Frames (N,) in which the exchanged names fit the cluster's distances, the own do not."""
    others = [c for c in known if c not in (a, b)]
    if len(others) < (1 if {a, b} <= inside else 2 if a in inside else 3):
        return np.zeros(len(positions), dtype=bool)
    terms = [(a, b, c) for c in others]
    if (a in inside) == (b in inside):  # else nothing is known of where `b` should be
        terms += [(b, a, c) for c in others]
    own, exchanged = np.zeros(len(positions)), np.zeros(len(positions))
    for m, other, c in terms:
        scale = max(pairs.spread[m, c], EXACT)
        for total, marker in ((own, m), (exchanged, other)):
            distance = _distance(positions[:, marker], positions[:, c])
            total += ((distance - pairs.median[m, c]) / scale) ** 2
    with np.errstate(invalid="ignore"):
        fits: BoolArray = (own > OFF**2 * len(terms)) & (exchanged < FITS**2 * len(terms))
    return fits


def _distance(one: FloatArray, other: FloatArray) -> FloatArray:
    """Distance (N,) between two tracks (N, 3)."""
    apart = one - other
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", apart, apart)))
