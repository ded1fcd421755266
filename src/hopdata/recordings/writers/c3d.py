"""Contact events in a copy of a C3D file, as the parameters of its group EVENT.

The layout follows the C3D user guide (c3d.org), "The parameter section". Only this
group is written anew; every other byte of the file is copied. If the section needs more
blocks, the data move back, and the two numbers that say where they begin follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from hopdata.errors import HopdataError, RecordingError
from hopdata.recordings.readers.c3d_parameters import (
    BLOCK,
    BYTE,
    FLOAT,
    MOST_16_BIT,
    PROCESSORS,
    TEXT,
    WHOLE,
    Processor,
    parameter_start,
    unsigned,
)
from hopdata.recordings.writers.contact_events import ContactEvent, labels

Value = TypeVar("Value")

GROUP = b"EVENT"

# Identifiers of events in Vicon's programs: a general one, and a foot strike.
GENERAL = 0
STRIKE = 1

# Widths of the texts, in bytes, as Vicon writes them.
WIDTHS = {"CONTEXTS": 16, "LABELS": 32, "DESCRIPTIONS": 32, "SUBJECTS": 32}

# Elements along one dimension of a parameter, which is counted in a byte; more are
# continued in a parameter with the next number, such as LABELS2.
MOST_IN_ONE = 255

# Bytes before the records of a parameter section.
SECTION_HEAD = 4

# Blocks of a parameter section, which are counted in a byte.
MOST_BLOCKS = 255

# What a description of an event of ours begins with, so that they can be found again.
OURS = "hopdata"


@dataclass(frozen=True)
class _Record:
    """A group or a parameter, as its bytes.

    Parameters
    ----------
    number : int
        Number of the group; negative for the group itself.
    name : bytes
        In upper case.
    head : bytes
        Length of the name, number and name.
    content : bytes
        What follows the distance to the next record.
    place : int
        Where the content begins in the section.
    """

    number: int
    name: bytes
    head: bytes
    content: bytes
    place: int = 0

    def written(self, processor: Processor) -> bytes:
        """Return the record with the distance to the next one."""
        distance = (2 + len(self.content)) % (MOST_16_BIT + 1)
        return self.head + _words([distance], processor) + self.content


@dataclass(frozen=True)
class _Events:
    """Events of a file, each list as long as the others."""

    contexts: list[bytes]
    labels: list[bytes]
    descriptions: list[bytes]
    subjects: list[bytes]
    seconds: list[float]
    icons: list[int]
    flags: list[int]

    def __len__(self) -> int:
        return len(self.labels)

    def in_order(self) -> _Events:
        """Return the events in order of time."""
        order = np.argsort(self.seconds, kind="stable").tolist()
        return _Events(
            contexts=[self.contexts[i] for i in order],
            labels=[self.labels[i] for i in order],
            descriptions=[self.descriptions[i] for i in order],
            subjects=[self.subjects[i] for i in order],
            seconds=[self.seconds[i] for i in order],
            icons=[self.icons[i] for i in order],
            flags=[self.flags[i] for i in order],
        )


def write_c3d_events(source: Path, path: Path, events: Sequence[ContactEvent]) -> None:
    """Copy a C3D file and add contact events to those that it has.

    Events of hopdata that it has already are replaced.

    Parameters
    ----------
    source : path
        The file that was read.
    path : path
        The copy.
    events : sequence of ContactEvent
        In order of time, on the clock of the file.

    Raises
    ------
    RecordingError
        If the file's parameters cannot be taken apart.
    HopdataError
        If so many events do not fit into the parameter section.
    """
    content = source.read_bytes()
    start = parameter_start(source, content[:BLOCK])
    processor = _processor(source, content, start)
    data_start = (unsigned(processor.whole(content[16:18])[0]) - 1) * BLOCK
    if not start < data_start <= len(content):
        found = f"parameters at byte {start} and data at byte {data_start}"
        raise RecordingError.at(source, "the parameters before the data", found)
    section = content[start:data_start]
    records = _records(source, section, processor)
    kept, group, old = _without_events(records)
    joined = _joined(old, events, _subject(records), processor)
    kept += _event_group(joined, group or _free_number(records), processor)

    n_blocks_before = len(section) // BLOCK
    n_blocks = max(_blocks_of(kept, processor), n_blocks_before)
    if n_blocks > MOST_BLOCKS:
        wanted = f"parameters of at most {MOST_BLOCKS} blocks"
        found = f"{n_blocks} with {len(joined)} events; write them as csv"
        raise HopdataError.at(path, wanted, found)
    moved = n_blocks - n_blocks_before
    head = bytearray(content[:start])
    if moved:
        head[16:18] = _words([data_start // BLOCK + 1 + moved], processor)
        kept = _with_data_start(kept, moved, processor)
    new = _section(
        kept, section[:SECTION_HEAD], n_blocks, processor, is_longer=moved > 0
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(head) + new + content[data_start:])


def _size_of(records: list[_Record], processor: Processor) -> int:
    """Return the bytes of a section: its head, its records, and a zero that ends it."""
    n_bytes = sum(len(record.written(processor)) for record in records)
    return SECTION_HEAD + n_bytes + 1


def _blocks_of(records: list[_Record], processor: Processor) -> int:
    """Return the blocks that a section of these records takes."""
    return -(-_size_of(records, processor) // BLOCK)


def _section(
    records: list[_Record],
    head: bytes,
    n_blocks: int,
    processor: Processor,
    *,
    is_longer: bool,
) -> bytes:
    """Return a section of these records, filled with zeros up to whole blocks.

    Parameters
    ----------
    records : list of _Record
        Groups and parameters.
    head : bytes
        Four bytes that the section had before its records; the third counts blocks.
    n_blocks : int
        Blocks of the section.
    processor : Processor
        Of the file.
    is_longer : bool
        Whether it has more blocks than before. If not, the count stays as the file
        states it, provided that it covers the records.
    """
    stated = head[2]
    if is_longer or stated * BLOCK < _size_of(records, processor):
        stated = n_blocks
    written = [record.written(processor) for record in records]
    section = head[:2] + bytes([stated]) + head[3:] + b"".join(written)
    return section.ljust(n_blocks * BLOCK, b"\0")


def _processor(source: Path, content: bytes, start: int) -> Processor:
    """Return the number format that the section's head states."""
    found = content[start + 3] if len(content) > start + 3 else None
    if found not in PROCESSORS:
        place = f"{source}, byte {start + 3}"
        raise RecordingError.at(place, "the processor type 84, 85 or 86", found)
    return PROCESSORS[found]


# The records of the section.


def _records(source: Path, section: bytes, processor: Processor) -> list[_Record]:
    """Take the section apart."""
    records = []
    at = SECTION_HEAD
    while at + 2 <= len(section) and section[at]:
        # A negative length locks the record.
        length, number = np.frombuffer(section, np.int8, 2, at).tolist()
        length = abs(length)
        name_end = at + 2 + length
        step_bytes = section[name_end : name_end + 2]
        if len(step_bytes) < 2:
            break
        step = unsigned(processor.whole(step_bytes)[0])
        place = name_end + 2
        size = _content_size(section, place, is_group=number < 0)
        if size is None or place + size > len(section):
            where = f"{source}, byte {place} of the parameters"
            raise RecordingError.at(
                where, "a whole parameter", "the end of the section"
            )
        # What stands between this record and the next is kept with it.
        end = name_end + step
        stated_fits = step >= 2 + size and end <= len(section)
        if not stated_fits:
            end = place + size
        records.append(
            _Record(
                number,
                section[at + 2 : name_end].upper().strip(),
                section[at:name_end],
                section[place:end],
                place,
            )
        )
        if step == 0:
            break
        at = end
    return records


def _content_size(section: bytes, place: int, *, is_group: bool) -> int | None:
    """Return the bytes of a record's content: values and description."""
    at = place
    if not is_group:
        if at + 2 > len(section):
            return None
        kind = int(np.frombuffer(section[at : at + 1], np.int8)[0])
        n_dimensions = section[at + 1]
        sizes = section[at + 2 : at + 2 + n_dimensions]
        at += 2 + n_dimensions + _data_size(kind, list(sizes))
    if at >= len(section):
        return None
    return at + 1 + section[at] - place


def _without_events(
    records: list[_Record],
) -> tuple[list[_Record], int, dict[bytes, bytes]]:
    """Return the records but those of the group, its number, and its parameters.

    The number is 0 if there is no such group.
    """
    number = 0
    for record in records:
        if record.number < 0 and record.name == GROUP:
            number = -record.number
    if not number:
        return list(records), 0, {}
    kept = [record for record in records if abs(record.number) != number]
    old = {record.name: record.content for record in records if record.number == number}
    return kept, number, old


def _free_number(records: list[_Record]) -> int:
    """Return a number that no group has."""
    taken = {abs(record.number) for record in records}
    return next(number for number in range(1, 128) if number not in taken)


def _subject(records: list[_Record]) -> bytes:
    """Return the first of the subjects' names; empty without any."""
    numbers = [-one.number for one in records if one.name == b"SUBJECTS"]
    for record in records:
        if record.number in numbers and record.name == b"NAMES":
            names = _texts_of(record.content)
            return names[0] if names else b""
    return b""


def _with_data_start(
    records: list[_Record], moved: int, processor: Processor
) -> list[_Record]:
    """Return the records with POINT:DATA_START later by `moved` blocks."""
    points = [-one.number for one in records if one.number < 0 and one.name == b"POINT"]
    changed = []
    for record in records:
        content = record.content
        is_start = record.name == b"DATA_START" and record.number in points
        if is_start and len(content) >= 4 and content[0] == WHOLE:
            at = 2 + content[1]
            stated = unsigned(processor.whole(content[at : at + 2])[0])
            word = _words([stated + moved], processor)
            content = content[:at] + word + content[at + 2 :]
            record = _Record(record.number, record.name, record.head, content)
        changed.append(record)
    return changed


# The events.


def _joined(
    old: dict[bytes, bytes],
    events: Sequence[ContactEvent],
    subject: bytes,
    processor: Processor,
) -> _Events:
    """Return the events of the file but ours, and these, in order of time."""
    known = _events_of(old, processor)
    for event, label in zip(events, labels(events), strict=True):
        is_strike = event.side != ""
        se_ms = 1e3 * event.se_s
        known.contexts.append(event.context.encode())
        known.labels.append(label.encode())
        known.descriptions.append(f"{OURS}: se {se_ms:.2g} ms".encode())
        known.subjects.append(subject)
        known.seconds.append(event.time_s)
        known.icons.append(STRIKE if is_strike else GENERAL)
        known.flags.append(0)
    return known.in_order()


def _events_of(old: dict[bytes, bytes], processor: Processor) -> _Events:
    """Return the events that a file has, without those of hopdata."""
    found = _Events([], [], [], [], [], [], [])
    used = _numbers_of(old, b"USED", processor)
    n_events = int(used[0]) if used else 0
    of_texts = {name: _all_texts(old, name.encode()) for name in WIDTHS}
    times = _numbers_of(old, b"TIMES", processor)
    icons = _numbers_of(old, b"ICON_IDS", processor)
    flags = _numbers_of(old, b"GENERIC_FLAGS", processor)
    n_events = min(n_events, len(of_texts["LABELS"]), len(times) // 2)
    for i in range(n_events):
        description = _at(of_texts["DESCRIPTIONS"], i, b"")
        if description.startswith(OURS.encode()):
            continue
        found.contexts.append(_at(of_texts["CONTEXTS"], i, b""))
        found.labels.append(of_texts["LABELS"][i])
        found.descriptions.append(description)
        found.subjects.append(_at(of_texts["SUBJECTS"], i, b""))
        found.seconds.append(60 * times[2 * i] + times[2 * i + 1])
        found.icons.append(int(_at(icons, i, 0)))
        found.flags.append(int(_at(flags, i, 0)))
    return found


def _event_group(events: _Events, number: int, processor: Processor) -> list[_Record]:
    """Return the group with its parameters."""
    records = [_Record(-number, GROUP, _head(GROUP, -number), b"\0")]
    used = _words([len(events)], processor)
    records.append(_parameter(number, "USED", WHOLE, [], used))
    texts = {
        "CONTEXTS": events.contexts,
        "LABELS": events.labels,
        "DESCRIPTIONS": events.descriptions,
        "SUBJECTS": events.subjects,
    }
    for first in range(0, max(len(events), 1), MOST_IN_ONE):
        part = slice(first, first + MOST_IN_ONE)
        suffix = "" if first == 0 else str(first // MOST_IN_ONE + 1)
        count = len(events.labels[part])
        for name, values in texts.items():
            width = max([WIDTHS[name], *(len(text) for text in values)])
            width = min(width, MOST_IN_ONE)
            data = b"".join(text[:width].ljust(width) for text in values[part])
            name = f"{name}{suffix}"
            records.append(_parameter(number, name, TEXT, [width, count], data))
        # Minutes and seconds; all is put into the seconds, which some programs read
        # alone.
        times = [value for second in events.seconds[part] for value in (0.0, second)]
        data = _floats(times, processor)
        records.append(_parameter(number, f"TIMES{suffix}", FLOAT, [2, count], data))
        data = _words(events.icons[part], processor)
        records.append(_parameter(number, f"ICON_IDS{suffix}", WHOLE, [count], data))
        data = bytes(flag % 256 for flag in events.flags[part])
        name = f"GENERIC_FLAGS{suffix}"
        records.append(_parameter(number, name, BYTE, [count], data))
    return records


# Values of parameters.


def _head(name: bytes, number: int) -> bytes:
    """Return the first bytes of a record: length of the name, number and name."""
    return bytes([len(name), number % 256]) + name


def _parameter(
    number: int, name: str, kind: int, sizes: list[int], data: bytes
) -> _Record:
    """Return a parameter without a description."""
    content = bytes([kind % 256, len(sizes), *sizes]) + data + b"\0"
    as_bytes = name.encode()
    return _Record(number, as_bytes, _head(as_bytes, number), content)


def _words(values: Sequence[int], processor: Processor) -> bytes:
    """Encode whole numbers as 16-bit words."""
    wrapped = np.asarray(values, dtype=np.int64) % (MOST_16_BIT + 1)
    return wrapped.astype(f"{processor.order}u2").tobytes()


def _floats(values: Sequence[float], processor: Processor) -> bytes:
    """Encode 32-bit floats; DEC floats are four times as large, halves exchanged."""
    numbers = np.asarray(values, dtype=np.float32)
    if processor.name != "DEC":
        return numbers.astype(f"{processor.order}f4").tobytes()
    halves = (numbers * np.float32(4)).astype("<f4").view("<u2").reshape(-1, 2)
    return halves[:, ::-1].tobytes()


def _values(content: bytes) -> tuple[int, list[int], bytes]:
    """Return type, sizes and data of a parameter."""
    kind = int(np.frombuffer(content[:1], np.int8)[0])
    sizes = list(content[2 : 2 + content[1]])
    at = 2 + content[1]
    return kind, sizes, content[at : at + _data_size(kind, sizes)]


def _data_size(kind: int, sizes: list[int]) -> int:
    """Return the bytes of a parameter's values; a type is the width of one, signed."""
    n_values = int(np.prod(sizes, dtype=np.int64))
    return n_values * abs(kind)


def _texts_of(content: bytes) -> list[bytes]:
    """Return the texts of a parameter's content; none if it holds numbers."""
    kind, sizes, data = _values(content)
    if kind != TEXT or not data:
        return []
    width = sizes[0] if sizes else 1
    if not width:
        return []
    return [
        data[at : at + width].split(b"\0")[0].strip()
        for at in range(0, len(data), width)
    ]


def _continued(old: dict[bytes, bytes], name: bytes) -> list[bytes]:
    """Return the contents of a parameter and of those that continue it."""
    contents: list[bytes] = []
    number = 1
    while True:
        key = name if number == 1 else name + str(number).encode()
        if key not in old:
            return contents
        contents.append(old[key])
        number += 1


def _all_texts(old: dict[bytes, bytes], name: bytes) -> list[bytes]:
    """Return the texts of a parameter and of those that continue it."""
    return [text for one in _continued(old, name) for text in _texts_of(one)]


def _numbers_of(
    old: dict[bytes, bytes], name: bytes, processor: Processor
) -> list[float]:
    """Return the numbers of a parameter and of those that continue it."""
    numbers: list[float] = []
    for content in _continued(old, name):
        kind, _, data = _values(content)
        if kind == BYTE:
            numbers += np.frombuffer(data, np.int8).astype(float).tolist()
        elif kind == WHOLE:
            numbers += processor.whole(data).astype(float).tolist()
        elif kind == FLOAT:
            numbers += processor.floats(data).astype(float).tolist()
    return numbers


def _at(values: Sequence[Value], place: int, otherwise: Value) -> Value:
    """Return an entry; the other value if there are too few."""
    return values[place] if place < len(values) else otherwise
