"""All feet of a recording, whenever they land, where a study would choose a few.

A study compares feet that land together; contacts are of interest for each foot: both
feet of a runner, and those of a walk.
"""

from __future__ import annotations

from hopdata.recordings.quality.feet import joined_feet
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.part_names import (
    HEEL,
    TOE,
    part_by_name,
    place_by_name,
    side_of_foot,
    subject_prefixes,
)
from hopdata.recordings.quality.rests import lowest
from hopdata.recordings.quality.roles import Roles

Joined = dict[str, list[str]]


def every_foot(inspection: Inspection, roles: Roles) -> tuple[list[str], Joined]:
    """Return the markers of all feet, and which of them belong to one foot.

    Parameters
    ----------
    inspection : Inspection
        The recording.
    roles : Roles
        What a study would choose (`roles.guess_roles`).

    Returns
    -------
    feet : list of str
        The markers, in the order of the file. Feet that land at other times than those
        of the study are added, by the same markers. If no marker is seen to land again
        and again, those that are named as heels and toes are taken; none without any.
    joined : dict
        Feet with several of these markers, and their names.
    """
    markers = inspection.markers
    chosen = set(roles.feet)
    if chosen:
        for group in roles.other_feet:
            chosen |= _alike(group, roles.feet)
    else:
        chosen = _by_name(inspection)
    feet = [m for m, name in enumerate(markers) if name in chosen]
    return [markers[m] for m in feet], joined_feet(feet, inspection)


def _alike(group: tuple[str, ...], feet: tuple[str, ...]) -> set[str]:
    """Return the markers of a group that are on the same places as those of the feet.

    Markers without a part in their name have no place: all of these are taken if the
    feet have none either.
    """
    if not any(part_by_name(name) for name in feet):
        return {name for name in group if not part_by_name(name)}
    places = {place_by_name(name) for name in feet}
    return {
        name
        for name in group
        if place_by_name(name) in places and part_by_name(name) in ("foot", "ankle")
    }


def _by_name(inspection: Inspection) -> set[str]:
    """Return the heels and toes of the first subject, by name, that are seen.

    Where a side has several of one kind, the lowest counts.
    """
    markers = inspection.markers
    low_m = lowest(inspection.positions[:, :, 2])
    others = tuple(subject_prefixes(markers)[1:])
    lowest_of: dict[tuple[str, int], str] = {}
    for m in low_m.argsort(kind="stable"):
        name = markers[m]
        if part_by_name(name) != "foot" or not low_m[m] < float("inf"):
            continue
        if others and name.startswith(others):
            continue
        rank, _ = place_by_name(name)
        if rank in (HEEL, TOE):
            lowest_of.setdefault((side_of_foot(name), rank), name)
    return set(lowest_of.values())
