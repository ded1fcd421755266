"""Rigid clusters of markers and the noise of a marker, both from distances between pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SAMPLE_FRAMES = 4000
SAMPLE_NUMBERS, LEAST_SAMPLED = 10_000_000, 500  # of many markers fewer frames, but so many
MOST_FRAMES = 200_000
LEAST_FRAMES = 5  # with fewer, nothing lies between the outer fifths
STRAIN = 0.025  # spread of a distance, relative, up to which a pair counts as rigid
SIGMAS = 4.0  # or up to this many times what the markers' own noise makes of it
LEAST = 3
MAD_TO_SD = 1.4826
FIFTHS_TO_SD = 1.6832  # range from the 20 % to the 80 % quantile of a normal distribution


@dataclass(frozen=True)
class PairDistances:
    """Distances between markers over a recording.

    Parameters
    ----------
    median : (M, M) array
        Median distance; NaN for pairs never seen together.
    spread : (M, M) array
        Standard deviation by the range between the outer fifths: a fifth of the frames may be wrong
        on either side, yet a leg that is stiff for half of the time is not taken for rigid.
    """

    median: FloatArray
    spread: FloatArray


@dataclass(frozen=True)
class Cluster:
    """Markers that keep their distances.

    Parameters
    ----------
    markers : tuple of int
        Their indices, at least three.
    noise : float
        Standard deviation of a marker's coordinate that the pairs' median spread amounts to, in
        the unit of the positions; what bends or slips counts as noise.
    """

    markers: tuple[int, ...]
    noise: float


def pair_distances(positions: FloatArray) -> PairDistances:
    """Measure all distances of (N, M, 3) positions, over about `SAMPLE_FRAMES` frames.

    Of more than fifty markers over fewer, such that the work stays the same. A spread needs
    `LEAST_FRAMES` frames.
    """
    n = positions.shape[1]
    most = max(LEAST_SAMPLED, min(SAMPLE_FRAMES, SAMPLE_NUMBERS // max(n, 1) ** 2))
    tracks = np.moveaxis(positions[:: max(1, len(positions) // most)], 1, 0)
    median, spread = np.full((n, n), np.nan), np.full((n, n), np.nan)
    np.fill_diagonal(median, 0.0)
    np.fill_diagonal(spread, 0.0)
    for i in range(1, n):
        apart = np.linalg.norm(tracks[:i] - tracks[i], axis=2)
        low, middle, high = _quantiles(apart, (0.2, 0.5, 0.8))
        median[i, :i] = median[:i, i] = middle
        spread[i, :i] = spread[:i, i] = (high - low) / FIFTHS_TO_SD
    return PairDistances(median, spread)


def _quantiles(values: FloatArray, levels: tuple[float, ...]) -> list[FloatArray]:
    """Quantiles of what is finite in each row of (K, N) values, as NumPy interpolates them, (K,).

    NaN without any; the outer ones also with fewer than `LEAST_FRAMES`.
    """
    values = np.sort(np.where(np.isfinite(values), values, np.nan), axis=1)
    count = np.isfinite(values).sum(axis=1)
    row = np.arange(len(values))
    found = []
    for level in levels:
        place = np.maximum(count - 1, 0) * level
        below = place.astype(np.int64)
        low, high = values[row, below], values[row, np.minimum(below + 1, np.maximum(count - 1, 0))]
        share = place - below
        inside = np.where(
            share < 0.5, low + (high - low) * share, high - (high - low) * (1 - share)
        )
        found.append(np.where(count < (1 if level == 0.5 else LEAST_FRAMES), np.nan, inside))
    return found


def frame_noise(positions: FloatArray) -> FloatArray:
    """Noise of each marker that changes from frame to frame, (M,), by fourth differences.

    The standard deviation of a coordinate, robust against the frames at which a foot lands; NaN
    for a marker without five frames in a row. Noise that a camera system has smoothed is missed.
    At most `MOST_FRAMES` evenly spaced frames are looked at.
    """
    n, n_markers = len(positions) - 4, positions.shape[1]
    noise = np.full(n_markers, np.nan)
    stride = max(1, -(-n // MOST_FRAMES))
    for m in range(n_markers if n > 0 else 0):
        fourth = np.diff([positions[k : k + n : stride, m] for k in range(5)], 4, axis=0)[0]
        fourth = fourth[np.isfinite(fourth).all(axis=1)]
        if len(fourth):
            noise[m] = MAD_TO_SD * float(np.median(np.abs(fourth))) / np.sqrt(70.0)
    return noise


def rigid_clusters(pairs: PairDistances, noise: FloatArray) -> tuple[Cluster, ...]:
    """Group markers so that every pair of a group is rigid, the largest groups first.

    Parameters
    ----------
    pairs : PairDistances
        Of all M markers.
    noise : (M,) array
        Noise of each marker from frame to frame, in the same unit.
    """
    if len(pairs.median) < LEAST:
        return ()
    own = np.sqrt(noise[:, None] ** 2 + noise[None] ** 2)
    allowed = np.fmax(STRAIN * _local(pairs.median), SIGMAS * np.nan_to_num(own))
    with np.errstate(invalid="ignore", divide="ignore"):
        softness = np.where(np.isfinite(pairs.spread), pairs.spread / allowed, np.inf)
    softness[~np.isfinite(softness)] = 1e6
    np.fill_diagonal(softness, 0.0)
    if np.sum(softness <= 1.0) == len(softness):  # no pair
        return ()
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    groups = fcluster(linkage(squareform(softness, checks=False), "complete"), 1.0, "distance")
    members = [tuple(np.flatnonzero(groups == g).tolist()) for g in np.unique(groups)]
    clusters = [Cluster(m, _noise(pairs.spread, m)) for m in members if len(m) >= LEAST]
    return tuple(sorted(clusters, key=lambda c: (-len(c.markers), c.markers)))


def _local(median: FloatArray) -> FloatArray:
    """Distances, but at most twice the way to a neighbour: far things seem rigid to all (M, M)."""
    others = median + np.where(np.eye(len(median)), np.inf, 0.0)
    nearest = np.nanmin(np.where(np.isnan(others), np.inf, others), axis=1)
    return np.fmin(median, 2 * np.fmin(nearest[:, None], nearest[None]))


def _noise(spread: FloatArray, members: tuple[int, ...]) -> float:
    inner = spread[np.ix_(members, members)][np.triu_indices(len(members), 1)]
    return float(np.median(inner) / np.sqrt(2.0))
