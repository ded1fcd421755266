"""Packets of Qualisys' real-time protocol, version 1.25, little-endian.

A packet is its size (header of 8 bytes included) and its type, then the payload. A data packet
holds a time stamp in us, a frame number and components, each with a size (its own header included)
and a type. The component "3D" holds the labelled markers, in the order of the labels, in mm; a
marker that is not seen is NaN. (Qualisys, QTM Real-time Server Protocol Documentation.)
"""

from __future__ import annotations

import asyncio
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from hopdata.errors import HopdataError, did_you_mean

LOOPBACK = "127.0.0.1"  # heard on this computer alone


# What can go wrong with a live stream.


class LiveError(HopdataError):
    """Base of all errors of a live stream."""


class ClientAbsentError(LiveError):
    """The client of the motion-capture system's protocol is not installed."""


class ConnectionLostError(LiveError):
    """The other side cannot be reached, has gone, or has fallen silent."""


class GarbageError(LiveError):
    """The bytes that came are not of the protocol, and where the next packet begins is unknown."""


class SettingsError(LiveError):
    """The camera system is set up otherwise than it must be."""


class LabelError(SettingsError):
    """A marker that is needed is not among those that the system has labelled."""


class PortError(LiveError):
    """The address is none, or cannot be listened on."""


VERSION = "1.25"
PORT = 22223  # where a Qualisys system listens for little-endian clients

ERROR, COMMAND, XML, DATA, EVENT = 0, 1, 2, 3, 6
PACKET_TYPES = range(10)
EVENT_CODES = range(1, 18)
COMPONENT_3D, COMPONENT_3D_RESIDUAL = 1, 9
COMPONENT_TYPES = range(1, 20)
MARKER_BYTES = {COMPONENT_3D: 12, COMPONENT_3D_RESIDUAL: 16}

HEADER = struct.Struct("<II")
FRAME = struct.Struct("<qII")
COMPONENT = struct.Struct("<II")
MARKERS = struct.Struct("<Ihh")

LONGEST = 1 << 16  # bytes of a packet other than XML: a thousand markers with room to spare
LONGEST_XML = 1 << 24


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


# What we read of a Qualisys system's settings: labels and frame rate, in XML.

RATE_SLACK = 0.05


@dataclass(frozen=True)
class StreamParameters:
    """Labels of the markers in the order of the stream; what is not told is None or empty.

    `rate_hz` is the frame rate, Hz; `upwards` the axis that points up, as "+Z".
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
    except ET.ParseError as error:
        raise GarbageError(f"settings of the stream: expected XML ({error})") from error
    names = [label.findtext("Name", "") for label in root.findall("./The_3D/Label")]
    frequency = root.findtext("./General/Frequency")
    try:
        rate = float(frequency) if frequency else None
    except ValueError:
        rate = None
    upwards = root.findtext("./The_3D/AxisUpwards", "").strip().upper()
    return StreamParameters(tuple(names), rate if rate and rate > 0 else None, upwards)


def check_settings(parameters: StreamParameters, rate_hz: float | None) -> None:
    """Check what a stream says of itself, as far as it does.

    Parameters
    ----------
    parameters : StreamParameters
    rate_hz : float or None
        The frame rate that is expected, Hz; None for any.

    Raises
    ------
    SettingsError
        If z does not point up, or the frame rate is another one.
    """
    if parameters.upwards not in ("", "+Z", "Z"):
        raise SettingsError(
            f"axis that points up in the stream: expected +Z, found {parameters.upwards}"
        )
    told = parameters.rate_hz
    if rate_hz is not None and told is not None and abs(told - rate_hz) > RATE_SLACK * rate_hz:
        raise SettingsError(f"frame rate of the stream: expected {rate_hz:g} Hz, found {told:g} Hz")


def find_labels(wanted: Sequence[str], labels: Sequence[str]) -> list[int]:
    """Return the place in the stream of each marker that is wanted.

    Raises
    ------
    LabelError
        If a label is missing, or stands there twice.
    """
    for name in wanted:
        if labels.count(name) != 1:
            found = ", ".join(labels) or "none"
            often = "not one of" if name not in labels else "more than once among"
            raise LabelError(
                f"marker {name!r} is {often} the labelled markers of the stream ({found})"
                f"{did_you_mean(name, labels) if name not in labels else ''}"
            )
    return [list(labels).index(name) for name in wanted]


# Bytes are screened before the client of the protocol sees them.
#
# The client trusts what it is sent: a header that says "0 bytes" makes it read that packet for
# ever, an unknown event or a damaged component ends its connection, and an absurd size makes it
# wait for data that never come. So whole packets are cut out here and checked, and it gets sound
# ones only.

LOOK_AGAIN_S = 0.02


class Screen(asyncio.Protocol):
    """Stands between a connection and the protocol that reads it.

    A damaged payload is left out and reported; when it is lost where packets begin, the connection
    is closed, and `error` says why.

    Parameters
    ----------
    inner : asyncio.Protocol
        Gets whole, sound packets.
    on_garbled : callable
        Called with what is wrong with each packet that is left out.
    """

    def __init__(self, inner: asyncio.Protocol, on_garbled: Callable[[str], None]) -> None:
        self.error: GarbageError | None = None
        self.lost = asyncio.Event()
        self._inner, self._on_garbled = inner, on_garbled
        self._transport: asyncio.BaseTransport | None = None
        self._bytes = bytearray()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Pass on that the connection stands."""
        self._transport = transport
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on that the connection is gone."""
        self._transport = None
        self._inner.connection_lost(exc)
        self.lost.set()

    def data_received(self, data: bytes) -> None:
        """Cut out whole packets, check them and pass on the sound ones."""
        if self.error is not None:
            return
        self._bytes += data
        while self.error is None and len(self._bytes) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._bytes)
            fault = header_fault(size, kind)
            if fault:
                self._give_up(fault)
            elif len(self._bytes) < size:
                return
            else:
                whole = bytes(self._bytes[:size])
                del self._bytes[:size]
                self._pass_on(kind, whole)

    def close(self) -> None:
        """Close the connection at once."""
        if isinstance(self._transport, asyncio.Transport):
            self._transport.abort()

    def _pass_on(self, kind: int, whole: bytes) -> None:
        fault = payload_fault(kind, whole[HEADER.size :])
        if fault:
            self._on_garbled(fault)
            return
        try:
            self._inner.data_received(whole)
        except Exception as error:  # the client keeps what it could not read, and is of no more use
            self._give_up(f"a packet that the client cannot read ({error!r})")

    def _give_up(self, fault: str) -> None:
        self.error = GarbageError(f"the stream is not of the protocol: {fault}")
        self._bytes.clear()
        self.close()


class ScreenedLoop:
    """What the client asks of an event loop: futures, and a connection, which is screened.

    After `create_connection`, `screen` is the screen, or `failure` says why there is none.
    """

    def __init__(self, on_garbled: Callable[[str], None]) -> None:
        self.screen: Screen | None = None
        self.failure: OSError | None = None
        self._on_garbled = on_garbled

    async def until_lost(self) -> None:
        """Wait until there is no connection any more, if there ever was one."""
        while self.screen is None:
            await asyncio.sleep(LOOK_AGAIN_S)
        await self.screen.lost.wait()

    def close(self) -> None:
        """Close the connection at once, if there is one."""
        if self.screen is not None:
            self.screen.close()

    def create_future(self) -> asyncio.Future[Any]:
        """Return a future of the running loop."""
        return asyncio.get_running_loop().create_future()

    async def create_connection(
        self, factory: Callable[[], asyncio.Protocol], host: str, port: int
    ) -> tuple[asyncio.BaseTransport, asyncio.Protocol]:
        """Connect, with a screen in front of the protocol that the factory makes."""
        inner = factory()
        self.screen = Screen(inner, self._on_garbled)
        screen = self.screen
        try:
            loop = asyncio.get_running_loop()
            transport, _ = await loop.create_connection(lambda: screen, host, port)
        except OSError as error:
            self.failure = error
            raise
        return transport, inner
