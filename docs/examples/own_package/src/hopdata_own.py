"""A reader of NumPy archives and a quadruped on stiffer legs, as an own package."""

from dataclasses import dataclass

import numpy as np

from hopdata.recordings.raw import RawRecording
from hopdata.scenes.quadruped import Quadruped


def read_npz(path, rate_hz):
    """Read ``time`` (N,), s, ``positions`` (N, M, 3), m, and ``markers`` (M,)."""
    with np.load(path, allow_pickle=False) as archive:
        time, places = archive["time"], archive["positions"]
        markers = tuple(str(name) for name in archive["markers"])
    rate_hz = rate_hz or 1 / float(np.median(np.diff(time)))
    return RawRecording(markers, time, places, rate_hz, "m")


@dataclass(frozen=True)
class StiffQuadruped(Quadruped):
    """The quadruped on legs that are stiffer aside by half."""

    side_stiffness_n_m: float = 90.0
