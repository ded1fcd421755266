"""The thread that reads the motion-capture stream into a buffer, and comes back after losses."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np

from hopdata.steering.live.buffer import FrameBuffer
from hopdata.steering.live.counts import StreamCounts
from hopdata.steering.live.errors import (
    ClientAbsentError,
    ConnectionLostError,
    GarbageError,
    LiveError,
    SettingsError,
)
from hopdata.steering.live.loop_thread import LoopThread
from hopdata.steering.live.packets import PORT, VERSION
from hopdata.steering.live.parameters import (
    StreamParameters,
    check_settings,
    find_labels,
    read_parameters,
)
from hopdata.steering.live.patience import Patience
from hopdata.steering.live.screening import ScreenedLoop
from hopdata.steering.live.states import Status, StatusLog
from hopdata.steering.live.timeline import CameraClock, Timeline

Result = TypeVar("Result")

FARTHEST_MM = 1e6  # from the origin: no camera system sees a marker a kilometre away


class MarkerStream:
    """Reads the markers of a Qualisys system, or of the loopback server, in a thread of its own.

    Used as a context manager, or with `start` and `close`. The frames stand in `buffer`, with the
    markers in the order of `labels`, m. Nothing that comes over the connection ends the thread.

    Parameters
    ----------
    labels : sequence of str
        Markers wanted, by the names they have in the camera system.
    host, port : str, int
        Address of the camera system; the loopback address unless told otherwise.
    rate_hz : float, optional
        Frame rate that the camera system must have, Hz; any by default.
    capacity : int
        Frames that the buffer holds.
    patience : Patience
    """

    def __init__(
        self,
        labels: Sequence[str],
        *,
        host: str = "127.0.0.1",
        port: int = PORT,
        rate_hz: float | None = None,
        capacity: int = 256,
        patience: Patience | None = None,
    ) -> None:
        self.labels, self.host, self.port, self.rate_hz = tuple(labels), host, port, rate_hz
        self.patience = patience or Patience()
        self.buffer = FrameBuffer(capacity)
        self.counts = StreamCounts()
        self.states = StatusLog()
        self.last_fault = ""  # of the last packet left out
        self._thread = LoopThread("hopdata-stream", self._main)
        self._epoch = -1
        self._last_good_s = 0.0

    def start(self) -> Self:
        """Begin to connect.

        Raises
        ------
        ClientAbsentError
            If the client of the protocol is not installed.
        """
        self._client = _client()
        self._thread.start()
        return self

    def close(self) -> None:
        """Hang up, and wait until the thread has ended."""
        self._thread.stop()
        self.states.report("closed")
        self.buffer.wake()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    def wait_until_streaming(self, timeout_s: float = 30.0) -> Status:
        """Wait for the first frame.

        Raises
        ------
        LiveError
            If a marker has another name or z is not up (`SettingsError`), or no frame has come.
        """
        status = self.states.wait_for("streaming", "failed", timeout_s=timeout_s)
        if status is None or status.state == "failed":
            failure = self._thread.failure
            if isinstance(failure, LiveError):
                raise failure
            reasons = [s.message for s in self.states.history() if s.message]
            raise ConnectionLostError(
                f"no frame from {self.host}, port {self.port}, within {timeout_s:g} s"
                + (f": {reasons[-1]}" if reasons else "")
            )
        return status

    async def _main(self) -> None:
        delay = self.patience.retry_s
        while True:
            before = self.counts.frames
            try:
                await self._session()
            except Exception as error:
                if isinstance(error, SettingsError) and self.counts.frames == 0:
                    self._thread.failure = error
                    self.states.report("failed", str(error))
                    return
                self.counts.losses += 1
                self.counts.broken += isinstance(error, GarbageError)
                ours = isinstance(error, LiveError | OSError)
                self.states.report("lost", str(error) if ours else repr(error))
            delay = self.patience.retry_s if self.counts.frames > before else delay
            await asyncio.sleep(delay)
            delay = min(2 * delay, self.patience.longest_retry_s)

    async def _session(self) -> None:
        """Connect and read until the connection is lost, which always ends in an exception."""
        self.states.report("connecting")
        line = ScreenedLoop(self._note_garbled)
        try:
            connection = await self._answer(line, self._connect(line))
            asked = connection.get_parameters(["general", "3d"])
            parameters = read_parameters(await self._answer(line, asked))
            self._begin_epoch(parameters)
            self.counts.connections += 1
            stream = connection.stream_frames(components=["3d"], on_packet=self._on_packet)
            await self._answer(line, stream)
            await self._watch(line)
        except self._client.QRTCommandException as error:
            raise ConnectionLostError(f"the server refuses: {error}") from error
        finally:
            line.close()

    async def _connect(self, line: ScreenedLoop) -> Any:
        connection = await self._client.connect(
            self.host,
            port=self.port,
            version=VERSION,
            timeout=2 * self.patience.answer_s,  # ours is over first, and says what it was
            loop=line,
            on_event=self._on_event,
        )
        if connection is None:
            reason = line.failure or f"it does not speak version {VERSION} of the protocol"
            raise ConnectionLostError(f"cannot connect to {self.host}, port {self.port}: {reason}")
        return connection

    async def _answer(self, line: ScreenedLoop, work: Awaitable[Result]) -> Result:
        """Wait for an answer, but no longer than there is a connection, or patience."""
        task, lost = asyncio.ensure_future(work), asyncio.ensure_future(line.until_lost())
        try:
            await asyncio.wait(
                {task, lost},
                timeout=self.patience.answer_s,
                return_when=asyncio.FIRST_COMPLETED,
            )
            if task.done():
                return task.result()
            if lost.done():
                raise _loss(line)
            raise ConnectionLostError(f"no answer within {self.patience.answer_s:g} s")
        finally:
            task.cancel()
            lost.cancel()

    async def _watch(self, line: ScreenedLoop) -> None:
        lost = asyncio.ensure_future(line.until_lost())
        try:
            while not lost.done():
                await asyncio.wait({lost}, timeout=self.patience.stale_s / 2)
                self._look_at_age()
        finally:
            lost.cancel()
        raise _loss(line)

    def _look_at_age(self) -> None:
        age = time.monotonic() - self._last_good_s
        if age > self.patience.reconnect_s:
            raise ConnectionLostError(f"no frame for {age:.1f} s")
        if age > self.patience.stale_s and self.states.status.state == "streaming":
            self.states.report("stale", f"no frame for {age:.2f} s")

    def _begin_epoch(self, parameters: StreamParameters) -> None:
        check_settings(parameters, self.rate_hz)
        self._places = find_labels(self.labels, parameters.labels)
        self._n_streamed = len(parameters.labels)
        self._timeline, self._clock = Timeline(parameters.rate_hz), CameraClock()
        self._epoch += 1
        self._last_good_s = time.monotonic()

    def _on_event(self, event: Any) -> None:
        self.states.report(self.states.status.state, f"the server reports: {event.name}")

    def _on_packet(self, packet: Any) -> None:
        arrival = time.monotonic()
        found = packet.get_3d_markers()
        if found is None or len(found[1]) != self._n_streamed:
            count = "none" if found is None else len(found[1])
            self._note_garbled(f"a frame with {self._n_streamed} markers was expected, not {count}")
            return
        markers = np.array(found[1], dtype=float).reshape(-1, 3)[self._places]
        if np.any(np.abs(markers) > FARTHEST_MM):  # NaN, which is a hidden marker, is not
            self._note_garbled("a marker farther than a kilometre away")
            return
        self._keep(packet.framenumber, 1e-6 * packet.timestamp, arrival, 1e-3 * markers)

    def _keep(self, number: int, time_s: float, arrival_s: float, markers: np.ndarray) -> None:
        verdict = self._timeline.judge(number, time_s)
        if verdict == "outdated":
            self.counts.outdated += 1
            return
        if verdict == "implausible":
            self._note_garbled(f"frame {number} at {time_s:.3f} s does not follow on the last")
            return
        if verdict == "restart":
            self._clock = CameraClock()
            self._epoch += 1
        captured = self._clock.captured(time_s, arrival_s)
        self.counts.frames += 1
        self.counts.missing += self._timeline.missing
        self.counts.late += arrival_s - captured > self.patience.late_s
        self.counts.hidden_markers += int(np.isnan(markers).any(axis=1).sum())
        self._last_good_s = arrival_s
        if self.states.status.state != "streaming":
            self.states.report("streaming")
        self.buffer.write(
            markers,
            epoch=self._epoch,
            number=number,
            time_s=time_s,
            arrival_s=arrival_s,
            captured_s=captured,
        )

    def _note_garbled(self, fault: str) -> None:
        self.counts.garbled += 1
        self.last_fault = fault


def _loss(line: ScreenedLoop) -> LiveError:
    if line.screen is not None and line.screen.error is not None:
        return line.screen.error
    return ConnectionLostError("the server has hung up")


def _client() -> Any:
    try:
        import qtm_rt
    except ImportError as error:
        raise ClientAbsentError(
            "reading a live stream needs the client qtm-rt: pip install 'hopdata[live]'"
        ) from error
    return qtm_rt
