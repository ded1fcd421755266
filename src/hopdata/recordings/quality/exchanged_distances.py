"""Stretches in which two markers keep each other's distances to a rigid cluster."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.rigid import Cluster, PairDistances, norms
from hopdata.recordings.quality.stretches import near, runs

#: Deviation from which on a distance is not the marker's own.
#: Unit: spreads. Origin: chosen.
OFF = 6.0

#: Largest rms deviation at which the exchanged distances fit the other marker.
#: Unit: spreads. Origin: chosen.
FITS = 3.0

#: Smallest spread of a distance: deviations are divided by it.
#: Unit: m. Origin: chosen.
LEAST_SPREAD_M = 1e-12

#: Evenly spaced markers of a cluster that serve as references, at most.
#: Unit: 1. Origin: chosen.
MOST_REFERENCES = 12

#: Frames of an exchange, at least.
#: Unit: frames. Origin: chosen.
LEAST_EXCHANGED = 2

#: Both markers must jump or be unseen this close to the end of a stretch.
#: Unit: frames. Origin: chosen.
NEAR = 3


def exchanged_stretches(
    positions: FloatArray,
    pairs: PairDistances,
    clusters: tuple[Cluster, ...],
    *,
    breaks: BoolArray,
) -> Iterator[tuple[int, int, int, int]]:
    """Yield both markers, the first frame of each stretch, and that after its last.

    Names can only be exchanged where both tracks break, so a stretch must begin and end
    at breaks.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    pairs : PairDistances
        Distances of all M markers.
    clusters : tuple of Cluster
        A marker of a cluster may have been exchanged with any other marker. Two markers
        outside it are told apart by their usual places relative to it.
    breaks : (N, M) bool array
        Frames in which a marker jumps or is not seen.
    """
    breaking = _boundaries_with_a_break(breaks)
    may_be_end = breaking[:-1] | breaking[1:]
    every_frame = np.arange(len(positions))
    for cluster in clusters:
        references = _evenly_spaced(cluster.markers)
        test = _Distances(positions, pairs, set(cluster.markers), references)
        away = []
        for m, ends in enumerate(may_be_end.T):
            away.append(test.away(m, np.flatnonzero(ends)))
        for a, b in combinations(range(len(away)), 2):
            only_second_inside = b in test.inside and a not in test.inside
            first, second = (b, a) if only_second_inside else (a, b)
            both_break = breaking[:, a] & breaking[:, b]
            ends = away[first][both_break[away[first]] | both_break[away[first] + 1]]
            # Most pairs are done with after looking at the possible ends.
            if not test.exchanged(first, second, ends).any():
                continue
            frames = test.away(first, every_frame)
            exchanged = np.zeros(len(positions), dtype=bool)
            exchanged[frames] = test.exchanged(first, second, frames)
            broken = breaks[:, a] | breaks[:, b]
            for start, stop in _stretches(exchanged, broken, both_break):
                yield a, b, start, stop


def _evenly_spaced(markers: Sequence[int]) -> list[int]:
    """Return evenly spaced markers of a cluster, at most `MOST_REFERENCES`."""
    stride = -(-len(markers) // MOST_REFERENCES)
    return list(markers[::stride])


def _boundaries_with_a_break(breaks: BoolArray) -> BoolArray:
    """Mark the boundaries of frames with a break of a track (N, M) nearby, (N + 1, M).

    Both ends of the recording count as breaks.
    """
    around = near(breaks, NEAR - 1)
    end = np.ones((1, breaks.shape[1]), dtype=bool)
    return np.concatenate([end, around[1:] | around[:-1], end])


def _stretches(
    exchanged: BoolArray, broken: BoolArray, both_break: BoolArray
) -> Iterator[tuple[int, int]]:
    """Yield the stretches of exchanged frames between breaks of both tracks.

    Parameters
    ----------
    exchanged : (N,) bool array
        Frames whose distances are exchanged.
    broken : (N,) bool array
        Frames in which one of the tracks is broken; a stretch may include them.
    both_break : (N + 1,) bool array
        Boundaries of frames where both tracks break.
    """
    for start, stop in runs(exchanged | broken):
        inside = start + np.flatnonzero(exchanged[start:stop])
        if len(inside) < LEAST_EXCHANGED:
            continue
        begin = int(inside[0])
        end = int(inside[-1]) + 1
        if both_break[begin] and both_break[end]:
            yield begin, end


@dataclass(frozen=True)
class _Distances:
    """Distances of markers to the references of a cluster.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    pairs : PairDistances
        Usual distances.
    inside : set of int
        Markers of the cluster.
    references : list of int
        Those of them to which distances are measured.
    """

    positions: FloatArray
    pairs: PairDistances
    inside: set[int]
    references: list[int]

    def spread(self, one: int, other: int) -> float:
        """Return the usual spread of a distance, which is never 0."""
        return max(float(self.pairs.spread[one, other]), LEAST_SPREAD_M)

    def away(self, marker: int, frames: IntArray) -> IntArray:
        """Select the frames, of (K,), in which a distance is not the marker's own."""
        is_away = np.zeros(len(frames), dtype=bool)
        track = self.positions[:, marker][frames]
        for reference in self.references:
            if reference == marker:
                continue
            distance = norms(track - self.positions[:, reference][frames])
            off = np.abs(distance - self.pairs.median[marker, reference])
            is_away |= off > OFF * self.spread(marker, reference)
        return frames[is_away]

    def exchanged(self, a: int, b: int, frames: IntArray) -> BoolArray:
        """Mask frames (K,) in which exchanged names fit and the own names do not."""
        references = [c for c in self.references if c not in (a, b)]
        if not len(frames) or len(references) < self._least_references(a, b):
            return np.zeros(len(frames), dtype=bool)
        positions = self.positions[frames]
        terms = [(a, b, c) for c in references]
        if (a in self.inside) == (b in self.inside):  # else the place of `b` is unknown
            terms += [(b, a, c) for c in references]
        own = np.zeros(len(frames))
        exchanged = np.zeros(len(frames))
        for marker, other, reference in terms:
            own += self._squares(positions, marker, marker, reference)
            exchanged += self._squares(positions, other, marker, reference)
        with np.errstate(invalid="ignore"):
            own_does_not_fit = own > OFF**2 * len(terms)
            exchanged_fits = exchanged < FITS**2 * len(terms)
        return np.asarray(own_does_not_fit & exchanged_fits)

    def _least_references(self, a: int, b: int) -> int:
        """Return how many references tell two markers apart."""
        if {a, b} <= self.inside:
            return 1
        if a in self.inside:
            return 2
        return 3

    def _squares(
        self, positions: FloatArray, marker: int, name: int, reference: int
    ) -> FloatArray:
        """Return squared deviations, spreads, of a marker's distance from a name's."""
        distance = norms(positions[:, marker] - positions[:, reference])
        off = distance - self.pairs.median[name, reference]
        return np.asarray((off / self.spread(name, reference)) ** 2)
