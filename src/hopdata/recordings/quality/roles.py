"""Which marker is on the body, which on a foot, which on the boom: by motion and by name."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.rigid import PairDistances
from hopdata.recordings.quality.stretches import at_rest, lowest, runs

# What a marker's name says about its part.

_WORDS = {
    "foot": """foot feet toe toes heel mt mth met metatarsal metatarsus hallux paw hoof claw calc
        calcaneus tarsus tip sole digit finger""",
    "boom": "boom counterweight weight tail post frame lab fixed",
    "body": """body pelvis hip hips asis psis asi psi sacrum trunk torso chassis back base iliac
        crest spine thorax croup withers""",
}
PARTS = {part: frozenset(words.split()) for part, words in _WORDS.items()}


def part_by_name(name: str) -> str:
    """Return ``"foot"``, ``"body"``, ``"boom"`` or ``""`` for a marker's name.

    Case, digits and separators do not matter: ``R_mt1``, ``L.Heel.Top`` and ``FOOT3`` are feet.
    """
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = re.findall(r"[a-z]+", apart.lower())
    for part, known in PARTS.items():
        if any(word in known or _without_side(word) in known for word in words):
            return part
    return ""


def _without_side(word: str) -> str:
    """Drop a leading l or r, as in ``rheel``, or the word for a side."""
    for side in ("left", "right", "l", "r"):
        if word.startswith(side) and len(word) > len(side) + 1:
            return word.removeprefix(side)
    return word


MOST_FEET, LEAST_FEET, LEAST_BODY = 6, 2, 3
LEAST_RESTS = 3
RESTS_SHARE = (0.03, 0.95)  # of the frames
NEAR_FLOOR = 0.08  # of the height of the highest marker: how high a foot marker may rest
TOGETHER = 0.5  # share of the shorter rests in which both rest: feet that land together
STILL_M = 0.003  # a marker that stays within this is fixed in the world
UNEVEN_M = 0.01  # markers of one part that rest further apart in height are not all on its sole
BEND = 0.04  # relative spread of a distance up to which named body markers are taken as a body


@dataclass(frozen=True)
class Roles:
    """Guessed roles; empty where nothing could be guessed, and `problems` says why.

    Parameters
    ----------
    body, feet, boom : tuple of str
        Marker names.
    reasons : dict
        Of ``"body"``, ``"feet"``, ``"boom"``: why these.
    other_feet : tuple of tuple of str
        Further groups of feet, which land at other times.
    problems : tuple of str
        What could not be guessed, and what to do about it.
    """

    body: tuple[str, ...]
    feet: tuple[str, ...]
    boom: tuple[str, ...]
    reasons: dict[str, str]
    other_feet: tuple[tuple[str, ...], ...]
    problems: tuple[str, ...]


def guess_roles(inspection: Inspection) -> Roles:
    """Guess the roles of all markers.

    Feet are markers that rest near the floor again and again, and together; the body is the rigid
    cluster that never does; the boom is what is named so, or stays fixed in the world.
    """
    markers, positions = inspection.markers, inspection.positions
    rests = at_rest(positions[:, :, 2], inspection.rate_hz)
    fixed = _fixed(positions)
    boom = tuple(name for m, name in enumerate(markers) if fixed[m] or part_by_name(name) == "boom")
    candidates = [m for m in _resting(inspection, rests, fixed) if markers[m] not in boom]
    groups = _together(candidates, rests)
    reasons, problems = {}, []
    if boom:
        reasons["boom"] = _boom_reason([markers.index(name) for name in boom], fixed)
    group = _chosen(groups, markers, positions)
    if len(group) >= LEAST_FEET:
        reasons["feet"] = _feet_reason(group, rests) + _one_part(group, inspection)
        reasons["feet"] += _beyond_most(group, groups, markers)
    else:
        problems.append(_no_feet(group, markers))
    taken = {m for g in groups for m in g} | {markers.index(name) for name in boom}
    body, reasons["body"] = _body(inspection, taken)
    if len(body) < LEAST_BODY:
        problems.append(
            "markers.body: expected three markers or more that keep their distances, found none; "
            "name them by hand"
        )
    others = [tuple(markers[m] for m in g) for g in groups if not set(g) & set(group)]
    return Roles(
        tuple(markers[m] for m in sorted(body)),
        tuple(markers[m] for m in sorted(group)),
        boom,
        reasons,
        tuple(others),
        tuple(problems),
    )


def _fixed(positions: FloatArray) -> BoolArray:
    """Markers that stay at one place of the world but for noise, (M,)."""
    fixed = np.zeros(positions.shape[1], dtype=bool)
    for m in range(positions.shape[1]):
        known = positions[np.isfinite(positions[:, m, 0]), m]
        if len(known):
            low, high = np.quantile(known, [0.02, 0.98], axis=0)
            fixed[m] = bool(np.all(high - low < STILL_M))
    return fixed


def _resting(inspection: Inspection, rests: BoolArray, fixed: BoolArray) -> list[int]:
    """Markers that rest near the floor, again and again but not always.

    Where the floor is does not depend on markers that are fixed in the world: they may be below it.
    """
    heights = inspection.positions[:, :, 2]
    low = lowest(heights)
    known = np.flatnonzero(np.isfinite(low))
    if fixed[known].all():
        return []
    floor = low[known[~fixed[known]]].min()
    top = max(float(np.nanmedian(heights[:, m])) for m in known)
    share = rests.sum(axis=0) / max(len(rests), 1)
    return [
        m
        for m in known.tolist()
        if low[m] - floor < NEAR_FLOOR * (top - floor)
        and RESTS_SHARE[0] < share[m] < RESTS_SHARE[1]
        and len(runs(rests[:, m])) >= LEAST_RESTS
        and part_by_name(inspection.markers[m]) in ("foot", "")
    ]


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


def _chosen(groups: list[list[int]], markers: tuple[str, ...], positions: FloatArray) -> list[int]:
    """Choose the group to analyse: at most six markers of it, named feet and low ones first."""
    if not groups:
        return []
    if len(groups[0]) == 1:  # one marker a foot, and no two land together
        groups = [[m for g in groups for m in g]]
    low = lowest(positions[:, :, 2])
    ranked = sorted(groups[0], key=lambda m: (part_by_name(markers[m]) != "foot", low[m]))
    return sorted(ranked[:MOST_FEET])


def _body(inspection: Inspection, taken: set[int]) -> tuple[list[int], str]:
    """Return the body's markers, and why: a rigid cluster, or named markers that hardly bend."""
    markers = inspection.markers
    named = [m for m, name in enumerate(markers) if part_by_name(name) == "body" and m not in taken]
    rigid = [[m for m in c.markers if m not in taken] for c in inspection.clusters]
    rigid = [c for c in rigid if len(c) >= LEAST_BODY]
    rigid.sort(key=lambda c: -float(np.nanmedian(inspection.positions[:, c, 2])))
    of_named = [c for c in rigid if set(c) & set(named)]
    if of_named:
        return of_named[0], f"rigid, {_strain(of_named[0], inspection.pairs)}; never on the floor"
    if len(named) >= LEAST_BODY:
        kept = _stiffest(named, inspection.pairs)
        if kept:
            left = [markers[m] for m in named if m not in kept]
            dropped = f"; left out, since they bend more: {', '.join(left)}" if left else ""
            return kept, f"by name; {_strain(kept, inspection.pairs)}{dropped}"
    if rigid:
        return rigid[0], f"the highest rigid cluster, {_strain(rigid[0], inspection.pairs)}"
    return [], ""


def _stiffest(named: list[int], pairs: PairDistances) -> list[int]:
    """Leave out, one by one, the marker that bends most, until the rest hardly bend."""
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
    return (
        f"distances vary by {1e3 * np.nanmax(spread):.1f} mm at most "
        f"({100 * np.nanmax(_bend(members, pairs)):.1f} %)"
    )


def _feet_reason(group: list[int], rests: BoolArray) -> str:
    counts = [len(runs(rests[:, m])) for m in group]
    share = 100 * rests[:, group].mean()
    low, high = min(counts), max(counts)
    often = f"{low}" if low == high else f"{low} to {high}"
    return f"rest near the floor {often} times, {share:.0f} % of the time" + (
        "" if _land_together(group, rests) else "; not at the same time"
    )


def _one_part(group: list[int], inspection: Inspection) -> str:
    """Say if the feet are one rigid part, such as a shoe, and not all of them on its sole."""
    if not any(set(group) <= set(cluster.markers) for cluster in inspection.clusters):
        return ""
    apart = float(np.ptp(lowest(inspection.positions[:, group, 2])))
    if apart < UNEVEN_M:
        return ""
    return (
        f"; all on one rigid part, and {1e3 * apart:.0f} mm apart in height: keep those where it "
        "touches the ground"
    )


def _beyond_most(group: list[int], groups: list[list[int]], markers: tuple[str, ...]) -> str:
    """Say which markers that land with the feet are not among them, since there are too many."""
    left = [markers[m] for g in groups if set(g) & set(group) for m in g if m not in group]
    return f"; {MOST_FEET} at most, left out: {', '.join(left)}" if left else ""


def _land_together(group: list[int], rests: BoolArray) -> bool:
    return all(any(_overlap(rests[:, m], rests[:, k]) for k in group if k != m) for m in group)


def _boom_reason(boom: list[int], fixed: BoolArray) -> str:
    return "stays fixed in the world" if fixed[boom].all() else "by name"


def _no_feet(group: list[int], markers: tuple[str, ...]) -> str:
    found = f"only {markers[group[0]]}" if group else "none"
    return (
        "markers.feet: expected two markers or more that rest near the floor again and again, "
        f"found {found}; name them by hand"
    )
