"""The driver's memory: which row or slot of its arrays holds what.

All of it lives in arrays, so that the driver can return for more room and go on as if nothing had
happened.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.compiled.views import FloatTable, FloatVector, IntTable, IntVector

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def index_numbers(count: int) -> Any:
    """Return 0, 1, ... as NumPy integers: for literal ones, Numba compiles a function once each."""
    return np.arange(count, dtype=np.int64)


# Rows of `states`: the step from Y to END, its slopes, room to work in, its interpolant.
Y, K1, K2, K3, K4, K5, K6, K7, END, SCRATCH, SLOPE, P1, P2, P3, P4 = index_numbers(15)
STATE_ROWS = 15

# Rows of `guards`: event functions and their rates at the start, at the end and inside of a step,
# the largest |h| over the step, which is the scale of its rounding error, and second derivatives.
H0, RATE0, H1, RATE1, H, RATE, SIZE, BEND = index_numbers(8)
GUARD_ROWS = 8

# Rows of `flags`: guards that flip now, how often each has flipped at this instant, and whether its
# lock was left open at the start.
DUE, FLIPS, OPEN = index_numbers(3)
FLAG_ROWS = 3

# Rows of `rules`: which crossings are events, and whether these end the integration.
DIRECTION, TERMINAL = index_numbers(2)

# Slots of `clock`. SPAN is the length of the step that the interpolant belongs to, 0 if there is
# none, and ERROR that step's error in units of the tolerance.
T, NEXT_DT, LAST_LOG_ERROR, INSTANT, RATE_BELOW, RATE_ABOVE, SPAN, ERROR = index_numbers(8)
CLOCK_SLOTS = 8

# Slots of `counts`.
(
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
) = index_numbers(10)
COUNT_SLOTS = 10


# Slots of the desk: addresses of the callbacks, then address and width of each array.
FIELD, GUARDS, ON_EVENT = index_numbers(3)
DESK_ARRAYS, N_DESK_ARRAYS = 3, 18
DESK_SLOTS = DESK_ARRAYS + 2 * N_DESK_ARRAYS
DESK_PLACES = DESK_ARRAYS + 2 * index_numbers(N_DESK_ARRAYS)
(
    MODE,
    RULES,
    ATOL,
    STATE_TABLE,
    GUARD_TABLE,
    FLAG_TABLE,
    CLOCK,
    COUNTS,
    WANTED,
    SAMPLE_TABLE,
    ROW_TIME,
    ROW_TABLE,
    LOG_TIME,
    LOG_GUARD,
    LOG_DIRECTION,
    LOG_BEFORE,
    LOG_AFTER,
    LOG_MODE,
) = DESK_PLACES


class Memory(NamedTuple):
    """All that changes during an integration, but for the mode and the output."""

    states: FloatTable
    guards: FloatTable
    flags: IntTable
    clock: FloatVector
    counts: IntVector
