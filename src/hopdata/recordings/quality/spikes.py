"""Spikes: one to three frames in which a marker is elsewhere; and jumps to another place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.one_sided import LONGEST_SPIKE, Surprises


@dataclass(frozen=True)
class Spike:
    """A marker that is elsewhere for up to three frames.

    Parameters
    ----------
    marker : str
        Its name.
    start, stop : int
        First frame and the frame after the last, from 0.
    size : float
        How far off it is at least, m.
    """

    marker: str
    start: int
    stop: int
    size: float


@dataclass(frozen=True)
class Jump:
    """A marker that moves to another place between two frames, and no other takes its own.

    Parameters
    ----------
    marker : str
        Its name.
    frame : int
        First frame at the new place, from 0.
    size : float
        Length of the jump, m.
    """

    marker: str
    frame: int
    size: float


def find_spikes(
    missed: Surprises, markers: tuple[str, ...], *, explained: NDArray[np.bool_]
) -> tuple[Spike, ...]:
    """List the spikes.

    Parameters
    ----------
    missed : Surprises
        Misses of the one-sided predictions.
    markers : tuple of str
        The M names.
    explained : (N, M) bool array
        Frames that a swap explains.
    """
    return tuple(
        Spike(markers[e.marker], e.start, e.stop, e.size)
        for e in missed.spikes
        if not explained[e.start : e.stop, e.marker].any()
    )


def find_jumps(
    missed: Surprises, markers: tuple[str, ...], *, explained: NDArray[np.bool_]
) -> tuple[Jump, ...]:
    """List the jumps that are neither spikes nor explained by a swap; see `find_spikes`."""
    near_spike = missed.is_spike
    for _ in range(LONGEST_SPIKE):
        near_spike[1:] |= near_spike[:-1].copy()
        near_spike[:-1] |= near_spike[1:].copy()
    return tuple(
        Jump(markers[e.marker], e.start, e.size)
        for e in missed.steps
        if not (explained[e.start, e.marker] or near_spike[e.start, e.marker])
    )
