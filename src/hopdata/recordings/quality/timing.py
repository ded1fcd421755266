"""Frames that are missing: by the time stamps, or because all markers skip ahead."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.stretches import quantiles

#: Largest deviation of a step from a whole number of usual ones that is regular.
#: Unit: frames. Origin: chosen.
IRREGULAR = 0.2

#: Sum of three steps in a row from which on the neighbours of the middle one do not
#: compensate it: frames were lost there.
#: Unit: frames. Origin: derived: three regular steps, and half of one that is missing.
LASTING = 3.5

#: Frames on either side of a loss to which a cubic is fitted.
#: Unit: frames. Origin: chosen.
HALF = 5

# Frames processed at a time.
BLOCK = 100_000

#: Most consecutive frames whose loss is looked for.
#: Unit: frames. Origin: chosen.
MOST_LOST = 10

#: Largest misfit, relative to the usual one of a marker; beyond it, something else
#: happened.
#: Unit: 1. Origin: chosen.
MOST_MISFIT = 5.0

#: Least ratio of a step to the usual one where frames are lost.
#: Unit: 1. Origin: chosen. With one frame missing, all markers move twice as far.
FURTHER = 1.5

#: Least sum over the markers of the logarithms by which their fits improve.
#: Unit: 1. Origin: measured: contacts at 30 Hz reach 2.5.
TELLING = 4.0


@dataclass(frozen=True)
class Timing:
    """Result of checking the time stamps.

    Parameters
    ----------
    rate_hz : float
        Rate from the median step, Hz; NaN with fewer than two frames.
    drops : (K, 2) array
        Frame after which frames are missing, from 0, and how many.
    irregular : (J,) array
        Frames whose step to the next is irregular: neither one frame nor several whole
        ones.
    backward : (L,) array
        Frames whose successor does not have a later time stamp.
    jitter_s : float
        Largest deviation of the other steps from the median, s.
    """

    rate_hz: float
    drops: IntArray
    irregular: IntArray
    backward: IntArray
    jitter_s: float

    @property
    def n_dropped(self) -> int:
        """Return the number of frames missing between the stamps."""
        return int(self.drops[:, 1].sum())


def check_stamps(time: FloatArray) -> Timing:
    """Check time stamps (N,), s, against their own median step."""
    steps = np.diff(time)
    is_forward = steps > 0
    step = float(np.median(steps[is_forward])) if is_forward.any() else np.nan
    frames = steps / step
    whole = np.round(frames)
    on_grid = np.abs(frames - whole) <= IRREGULAR
    is_regular = is_forward & on_grid & (whole == 1)
    is_dropped = is_forward & on_grid & (whole > 1) & lasting(frames)
    dropped = np.flatnonzero(is_dropped)
    n_missing = whole[dropped].astype(np.int64) - 1
    # NaN if the clock never moves forward.
    jitter_s = np.abs(steps[is_regular] - step).max(initial=0.0 * step)
    return Timing(
        rate_hz=1 / step,
        drops=np.column_stack([dropped, n_missing]),
        irregular=np.flatnonzero(is_forward & ~is_dropped & ~is_regular),
        backward=np.flatnonzero(~is_forward),
        jitter_s=float(jitter_s),
    )


def lasting(frames: FloatArray) -> BoolArray:
    """Tell which steps (K,), in frames, no neighbour compensates."""
    forward = np.where(frames > 0, frames, 1.0)
    padded = np.pad(forward, 1, constant_values=1.0)
    return np.asarray(padded[:-2] + padded[1:-1] + padded[2:] > LASTING)


def lost_frames(positions: FloatArray) -> IntArray:
    """Find where markers (N, M, 3) fit better if the later frames are n frames later.

    No sign in the time stamps is needed. A marker contributes the logarithm of the
    ratio by which its fit improves, counted down to its usual misfit. The marker with
    the largest gain is left out, since it may have jumped alone.

    Returns
    -------
    (K, 2) array
        Frame after which frames are missing, from 0, and how many.
    """
    if len(positions) < 2 * HALF:
        return np.zeros((0, 2), dtype=np.int64)
    windows = np.lib.stride_tricks.sliding_window_view(positions, 2 * HALF, axis=0)
    usual = _usual_misfit(windows)
    candidates = _windows_that_fit_badly(windows, usual)
    candidates = candidates[_steps_out(positions, candidates + HALF)]

    log_misfits = []
    for n_lost in range(MOST_LOST + 1):
        misfit = _misfit(windows, n_lost, candidates)
        log_misfits.append(np.log(np.fmax(misfit / usual, 1.0)))
    gain = _gain(np.stack(log_misfits))
    best_gain = gain.max(axis=0)
    found: dict[int, int] = {}
    for k in np.argsort(-best_gain, kind="stable"):
        is_apart = all(abs(candidates[k] - other) >= HALF for other in found)
        if gain[:, k].max() > TELLING and is_apart:
            found[int(candidates[k])] = int(gain[:, k].argmax())
    losses = [(k + HALF - 1, n_lost) for k, n_lost in sorted(found.items())]
    return np.reshape(losses, (-1, 2)).astype(int)


def _usual_misfit(windows: FloatArray) -> FloatArray:
    """Return the median misfit of each marker, (M,), from some of the windows."""
    some = windows[:: 1 + len(windows) // BLOCK]
    usual = quantiles(_misfit(some, 0), [0.5])[0]
    usual[~(usual > 0)] = np.inf  # the marker is never seen, or never moves
    return usual


def _windows_that_fit_badly(windows: FloatArray, usual: FloatArray) -> IntArray:
    """Return the windows (K,) that a cubic fits much worse than usual."""

    def badness() -> Iterator[FloatArray]:
        for first in range(0, len(windows), BLOCK):
            misfit = _misfit(windows[first : first + BLOCK], 0)
            yield np.log(np.fmax(misfit / usual, 1.0)).sum(axis=1)

    return np.flatnonzero(np.concatenate(list(badness())) > TELLING)


def _gain(log_misfits: FloatArray) -> FloatArray:
    """Return by how much losses improve the fits in K windows, (n losses, K).

    Parameters
    ----------
    log_misfits : (n losses, K, M) array
        Logarithms of misfits relative to the usual ones; the first is without a loss.
    """
    as_recorded = log_misfits[0]
    explained = np.fmin(log_misfits, as_recorded) < np.log(MOST_MISFIT)
    of_marker = np.where(explained, as_recorded - log_misfits, 0.0)
    return np.asarray(of_marker.sum(axis=2) - of_marker.max(axis=2))


def _steps_out(positions: FloatArray, frames: IntArray) -> BoolArray:
    """Tell at which frames (K,) all markers move further than just before and after."""

    def way(begin: int, end: int) -> FloatArray:
        moved = positions[frames + end] - positions[frames + begin]
        return np.asarray(np.nansum(moved**2, axis=(1, 2)) ** 0.5)

    usual = np.maximum(way(-3, -1), way(0, 2)) / 2  # of two frames
    return np.asarray(way(-1, 0) > FURTHER * usual)


def _misfit(windows: FloatArray, n_lost: int, at: IntArray | None = None) -> FloatArray:
    """Return squares (K, M) that cubics leave in windows with a loss in their middle.

    Parameters
    ----------
    windows : (K', M, 3, 2 HALF) array
        Positions.
    n_lost : int
        Number of frames lost between the halves.
    at : (K,) array, optional
        Windows to use; by default all.
    """
    frames = np.arange(2.0 * HALF) + n_lost * (np.arange(2 * HALF) >= HALF)
    complete = np.linalg.qr(np.vander(frames, 4), mode="complete")[0]
    beside_cubics = complete[:, 4:]
    misfits = []
    for track in np.moveaxis(windows, 1, 0):
        chosen = track if at is None else track[at]
        misfits.append(np.square(chosen @ beside_cubics).sum(axis=(1, 2)))
    return np.stack(misfits, axis=1)
