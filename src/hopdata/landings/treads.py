"""Rests of feet at other heights than the floor: treads of stairs, boxes, hips.

Of stairs each tread is a floor of its own: `without_treads` takes the height of the
tread that a foot comes down to off its track, so that it rests at the height of the
floor each time. Rests at one or two heights may be on a box, or a hand on a hip: they
are counted, and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import counted
from hopdata.landings.floor_rests import (
    LEVEL_M,
    PAUSE_S,
    REST_BAND_M,
    rest_points,
)
from hopdata.messages import Message
from hopdata.recording import Recording

#: Shortest rest that counts, of an animal of 1 m: a foot is as slow at the top of its
#: swing, but not for as long.
#: Unit: s. Origin: chosen.
LEAST_REST_S = 0.1

#: Time before a foot is nearly at its rest in which it falls by `ARRIVES_M`, of an
#: animal of 1 m. A foot that is held in the air rises to its rest, or sinks to it
#: slowly.
#: Unit: s. Origin: chosen: with `ARRIVES_M` 0.2 m/s, half of a careful step's.
ARRIVES_S = 0.05

#: How near to its rest a foot nearly is, and how far it falls before, of an animal of
#: 1 m.
#: Unit: m. Origin: chosen: see `ARRIVES_S`.
ARRIVES_M = 0.01

#: Heights other than the floor's from which on feet step on treads.
#: Unit: 1. Origin: chosen: boxes and hips are at one or two.
LEAST_TREADS = 3

#: Fewest rests at other heights of which is told: noise makes one.
#: Unit: rests. Origin: chosen.
LEAST_TOLD = 3


@dataclass(frozen=True)
class _Rest:
    """A rest of a marker: its first and last frame, and its height, m."""

    begin: int
    end: int
    height_m: float


def without_treads(recording: Recording) -> tuple[Recording, list[Message]]:
    """Return a recording whose feet rest at the height of the floor on each tread.

    Parameters
    ----------
    recording : Recording
        Levelled: feet on the floor rest at height 0.

    Returns
    -------
    recording : Recording
        As it was, unless feet rest at `LEAST_TREADS` heights above or below the floor.
        Markers that are no feet are lowered by the mean of the treads, which are joined
        by straight lines.
    messages : list of Message
        How many rests are on treads, or are at other heights and no landings.
    """
    of_feet = _rests_of_feet(recording)
    above_m = _elsewhere(recording, of_feet)
    n_levels = _n_levels(above_m, LEVEL_M * recording.scale)
    if n_levels < LEAST_TREADS:
        return recording, _told(recording, above_m)
    values = {"levels": n_levels, **_values(recording, above_m)}
    message = Message("landings.treads", values)
    return _on_one_floor(recording, of_feet), [message]


def rests_elsewhere(recording: Recording) -> list[Message]:
    """Tell how many rests of feet are at other heights than the floor: no landings.

    The recording is levelled.
    """
    return _told(recording, _elsewhere(recording, _rests_of_feet(recording)))


def _told(recording: Recording, above_m: Sequence[float]) -> list[Message]:
    """Tell of rests at these heights above the floor, m, unless they are few."""
    if len(above_m) < LEAST_TOLD:
        return []
    return [Message("landings.rests_elsewhere", _values(recording, above_m))]


def _values(recording: Recording, above_m: Sequence[float]) -> dict[str, Any]:
    """Return what messages tell of rests at these heights above the floor, m."""
    return {
        "recording": recording.name,
        "rests": counted(len(above_m), "rest"),
        "low_m": min(above_m),
        "high_m": max(above_m),
    }


def _rests_of_feet(recording: Recording) -> list[list[_Rest]]:
    """Return the rests of each foot."""
    at_rest = rest_points(recording)
    frames = np.searchsorted(recording.time, at_rest.time)
    n_feet = recording.feet.shape[1]
    return [
        _rests(recording, foot, frames[at_rest.foot == foot]) for foot in range(n_feet)
    ]


def _elsewhere(recording: Recording, of_feet: Sequence[Sequence[_Rest]]) -> list[float]:
    """Return how high above the floor the rests are that are not on it, m."""
    level_m = LEVEL_M * recording.scale
    return [
        rest.height_m
        for rests in of_feet
        for rest in rests
        if abs(rest.height_m) > level_m
    ]


def _n_levels(heights: Sequence[float], apart_m: float) -> int:
    """Return at how many heights these are that differ by more than `apart_m`."""
    n_levels = 0
    last_m = -np.inf
    for height_m in sorted(heights):
        if height_m - last_m > apart_m:
            n_levels += 1
            last_m = height_m
    return n_levels


def _rests(recording: Recording, foot: int, frames: IntArray) -> list[_Rest]:
    """Return the rests of a foot on the floor, and those to which it fell.

    It may also have stood where the recording begins. In the frames given it is slow.
    """
    if not len(frames):
        return []
    scale = recording.scale
    time_scale = recording.time_scale
    height = recording.feet[:, foot, 2]
    pauses = np.diff(recording.time[frames]) > PAUSE_S * time_scale
    steps = np.abs(np.diff(height[frames])) > REST_BAND_M * scale
    rests = []
    for own in np.split(frames, np.flatnonzero(pauses | steps) + 1):
        lasts_s = recording.time[own[-1]] - recording.time[own[0]]
        places = recording.feet[own, foot, :2]
        moves_m = np.linalg.norm(places[0] - places[-1])
        if lasts_s < LEAST_REST_S * time_scale:
            continue
        # In the air it swings on; on a treadmill there are no treads.
        if moves_m > LEVEL_M * scale:
            continue
        rest = _Rest(int(own[0]), int(own[-1]), float(np.median(height[own])))
        stood = recording.time[rest.begin] - recording.time[0] < PAUSE_S * time_scale
        is_on_floor = abs(rest.height_m) <= LEVEL_M * scale
        if stood or is_on_floor or _fell_to(recording, height, rest):
            rests.append(rest)
    return _without_shudders(height, rests, REST_BAND_M * scale)


def _without_shudders(
    height: FloatArray, rests: Sequence[_Rest], band_m: float
) -> list[_Rest]:
    """Join rests of a foot (N,) between which it stays within a band, m."""
    joined: list[_Rest] = []
    for rest in rests:
        if joined:
            last = joined[-1]
            between_m = np.abs(height[last.end : rest.begin] - last.height_m)
            if np.nanmax(between_m) <= band_m:
                joined[-1] = replace(last, end=rest.end)
                continue
        joined.append(rest)
    return joined


def _fell_to(recording: Recording, height: FloatArray, rest: _Rest) -> bool:
    """Tell whether a foot (N,) fell until it was nearly at its rest."""
    lasts = round(ARRIVES_S * recording.time_scale * recording.rate_hz)
    near_m = ARRIVES_M * recording.scale
    above_m = height[: rest.begin] - rest.height_m
    away = np.flatnonzero(np.abs(above_m) > near_m)
    if not len(away) or above_m[away[-1]] < 0:
        return False
    # Not where it is not seen.
    fell_m = above_m[max(away[-1] - lasts, 0)] - above_m[away[-1]]
    return bool(fell_m > near_m)


def _on_one_floor(
    recording: Recording, of_feet: Sequence[Sequence[_Rest]]
) -> Recording:
    """Take the treads off the feet, and their mean off all other markers."""
    positions = recording.positions.copy()
    markers = recording.indices("foot")
    under_body_m = []
    for foot, (marker, rests) in enumerate(zip(markers, of_feet, strict=True)):
        if not rests:
            continue
        ends = [frame for rest in rests for frame in (rest.begin, rest.end)]
        heights_m = np.repeat([rest.height_m for rest in rests], 2)
        frames = np.arange(len(recording.time))
        under_body_m.append(np.interp(frames, ends, heights_m))
        positions[:, marker, 2] -= _treads(recording.feet[:, foot, 2], rests)
    others = np.setdiff1d(np.arange(len(recording.markers)), markers)
    positions[:, others, 2] -= np.mean(under_body_m, axis=0)[:, None]
    return replace(recording, positions=positions)


def _treads(height: FloatArray, rests: Sequence[_Rest]) -> FloatArray:
    """Return the height (N,) of the tread that a foot comes down to, m.

    A lower one counts from where the foot is highest, or leaves the last one. A higher
    one counts once the foot is above it: until then it is as high as the foot.
    """
    treads_m = np.full(len(height), rests[0].height_m)
    for last, this in pairwise(rests):
        treads_m[last.end :] = this.height_m
        swing_m = height[last.end : this.begin]
        if this.height_m > last.height_m:
            so_far_m = np.fmax.accumulate(swing_m)
            so_far_m = np.clip(so_far_m, last.height_m, this.height_m)
            treads_m[last.end : this.begin] = so_far_m
        else:
            top = max(int(np.nanargmax(swing_m)), 1)
            lowers_m = np.linspace(last.height_m, this.height_m, top)
            treads_m[last.end : last.end + top] = lowers_m
    return treads_m
