"""Contact events as all formats take them: what is written, and under which names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hopdata.errors import HopdataError

# The label of a contact, as the laboratory programs of Vicon name it.
FOOT_STRIKE = "Foot Strike"

# Contexts of events in these programs, by the side of the foot.
CONTEXTS = {"left": "Left", "right": "Right", "": "General"}


@dataclass(frozen=True)
class ContactEvent:
    """One contact.

    Parameters
    ----------
    time_s : float
        On the clock of the file, s.
    foot, side : str
        The foot and its side, ``left``, ``right`` or empty.
    se_s : float
        Standard error of the instant, s.
    landing : int
        Number of the landing, from 1.
    """

    time_s: float
    foot: str
    side: str
    se_s: float
    landing: int

    @property
    def context(self) -> str:
        """Return the context of the event, as Vicon's programs name it."""
        return CONTEXTS[self.side]


def labels(events: Sequence[ContactEvent]) -> list[str]:
    """Return a label for each event: that of the field, and whose foot it was.

    A foot of a side is named by the event's context; where a side has several feet, or
    none is known, the label names the foot.
    """
    feet_of_side = Counter(side for side, _ in {(one.side, one.foot) for one in events})
    found = []
    for event in events:
        is_told = bool(event.side) and feet_of_side[event.side] == 1
        if is_told:
            found.append(FOOT_STRIKE)
        else:
            found.append(f"{FOOT_STRIKE} {event.foot}")
    return found


def require_new(path: Path, sources: Sequence[Path], *, replace: bool = False) -> None:
    """Refuse to write over a recording, and over any file that is there.

    Parameters
    ----------
    path : path
        The file to be written.
    sources : sequence of path
        The recordings that were read; they are never written over.
    replace : bool
        Whether a file of this name that is no recording may be replaced.

    Raises
    ------
    HopdataError
        If the file must not be written.
    """
    is_source = any(path.resolve() == one.resolve() for one in sources)
    if is_source:
        raise HopdataError.at(path, "another name", "that of a recording that was read")
    if path.exists() and not replace:
        wanted = "no such file yet"
        raise HopdataError.at(path, wanted, "one; --force replaces it")
