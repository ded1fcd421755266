"""A connected server and stream, for the tests of this folder."""

import threading
import time
from contextlib import contextmanager

import numpy as np
from loopback_server import LoopbackServer

from hopdata.steering.live.stream import MarkerStream, Patience

LABELS = ("body1", "body2", "body3", "boom")
LONG_S = 30.0  # a time-out that a loaded machine does not reach
BRISK = Patience(stale_s=0.05, reconnect_s=0.4, retry_s=0.02, longest_retry_s=0.1)


def ramp(n_frames, rate_hz=100.0):
    """Return frames whose markers show their number: x of marker m in frame k is k + m / 10 mm."""
    for k in range(n_frames):
        markers = np.zeros((len(LABELS), 3))
        markers[:, 0] = 1e-3 * (k + np.arange(len(LABELS)) / 10)
        markers[:, 2] = 0.3
        yield k / rate_hz, markers


@contextmanager
def linked(
    n_frames=500, *, speed=10.0, labels=LABELS, patience=BRISK, capacity=4096, **server
):
    """Yield a server of `n_frames` frames and a stream that reads it; close both at the end."""
    with (
        LoopbackServer(ramp(n_frames), LABELS, speed=speed, **server) as served,
        MarkerStream(
            labels, port=served.port, patience=patience, capacity=capacity
        ) as stream,
    ):
        yield served, stream


def wait_until(condition, timeout_s=LONG_S):
    """Wait until a condition holds; fail if it does not become true."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.005)


def our_threads():
    return [t.name for t in threading.enumerate() if t.name.startswith("hopdata-")]
