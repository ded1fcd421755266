"""Packets of Qualisys' real-time protocol, version 1.25, little-endian.

A packet is its size (header of 8 bytes included) and its type, then the payload. A data packet
holds a time stamp in us, a frame number and components, each with a size (its own header included)
and a type. The component "3D" holds the labelled markers, in the order of the labels, in mm; a
marker that is not seen is NaN. (Qualisys, QTM Real-time Server Protocol Documentation.)
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

VERSION = "1.25"
PORT = 22223  # where a Qualisys system listens for little-endian clients
GREETING = "QTM RT Interface connected"

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT = 0, 1, 2, 3, 4, 6
PACKET_TYPES = range(10)
EVENT_CODES = range(1, 18)
EVENT_CONNECTED, EVENT_CAPTURE_STARTED, EVENT_CAPTURE_STOPPED, EVENT_SHUTTING_DOWN = 1, 3, 4, 12
COMPONENT_3D, COMPONENT_3D_RESIDUAL = 1, 9
COMPONENT_TYPES = range(1, 20)
MARKER_BYTES = {COMPONENT_3D: 12, COMPONENT_3D_RESIDUAL: 16}

HEADER = struct.Struct("<II")
FRAME = struct.Struct("<qII")
COMPONENT = struct.Struct("<II")
MARKERS = struct.Struct("<Ihh")

LONGEST = 1 << 16  # bytes of a packet other than XML: a thousand markers with room to spare
LONGEST_XML = 1 << 24


@dataclass(frozen=True)
class StreamFrame:
    """One frame of the stream: camera time in s, frame number, markers (M, 3) in m, NaN unseen."""

    time_s: float
    number: int
    markers: FloatArray


def packet(kind: int, payload: bytes) -> bytes:
    """Put the header in front of a payload."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def text(kind: int, words: str) -> bytes:
    """Return a packet of text: a command, the answer to one, an error or XML."""
    return packet(kind, words.encode() + b"\0")


def event(code: int) -> bytes:
    """Return a packet that reports a change of the system's state."""
    return packet(EVENT, bytes([code]))


def frame_3d(frame: StreamFrame, *, residuals: bool = False) -> bytes:
    """Return the data packet of a frame, with the residuals (always 0) if asked for."""
    columns = 4 if residuals else 3
    numbers = np.zeros((len(frame.markers), columns), dtype="<f4")
    numbers[:, :3] = 1e3 * frame.markers
    numbers[np.isnan(frame.markers).any(axis=1)] = np.nan
    kind = COMPONENT_3D_RESIDUAL if residuals else COMPONENT_3D
    body = MARKERS.pack(len(numbers), 0, 0) + numbers.tobytes()
    component = COMPONENT.pack(COMPONENT.size + len(body), kind) + body
    stamp = FRAME.pack(round(1e6 * frame.time_s), frame.number, 1)
    return packet(DATA, stamp + component)


def header_fault(size: int, kind: int) -> str:
    """Say what is wrong with a header, or return an empty string."""
    if kind not in PACKET_TYPES:
        return f"packet of type {kind}, where 0 to {PACKET_TYPES[-1]} was expected"
    longest = LONGEST_XML if kind == XML else LONGEST
    if not HEADER.size <= size <= longest:
        return f"packet of {size} bytes, where {HEADER.size} to {longest} was expected"
    return ""


def payload_fault(kind: int, payload: bytes) -> str:
    """Say what is wrong with the payload of a packet that has a sound header, or return ""."""
    if kind in (ERROR, COMMAND, XML) and not payload.endswith(b"\0"):
        return "text without its end"
    if kind == EVENT and (len(payload) != 1 or payload[0] not in EVENT_CODES):
        return "an unknown event"
    return _data_fault(payload) if kind == DATA else ""


def _data_fault(payload: bytes) -> str:
    if len(payload) < FRAME.size:
        return "a frame cut short"
    count, at = FRAME.unpack_from(payload)[2], FRAME.size
    for _ in range(min(count, len(payload))):
        fault, size = _component_fault(payload, at)
        if fault:
            return fault
        at += size
    return "" if at == len(payload) else "bytes after the last component of a frame"


def _component_fault(payload: bytes, at: int) -> tuple[str, int]:
    if at + COMPONENT.size > len(payload):
        return "a component cut short", 0
    size, kind = COMPONENT.unpack_from(payload, at)
    if kind not in COMPONENT_TYPES or not COMPONENT.size <= size <= len(payload) - at:
        return f"a component of type {kind} with {size} bytes", 0
    if kind in MARKER_BYTES:
        if size < COMPONENT.size + MARKERS.size:
            return "markers cut short", 0
        markers = MARKERS.unpack_from(payload, at + COMPONENT.size)[0]
        if size != COMPONENT.size + MARKERS.size + markers * MARKER_BYTES[kind]:
            return f"{markers} markers in a component of {size} bytes", 0
    return "", size
