"""Stances of a recording and the hops between them (dissertation, Algorithm 4, made robust)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.observation.bottoms import BOTTOM_UNSEEN, NO_BOUNCE, Bottom, find_bottom
from hopdata.steering.observation.height_band import height_band
from hopdata.steering.observation.visits import HELD, HOLE, Visits, find_visits, not_a_hop

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NO_STANCE = "one of them no stance"
REASONS = (BOTTOM_UNSEEN, NO_BOUNCE, NO_STANCE, HOLE, HELD)


@dataclass(frozen=True)
class Stances:
    """Stances in order of time, and which of them are a hop apart.

    Parameters
    ----------
    time_s : (K,) array
        Instant of the lowest point, between frames.
    height_m : (K,) array
        Height there.
    frame : (K,) array of int
        The nearest frame with a known height.
    bridged : (K,) bool array
        Whether the lowest point fell into a hole: its instant is less sure.
    pairs : (P, 2) array of int
        Numbers k and k + 1 of the two stances of each hop.
    rejected : dict of str to int
        By reason, how many visits below the threshold are no stance ("lowest point not seen", "no
        bounce"), and how many neighbouring visits are no hop ("one of them no stance", "heights
        missing in between", "held or carried in between").
    """

    time_s: FloatArray
    height_m: FloatArray
    frame: IntArray
    bridged: BoolArray
    pairs: IntArray
    rejected: dict[str, int]


def find_stances(
    time: FloatArray, height: FloatArray, band_m: tuple[float, float] | None = None
) -> Stances:
    """Find all stances, and pair those with one flight and nothing else between them.

    A stance is a visit below the lower threshold, before the height is above the upper one again:
    double minima, and a stumble that does not rise above the upper one, are one visit. Its instant
    is the lowest point, where the body must be thrown back up. A pair is a hop if the time spent
    above the upper threshold is that of free fall: else somebody held or carried the hopper.

    Parameters
    ----------
    time : (N,) array
        In order, s; frames may be missing.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    band_m : (float, float), optional
        The two thresholds; by default `height_band` of these heights.
    """
    below, above = height_band(height) if band_m is None else band_m
    frames = np.flatnonzero(np.isfinite(height))
    t, z = time[frames], height[frames]
    visits = find_visits(t, z, below, above)
    frame_s = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    bottoms = [_bottom(t, z, visits, k, frame_s) for k in range(len(visits.lowest))]
    links = [_link(t, z, visits, bottoms, k, above) for k in range(len(bottoms) - 1)]
    found = [bottom for bottom in bottoms if isinstance(bottom, Bottom)]
    number = np.cumsum([isinstance(bottom, Bottom) for bottom in bottoms]) - 1
    first = np.array([number[k] for k, link in enumerate(links) if link is None], dtype=int)
    why = Counter(reason for reason in [*bottoms, *links] if isinstance(reason, str))
    instants = np.array([bottom.time_s for bottom in found])
    return Stances(
        instants,
        np.array([bottom.height_m for bottom in found]),
        frames[_nearest(t, instants)],
        np.array([bottom.bridged for bottom in found], dtype=bool),
        np.column_stack([first, first + 1]),
        {reason: why[reason] for reason in REASONS},
    )


def _bottom(t: FloatArray, z: FloatArray, visits: Visits, k: int, frame_s: float) -> Bottom | str:
    """Return the lowest point of a visit, which must lie in it, or why it has none."""
    found = find_bottom(t, z, int(visits.lowest[k]), frame_s)
    first, last = max(visits.first[k] - 1, 0), min(visits.last[k] + 1, len(t) - 1)
    if isinstance(found, Bottom) and not t[first] < found.time_s < t[last]:
        return BOTTOM_UNSEEN
    return found


def _link(
    t: FloatArray, z: FloatArray, visits: Visits, bottoms: list[Bottom | str], k: int, above: float
) -> str | None:
    """Say why visits k and k + 1 are no hop apart; None if they are."""
    if isinstance(bottoms[k], str) or isinstance(bottoms[k + 1], str):
        return NO_STANCE
    if visits.after_hole[k + 1]:
        return HOLE
    return not_a_hop(t, z, int(visits.last[k]), int(visits.first[k + 1]), above)


def _nearest(time: FloatArray, instants: FloatArray) -> IntArray:
    after = np.searchsorted(time, instants).clip(1, max(len(time) - 1, 1))
    early = instants - time[after - 1] < time[after] - instants
    return np.asarray(after - early)
