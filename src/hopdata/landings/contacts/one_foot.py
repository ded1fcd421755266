"""Markers of one shoe that are taken for feet: they keep their distances and tilt.

Each of several markers of one shoe comes down at its own time, so that one landing may
count as several. Distances alone do not tell them from feet: those of a hopper keep
theirs as well. Yet its feet stand side by side, level, while a shoe rolls and swings;
and if it falls over, its feet turn with its body, as a shoe does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.quality.part_names import SIDE_NAMES, side_of_foot
from hopdata.recordings.quality.rigid import pair_distances
from hopdata.scale import sampled

#: Spread of a distance, relative to its length, up to which two markers may be on one
#: shoe. One on either shoe spreads by 0.11 or more, walking or running (15 recordings).
#: Unit: 1. Origin: measured: of 176 pairs on 30 shoes half spread by less than 0.008,
#: nine in ten by less than 0.04, and all by less than 0.1, as a toe bends.
LARGEST_SPREAD = 0.03

#: Range of the slope between two markers, as a sine and from the 5 % to the 95 %
#: quantile, that shows a shoe. Feet of simulated hoppers have 0.26 at most, unless they
#: fall over.
#: Unit: 1. Origin: measured: the largest on each of 30 shoes is 0.6 to 1.5.
LEAST_TILT = 0.5

#: Range of the cosine between two of these markers and two of the body, between the
#: same quantiles, that shows a shoe. Feet of simulated hoppers have 0.02, if they fall
#: or not.
#: Unit: 1. Origin: measured: 0.27 to 1.95 on 27 shoes, and 0.06 on another.
LEAST_TURN = 0.15


def markers_of_one_foot(recording: Recording) -> list[tuple[str, ...]]:
    """Return groups of foot markers, two or more each, that move as one shoe does.

    Parameters
    ----------
    recording : Recording
        z up; markers that are joined to a foot already are left out. Without a body,
        stiff legs that fall over are not told from a shoe.
    """
    from scipy.sparse.csgraph import connected_components

    joined = {marker for _, own in recording.joined for marker in own}
    feet = [name for name in recording.names("foot") if name not in joined]
    if len(feet) < 2:
        return []
    tracks = sampled(np.stack([recording[name] for name in feet], axis=1))
    distances = pair_distances(tracks)
    is_rigid = distances.spread <= LARGEST_SPREAD * distances.median
    body = sampled(recording.body)
    # The tip of a toe may keep its distance from the heel alone.
    _, group_of = connected_components(is_rigid)
    groups = []
    for group in dict.fromkeys(group_of):
        own = np.flatnonzero(group_of == group)
        if len(own) < 2 or _tilt(tracks[:, own]) < LEAST_TILT:
            continue
        if body.shape[1] > 1 and _turn(tracks[:, own], body) < LEAST_TURN:
            continue
        groups.append(tuple(feet[marker] for marker in own))
    return groups


def _tilt(tracks: FloatArray) -> float:
    """Return the largest range of the slope between two of K markers, a sine."""
    return max(_range(direction[:, 2]) for direction in _directions(tracks))


def _turn(tracks: FloatArray, body: FloatArray) -> float:
    """Return the largest range of the cosine between two of K markers and of B."""
    of_body = list(_directions(body))
    return max(
        _range((direction * other).sum(axis=1))
        for direction in _directions(tracks)
        for other in of_body
    )


def _directions(tracks: FloatArray) -> Iterator[FloatArray]:
    """Yield the unit vectors (N, 3) between any two of K markers (N, K, 3).

    They are NaN where two markers are in one place, or one is not seen.
    """
    for one, other in combinations(range(tracks.shape[1]), 2):
        apart = tracks[:, one] - tracks[:, other]
        distance = np.linalg.norm(apart, axis=1, keepdims=True)
        distance[distance == 0] = np.nan
        yield apart / distance


def _range(values: FloatArray) -> float:
    """Return the range of the known values without their tails; 0 if none is known."""
    known = values[np.isfinite(values)]
    if not len(known):  # two markers that are never seen together
        return 0.0
    low, high = np.quantile(known, [0.05, 0.95])
    return float(high - low)


def one_foot_remarks(recording: Recording) -> list[Message]:
    """Say of which foot markers are on one shoe, and how to name them."""
    remarks = []
    for markers in markers_of_one_foot(recording):
        name = _name_of(markers)
        values = {
            "recording": recording.name,
            "markers": f"{', '.join(markers[:-1])} and {markers[-1]}",
            "argument": f"feet={{'{name}': [{', '.join(map(repr, markers))}]}}",
            "option": f"--feet '{name}={','.join(markers)}'",
        }
        remarks.append(Message("landings.markers_of_one_foot", values))
    return remarks


def _name_of(markers: Sequence[str]) -> str:
    """Return ``left`` or ``right`` if the names of all markers tell it, or ``foot``."""
    sides = {side_of_foot(marker) for marker in markers}
    return SIDE_NAMES.get(sides.pop(), "foot") if len(sides) == 1 else "foot"
