"""Guess which markers are on the body, feet and boom, from their motion and names."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import mismatch
from hopdata.recordings.quality import stretches
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.rigid import PairDistances
from hopdata.recordings.quality.stretches import BAND_M, at_rest, lowest, runs, scale_of_all

# What a marker's name reveals about its body part.

_WORDS = {
    "foot": """foot feet toe toes heel hee mt mth met fm metatarsal metatarsus hallux paw hoof claw
        calc calcaneus fcc tarsus tip sole digit finger""",
    "ankle": "ankle ank malleolus mal fal tam",
    "boom": "boom counterweight weight tail post frame lab fixed",
    "body": """body pelvis hip hips asis psis asi psi ias ips sacrum sacr trunk torso chassis back
        base iliac crest spine thorax croup withers""",
}
_HEELS = frozenset({"heel", "hee", "calc", "calcaneus", "fcc"})
_TOES = frozenset({"toe", "toes", "hallux"})
_NAMES = {"l": "left", "r": "right"}
_SIDES = (*_NAMES.values(), *_NAMES)
_LIMB = re.compile("l|r|left|right|[lr][fh]|[fhb][lr]|front|hind|fore|rear|back")
PARTS = {part: frozenset(words.split()) for part, words in _WORDS.items()}
_OF_FEET = PARTS["foot"] | PARTS["ankle"]


def part_by_name(name: str) -> str:
    """Return ``"foot"``, ``"ankle"``, ``"boom"``, ``"body"`` or ``""`` for a marker's name.

    Case, digits and separators are ignored: ``R_mt1``, ``L.Heel.Top`` and ``FOOT3`` are feet.
    """
    words = _words(name, r"[a-z]+")
    plain = {*words, *map(_without_side, words)}
    return next((part for part, known in PARTS.items() if plain & known), "")


def place_by_name(name: str) -> tuple[int, str]:
    """Return the rank of a place on a foot (0 heels, 1 toes, 2 others) and its name.

    The name is shared by both sides: ``L_mt1`` and ``RMT1`` are ``mt1``.
    """
    words = [w for w in _words(name, r"[a-z]+[0-9]*|[0-9]+") if w not in _SIDES]
    plain = [_without_side(w) if w.rstrip("0123456789") not in _OF_FEET else w for w in words]
    letters = {w.rstrip("0123456789") for w in plain}
    return 0 if letters & _HEELS else 1 if letters & _TOES else 2, " ".join(plain)


def _words(name: str, pattern: str) -> list[str]:
    return re.findall(pattern, re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())


def _without_side(word: str) -> str:
    """Drop a leading l or r, as in ``rheel``, or a word for the side."""
    for side in _SIDES:
        if word.startswith(side) and len(word) > len(side) + 1:
            return word.removeprefix(side)
    return word


# Lengths and speeds refer to an animal of 1 m; positions are scaled to that size first.
MOST_FEET, LEAST_FEET, LEAST_BODY = 6, 2, 3
LEAST_RESTS = 3  # rests of a marker that no other evidence assigns to a foot
RESTS_SHARE = (0.03, 0.95)  # least and greatest share of the frames at rest
LIFT_M = 0.05  # m; a marker that rests after being this much higher has landed
SEEN_SHARE = 0.01  # largest share of frames in which the home marker may be unseen
SEEN_SHARES = (SEEN_SHARE, 0.05)  # of a body marker; of one that helps to fill gaps
NEAR_FLOOR = 0.08  # of the highest marker's height: greatest height of a foot marker at rest
TOGETHER = 0.5  # of the shorter rest: feet that rest together for this share land together
STILL_M = 0.003  # m; a marker that moves less is fixed in the world
MOST_FIXED = 0.25  # largest share of fixed markers; beyond it, somebody is standing still
UNEVEN_M = 0.01  # m; if markers of one part rest further apart in height, some are not on its sole
SOLE_M = 0.025  # m above the lowest marker of a part; higher ones are not on its sole
BEND = 0.04  # largest relative spread of distances between named markers that form a body


@dataclass(frozen=True)
class Roles:
    """Guessed roles. Empty where none could be guessed; `problems` says why.

    Parameters
    ----------
    body, feet, boom : tuple of str
        Marker names.
    home : str
        Body marker that defines the axis of the home frame.
    reasons : dict
        Reasons for the choice of ``"body"``, ``"feet"``, ``"boom"`` and ``"home"``.
    other_feet : tuple of tuple of str
        Other groups of feet, which land at other times.
    problems : tuple of str
        Roles that could not be guessed, and what to do about it.
    unsure : dict
        Alternatives for ``"body"`` and ``"feet"`` where the choice is not clear.
    joined : dict
        Feet with several markers in `feet`, such as heel and toe: name and those markers.
    """

    body: tuple[str, ...]
    feet: tuple[str, ...]
    boom: tuple[str, ...]
    home: str
    reasons: dict[str, str]
    other_feet: tuple[tuple[str, ...], ...]
    problems: tuple[str, ...]
    unsure: dict[str, str] = field(default_factory=dict)
    joined: dict[str, list[str]] = field(default_factory=dict)


def guess_roles(inspection: Inspection) -> Roles:
    """Guess the roles of all markers.

    Feet are markers that repeatedly rest near the floor at the same time. Markers named as feet, or
    any if no others are found, need to land there only once. The body is the rigid cluster that
    never rests there. The boom is whatever is named so or stays fixed in the world.
    """
    markers, scale = inspection.markers, scale_of_all(inspection.positions)
    positions = inspection.positions if scale == 1 else inspection.positions / scale
    rests, fixed = at_rest(positions[:, :, 2], inspection.rate_hz * scale**0.5), _fixed(positions)
    subjects = subject_prefixes(markers)
    others = {m for m, name in enumerate(markers) if name.startswith(tuple(subjects[1:]))}
    is_boom = fixed | np.array([part_by_name(name) == "boom" for name in markers])
    boom = tuple(markers[m] for m in np.flatnonzero(is_boom) if m not in others)
    resting = _resting(markers, positions[:, :, 2], rests, fixed)
    groups = _together([m for m in resting if markers[m] not in boom and m not in others], rests)
    reasons, problems = {}, []
    if boom:
        stays = fixed[[markers.index(name) for name in boom]].all()
        reasons["boom"] = "stays fixed in the world" if stays else "by name"
    group = _chosen(groups, inspection) if groups else []
    rivals = [tuple(markers[m] for m in g) for g in groups if not set(g) & set(group)]
    if len(group) >= LEAST_FEET:
        beyond = _beyond_most(group, groups, markers)
        group, on_one = _sole(group, inspection)
        reasons["feet"] = _feet_reason(group, rests) + on_one + beyond
        between = "; ".join(", ".join(other) for other in rivals)
        reasons["feet"] += f"; {between} land in between: a study of their own" * bool(between)
    else:
        problems.append(_no_feet(group, inspection))
    taken = {m for g in groups for m in g} | {markers.index(name) for name in boom} | others
    body, reasons["body"], other_body = _body(inspection, taken)
    if others:
        of, *apart = (name[:-1] for name in subjects)
        reasons["body"] += f"; of {of} alone, a study of its own for {', '.join(apart)}"
    if len(body) < LEAST_BODY:
        wanted = "three markers or more that keep their distances"
        problems.append(mismatch("markers.body", wanted, "none; name them by hand"))
    body = sorted(body)
    home, reasons["home"] = _home(body, inspection) if body else ("", "")
    feet = tuple(markers[m] for m in sorted(group))
    body_names = tuple(markers[m] for m in body)
    unsure = {"body": other_body} if body and other_body else {}
    rested = min((len(runs(rests[:, m])) for m in group), default=0)
    if feet and (doubt := _doubt(feet, markers, rested) or _high(group, taken, inspection)):
        unsure["feet"] = ", or ".join([doubt, *(", ".join(other) for other in rivals)])
    if body and rested < LEAST_RESTS and "body" not in unsure:
        unsure["body"] = "parts that bend, where too little lands to show it"
    spare = [m for m in range(len(markers)) if markers[m] not in {*feet, *body_names, *boom}]
    reasons["unused"] = _spare([m for m in spare if m not in others], inspection, rests)
    told = (reasons, tuple(rivals), tuple(problems), unsure, _joined(sorted(group), inspection))
    return Roles(body_names, feet, boom, home, *told)


def _spare(spare: list[int], inspection: Inspection, rests: BoolArray) -> str:
    """Report which markers other than feet rest near the floor, how often, and how high."""
    name, often = inspection.markers, rests.mean(axis=0)
    height = lowest(inspection.positions[:, :, 2])
    height -= np.nanmin(height, initial=np.inf)
    reach = 2 * NEAR_FLOOR * scale_of_all(inspection.positions)
    return "; ".join(
        f"{name[m]} hardly ever leaves the floor"
        if often[m] >= RESTS_SHARE[1]
        else f"{name[m]} rests {len(runs(rests[:, m]))} times, {1e3 * height[m]:.3g} mm higher"
        for m in spare
        if often[m] > RESTS_SHARE[0] and height[m] < reach
    )


def subject_prefixes(markers: tuple[str, ...]) -> list[str]:
    """Return the prefixes of the subjects' names: `A:`, or `A_` where five names continue alike."""
    named: dict[str, set[str]] = {}
    for name in markers:
        first, mark, marker = name.partition("_")
        named.setdefault(first + mark, set()).add(marker)
    alike = named and len(set.intersection(*named.values())) >= LEAST_FEET + LEAST_BODY
    if alike and not any(_LIMB.fullmatch(part.strip("_").lower()) for part in named):
        return list(named)
    return list(dict.fromkeys(name.partition(":")[0] + ":" for name in markers if ":" in name))


def _joined(group: list[int], inspection: Inspection) -> dict[str, list[str]]:
    """Return feet with several markers: those on one side by name that keep their distances.

    Empty if all markers form one foot, or each is a foot by itself. Distances alone do not decide,
    since feet that jump together keep theirs; nor do sides alone, since L1, L2 and L3 are legs.
    """
    names, bend = [inspection.markers[m] for m in group], _bend(group, inspection.pairs)
    sides = [_side(name) if part_by_name(name) else "" for name in names]
    parts: list[list[int]] = []
    for i, side in enumerate(sides):
        home = [p for p in parts if side and side == sides[p[0]] and bend[i, p].min() <= BEND]
        parts = [p for p in parts if p not in home] + [[*(k for p in home for k in p), i]]
    if not LEAST_FEET <= len(parts) < len(group):
        return {}
    alone = len({sides[p[0]] for p in parts}) == len(parts)
    feet = {sides[p[0]] if alone else f"of {names[p[0]]}": [names[i] for i in p] for p in parts}
    return {_NAMES.get(k, f"foot {k}"): of for k, of in sorted(feet.items()) if len(of) > 1}


def _side(name: str) -> str:
    """Return ``"l"`` or ``"r"`` if the name of a foot marker gives its side; else empty."""
    words = [w for w in _words(name, r"[a-z]+") if w not in _OF_FEET]
    return next((w[0] for w in words if w in _SIDES or _without_side(w) in _OF_FEET), "")


def _doubt(feet: tuple[str, ...], markers: tuple[str, ...], rested: int) -> str:
    """Return a doubt about the feet: too few landings, or other markers with names of feet."""
    if rested < LEAST_RESTS:
        return "others, since these rest near the floor less than three times"
    named = [name for name in markers if part_by_name(name) == "foot"]
    strangers = [name for name in feet if name not in named]
    return f"those named so: {', '.join(named)}" if named and strangers else ""


def _high(feet: list[int], taken: set[int], inspection: Inspection) -> str:
    """Report markers named like the feet but for a number that stay higher than they do."""
    stems = [re.sub(r"\d+", "", name) for name in inspection.markers]
    alike = {stems[m] for m in feet if part_by_name(stems[m]) == "foot"}
    above = lowest(inspection.positions[:, :, 2]) - lowest(inspection.positions[:, feet, 2]).min()
    high = [m for m in np.flatnonzero(np.isfinite(above)) if stems[m] in alike and m not in taken]
    told = (f"{inspection.markers[m]}, which stays {1e3 * above[m]:.0f} mm above" for m in high)
    return " and ".join(told)


def _fixed(positions: FloatArray) -> BoolArray:
    """Tell which markers stay in one place but for noise, (M,); none if many do."""
    ends = (stretches.quantiles(positions[:, :, axis], [0.02, 0.98]) for axis in range(3))
    fixed = np.logical_and.reduce([high - low < STILL_M for low, high in ends])
    return np.asarray(fixed & (fixed.mean() <= MOST_FIXED))


def feet_between(
    markers: tuple[str, ...], positions: FloatArray, rate_hz: float, feet: Sequence[str]
) -> list[str]:
    """Return the markers that repeatedly rest on the floor, but at other times than these feet.

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
    scale = scale_of_all(positions)
    rests = at_rest((positions := positions / scale)[:, :, 2], rate_hz * scale**0.5)
    resting = _resting(markers, positions[:, :, 2], rests, _fixed(positions))
    groups = _together(sorted({*resting, *(markers.index(name) for name in feet)}), rests)
    other = [[markers[m] for m in group] for group in groups]
    return [name for group in other if not {*group} & {*feet} for name in group]


def _resting(
    markers: tuple[str, ...], heights: FloatArray, rests: BoolArray, fixed: BoolArray
) -> list[int]:
    """Return the markers that rest near the floor repeatedly but not always, or that land there.

    Markers fixed in the world do not define the floor, since they may be below it.
    """
    low = lowest(heights)
    known = np.flatnonzero(np.isfinite(low))
    if fixed[known].all():
        return []
    floor = low[known[~fixed[known]]].min()
    top = np.nanmax(stretches.quantiles(heights, [0.5]))
    share = rests.mean(axis=0)
    parts = [part_by_name(name) for name in markers]
    rests_near = (low - floor < NEAR_FLOOR * (top - floor)) & (share > RESTS_SHARE[0])
    near = [m for m in np.flatnonzero(rests_near).tolist() if parts[m] in ("foot", "ankle", "")]
    often = [m for m in near if share[m] < RESTS_SHARE[1] and len(runs(rests[:, m])) >= LEAST_RESTS]
    once = [m for m in near if _landings(heights[:, m], rests[:, m])]
    named = [m for m in once if parts[m] == "foot"]
    return sorted({*often, *named}) if len(named) + len(often) >= LEAST_FEET else once


def _landings(heights: FloatArray, rests: BoolArray) -> int:
    """Count the rests that follow a height well above the floor since the rest before."""
    high = heights > lowest(heights[:, None])[0] + BAND_M + LIFT_M
    starts = [start for start, _ in runs(rests)]
    return sum(bool(high[a:b].any()) for a, b in zip([0, *starts], starts, strict=False))


def _together(candidates: list[int], rests: BoolArray) -> list[list[int]]:
    """Group feet by whether they rest at the same time, the largest group first."""
    groups: list[list[int]] = []
    for m in candidates:
        home = [g for g in groups if any(_overlap(rests[:, m], rests[:, k]) for k in g)]
        merged = sorted([m, *(k for g in home for k in g)])
        groups = [g for g in groups if g not in home] + [merged]
    return sorted(groups, key=lambda g: (-len(g), g))


def _overlap(one: BoolArray, other: BoolArray) -> bool:
    return bool((one & other).sum() > TOGETHER * min(one.sum(), other.sum()))


def _chosen(groups: list[list[int]], inspection: Inspection) -> list[int]:
    """Choose the feet to analyse: at most six markers, the same ones on both sides.

    Heels come first, then toes, then low markers. Of each rigid part only the lowest heel counts,
    since the heels of one shoe land together. Markers not named as feet are used only if fewer than
    two are, and ankles only if there is nothing else.
    """
    if len(groups[0]) == 1:  # one marker per foot, and no two land together
        groups = [[m for g in groups for m in g]]
    markers, low = inspection.markers, lowest(inspection.positions[:, :, 2])
    parts = {m: part_by_name(markers[m]) for m in groups[0]}
    kinds = (("foot",), ("foot", ""))
    named, others = ([m for m in groups[0] if parts[m] in known] for known in kinds)
    group = next((g for g in (named, others) if len(g) >= LEAST_FEET), groups[0])

    def rank(m: int) -> tuple[bool, int, float]:
        return parts[m] != "foot", place_by_name(markers[m])[0], float(low[m])

    chosen: list[int] = []
    for m in sorted(group, key=rank):
        place = place_by_name(markers[m])[1]
        alike = [k for k in group if place_by_name(markers[k])[1] == place or k == m]
        if len({m, *chosen, *alike}) <= MOST_FEET and not _heel_again(m, chosen, inspection):
            chosen += [k for k in alike if k not in chosen]
    return sorted(chosen)


def _heel_again(m: int, chosen: list[int], inspection: Inspection) -> bool:
    """Tell whether a marker is on a heel already chosen, on the same rigid part."""
    heels = [k for k in [m, *chosen] if place_by_name(inspection.markers[k])[0] == 0]
    parts = [set(cluster.markers) for cluster in inspection.clusters]
    return m in heels and any({m, k} <= part for k in heels[1:] for part in parts)


def _home(body: list[int], inspection: Inspection) -> tuple[str, str]:
    """Return the first body marker without faults, or the one with the fewest, and the reason."""
    markers = inspection.markers
    faults = Counter(name for one in inspection.suspects() for name in one.markers)
    unseen = 1.0 - np.isfinite(inspection.positions[:, body, 0]).mean(axis=0)

    def rank(k: int) -> tuple[int, float]:
        return faults.get(markers[body[k]], 0), unseen[k] if unseen[k] > SEEN_SHARE else 0.0

    best = min(range(len(body)), key=rank)
    passed = [f"{markers[body[k]]} ({_wrong(*rank(k))})" for k in range(best)]
    reason = f"the first of the body's markers but for {', '.join(passed)}" if passed else ""
    if rank(best) != (0, 0.0):
        least = f"the best of the body's, none of them without fault: {_wrong(*rank(best))}"
        return markers[body[best]], f"{least}; look at hopdata inspect"
    return markers[body[best]], reason


def _wrong(faults: int, unseen: float) -> str:
    parts = [f"{faults} suspected fault{'s' if faults > 1 else ''}"] if faults else []
    parts += [f"unseen in {100 * unseen:.2g} % of the frames"] if unseen else []
    return ", ".join(parts)


def _body(inspection: Inspection, taken: set[int]) -> tuple[list[int], str, str]:
    """Return the body's markers, the reason, and any alternative if the choice is not clear.

    The body is a rigid cluster, or named markers that hardly bend. It is limited to markers that
    are nearly always seen, if these are enough.
    """
    markers = inspection.markers
    named = [m for m, name in enumerate(markers) if part_by_name(name) == "body" and m not in taken]
    rigid = [[m for m in c.markers if m not in taken] for c in inspection.clusters]
    rigid = [c for c in rigid if len(c) >= LEAST_BODY]
    rigid.sort(key=lambda c: -float(np.nanmedian(inspection.positions[:, c, 2])))
    of_named = [c for c in rigid if len(set(c) & set(named)) >= LEAST_BODY]
    seen = np.isfinite(inspection.positions[:, :, 0]).mean(axis=0)

    def left_out(kept: list[int], of: list[int], why: str) -> str:
        left = [markers[m] for m in of if m not in kept]
        return f"; left out, {why}: {', '.join(left)}" if left else ""

    if of_named:
        pool = [m for m in of_named[0] if m in named]
        kept = _well_seen(pool, seen)
        reason = f"rigid, {_strain(kept, inspection.pairs)}; never on the floor"
        reason += left_out(pool, of_named[0], "for their names")
        return kept, reason + left_out(kept, pool, "since they are seen less"), ""
    for pool in (_well_seen(named, seen), named):
        if kept := _stiffest(pool, inspection.pairs):
            reason = f"by name; {_strain(kept, inspection.pairs)}"
            reason += left_out(pool, named, "since they are seen less")
            return kept, reason + left_out(kept, pool, "since they bend more"), ""
    if rigid:
        kept = _well_seen(rigid[0], seen)
        reason = f"the highest rigid cluster, {_strain(kept, inspection.pairs)}"
        reason += left_out(kept, rigid[0], "since they are seen less")
        rivals = [m for c in rigid[1:2] for m in c] or named
        return kept, reason, ", ".join(markers[m] for m in rivals if m not in kept)
    return [], "", ""


def _well_seen(pool: list[int], seen: FloatArray) -> list[int]:
    """Keep the markers seen in nearly all frames if four are or, with more gaps, three.

    With four, the gaps of each can be filled from the other three.
    """
    nearly, well = ([m for m in pool if seen[m] >= 1 - share] for share in SEEN_SHARES)
    well = nearly if len(nearly) > LEAST_BODY else well
    return well if len(well) >= LEAST_BODY else pool


def _stiffest(named: list[int], pairs: PairDistances) -> list[int]:
    """Remove the marker that bends most, one by one, until the rest hardly bend."""
    kept = list(named)
    while len(kept) >= LEAST_BODY:
        bend = _bend(kept, pairs)
        if np.nanmax(bend) <= BEND:
            return kept
        kept.pop(int(np.nanargmax(np.nansum(bend, axis=1))))
    return []


def _bend(members: list[int], pairs: PairDistances) -> FloatArray:
    square = np.ix_(members, members)
    with np.errstate(invalid="ignore", divide="ignore"):
        bend: FloatArray = pairs.spread[square] / pairs.median[square]
    np.fill_diagonal(bend, 0.0)
    return bend


def _strain(members: list[int], pairs: PairDistances) -> str:
    spread = pairs.spread[np.ix_(members, members)]
    most_mm = float(f"{1e3 * np.nanmax(spread):.2g}")
    bend = np.nanmax(_bend(members, pairs))
    return f"distances vary by {most_mm:g} mm at most ({100 * bend:.1f} %)"


def _feet_reason(group: list[int], rests: BoolArray) -> str:
    counts = [len(runs(rests[:, m])) for m in group]
    share = 100 * rests[:, group].mean()
    low, high = min(counts), max(counts)
    often = f"{low}" if low == high else f"{low} to {high}"
    together = (any(_overlap(rests[:, m], rests[:, k]) for k in group if k != m) for m in group)
    apart = "" if all(together) else "; not at the same time"
    return f"rest near the floor {often} time{'s' * (high != 1)}, {share:.0f} % of the time{apart}"


def _sole(group: list[int], inspection: Inspection) -> tuple[list[int], str]:
    """Keep only the low markers of feet that form one rigid part such as a shoe; say so."""
    markers, scale = inspection.markers, scale_of_all(inspection.positions)
    two_sides = len({place_by_name(markers[m]) for m in group}) < len(group)
    one = any(set(group) <= set(cluster.markers) for cluster in inspection.clusters)
    low = lowest(inspection.positions[:, group, 2])
    kept = [m for m, height in zip(group, low, strict=True) if height < low.min() + SOLE_M * scale]
    if two_sides or not one or np.ptp(low) < UNEVEN_M * scale:
        return group, ""
    kept = kept if len(kept) >= LEAST_FEET else group
    told = "; all on one rigid part"
    if left := [markers[m] for m in group if m not in kept]:
        told += f", left out, higher on it: {', '.join(left)}"
    apart = 1e3 * float(np.ptp(lowest(inspection.positions[:, kept, 2])))
    keep = "keep those where it touches the ground, or all if that slopes"
    return kept, f"{told}; {apart:.0f} mm apart in height: {keep}"


def _beyond_most(group: list[int], groups: list[list[int]], markers: tuple[str, ...]) -> str:
    """Report which markers land with the feet but are left out because there are too many."""
    left = [markers[m] for g in groups if set(g) & set(group) for m in g if m not in group]
    most = f"{MOST_FEET} at most, " if len(group) + 1 >= MOST_FEET else ""
    one = " (of a shoe's heel one marker is enough)"
    why = one * any(place_by_name(name)[0] == 0 for name in left)
    return f"; {most}left out: {', '.join(left)}{why}" if left else ""


def _no_feet(group: list[int], inspection: Inspection) -> str:
    """Report that no feet were found, and the likely candidates: by name, or the lowest."""
    markers, low = inspection.markers, lowest(inspection.positions[:, :, 2])
    found = f"only {markers[group[0]]}" if group else "none"
    by_height = [markers[m] for m in np.argsort(low, kind="stable") if np.isfinite(low[m])]
    named = [name for name in by_height if part_by_name(name) == "foot"]
    likely = f"named as feet: {', '.join(named)}" if named else ""
    likely = likely or f"nearest to the floor: {', '.join(by_height[:MOST_FEET]) or 'none'}"
    wanted = "two markers or more that rest near the floor again and again, or leave it and land"
    return mismatch("markers.feet", wanted, f"{found}; name them by hand ({likely})")
