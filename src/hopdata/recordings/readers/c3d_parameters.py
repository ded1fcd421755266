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
        halves = raw.view("<u2").reshape(-1, 2)
        swapped = halves[:, ::-1].copy().view("<f4").reshape(-1)
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
    return int(value) + (WORDS if value < 0 else 0)


# Bytes of a block; all sections begin at a multiple of this.
BLOCK = 512

# Values of a 16-bit word, and the largest that has no sign.
WORDS = 65536
MOST_16_BIT = 65535

# Types of parameters, and the bytes that an element of each takes.
TEXT = -1
BYTE = 1
WHOLE = 2
FLOAT = 4
_MOST_COUNTED = 2**31  # no file counts more of anything
_WIDTH = {TEXT: 1, BYTE: 1, WHOLE: 2, FLOAT: 4}


@dataclass
class Parameters:
    """Parameters by group and name, both in upper case, and their places in the file.

    A parameter may be continued in others, such as ``LABELS2`` after ``LABELS``.
    `sizes` are the dimensions of each; the first of them runs fastest in `groups`.
    """

    path: Path
    processor: Processor
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    sizes: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)

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

    def count(self, group: str, name: str) -> int:
        """Return a parameter that counts; 0 if it is absent or empty.

        Raises
        ------
        RecordingError
            If it is text, negative, or not whole.
        """
        stated = self.number(group, name)
        if stated is None:
            return 0
        if not (0 <= stated <= _MOST_COUNTED and stated == int(stated)):
            raise RecordingError.at(self.place(group, name), "a count", f"{stated:g}")
        return int(stated)

    def numbers(self, group: str, name: str) -> list[float]:
        """Return all numbers of a parameter and its continuations; none if absent.

        Raises
        ------
        RecordingError
            If it is text.
        """
        return [float(x) for value in self._all(group, name, np.ndarray) for x in value]

    def unsigned_numbers(self, group: str, name: str) -> list[float]:
        """Return all numbers as `numbers`, of a parameter whose words have no sign.

        Whole numbers are decoded as signed, so 32768 comes as -32768. Floats keep their
        sign.
        """
        numbers: list[float] = []
        for values in self._all(group, name, np.ndarray):
            if values.dtype == np.int16:
                numbers += [unsigned(x) for x in values]
            else:
                numbers += [float(x) for x in values]
        return numbers

    def texts(self, group: str, name: str) -> list[str]:
        """Return all texts of a parameter and its continuations; none if absent.

        Raises
        ------
        RecordingError
            If it is a number.
        """
        return [text for value in self._all(group, name, list) for text in value]

    def _all(self, group: str, name: str, kind: type) -> Iterator[Any]:
        """Yield the values of a parameter and its continuations, all of one kind."""
        named = self.groups.get(group, {})
        continuations = [f"{name}{i}" for i in range(2, len(named) + 2)]
        for key in [name, *continuations]:
            if key not in named:
                return
            if not isinstance(named[key], kind):
                place = self.place(group, key)
                if kind is list:
                    raise RecordingError.at(place, "text", "numbers")
                raise RecordingError.at(place, "numbers", "text")
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
    groups: dict[int, str] = {}
    found: list[tuple[_Record, Any]] = []
    for record in source.records():
        if record.number < 0:
            groups[-record.number] = record.name
            continue
        kind = source.kind(record.content)
        if kind in _WIDTH:
            value = source.value(record.content)
            found.append((record, value))
        else:
            byte = offset + record.content
            place = f"{path}, byte {byte}: parameter {record.name}"
            told = mismatch(place, "the type -1, 1, 2 or 4", f"{kind}; it is left out")
            parameters.remarks += (told,)
    # A group may follow its parameters.
    for record, value in found:
        if record.number in groups:
            group = groups[record.number]
            parameters.groups.setdefault(group, {})[record.name] = value
            parameters.sizes[group, record.name] = source.sizes(record.content)
        else:
            place = f"{path}: parameter {record.name}"
            wanted = f"a group of number {record.number}"
            told = mismatch(place, wanted, "none; it is left out")
            parameters.remarks += (told,)
    return parameters


@dataclass(frozen=True)
class _Record:
    """A group, or a parameter of one.

    Parameters
    ----------
    number : int
        Number of the group; negative for the group itself.
    name : str
        In upper case.
    content : int
        Place in the section at which its content begins.
    """

    number: int
    name: str
    content: int


@dataclass(frozen=True)
class _Section:
    """The bytes of the section and their place in the file."""

    path: Path
    data: bytes
    offset: int
    processor: Processor

    def records(self) -> Iterator[_Record]:
        """Yield groups and parameters."""
        start = 4
        while start + 2 <= len(self.data) and self.data[start]:
            length, number = np.frombuffer(self.data, np.int8, 2, start).tolist()
            after_name = start + 2 + abs(length)
            name = decoded(self.take(start + 2, abs(length))).strip().upper()
            step = unsigned(self.processor.whole(self.take(after_name, 2))[0])
            yield _Record(number, name, after_name + 2)
            if step == 0:
                return
            if step < 2:
                what = f"the distance to the next record, found {step}"
                raise self.fault(after_name, what)
            start = after_name + self.distance(number, after_name + 2, step)

    def distance(self, number: int, content: int, step: int) -> int:
        """Return the distance to the next record, of which the file states 16 bits.

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
        description_bytes = 1 + self.data[description_at]
        whole = description_at + description_bytes - (content - 2)
        return whole if whole % WORDS == step else step

    def kind(self, at: int) -> int:
        """Return the type of a parameter."""
        return int(np.frombuffer(self.take(at, 1), np.int8)[0])

    def sizes(self, at: int) -> tuple[int, ...]:
        """Return the dimensions of a parameter; none of a single number."""
        n_dimensions = self.take(at + 1, 1)[0]
        return tuple(self.take(at + 2, n_dimensions))

    def value(self, at: int) -> Any:
        """Return a parameter: an array of its numbers or a list of its texts."""
        kind = self.kind(at)
        sizes = self.sizes(at)
        n_bytes = prod(sizes) * _WIDTH[kind]
        data = self.take(at + 2 + len(sizes), n_bytes)
        if kind == TEXT:
            return _texts(data, width=sizes[0] if sizes else 1)
        if kind == BYTE:
            return np.frombuffer(data, dtype=np.int8)
        if kind == WHOLE:
            return self.processor.whole(data)
        return self.processor.floats(data)

    def take(self, at: int, length: int) -> bytes:
        """Return bytes of the section; raise an error if it is too short."""
        if at + length > len(self.data):
            what = f"{length} bytes of a parameter, found the end of the section"
            raise self.fault(at, what)
        return self.data[at : at + length]

    def fault(self, at: int, what: str) -> RecordingError:
        return RecordingError(f"{self.path}, byte {self.offset + at}: expected {what}")


def _texts(data: bytes, *, width: int) -> list[str]:
    """Return texts of equal width, which a zero or blanks may end."""
    if not width:
        return []
    texts = []
    for start in range(0, len(data), width):
        text = data[start : start + width].split(b"\0")[0]
        texts.append(decoded(text).strip(" "))
    return texts


# First block of a C3D file, and the number of frames that the file really holds.

# Value of word 150 if events with four-letter labels follow, and their largest number.
_EVENT_KEY = 12345
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
        bytes_of_a_number = 4 if self.scale < 0 else 2
        return (4 * self.n_points + self.n_analog) * bytes_of_a_number


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
        wanted = "the parameters in block 2 or later"
        raise RecordingError.at(f"{path}, byte 0", wanted, block[0])
    return (block[0] - 1) * BLOCK


def read_c3d_header(block: bytes, processor: Processor) -> C3dHeader:
    """Decode the header block (512 bytes)."""
    words = processor.whole(block)
    return C3dHeader(
        n_points=unsigned(words[1]),
        n_analog=unsigned(words[2]),
        first=unsigned(words[3]),
        last=unsigned(words[4]),
        scale=float(processor.floats(block[12:16])[0]),
        data_start=(unsigned(words[8]) - 1) * BLOCK,
        rate_hz=float(processor.floats(block[20:24])[0]),
        events=_events(block, processor),
    )


def _events(block: bytes, processor: Processor) -> tuple[Event, ...]:
    """Return the events of the header, whose labels have four letters."""
    key, number = processor.whole(block[298:302])
    if key != _EVENT_KEY or not 0 < number <= _MOST_EVENTS:
        return ()
    times = processor.floats(block[304:376])
    events = []
    for i in range(number):
        label = decoded(block[396 + 4 * i : 400 + 4 * i]).strip(" \0")
        events.append(Event(label, float(times[i])))
    return tuple(events)


def with_stated_start(header: C3dHeader, parameters: Parameters) -> C3dHeader:
    """Return the header with the data's start from ``POINT:DATA_START``, if any."""
    stated = parameters.unsigned_numbers("POINT", "DATA_START")
    if not stated or not isfinite(stated[0]):
        return header
    return replace(header, data_start=(int(stated[0]) - 1) * BLOCK)


def settle_points(
    header: C3dHeader, parameters: Parameters, available: int
) -> tuple[C3dHeader, tuple[str, ...]]:
    """Return the header with the number of points that fits the file, and remarks.

    Header and ``POINT:USED`` both state it. Where they differ, the frames of only one
    of them may fill the file to the block.

    Raises
    ------
    RecordingError
        If they differ and neither or both fit.
    """
    stated = parameters.number("POINT", "USED")
    if stated is None or stated % WORDS == header.n_points or not isfinite(stated):
        return header, ()
    place = parameters.place("POINT", "USED")
    other = replace(header, n_points=int(stated % WORDS))
    fitting = [one for one in (header, other) if _fits(one, parameters, available)]
    if len(fitting) != 1:
        wanted = f"{header.n_points} as in the header"
        raise RecordingError.at(place, wanted, f"{stated:g}")
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
    """Return the number of the first frame; long recordings state it in ``TRIAL``."""
    return _two_words(parameters, "ACTUAL_START_FIELD") or header.first


def zeros_at_end(path: Path, end: int) -> int:
    """Return how many bytes before byte `end` of a file are 0, to one block."""
    first = max(0, end - BLOCK)
    with path.open("rb") as file:
        file.seek(first)
        tail = file.read(end - first)
    return len(tail) - len(tail.rstrip(b"\0"))


def count_frames(
    header: C3dHeader, parameters: Parameters, available: int, *, n_zeros: int = 0
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
    n_zeros : int
        How many of the last of these are 0, to one block (`zeros_at_end`). Where only
        the size tells the number of frames, they fill up the last block.

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
    path = parameters.path
    most = available // header.frame_bytes
    if most and _lacks_a_block(claims, header, available):
        stated = f"{min(claims.values()):g} frames are stated"
        lacking = f"{stated}, the file ends within one block of them"
        return most, (f"{path}: {lacking}; the {most} that are whole are read",)
    # Some writers pad the last block; others add a whole block if it is full.
    least = -(-(available - BLOCK) // header.frame_bytes)
    possible = range(most, max(0, least - 1), -1)
    fitting = [int(claim) for claim in claims.values() if claim in possible]
    # Beyond 16 bits, a count that all claims agree with but for a multiple of 65,536.
    wrapped = [n for n in possible if _are_wrapped(claims, header, n)]
    if not claims or not (fitting or wrapped):
        raise _no_room(claims, header, most, path)
    if fitting:
        n_frames = fitting[0]
    else:
        n_frames = _without_padding(wrapped, header, available - n_zeros)
    remarks = []
    for name, claim in claims.items():
        is_wrapped = n_frames > claim and _is_16_bit(claim, n_frames)
        if claim != n_frames and not is_wrapped:
            says = f"{name} says {claim:g} frames, the file holds {n_frames}"
            remarks.append(f"{path}: {says}")
    if not fitting:
        counted = f"{n_frames} frames counted from the size of the file"
        if n_frames < wrapped[0]:
            n_filling = available - n_frames * header.frame_bytes
            counted += f"; the {n_filling} bytes of 0 after them fill up a block"
        remarks.append(f"{path}: {counted}")
    return n_frames, tuple(remarks)


def _without_padding(counts: list[int], header: C3dHeader, n_bytes: int) -> int:
    """Return the least of these counts that holds so many bytes, else the largest.

    An unseen point has a residual of -1, so that a frame of zeros alone is no frame.
    """
    whole = [count for count in counts if count * header.frame_bytes >= n_bytes]
    return min(whole, default=max(counts))


def _are_wrapped(claims: dict[str, float], header: C3dHeader, n_frames: int) -> bool:
    """Tell whether each claim is this number in 16 bits, or the limit that it exceeds.

    A count at the limit says that there are at least as many frames: a file that holds
    fewer was cut short. The header has the last frame's number in place of a count.
    """
    reaches_limit = dict.fromkeys(claims, n_frames >= MOST_16_BIT)
    reaches_limit["header"] = header.first + n_frames - 1 >= MOST_16_BIT
    return all(
        claim == n_frames % WORDS or (_is_full(claim) and reaches_limit[name])
        for name, claim in claims.items()
    )


def _no_room(
    claims: dict[str, float], header: C3dHeader, most: int, path: Path
) -> RecordingError:
    stated = ", ".join(f"{claim:g} ({name})" for name, claim in claims.items())
    wanted = f"{stated} of {header.frame_bytes} bytes each"
    found = f"room for {most} after byte {header.data_start}"
    if all(claim > most for claim in claims.values()):
        found += "; was the file cut short?"
    return RecordingError.at(f"{path}: frames", wanted, found)


def _lacks_a_block(claims: dict[str, float], header: C3dHeader, available: int) -> bool:
    """Tell whether the last block of the frames was not written, as some do."""
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
            is_word = stated > -32769
            claims[f"POINT:{name}"] = unsigned(stated) if is_word else stated
    if header.last < MOST_16_BIT:
        claims["header"] = header.last - header.first + 1
    elif not claims:
        # Beside other claims, a last frame at the limit says nothing.
        is_full = header.last == MOST_16_BIT
        claims["header"] = MOST_16_BIT if is_full else header.last - header.first + 1
    return claims


def _two_words(parameters: Parameters, name: str) -> int:
    """Return the integer in two words of ``TRIAL``, low word first; 0 if absent."""
    words = parameters.numbers("TRIAL", name)
    if len(words) != 2 or not all(abs(word) <= MOST_16_BIT for word in words):
        return 0
    return unsigned(words[0]) + WORDS * unsigned(words[1])


def _is_full(claim: float) -> bool:
    return claim in (MOST_16_BIT, -1)


def _is_16_bit(claim: float, n: float) -> bool:
    if n <= MOST_16_BIT:
        return False
    return _is_full(claim) or claim in (n % WORDS, n % WORDS - WORDS)
