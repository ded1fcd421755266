"""Markers whose names were exchanged: found by where each goes on, and by pair distances."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.exchanged_distances import exchanged_stretches
from hopdata.recordings.quality.exchanges import LONGEST_GAP_S, Exchange, exchanges
from hopdata.recordings.quality.gaps import seen
from hopdata.recordings.quality.one_sided import Surprises
from hopdata.recordings.quality.rigid import Cluster, PairDistances

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CONTINUITY, DISTANCES = "continuity", "pair distances"
NEAR = 3  # frames by which the two tests may differ in when


@dataclass(frozen=True)
class Swap:
    """Markers that seem to have exchanged their names for a while.

    Parameters
    ----------
    markers : tuple of str
        Two names, or more if they went round in a circle.
    start : int
        First frame with the exchanged names, from 0.
    stop : int or None
        The frame after the last; None if the names never came back, so that either part of the
        recording may be the right one.
    found_by : tuple of str
        The tests that saw it: ``"continuity"``, ``"pair distances"``.
    """

    markers: tuple[str, ...]
    start: int
    stop: int | None
    found_by: tuple[str, ...]


def find_swaps(
    positions: FloatArray,
    markers: tuple[str, ...],
    *,
    missed: Surprises,
    pairs: PairDistances,
    clusters: tuple[Cluster, ...],
    rate_hz: float,
) -> tuple[Swap, ...]:
    """Find exchanged markers by both tests.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    markers : tuple of str
        The M names.
    missed : Surprises
        Of the same positions.
    pairs, clusters
        Distances and rigid clusters of the same positions.
    rate_hz : float
        Frame rate, Hz.
    """
    by_track = _paired(exchanges(positions, missed, rate_hz=rate_hz), markers)
    breaks = missed.is_step | missed.is_spike | ~seen(positions)
    by_distance = [
        Swap((markers[a], markers[b]), start, stop if stop < len(positions) else None, (DISTANCES,))
        for a, b, start, stop in exchanged_stretches(positions, pairs, clusters, breaks=breaks)
    ]
    longest = max(1, round(LONGEST_GAP_S * rate_hz))
    return tuple(
        sorted(_merged(by_track, by_distance, longest), key=lambda s: (s.start, s.markers))
    )


def explained_frames(swaps: Iterable[Swap], markers: tuple[str, ...], n_frames: int) -> BoolArray:
    """Mask (N, M) of the frames beside the ends of a swap, whose jumps it explains."""
    mask = np.zeros((n_frames, len(markers)), dtype=bool)
    for swap in swaps:
        stop = n_frames if swap.stop is None else swap.stop
        for name in swap.markers:
            column = mask[:, markers.index(name)]
            for frame in {swap.start, stop}:
                column[max(0, frame - NEAR) : frame + NEAR] = True
            if stop - swap.start <= NEAR:
                column[swap.start : stop] = True
    return mask


def _paired(found: Iterable[Exchange], markers: tuple[str, ...]) -> list[Swap]:
    """Join an exchange and the next one of the same markers, which undoes it."""
    swaps: list[Swap] = []
    waiting: dict[frozenset[int], int] = {}
    for exchange in found:
        key = frozenset(exchange.cycle)
        if key in waiting:
            at = waiting.pop(key)
            swaps[at] = replace(swaps[at], stop=exchange.frame)
        else:
            waiting[key] = len(swaps)
            names = tuple(markers[m] for m in exchange.cycle)
            swaps.append(Swap(names, exchange.frame, None, (CONTINUITY,)))
    return swaps


def _merged(by_track: list[Swap], by_distance: list[Swap], longest: int) -> list[Swap]:
    """Say of each swap who found it; both where they agree on the markers and overlap.

    An exchange that nothing undoes may itself undo one that only the distances show, and that ends
    in the gap (of `longest` frames at most) before it.
    """
    merged = list(by_track)
    for late in by_distance:
        for i, swap in enumerate(merged):
            same = set(swap.markers) == set(late.markers)
            if same and _undoes(swap, late, longest):
                both = late.found_by + swap.found_by
                merged[i] = replace(late, stop=swap.start, found_by=both)
                break
            if same and _overlap(swap, late):
                both = tuple(dict.fromkeys(swap.found_by + late.found_by))
                stop = swap.stop if swap.stop is not None else late.stop
                merged[i] = replace(swap, stop=stop, found_by=both)
                break
            if set(late.markers) < set(swap.markers) and _overlap(swap, late):
                break  # a part of a longer circle
        else:
            merged.append(late)
    return merged


def _undoes(swap: Swap, late: Swap, longest: int) -> bool:
    if swap.stop is not None or late.stop is None:
        return False
    return late.start < swap.start <= late.stop + longest


def _overlap(one: Swap, other: Swap) -> bool:
    ends = [np.inf if swap.stop is None else swap.stop for swap in (one, other)]
    return one.start < ends[1] + NEAR and other.start < ends[0] + NEAR
