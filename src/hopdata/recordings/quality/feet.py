"""Which of the markers that land together are the feet of a study."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.messages import Message
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.landing_markers import (
    LEAST_FEET,
    LEAST_RESTS,
    rest_together,
)
from hopdata.recordings.quality.part_names import (
    HEEL,
    SIDE_NAMES,
    TOE,
    part_by_name,
    side_of_foot,
    without_number,
)
from hopdata.recordings.quality.rests import lowest, scale_of_all
from hopdata.recordings.quality.shared_names import corrected_sides
from hopdata.recordings.quality.stretches import runs
from hopdata.recordings.quality.vocabulary import LIMBS, NamedParts, named_parts
from hopdata.recordings.wording import chained, listed

#: Markers of feet in a study, at most.
#: Unit: 1. Origin: chosen.
MOST_FEET = 6

#: Range of the lowest heights of one part's markers, for an animal of 1 m, from which
#: on some are not on its sole.
#: Unit: m. Origin: chosen.
UNEVEN_M = 0.01

#: Height above the lowest marker of such a part, for an animal of 1 m, from which on a
#: marker is not on its sole.
#: Unit: m. Origin: chosen.
SOLE_M = 0.025

#: Largest spread of a distance, relative to its length, between markers of one shoe.
#: Unit: 1. Origin: chosen.
BEND = 0.04

#: The same for a heel and other places of its foot by name: a foot bends at its toes,
#: and a hind heel and a fore toe on one side are much further from keeping theirs.
#: Unit: 1. Origin: chosen.
BEND_OF_NAMED = 0.15


# The side of markers that are on one foot, of whichever side.
ONLY = "only"


@dataclass(frozen=True)
class Feet:
    """The feet that were chosen.

    Parameters
    ----------
    markers : list of int
        Their markers, in increasing order.
    rivals : list of list of int
        Groups of markers that land at other times.
    reason : Message, optional
        Why these, if there are enough of them.
    problem : Message, optional
        What to do if there are not.
    """

    markers: list[int]
    rivals: list[list[int]]
    reason: Message | None = None
    problem: Message | None = None


def guess_feet(
    groups: list[list[int]],
    inspection: Inspection,
    rests: BoolArray,
    others: AbstractSet[int] = frozenset(),
) -> Feet:
    """Choose the feet to analyse among groups that land together, and say why.

    Parameters
    ----------
    groups : list of list of int
        Output of `landing_markers.land_together`.
    inspection : Inspection
        The recording.
    rests : (N, M) bool array
        When each marker rests.
    others : set of int
        Markers of other subjects, and those that are another one once more.
    """
    markers = inspection.markers
    names = named_parts(tuple(markers))
    added: set[int] = set()
    if names.settles_feet:
        groups = _with_named_feet(groups, names)
    if names.is_human:
        added = _of_the_other_side(groups, inspection) - others
        groups = [_with_counterparts(group, added, names) for group in groups]
    group = _most_telling(groups, inspection) if groups else []
    rivals = [other for other in groups if not set(other) & set(group)]
    if len(group) < LEAST_FEET and names.settles_feet:
        return _by_name_alone(names, inspection, others)
    if len(group) < LEAST_FEET:
        return Feet(group, rivals, problem=_too_few(group, inspection))

    on_sole, of_one_part = _on_the_sole(group, inspection)
    parts = [
        *_how_they_rest([m for m in on_sole if m not in added], rests),
        _for_both_sides([markers[m] for m in on_sole if m in added]),
        of_one_part,
        _left_out(group, groups, markers),
    ]
    if rivals:
        groups_between = []
        for other in rivals:
            groups_between.append(", ".join(markers[m] for m in other))
        between = {"markers": "; ".join(groups_between)}
        parts.append(Message("recordings.feet_in_between", between))
    reason = chained([part for part in parts if part is not None])
    return Feet(sorted(on_sole), rivals, reason)


def _with_named_feet(groups: list[list[int]], names: NamedParts) -> list[list[int]]:
    """Return the groups with two markers named as feet, those with most of them first.

    Where one marker of each foot lands, and no two together, all groups are kept.
    """
    feet = set(names.feet)
    named = [group for group in groups if feet & set(group)]
    if all(len(group) == 1 for group in named):
        return named
    named = [group for group in named if len(feet & set(group)) >= LEAST_FEET]
    return sorted(named, key=lambda group: (-len(feet & set(group)), group))


def counterparts(m: int, names: NamedParts) -> list[int]:
    """Return the markers on the same place of the other foot, by name."""
    of_other_side = {"l": "r", "r": "l"}.get(names.sides[m])
    if names.role(m) != "foot" or of_other_side is None:
        return []
    place = names.place_on_limb(m)
    return [
        k
        for k in names.feet
        if names.sides[k] == of_other_side and names.place_on_limb(k) == place
    ]


def _of_the_other_side(groups: list[list[int]], inspection: Inspection) -> set[int]:
    """Return markers that no group has, though one has the same place opposite.

    Only where both feet land in a group, and if they come down as low: a gap or noise
    may hide that such a marker rests. So left and right feet are defined alike.
    """
    names = named_parts(tuple(inspection.markers))
    landing = {m for group in groups for m in group}
    low_m = lowest(inspection.positions[:, :, 2])
    reach_m = SOLE_M * scale_of_all(inspection.positions)
    found = set()
    for group in groups:
        if not {"l", "r"} <= {names.sides[m] for m in group}:
            continue
        for m in group:
            for k in counterparts(m, names):
                if k not in landing and low_m[k] < low_m[m] + reach_m:
                    found.add(k)
    return found


def _with_counterparts(
    group: list[int], added: AbstractSet[int], names: NamedParts
) -> list[int]:
    """Return a group with those of the added markers that are opposite to its own."""
    opposite = {k for m in group for k in counterparts(m, names)}
    return sorted({*group, *(opposite & added)})


def _for_both_sides(added: list[str]) -> Message | None:
    """Report markers that are feet because their counterparts are."""
    if not added:
        return None
    return Message("recordings.feet_for_both_sides", {"markers": ", ".join(added)})


def _by_name_alone(
    names: NamedParts, inspection: Inspection, others: AbstractSet[int]
) -> Feet:
    """Return the feet by their names, which leave no doubt, though too few land."""
    seen = np.isfinite(lowest(inspection.positions[:, :, 2]))
    named = [m for m in names.feet if seen[m] and m not in others]
    if not named:
        return Feet([], [], problem=_too_few([], inspection))
    group = _most_telling([named], inspection)
    if len(group) < LEAST_FEET:
        return Feet(group, [], problem=_too_few(group, inspection))
    left = [inspection.markers[m] for m in named if m not in group]
    reason = Message("recordings.feet_by_name")
    if left:
        left_out = Message("recordings.feet_left_out", {"markers": ", ".join(left)})
        reason = chained([reason, left_out]) or reason
    return Feet(sorted(group), [], reason)


def _most_telling(groups: list[list[int]], inspection: Inspection) -> list[int]:
    """Choose at most six markers, the same ones on both sides.

    Heels come first, then toes, then low markers. Of each rigid part only the lowest
    heel counts, since the heels of one shoe land together. Markers not named as feet
    are used only if fewer than two are, and ankles only if there is nothing else.
    """
    markers = inspection.markers
    largest = groups[0]
    if len(largest) == 1:  # one marker per foot, and no two land together
        largest = [m for group in groups for m in group]
    group = _likeliest_by_name(largest, markers)
    low_m = lowest(inspection.positions[:, :, 2])
    names = named_parts(tuple(markers))
    place = {m: names.place_on_limb(m) for m in group}

    def rank(m: int) -> tuple[bool, int, float]:
        is_stranger = names.role(m) != "foot"
        rank_of_place, _ = place[m]
        return is_stranger, rank_of_place, float(low_m[m])

    chosen: list[int] = []
    for m in sorted(group, key=rank):
        both_sides = [k for k in group if place[k][1] == place[m][1]]
        few_enough = len({*chosen, *both_sides}) <= MOST_FEET
        if few_enough and not _heel_again(m, chosen, inspection):
            chosen += [k for k in both_sides if k not in chosen]
    return sorted(chosen)


def _likeliest_by_name(group: list[int], markers: tuple[str, ...]) -> list[int]:
    """Return the markers named as feet, or all but the ankles, or all: two or more."""
    names = named_parts(tuple(markers))
    named = [m for m in group if names.role(m) == "foot"]
    if len(named) >= LEAST_FEET:
        return named
    without_ankles = [m for m in group if names.role(m) in ("foot", "")]
    if len(without_ankles) >= LEAST_FEET:
        return without_ankles
    return group


def _heel_again(m: int, chosen: list[int], inspection: Inspection) -> bool:
    """Tell whether a marker is on a heel already chosen, on the same rigid part."""
    names = named_parts(tuple(inspection.markers))
    if names.place(m)[0] != HEEL:
        return False
    for k in chosen:
        if names.place(k)[0] != HEEL or names.limb(k) != names.limb(m):
            continue
        if any({m, k} <= set(part.markers) for part in inspection.clusters):
            return True
    return False


def _on_the_sole(
    group: list[int], inspection: Inspection
) -> tuple[list[int], Message | None]:
    """Keep only the low markers of feet on one rigid part such as a shoe; say so."""
    markers = inspection.markers
    scale = scale_of_all(inspection.positions)
    low_m = lowest(inspection.positions[:, group, 2])
    names = named_parts(tuple(markers))
    two_sides = len({names.place(m) for m in group}) < len(group)
    is_one_part = any(set(group) <= set(part.markers) for part in inspection.clusters)
    if two_sides or not is_one_part or np.ptp(low_m) < UNEVEN_M * scale:
        return group, None

    limit_m = low_m.min() + SOLE_M * scale
    kept = [m for m, height_m in zip(group, low_m, strict=True) if height_m < limit_m]
    if len(kept) < LEAST_FEET:
        kept = group
    apart_m = float(np.ptp(lowest(inspection.positions[:, kept, 2])))
    values = {"apart_mm": 1e3 * apart_m}
    left = [markers[m] for m in group if m not in kept]
    if not left:
        return kept, Message("recordings.feet_on_one_part", values)
    return kept, Message(
        "recordings.feet_on_one_part_left_out",
        {**values, "markers": ", ".join(left)},
    )


def _how_they_rest(group: list[int], rests: BoolArray) -> list[Message]:
    """Report how often feet rest, and whether at the same time."""
    counts = [len(runs(rests[:, m])) for m in group]
    fewest = min(counts)
    most = max(counts)
    often = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    values = {"often": often, "percent": 100 * float(rests[:, group].mean())}
    code = "recordings.feet_rest_once" if most == 1 else "recordings.feet_rest"
    reasons = [Message(code, values)]
    for m in group:
        others = [k for k in group if k != m]
        if not any(rest_together(rests[:, m], rests[:, k]) for k in others):
            reasons.append(Message("recordings.feet_apart"))
            break
    return reasons


def _left_out(
    group: list[int], groups: list[list[int]], markers: tuple[str, ...]
) -> Message | None:
    """Report which markers land with the feet but are left out, being too many."""
    left = []
    for other in groups:
        if set(other) & set(group):
            left += [markers[m] for m in other if m not in group]
    if not left:
        return None
    message = Message("recordings.feet_left_out", {"markers": ", ".join(left)})
    if len(group) + 1 >= MOST_FEET:
        values = {"most": MOST_FEET, "left_out": message}
        message = Message("recordings.feet_too_many", values)
    names = named_parts(tuple(markers))
    heels = {markers[m] for m in range(len(markers)) if names.place(m)[0] == HEEL}
    if heels & {*left}:
        message = Message("recordings.feet_one_heel", {"left_out": message})
    return message


def _too_few(group: list[int], inspection: Inspection) -> Message:
    """Report that no feet were found, and likely candidates: by name, or the lowest."""
    markers = inspection.markers
    low_m = lowest(inspection.positions[:, :, 2])
    rising = np.argsort(low_m, kind="stable")
    by_height = [markers[m] for m in rising if np.isfinite(low_m[m])]
    feet = {markers[m] for m in named_parts(tuple(markers)).feet}
    named = [name for name in by_height if name in feet]
    if named:
        likely = Message("recordings.likely_by_name", {"markers": ", ".join(named)})
    else:
        nearest = ", ".join(by_height[:MOST_FEET]) or "none"
        likely = Message("recordings.likely_by_height", {"markers": nearest})
    if not group:
        return Message("recordings.no_feet", {"likely": likely})
    return Message(
        "recordings.one_foot", {"marker": markers[group[0]], "likely": likely}
    )


def doubt_about_feet(
    feet: Feet, taken: set[int], inspection: Inspection, least_rests: int
) -> Message | None:
    """Return what else the feet might be, if that is not clear.

    Parameters
    ----------
    feet : Feet
        The feet that were chosen.
    taken : set of int
        Markers that land, at whatever time, or have another role.
    inspection : Inspection
        The recording.
    least_rests : int
        Number of rests of the foot that rests least often.
    """
    markers = inspection.markers
    if not feet.markers:
        return None
    names = named_parts(tuple(markers))
    if names.settles_feet and set(feet.markers) <= set(names.feet):
        return None
    if least_rests < LEAST_RESTS:
        doubt = Message("recordings.doubt_few_rests")
    else:
        likely = _others_named_so(feet.markers, markers) or _higher_ones_named_alike(
            feet.markers, taken, inspection
        )
        if likely is None:
            return None
        doubt = likely
    rivals = []
    for group in feet.rivals:
        of_group = [markers[m] for m in group]
        rivals.append(listed(of_group))
    return chained([doubt, *rivals], "recordings.or")


def _others_named_so(feet: list[int], markers: tuple[str, ...]) -> Message | None:
    """Report all markers named as feet if some of the feet are not."""
    named = [markers[m] for m in named_parts(tuple(markers)).feet]
    strangers = [m for m in feet if markers[m] not in named]
    if not named or not strangers:
        return None
    return Message("recordings.doubt_named", {"markers": ", ".join(named)})


def _higher_ones_named_alike(
    feet: list[int], taken: set[int], inspection: Inspection
) -> Message | None:
    """Report markers named like the feet but for a number that stay higher."""
    stems = [without_number(name) for name in inspection.markers]
    stems_of_feet = {stems[m] for m in feet if part_by_name(stems[m]) == "foot"}
    heights = inspection.positions[:, :, 2]
    above_m = lowest(heights) - lowest(heights[:, feet]).min()
    higher = []
    for m, name in enumerate(inspection.markers):
        is_alike = stems[m] in stems_of_feet and m not in taken
        if is_alike and np.isfinite(above_m[m]):
            values = {"marker": name, "above_mm": 1e3 * float(above_m[m])}
            higher.append(Message("recordings.doubt_higher", values))
    return chained(higher, "recordings.and")


def joined_feet(
    group: Sequence[int], inspection: Inspection, *, least_feet: int = LEAST_FEET
) -> dict[str, list[str]]:
    """Return feet with several markers: of one side by name, at constant distances.

    A heel and the other places of a foot, by name, need not keep their distances as
    well as others: a foot bends. So one marker set gives the same feet in each trial.

    Empty if each is a foot by itself, or if there are fewer than `least_feet`: the
    markers of a single foot are the feet of a study. Distances alone do not decide,
    since feet that jump together keep theirs; nor do sides alone, since L1, L2 and L3
    are legs.
    """
    names = [inspection.markers[m] for m in group]
    sides = _sides(group, inspection)
    named = _sides_of_one_named_foot(group, sides, inspection)
    largest = np.array([BEND_OF_NAMED if side in named else BEND for side in sides])
    feet = _by_foot(sides, inspection.pairs.relative_spread(group), largest)
    if not least_feet <= len(feet) < len(group):
        return {}

    sides_differ = len({sides[foot[0]] for foot in feet}) == len(feet)
    of_foot = {}
    for foot in feet:
        first = foot[0]
        is_named = sides_differ and sides[first] in (*SIDE_NAMES, *LIMBS)
        label = sides[first] if is_named else f"of {names[first]}"
        of_foot[label] = [names[i] for i in foot]
    joined = {}
    for label, markers in sorted(of_foot.items()):
        if len(markers) > 1:
            joined[_name_of_foot(label)] = markers
    return joined


def _name_of_foot(label: str) -> str:
    """Return ``left``, ``right``, a limb's letters, or ``foot of`` a marker."""
    if label in LIMBS:
        return label.upper()
    return SIDE_NAMES.get(label, f"foot {label}")


def of_one_side(feet: Sequence[str], markers: Sequence[str]) -> dict[str, list[str]]:
    """Return markers of feet that are a heel or toe and others of one side, by name.

    They may be on one foot. Empty unless there are two such sides or more.
    """
    parts = named_parts(tuple(markers))
    by_side: dict[str, list[str]] = {}
    places: dict[str, set[int]] = {}
    for name in feet:
        m = list(markers).index(name)
        side = parts.sides[m] or side_of_foot(name)
        if side not in SIDE_NAMES or parts.role(m) != "foot":
            continue
        by_side.setdefault(SIDE_NAMES[side], []).append(name)
        places.setdefault(SIDE_NAMES[side], set()).add(parts.place(m)[0])
    several = {
        side: own
        for side, own in by_side.items()
        if len(own) > 1 and places[side] & {HEEL, TOE}
    }
    return several if len(several) > 1 else {}


def _sides(group: Sequence[int], inspection: Inspection) -> list[str]:
    """Return the side of each marker; empty if it is not known, nor that all are one.

    On an animal, names of limbs are sides that say more. A heel and other places of a
    foot, each of them once and on no side, are one foot.
    """
    markers = inspection.markers
    parts = named_parts(tuple(markers))
    of_all = corrected_sides(parts.sides, parts, inspection)
    sides = []
    for m in group:
        if parts.role(m) in ("foot", "ankle"):
            side = parts.limb(m) or of_all[m] or side_of_foot(markers[m])
            sides.append(side)
        else:
            sides.append("")
    places = [parts.place(m) for m in group]
    of_heels = [place for place in places if place[0] == HEEL]
    is_each_once = len(of_heels) == 1 and len(set(places)) == len(places)
    are_on_a_foot = all(parts.role(m) == "foot" for m in group)
    if is_each_once and are_on_a_foot and not any(sides):
        return [ONLY] * len(group)
    return sides


def _sides_of_one_named_foot(
    group: Sequence[int], sides: list[str], inspection: Inspection
) -> set[str]:
    """Return sides whose markers are one heel and other places of a foot, by name.

    Of two heels on one side, as of a hind and a fore leg, distances decide.
    """
    parts = named_parts(tuple(inspection.markers))
    named = set()
    for side in {*sides} - {""}:
        own = [m for m, of in zip(group, sides, strict=True) if of == side]
        ranks = [parts.place(m)[0] for m in own]
        are_on_a_foot = all(parts.role(m) == "foot" for m in own)
        if are_on_a_foot and ranks.count(HEEL) == 1:
            named.add(side)
    return named


def _by_foot(
    sides: list[str], bend: FloatArray, largest: FloatArray
) -> list[list[int]]:
    """Group markers of one side that keep their distances.

    Parameters
    ----------
    sides : list of str
        The side of each of K markers, or an empty string.
    bend : (K, K) array
        Spread of each distance, relative to its length.
    largest : (K,) array
        Largest spread for each marker, the same for all of a side.
    """
    feet: list[list[int]] = []
    for i, side in enumerate(sides):
        joined = []
        apart = []
        for foot in feet:
            same_side = side and side == sides[foot[0]]
            if same_side and bend[i, foot].min() <= largest[i]:
                joined += foot
            else:
                apart.append(foot)
        feet = [*apart, [*joined, i]]
    return feet
