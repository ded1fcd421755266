"""Markers of one shoe that are taken for feet: they keep their distances and tilt.

Each of several markers of one shoe comes down at its own time, so that one landing may
count as several. Distances alone do not tell them from feet: those of a hopper keep
theirs as well. Yet feet stand side by side, level, while a shoe rolls and swings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.recording import Recording, sampled
from hopdata.recordings.quality.part_names import SIDE_NAMES, side_of_foot
from hopdata.recordings.quality.rigid import pair_distances

#: Spread of a distance, relative to its length, up to which two markers may be on one
#: shoe. Those of both feet of a runner spread by 0.25 and more.
#: Unit: 1. Origin: measured: up to 0.02 on five shoes of runners and walkers.
LARGEST_SPREAD = 0.03

#: Range of the slope between two markers, as a sine and from the 5 % to the 95 %
#: quantile, that shows a shoe. The feet of the simulated hopper have 0.25.
#: Unit: 1. Origin: measured: 0.9 to 1.3 from heel to toe on five shoes.
LEAST_TILT = 0.5

#: Length of a shoe at most, of an animal of 1 m. Without a body it is not known.
#: Unit: m. Origin: chosen: twice what runners have; feet of the hopper are 0.7 apart.
LONGEST_M = 0.35


def markers_of_one_foot(recording: Recording) -> list[tuple[str, ...]]:
    """Return groups of foot markers, two or more each, that move as one shoe does.

    Parameters
    ----------
    recording : Recording
        z up; markers that are joined to a foot already are left out.
    """
    from scipy.sparse.csgraph import connected_components

    joined = {marker for _, own in recording.joined for marker in own}
    feet = [name for name in recording.names("foot") if name not in joined]
    if len(feet) < 2:
        return []
    tracks = sampled(np.stack([recording[name] for name in feet], axis=1))
    distances = pair_distances(tracks)
    is_rigid = distances.spread <= LARGEST_SPREAD * distances.median
    if recording.indices("body"):
        is_rigid &= distances.median <= LONGEST_M * recording.scale
    # The tip of a toe may keep its distance from the heel alone.
    _, group_of = connected_components(is_rigid)
    groups = []
    for group in dict.fromkeys(group_of):
        own = np.flatnonzero(group_of == group)
        if len(own) > 1 and _tilt(tracks[:, own]) >= LEAST_TILT:
            groups.append(tuple(feet[marker] for marker in own))
    return groups


def _tilt(tracks: FloatArray) -> float:
    """Return the largest range of the slope between two of K markers, a sine."""
    largest = 0.0
    for i in range(tracks.shape[1]):
        for j in range(i):
            apart = tracks[:, i] - tracks[:, j]
            apart = apart[np.isfinite(apart).all(axis=1)]
            slope = apart[:, 2] / np.linalg.norm(apart, axis=1)
            low, high = np.quantile(slope, [0.05, 0.95])
            largest = max(largest, float(high - low))
    return largest


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
