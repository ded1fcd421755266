"""What a marker's name reveals: its subject, its body part, and its place on a foot."""

import re
from collections.abc import Sequence

_WORDS = {
    "foot": (
        "foot feet toe toes heel hee mt mth met fm metatarsal metatarsus hallux paw "
        "hoof claw calc calcaneus fcc tarsus tip sole digit finger"
    ),
    "ankle": "ankle ank malleolus mal fal tam",
    "boom": "boom counterweight weight tail post frame lab fixed",
    "body": (
        "body pelvis hip hips asis psis asi psi ias ips sacrum sacr trunk torso "
        "chassis back base iliac crest spine thorax croup withers"
    ),
}
_HEELS = frozenset({"heel", "hee", "calc", "calcaneus", "fcc"})
_TOES = frozenset({"toe", "toes", "hallux"})
_DIGITS = "0123456789"
_LIMB = re.compile("l|r|left|right|[lr][fh]|[fhb][lr]|front|hind|fore|rear|back")
SIDE_NAMES = {"l": "left", "r": "right"}
SIDES = (*SIDE_NAMES.values(), *SIDE_NAMES)
PARTS = {part: frozenset(words.split()) for part, words in _WORDS.items()}
OF_FEET = PARTS["foot"] | PARTS["ankle"]

# The four limbs of an animal, with the side first or last: fore or front, and hind,
# rear or back. A word for the foot may follow without a space, as a paw's P does.
_LIMBS = (
    re.compile("(?P<side>[lr])(?P<end>[fh])(?P<foot>.*)"),
    re.compile("(?P<end>[fhrb])(?P<side>[lr])(?P<foot>.*)"),
)
_AFTER_LIMB = OF_FEET | {"", "p"}

# Ranks of places on a foot: heels come first.
HEEL = 0
TOE = 1
ELSEWHERE = 2

#: Least number of names that all subjects have in common.
#: Unit: 1. Origin: derived: two feet and three markers of a body.
NAMES_OF_A_SUBJECT = 5


def part_by_name(name: str) -> str:
    """Return the part of a marker's name: a key of `PARTS`, or an empty string.

    Case, digits and separators are ignored: ``R_mt1``, ``L.Heel.Top`` and ``FOOT3`` are
    feet.
    """
    words = words_of(name, r"[a-z]+")
    plain = {*words, *map(without_side, words)}
    for part, known in PARTS.items():
        if plain & known:
            return part
    return ""


def place_by_name(name: str) -> tuple[int, str]:
    """Return the rank of a place on a foot (`HEEL`, `TOE`, `ELSEWHERE`) and its name.

    The name is shared by both sides: ``L_mt1`` and ``RMT1`` are ``mt1``.
    """
    plain = []
    for word in words_of(name, r"[a-z]+[0-9]*|[0-9]+"):
        if word in SIDES:
            continue
        if word.rstrip(_DIGITS) not in OF_FEET:  # `rheel`, but not `foot`
            word = without_side(word)
        plain.append(word)
    letters = {word.rstrip(_DIGITS) for word in plain}
    if letters & _HEELS:
        rank = HEEL
    elif letters & _TOES:
        rank = TOE
    else:
        rank = ELSEWHERE
    return rank, " ".join(plain)


def is_heel(name: str) -> bool:
    """Tell whether a marker is on a heel by its name."""
    rank, _ = place_by_name(name)
    return rank == HEEL


def side_of_foot(name: str) -> str:
    """Return ``"l"`` or ``"r"`` if a foot marker's name gives its side; else empty."""
    for word in words_of(name, r"[a-z]+"):
        if word in OF_FEET:
            continue
        if word in SIDES or without_side(word) in OF_FEET:
            return word[0]
    return ""


def sides_of_feet(names: Sequence[str]) -> tuple[str, ...]:
    """Return the side of each foot, ``"l"`` or ``"r"`` or empty, by all of their names.

    LF, RF, LH and RH, or FL, FR, HL and HR, are sides only if the names of all feet
    begin so, on both sides, and no name has a side by itself: ``LHEE`` is a left heel.
    """
    alone = tuple(side_of_foot(name) for name in names)
    if any(alone):
        return alone
    first_words = [words_of(name, "[a-z]+")[:1] for name in names]
    for limb in _LIMBS:
        found = [limb.fullmatch(word) for words in first_words for word in words]
        sides = tuple(
            one["side"]
            for one in found
            if one is not None and one["foot"] in _AFTER_LIMB
        )
        if len(sides) == len(names) and set(sides) == set(SIDE_NAMES):
            return sides
    return alone


def words_of(name: str, pattern: str) -> list[str]:
    """Return the parts of a marker's name that match a pattern, in lower case."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return re.findall(pattern, spaced.lower())


def without_side(word: str) -> str:
    """Drop a leading l or r, as in ``rheel``, or a word for the side."""
    for side in SIDES:
        if word.startswith(side) and len(word) > len(side) + 1:
            return word.removeprefix(side)
    return word


def without_number(name: str) -> str:
    """Drop the digits of a name."""
    return re.sub(r"\d+", "", name)


def subject_prefixes(markers: tuple[str, ...]) -> list[str]:
    """Return the prefixes of the subjects' names: `A:`, or `A_`.

    An underscore separates subjects only if five names of all of them continue alike,
    and if what stands before it is no limb.
    """
    markers_of: dict[str, set[str]] = {}
    for name in markers:
        first, underscore, marker = name.partition("_")
        markers_of.setdefault(first + underscore, set()).add(marker)
    in_common = set.intersection(*markers_of.values()) if markers_of else set()
    are_limbs = any(_LIMB.fullmatch(one.strip("_").lower()) for one in markers_of)
    if len(in_common) >= NAMES_OF_A_SUBJECT and not are_limbs:
        return list(markers_of)

    before_colon = [name.partition(":")[0] for name in markers if ":" in name]
    return [f"{subject}:" for subject in dict.fromkeys(before_colon)]
