import threading
from itertools import pairwise

import numpy as np
import pytest

from hopdata.steering.live.buffer import FrameBuffer


def write(buffer, k):
    buffer.write(np.full((4, 3), float(k)), epoch=0, number=k, time_s=k, arrival_s=k, captured_s=k)


def test_the_newest_frames_are_kept():
    buffer = FrameBuffer(4)
    assert buffer.newest() is None
    assert buffer.since(0) == []
    for k in range(6):
        write(buffer, k)
    assert (len(buffer), buffer.written) == (4, 6)
    assert buffer.newest().number == 5
    assert [f.index for f in buffer.since(0)] == [2, 3, 4, 5]
    assert [f.index for f in buffer.since(4)] == [4, 5]
    assert buffer.since(6) == []


def test_what_is_written_is_a_copy_that_nobody_can_change():
    buffer, markers = FrameBuffer(2), np.zeros((4, 3))
    buffer.write(markers, epoch=0, number=1, time_s=0, arrival_s=0, captured_s=0)
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
