"""Which markers land, by their motion, and which of them land together.

Lengths and speeds refer to an animal of 1 m; positions are scaled to that size first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recordings.quality.rests import BAND_M, at_rest, lowest, scale_of_all
from hopdata.recordings.quality.stretches import quantiles, runs
from hopdata.recordings.quality.vocabulary import named_parts

#: Feet of a study, at least.
#: Unit: 1. Origin: derived: with fewer there is no order of contacts.
LEAST_FEET = 2

#: Rests of a marker that no other evidence assigns to a foot.
#: Unit: 1. Origin: chosen.
LEAST_RESTS = 3

#: Share of the frames at rest up to which a marker only passes its lowest height.
#: Unit: 1. Origin: chosen.
LEAST_AT_REST = 0.03

#: Share of the frames at rest from which on a marker hardly ever leaves the floor.
#: Unit: 1. Origin: chosen.
MOST_AT_REST = 0.95

#: A marker that rests after being this much above the band of its rests has landed.
#: Unit: m. Origin: chosen.
LIFT_M = 0.05

#: Greatest height of a foot marker at rest, relative to that of the highest marker.
#: Unit: 1. Origin: chosen.
NEAR_FLOOR = 0.08

#: Share of the shorter one's rests that two markers have in common if they land
#: together.
#: Unit: 1. Origin: chosen.
TOGETHER = 0.5

#: A marker that moves less than this along each axis is fixed in the world.
#: Unit: m. Origin: chosen.
STILL_M = 0.003

#: Share of the frames that are left out at either end where that motion is measured.
#: Unit: 1. Origin: chosen.
STILL_BUT_FOR = 0.02

#: Largest share of fixed markers; beyond it, somebody is standing still.
#: Unit: 1. Origin: chosen.
MOST_FIXED = 0.25


@dataclass(frozen=True)
class Motion:
    """How M markers move in N frames, scaled to an animal of 1 m.

    Parameters
    ----------
    heights : (N, M) array
        Heights, m.
    rests : (N, M) bool array
        When each marker rests near its lowest height.
    fixed : (M,) bool array
        Which markers stay in one place.
    """

    heights: FloatArray
    rests: BoolArray
    fixed: BoolArray


def motion_of(positions: FloatArray, rate_hz: float) -> Motion:
    """Return how markers (N, M, 3), m, z up, move."""
    scale = scale_of_all(positions)
    if scale != 1:  # saves a copy of a long recording
        positions = positions / scale
    heights = positions[:, :, 2]
    # A small animal moves faster, by the root of its size.
    rests = at_rest(heights, rate_hz * scale**0.5)
    return Motion(heights, rests, _fixed(positions))


def _fixed(positions: FloatArray) -> BoolArray:
    """Tell which markers stay in one place but for noise, (M,); none if many do."""
    fixed = np.ones(positions.shape[1], dtype=bool)
    for axis in range(3):
        ends = [STILL_BUT_FOR, 1 - STILL_BUT_FOR]
        low, high = quantiles(positions[:, :, axis], ends)
        fixed &= high - low < STILL_M
    if fixed.mean() > MOST_FIXED:
        fixed[:] = False
    return fixed


def landing_markers(markers: tuple[str, ...], motion: Motion) -> list[int]:
    """Return the markers that rest near the floor again and again, or that land there.

    Markers fixed in the world do not define the floor, since they may be below it.
    """
    low_m = lowest(motion.heights)
    moving = np.isfinite(low_m) & ~motion.fixed
    if not moving.any():
        return []
    floor_m = low_m[moving].min()
    top_m = np.nanmax(quantiles(motion.heights, [0.5]))
    reaches_floor = low_m - floor_m < NEAR_FLOOR * (top_m - floor_m)
    share_at_rest = motion.rests.mean(axis=0)

    names = named_parts(tuple(markers))
    often = []
    once = []
    named = []
    for m in np.flatnonzero(reaches_floor & (share_at_rest > LEAST_AT_REST)).tolist():
        part = names.role(m)
        if part not in ("foot", "ankle", ""):
            continue
        rests = motion.rests[:, m]
        if share_at_rest[m] < MOST_AT_REST and len(runs(rests)) >= LEAST_RESTS:
            often.append(m)
        if _landings(motion.heights[:, m], rests):
            once.append(m)
            if part == "foot":
                named.append(m)

    # One landing is enough for a marker named as a foot, or if nothing better is found.
    if len(named) + len(often) < LEAST_FEET:
        return once
    return sorted({*often, *named})


def _landings(heights: FloatArray, rests: BoolArray) -> int:
    """Count the rests before which, since the last rest, the marker was well above."""
    low_m = lowest(heights[:, None])[0]
    is_high = heights > low_m + BAND_M + LIFT_M
    landings = 0
    since = 0
    for start, _ in runs(rests):
        if is_high[since:start].any():
            landings += 1
        since = start
    return landings


def land_together(candidates: Sequence[int], rests: BoolArray) -> list[list[int]]:
    """Group markers by whether they rest at the same time, the largest group first."""
    groups: list[list[int]] = []
    for m in candidates:
        merged = [m]
        apart = []
        for group in groups:
            if any(rest_together(rests[:, m], rests[:, k]) for k in group):
                merged += group
            else:
                apart.append(group)
        groups = [*apart, sorted(merged)]
    return sorted(groups, key=lambda group: (-len(group), group))


def rest_together(one: BoolArray, other: BoolArray) -> bool:
    """Tell whether two markers rest at the same time; their rests are (N,)."""
    n_both = (one & other).sum()
    return bool(n_both > TOGETHER * min(one.sum(), other.sum()))


def feet_between(
    markers: tuple[str, ...], positions: FloatArray, rate_hz: float, feet: Sequence[str]
) -> list[str]:
    """Return the markers that rest on the floor at other times than these feet.

    Parameters
    ----------
    markers : tuple of str
        The M names of the whole file.
    positions : (N, M, 3) array
        In m, z up.
    rate_hz : float
        Frame rate, Hz.
    feet : sequence of str
        Names of the feet that are analysed.
    """
    motion = motion_of(positions, rate_hz)
    given = {markers.index(name) for name in feet}
    landing = landing_markers(markers, motion)
    between = []
    for group in land_together(sorted({*landing, *given}), motion.rests):
        if not given & set(group):
            between += [markers[m] for m in group]
    return between
