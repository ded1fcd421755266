"""The first block of a C3D file, and how many frames the file really holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from hopdata.errors import RecordingError
from hopdata.recordings.c3d_numbers import Processor, unsigned
from hopdata.recordings.c3d_parameters import BLOCK, Parameters, decoded
from hopdata.recordings.raw import Event

MOST_16_BIT = 65535
_EVENT_KEY = 12345  # word 150: what follows are events with labels of four letters
_MOST_EVENTS = 18


@dataclass(frozen=True)
class C3dHeader:
    """What the header says, before anything of it is believed.

    ``n_points`` markers and ``n_analog`` analog numbers stand in each frame; ``first`` and ``last``
    are frame numbers; the data begin at byte ``data_start``, as floats if ``scale`` is negative.
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
        """Bytes of one frame."""
        return (4 * self.n_points + self.n_analog) * (4 if self.scale < 0 else 2)


def parameter_start(path: Path, block: bytes) -> int:
    """Byte at which the parameter section starts.

    Raises
    ------
    RecordingError
        If this is no C3D file.
    """
    if not block:
        raise RecordingError(f"{path}: expected a C3D file, found an empty file")
    if len(block) < BLOCK or block[1] != 0x50:
        found = f"{len(block)} bytes" if len(block) < BLOCK else f"{block[1]:#04x}"
        raise RecordingError(
            f"{path}, byte 1: expected a C3D file (0x50 in a header of {BLOCK} bytes), "
            f"found {found}"
        )
    if block[0] < 2:
        raise RecordingError(
            f"{path}, byte 0: expected the parameters in block 2 or later, found {block[0]}"
        )
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


def first_frame(header: C3dHeader, parameters: Parameters) -> int:
    """Return the number of the first frame: a long recording has it in two words of ``TRIAL``."""
    return _two_words(parameters, "ACTUAL_START_FIELD") or header.first


def count_frames(
    header: C3dHeader, parameters: Parameters, available: int
) -> tuple[int, tuple[str, ...]]:
    """Agree on the number of frames between the file's claims and its own size.

    Header and ``POINT:FRAMES`` have 16 bits and cannot count beyond 65,535: a claim that is full or
    has wrapped round is no lie. The other claims must fit the bytes that are there, to the block.

    Parameters
    ----------
    header, parameters
        What the file says.
    available : int
        Bytes from the start of the data to the end of the file.

    Returns
    -------
    n_frames : int
    remarks : tuple of str
        Claims that do not hold beside one that does.

    Raises
    ------
    RecordingError
        If no claim fits the file's size, or there are no frames.
    """
    claims = _claims(header, parameters)
    most = available // header.frame_bytes
    least = max(0, -(-(available - BLOCK + 1) // header.frame_bytes))
    fitting = [n for n in claims.values() if least <= n <= most and n > 0]
    if fitting:
        n = int(fitting[0])
    elif claims and most and all(_is_full(c) or c == most % 65536 for c in claims.values()):
        n = most
    else:
        raise _wrong_size(header, parameters, claims, (least, most))
    wrong = {k: c for k, c in claims.items() if c != n and not (n > c and _is_16_bit(c, n))}
    remarks = [
        f"{parameters.path}: {name} says {claim:g} frames, the file holds {n}"
        for name, claim in wrong.items()
    ]
    if not fitting:
        remarks.append(f"{parameters.path}: {n} frames counted from the size of the file")
    return n, tuple(remarks)


def _claims(header: C3dHeader, parameters: Parameters) -> dict[str, float]:
    """Numbers of frames by where the file says so, the most trustworthy first."""
    claims: dict[str, float] = {}
    last = _two_words(parameters, "ACTUAL_END_FIELD")
    if last:
        claims["TRIAL:ACTUAL_END_FIELD"] = last - first_frame(header, parameters) + 1
    for name in ("LONG_FRAMES", "FRAMES"):
        stated = parameters.number("POINT", name)
        if stated is not None and math.isfinite(stated):
            claims[f"POINT:{name}"] = unsigned(stated) if stated > -32769 else stated
    if header.last < MOST_16_BIT or not claims:  # a full last frame says nothing beside others
        full = header.last == MOST_16_BIT
        claims["header"] = MOST_16_BIT if full else header.last - header.first + 1
    return claims


def _two_words(parameters: Parameters, name: str) -> int:
    """Whole number in two 16-bit words of ``TRIAL``, the lower one first; 0 if absent."""
    words = parameters.numbers("TRIAL", name)
    if len(words) != 2 or not all(abs(word) <= MOST_16_BIT for word in words):
        return 0
    return unsigned(words[0]) + 65536 * unsigned(words[1])


def _is_full(claim: float) -> bool:
    return claim in (MOST_16_BIT, -1)


def _is_16_bit(claim: float, n: float) -> bool:
    return n > MOST_16_BIT and (_is_full(claim) or claim == n % 65536 or claim == n % 65536 - 65536)


def _wrong_size(
    header: C3dHeader, parameters: Parameters, claims: dict[str, float], fits: tuple[int, int]
) -> RecordingError:
    told = ", ".join(f"{claim:g} ({name})" for name, claim in claims.items())
    cut = "; was the file cut short?" if all(claim > fits[1] for claim in claims.values()) else ""
    return RecordingError(
        f"{parameters.path}: frames: expected {told} of {header.frame_bytes} bytes each, "
        f"found room for {fits[1]} after byte {header.data_start}{cut}"
    )


def _events(block: bytes, processor: Processor) -> tuple[Event, ...]:
    """Events of the header, whose labels have four letters."""
    words = processor.whole(block[298:302])
    if words[0] != _EVENT_KEY or not 0 < words[1] <= _MOST_EVENTS:
        return ()
    times = processor.floats(block[304:376])[: words[1]]
    labels = [decoded(block[396 + 4 * i : 400 + 4 * i]).strip(" \0") for i in range(words[1])]
    return tuple(Event(label, float(t)) for label, t in zip(labels, times, strict=True))
