"""Remarks on the recordings of a study; what is true of many files is told once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hopdata.errors import counted
from hopdata.messages import Message

#: Files of a folder from which on a remark on each is told once.
#: Unit: files. Origin: chosen: two lines are read as soon as one on both.
LEAST_FILES = 3

# Files that such a remark names.
MOST_NAMED = 3

# What may differ between remarks that are alike.
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class Remark:
    """What should be known of a recording.

    Parameters
    ----------
    place
        File of the recording; what else names it has no folder to share.
    text
        The remark, without the place.
    """

    place: str
    text: str

    def __str__(self) -> str:
        if not self.place:
            return self.text
        return f"{self.place}: {self.text}"

    @property
    def _kind(self) -> tuple[Path, str]:
        """Return what is the same in remarks that are alike."""
        return Path(self.place).parent, _NUMBER.sub("#", self.text)

    @classmethod
    def of(cls, place: str, text: str) -> Remark:
        """Return a remark whose text may begin with the place."""
        return cls(place, text.removeprefix(f"{place}: "))


def told_together(remarks: Sequence[Remark]) -> list[str]:
    """Return remarks in words, with one for all files of a folder that it is true of.

    Remarks that differ only in their numbers are alike; the numbers told are then those
    of the first file.
    """
    alike: dict[tuple[Path, str], list[Remark]] = {}
    for remark in remarks:
        alike.setdefault(remark._kind, []).append(remark)
    told = []
    for of_kind in alike.values():
        places = list(dict.fromkeys(remark.place for remark in of_kind))
        if len(places) < LEAST_FILES:
            told += [str(remark) for remark in of_kind]
        else:
            told.append(_of_many(of_kind, places))
    return told


def _of_many(remarks: Sequence[Remark], places: Sequence[str]) -> str:
    """Return one remark on several files of a folder."""
    names = [Path(place).name for place in places[:MOST_NAMED]]
    if len(places) > MOST_NAMED:
        names.append(f"{len(places) - MOST_NAMED} more")
    folder = Path(places[0]).parent
    number = counted(len(places), "file")
    code = "commands.of_many_files"
    if len({remark.text for remark in remarks}) > 1:
        code = "commands.of_many_files_in_numbers"
    values = {
        "files": f"{number} of {folder} ({', '.join(names)})",
        "text": remarks[0].text,
    }
    return str(Message(code, values))
