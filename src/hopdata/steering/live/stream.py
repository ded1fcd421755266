"""The thread that reads the stream into a buffer, and reconnects after losses."""

import asyncio
import math
import time
from collections import deque
from collections.abc import Awaitable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeVar

import numpy as np

from hopdata.errors import counted
from hopdata.steering.live import buffer, packets

# Timeouts of a stream.


@dataclass(frozen=True)
class Patience:
    """Timeouts of the stream, s.

    `answer_s`: for an answer or the first frame. `late_s`: frames delayed by more than
    this beyond the shortest delay count as late. `stale_s`: with no frame for this
    long, the stream is stale; after `reconnect_s` it is given up. A lost connection is
    retried after `retry_s`, then after twice that, and so on up to `longest_retry_s`.
    """

    answer_s: float = 5.0
    late_s: float = 0.02
    stale_s: float = 0.1
    reconnect_s: float = 2.0
    retry_s: float = 0.1
    longest_retry_s: float = 5.0


# Whether frames follow each other as they should, and when they were captured
# (monotonic clock).

Verdict = Literal["next", "restart", "outdated", "implausible"]

#: Relative difference allowed between the actual and the reported frame rate.
#: Unit: 1. Origin: chosen.
SLACK = 0.05
#: Largest difference of the time between neighbours from what the rate demands, in
#: times between frames: with half of one, rounding would decide whether frames at twice
#: the rate follow.
#: Unit: 1. Origin: derived: a little less than half.
SLACK_FRAMES = 0.45
#: Out-of-place frames in a row after which the rate, or the last good frame, is wrong.
#: Unit: 1. Origin: chosen.
MOST_IN_A_ROW = 10
#: Frames; one at most this far behind the last may merely have been delayed.
#: Unit: frames. Origin: chosen.
RECENT = 100
#: Relative drift allowed between two clocks.
#: Unit: 1. Origin: derived: twice the 1e-4 by which quartz clocks drift at most.
CREEP = 2e-4


class Timeline:
    """Judges the numbers and times of the frames of one connection.

    A frame is plausible if its number and time have increased consistently with the
    frame rate. If not, it is damaged, or the camera system has restarted, which is
    assumed once the next frame follows this one. If that never happens, the frame rate
    is not the reported one, and from then on only the order counts. A frame is outdated
    if it is the last good frame again or one before it: it is a duplicate, or late.
    Several outdated frames in a row that follow each other are not a restart, unless
    they go on.
    """

    def __init__(self, rate_hz: float | None) -> None:
        self._period_s = None if rate_hz is None else 1 / rate_hz
        self._last: tuple[int, float] | None = None
        self._suspect: tuple[int, float] | None = None
        self._in_a_row = 0  # implausible or outdated frames
        self.missing = 0  # frames missing just before the last good one

    def judge(self, number: int, time_s: float) -> Verdict:
        """Return whether a frame follows, begins after a restart, or is dropped."""
        new = (number, time_s)
        verdict: Verdict = "implausible"
        if self._last is None or self._follows(self._last, new):
            verdict = "next"
        elif self._is_outdated(self._last, new) and self._in_a_row < MOST_IN_A_ROW:
            verdict = "outdated"
        elif self._suspect is not None and self._follows(self._suspect, new):
            verdict = "restart"
        if verdict in ("outdated", "implausible"):
            self._suspect = new
            self._in_a_row += 1
            if verdict == "implausible" and self._in_a_row == MOST_IN_A_ROW:
                self._period_s = None
            return verdict
        before = self._last if verdict == "next" else self._suspect
        self.missing = 0 if before is None else number - before[0] - 1
        self._last = new
        self._suspect = None
        self._in_a_row = 0
        return verdict

    def _is_outdated(self, last: tuple[int, float], new: tuple[int, float]) -> bool:
        """Tell whether a frame is the last one again, or one shortly before it."""
        if new == last:
            return True
        return last[0] - new[0] <= RECENT and self._follows(new, last)

    def _follows(self, old: tuple[int, float], new: tuple[int, float]) -> bool:
        """Tell whether number and time have increased as the frame rate demands."""
        n_frames = new[0] - old[0]
        span_s = new[1] - old[1]
        if n_frames < 1 or span_s <= 0:
            return False
        if self._period_s is None:
            return True
        expected_s = n_frames * self._period_s
        allowed_s = max(SLACK_FRAMES * self._period_s, SLACK * expected_s)
        return abs(span_s - expected_s) <= allowed_s


#: The shortest delay is noted in every such span.
#: Unit: s. Origin: chosen.
BIN_S = 1.0
#: Spans remembered: the drift of a clock is known from their shortest delays.
#: Unit: 1. Origin: chosen.
BINS = 20
#: Spans before a drift is estimated; until then clocks drift by `CREEP` at most.
#: Unit: 1. Origin: chosen.
LEAST_BINS = 4
#: Largest relative drift of a camera's clock. A delay that grows as slowly cannot be
#: told from a drift, so a larger limit would hide a queue that fills.
#: Unit: 1. Origin: derived: twice that of 59.94 Hz taken for 60.
MOST_DRIFT = 2e-3


class CameraClock:
    """Converts camera times to the monotonic clock, by the shortest delay seen lately.

    A frame that was delayed thus keeps its capture time, and appears as old as it is. A
    constant delay cannot be observed and is not included. The camera's clock may be
    slow or fast by `MOST_DRIFT`: its drift is the median slope of the shortest delays
    of the last spans.
    """

    def __init__(self) -> None:
        # Arrival and offset of the shortest delay in each span, s.
        self._bins: deque[tuple[float, float]] = deque(maxlen=BINS)
        self._bin_ends_s = -math.inf
        self._drift = 0.0
        # What spans that are no longer remembered predict. Without it, a queue that
        # fills a little faster than `MOST_DRIFT` would never look older than 20 s of
        # it.
        self._earlier = (0.0, math.inf)

    def captured(self, time_s: float, arrival_s: float) -> float:
        """Return when a frame was captured, s, by its camera time and its arrival."""
        self._note(arrival_s, arrival_s - time_s)
        noted = (*self._bins, self._earlier)
        offset_s = min(self._foreseen(one, arrival_s) for one in noted)
        return time_s + min(offset_s, arrival_s - time_s)

    def _note(self, arrival_s: float, offset_s: float) -> None:
        """Keep the smallest offset of each span; then estimate the drift anew."""
        if arrival_s >= self._bin_ends_s:
            self._drift = _slope(self._bins)
            if len(self._bins) == BINS:
                forgotten = (self._bins[0], self._earlier)
                least_s = min(self._foreseen(one, arrival_s) for one in forgotten)
                self._earlier = (arrival_s, least_s)
            self._bins.append((arrival_s, offset_s))
            self._bin_ends_s = arrival_s + BIN_S
            return
        last = self._bins[-1]
        if offset_s < self._foreseen(last, arrival_s):
            self._bins[-1] = (arrival_s, offset_s)

    def _foreseen(self, noted: tuple[float, float], arrival_s: float) -> float:
        """Return the offset expected now from one noted earlier, s."""
        at_s, offset_s = noted
        return offset_s + (self._drift + CREEP) * max(0.0, arrival_s - at_s)


def _slope(bins: Sequence[tuple[float, float]]) -> float:
    """Return the median slope of offsets (Theil and Sen), within `MOST_DRIFT`."""
    if len(bins) < LEAST_BINS:
        return 0.0
    at_s, offset_s = np.array(bins).T
    first, second = np.triu_indices(len(bins), 1)
    slopes = (offset_s[second] - offset_s[first]) / (at_s[second] - at_s[first])
    return float(np.clip(np.median(slopes), -MOST_DRIFT, MOST_DRIFT))


Result = TypeVar("Result")

#: Largest coordinate of a marker: no camera system sees one a kilometre away.
#: Unit: mm. Origin: chosen.
FARTHEST_MM = 1e6


class MarkerStream(buffer.Stream):
    """Reads the markers of a Qualisys system in a thread of its own.

    The loopback server speaks its protocol too. Use it as a context manager, or with
    `start` and `close`. The frames are in `buffer`, with the markers in the order of
    `labels`, m. No received data can end the thread.

    Parameters
    ----------
    labels : sequence of str
        Wanted markers, by their names in the camera system.
    host, port : str, int
        Address of the camera system; the loopback address by default.
    rate_hz : float, optional
        Required frame rate of the camera system, Hz; any by default.
    capacity : int
        Number of frames in the buffer.
    patience : Patience
    """

    def __init__(
        self,
        labels: Sequence[str],
        *,
        host: str = "127.0.0.1",
        port: int = packets.PORT,
        rate_hz: float | None = None,
        capacity: int = 256,
        patience: Patience | None = None,
    ) -> None:
        super().__init__("hopdata-stream", self._read, capacity)
        self.labels = tuple(labels)
        self.host = host
        self.port = port
        self.rate_hz = rate_hz
        self.patience = patience or Patience()
        self.last_fault = ""  # fault of the last dropped packet
        self._epoch = -1
        self._last_good_s = 0.0

    @classmethod
    def client(cls) -> Any:
        """Return the client library of the source.

        Raises
        ------
        ClientAbsentError
            If it is not installed.
        """
        try:
            import qtm_rt
        except ImportError as error:
            raise packets.ClientAbsentError(
                "reading a live stream needs the client qtm-rt: "
                "pip install 'hopdata[live]'"
            ) from error
        return qtm_rt

    def start(self) -> Self:
        """Start connecting.

        Raises
        ------
        ClientAbsentError
            If the client library of the source is not installed.
        """
        self._client = self.client()
        return super().start()

    def wait_until_streaming(self, timeout_s: float = 30.0) -> buffer.Status:
        """Wait for the first frame.

        Raises
        ------
        LiveError
            If a marker has another name or z is not up (`SettingsError`), or no frame
            arrives.
        """
        status = self.states.wait_for("streaming", "failed", timeout_s=timeout_s)
        if status is None or status.state == "failed":
            if isinstance(self.failure, packets.LiveError):
                raise self.failure
            where = f"{self.host}, port {self.port}"
            message = f"no frame from {where}, within {timeout_s:g} s"
            reasons = [s.message for s in self.states.history() if s.message]
            if reasons:
                message += f": {reasons[-1]}"
            if self.last_fault:
                dropped = counted(self.counts.garbled, "packet")
                message += f"; {dropped} dropped, the last for {self.last_fault}"
            raise packets.ConnectionLostError(message)
        return status

    async def _read(self) -> None:
        delay = self.patience.retry_s
        while True:
            before = self.counts.frames
            try:
                await self._session()
            except Exception as error:
                if isinstance(error, packets.SettingsError) and self.counts.frames == 0:
                    self.failure = error
                    self.states.report("failed", str(error))
                    return
                self.counts.losses += 1
                self.counts.broken += isinstance(error, packets.GarbageError)
                ours = isinstance(error, packets.LiveError | OSError)
                self.states.report("lost", str(error) if ours else repr(error))
            if self.counts.frames > before:  # it was a good connection
                delay = self.patience.retry_s
            await asyncio.sleep(delay)
            delay = min(2 * delay, self.patience.longest_retry_s)

    async def _session(self) -> None:
        """Connect and read until the connection is lost, which raises an exception."""
        self.states.report("connecting")
        line = packets.Line(self._note_garbled)
        try:
            connection = await self._answer(line, self._connect(line))
            asked = connection.get_parameters(["general", "3d"])
            parameters = packets.read_parameters(await self._answer(line, asked))
            self._begin_epoch(parameters)
            self.counts.connections += 1
            stream = connection.stream_frames(
                components=["3d"], on_packet=self._on_packet
            )
            await self._answer(line, stream)
            await self._watch(line)
        except self._client.QRTCommandException as error:
            raise packets.ConnectionLostError(f"the server refuses: {error}") from error
        finally:
            line.close()

    async def _connect(self, line: packets.Line) -> Any:
        # Our own timeout comes first, and says more.
        client_timeout_s = 2 * self.patience.answer_s
        connection = await self._client.connect(
            self.host,
            port=self.port,
            version=packets.VERSION,
            timeout=client_timeout_s,
            loop=line,
            on_event=self._on_event,
        )
        if connection is None:
            version = f"it does not speak version {packets.VERSION} of the protocol"
            where = f"{self.host}, port {self.port}"
            raise packets.ConnectionLostError(
                f"cannot connect to {where}: {line.error or version}"
            )
        return connection

    async def _answer(self, line: packets.Line, work: Awaitable[Result]) -> Result:
        """Wait for an answer as long as there is a connection, at most `answer_s`."""
        task = asyncio.ensure_future(work)
        lost = asyncio.ensure_future(line.lost.wait())
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
            raise packets.ConnectionLostError(
                f"no answer within {self.patience.answer_s:g} s"
            )
        finally:
            task.cancel()
            lost.cancel()

    async def _watch(self, line: packets.Line) -> None:
        while not line.lost.is_set():
            # In Python 3.11 `wait_for` swallows a cancellation that comes just after a
            # loss.
            with suppress(TimeoutError):
                async with asyncio.timeout(self.patience.stale_s / 2):
                    await line.lost.wait()
            self._look_at_age()
        raise _loss(line)

    def _look_at_age(self) -> None:
        age = time.monotonic() - self._last_good_s
        if age > self.patience.reconnect_s:
            raise packets.ConnectionLostError(f"no frame for {age:.1f} s")
        if age > self.patience.stale_s and self.states.status.state == "streaming":
            self.states.report("stale", f"no frame for {age:.2f} s")

    def _begin_epoch(self, parameters: packets.StreamParameters) -> None:
        packets.check_settings(parameters, self.rate_hz)
        self._places = packets.find_labels(self.labels, parameters.labels)
        self._n_streamed = len(parameters.labels)
        self._timeline = Timeline(parameters.rate_hz)
        self._clock = CameraClock()
        self._epoch += 1
        self._last_good_s = time.monotonic()

    def _on_event(self, event: Any) -> None:
        state = self.states.status.state
        self.states.report(state, f"the server reports: {event.name}")

    def _on_packet(self, packet: Any) -> None:
        arrival = time.monotonic()
        found = packet.get_3d_markers()
        if found is None or len(found[1]) != self._n_streamed:
            count = "none" if found is None else len(found[1])
            wanted = f"a frame with {self._n_streamed} markers was expected"
            self._note_garbled(f"{wanted}, not {count}")
            return
        markers = np.array(found[1], dtype=float).reshape(-1, 3)[self._places]
        if np.any(np.abs(markers) > FARTHEST_MM):  # False for NaN, a hidden marker
            far = "a marker farther than a kilometre away; are its units mm?"
            self._note_garbled(far)
            return
        self._keep(packet.framenumber, 1e-6 * packet.timestamp, arrival, 1e-3 * markers)

    def _keep(
        self, number: int, time_s: float, arrival_s: float, markers: np.ndarray
    ) -> None:
        """Keep a frame if it follows the last one, or begins after a restart."""
        verdict = self._timeline.judge(number, time_s)
        if verdict == "implausible":
            self._note_garbled(
                f"frame {number} at {time_s:.3f} s does not follow the last one"
            )
            return
        if verdict == "outdated":
            self.counts.outdated += 1
            return
        if verdict == "restart":
            self._clock = CameraClock()
            self._epoch += 1
        captured = self._clock.captured(time_s, arrival_s)
        self.counts.frames += 1
        self.counts.missing += self._timeline.missing
        if arrival_s - captured > self.patience.late_s:
            self.counts.late += 1
        self.counts.hidden_markers += int(np.isnan(markers).any(axis=1).sum())
        self._last_good_s = arrival_s
        if self.states.status.state != "streaming":
            self.states.report("streaming")
        self.buffer.write(
            buffer.Frame(self._epoch, number, time_s, arrival_s, captured, markers)
        )

    def _note_garbled(self, fault: str) -> None:
        self.counts.garbled += 1
        self.last_fault = fault


def _loss(line: packets.Line) -> Exception:
    return line.error or packets.ConnectionLostError("the server has hung up")
