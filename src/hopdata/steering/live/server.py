"""A loopback server that streams frames as a Qualisys system does, with faults on demand."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError
from hopdata.steering.live.buffer import LoopThread, ServerCounts
from hopdata.steering.live.faults import (
    Faults,
    FaultSource,
    Outage,
    ServedClient,
    hide,
    listening_socket,
    next_command,
)
from hopdata.steering.live.packets import (
    COMMAND,
    ERROR,
    EVENT_CAPTURE_STARTED,
    GREETING,
    LOOPBACK,
    NO_MORE_DATA,
    VERSION,
    XML,
    LiveError,
    PortError,
    StreamFrame,
    event,
    frame_3d,
    packet,
    parameters_xml,
    text,
)

# Answers of the server to the commands of a client, as the client of version 1.25 expects them.

COMPONENTS = ("3d", "3dres")


@dataclass(frozen=True)
class FrameRequest:
    """Frames are wanted: one (`every` 0), or a stream of every so manieth frame (-1: no more)."""

    every: int
    residuals: bool = False


def answer(command: str, labels: Sequence[str], rate_hz: float) -> bytes | FrameRequest:
    """Return the packet to send, or what is to be streamed; a stream has no other answer."""
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
    """Return which frames a client wants: every n-th; 0 if its words make no sense."""
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


TRY_AGAIN_S = 0.05


class LoopbackServer:
    """Streams frames of a source to any number of clients, from a thread of its own.

    Used as a context manager, or with `start` and `close`. The first frame goes out when the first
    client asks for the stream. From then on time runs for all, whether anybody listens or not.

    Parameters
    ----------
    source : iterable of (time_s, markers)
        Camera time, s, and markers (M, 3), m, NaN for those not seen. Each frame is asked for when
        it is due.
    labels : sequence of M str
    rate_hz : float
        Frame rate, Hz.
    speed : float
        Times real time; infinite: as fast as the clients read.
    host, port : str, int
        Where to listen; only on the loopback address unless told otherwise. Port 0: any free one.
    faults, outages
        What befalls frames, and the whole server.
    seed : int
        Of the faults.

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
        self.labels, self.rate_hz, self.host, self.port = tuple(labels), rate_hz, host, port
        self.counts = ServerCounts()
        self.ended = threading.Event()  # the source has no more frames
        self.outage_spans: list[tuple[float, float]] = []  # camera time, s
        self._source, self._period = iter(source), 1 / (rate_hz * speed)
        self._fates = FaultSource(faults or Faults(), len(self.labels), seed)
        self._outages = sorted(outages, key=lambda outage: outage.at_s)
        self._clients: set[ServedClient] = set()
        self._handlers: set[asyncio.Task[None]] = set()
        self._held: list[StreamFrame] | None = None  # in a stall
        self._latest: StreamFrame | None = None
        self._listener: asyncio.Server | None = None
        self._thread = LoopThread("hopdata-server", self._main)

    def start(self) -> Self:
        """Begin to listen.

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
        self._thread.stop()
        if self._thread.failure is not None:
            raise LiveError(f"server: {self._thread.failure!r}") from self._thread.failure

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    def begin(self, outage: Outage) -> None:
        """Begin an outage now, whatever its time."""
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
        frame = StreamFrame(frame.time_s, frame.number, hide(frame.markers, fate.hidden))
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
        work = self._stall(outage.for_s) if outage.kind == "stall" else self._vanish(outage.for_s)
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
            except PortError:  # somebody else has taken it in the meantime
                await asyncio.sleep(TRY_AGAIN_S)

    def _hang_up(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        for client in self._clients:
            client.writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
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
            return  # gone, perhaps in the middle of a packet
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
