"""Which part of a body each marker is on, by all the names of a file together.

A name alone may say little: ``RA`` is an ankle, an acromion or an arm. So the names of
a file are compared with whole vocabularies, and the vocabulary that knows most of them
settles what each means.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from hopdata.recordings.quality.part_names import (
    ELSEWHERE,
    HEEL,
    TOE,
    part_by_name,
    place_by_name,
)

#: Codes of one vocabulary, without their sides, that must occur together in a file.
#: Unit: 1. Origin: chosen. The codes of one limb alone are three or four.
LEAST_CODES = 4

#: Parts that these codes must name, at least.
#: Unit: 1. Origin: chosen.
LEAST_PARTS = 3

# Heights of parts above the ground, relative to the stature of who stands upright, from
# anthropometric tables (Drillis and Contini, 1966), rounded.
HEIGHTS: Mapping[str, float] = {
    "heel": 0.03,
    "toe": 0.02,
    "foot": 0.03,
    "ankle": 0.05,
    "shank": 0.17,
    "knee": 0.28,
    "thigh": 0.40,
    "hip": 0.53,
    "pelvis": 0.57,
    "trunk": 0.73,
    "shoulder": 0.82,
    "neck": 0.87,
    "head": 0.95,
}

# The same for animals on four legs, relative to their height; their heads are ahead.
HEIGHTS_ON_FOUR_LEGS: Mapping[str, float] = {
    "heel": 0.02,
    "toe": 0.0,
    "foot": 0.0,
    "ankle": 0.15,
    "shank": 0.3,
    "knee": 0.45,
    "thigh": 0.6,
    "hip": 0.8,
    "pelvis": 0.9,
    "trunk": 0.9,
    "shoulder": 0.75,
}

OF_A_FOOT = ("heel", "toe", "foot")

# Parts that only people's markers are named after, beside the vocabularies of codes.
_OF_PEOPLE = ("pelvis", "shoulder", "neck", "head", "arm", "hand")

# Landmarks that are palpated on people; with markers on the legs they tell a person.
_BONES_OF_PEOPLE = {
    form
    for bone in (
        "asis",
        "psis",
        "asi",
        "psi",
        "iliac",
        "sacral",
        "malleolus",
        "acromion",
    )
    for form in (bone, f"l{bone}", f"r{bone}")
}

# Words that are on feet where there are no hands.
_OF_HANDS = frozenset({"finger", "digit", "tip"})

# Vertebrae, whose names are no words.
_VERTEBRAE = {
    **dict.fromkeys(("c7", "cv7"), "neck"),
    **dict.fromkeys(("t8", "t10", "t12"), "trunk"),
}

# How the four limbs of an animal are called.
LIMBS = frozenset({"lf", "rf", "lh", "rh", "fl", "fr", "hl", "hr"})

# Ends of an animal, before which `L` and `R` are sides.
_ENDS = frozenset({"front", "fore", "hind", "back"})

_WORD_AND_NUMBER = r"[a-zà-ÿß]+[0-9]*|[0-9]+"

# Words that would be others but for their first letter.
_WITHOUT_SIDE = frozenset({"rear"})

_SIDES = {
    **dict.fromkeys(("l", "left", "gauche", "links", "esquerdo", "esquerda"), "l"),
    **dict.fromkeys(("r", "right", "droit", "droite", "rechts", "direito"), "r"),
    **dict.fromkeys(("re", "direita", "izquierdo", "derecho"), "r"),
    **dict.fromkeys(("li", "g", "izq", "lx", "sx"), "l"),
    **dict.fromkeys(("d", "der", "rx", "dx"), "r"),
}
_SIDES["izquierdo"] = "l"
_LONG_SIDES = tuple(side for side in _SIDES if len(side) > 3)
_LATERAL = re.compile("(med|lat|m|l)(?=(ankle|knee|elbow|wrist|mal|heel|foot)s?$)")


@dataclass(frozen=True)
class NamedParts:
    """What the names of a file's M markers say together.

    Parameters
    ----------
    parts : tuple of str
        The part of each: a key of `HEIGHTS`, ``"arm"``, ``"hand"``, ``"boom"``,
        ``"tail"``, ``"virtual"`` (computed by a program), or an empty string.
    sides : tuple of str
        ``"l"``, ``"r"`` or an empty string for each.
    stems : tuple of str
        The name of each without subject and side.
    vocabulary : str
        The vocabulary of codes that knows most of the names, if any is recognised.
    is_human : bool
        Whether the markers are on a person.
    is_animal : bool
        Whether they are on an animal with four legs.
    """

    parts: tuple[str, ...]
    sides: tuple[str, ...]
    stems: tuple[str, ...]
    vocabulary: str
    is_human: bool
    is_animal: bool

    @property
    def heights(self) -> Mapping[str, float]:
        """The usual heights of parts, relative to the stature."""
        if self.is_animal:
            return HEIGHTS_ON_FOUR_LEGS
        return HEIGHTS

    def role(self, m: int) -> str:
        """Return ``foot, ankle, body, boom, other`` or an empty string for a marker."""
        part = self.parts[m]
        if part in OF_A_FOOT:
            return "foot"
        if part in ("ankle", "boom", ""):
            return part
        if part in ("pelvis", "hip", "trunk"):
            return "body"
        return "other"

    def place(self, m: int) -> tuple[int, str]:
        """Return the rank of a place on a foot, heels first, and its sideless name."""
        ranks = {"heel": HEEL, "toe": TOE}
        return ranks.get(self.parts[m], ELSEWHERE), self.stems[m]

    def limb(self, m: int) -> str:
        """Return what the name of a marker calls an animal's limb, such as ``lf``."""
        if not self.is_animal:
            return ""
        of_limb = [word for word in self.stems[m].split() if word in LIMBS]
        return of_limb[0] if of_limb else ""

    def place_on_limb(self, m: int) -> tuple[int, str]:
        """Return the place of a marker on a foot, whichever limb the foot is of."""
        rank, stem = self.place(m)
        return rank, " ".join(word for word in stem.split() if word not in LIMBS)

    @property
    def settles_feet(self) -> bool:
        """Whether the names leave no doubt about which markers are on feet."""
        return (self.is_human or self.is_animal) and len(self.feet) > 1

    @property
    def feet(self) -> list[int]:
        """The markers named as parts of feet."""
        return [m for m, part in enumerate(self.parts) if part in OF_A_FOOT]


@cache
def _tables() -> tuple[dict[str, str], frozenset[str], dict[str, dict[str, str]]]:
    """Return the parts of words, the words of animals, and the vocabularies' codes."""
    place = resources.files("hopdata.recordings.quality").joinpath("vocabularies.toml")
    read = tomllib.loads(place.read_text(encoding="utf-8"))
    words: dict[str, str] = {}
    for part, listed in read["words"].items():
        for word in listed.split():
            words.setdefault(word, part)
    codes = {}
    for vocabulary, parts in read["codes"].items():
        codes[vocabulary] = {
            code.replace("_", ""): part
            for part, listed in parts.items()
            for code in listed.split()
        }
    return words, frozenset(read["animal"]["words"].split()), codes


@cache
def named_parts(markers: tuple[str, ...]) -> NamedParts:
    """Return the parts that the names of a file mean, taken together.

    Parameters
    ----------
    markers : tuple of str
        The M names, in the file's order.
    """
    _, animal_words, codes = _tables()
    own = _without_common_prefix([_own_name(name) for name in markers])
    candidates = [_stems(name) for name in own]
    known_by = _recognised(candidates, codes)
    parts = []
    sides = []
    stems = []
    for name, stems_of_name in zip(own, candidates, strict=True):
        part, stem = _part(name, stems_of_name, known_by)
        parts.append(part)
        stems.append(stem)
        sides.append(_side(name, stem, stems_of_name))
    words = {word for name in own for word in _words(name)}
    # Joints are called alike in people and animals.
    of_joints = all(vocabulary == "keypoints" for vocabulary, _ in known_by)
    is_animal = bool(words & (animal_words | LIMBS)) and of_joints
    of_people = {part for part in parts if part in _OF_PEOPLE}
    has_legs = bool({"knee", "shank"} & {*parts})
    of_bones = bool(words & _BONES_OF_PEOPLE) and has_legs
    is_whole = len(of_people) >= 3 or (len(of_people) == 2 and has_legs)
    is_human = not is_animal and (bool(known_by) or is_whole or of_bones)
    for m, name in enumerate(own):
        parts[m] = _alone(parts[m], name, is_human=is_human, is_animal=is_animal)
    if is_human:
        parts = [
            part or _VERTEBRAE.get(stem, "")
            for part, stem in zip(parts, stems, strict=True)
        ]
    # `LFOO` is on a foot, unless it is the origin of axes among `LFOA` and others.
    if "foa" in stems:
        parts = [
            "virtual" if stem == "foo" else part
            for part, stem in zip(parts, stems, strict=True)
        ]
    vocabulary = known_by[0][0] if known_by else ""
    return NamedParts(
        tuple(parts), tuple(sides), tuple(stems), vocabulary, is_human, is_animal
    )


def _own_name(name: str) -> str:
    """Return a name without its subject (`Anna:LTOE`) and the number of a copy."""
    name = name.rpartition(":")[2]
    return re.sub(r"\s+\d+$", "", name.strip())


def _words(name: str) -> list[str]:
    """Return the words of a name in lower case: `RightToeBase` has three."""
    return re.findall(r"[a-zà-ÿß]+", _spaced(name).lower())


def _stems(name: str) -> dict[str, str]:
    """Return what a name may be without its side, and that side."""
    compact = re.sub(r"[^a-z0-9à-ÿß]", "", name.lower())
    stems = {compact: ""}
    for side in _LONG_SIDES:
        if compact.startswith(side):
            stems.setdefault(compact.removeprefix(side), _SIDES[side])
        if compact.endswith(side):
            stems.setdefault(compact.removesuffix(side), _SIDES[side])
    for side in "lr":
        if compact.startswith(side):
            stems.setdefault(compact[1:], side)
        if re.search(f"(_|[a-z0-9]){side.upper()}$|[A-Z_. ]{side}$", name):
            stems.setdefault(compact[:-1], side)
    stems.pop("", None)
    return stems


def _recognised(
    candidates: list[dict[str, str]], codes: Mapping[str, Mapping[str, str]]
) -> list[tuple[str, Mapping[str, str]]]:
    """Return the vocabularies that know several of the names, the best first."""
    scores = []
    for vocabulary, parts_of_codes in codes.items():
        known = set()
        for stems in candidates:
            known |= set(stems) & set(parts_of_codes)
        parts = {parts_of_codes[code] for code in known}
        n_names = sum(bool(set(stems) & set(parts_of_codes)) for stems in candidates)
        if len(known) >= LEAST_CODES and len(parts) >= LEAST_PARTS:
            scores.append((-n_names, vocabulary))
    return [(vocabulary, codes[vocabulary]) for _, vocabulary in sorted(scores)]


def _part(
    name: str,
    stems: Mapping[str, str],
    known_by: list[tuple[str, Mapping[str, str]]],
) -> tuple[str, str]:
    """Return the part that a name means, and the name without its side."""
    # The first vocabulary knows most names; the others complete it.
    for _, parts_of_codes in known_by:
        for stem in sorted(stems, key=len):
            if stem in parts_of_codes:
                return parts_of_codes[stem], stem
    words, _, _ = _tables()
    sideless = [word for word in _words(name) if word not in _SIDES]
    found = []
    for word in sideless:
        for plain in (word, *_plainer(word)):
            if plain in words:
                found.append(words[plain])
                break
    for part in ("heel", "toe", "foot", "virtual", *HEIGHTS, "hand", "arm", "boom"):
        if part in found:
            _, place = place_by_name(_without_sides(name))
            return part, place
    shortest = min(stems, key=len, default=name)
    return "", shortest


def _without_sides(name: str) -> str:
    """Return a name without its side, in any language: `talon_droit`, `LFrontHoof`."""
    kept = []
    for word in re.findall(_WORD_AND_NUMBER, _spaced(name).lower()):
        letters = word.rstrip("0123456789")
        if letters in _SIDES:
            continue
        if letters[:1] in ("l", "r") and letters[1:] in _ENDS:
            word = word[1:]
        kept.append(word)
    return " ".join(kept)


def _spaced(name: str) -> str:
    """Return a name with a space before each capital letter that begins a word."""
    return re.sub(r"([a-zß-ÿ])([A-Z])", r"\1 \2", name)


def _plainer(word: str) -> list[str]:
    """Return a word without a side or `m` and `l` for medial and lateral."""
    if word in _WITHOUT_SIDE:
        return []
    plainer = [_LATERAL.sub("", word)]
    for side in ("l", "r", *_LONG_SIDES):
        if word.startswith(side) and len(word) > len(side) + 1:
            plainer.append(word.removeprefix(side))
            plainer.append(_LATERAL.sub("", word.removeprefix(side)))
        elif word.endswith(side) and len(side) > 1:
            plainer.append(word.removesuffix(side))
    return plainer


def _side(name: str, stem: str, stems: Mapping[str, str]) -> str:
    """Return the side that a name gives."""
    if stems.get(stem):
        return stems[stem]
    words_of_parts, _, _ = _tables()
    for word in _words(name):
        if len(word) != 2 and word in _SIDES:
            return _SIDES[word]
        if word in words_of_parts or word in _WITHOUT_SIDE:
            continue
        for side in ("l", "r", *_LONG_SIDES):
            rest = word.removeprefix(side)
            is_marked = word.startswith(side) and rest
            is_known = _LATERAL.sub("", rest) in words_of_parts or rest in _ENDS
            if is_marked and is_known:
                return _SIDES[side]
    return ""


def _alone(part: str, name: str, *, is_human: bool, is_animal: bool) -> str:
    """Return the part of a marker that the vocabularies do not know, by its name alone.

    A robot has no hands: its fingers, digits and tips are what it lands on. An animal's
    tail is no boom.
    """
    if is_animal and part == "boom":
        return "tail"
    if part and (is_human or part not in ("hand", "arm")):
        return part
    alone = part_by_name(name)
    if alone == "foot" and is_human and _OF_HANDS & set(_words(name)):
        return ""
    if alone == "body":
        return "trunk"
    return alone or part


def _without_common_prefix(names: list[str]) -> list[str]:
    """Drop what all names begin with up to a separator, such as a trial's number."""
    if len(names) < LEAST_CODES:
        return names
    first = min(names)
    last = max(names)
    n_common = 0
    while n_common < len(first) and first[: n_common + 1] == last[: n_common + 1]:
        n_common += 1
    length = max(first[:n_common].rfind(mark) for mark in "_:-. ") + 1
    # `L_` may be common to the markers of one leg.
    if length <= len("left_"):
        return names
    return [name[length:] for name in names]
