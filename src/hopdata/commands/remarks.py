"""Remarks on the recordings of a study; what is true of many files is told once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Number
from pathlib import Path

from hopdata.errors import counted
from hopdata.messages import Message

#: Files of a folder from which on a remark on each is told once.
#: Unit: files. Origin: chosen: two lines are read as soon as one on both.
LEAST_FILES = 3

# Files that such a remark names.
MOST_NAMED = 3


@dataclass(frozen=True)
class Remark:
    """What should be known of a recording.

    Parameters
    ----------
    place
        File of the recording; what else names it has no folder to share.
    text
        The remark, which may begin with the place.
    """

    place: str
    text: str | Message

    def __str__(self) -> str:
        if not self.place:
            return self.words
        return f"{self.place}: {self.words}"

    @property
    def words(self) -> str:
        """The remark in words, without the place that these may begin with."""
        return str(self.text).removeprefix(f"{self.place}: ")

    @property
    def _kind(self) -> tuple[Path, object]:
        """Return what is the same in remarks that are alike."""
        return Path(self.place).parent, _kind_of(self.text, self.place)


def _kind_of(value: object, place: str) -> object:
    """Return what is the same in values that are alike: all but numbers and files.

    Words are alike if they are the same, and messages if their codes are and the values
    that are neither numbers nor the remark's own file.
    """
    if isinstance(value, Message):
        of_values = [
            (name, _kind_of(one, place)) for name, one in sorted(value.values.items())
        ]
        return value.code, tuple(of_values)
    if isinstance(value, Number):
        return Number
    text = str(value)
    if text in (place, Path(place).name):
        return Path
    return text


def told_together(remarks: Sequence[Remark]) -> list[str]:
    """Return remarks in words, with one for all files of a folder that it is true of.

    Remarks that differ only in the numbers of their messages are alike; the numbers
    told are then those of the first file.
    """
    alike: dict[tuple[Path, object], list[Remark]] = {}
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
    if len({remark.words for remark in remarks}) > 1:
        code = "commands.of_many_files_in_numbers"
    values = {
        "files": f"{number} of {folder} ({', '.join(names)})",
        "text": remarks[0].words,
    }
    return str(Message(code, values))
