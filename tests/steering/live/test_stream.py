import asyncio
import builtins
import math
import socket

import numpy as np
import pytest
import qtm_rt
from hypothesis import example, given
from hypothesis import strategies as st
from loopback import BRISK, LABELS, LONG_S, linked, our_threads, ramp, wait_until
from loopback_server import GREETING, Faults, LoopbackServer, Outage, event, text

from hopdata.steering.live.packets import (
    COMMAND,
    HEADER,
    ClientAbsentError,
    ConnectionLostError,
    LabelError,
    Line,
)
from hopdata.steering.live.stream import (
    BINS,
    CREEP,
    MOST_DRIFT,
    CameraClock,
    MarkerStream,
    Patience,
    Timeline,
)

FAST = float("inf")
EVENT_SHUTTING_DOWN = 12


def states(stream):
    return [status.state for status in stream.states.history()]


def after_the_end(server, stream):
    """Assert that each sent frame is in the buffer, or was counted as garbled."""
    assert server.ended.wait(LONG_S)
    sent = server.counts.frames - server.counts.dropped
    wait_until(lambda: stream.buffer.written + stream.counts.garbled >= sent)


def test_markers_come_by_label_in_metres():
    with linked(100, labels=("boom", "body1"), speed=FAST) as (server, stream):
        stream.wait_until_streaming(LONG_S)
        after_the_end(server, stream)
        frames = stream.buffer.since(0)
    assert [f.number for f in frames] == list(range(1, 101))
    for k, frame in enumerate(frames):
        assert frame.time_s == pytest.approx(k / 100)
        np.testing.assert_allclose(
            frame.markers[:, 0], [1e-3 * (k + 0.3), 1e-3 * k], rtol=1e-6
        )
    assert states(stream)[:3] == ["idle", "connecting", "streaming"]
    assert states(stream)[-1] == "closed"


def test_dropped_frames_and_hidden_markers_are_counted():
    faults = Faults(dropped=0.1, burst_frames=2, hidden=0.1)
    with linked(500, speed=FAST, faults=faults) as (server, stream):
        after_the_end(server, stream)
        assert stream.counts.frames == 500 - server.counts.dropped
        newest = stream.buffer.newest().number
        assert stream.counts.missing == newest - stream.counts.frames > 20
        assert stream.counts.hidden_markers > 100
        unseen = sum(
            int(np.isnan(f.markers[:, 0]).sum()) for f in stream.buffer.since(0)
        )
        assert unseen == stream.counts.hidden_markers


def test_garbled_frames_are_left_out_and_counted():
    with linked(400, speed=FAST, faults=Faults(garbled=0.2, garbled_bytes=20)) as (
        server,
        stream,
    ):
        after_the_end(server, stream)
        assert stream.counts.connections == 1
        assert stream.counts.garbled >= 0.9 * server.counts.garbled > 40
        assert stream.last_fault
        times = [f.time_s for f in stream.buffer.since(0)]
        assert times == sorted(times)


class Untidy(LoopbackServer):
    """Sends every seventh frame again, two others later, and every tenth one place too late."""

    def _send(self, frame, *, garbled=False):
        held = self.__dict__.setdefault("held", {})
        if frame.number % 10 == 0:
            held[frame.number + 1] = frame
            return
        super()._send(frame, garbled=garbled)
        if frame.number in held:
            super()._send(held.pop(frame.number))
        if frame.number % 7 == 0:
            held[frame.number + 2] = frame


def test_frames_that_come_late_or_twice_are_left_out_and_counted():
    with (
        Untidy(ramp(209), LABELS, speed=FAST) as server,
        MarkerStream(LABELS, port=server.port, patience=BRISK, capacity=4096) as stream,
    ):
        assert server.ended.wait(LONG_S)
        wait_until(
            lambda: stream.buffer.written and stream.buffer.newest().number == 209
        )
        numbers = [f.number for f in stream.buffer.since(0)]
        assert {f.epoch for f in stream.buffer.since(0)} == {0}
    assert numbers == [k for k in range(1, 210) if k % 10]
    assert stream.counts.outdated >= 20 + 20
    assert stream.counts.garbled == 0


def test_garbage_between_packets_is_a_clear_error_and_the_stream_comes_back():
    with linked(10**6, outages=[Outage(0.5, kind="garbage")], seed=4) as (_, stream):
        wait_until(
            lambda: stream.counts.connections == 2 and stream.counts.frames > 200
        )
        lost = [s for s in stream.states.history() if s.state == "lost"]
        assert "the stream is not of the protocol" in lost[0].message
        assert stream.counts.broken == 1


@pytest.mark.parametrize(
    "garbage", [bytes(64), HEADER.pack(0, 3) * 9, b"HTTP/1.1 400 Bad Request\r\n"]
)
def test_a_server_of_something_else_is_a_clear_error(garbage):
    """Eight zero bytes are a packet of no length, which the client alone would read for ever."""
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        MarkerStream(LABELS, port=listener.getsockname()[1], patience=BRISK) as stream,
        listener.accept()[0] as connection,
    ):
        connection.sendall(text(COMMAND, GREETING) + garbage)
        status = stream.states.wait_for("lost", timeout_s=LONG_S)
        assert "the stream is not of the protocol" in status.message
    assert our_threads() == []


def test_a_server_that_vanishes_is_reconnected_to():
    with linked(10**6, outages=[Outage(0.5, 0.3, "vanish")]) as (server, stream):
        wait_until(
            lambda: stream.counts.connections == 2 and stream.counts.frames > 200
        )
        assert server.counts.connections == 2
        epochs = [f.epoch for f in stream.buffer.since(0)]
        assert epochs == sorted(epochs)
        assert set(epochs) == {0, 1}
        heard = states(stream)
        assert heard.index("lost") < len(heard) - 1 - heard[::-1].index("streaming")


def test_a_server_that_comes_later_is_found():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with MarkerStream(LABELS, port=port, patience=BRISK) as stream:
        wait_until(lambda: stream.counts.losses >= 2)
        assert "Connect call failed" in stream.states.history()[2].message
        with LoopbackServer(ramp(10**6), LABELS, port=port, speed=10):
            stream.wait_until_streaming(LONG_S)


def test_a_stall_is_stale_and_its_frames_are_late_but_none_is_lost():
    outage = Outage(0.2, 0.25, "stall")
    with linked(60, speed=1.0, outages=[outage]) as (server, stream):
        after_the_end(server, stream)
        assert "stale" in states(stream)
        assert stream.counts.late >= 15
        assert stream.counts.missing == 0
        ages = [f.arrival_s - f.captured_s for f in stream.buffer.since(0)]
        assert max(ages) > 0.2


def test_a_server_that_says_nothing_is_given_up_and_tried_again():
    with linked(10**6, speed=1.0, outages=[Outage(0.1, 1.0, "stall")]) as (
        server,
        stream,
    ):
        wait_until(lambda: server.counts.connections >= 2)
        reasons = [s.message for s in stream.states.history() if s.state == "lost"]
        assert reasons[0].startswith("no frame for")


def test_a_server_that_does_not_answer_is_a_clear_error():
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        MarkerStream(
            LABELS, port=listener.getsockname()[1], patience=Patience(0.1)
        ) as stream,
    ):
        status = stream.states.wait_for("lost", timeout_s=LONG_S)
        assert status.message == "no answer within 0.1 s"


def test_whatever_goes_wrong_in_the_client_is_reported_and_tried_again(monkeypatch):
    calls = []

    async def connect(*_, **options):
        calls.append(options["version"])
        raise AttributeError("in the client")

    monkeypatch.setattr(qtm_rt, "connect", connect)
    with MarkerStream(LABELS, port=1, patience=BRISK) as stream:
        wait_until(lambda: len(calls) >= 3)
        assert stream.states.history()[2].message == "AttributeError('in the client')"
    assert calls[0] == "1.25"


def test_events_of_the_server_are_logged():
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        MarkerStream(LABELS, port=listener.getsockname()[1], patience=BRISK) as stream,
        listener.accept()[0] as connection,
    ):
        connection.sendall(text(COMMAND, GREETING) + event(EVENT_SHUTTING_DOWN))
        wait_until(lambda: "EventQTMShuttingDown" in stream.states.status.message)


def test_a_wrong_label_is_a_clear_error():
    with linked(10**6, labels=("body1", "bom")) as (_, stream):
        with pytest.raises(LabelError, match=r"marker 'bom' .* did you mean 'boom'"):
            stream.wait_until_streaming(LONG_S)
        assert stream.states.status.state == "failed"


def test_a_server_that_comes_back_with_other_markers_is_lost_until_they_are_right():
    server = LoopbackServer(ramp(10**6), LABELS, speed=10).start()
    with MarkerStream(LABELS, port=server.port, patience=BRISK) as stream:
        stream.wait_until_streaming(LONG_S)
        server.close()
        others = ("head", "body2", "body3", "boom")
        with LoopbackServer(ramp(10**6), others, port=server.port, speed=10):
            wait_until(
                lambda: any(
                    "marker 'body1' is not one of" in status.message
                    for status in stream.states.history()
                    if status.state == "lost"
                )
            )
            assert stream.states.status.state in ("lost", "connecting")
        with LoopbackServer(ramp(10**6), LABELS, port=server.port, speed=10):
            assert stream.states.wait_for("streaming", timeout_s=LONG_S)


def test_coordinates_in_other_units_that_cannot_be_are_told():
    far = ((time_s, 1e6 * markers + 1e4) for time_s, markers in ramp(10**6))
    with (
        LoopbackServer(far, LABELS, speed=10) as server,
        MarkerStream(LABELS, port=server.port, patience=BRISK) as stream,
        pytest.raises(ConnectionLostError, match="are its units mm"),
    ):
        wait_until(lambda: stream.counts.garbled > 3)
        stream.wait_until_streaming(0.01)


def test_no_server_at_all_is_a_clear_error():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with (
        MarkerStream(LABELS, port=port, patience=BRISK) as stream,
        pytest.raises(
            ConnectionLostError, match=f"port {port}, within 0.2 s: cannot connect"
        ),
    ):
        stream.wait_until_streaming(0.2)


def test_without_the_client_the_extra_is_named(monkeypatch):
    real = builtins.__import__

    def absent(name, *rest):
        if name == "qtm_rt":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(ClientAbsentError, match=r"pip install 'hopdata\[live\]'"):
        MarkerStream(LABELS).start()


def test_closing_leaves_no_thread_behind_whatever_the_state():
    with linked(10**6, speed=1.0) as (server, stream):
        stream.wait_until_streaming(LONG_S)
        server.begin(Outage(0, 60, "vanish"))
        stream.states.wait_for("lost", timeout_s=LONG_S)
    MarkerStream(LABELS).close()
    assert our_threads() == []


@pytest.mark.parametrize("steps_later", range(4))
def test_a_close_as_the_connection_is_lost_is_not_swallowed(steps_later):
    async def close_after_loss():
        line = Line(print)
        watching = asyncio.create_task(
            MarkerStream(LABELS, patience=Patience(60))._watch(line)
        )
        await asyncio.sleep(0.01)
        line.lost.set()
        for _ in range(steps_later):
            await asyncio.sleep(0)
        accepted = watching.cancel()  # False once the task has ended by itself
        await asyncio.wait([watching])
        line.close()
        return accepted, watching.cancelled()

    accepted, cancelled = asyncio.run(close_after_loss())
    assert accepted == cancelled


def verdicts(frames, rate_hz=100.0):
    timeline = Timeline(rate_hz)
    return [timeline.judge(number, time) for number, time in frames]


def test_frames_in_order_follow_each_other():
    assert verdicts([(k, k / 100) for k in range(1, 6)]) == ["next"] * 5


@pytest.mark.parametrize("rate_hz", [33.3, 50.0, 200 / 3, 150.0, 200.0, 400.0])
@pytest.mark.parametrize("begin_s", [0.0, 1234.567])
def test_at_another_rate_than_was_told_few_frames_are_lost(rate_hz, begin_s):
    told = verdicts([(k, begin_s + k / rate_hz) for k in range(1000)])
    assert told.count("next") >= 990


def test_missing_frames_are_counted():
    timeline = Timeline(100.0)
    timeline.judge(1, 0.01)
    assert timeline.judge(5, 0.05) == "next"
    assert timeline.missing == 3
    timeline.judge(6, 0.06)
    assert timeline.missing == 0


@pytest.mark.parametrize("damaged", [(2, 1e9), (2_000_000, 0.02), (1, 0.02), (0, -5.0)])
def test_one_damaged_frame_does_not_disturb_those_after_it(damaged):
    assert verdicts([(1, 0.01), damaged, (3, 0.03), (4, 0.04)]) == [
        "next", "implausible", "next", "next",
    ]  # fmt: skip


def test_frames_that_come_late_twice_or_out_of_order_are_outdated():
    numbers = [10, 8, 9, 11, 11, 13, 12, 10, 11, 14]
    heard = verdicts([(k, k / 100) for k in numbers])
    late = {1, 2, 4, 6, 7, 8}
    assert heard == ["outdated" if k in late else "next" for k in range(len(numbers))]


@example(first=1, delays=[(4, True), (4, True), (3, True), (2, True), (0, True)])
@given(
    st.integers(1, 60),
    st.lists(st.tuples(st.integers(0, 4), st.booleans()), max_size=300),
)
def test_a_stream_that_is_shuffled_a_little_keeps_its_order_and_its_clock(
    first, delays
):
    """Four frames that are late and sent twice give nine outdated in a row; ten mean a restart."""
    sent = [
        (k + delay, first + k)
        for k, (delay, twice) in enumerate(delays)
        for _ in range(1 + twice)
    ]
    numbers = [number for _, number in sorted(sent)]
    heard = verdicts([(k, k / 100) for k in numbers])
    assert set(heard) <= {"next", "outdated"}
    kept = [k for k, verdict in zip(numbers, heard, strict=True) if verdict == "next"]
    assert kept == sorted(set(kept))
    assert kept == list(
        dict.fromkeys(np.maximum.accumulate(np.array(numbers, int)).tolist())
    )


def test_a_camera_system_that_begins_anew_soon_is_followed_in_the_end():
    frames = [(k, k / 100) for k in [*range(1, 31), *range(1, 31)]]
    assert (
        verdicts(frames)
        == ["next"] * 30 + ["outdated"] * 10 + ["restart"] + ["next"] * 19
    )


def test_a_camera_system_that_begins_anew_is_followed():
    frames = [(900, 9.0), (901, 9.01), (1, 0.01), (2, 0.02), (3, 0.03)]
    assert verdicts(frames) == ["next", "next", "implausible", "restart", "next"]


def test_a_first_frame_that_is_damaged_is_left_behind():
    frames = [(7, 1e12), (8, 0.08), (9, 0.09)]
    assert verdicts(frames) == ["next", "implausible", "restart"]


def test_a_frame_rate_that_is_not_the_one_told_is_put_up_with():
    heard = verdicts([(k, k / 60) for k in range(1, 31)])
    assert heard == ["next"] + ["implausible"] * 10 + ["next"] * 19


def test_without_a_rate_only_the_order_counts():
    assert verdicts([(1, 0.0), (2, 5.0), (2, 6.0)], None) == [
        "next",
        "next",
        "implausible",
    ]


def test_a_held_up_frame_is_as_old_as_it_is():
    clock, rng = CameraClock(), np.random.default_rng(np.random.SeedSequence(2))
    for k in range(200):
        clock.captured(k / 100, 1000.0 + k / 100 + 0.002 + 0.001 * rng.random())
    captured = clock.captured(2.0, 1002.5)
    assert 1002.5 - captured == pytest.approx(0.5 - 0.002, abs=1e-3)


def ages_of(
    drift, *, jitter_s=0.0, held_up=(math.inf, math.inf), seconds=120.0, rate_hz=100.0
):
    """Return how old frames appear beyond their true delay, s, and when they were captured.

    The delay is 2 ms and up to `jitter_s` more. Frames captured in a span come at its
    end.
    """
    clock = CameraClock()
    chance = np.random.default_rng(np.random.SeedSequence(11))
    captured_s = np.arange(0.0, seconds, 1 / rate_hz)
    delay_s = 0.002 + jitter_s * chance.random(len(captured_s))
    arrival_s = captured_s + delay_s
    begin_s, end_s = held_up
    held = (captured_s >= begin_s) & (captured_s < end_s)
    arrival_s = np.where(held, end_s + 0.002, arrival_s)
    arrival_s = np.maximum.accumulate(arrival_s)
    camera_s = captured_s * (1 + drift)
    told_s = [clock.captured(*both) for both in zip(camera_s, arrival_s, strict=True)]
    return np.array(told_s) - captured_s - 0.002, captured_s


DRIFTS = [
    drift * sign for drift in (0.0, 5e-5, 5e-4, 1e-3, 1.5e-3) for sign in (1, -1)
][1:]


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("jitter_s", [0.0, 0.01])
def test_clocks_that_drift_apart_do_not_make_frames_look_old(drift, jitter_s):
    off_s, at_s = ages_of(drift, jitter_s=jitter_s)
    assert np.abs(off_s[at_s < 5.0]).max() < 5e-3 + 1e-3  # until the pace is known
    assert np.abs(off_s[at_s > 5.0]).max() < 1.5e-3


@pytest.mark.parametrize("drift", [0.0, 1e-3, -1e-3])
def test_frames_that_are_held_up_for_seconds_keep_their_time_though_clocks_drift(drift):
    off_s, at_s = ages_of(drift, jitter_s=0.003, held_up=(40.0, 44.0), seconds=80.0)
    held = (at_s >= 40.0) & (at_s < 44.0)
    assert np.abs(off_s[(at_s > 5.0) & ~held]).max() < 1.5e-3
    assert (
        np.abs(off_s[held]).max() < 4.0 * abs(drift) + 1.5e-3
    )  # the pace counts from arrival


@pytest.mark.parametrize("growth", [3e-3, 4e-3, 1e-2])
def test_frames_of_a_queue_that_fills_look_as_old_as_they_are_but_for_what_a_clock_may_drift(
    growth,
):
    """The delay grows by a share of the time: like a clock that drifts, but no clock does so."""
    off_s, at_s = ages_of(-growth, seconds=200.0)
    grown_s = -off_s[-1]
    assert grown_s > 0.9 * (growth - MOST_DRIFT - CREEP) * at_s[-1]
    assert grown_s < growth * at_s[-1]


def test_the_pace_is_no_longer_than_the_last_spans_remember():
    clock = CameraClock()
    for at_s in np.arange(0.0, 200.0, 0.01):
        clock.captured(at_s, at_s)
    assert len(clock._bins) == BINS
