"""The driver's memory: which row or slot of its arrays holds what.

All of it lives in arrays, so that the driver can return for more room and go on as if nothing had
happened.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.views import FloatTable, FloatVector, IntTable, IntVector

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def index_numbers(count: int) -> Any:
    """Return 0, 1, ... as NumPy integers: for literal ones, Numba compiles a function once each."""
    return np.arange(count, dtype=np.int64)


# Rows of `states`: the step from Y to END, its slopes, room to work in, its interpolant.
Y, K1, K2, K3, K4, K5, K6, K7, END, SCRATCH, SLOPE, P1, P2, P3, P4 = index_numbers(15)
STATE_ROWS = 15

# Rows of `guards`: event functions and their rates at the start, at the end and inside of a step,
# and the largest |h| over the step, which is the scale of its rounding error.
H0, RATE0, H1, RATE1, H, RATE, SIZE = index_numbers(7)
GUARD_ROWS = 7

# Rows of `flags`: guards that flip now, how often each has flipped at this instant, and whether its
# lock was left open at the start.
DUE, FLIPS, OPEN = index_numbers(3)
FLAG_ROWS = 3

# Rows of `rules`: which crossings are events, and whether these end the integration.
DIRECTION, TERMINAL = index_numbers(2)

# Slots of `clock`.
T, NEXT_DT, LAST_ERROR, INSTANT, RATE_BELOW, RATE_ABOVE = index_numbers(6)
CLOCK_SLOTS = 6

# Slots of `counts`.
(
    STARTED,
    NFEV,
    NGEV,
    STEPS,
    REJECTED,
    EVENTS,
    ROWS,
    EVENT_ROWS,
    SAMPLES,
    CROWD,
    CULPRIT,
) = index_numbers(11)
COUNT_SLOTS = 11


class Memory(NamedTuple):
    """All that changes during an integration, but for the mode and the output."""

    states: FloatTable
    guards: FloatTable
    flags: IntTable
    clock: FloatVector
    counts: IntVector


def fresh_memory(
    t: float, y0: FloatArray, n_guards: int, first_step: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, IntArray]:
    """Return the arrays of the memory of an integration that starts at `t` from `y0`.

    A `first_step` of 0 has the driver choose one.
    """
    states = np.zeros((STATE_ROWS, len(y0)))
    clock = np.zeros(CLOCK_SLOTS)
    counts = np.zeros(COUNT_SLOTS, dtype=np.int64)
    states[Y] = y0
    clock[T], clock[NEXT_DT], clock[INSTANT] = t, first_step, -np.inf
    counts[CULPRIT] = -1
    guards = np.zeros((GUARD_ROWS, n_guards))
    flags = np.zeros((FLAG_ROWS, n_guards), dtype=np.int64)
    return states, guards, flags, clock, counts
