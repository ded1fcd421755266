"""Packets of Qualisys' real-time protocol, version 1.25, little-endian.

A packet consists of its size (including the header of 8 bytes), its type and the
payload. A data packet holds a time stamp in us, a frame number, and components, each
with a size (including its own header) and a type. The component "3D" holds the labelled
markers in mm, in the order of the labels; an unseen marker is NaN. (Qualisys, QTM
Real-time Server Protocol Documentation.)
"""

import asyncio
import math
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from hopdata.errors import HopdataError, did_you_mean

LOOPBACK = "127.0.0.1"  # reachable from this computer only


# Errors of a live stream.


class LiveError(HopdataError):
    """Base class of all errors of a live stream."""


class ClientAbsentError(LiveError):
    """The client library of the motion-capture protocol is not installed."""


class ConnectionLostError(LiveError):
    """The other side cannot be reached, has disconnected, or is silent."""


class GarbageError(LiveError):
    """The bytes are not of the protocol: where the next packet starts is unknown."""


class SettingsError(LiveError):
    """The settings of the camera system are not as required."""


class LabelError(SettingsError):
    """A required marker is not among those labelled by the system."""


class PortError(LiveError):
    """The address is invalid, or cannot be listened on."""


VERSION = "1.25"
PORT = 22223  # where a Qualisys system listens for little-endian clients

# Types of packets.
ERROR = 0
COMMAND = 1
XML = 2
DATA = 3
EVENT = 6
PACKET_TYPES = range(10)

HEADER = struct.Struct("<II")

#: Longest packet other than XML; a longer one is not of the protocol.
#: Unit: bytes. Origin: chosen: room for a thousand markers and more.
LONGEST = 1 << 16
#: Longest packet of XML.
#: Unit: bytes. Origin: chosen.
LONGEST_XML = 1 << 24


def header_fault(size: int, kind: int) -> str:
    """Return what is wrong with a header, or an empty string."""
    longest = LONGEST_XML if kind == XML else LONGEST
    if kind in PACKET_TYPES and HEADER.size <= size <= longest:
        return ""
    expected = f"expected {HEADER.size} to {longest} bytes"
    return f"packet of type {kind} with {size} bytes, {expected}"


# Time stamp, us; frame number; number of components.
FRAME_HEADER = struct.Struct("<qII")
# Number of markers; two rates of frames lost.
MARKERS_HEADER = struct.Struct("<Ihh")
# Bytes of a marker in the components of markers, by their type: three floats, and a
# label, a residual or both.
MARKER_BYTES = {1: 12, 2: 16, 9: 16, 10: 20}


def parts_fault(payload: bytes) -> str:
    """Return which stated length of a frame does not fit its bytes, or an empty string.

    The work is bounded by the bytes present: a component has at least a header, so a
    frame of n bytes cannot hold more than n / 8 of them, whatever it states.
    """
    if len(payload) < FRAME_HEADER.size:
        wanted = f"{FRAME_HEADER.size} bytes before the components"
        return f"expected {wanted}, found {len(payload)}"
    stated = FRAME_HEADER.unpack_from(payload)[2]
    most = (len(payload) - FRAME_HEADER.size) // HEADER.size
    if stated > most:
        wanted = f"room for the {stated} components stated"
        return f"expected {wanted}, found room for {most}"
    at = FRAME_HEADER.size
    for _ in range(stated):
        if at + HEADER.size > len(payload):
            return f"expected a component at byte {at}, found the end of the frame"
        size, kind = HEADER.unpack_from(payload, at)
        if not HEADER.size <= size <= len(payload) - at:
            wanted = f"{HEADER.size} to {len(payload) - at} bytes of a component"
            return f"expected {wanted} at byte {at}, found {size}"
        if kind in MARKER_BYTES:
            fault = _markers_fault(payload, at, size, kind)
            if fault:
                return fault
        at += size
    return ""


def _markers_fault(payload: bytes, at: int, size: int, kind: int) -> str:
    """Return whether the number of markers of a component does not fit its size."""
    header = HEADER.size + MARKERS_HEADER.size
    if size < header:
        return f"expected {header} bytes before the markers at byte {at}, found {size}"
    stated = MARKERS_HEADER.unpack_from(payload, at + HEADER.size)[0]
    room = (size - header) // MARKER_BYTES[kind]
    if stated > room:
        wanted = f"room for the {stated} markers stated at byte {at}"
        return f"expected {wanted}, found room for {room}"
    return ""


def payload_fault(kind: int, payload: bytes) -> str:
    """Return why the client cannot read a frame or event, or an empty string."""
    # The client believes what a packet says of its own parts, so that comes first.
    fault = ""
    if kind == DATA:
        fault = parts_fault(payload)
    if fault:
        return f"a frame that cannot be read: {fault}"
    from qtm_rt.packet import QRTEvent, QRTPacket

    try:
        if kind == DATA:
            QRTPacket(payload).get_3d_markers()
        elif kind == EVENT:
            QRTEvent(*payload)
    except Exception as error:
        what = "a frame" if kind == DATA else "an event"
        return f"{what} that cannot be read: {error}"
    return ""


# Settings of a Qualisys system that are used: labels and frame rate, in XML.

#: Largest difference from the expected frame rate, as a share of it.
#: Unit: 1. Origin: chosen.
RATE_SLACK = 0.05


@dataclass(frozen=True)
class StreamParameters:
    """Settings of a stream; unknown ones are None or empty.

    `labels` are those of the markers in the order of the stream; `rate_hz` is the frame
    rate, Hz; `upwards` is the axis that points up, such as "+Z".
    """

    labels: tuple[str, ...]
    rate_hz: float | None
    upwards: str = ""


def read_parameters(document: str | bytes) -> StreamParameters:
    """Read labels and frame rate.

    Raises
    ------
    GarbageError
        If the document is not XML.
    """
    try:
        root = ET.fromstring(document)
        frequency = root.findtext("./General/Frequency")
        rate = float(frequency) if frequency else 0.0
    except (ET.ParseError, ValueError) as error:
        raise GarbageError(f"settings of the stream: expected XML ({error})") from error
    names = [label.findtext("Name", "") for label in root.findall("./The_3D/Label")]
    upwards = root.findtext("./The_3D/AxisUpwards", "").strip().upper()
    known_rate = rate if 0 < rate < math.inf else None
    return StreamParameters(tuple(names), known_rate, upwards)


def check_settings(parameters: StreamParameters, rate_hz: float | None) -> None:
    """Check the settings that a stream reports.

    Parameters
    ----------
    parameters : StreamParameters
    rate_hz : float or None
        Expected frame rate, Hz; None for any.

    Raises
    ------
    SettingsError
        If z does not point up, or the frame rate differs.
    """
    upwards = parameters.upwards
    if upwards not in ("", "+Z", "Z"):
        raise SettingsError.at("axis that points up in the stream", "+Z", upwards)
    told = parameters.rate_hz
    if rate_hz is None or told is None:
        return
    if abs(told - rate_hz) > RATE_SLACK * rate_hz:
        asked = f"{rate_hz:g} Hz (rate_hz, or hopdata drive --rate)"
        raise SettingsError.at("frame rate of the stream", asked, f"{told:g} Hz")


def find_labels(wanted: Sequence[str], labels: Sequence[str]) -> list[int]:
    """Return the index in the stream of each wanted marker.

    Raises
    ------
    LabelError
        If a label is missing or occurs more than once.
    """
    for name in wanted:
        count = labels.count(name)
        of_stream = (
            f"the labelled markers of the stream ({', '.join(labels) or 'none'})"
        )
        if count == 0:
            near = did_you_mean(name, labels)
            raise LabelError(f"marker {name!r} is not one of {of_stream}{near}")
        if count > 1:
            raise LabelError(f"marker {name!r} is more than once among {of_stream}")
    return [list(labels).index(name) for name in wanted]


# Bytes are screened before the protocol's client sees them.
#
# The client trusts its input: a header with size 0, as a server of another protocol may
# send, makes it read that packet for ever; an unknown event ends its connection; an
# absurd size makes it wait for data that never come. So whole packets are cut out here,
# and checked.


class Line(asyncio.Protocol):
    """A screened connection that poses as the event loop of the client.

    The client asks its loop for futures and connections only. A frame or event that
    cannot be read is dropped and reported. If packet boundaries are lost, the
    connection is closed and `error` is set, as it is if there is no connection. `lost`
    is set when the connection is gone.

    Parameters
    ----------
    on_garbled : callable
        Called with the fault of each dropped packet.
    """

    def __init__(self, on_garbled: Callable[[str], None]) -> None:
        self.error: Exception | None = None
        self.lost = asyncio.Event()
        self._on_garbled = on_garbled
        self._transport: Any = None
        self._bytes = bytearray()

    def create_future(self) -> asyncio.Future[Any]:
        """Return a future of the running loop."""
        return asyncio.get_running_loop().create_future()

    async def create_connection(
        self, factory: Callable[[], asyncio.Protocol], host: str, port: int
    ) -> tuple[asyncio.BaseTransport, asyncio.Protocol]:
        """Connect, with this object between the network and the factory's protocol."""
        self._client = factory()
        try:
            loop = asyncio.get_running_loop()
            transport, _ = await loop.create_connection(lambda: self, host, port)
        except OSError as error:
            self.error = error
            raise
        return transport, self._client

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Pass on that the connection is made."""
        self._transport = transport
        self._client.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on that the connection is lost."""
        self._client.connection_lost(exc)
        self.lost.set()

    def data_received(self, data: bytes) -> None:
        """Cut out whole packets, and pass on those that can be read."""
        self._bytes += data
        while self.error is None and len(self._bytes) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._bytes)
            fault = header_fault(size, kind)
            if fault:
                self.error = GarbageError(f"the stream is not of the protocol: {fault}")
                self.close()
            elif len(self._bytes) < size:
                return
            else:
                whole = bytes(self._bytes[:size])
                del self._bytes[:size]
                fault = payload_fault(kind, whole[HEADER.size :])
                if fault:
                    self._on_garbled(fault)
                else:
                    self._client.data_received(whole)

    def close(self) -> None:
        """Close the connection at once, if there is one."""
        if self._transport is not None:
            self._transport.abort()
