"""Which frames of a marker are displaced, where several are close to one another.

A parabola through three frames errs if one of them is itself displaced. Beside several
spikes, it may therefore miss frames in which nothing is wrong. So the frames are taken
out one spike at a time, the clearest first: a spike is clear if the frames beside it
lie on one smooth curve, and it does not.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray

#: Frames on either side of a displaced one that are taken to lie on one curve.
#: Unit: frames. Origin: chosen.
SIDE = 3

#: Degree of the curve through the frames on both sides.
#: Unit: 1. Origin: chosen. It follows a linear change of the acceleration.
DEGREE = 3

#: Least ratio of a displacement to what the curve misses of the frames beside it.
#: Unit: 1. Origin: derived: displaced frames beside a good one give 1.2 at most.
CLEAR = 2.0

#: Longest way from a displaced frame to the frames beside it.
#: Unit: frames. Origin: chosen: four are taken out at most on each side.
REACH = 7


@dataclass(frozen=True)
class _Block:
    """Frames in a row that may be displaced: their numbers, and how far each is off."""

    frames: IntArray
    off: FloatArray
    size: float
    clearness: float


def displaced(
    track: FloatArray, first: int, last: int, limits: dict[int, float]
) -> dict[int, float]:
    """Return the displaced frames from `first` to `last`, and how far each is off, m.

    Parameters
    ----------
    track : (N, 3) array
        Positions of one marker, m.
    first, last : int
        First and last frame that may be displaced.
    limits : dict
        Least displacement, m, of so many frames in a row.
    """
    begin = max(first - REACH, 0)
    frames = np.arange(begin, min(last + REACH + 1, len(track)))
    frames = frames[np.isfinite(track[frames]).all(axis=1)]
    found: dict[int, float] = {}
    while True:
        best = _clearest(track, frames, (first, last), limits)
        if best is None:
            return dict(sorted(found.items()))
        is_off = best.off > min(limits.values())
        for frame, off in zip(best.frames[is_off], best.off[is_off], strict=True):
            found[int(frame)] = float(off)
        frames = np.setdiff1d(frames, best.frames[is_off])


def _clearest(
    track: FloatArray,
    frames: IntArray,
    between: tuple[int, int],
    limits: dict[int, float],
) -> _Block | None:
    """Return the clearest displaced frames in a row among those left (K,), if any."""
    best = None
    for length, limit in limits.items():
        for start in range(SIDE, len(frames) - length - SIDE + 1):
            ends = frames[[start, start + length - 1]]
            if ends[0] < between[0] or ends[1] > between[1]:
                continue
            block = _judged(track, frames, start, length)
            if block is None or block.size <= limit or block.clearness <= 0.0:
                continue
            if best is None or block.clearness > best.clearness:
                best = block
    return best


def _judged(
    track: FloatArray, frames: IntArray, start: int, length: int
) -> _Block | None:
    """Return how far `length` frames are off the curve through those beside them."""
    stop = start + length
    inside = frames[start:stop]
    beside = np.concatenate([frames[start - SIDE : start], frames[stop : stop + SIDE]])
    if inside[0] - beside[0] > REACH or beside[-1] - inside[-1] > REACH:
        return None
    middle = 0.5 * (inside[0] + inside[-1])
    curve = np.vander(beside - middle, DEGREE + 1)
    coefficients = np.linalg.lstsq(curve, track[beside], rcond=None)[0]
    missed = np.linalg.norm(track[beside] - curve @ coefficients)
    expected = np.vander(inside - middle, DEGREE + 1) @ coefficients
    off = np.linalg.norm(track[inside] - expected, axis=1)
    size = float(min(off[0], off[-1]))
    return _Block(inside, off, size, size - CLEAR * float(missed))
