"""Rigid clusters and the noise of markers, both from distances between pairs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.recordings.quality.stretches import quantiles

#: Frames of a recording from which distances are measured, about.
#: Unit: frames. Origin: chosen.
SAMPLE_FRAMES = 4000

#: Numbers that are measured at most: fewer frames for many markers.
#: Unit: 1. Origin: chosen.
SAMPLE_NUMBERS = 10_000_000

#: Frames from which distances are measured at least, however many markers there are.
#: Unit: frames. Origin: chosen.
LEAST_SAMPLED = 500

#: Evenly spaced frames from which noise is measured at most.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 200_000

#: Frames that a spread needs.
#: Unit: frames. Origin: derived: with fewer nothing lies between the outer fifths.
LEAST_FRAMES = 5

#: Spread of a distance, relative to its length, up to which a pair counts as rigid.
#: Unit: 1. Origin: chosen.
STRAIN = 0.025

#: The same, as a multiple of the spread that the noise of the two markers explains.
#: Unit: standard deviations. Origin: chosen.
SIGMAS = 4.0

#: Spread of a distance, relative to its length, beyond which no noise makes it rigid:
#: then a marker is loose, or exchanged again and again.
#: Unit: 1. Origin: chosen.
LOOSE = 0.25

#: Distances that count as long: this many times that to the nearest other marker. Of
#: longer ones only this length counts, since far pairs all seem rigid.
#: Unit: 1. Origin: chosen.
LOCAL = 2

#: Markers of a cluster, at least.
#: Unit: 1. Origin: derived: three fix the attitude of a rigid body.
LEAST_MARKERS = 3

#: Median length of a vector of noise, relative to the noise of a coordinate.
#: Unit: standard deviations. Origin: derived: of three independent standard normals.
MEDIAN_LENGTH = 1.5381722544550522

#: Range from the 20 % to the 80 % quantile of noise.
#: Unit: standard deviations. Origin: derived: of a standard normal.
FIFTHS_TO_SD = 1.6832

#: Variance of the fourth difference of noise, relative to that of the noise.
#: Unit: 1. Origin: derived: 1 + 16 + 36 + 16 + 1, as the frames are independent.
FOURTH_DIFFERENCE = 70.0


@dataclass(frozen=True)
class PairDistances:
    """Distances between markers during a recording.

    Parameters
    ----------
    median : (M, M) array
        Median distance; NaN for pairs that are never seen together.
    spread : (M, M) array
        Standard deviation from the range between the outer fifths. A fifth of the
        frames may be wrong on either side, yet a leg that is stiff half of the time is
        not taken for rigid.
    """

    median: FloatArray
    spread: FloatArray

    def relative_spread(self, members: Sequence[int]) -> FloatArray:
        """Return the spread of K markers' distances relative to them, (K, K)."""
        square = np.ix_(members, members)
        with np.errstate(invalid="ignore", divide="ignore"):
            relative: FloatArray = self.spread[square] / self.median[square]
        np.fill_diagonal(relative, 0.0)
        return relative


@dataclass(frozen=True)
class Cluster:
    """Markers that keep their mutual distances.

    Parameters
    ----------
    markers : tuple of int
        Indices of at least three markers.
    noise : float
        Standard deviation of a marker's coordinate that corresponds to the pairs'
        median spread, in the unit of the positions. Bending and slipping count as
        noise.
    """

    markers: tuple[int, ...]
    noise: float


def pair_distances(positions: FloatArray) -> PairDistances:
    """Measure all distances of (N, M, 3) positions over about `SAMPLE_FRAMES` frames.

    With more than fifty markers, fewer frames are used to keep the work the same. A
    spread needs `LEAST_FRAMES` frames.
    """
    n_markers = positions.shape[1]
    affordable = SAMPLE_NUMBERS // max(n_markers, 1) ** 2
    n_frames = max(LEAST_SAMPLED, min(SAMPLE_FRAMES, affordable))
    stride = max(1, len(positions) // n_frames)
    tracks = np.moveaxis(positions[::stride], 1, 0)
    median = np.zeros((n_markers, n_markers))
    spread = np.zeros((n_markers, n_markers))
    for i in range(1, n_markers):
        apart = np.linalg.norm(tracks[:i] - tracks[i], axis=2)
        low, middle, high = quantiles(apart.T, [0.2, 0.5, 0.8])
        too_few = np.isfinite(apart).sum(axis=1) < LEAST_FRAMES
        deviation = np.where(too_few, np.nan, (high - low) / FIFTHS_TO_SD)
        median[i, :i] = middle
        median[:i, i] = middle
        spread[i, :i] = deviation
        spread[:i, i] = deviation
    return PairDistances(median, spread)


def frame_noise(positions: FloatArray, *, lag: int = 1) -> FloatArray:
    """Return the frame-to-frame noise of each marker, (M,), from fourth differences.

    The standard deviation of a coordinate, robust against the frames at which a foot
    lands. NaN for a marker without five frames in a row, `lag` frames apart. Noise that
    a camera system has smoothed is not detected. At most `MOST_FRAMES` evenly spaced
    frames are used.
    """
    n_windows = len(positions) - 4 * lag
    n_markers = positions.shape[1]
    noise = np.full(n_markers, np.nan)
    if n_windows <= 0:
        return noise
    stride = max(1, -(-n_windows // MOST_FRAMES))
    for m in range(n_markers):
        five = [
            positions[k : k + n_windows : stride, m] for k in range(0, 5 * lag, lag)
        ]
        fourth = np.diff(five, 4, axis=0)[0]
        fourth = fourth[np.isfinite(fourth).all(axis=1)]
        if len(fourth):
            # The length of the vector, because its coordinates depend on the axes.
            length = np.sqrt(np.median((fourth**2).sum(axis=1)))
            noise[m] = float(length) / MEDIAN_LENGTH / np.sqrt(FOURTH_DIFFERENCE)
    return noise


def rigid_clusters(pairs: PairDistances, noise: FloatArray) -> tuple[Cluster, ...]:
    """Group markers so that every pair in a group is rigid, the largest groups first.

    Parameters
    ----------
    pairs : PairDistances
        Distances of all M markers.
    noise : (M,) array
        Frame-to-frame noise of each marker, in the same unit.
    """
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    if len(pairs.median) < LEAST_MARKERS:
        return ()
    own = np.sqrt(noise[:, None] ** 2 + noise[None] ** 2)
    local = _local(pairs.median)
    by_noise = np.fmin(SIGMAS * np.nan_to_num(own), LOOSE * local)
    allowed = np.fmax(STRAIN * local, by_noise)
    with np.errstate(invalid="ignore", divide="ignore"):
        softness = np.nan_to_num(pairs.spread / allowed, nan=1e6, posinf=1e6)
    np.fill_diagonal(softness, 0.0)

    tree = linkage(squareform(softness, checks=False), "complete")
    group_of = fcluster(tree, 1.0, "distance")
    clusters = []
    for group in np.unique(group_of):
        members = tuple(np.flatnonzero(group_of == group).tolist())
        if len(members) >= LEAST_MARKERS:
            clusters.append(Cluster(members, _coordinate_noise(pairs.spread, members)))
    return tuple(sorted(clusters, key=lambda c: (-len(c.markers), c.markers)))


def _local(median: FloatArray) -> FloatArray:
    """Limit distances (M, M) to twice the distance to a neighbour.

    Far pairs all seem rigid.
    """
    to_others = median + np.where(np.eye(len(median)), np.inf, 0.0)
    nearest = np.nanmin(np.where(np.isnan(to_others), np.inf, to_others), axis=1)
    return np.fmin(median, LOCAL * np.fmin(nearest[:, None], nearest[None]))


def _coordinate_noise(spread: FloatArray, members: tuple[int, ...]) -> float:
    """Return the noise of a coordinate from the spreads (M, M) of a cluster's pairs."""
    square = np.ix_(members, members)
    of_pairs = spread[square][np.triu_indices(len(members), 1)]
    # A distance has the noise of two markers.
    return float(np.median(of_pairs) / np.sqrt(2.0))


def norms(vectors: FloatArray) -> FloatArray:
    """Return the lengths (...) of vectors (..., 3)."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
