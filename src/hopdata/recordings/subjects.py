"""Which subject each file of a folder belongs to, and what that is read from.

The file itself may name its subject, its folder or the beginning of its name may. Of
sources that tell several subjects apart the most explicit one is taken; if another one
divides the files differently, that is said.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from hopdata.messages import Message

# Words that name what is done or stored, not who does it.
_NO_NAMES = frozenset(
    (
        *("walk", "walking", "run", "running", "jump", "jumping", "hop", "hopping"),
        *("gait", "sprint", "squat", "land", "landing", "drop", "cmj", "dj", "sj"),
        *("stand", "standing", "static", "stat", "calibration", "calib", "cal", "rom"),
        *(
            "trial",
            "take",
            "test",
            "task",
            "rec",
            "recording",
            "capture",
            "measurement",
        ),
        *("trc", "csv", "tsv", "mat", "raw", "data", "mocap", "markers", "marker"),
        *("session", "ses", "day", "visit", "block", "motion", "export", "exports"),
        *("treadmill", "overground", "turn", "step", "stairs", "slow", "fast"),
        *("gang", "gehen", "laufen", "lauf", "sprung", "stehen", "statisch"),
        *("marche", "course", "saut", "statique", "essai"),
        *("salto", "corrida", "marcha", "estatico"),
    )
)

# Words that say that a subject follows.
_SUBJECT = r"(?:s|sub|subj|subject|p|pp|part|participant|pat|patient|vp|proband|suj|id)"
_BIDS = re.compile(r"(?:^|[/_])sub-([A-Za-z0-9]+)")
_BIDS_SESSION = re.compile(r"(?:^|[/_])ses-([A-Za-z0-9]+)")
_EXPLICIT = re.compile(rf"{_SUBJECT}[-_ ]?\d+", re.IGNORECASE)
_NUMBERED = re.compile(r"([^\W\d_]+[-_ ]?\d+)(?=[^\d])")
_FIRST_WORD = re.compile(r"([^-_ .]+)[-_ .]")
_DATE = re.compile(r"(19|20)\d\d[-_.]?\d\d[-_.]?\d\d.*")

# Names of a subject that programs write if nobody gave one.
_PLACEHOLDERS = frozenset(("subject", "patient", "default", "unknown", "new subject"))


@dataclass(frozen=True)
class Subjects:
    """The subject of each file.

    Parameters
    ----------
    names, sessions : tuple of str
        Subject and session of each file; sessions may be empty.
    reason : Message
        What the subjects are read from.
    doubt : Message, optional
        What else they might be.
    """

    names: tuple[str, ...]
    sessions: tuple[str, ...]
    reason: Message
    doubt: Message | None = None

    @property
    def distinct(self) -> list[str]:
        """Return each subject once, in the order of the files."""
        return list(dict.fromkeys(self.names))


@dataclass(frozen=True)
class Source:
    """A way to tell subjects apart, and whether it is explicit."""

    code: str
    names: tuple[str, ...]
    is_explicit: bool = True

    @property
    def tells(self) -> bool:
        """Whether it names a subject for each file, and several of them."""
        return all(self.names) and len(set(self.names)) > 1

    def divides_as(self, other: "Source") -> bool:
        """Tell whether it divides the files into the same groups."""
        pairs = set(zip(self.names, other.names, strict=True))
        return len(pairs) == len(set(self.names)) == len(set(other.names))


def tell_subjects(files: Sequence[PurePath], stated: Sequence[str]) -> Subjects:
    """Tell the subjects of files apart.

    Parameters
    ----------
    files : sequence of path
        Each relative to the folder that was given.
    stated : sequence of str
        The subject that each file states; empty if it states none.
    """
    places = [file.as_posix() for file in files]
    sessions = tuple(_found(_BIDS_SESSION, place) for place in places)
    named = tuple(name if _is_a_name(name) else "" for name in stated)
    sources = [
        Source(
            "recordings.subjects_by_bids",
            tuple(_found(_BIDS, place) for place in places),
        ),
        Source("recordings.subjects_stated", _alike(named)),
        Source("recordings.subjects_by_folder", _folders(files)),
        _prefixes(files),
    ]
    telling = [source for source in sources if source.tells]
    if not telling:
        only = next((name for name in named if name), "")
        reason = Message("recordings.subjects_one")
        return Subjects(tuple(only for _ in files), sessions, reason)
    chosen = telling[0]
    values = {"number": len(set(chosen.names))}
    reason = Message(chosen.code, values)
    doubt = None
    others = [source for source in telling[1:] if not source.divides_as(chosen)]
    if others:
        values = {"number": len(set(others[0].names))}
        doubt = Message(others[0].code, values)
    elif not chosen.is_explicit and len(telling) == 1:
        doubt = Message("recordings.subjects_one")
    return Subjects(chosen.names, sessions, reason, doubt)


def _found(pattern: re.Pattern[str], place: str) -> str:
    found = pattern.search(place)
    return found.group(1) if found else ""


def _is_a_name(text: str) -> bool:
    return bool(text) and text.strip().casefold() not in _PLACEHOLDERS


def _alike(names: Sequence[str]) -> tuple[str, ...]:
    """Return names with one spelling for those that differ only in case."""
    spelling: dict[str, str] = {}
    return tuple(spelling.setdefault(name.casefold(), name) for name in names)


def _folders(files: Sequence[PurePath]) -> tuple[str, ...]:
    """Return the folder of each file at the first level that may name subjects."""
    deepest = min((len(file.parts) - 1 for file in files), default=0)
    for level in range(deepest):
        names = [file.parts[level] for file in files]
        if len(set(names)) > 1 and all(map(_names_somebody, names)):
            return _alike(names)
    return tuple("" for _ in files)


def _names_somebody(text: str) -> bool:
    """Tell whether a word may name a subject, and no deed, format or date."""
    word = re.sub(r"[\W\d_]+", "", text).casefold()
    return word not in _NO_NAMES and not _DATE.fullmatch(text)


def _prefixes(files: Sequence[PurePath]) -> Source:
    """Return the beginning of each file's name that may name its subject."""
    stems = [file.stem for file in files]
    explicit = _beginnings(stems, _EXPLICIT.match)
    if all(explicit):
        return Source("recordings.subjects_by_prefix", _alike(explicit))
    code = "recordings.subjects_by_prefix"
    for pattern in (_NUMBERED, _FIRST_WORD):
        names = _alike(_beginnings(stems, pattern.match))
        # A number of a trial, unlike one of a subject, occurs once.
        recurs = len(set(names)) * 2 <= len(names)
        if all(names) and recurs and all(map(_names_somebody, names)):
            return Source(code, names, is_explicit=False)
    return Source(code, tuple("" for _ in files), is_explicit=False)


def _beginnings(
    stems: Sequence[str], matched: Callable[[str], re.Match[str] | None]
) -> list[str]:
    found = [matched(stem) for stem in stems]
    return [one.group().strip("-_ .") if one else "" for one in found]
