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


# Rows of `states`: the step from Y to END with the slopes there, room to work in, the coefficients
# of its interpolant, and the rows that belong to the method (slopes of its stages, for instance).
Y, K1, END, KEND, SCRATCH, SLOPE, P1 = index_numbers(7)
LARGEST_DEGREE = 32  # of an interpolant
W1 = P1 + LARGEST_DEGREE

# Rows of the tangent's table, which are as long as the state: the flow's Jacobian (n rows), two
# blocks of n rows for the method, these single rows, and what the method has of its own.
# PHI_MOTION begins with the fastest motion squared, by which the method has judged its error;
# RATE_INPUTS is 1 where the rates of the guards may depend on that component of the state's rate;
# STEADY begins with 1 if no guard depends on time.
(
    PHI_SHIFTED,
    PHI_SLOPE,
    F_BEFORE,
    F_AFTER,
    ALONG,
    COLUMN,
    PHI_MOTION,
    RATE_INPUTS,
    STEADY,
) = index_numbers(9)
PHI_ROWS = 9
GAUSS_1, GAUSS_2 = 0.5 - 3.0**0.5 / 6.0, 0.5 + 3.0**0.5 / 6.0  # of a step, for its short tangent

# Rows of `guards`: event functions and their rates at the start of a step, at up to two knots in
# its inside, at its end, and wherever else; the largest |h| over the step, which is the scale of
# its rounding error, second derivatives, how far a guard stays from its surface over the step, and
# its rate along one way, by which those that bend are known (see `watch`).
H0, RATE0, _, _, _, _, H1, RATE1, H, RATE, SIZE, BEND, CLEARANCE, RATE_ALONG = index_numbers(14)
GUARD_ROWS = 14

# Rows of `flags`: the number of the instant at which a guard flipped last, how often it has flipped
# then, whether its lock was left open at the start, and whether it is known to bend.
LAST_FLIP, FLIPS, OPEN, BENT = index_numbers(4)
FLAG_ROWS = 4

# Rows of `lists`: the guards that are awake, the heap of those asleep (see `sleep`), the few that
# the step may concern (see `near`), and those that flip now.
AWAKE, HEAP, NEAR, DUE = index_numbers(4)
LIST_ROWS = 4

# Rows of `rules`: which crossings are events, and whether these end the integration.
DIRECTION, TERMINAL = index_numbers(2)

# Columns of `methods`: addresses of step, interpolant, tangent and refresh, evaluations that a step
# and its interpolant take, the interpolant's error in units of the estimated one of the step,
# whether it is in powers of theta, the order by which the step is controlled; the methods to change
# to where events are sparser or denser, where the field is stiff and where it is not (-1: none);
# the row of the last stage's slope, the limit of stability, evaluations that a tangent takes; the
# address of the tangent for short steps (0: none), and evaluations that it takes.
(
    STEP,
    INTERPOLANT,
    TANGENT,
    REFRESH,
    EVALUATIONS,
    INTERPOLANT_EVALUATIONS,
    INTERPOLANT_ERROR,
    IN_POWERS,
    ORDER,
    SPARSER,
    DENSER,
    STIFFER,
    RELAXED,
    LAST_SLOPE,
    STIFF_TENTHS,
    TANGENT_EVALUATIONS,
    SHORT_TANGENT,
    SHORT_TANGENT_EVALUATIONS,
) = index_numbers(18)
METHOD_SLOTS = 18

# Slots of `clock`. SPAN is the length of the step that the interpolant belongs to, 0 if there is
# none, ERROR that step's error in units of the tolerance, SEGMENT the start of the smooth piece of
# the trajectory, GAP the length of the one before it, TRAVEL what no event function can have
# changed by more than since the start, and SPEED the bound of their rates now. STIFF_SCORE counts
# steps that stability limits. MOTION is the fastest motion squared in the last step's Jacobian.
# PIECE is the part of the step between two of its knots, WINDOW the length, s, within which guards
# that bend were resolved last.
(
    T,
    NEXT_DT,
    LAST_LOG_ERROR,
    INSTANT,
    RATE_BELOW,
    RATE_ABOVE,
    SPAN,
    ERROR,
    SEGMENT,
    TRAVEL,
    SPEED,
    STIFF_SCORE,
    GAP,
    MOTION,
    PIECE,
    WINDOW,
) = index_numbers(16)
CLOCK_SLOTS = 16

# Slots of `counts`. DEGREE is that of the interpolant, if there is one, PIECES how many the knots
# make of a step, MEASURED the instant at which rates along one way were taken, N_BENT how many
# guards are known to bend, ROUGH how often their rates were not those of their values, WATCHED
# what is known of the step (see `watch`).
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
    METHOD,
    N_AWAKE,
    N_ASLEEP,
    JUMPS,
    N_NEAR,
    N_DUE,
    INSTANTS,
    DEGREE,
    PIECES,
    MEASURED,
    N_BENT,
    ROUGH,
    WATCHED,
) = index_numbers(23)
COUNT_SLOTS = 23


# Slots of the desk: addresses of the callbacks and of the driver, room for steps and events,
# address and width of each array, then what is asked for (numbers with a fraction in the memory of
# integers; whether each step is written down). Behind it stand the initial state and the
# parameters: a caller writes all that it asks for in one go.
FIELD, GUARDS, GUARD, RATE_BOUND, ON_EVENT, RUN, N_ROWS, N_LOG_ROWS = index_numbers(8)
DESK_ARRAYS, N_DESK_ARRAYS, N_DESK_ASKED = 8, 18, 8

# Columns of the log: one row holds an event, as time, guard, direction, state before and after its
# handler, and mode; integers stand in the memory of floats.
LOG_TIME, LOG_GUARD, LOG_DIRECTION, LOG_STATES = index_numbers(4)

DESK_ASKED = DESK_ARRAYS + 2 * N_DESK_ARRAYS
T_START, T_END, RTOL, MAX_STEP, FIRST_STEP, MAX_STEPS, MAX_EVENTS, EACH_STEP = (
    DESK_ASKED + index_numbers(N_DESK_ASKED)
)
DESK_SLOTS = DESK_ASKED + N_DESK_ASKED
DESK_PLACES = DESK_ARRAYS + 2 * index_numbers(N_DESK_ARRAYS)
(
    PARAMS,
    MODE,
    RULES,
    ATOL,
    STATE_TABLE,
    GUARD_TABLE,
    FLAG_TABLE,
    LIST_TABLE,
    WAKE_AT,
    CLOCK,
    COUNTS,
    METHOD_TABLE,
    TANGENT_TABLE,
    WANTED,
    SAMPLE_TABLE,
    ROW_TABLE,
    LOG_TABLE,
    START_STATE,
) = DESK_PLACES


# How a run is asked for: that it goes on where it was, that the mode is given (else it is zeros).
RESUMED, GIVEN_MODE = 1, 2


class Memory(NamedTuple):
    """All that changes during an integration, but for the mode and the output."""

    states: FloatTable
    guards: FloatTable
    flags: IntTable
    lists: IntTable
    wake_at: FloatVector  # travel at which each guard in the heap must be looked at
    clock: FloatVector
    counts: IntVector
