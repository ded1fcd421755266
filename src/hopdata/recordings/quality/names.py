"""What a marker's name says about its part."""

from __future__ import annotations

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
_SIDES = ("left", "right", "l", "r")
PARTS = {part: frozenset(words.split()) for part, words in _WORDS.items()}


def part_by_name(name: str) -> str:
    """Return ``"foot"``, ``"ankle"``, ``"boom"``, ``"body"`` or ``""`` for a marker's name.

    Case, digits and separators do not matter: ``R_mt1``, ``L.Heel.Top`` and ``FOOT3`` are feet.
    """
    words = _words(name, r"[a-z]+")
    for part, known in PARTS.items():
        if any(word in known or _without_side(word) in known for word in words):
            return part
    return ""


def place_by_name(name: str) -> tuple[int, str]:
    """Return how telling a place on a foot is, 0 for heels, 1 for toes, else 2, and its name.

    The name is that of both sides: ``L_mt1`` and ``RMT1`` are ``mt1``.
    """
    words = [w for w in _words(name, r"[a-z]+[0-9]*|[0-9]+") if w not in _SIDES]
    known = PARTS["foot"] | PARTS["ankle"]
    plain = [_without_side(w) if w.rstrip("0123456789") not in known else w for w in words]
    letters = {w.rstrip("0123456789") for w in plain}
    return 0 if letters & _HEELS else 1 if letters & _TOES else 2, " ".join(plain)


def _words(name: str, pattern: str) -> list[str]:
    return re.findall(pattern, re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())


def _without_side(word: str) -> str:
    """Drop a leading l or r, as in ``rheel``, or the word for a side."""
    for side in _SIDES:
        if word.startswith(side) and len(word) > len(side) + 1:
            return word.removeprefix(side)
    return word
