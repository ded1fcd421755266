"""A foot with several markers: as low as the lowest, down as soon as one is down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.landings import schedules
from hopdata.landings.contacts.descents import ALREADY_DOWN, LANDED, NOT_LANDED
from hopdata.landings.contacts.judged import NO_MARKER
from hopdata.recording import Recording


@dataclass(frozen=True)
class _Marker:
    """A marker of the new recording, made from one or more of the old one."""

    name: str
    role: str
    numbers: list[int]


def join_feet(recording: Recording, feet: Sequence[Mapping[str, Any]]) -> Recording:
    """Replace groups of markers by the feet that they belong to.

    Parameters
    ----------
    recording : Recording
        Levelled, so that each marker rests at height 0.
    feet : sequence of mapping
        ``name`` and ``markers`` of each foot; the markers are foot markers of the
        recording. A foot marker that is not listed is a foot of its own.

    Returns
    -------
    Recording
        With each foot listed in place of its first marker. The foot is where its lowest
        marker is, NaN where one of them is not seen. Its markers follow it, by name,
        with the role ``part``.
    """
    if not feet:
        return recording
    new = _markers_with_feet(recording, feet)
    frames = np.arange(len(recording.time))
    tracks = []
    for marker in new:
        heights = recording.positions[:, marker.numbers, 2]
        lowest = np.asarray(marker.numbers)[np.argmin(heights, axis=1)]
        tracks.append(recording.positions[frames, lowest])
    filled = None
    if recording.filled is not None:
        filled = recording.filled[:, [marker.numbers[0] for marker in new]]
    return replace(
        recording,
        positions=np.stack(tracks, axis=1),
        markers=tuple(marker.name for marker in new),
        roles=tuple(marker.role for marker in new),
        filled=filled,
        joined=(),
    )


def _markers_with_feet(
    recording: Recording, feet: Sequence[Mapping[str, Any]]
) -> list[_Marker]:
    """List the markers in order, with each foot in place of its first marker."""
    foot_of = {marker: foot for foot in feet for marker in foot["markers"]}
    place_of = recording.markers.index
    new: list[_Marker] = []
    roles = zip(recording.markers, recording.roles, strict=True)
    for number, (marker, role) in enumerate(roles):
        foot = foot_of.get(marker)
        if foot is None:
            new.append(_Marker(marker, role, [number]))
            continue
        if marker != min(foot["markers"], key=place_of):
            continue
        # By name: on few landings the last digits can decide what they learn from one
        # another, and sums round by their order, which must not be that of a list.
        parts = [place_of(one) for one in sorted(foot["markers"])]
        new.append(_Marker(str(foot["name"]), "foot", parts))
        for part in parts:
            new.append(_Marker(recording.markers[part], "part", [part]))
    return new


def parts_of_feet(recording: Recording) -> list[list[int]]:
    """Return the markers of each foot: the foot itself, or the parts that follow it."""
    parts: list[list[int]] = []
    for number, role in enumerate(recording.roles):
        if role == "foot":
            parts.append([number])
        elif role == "part":
            # The first part takes the place of the foot that it belongs to.
            own = [one for one in parts[-1] if recording.roles[one] == "part"]
            parts[-1] = [*own, number]
    return parts


def tracks_of_feet(recording: Recording) -> FloatArray:
    """Return the positions of the markers of all feet (N, p, 3), m, foot by foot."""
    parts = parts_of_feet(recording)
    markers = [marker for own in parts for marker in own]
    if len(markers) > len(parts):
        return np.asarray(recording.positions[:, markers])
    return recording.feet


def first_of(
    instant: FloatArray, se: FloatArray, status: IntArray, earliest: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the contacts (L,) of a foot: the first landing among its p markers (L, p).

    If a marker was already down, so was the foot. If a marker may have landed unseen,
    or fits badly, the foot's contact stays open, unless that marker was too high (until
    `earliest`, s). Instant and standard error, s, are the mean and deviation of the
    earliest of independent normals, taken two at a time from the earliest on (Clark
    1961): of three or more this is approximate, and depends on which are taken first.
    """
    landed = status == LANDED
    unlanded_last = np.where(landed, instant, np.inf)
    order = np.lexsort((np.where(landed, se, np.inf), unlanded_last), axis=1)
    instant, se, status, earliest, landed = (
        np.take_along_axis(values, order, axis=1)
        for values in (instant, se, status, earliest, landed)
    )
    first = np.where(landed, instant, np.inf).min(axis=1, keepdims=True)
    is_decided = np.isin(status, (LANDED, NOT_LANDED, ALREADY_DOWN))
    was_too_high = earliest > first
    is_open = ~(is_decided | was_too_high)
    worst = np.where(is_open, status, -1).max(axis=1)
    was_down = (status == ALREADY_DOWN).any(axis=1)
    found = np.where(landed.any(axis=1), LANDED, NOT_LANDED)
    found = np.where(worst >= 0, worst, found)
    found = np.where(was_down, ALREADY_DOWN, found)
    mean = np.full(len(status), np.nan)
    sd = np.full(len(status), np.nan)
    for part in range(status.shape[1]):
        other = np.where(landed[:, part], instant[:, part], np.nan)
        other_sd = np.where(landed[:, part], se[:, part], np.nan)
        earlier, earlier_sd = _earlier(mean, sd, other, other_sd)
        only_one = np.isnan(mean) | np.isnan(other)
        mean = np.where(only_one, np.fmax(mean, other), earlier)
        sd = np.where(only_one, np.fmax(sd, other_sd), earlier_sd)
    known = found == LANDED
    return np.where(known, mean, np.nan), np.where(known, sd, np.nan), found


def first_marker(
    instant: FloatArray,
    se: FloatArray,
    status: IntArray,
    earliest: FloatArray,
    common: FloatArray,
) -> tuple[IntArray, FloatArray]:
    """Return which of p markers touches first (L,), and how probable that is (L,).

    It is the one whose contact is earliest, `NO_MARKER` if none landed. The errors
    `common` (p,), s, may differ between the markers of a foot, so that they count as
    independent. A marker that does not land is not first. One that may have landed
    unseen can have touched once it was low enough: at `earliest`, which is known no
    better than the first contact. The probability is NaN without another marker.
    """
    landed = status == LANDED
    touches = np.where(landed, instant, np.inf)
    first = np.where(landed.any(axis=1), touches.argmin(axis=1), NO_MARKER)
    is_known = first != NO_MARKER
    probability = np.full(len(first), np.nan)
    if status.shape[1] == 1:
        return first, probability
    may_touch = ~np.isin(status, (LANDED, NOT_LANDED))
    touches = np.where(may_touch, earliest, touches)
    of_first = np.take_along_axis(se, first[:, None], axis=1)
    errors = np.hypot(np.where(landed, se, of_first), common)
    probability[is_known] = schedules.first_probability(
        touches[is_known], errors[is_known]
    )
    return first, probability


def _earlier(
    a: FloatArray, sd_a: FloatArray, b: FloatArray, sd_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and deviation of the smaller of two independent normals."""
    from scipy.special import ndtr

    width = np.hypot(sd_a, sd_b)
    x = (b - a) / width
    a_is_first = ndtr(x)
    density = width * np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
    mean = a * a_is_first + b * (1 - a_is_first) - density
    # Moments about the mean avoid cancellation.
    away_a = a - mean
    away_b = b - mean
    square = (away_a**2 + sd_a**2) * a_is_first
    square += (away_b**2 + sd_b**2) * (1 - a_is_first)
    variance = square - (away_a + away_b) * density
    return mean, np.sqrt(np.maximum(variance, 0.0))
