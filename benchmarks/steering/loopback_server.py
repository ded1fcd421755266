"""A loopback server that streams frames as a Qualisys system does, with faults on demand."""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import struct
import threading
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Self

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError, require_choice
from hopdata.steering.live.actuator import SILENCE_S
from hopdata.steering.live.buffer import LoopThread
from hopdata.steering.live.packets import (
    COMMAND,
    DATA,
    ERROR,
    EVENT,
    HEADER,
    LOOPBACK,
    VERSION,
    XML,
    LiveError,
    PortError,
    header_fault,
)

GREETING = "QTM RT Interface connected"
NO_MORE_DATA = 4
EVENT_CAPTURE_STARTED = 3

# Packets that the server writes; `hopdata.steering.live.packets` reads them. A data
# packet holds a frame's stamp and number, then components: size, type, and here
# markers.

COMPONENT_3D, COMPONENT_3D_RESIDUAL = 1, 9
FRAME = struct.Struct("<qII")
COMPONENT = struct.Struct("<II")
MARKERS = struct.Struct("<Ihh")


@dataclass(frozen=True)
class StreamFrame:
    """One frame of the stream: camera time, s, frame number, markers (M, 3), m, NaN if unseen."""

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


def parameters_xml(
    labels: Sequence[str], rate_hz: float, *, parts: Sequence[str]
) -> str:
    """Return the answer to `getparameters` for the parts "general", "3d" or "all"."""
    root = ET.Element(f"QTM_Parameters_Ver_{VERSION}")
    if {"general", "all"} & set(parts):
        general = ET.SubElement(root, "General")
        ET.SubElement(general, "Frequency").text = f"{rate_hz:g}"
    if {"3d", "all"} & set(parts):
        settings = ET.SubElement(root, "The_3D")
        ET.SubElement(settings, "AxisUpwards").text = "+Z"
        ET.SubElement(settings, "Labels").text = str(len(labels))
        for name in labels:
            label = ET.SubElement(settings, "Label")
            ET.SubElement(label, "Name").text = name
    return ET.tostring(root, encoding="unicode")


# Deliberate faults of the stream, reproducible by seed.

OutageKind = Literal["stall", "vanish", "garbage"]


@dataclass(frozen=True)
class Faults:
    """Rates of faults that affect single frames.

    `dropped` is the share of frames that are not sent, in bursts of `burst_frames` on
    average (1: single frames); `hidden` is the share of unseen markers; `garbled` is
    the share of frames with `garbled_bytes` random bytes after the packet's header.
    """

    dropped: float = 0.0
    burst_frames: float = 1.0
    hidden: float = 0.0
    garbled: float = 0.0
    garbled_bytes: int = 4

    def __post_init__(self) -> None:
        for name in ("dropped", "hidden", "garbled"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise ValueError(
                    f"{name}: expected a share from 0 to below 1, found {share}"
                )
        if self.burst_frames < 1:
            raise ValueError(
                f"burst_frames: expected at least 1, found {self.burst_frames}"
            )


@dataclass(frozen=True)
class Outage:
    """A fault of the whole server, `at_s` after the first frame, for `for_s`.

    "stall": nothing is sent, and then everything at once. "vanish": the server hangs
    up, refuses connections and comes back. "garbage": random bytes between two packets.
    """

    at_s: float
    for_s: float = 0.0
    kind: OutageKind = "vanish"

    def __post_init__(self) -> None:
        require_choice("kind", self.kind, ("stall", "vanish", "garbage"))


@dataclass(frozen=True)
class Fate:
    """The fate of one frame: whether it is dropped, hidden markers (M,), garbled bytes."""

    dropped: bool
    hidden: np.ndarray
    garbled: bool


class FaultSource:
    """Draws the fate of each frame in turn from a seed."""

    def __init__(self, faults: Faults, n_markers: int, seed: int) -> None:
        frames, garbage = np.random.SeedSequence(seed).spawn(2)
        self._faults, self._n_markers = faults, n_markers
        self._rng, self._bytes = (
            np.random.default_rng(frames),
            np.random.default_rng(garbage),
        )
        self._in_burst = False

    def next_fate(self) -> Fate:
        """Return the fate of the next frame.

        Every frame uses the same number of random draws, so its fate depends on other
        frames only through the bursts: a two-state chain with the given share and mean
        length.
        """
        faults = self._faults
        drop, garble, *hide = self._rng.random(2 + self._n_markers)
        begin = faults.dropped / (1 - faults.dropped) / faults.burst_frames
        self._in_burst = drop < (
            1 - 1 / faults.burst_frames if self._in_burst else begin
        )
        if faults.burst_frames == 1:
            self._in_burst = drop < faults.dropped
        hidden = np.asarray(hide) < faults.hidden
        return Fate(bool(self._in_burst), hidden, bool(garble < faults.garbled))

    def garbled(self, packet: bytes) -> bytes:
        """Return the packet with some bytes after its header replaced."""
        damaged = np.frombuffer(packet, dtype=np.uint8).copy()
        count = min(self._faults.garbled_bytes, len(damaged) - HEADER.size)
        places = self._bytes.choice(
            np.arange(HEADER.size, len(damaged)), count, replace=False
        )
        damaged[places] ^= self._bytes.integers(1, 256, count, dtype=np.uint8)
        return damaged.tobytes()

    def garbage(self, count: int = 64) -> bytes:
        """Return random bytes."""
        return self._bytes.bytes(count)


def hide(markers: FloatArray, hidden: np.ndarray) -> FloatArray:
    """Return the markers (M, 3) with NaN for the hidden ones (M,)."""
    return np.where(hidden[:, None], np.nan, markers)


# The server's clients, and the socket on which it waits for them.

MOST_WAITING = 1 << 20  # unread bytes of a client above which its frames are skipped


class ServedClient:
    """One connection: which frames it wants (every n-th, 0 for none), and in which form."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.writer, self.every, self.residuals = writer, 0, False

    def send(self, data: bytes) -> bool:
        """Send, unless the client has left too much unread; return whether it was sent."""
        transport = self.writer.transport
        if transport.is_closing() or transport.get_write_buffer_size() > MOST_WAITING:
            return False
        self.writer.write(data)
        return True


async def next_command(reader: asyncio.StreamReader) -> str:
    """Read the next command of a client.

    Raises
    ------
    ValueError
        If the data are not a command.
    IncompleteReadError
        If the client has gone.
    """
    size, kind = HEADER.unpack(await reader.readexactly(HEADER.size))
    fault = header_fault(size, kind)
    if fault or kind != COMMAND:
        raise ValueError(f"Parse error: {fault or f'packet of type {kind}'}")
    payload = await reader.readexactly(size - HEADER.size)
    return payload.rstrip(b"\0").decode("utf-8", errors="replace")


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket; port 0 means any free port.

    Raises
    ------
    PortError
        If the address cannot be listened on.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError) as error:
        raise PortError(f"cannot listen on {host}, port {port}: {error}") from error


# The robot's side: it receives the lines of `hopdata.steering.live.actuator.UdpBoom`.

LONGEST_LINE = 200


class UdpSwings:
    """Receives the lines of `UdpBoom` in a thread, on the loopback address by default.

    Each readable line is answered to where it came from: `swing <number> <rad>` with
    `heard <number>`, and `alive <number>` with the same line. Unreadable lines are left
    out and counted in `garbled`. Lines that are late, repeated or out of order, whose
    number does not exceed all earlier ones of their kind, are counted in `outdated`.

    A robot that hears nothing new for `silence_s` rests by itself: a swing that waits
    for its flight then is dropped, and counted in `silences`.

    Raises
    ------
    PortError
        If the port cannot be listened on.
    """

    def __init__(
        self, port: int = 0, *, host: str = LOOPBACK, silence_s: float = SILENCE_S
    ) -> None:
        self.garbled = self.outdated = self.silences = self.beats = 0
        self.answers = True  # a test may make the robot deaf or dumb
        self._silence_s = silence_s
        # Numbers of the newest swing and heartbeat so far, and when a line last came.
        self._newest = {b"swing": -1, b"alive": -1}
        self._heard_s = -math.inf
        self._swing: float | None = None
        self._lock = threading.Lock()
        self._is_closed = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise PortError(f"cannot listen on {host}, port {port}: {error}") from error
        self._socket.settimeout(0.05)
        self.port: int = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._listen, name="robot", daemon=True)
        self._thread.start()

    def newest(self) -> float | None:
        """Return the newest swing received since the last call, rad, or None; never waits.

        It is 0 if nothing new was heard for `silence_s`.
        """
        with self._lock:
            swing, self._swing = self._swing, None
            if swing is None or time.monotonic() - self._heard_s <= self._silence_s:
                return swing
            self.silences += swing != 0.0
            return 0.0

    def close(self) -> None:
        """Close the socket."""
        self._is_closed = True
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while not self._is_closed:
            try:
                line, sender = self._socket.recvfrom(LONGEST_LINE)
            except OSError:  # nothing came, or a sender is gone
                continue
            found = _robot_line(line)
            with self._lock:
                if found is None:
                    self.garbled += 1
                    continue
                kind, number, rad = found
                self._take(kind, number, rad)
            if self.answers:
                word = b"heard" if kind == b"swing" else b"alive"
                with contextlib.suppress(OSError):  # the sender may be gone
                    self._socket.sendto(b"%s %d\n" % (word, number), sender)

    def _take(self, kind: bytes, number: int, rad: float) -> None:
        if number <= self._newest[kind]:
            self.outdated += 1
            return
        self._newest[kind] = number
        self._heard_s = time.monotonic()
        if kind == b"swing":
            self._swing = rad
        else:
            self.beats += 1


def _robot_line(line: bytes) -> tuple[bytes, int, float] | None:
    """Return kind and number of a line, and its swing, rad; 0 for a heartbeat."""
    words = line.split()
    if len(words) < 2 or not words[1].isdigit():
        return None
    number = int(words[1])
    if words[0] == b"alive" and len(words) == 2:
        return b"alive", number, 0.0
    if words[0] != b"swing" or len(words) != 3:
        return None
    try:
        rad = float(words[2])
    except ValueError:
        return None
    return (b"swing", number, rad) if math.isfinite(rad) else None


# The server's answers to commands of a client, as version 1.25 of the client expects
# them.

COMPONENTS = ("3d", "3dres")


@dataclass(frozen=True)
class FrameRequest:
    """A request for frames: one (`every` 0), a stream of every n-th frame, or no more (-1)."""

    every: int
    residuals: bool = False


def answer(command: str, labels: Sequence[str], rate_hz: float) -> bytes | FrameRequest:
    """Return the packet to send, or the request for a stream, which has no other answer."""
    verb, *words = command.lower().split() or [""]
    if verb == "version":
        return _version(words)
    if verb == "qtmversion":
        return text(COMMAND, "QTM Version is 2024.3 (hopdata loopback server)")
    if verb == "byteorder":
        return text(COMMAND, "Byte order is little endian")
    if verb == "getstate":
        return event(EVENT_CAPTURE_STARTED)
    if verb == "getparameters":
        return text(XML, parameters_xml(labels, rate_hz, parts=words))
    if verb == "getcurrentframe":
        return _frames(0, words)
    if verb == "streamframes" and words == ["stop"]:
        return FrameRequest(-1)
    if verb == "streamframes" and words:
        every = _every(words[0], rate_hz)
        return _frames(every, words[1:]) if every > 0 else _not_understood()
    return _not_understood()


def _version(words: list[str]) -> bytes:
    if not words:
        return text(COMMAND, f"Version is {VERSION}")
    if words != [VERSION]:
        return text(ERROR, "Version NOT supported")
    return text(COMMAND, f"Version set to {VERSION}")


def _frames(every: int, components: list[str]) -> bytes | FrameRequest:
    if len(components) != 1 or components[0] not in COMPONENTS:
        return _not_understood()
    return FrameRequest(every, residuals=components[0] == "3dres")


def _every(which: str, rate_hz: float) -> int:
    """Return n if a client wants every n-th frame, or 0 if its request makes no sense."""
    kind, _, number = which.partition(":")
    if which == "allframes":
        return 1
    if not number.isdigit() or int(number) < 1:
        return 0
    if kind == "frequency":
        return max(1, round(rate_hz / int(number)))
    return int(number) if kind == "frequencydivisor" else 0


def _not_understood() -> bytes:
    return text(ERROR, "Parse error")


@dataclass
class ServerCounts:
    """What the server has done so far, in frames, markers and connections."""

    frames: int = 0
    dropped: int = 0
    hidden_markers: int = 0
    garbled: int = 0
    skipped: int = 0
    connections: int = 0
    refused_packets: int = 0


TRY_AGAIN_S = 0.05


class LoopbackServer:
    """Streams frames of a source to any number of clients, from a thread of its own.

    Use it as a context manager, or with `start` and `close`. The first frame is sent
    when the first client asks for the stream. From then on time runs for all, whether
    or not anybody listens.

    Parameters
    ----------
    source : iterable of (time_s, markers)
        Camera time, s, and markers (M, 3), m, NaN if unseen. Each frame is requested
        when it is due.
    labels : sequence of M str
        Names of the markers.
    rate_hz : float
        Frame rate, Hz.
    speed : float
        Multiple of real time; infinite means as fast as the clients read.
    host, port : str, int
        Address to listen on, the loopback address by default. Port 0 means any free
        port.
    faults, outages
        Faults of frames, and of the whole server.
    seed : int
        Seed of the faults.

    Raises
    ------
    ConfigError
        If the rate or the speed is not above 0.
    """

    def __init__(
        self,
        source: Iterable[tuple[float, FloatArray]],
        labels: Sequence[str],
        *,
        rate_hz: float = 100.0,
        speed: float = 1.0,
        host: str = LOOPBACK,
        port: int = 0,
        faults: Faults | None = None,
        outages: Sequence[Outage] = (),
        seed: int = 0,
    ) -> None:
        if not 0 < rate_hz < math.inf:
            raise ConfigError(f"rate_hz: expected more than 0 Hz, found {rate_hz}")
        if not speed > 0:
            raise ConfigError(f"speed: expected more than 0, found {speed}")
        self.labels, self.rate_hz, self.host, self.port = (
            tuple(labels),
            rate_hz,
            host,
            port,
        )
        self.counts = ServerCounts()
        self.ended = threading.Event()  # set when the source has no more frames
        self.outage_spans: list[tuple[float, float]] = []  # spans in camera time, s
        self._source, self._period = iter(source), 1 / (rate_hz * speed)
        self._fates = FaultSource(faults or Faults(), len(self.labels), seed)
        self._outages = sorted(outages, key=lambda outage: outage.at_s)
        self._clients: set[ServedClient] = set()
        self._handlers: set[asyncio.Task[None]] = set()
        self._held: list[StreamFrame] | None = None  # frames held back during a stall
        self._latest: StreamFrame | None = None
        self._listener: asyncio.Server | None = None
        self._thread = LoopThread("hopdata-server", self._main)

    def start(self) -> Self:
        """Start listening.

        Raises
        ------
        PortError
            If the address cannot be listened on.
        """
        self._socket = listening_socket(self.host, self.port)
        self.port = self._socket.getsockname()[1]
        self._thread.start()
        return self

    def close(self) -> None:
        """Hang up, and wait until the thread has ended.

        Raises
        ------
        LiveError
            If the source of the frames has failed.
        """
        self._thread.close()
        if self._thread.failure is not None:
            raise LiveError(
                f"server: {self._thread.failure!r}"
            ) from self._thread.failure

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        _: TracebackType | None,
    ) -> None:
        self.close()

    def begin(self, outage: Outage) -> None:
        """Begin an outage now, regardless of its time."""
        self._thread.call(self._begin, outage)

    async def _main(self) -> None:
        self._streaming = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._listener = await asyncio.start_server(self._serve, sock=self._socket)
        try:
            await self._pump()
            self.ended.set()
            for client in self._clients:
                client.send(packet(NO_MORE_DATA, b""))
            await asyncio.Event().wait()  # until cancelled
        finally:
            self._hang_up()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._handlers, *self._tasks, return_exceptions=True)

    async def _pump(self) -> None:
        await self._streaming.wait()
        start = time.monotonic()
        while True:
            await self._until_due(start)
            item = next(self._source, None)
            if item is None:
                return
            self.counts.frames += 1
            self._latest = StreamFrame(item[0], self.counts.frames, item[1])
            self._deliver(self._latest)
            while self._outages and item[0] >= self._outages[0].at_s:
                self._begin(self._outages.pop(0))

    async def _until_due(self, start: float) -> None:
        if self._period > 0:
            due = start + self.counts.frames * self._period
            await asyncio.sleep(max(0.0, due - time.monotonic()))
        else:
            for client in [c for c in self._clients if c.every > 0]:
                with contextlib.suppress(ConnectionError):
                    await client.writer.drain()
            await asyncio.sleep(0)
            await self._streaming.wait()

    def _deliver(self, frame: StreamFrame) -> None:
        fate = self._fates.next_fate()
        if fate.dropped:
            self.counts.dropped += 1
            return
        self.counts.hidden_markers += int(fate.hidden.sum())
        self.counts.garbled += fate.garbled
        frame = StreamFrame(
            frame.time_s, frame.number, hide(frame.markers, fate.hidden)
        )
        if self._held is not None:
            self._held.append(frame)
            return
        self._send(frame, garbled=fate.garbled)

    def _send(self, frame: StreamFrame, *, garbled: bool = False) -> None:
        for client in self._clients:
            if client.every > 0 and frame.number % client.every == 0:
                whole = frame_3d(frame, residuals=client.residuals)
                sent = client.send(self._fates.garbled(whole) if garbled else whole)
                self.counts.skipped += not sent

    def _begin(self, outage: Outage) -> None:
        begun = 0.0 if self._latest is None else self._latest.time_s
        self.outage_spans.append((begun, begun + outage.for_s))
        if outage.kind == "garbage":
            for client in self._clients:
                client.send(self._fates.garbage())
            return
        work = (
            self._stall(outage.for_s)
            if outage.kind == "stall"
            else self._vanish(outage.for_s)
        )
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _stall(self, for_s: float) -> None:
        self._held = [] if self._held is None else self._held
        await asyncio.sleep(for_s)
        held, self._held = self._held or [], None
        for frame in held:
            self._send(frame)

    async def _vanish(self, for_s: float) -> None:
        self._hang_up()
        await asyncio.sleep(for_s)
        while self._listener is None:
            try:
                sock = listening_socket(self.host, self.port)
                self._listener = await asyncio.start_server(self._serve, sock=sock)
            except PortError:  # another program has taken it in the meantime
                await asyncio.sleep(TRY_AGAIN_S)

    def _hang_up(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        for client in self._clients:
            client.writer.transport.abort()

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        client, handler = ServedClient(writer), asyncio.current_task()
        assert handler is not None
        self._clients.add(client)
        self._handlers.add(handler)
        self.counts.connections += 1
        try:
            client.send(text(COMMAND, GREETING))
            while True:
                self._obey(client, await next_command(reader))
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            return  # the client has gone, perhaps in the middle of a packet
        except ValueError as error:
            self.counts.refused_packets += 1
            client.send(text(ERROR, str(error)))
        finally:
            self._clients.discard(client)
            self._handlers.discard(handler)
            self._note_streaming()
            writer.close()

    def _obey(self, client: ServedClient, command: str) -> None:
        reply = answer(command, self.labels, self.rate_hz)
        if isinstance(reply, bytes):
            client.send(reply)
        elif reply.every != 0:
            client.every, client.residuals = max(0, reply.every), reply.residuals
            self._note_streaming()
        else:
            client.send(self._current(reply))

    def _current(self, request: FrameRequest) -> bytes:
        if self._latest is None:
            return packet(NO_MORE_DATA, b"")
        return frame_3d(self._latest, residuals=request.residuals)

    def _note_streaming(self) -> None:
        if any(client.every > 0 for client in self._clients):
            self._streaming.set()
        else:
            self._streaming.clear()
