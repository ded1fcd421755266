import asyncio
import threading
from itertools import pairwise

import numpy as np
import pytest
from loopback import LONG_S, our_threads, wait_until

from hopdata.steering.live.buffer import Frame, FrameBuffer, LoopThread, StatusLog


def write(buffer, k):
    buffer.write(Frame(0, k, k, k, k, np.full((4, 3), float(k))))


def test_the_newest_frames_are_kept():
    buffer = FrameBuffer(4)
    assert buffer.newest() is None
    assert buffer.since(0) == []
    for k in range(6):
        write(buffer, k)
    assert (len(buffer.since(0)), buffer.written) == (4, 6)
    assert buffer.newest().number == 5
    assert [f.index for f in buffer.since(0)] == [2, 3, 4, 5]
    assert [f.index for f in buffer.since(4)] == [4, 5]
    assert buffer.since(6) == []


def test_what_is_written_is_a_copy_that_nobody_can_change():
    buffer, markers = FrameBuffer(2), np.zeros((4, 3))
    buffer.write(Frame(0, 1, 0, 0, 0, markers))
    markers[:] = 1
    assert not buffer.newest().markers.any()
    with pytest.raises(ValueError):
        buffer.newest().markers[0, 0] = 1


def test_waiting_ends_with_a_frame_or_the_time_or_a_reason():
    buffer = FrameBuffer(2)
    assert not buffer.wait(0, 0.01)
    assert not buffer.wait(0, 60.0, unless=lambda: True)
    threading.Timer(0.02, write, (buffer, 0)).start()
    assert buffer.wait(0, 60.0)


def test_readers_get_whole_frames_in_order_while_the_writer_runs():
    buffer, failures, done = FrameBuffer(8), [], threading.Event()

    def read():
        seen = 0
        while not done.is_set():
            frames = buffer.since(seen)
            indices = [f.index for f in frames]
            whole = all((f.markers == f.number).all() for f in frames)
            in_a_row = all(later - one == 1 for one, later in pairwise(indices))
            if not (whole and in_a_row) or (indices and indices[0] < seen):
                failures.append(indices)
            seen = indices[-1] + 1 if indices else seen

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    for k in range(3000):
        write(buffer, k)
    done.set()
    for reader in readers:
        reader.join()
    assert not failures


def test_a_buffer_holds_at_least_one_frame():
    with pytest.raises(ValueError, match="capacity"):
        FrameBuffer(0)


async def forever():
    await asyncio.Event().wait()


def test_it_runs_until_it_is_stopped():
    thread, called = LoopThread("hopdata-test", forever), threading.Event()
    thread.start()
    thread.call(called.set)
    assert called.wait(LONG_S)
    assert thread._thread.is_alive()
    thread.close()
    thread.close()
    thread.call(called.set)  # ignored
    assert not thread._thread.is_alive()
    assert thread.failure is None
    assert our_threads() == []


def test_a_failure_is_kept():
    async def fails():
        raise RuntimeError("broken")

    thread = LoopThread("hopdata-test", fails)
    thread.start()
    wait_until(lambda: not thread._thread.is_alive())
    assert str(thread.failure) == "broken"
    thread.close()


def test_states_are_kept_in_order_with_their_reasons():
    log = StatusLog()
    log.report("connecting")
    log.report("lost", "gone")
    assert [s.state for s in log.history()] == ["idle", "connecting", "lost"]
    assert log.status.message == "gone"
    times = [s.at_s for s in log.history()]
    assert times == sorted(times)


def test_waiting_for_a_state():
    log = StatusLog()
    threading.Timer(0.02, log.report, ("streaming",)).start()
    assert log.wait_for("streaming", "failed", timeout_s=LONG_S).state == "streaming"
    assert log.wait_for("lost", timeout_s=0.01) is None
