"""The parameter section of a C3D file: groups of named numbers and texts.

Layout after the C3D user guide (c3d.org), "The parameter section". Every length in it is checked
against the section before it is used, so that a file cannot make the reader run away.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.c3d_numbers import PROCESSORS, Processor

BLOCK = 512  # bytes; all sections begin at a multiple of it
_WIDTH = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes of an element: text, byte, whole number, float


@dataclass
class Parameters:
    """Parameters by group and name, both in upper case, and where they stand in the file."""

    path: Path
    processor: Processor
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def place(self, group: str, name: str) -> str:
        """File and parameter, for messages."""
        return f"{self.path}: {group}:{name}"

    def number(self, group: str, name: str) -> float | None:
        """First number of a parameter; None if it is absent or empty.

        Raises
        ------
        RecordingError
            If it is text.
        """
        numbers = self.numbers(group, name)
        return numbers[0] if numbers else None

    def numbers(self, group: str, name: str) -> list[float]:
        """All numbers of a parameter and of its continuations (``SCALE2`` ...), none if absent.

        Raises
        ------
        RecordingError
            If it is text.
        """
        return [float(x) for value in self._all(group, name, np.ndarray) for x in value]

    def texts(self, group: str, name: str) -> list[str]:
        """All texts of a parameter and of its continuations (``LABELS2`` ...), none if absent.

        Raises
        ------
        RecordingError
            If it is a number.
        """
        return [text for value in self._all(group, name, list) for text in value]

    def _all(self, group: str, name: str, kind: type) -> Iterator[Any]:
        """Yield the values of a parameter and of its continuations, which are of one kind."""
        named = self.groups.get(group, {})
        for key in [name, *(f"{name}{i}" for i in range(2, len(named) + 2))]:
            if key not in named:
                return
            if not isinstance(named[key], kind):
                told = ("text", "numbers") if kind is list else ("numbers", "text")
                raise RecordingError(
                    f"{self.place(group, key)}: expected {told[0]}, found {told[1]}"
                )
            yield named[key]

    def near(self, group: str, name: str) -> str:
        """Hint at a parameter of a similar name."""
        return did_you_mean(name, self.groups.get(group, {}))


def read_parameters(path: Path, section: bytes, offset: int) -> Parameters:
    """Read the parameter section.

    Parameters
    ----------
    path : path
        The file, for messages.
    section : bytes
        The file from the section's first byte on.
    offset : int
        Where in the file that is.

    Raises
    ------
    RecordingError
        If a record reaches beyond the section.
    """
    if len(section) < 4:
        raise RecordingError(
            f"{path}, byte {offset}: expected the parameter section, found the end of the file"
        )
    processor = PROCESSORS.get(section[3])
    if processor is None:
        raise RecordingError(
            f"{path}, byte {offset + 3}: expected the processor type 84, 85 or 86, "
            f"found {section[3]}"
        )
    parameters = Parameters(path, processor)
    source = _Section(path, section, offset, processor)
    names: dict[int, str] = {}
    found: list[tuple[int, str, Any]] = []
    for number, name, start in source.records():
        if number < 0:
            names[-number] = name
        elif (kind := source.kind(start)) in _WIDTH:
            found.append((number, name, source.value(start)))
        else:
            parameters.remarks += (
                f"{path}, byte {offset + start}: parameter {name}: expected the type -1, 1, 2 or "
                f"4, found {kind}; it is left out",
            )
    for number, name, value in found:
        if number not in names:
            raise RecordingError(
                f"{path}: parameter {name}: expected a group of number {number}, found none"
            )
        parameters.groups.setdefault(names[number], {})[name] = value
    return parameters


@dataclass(frozen=True)
class _Section:
    """The bytes of the section, and where they stand in the file."""

    path: Path
    data: bytes
    offset: int
    processor: Processor

    def records(self) -> Iterator[tuple[int, str, int]]:
        """Yield the group's number (negative for a group itself), name and start of content."""
        at = 4
        while at + 2 <= len(self.data) and self.data[at]:
            length = abs(_signed(self.data[at]))
            number = _signed(self.data[at + 1])
            name = decoded(self.take(at + 2, length)).strip().upper()
            after = at + 2 + length
            step = self.processor.whole(self.take(after, 2))[0]
            yield number, name, after + 2
            if step == 0:
                return
            if step < 2:
                raise self.fault(after, f"the distance to the next record, found {step}")
            at = after + int(step)

    def kind(self, at: int) -> int:
        """Type of a parameter."""
        return _signed(self.take(at, 1)[0])

    def value(self, at: int) -> Any:
        """Value of a parameter: an array of its numbers or a list of its texts."""
        kind, n_dimensions = self.kind(at), self.take(at + 1, 1)[0]
        sizes = list(self.take(at + 2, n_dimensions))
        data = self.take(at + 2 + n_dimensions, prod(sizes) * _WIDTH[kind])
        if kind == -1:
            width = sizes[0] if sizes else 1
            pieces = range(0, len(data), width) if width else []
            return [decoded(data[i : i + width].split(b"\0")[0]).strip(" ") for i in pieces]
        if kind == 1:
            return np.frombuffer(data, dtype=np.int8)
        return self.processor.whole(data) if kind == 2 else self.processor.floats(data)

    def take(self, at: int, length: int) -> bytes:
        """Bytes of the section, all of them."""
        if at + length > len(self.data):
            raise self.fault(at, f"{length} bytes of a parameter, found the end of the section")
        return self.data[at : at + length]

    def fault(self, at: int, what: str) -> RecordingError:
        return RecordingError(f"{self.path}, byte {self.offset + at}: expected {what}")


def decoded(data: bytes) -> str:
    """Text of a file, which may be older than UTF-8."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte
