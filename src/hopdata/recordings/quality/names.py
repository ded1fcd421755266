"""What a marker's name says about its part."""

from __future__ import annotations

import re

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
