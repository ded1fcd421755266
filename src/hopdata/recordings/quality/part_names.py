"""What a marker's name reveals about its body part."""

import re

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
SIDE_NAMES = {"l": "left", "r": "right"}
SIDES = (*SIDE_NAMES.values(), *SIDE_NAMES)
PARTS = {part: frozenset(words.split()) for part, words in _WORDS.items()}
OF_FEET = PARTS["foot"] | PARTS["ankle"]


def part_by_name(name: str) -> str:
    """Return ``"foot"``, ``"ankle"``, ``"boom"``, ``"body"`` or ``""`` for a marker's name.

    Case, digits and separators are ignored: ``R_mt1``, ``L.Heel.Top`` and ``FOOT3`` are
    feet.
    """
    words = words_of(name, r"[a-z]+")
    plain = {*words, *map(without_side, words)}
    return next((part for part, known in PARTS.items() if plain & known), "")


def place_by_name(name: str) -> tuple[int, str]:
    """Return the rank of a place on a foot (0 heels, 1 toes, 2 others) and its name.

    The name is shared by both sides: ``L_mt1`` and ``RMT1`` are ``mt1``.
    """
    words = [w for w in words_of(name, r"[a-z]+[0-9]*|[0-9]+") if w not in SIDES]
    plain = [
        without_side(w) if w.rstrip("0123456789") not in OF_FEET else w for w in words
    ]
    letters = {w.rstrip("0123456789") for w in plain}
    return 0 if letters & _HEELS else 1 if letters & _TOES else 2, " ".join(plain)


def words_of(name: str, pattern: str) -> list[str]:
    """Return the parts of a marker's name that match a pattern, in lower case."""
    return re.findall(pattern, re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())


def without_side(word: str) -> str:
    """Drop a leading l or r, as in ``rheel``, or a word for the side."""
    for side in SIDES:
        if word.startswith(side) and len(word) > len(side) + 1:
            return word.removeprefix(side)
    return word


def roles_by_name(markers: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the markers named as parts of the ``"body"`` and as ``"feet"``."""
    parts = {"body": "body", "feet": "foot"}
    return {
        role: [name for name in markers if part_by_name(name) == part]
        for role, part in parts.items()
    }
