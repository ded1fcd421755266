"""Markers that share a name: which are one marker, and on which foot they are.

Readers number them (`LHEE 1`, `LHEE 2`). One may be the other once more, or be a marker
of the other foot with the wrong side in its name, so places tell more than names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.rests import scale_of_all
from hopdata.recordings.quality.vocabulary import NamedParts

#: Usual distance of two markers with one name up to which they are one marker, for an
#: animal of 1 m.
#: Unit: m. Origin: chosen. Markers have some 10 mm across.
ONE_PLACE_M = 0.01

# Parts of a leg by which the side of a foot's marker is told.
OF_LOWER_LEG = ("foot", "heel", "toe", "ankle", "shank")


def sharing(markers: Sequence[str]) -> list[list[int]]:
    """Return the markers that share a name but for its number, name by name."""
    of_name: dict[str, list[int]] = {}
    for m, name in enumerate(markers):
        stem = re.sub(r"\s+\d+$", "", name)
        if stem != name:
            of_name.setdefault(stem, []).append(m)
    return [own for own in of_name.values() if len(own) > 1]


def repeated(inspection: Inspection) -> set[int]:
    """Return the markers that are one with an earlier marker of the same name."""
    shared = sharing(inspection.markers)
    if not shared:
        return set()
    near_m = ONE_PLACE_M * scale_of_all(inspection.positions)
    found = set()
    for own in shared:
        for k, m in enumerate(own):
            earlier = [one for one in own[:k] if one not in found]
            if (inspection.pairs.median[m, earlier] < near_m).any():
                found.add(m)
    return found


def corrected_sides(
    sides: Sequence[str], names: NamedParts, inspection: Inspection
) -> list[str]:
    """Return the sides of all M markers, corrected where both feet share a name.

    Of markers with one name that are not all nearest to the lower leg of one side, each
    is on the side to which it is nearest.
    """
    corrected = list(sides)
    shared = sharing(inspection.markers)
    in_doubt = {m for own in shared for m in own}
    legs: dict[str, list[int]] = {"l": [], "r": []}
    for m, (part, side) in enumerate(zip(names.parts, sides, strict=True)):
        if part in OF_LOWER_LEG and side in legs and m not in in_doubt:
            legs[side].append(m)
    if not all(legs.values()):
        return corrected
    for own in shared:
        on_feet = [m for m in own if names.role(m) in ("foot", "ankle")]
        nearest = {m: _nearest_side(m, legs, inspection) for m in on_feet}
        if set(nearest.values()) == {"l", "r"}:
            for m, side in nearest.items():
                corrected[m] = side
    return corrected


def _nearest_side(m: int, legs: dict[str, list[int]], inspection: Inspection) -> str:
    """Return the side whose markers are nearer to a marker, usually and on average.

    Empty if no distance is known.
    """
    apart_m = {}
    for side, others in legs.items():
        distances = inspection.pairs.median[m, others]
        known = distances[np.isfinite(distances)]
        if not len(known):
            return ""
        apart_m[side] = float(known.mean())
    return min(apart_m, key=lambda side: apart_m[side])
