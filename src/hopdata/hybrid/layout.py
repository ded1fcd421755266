"""The driver's memory: which row or slot of its arrays holds what.

All of it lives in arrays, so that the driver can return for more room and go on as if nothing had
happened.
"""

from typing import Any, NamedTuple

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.memory import FloatTable, FloatVector, IntTable, IntVector


def numbers(count: int, first: int = 0) -> Any:
    """Return NumPy integers in a row: for literal ones, Numba compiles a function once each."""
    return np.arange(first, first + count, dtype=np.int64)


# Rows of `states`: the step from Y to END with the slopes there, room to work in, the coefficients
# of its interpolant, and the rows that belong to the method (slopes of its stages, for instance).
# A method reads Y and K1 and fills END and KEND; its interpolant fills P1 and the rows after it.
Y, K1, END, KEND, SCRATCH, SLOPE, P1 = numbers(7)
LARGEST_DEGREE = 32  # of an interpolant
W1 = P1 + LARGEST_DEGREE

# Rows of the tangent's table, which are as long as the state: the flow's Jacobian (n rows), two
# blocks of n rows for the method, these single rows, and what the method has of its own.
PHI_SHIFTED, PHI_SLOPE, F_BEFORE, F_AFTER, ALONG, COLUMN = numbers(6)
# PHI_MOTION begins with the fastest motion squared, by which the method has judged its error;
# RATE_INPUTS is 1 where the rates of the guards may depend on that component of the state's rate.
PHI_MOTION, RATE_INPUTS = numbers(2, 6)
# For differences: four rows of values, which are good, by how much they may err, and what part of
# an increment was small enough lately.
PHI_VALUES, PHI_PART, PHI_ROWS = 8, 14, 15
GAUSS_1, GAUSS_2 = 0.5 - 3.0**0.5 / 6.0, 0.5 + 3.0**0.5 / 6.0  # of a step, for its short tangent

# Rows of `guards`: event functions and their rates at the start of a step, at up to two knots in
# its inside, at its end, and wherever else; the largest |h| over the step, which is the scale of
# its rounding error, second derivatives, how far a guard stays from its surface over the step, and
# its rate along one way, by which those that bend are known (see `watch`), and how large the parts
# were that h is the sum of when it flipped last.
H0, RATE0, _, _, _, _, H1, RATE1, H, RATE, SIZE, BEND, CLEARANCE, RATE_ALONG, PARTS = numbers(15)
GUARD_ROWS = 15

# Rows of `flags`: the number of the instant at which a guard flipped last, how often it has flipped
# then, whether its lock was left open at the start, whether it is known to bend, and its events.
LAST_FLIP, FLIPS, OPEN, BENT, FIRED = numbers(5)
FLAG_ROWS = 5

# Rows of `lists`: the guards that are awake, the heap of those asleep (see `sleep`), the few that
# the step may concern (see `watch`), and those that flip now.
AWAKE, HEAP, NEAR, DUE = numbers(4)
LIST_ROWS = 4

# Rows of `rules`: which crossings are events, how many of these end the integration (0: none), and
# the way of time, -1 for backward.
DIRECTION, TERMINAL, WAY = numbers(3)

# Columns of `methods`. Addresses (0: there is none); the short tangent is that for short steps, the
# derivative the user's.
STEP, INTERPOLANT, TANGENT, SHORT_TANGENT, REFRESH, DERIVATIVE = numbers(6)
# Evaluations that each of them takes.
EVALUATIONS, INTERPOLANT_EVALUATIONS, TANGENT_EVALUATIONS, SHORT_EVALUATIONS = numbers(4, 6)
# The order by which the step is controlled, the interpolant's error in units of the estimated one
# of the step, and whether it is in powers of theta.
ORDER, INTERPOLANT_ERROR, IN_POWERS = numbers(3, 10)
# The methods to change to where events are sparser or denser, where the field is stiff and where it
# is not (-1: none).
SPARSER, DENSER, STIFFER, RELAXED = numbers(4, 13)
LAST_SLOPE, STIFF_TENTHS = numbers(2, 17)  # row of the last stage's slope, limit of stability
METHOD_SLOTS = 19

# Slots of `clock`: the time, the next step, the error of the last one (a logarithm), and its error
# in units of the tolerance.
T, NEXT_DT, LAST_LOG_ERROR, ERROR = numbers(4)
# The last instant of an event, the start of the smooth piece of the trajectory, the length of the
# one before it, and rates of a guard below and above its surface.
INSTANT, SEGMENT, GAP, RATE_BELOW, RATE_ABOVE = numbers(5, 4)
# The length of the step that the interpolant belongs to (0: there is none), the part of the step
# between two of its knots, and the length, s, within which guards that bend were resolved last.
SPAN, PIECE, WINDOW = numbers(3, 9)
# What no event function can have changed by more than since the start; the bound of their rates.
TRAVEL, SPEED = numbers(2, 12)
# How many steps stability has limited, and the fastest motion squared in the last step's Jacobian.
STIFF_SCORE, MOTION = numbers(2, 14)
CLOCK_SLOTS = 16

# Slots of `counts`: evaluations, steps, events, and what has been written of them.
NFEV, NGEV, STEPS, REJECTED, EVENTS, ROWS, EVENT_ROWS, SAMPLES = numbers(8)
# The method, the degree of its interpolant, if there is one, how many pieces the knots make of a
# step, and what is known of the step (see `watch`).
METHOD, DEGREE, PIECES, WATCHED = numbers(4, 8)
# How many guards stand in each of the lists, in their order, how many are known to bend, and which
# one to report.
N_AWAKE, N_ASLEEP, N_NEAR, N_DUE, N_BENT, CULPRIT = numbers(6, 12)
# Instants, those too near to each other, how often a handler has changed the state, and had before
# this instant, the instant at which rates along one way were taken, how often the rates of guards
# that bend were not those of their values, and whether a guard was back before it could be clear.
INSTANTS, CROWD, JUMPS, JUMPS_BEFORE, MEASURED, ROUGH, LOW = numbers(7, 18)
COUNT_SLOTS = 25


# Slots of the desk: addresses of the callbacks and of the driver, room for rows and events, steps
# until Python may look up, addresses of the code for Jacobians (0 if none is wanted) and of the
# desk itself, address and width of each array, then what is asked for (numbers with a fraction in
# the memory of integers; how many rows each step is written down in). Behind it stand the initial
# state and the parameters: a caller writes all that it asks for in one go.
FIELD, GUARDS, GUARD, RATE_BOUND, ON_EVENT, RUN, N_ROWS, N_LOG_ROWS, PATIENCE = numbers(9)
FIRST_ORDER, HERE = numbers(2, 9)
DESK_ARRAYS, N_DESK_ARRAYS, N_DESK_ASKED = 11, 19, 8
DESK_ASKED = DESK_ARRAYS + 2 * N_DESK_ARRAYS
T_START, T_END, RTOL, MAX_STEP, FIRST_STEP = numbers(5, DESK_ASKED)
MAX_STEPS, MAX_EVENTS, ROWS_PER_STEP = numbers(3, DESK_ASKED + 5)
DESK_SLOTS = DESK_ASKED + N_DESK_ASKED
DESK_PLACES = DESK_ARRAYS + 2 * numbers(N_DESK_ARRAYS)
PARAMS, MODE, RULES, ATOL, STATE_TABLE, GUARD_TABLE, FLAG_TABLE, LIST_TABLE = DESK_PLACES[:8]
WAKE_AT, CLOCK, COUNTS, METHOD_TABLE, TANGENT_TABLE, WANTED, SAMPLE_TABLE = DESK_PLACES[8:15]
ROW_TABLE, LOG_TABLE, START_STATE, KEPT = DESK_PLACES[15:]

# Columns of the log: one row holds an event, as time, guard, direction, state before and after its
# handler, and mode; integers stand in the memory of floats.
LOG_TIME, LOG_GUARD, LOG_DIRECTION, LOG_STATES = numbers(4)

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


# How an integration ended: codes as in SciPy (0 end, 1 event, negative failure) and words.

FINISHED, TERMINATED = 0, 1
STEP_UNDERFLOW, FIELD_NOT_FINITE, GUARD_NOT_FINITE, TOO_MANY_STEPS = -1, -2, -3, -4
TOO_MANY_EVENTS, SLIDING, ZENO, GRAZING_IN_JACOBIAN = -5, -6, -7, -8
AFFINE_DIFFERS, JACOBIAN_NOT_FINITE, TIE_IN_JACOBIAN, RATE_DIFFERS = -9, -10, -11, -12
RAISED, NO_LOCK = -13, -14
RUNNING, NEEDS_ROOM, PAUSED, NEEDS_METHOD, BAD_START, BAD_NUMBERS = range(2, 8)  # in the driver

SENTENCES = {
    FINISHED: "The integration reached the end of t_span.",
    TERMINATED: "Event '{guard}' ended the integration at {at}.",
    STEP_UNDERFLOW: "The step fell below the spacing of floating-point times at {at}: "
    "the field is stiff or singular there, or the tolerance cannot be met.",
    FIELD_NOT_FINITE: "The field is NaN or infinite at, or directly after, {at}.",
    GUARD_NOT_FINITE: "Guard '{guard}' is NaN or infinite at, or directly after, {at}.",
    TOO_MANY_STEPS: "max_steps was reached at {at}.",
    TOO_MANY_EVENTS: "max_events was reached at {at}; the last was '{guard}'.",
    SLIDING: "Guard '{guard}' is not live at {at}: the field points into its surface from "
    "both sides (rates {below:+.6g} below and {above:+.6g} above, per second), so the "
    "trajectory would slide along it. Event-selected systems cross their guards.",
    ZENO: "Events pile up at {at}, the last of them '{guard}': the time between them falls "
    "below what floating-point numbers resolve (a Zeno sequence, or chattering).",
    TIE_IN_JACOBIAN: "Several guards flip at {at}, and their handlers change the field or the "
    "state: how much of that belongs to which guard, and so the Jacobian of the flow, is not "
    "known.",
    JACOBIAN_NOT_FINITE: "The derivative of the field or the flow is NaN or infinite near {at}.",
    RATE_DIFFERS: "The rate hdot of guard '{guard}' is not that of its values h, up to {at}: "
    "correct @guards (by dy[0], say, not y[1]; they may jump and have kinks, but not everywhere).",
    RAISED: "It was interrupted, or a function of the system raised an exception, after {at}.",
    NO_LOCK: "on_event has set the lock of guard '{guard}' to what is neither -1 nor +1 at {at}: "
    "mode[k] is the lock of guard k, and the system's own integers stand behind the locks.",
    AFFINE_DIFFERS: "The @affine function does not give the @field function's value at {at}: "
    "they must be the same field, in every mode.",
    GRAZING_IN_JACOBIAN: "Guard '{guard}' is grazed at {at}: its rate is zero, as far as the "
    "tolerance can tell, and the Jacobian of the flow does not exist where it is.",
}


def describe(
    status: int, *, time: float, culprit: int, names: tuple[str, ...], rates: FloatArray
) -> str:
    """Say in a sentence how an integration ended.

    Parameters
    ----------
    status : int
        One of the codes of this module.
    time : float
        Where it ended, s.
    culprit : int
        Number of the guard concerned, -1 if there is none.
    names : tuple of str
        Names of all guards.
    rates : (2,) array
        Rates of that guard's event function just before its last two flips, 1/s.
    """
    guard, (below, above) = names[culprit] if culprit >= 0 else "", rates
    return SENTENCES[status].format(at=f"t = {time:.17g}", guard=guard, below=below, above=above)
