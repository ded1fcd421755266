"""Stances of a recording and the hops between them (dissertation, Algorithm 4, made robust)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.observation.height_band import height_band
from hopdata.steering.observation.local_fits import local_fit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HOLE_S = 0.2  # without a height for so long, anything may have happened
BOTTOM_S = 0.045  # half the window of the fit at the bottom
WIDER_S = 0.09  # where frames are missing
LEAST_BEND_M_S2 = 5.0  # half of g: a floor throws back harder than a hand lifts
GRAVITY_M_S2 = 9.81
SHORTEST, LONGEST = 0.6, 1.5  # time in flight over that of free fall from the apex

BOTTOM_UNSEEN, NO_BOUNCE = "lowest point not seen", "no bounce"
HELD, HOLE, NO_STANCE = "held or carried in between", "heights missing in between", "no stance"


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
    pairs : (P, 2) array of int
        Numbers of the two stances of each hop, k and k + 1.
    rejected : dict of str to int
        How many visits below the threshold are no stance, and how many neighbouring visits no hop,
        by reason.
    """

    time_s: FloatArray
    height_m: FloatArray
    frame: IntArray
    pairs: IntArray
    rejected: dict[str, int]


@dataclass(frozen=True)
class _Visit:
    """Frames from `first` to `last` without a flight between them; whether a hole came before."""

    first: int
    last: int
    after_hole: bool


def find_stances(
    time: FloatArray, height: FloatArray, band_m: tuple[float, float] | None = None
) -> Stances:
    """Find all stances, and pair those with nothing but one flight between them.

    A stance is a visit below the lower threshold, before the height is above the upper one again;
    double minima are one visit. Its instant is the lowest point of a cubic through the frames
    there, which must bend by half of g at least. A pair is a hop if the time spent above the
    upper threshold is that of free fall from the highest point: else somebody held the hopper.

    Parameters
    ----------
    time : (N,) array
        s; frames may be missing.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    band_m : (float, float), optional
        The two thresholds; by default `height_band` of these heights.
    """
    below, above = height_band(height) if band_m is None else band_m
    frames = np.flatnonzero(np.isfinite(height))
    t, z = time[frames], height[frames]
    visits = _visits(t, z, below, above)
    rejected = dict.fromkeys((BOTTOM_UNSEEN, NO_BOUNCE, NO_STANCE, HOLE, HELD), 0)
    found: list[tuple[float, float, int]] = []
    pairs: list[tuple[int, int]] = []
    before: _Visit | None = None  # the last visit that was a stance, if it was the last visit
    for number, visit in enumerate(visits):
        bottom = _bottom(t, z, visit)
        reason = None if number == 0 else NO_STANCE
        if isinstance(bottom, str):
            rejected[bottom] += 1
            before = None
        else:
            found.append(bottom)
            if before is not None:
                reason = _not_a_hop(t, z, before, visit, above)
            if number > 0 and reason is None:
                pairs.append((len(found) - 2, len(found) - 1))
            before = visit
        if reason is not None:
            rejected[reason] += 1
    instants, heights, nearest = (
        (np.array(part) for part in zip(*found, strict=True))
        if found
        else (np.empty(0), np.empty(0), np.empty(0, dtype=int))
    )
    return Stances(
        instants, heights, frames[nearest], np.array(pairs, dtype=int).reshape(-1, 2), rejected
    )


def _visits(t: FloatArray, z: FloatArray, below: float, above: float) -> list[_Visit]:
    """Return the visits below the lower threshold, up to the next rise above the upper one."""
    side = np.where(z < below, -1, np.where(z > above, 1, 0))
    outside = np.flatnonzero(side)
    hole_before = np.diff(t, prepend=t[:1]) > HOLE_S
    holes = np.cumsum(hole_before)
    begins = [
        i
        for i, k in enumerate(outside)
        if side[k] < 0 and (i == 0 or side[outside[i - 1]] > 0 or holes[k] > holes[outside[i - 1]])
    ]
    visits = []
    for n, i in enumerate(begins):
        end = begins[n + 1] if n + 1 < len(begins) else len(outside)
        inside = outside[i:end]
        inside = inside[side[inside] < 0]
        start = outside[begins[n - 1]] if n else 0
        visits.append(_Visit(inside[0], inside[-1], bool(holes[inside[0]] > holes[start])))
    return visits


def _bottom(t: FloatArray, z: FloatArray, visit: _Visit) -> tuple[float, float, int] | str:
    """Return instant, height and frame of the lowest point, or why it is none."""
    lowest = visit.first + int(np.argmin(z[visit.first : visit.last + 1]))
    for half_s in (BOTTOM_S, WIDER_S):
        fit = local_fit(t, z, t[lowest], half_s, degree=3)
        if fit is None:
            continue
        instant = fit.extremum()
        if instant is None:
            return NO_BOUNCE
        height, _, bend = fit.at(instant)
        if bend < LEAST_BEND_M_S2:
            return NO_BOUNCE
        return instant, height, int(np.argmin(np.abs(t - instant)))
    return BOTTOM_UNSEEN


def _not_a_hop(
    t: FloatArray, z: FloatArray, one: _Visit, other: _Visit, above: float
) -> str | None:
    """Say why two stances are not a hop apart, or None if they are."""
    if other.after_hole:
        return HOLE
    between = slice(one.last, other.first + 1)
    high = np.flatnonzero(z[between] > above) + one.last
    up = np.interp(above, z[high[0] - 1 : high[0] + 1], t[high[0] - 1 : high[0] + 1])
    down = np.interp(-above, -z[high[-1] : high[-1] + 2], t[high[-1] : high[-1] + 2])
    free = 2 * np.sqrt(2 * (z[high].max() - above) / GRAVITY_M_S2)
    return None if SHORTEST * free <= down - up <= LONGEST * free else HELD
