"""Parameter section of a C3D file: groups of named numbers and texts.

The layout follows the C3D user guide (c3d.org), "The parameter section". Every length
is checked against the section before use, so that a file cannot make the reader run
away.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError, mismatch
from hopdata.recording import Event
from hopdata.recordings.readers.text import decoded

# Numbers in a C3D file, in the three byte orders of the format.


@dataclass(frozen=True)
class Processor:
    """Type of computer whose number format a C3D file uses.

    Parameters
    ----------
    name : str
        ``"Intel"``, ``"DEC"`` or ``"MIPS"``.
    order : {"<", ">"}
        Byte order of integers, in NumPy's notation.
    """

    name: str
    order: str

    def whole(self, data: bytes | NDArray[np.uint8]) -> NDArray[np.int16]:
        """Decode signed 16-bit integers."""
        return np.frombuffer(data, dtype=f"{self.order}i2").astype(np.int16)

    def floats(self, data: bytes | NDArray[np.uint8]) -> NDArray[np.float32]:
        """Decode 32-bit floats; DEC floats have their halves exchanged."""
        raw = np.frombuffer(data, dtype=np.uint8)
        if self.name != "DEC":
            return raw.view(f"{self.order}f4")
        swapped = raw.view("<u2").reshape(-1, 2)[:, ::-1].copy().view("<f4").reshape(-1)
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            quarter: NDArray[np.float32] = (swapped / np.float32(4)).astype(np.float32)
        return quarter


# Keyed by the number at the start of the file's parameter section.
PROCESSORS = {
    84: Processor("Intel", "<"),
    85: Processor("DEC", "<"),
    86: Processor("MIPS", ">"),
}


def unsigned(value: float) -> int:
    """Return a count whose 16 bits may have been read as signed."""
    return int(value) + (65536 if value < 0 else 0)


BLOCK = 512  # bytes; all sections begin at a multiple of this
_WIDTH = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes per element: text, byte, integer, float


@dataclass
class Parameters:
    """Parameters by group and name, both in upper case, and their places in the file."""

    path: Path
    processor: Processor
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def place(self, group: str, name: str) -> str:
        """Return file and parameter, for messages."""
        return f"{self.path}: {group}:{name}"

    def number(self, group: str, name: str) -> float | None:
        """Return the first number of a parameter; None if it is absent or empty.

        Raises
        ------
        RecordingError
            If it is text.
        """
        numbers = self.numbers(group, name)
        return numbers[0] if numbers else None

    def numbers(self, group: str, name: str) -> list[float]:
        """Return all numbers of a parameter and its continuations (``SCALE2`` ...); none if absent.

        Raises
        ------
        RecordingError
            If it is text.
        """
        return [float(x) for value in self._all(group, name, np.ndarray) for x in value]

    def unsigned_numbers(self, group: str, name: str) -> list[float]:
        """Return all numbers of a parameter whose 16-bit words are unsigned, as `numbers` does.

        Whole numbers are decoded as signed, so 32768 comes as -32768. Floats keep their
        sign.
        """
        found: list[float] = []
        for values in self._all(group, name, np.ndarray):
            is_word = values.dtype == np.int16
            found += [unsigned(x) if is_word else float(x) for x in values]
        return found

    def texts(self, group: str, name: str) -> list[str]:
        """Return all texts of a parameter and its continuations (``LABELS2`` ...); none if absent.

        Raises
        ------
        RecordingError
            If it is a number.
        """
        return [text for value in self._all(group, name, list) for text in value]

    def _all(self, group: str, name: str, kind: type) -> Iterator[Any]:
        """Yield the values of a parameter and its continuations, which must be of one kind."""
        named = self.groups.get(group, {})
        for key in [name, *(f"{name}{i}" for i in range(2, len(named) + 2))]:
            if key not in named:
                return
            if not isinstance(named[key], kind):
                told = ("text", "numbers") if kind is list else ("numbers", "text")
                raise RecordingError.at(self.place(group, key), told[0], told[1])
            yield named[key]


def read_parameters(path: Path, section: bytes, offset: int) -> Parameters:
    """Read the parameter section.

    Parameters
    ----------
    path : path
        The file, for messages.
    section : bytes
        The file from the first byte of the section on.
    offset : int
        Place of that byte in the file.

    Raises
    ------
    RecordingError
        If a record reaches beyond the section.
    """
    if len(section) < 4:
        wanted = "the parameter section"
        raise RecordingError.at(f"{path}, byte {offset}", wanted, "the end of the file")
    processor = PROCESSORS.get(section[3])
    if processor is None:
        wanted = "the processor type 84, 85 or 86"
        raise RecordingError.at(f"{path}, byte {offset + 3}", wanted, section[3])
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
            place = f"{path}, byte {offset + start}: parameter {name}"
            told = mismatch(place, "the type -1, 1, 2 or 4", f"{kind}; it is left out")
            parameters.remarks += (told,)
    for number, name, value in found:
        if number not in names:
            told = mismatch(
                f"{path}: parameter {name}",
                f"a group of number {number}",
                "none; it is left out",
            )
            parameters.remarks += (told,)
            continue
        parameters.groups.setdefault(names[number], {})[name] = value
    return parameters


@dataclass(frozen=True)
class _Section:
    """The bytes of the section and their place in the file."""

    path: Path
    data: bytes
    offset: int
    processor: Processor

    def records(self) -> Iterator[tuple[int, str, int]]:
        """Yield the group's number (negative for the group itself), name and start of content."""
        at = 4
        while at + 2 <= len(self.data) and self.data[at]:
            length, number = np.frombuffer(self.data, np.int8, 2, at).tolist()
            name = decoded(self.take(at + 2, abs(length))).strip().upper()
            after = at + 2 + abs(length)
            step = unsigned(self.processor.whole(self.take(after, 2))[0])
            yield number, name, after + 2
            if step == 0:
                return
            if step < 2:
                raise self.fault(
                    after, f"the distance to the next record, found {step}"
                )
            at = after + self.distance(number, after + 2, step)

    def distance(self, number: int, content: int, step: int) -> int:
        """Return the distance to the next record, of which the file states the lower 16 bits.

        A parameter of more than 65,535 bytes is known by its own lengths, which then
        agree with the stated distance but for a multiple of 65,536.
        """
        if number < 0 or self.kind(content) not in _WIDTH:
            return step
        n_dimensions = self.take(content + 1, 1)[0]
        sizes = self.take(content + 2, n_dimensions)
        n_bytes = prod(sizes) * _WIDTH[self.kind(content)]
        description_at = content + 2 + n_dimensions + n_bytes
        if n_bytes <= MOST_16_BIT or description_at >= len(self.data):
            return step
        whole = description_at + 1 + self.data[description_at] - (content - 2)
        return whole if whole % 65536 == step else step

    def kind(self, at: int) -> int:
        """Return the type of a parameter."""
        return int(np.frombuffer(self.take(at, 1), np.int8)[0])

    def value(self, at: int) -> Any:
        """Return a parameter: an array of its numbers or a list of its texts."""
        kind, n_dimensions = self.kind(at), self.take(at + 1, 1)[0]
        sizes = list(self.take(at + 2, n_dimensions))
        data = self.take(at + 2 + n_dimensions, prod(sizes) * _WIDTH[kind])
        if kind == -1:
            width = sizes[0] if sizes else 1
            pieces = range(0, len(data), width) if width else []
            return [
                decoded(data[i : i + width].split(b"\0")[0]).strip(" ") for i in pieces
            ]
        if kind == 1:
            return np.frombuffer(data, dtype=np.int8)
        return self.processor.whole(data) if kind == 2 else self.processor.floats(data)

    def take(self, at: int, length: int) -> bytes:
        """Return the requested bytes of the section; raise an error if it is too short."""
        if at + length > len(self.data):
            raise self.fault(
                at, f"{length} bytes of a parameter, found the end of the section"
            )
        return self.data[at : at + length]

    def fault(self, at: int, what: str) -> RecordingError:
        return RecordingError(f"{self.path}, byte {self.offset + at}: expected {what}")


# First block of a C3D file, and the number of frames that the file really holds.

MOST_16_BIT = 65535
_EVENT_KEY = 12345  # in word 150: events with four-letter labels follow
_MOST_EVENTS = 18


@dataclass(frozen=True)
class C3dHeader:
    """Contents of the header, before any check.

    Each frame holds ``n_points`` markers and ``n_analog`` analog numbers. ``first`` and
    ``last`` are frame numbers. Data begin at byte ``data_start``, as floats if
    ``scale`` is negative.
    """

    n_points: int
    n_analog: int
    first: int
    last: int
    scale: float
    data_start: int
    rate_hz: float
    events: tuple[Event, ...]

    @property
    def frame_bytes(self) -> int:
        """Return the number of bytes per frame."""
        return (4 * self.n_points + self.n_analog) * (4 if self.scale < 0 else 2)


def parameter_start(path: Path, block: bytes) -> int:
    """Return the byte at which the parameter section starts.

    Raises
    ------
    RecordingError
        If this is not a C3D file.
    """
    if not block:
        raise RecordingError.at(path, "a C3D file", "an empty file")
    if len(block) < BLOCK or block[1] != 0x50:
        found = f"{len(block)} bytes" if len(block) < BLOCK else f"{block[1]:#04x}"
        wanted = f"a C3D file (0x50 in a header of {BLOCK} bytes)"
        raise RecordingError.at(f"{path}, byte 1", wanted, found)
    if block[0] < 2:
        raise RecordingError.at(
            f"{path}, byte 0", "the parameters in block 2 or later", block[0]
        )
    return (block[0] - 1) * BLOCK


def read_c3d_header(block: bytes, processor: Processor) -> C3dHeader:
    """Decode the header block (512 bytes)."""
    words = processor.whole(block)
    n_points, n_analog, first, last = map(unsigned, words[1:5])
    scale, rate_hz = (float(processor.floats(block[k : k + 4])[0]) for k in (12, 20))
    start, events = (unsigned(words[8]) - 1) * BLOCK, _events(block, processor)
    return C3dHeader(n_points, n_analog, first, last, scale, start, rate_hz, events)


def with_stated_start(header: C3dHeader, parameters: Parameters) -> C3dHeader:
    """Return the header with the start of the data from ``POINT:DATA_START``, if it has one."""
    stated = parameters.unsigned_numbers("POINT", "DATA_START")[:1]
    if not stated or not isfinite(stated[0]):
        return header
    return replace(header, data_start=(int(stated[0]) - 1) * BLOCK)


def settle_points(
    header: C3dHeader, parameters: Parameters, available: int
) -> tuple[C3dHeader, tuple[str, ...]]:
    """Return the header with the number of points that fits the file's size, and remarks.

    Header and ``POINT:USED`` both state it. Where they differ, the frames of only one
    of them may fill the file to the block.

    Raises
    ------
    RecordingError
        If they differ and neither or both fit.
    """
    stated = parameters.number("POINT", "USED")
    if stated is None or stated % 65536 == header.n_points or not isfinite(stated):
        return header, ()
    place = parameters.place("POINT", "USED")
    other = replace(header, n_points=int(stated % 65536))
    fitting = [one for one in (header, other) if _fits(one, parameters, available)]
    if len(fitting) != 1:
        raise RecordingError.at(
            place, f"{header.n_points} as in the header", f"{stated:g}"
        )
    (right,) = fitting
    wanted = f"{header.n_points} points as in the header"
    found = f"{stated:g}; {right.n_points} fit the size of the file and are read"
    return right, (mismatch(place, wanted, found),)


def _fits(header: C3dHeader, parameters: Parameters, available: int) -> bool:
    """Tell whether the stated frames, with this number of points, fill the file."""
    if not header.frame_bytes:
        return False
    try:
        count_frames(header, parameters, available)
    except RecordingError:
        return False
    return True


def first_frame(header: C3dHeader, parameters: Parameters) -> int:
    """Return the number of the first frame; long recordings store it in two words of ``TRIAL``."""
    return _two_words(parameters, "ACTUAL_START_FIELD") or header.first


def count_frames(
    header: C3dHeader, parameters: Parameters, available: int
) -> tuple[int, tuple[str, ...]]:
    """Find the number of frames on which the file's claims and its size agree.

    Header and ``POINT:FRAMES`` have 16 bits and cannot count beyond 65,535, so a claim
    at that limit or wrapped around is not a contradiction. The other claims must fit
    the bytes present, to the block.

    Parameters
    ----------
    header, parameters
        Counts stated by the file.
    available : int
        Bytes from the start of the data to the end of the file.

    Returns
    -------
    n_frames : int
    remarks : tuple of str
        Claims that contradict the valid one, or frames that are lacking in the last
        block.

    Raises
    ------
    RecordingError
        If no claim fits the file's size, or there are no frames.
    """
    claims = _claims(header, parameters)
    most = available // header.frame_bytes
    # Some writers pad the last block; others add a whole block if it is full.
    possible = range(
        most, max(0, -(-(available - BLOCK) // header.frame_bytes) - 1), -1
    )
    fitting = [n for n in claims.values() if n in possible]
    wrapped = [
        n
        for n in possible
        if all(_is_full(c) or c == n % 65536 for c in claims.values())
    ]
    if most and _lacks_a_block(claims, header, available):
        told = f"{min(claims.values()):g} frames are stated, the file ends within one block of them"
        return most, (f"{parameters.path}: {told}; the {most} that are whole are read",)
    if not claims or not (fitting or wrapped):
        told = ", ".join(f"{claim:g} ({name})" for name, claim in claims.items())
        cut = (
            "; was the file cut short?"
            if all(claim > most for claim in claims.values())
            else ""
        )
        wanted = f"{told} of {header.frame_bytes} bytes each"
        found = f"room for {most} after byte {header.data_start}{cut}"
        raise RecordingError.at(f"{parameters.path}: frames", wanted, found)
    n = int((fitting or wrapped)[0])
    remarks = [
        f"{parameters.path}: {name} says {claim:g} frames, the file holds {n}"
        for name, claim in claims.items()
        if claim != n and not (n > claim and _is_16_bit(claim, n))
    ]
    if not fitting:
        remarks.append(
            f"{parameters.path}: {n} frames counted from the size of the file"
        )
    return n, tuple(remarks)


def _lacks_a_block(claims: dict[str, float], header: C3dHeader, available: int) -> bool:
    """Tell whether the last block of the stated frames was not written, as some programs do."""
    stated = set(claims.values())
    if len(stated) != 1 or not isfinite(min(stated)):
        return False
    lacking = min(stated) * header.frame_bytes - available
    return 0 < lacking <= BLOCK


def _claims(header: C3dHeader, parameters: Parameters) -> dict[str, float]:
    """Return the numbers of frames by place in the file, the most trustworthy first."""
    claims: dict[str, float] = {}
    last = _two_words(parameters, "ACTUAL_END_FIELD")
    if last:
        claims["TRIAL:ACTUAL_END_FIELD"] = last - first_frame(header, parameters) + 1
    for name in ("LONG_FRAMES", "FRAMES"):
        stated = parameters.number("POINT", name)
        if stated is not None and isfinite(stated):
            claims[f"POINT:{name}"] = unsigned(stated) if stated > -32769 else stated
    if (
        header.last < MOST_16_BIT or not claims
    ):  # a saturated last frame says nothing beside others
        full = header.last == MOST_16_BIT
        claims["header"] = MOST_16_BIT if full else header.last - header.first + 1
    return claims


def _two_words(parameters: Parameters, name: str) -> int:
    """Return the integer in two 16-bit words of ``TRIAL``, low word first; 0 if absent."""
    words = parameters.numbers("TRIAL", name)
    if len(words) != 2 or not all(abs(word) <= MOST_16_BIT for word in words):
        return 0
    return unsigned(words[0]) + 65536 * unsigned(words[1])


def _is_full(claim: float) -> bool:
    return claim in (MOST_16_BIT, -1)


def _is_16_bit(claim: float, n: float) -> bool:
    return n > MOST_16_BIT and (
        _is_full(claim) or claim == n % 65536 or claim == n % 65536 - 65536
    )


def _events(block: bytes, processor: Processor) -> tuple[Event, ...]:
    """Return the events of the header, whose labels have four letters."""
    words = processor.whole(block[298:302])
    if words[0] != _EVENT_KEY or not 0 < words[1] <= _MOST_EVENTS:
        return ()
    times = processor.floats(block[304:376])[: words[1]]
    labels = [
        decoded(block[396 + 4 * i : 400 + 4 * i]).strip(" \0") for i in range(words[1])
    ]
    return tuple(Event(label, float(t)) for label, t in zip(labels, times, strict=True))
