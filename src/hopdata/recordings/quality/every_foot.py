"""All feet of a recording, whenever they land, where a study would choose a few.

A study compares feet that land together; contacts are of interest for each foot: both
feet of a runner, and those of a walk.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hopdata.recordings.quality.feet import joined_feet
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.part_names import (
    HEEL,
    TOE,
    part_by_name,
    place_by_name,
    side_of_foot,
    subject_prefixes,
    without_number,
)
from hopdata.recordings.quality.rests import lowest
from hopdata.recordings.quality.roles import Roles
from hopdata.recordings.quality.vocabulary import NamedParts, named_parts

_OPPOSITE = {"l": "r", "r": "l"}

Joined = dict[str, list[str]]
Grouping = tuple[tuple[str, tuple[str, ...]], ...]


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
        Feet with several of these markers, and their names; a single foot as well.
    """
    markers = inspection.markers
    chosen = set(roles.feet)
    if chosen:
        for group in roles.other_feet:
            chosen |= _alike(group, roles.feet, named_parts(tuple(markers)), markers)
    else:
        chosen = _by_name(inspection)
    feet = [m for m, name in enumerate(markers) if name in chosen]
    return [markers[m] for m in feet], joined_feet(feet, inspection, least_feet=1)


@dataclass(frozen=True)
class GuessedFeet:
    """The feet that were guessed in one of several files.

    Parameters
    ----------
    markers : tuple of str
        All markers of the file.
    feet : tuple of str
        Those on feet, in the order of the file.
    joined : tuple of (str, tuple of str)
        Feet with several of these markers: name, and those markers.
    """

    markers: tuple[str, ...]
    feet: tuple[str, ...]
    joined: Grouping

    @classmethod
    def of(
        cls, markers: Iterable[str], feet: Iterable[str], joined: Joined
    ) -> GuessedFeet:
        """Return what `every_foot` has found among the markers of a file."""
        groups = tuple((name, tuple(own)) for name, own in joined.items())
        return cls(tuple(markers), tuple(feet), groups)


def shared_feet(guesses: Sequence[GuessedFeet]) -> list[GuessedFeet]:
    """Return the guess of each file, alike for all files with the same markers.

    Files of one call are of one subject. What most of them show holds for all; of two
    guesses as frequent, the one with more markers. So a gap, noise or a heel that does
    not land in one file makes no other feet of it.
    """
    counts: dict[frozenset[str], Counter[GuessedFeet]] = {}
    for guess in guesses:
        own = counts.setdefault(frozenset(guess.markers), Counter())
        own[guess] += 1
    shared = {markers: _most_frequent(own) for markers, own in counts.items()}
    return [shared[frozenset(guess.markers)] for guess in guesses]


def _most_frequent(counts: Counter[GuessedFeet]) -> GuessedFeet:
    """Return the most frequent guess; of several, the one with more markers."""

    def rank(guess: GuessedFeet) -> tuple[int, int, int]:
        n_joined = sum(len(own) for _, own in guess.joined)
        return counts[guess], len(guess.feet), n_joined

    return max(counts, key=rank)


def _alike(
    group: tuple[str, ...],
    feet: tuple[str, ...],
    names: NamedParts,
    markers: tuple[str, ...],
) -> set[str]:
    """Return the markers of a group that are on the same places as those of the feet.

    Numbers do not count where too few have the same: of FT1, FT2 and FT3 on either foot
    others may land. Markers without a part in their name have no place: all of these
    are taken if the feet have none either.
    """
    numbers = {name: m for m, name in enumerate(markers)}
    part_of = {name: names.role(numbers[name]) for name in (*feet, *group)}
    if not any(part_of[name] for name in feet):
        return {name for name in group if not part_of[name]}
    of_foot = [name for name in group if part_of[name] in ("foot", "ankle")]
    places = _places(names, markers)
    alike = _on_same_places(of_foot, feet, places)
    if len(alike) < len(feet):
        alike = _on_same_places(of_foot, feet, _but_for_numbers(places))
    sides = {names.sides[numbers[name]] for name in (*feet, *of_foot)}
    if not alike and not {*_OPPOSITE} <= sides:  # names as foot_A tell no places
        return set(of_foot)
    return alike


# Where each marker is on its limb, by its name: rank, and the rest of the name.
Places = dict[str, tuple[int, str]]


def _places(names: NamedParts, markers: tuple[str, ...]) -> Places:
    """Return the places of all markers, without the side of the limb."""
    on_limbs = [names.place_on_limb(m) for m in range(len(markers))]
    all_stems = {stem for _, stem in on_limbs}
    places = {}
    for name, (rank, stem) in zip(markers, on_limbs, strict=True):
        places[name] = (rank, _without_mirrored_side(stem, all_stems))
    return places


def _but_for_numbers(places: Places) -> Places:
    """Return places that differ no more where only their numbers do."""
    return {name: (rank, without_number(stem)) for name, (rank, stem) in places.items()}


def _on_same_places(
    names: Iterable[str], feet: Iterable[str], places: Places
) -> set[str]:
    """Return those of the names that are on a place of one of the feet."""
    of_feet = {places[foot] for foot in feet}
    return {name for name in names if places[name] in of_feet}


def _without_mirrored_side(stem: str, all_stems: set[str]) -> str:
    """Drop l or r at the beginning of a word where a marker has the other side's.

    The middle legs of an insect, as of foot_LM and foot_RM, are no limbs of an animal
    on four legs, and have no side by that.
    """
    words = stem.split()
    for k, word in enumerate(words):
        first = word[0]
        if first not in _OPPOSITE:
            continue
        opposite = _OPPOSITE[first] + word[1:]
        mirrored = " ".join([*words[:k], opposite, *words[k + 1 :]])
        if mirrored in all_stems:
            words[k] = word[1:]
    return " ".join(word for word in words if word)


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
