"""A reader of a lab's own format, here of arrays that NumPy saved."""

import numpy as np

from hopdata.recordings.raw import RawRecording


def read_npz(path, rate_hz):
    """Read ``time`` (N,), s, ``positions`` (N, M, 3), m, and ``markers`` (M,)."""
    with np.load(path, allow_pickle=False) as archive:
        time = archive["time"]
        positions = archive["positions"]
        markers = tuple(str(name) for name in archive["markers"])
    rate_hz = rate_hz or 1 / float(np.median(np.diff(time)))
    return RawRecording(markers, time, positions, rate_hz, "m")
