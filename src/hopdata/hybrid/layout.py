"""Layout of the driver's memory: the meaning of each row and slot of its arrays.

All state is kept in arrays, so the driver can return to ask for more room and then
resume where it was.
"""

from typing import Any, NamedTuple

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.memory import FloatTable, FloatVector, IntTable, IntVector
from hopdata.hybrid.numbers import answers


def numbers(count: int, first: int = 0) -> Any:
    """Return consecutive NumPy integers.

    Numba would recompile a function for each literal one.
    """
    return np.arange(first, first + count, dtype=np.int64)


# Rows of `states`: the step from Y to END with its slopes, scratch space, ranges of
# states and slopes over a piece of the step (lower and upper ends) and their rounding,
# how many terms of a piece are known (see `enclosure`), ranges of states and slopes
# over several steps (see `ahead`) or in which guards are left out (see `sleep`), the
# coefficients of the interpolant from P1 on, and rows that belong to the method (the
# slopes of its stages, for instance). A method reads Y and K1 and fills END and KEND;
# its interpolant fills P1 and the rows after it. P0 is for a copy of Y, before the
# others. `enclosure` needs more rows for each coefficient: they are among those of the
# interpolant that a method of low degree leaves free, else after its own rows.
Y, K1, END, KEND, SCRATCH, SLOPE, LEAST, MOST, LEAST_SLOPE, MOST_SLOPE = numbers(10)
VALUE_GRAIN, SLOPE_GRAIN, PASSES = numbers(3, 10)
BOX_LEAST, BOX_MOST, BOX_LEAST_SLOPE, BOX_MOST_SLOPE = numbers(4, 13)
LARGEST_DEGREE = 32  # largest degree of an interpolant
P0, P1 = numbers(2, 17)
# Largest degree that leaves three free rows for each of its coefficients.
LOW_DEGREE = (LARGEST_DEGREE + 1) // 4 - 1
# Its first number is the address of the structure of a sparse Jacobian (0: none; see
# `methods.sparsity`).
STRUCTURE = P1 + LARGEST_DEGREE
W1 = STRUCTURE + 1

# Rows of the tangent's table, each as long as the state: the flow's Jacobian (n rows),
# two blocks of n rows for the method, the single rows below, n rows from PHI_GROWN on,
# and the method's own rows.
PHI_SHIFTED, PHI_SLOPE, F_BEFORE, F_AFTER, ALONG, COLUMN = numbers(6)
# PHI_MOTION begins with the square of the fastest motion by which the method judged its
# error. RATE_INPUTS is 1 where the guards' rates may depend on that component of the
# state's rate.
PHI_MOTION, RATE_INPUTS = numbers(2, 6)
# For finite differences: four rows of values, flags of the valid ones, their possible
# errors, and the fraction of an increment that was small enough recently.
PHI_VALUES = 8
PHI_PART = 14
# Derivative of a guard.
GRADIENT = 15
# For the error of the columns: the largest size of each state since the start; the
# error of each column over this step, in its own size, and its sum over all steps; the
# sizes by which this step is judged. PHI_ROUGH begins with the error of a step over
# which the field's derivative is not smooth, in tolerances, 0 if it is.
PHI_LARGEST, PHI_STEP_ERROR, PHI_ERROR, PHI_SIZE, PHI_ROUGH = numbers(5, 16)
# From this row on, in the row of each column, the sum of its errors, each relative to
# the size that every column had then: how these grow later is how the errors may grow.
PHI_GROWN = 21
PHI_ROWS = 21
# Gauss nodes of the short tangent.
GAUSS_1 = 0.5 - 3.0**0.5 / 6.0
GAUSS_2 = 0.5 + 3.0**0.5 / 6.0

# Rows of `guards`: event functions and their rates at the start of a step, at both ends
# of a piece inside it, at its end, and at any other place. Then: the largest |h| over
# the step, which is the scale of its rounding error; second derivatives; how far a
# guard is from its surface; and the size of the terms whose sum was h at its last flip.
# Then ranges of values and rates over a piece of the step, as one run of the guards'
# code gives them, and over all answers to its comparisons; what a guard of this size of
# terms may be by rounding alone; and ranges over several steps (see `ahead`).
H0, RATE0, H_LEFT, RATE_LEFT, H_RIGHT, RATE_RIGHT, H1, RATE1 = numbers(8)
H, RATE, SIZE, BEND, CLEARANCE, PARTS = numbers(6, 8)
RANGES = np.int64(14)
H_LEAST, H_MOST, RATE_LEAST, RATE_MOST, GRAIN = numbers(5, 18)
BOX_RANGES = np.int64(23)
GUARD_ROWS = 27

# Rows of `flags`: number of the instant at which a guard last flipped or was due, its
# flips at that instant since the state last jumped (0: it was due, but has not
# flipped), whether its lock was left open at the start, whether it branches within the
# piece of the step, its event count, the number of jumps of the state at its last flip,
# and the number of the instant at which its handler last turned it back. Then the
# direction of its event that a law decides about, 0 if it has none; 0 if its ranges are
# those of a larger piece (see `sleep`); and 1 if it passes a pole where the step ends.
LAST_FLIP, FLIPS, OPEN, BRANCHED, FIRED, AT_JUMP, BOUNCED, DECIDED = numbers(8)
RANGED, AT_POLE = numbers(2, 8)
FLAG_ROWS = 10

# Rows of `lists`: guards that are awake, the heap of sleeping guards (see `sleep`), the
# few that the step may concern (see `watch`), and the guards that flip now.
AWAKE, HEAP, NEAR, DUE = numbers(4)
LIST_ROWS = 4

# Rows of `rules`: which crossings are events, the number of events after which the
# integration ends (0: none), the direction of time, -1 for backward; whether a law
# decides where several guards are due; whether the guard comes to rest where its events
# pile up; and whether guards may be left out of an evaluation for ranges.
DIRECTION, TERMINAL, WAY, BY_LAW, MAY_REST, LEAVES_OUT = numbers(6)

# Columns of `methods`. Addresses first (0: none). The short tangent is the one for
# short steps, the derivative is the user's.
STEP, INTERPOLANT, TANGENT, SHORT_TANGENT, REFRESH, DERIVATIVE = numbers(6)
# Number of evaluations of each of them.
EVALUATIONS, INTERPOLANT_EVALUATIONS, TANGENT_EVALUATIONS = numbers(3, 6)
SHORT_EVALUATIONS = np.int64(9)
# Order of the step control, error of the interpolant in units of the step's estimated
# error, and whether the interpolant is in powers of theta.
ORDER, INTERPOLANT_ERROR, IN_POWERS = numbers(3, 10)
# Methods to change to where events are sparser or denser and where the field becomes
# stiff or non-stiff (-1: none).
SPARSER, DENSER, STIFFER, RELAXED = numbers(4, 13)
# Row of the last stage's slope, and ten times the stability limit.
LAST_SLOPE, STIFF_TENTHS = numbers(2, 17)
# First of the rows in which the interpolant is enclosed.
ENCLOSED_AT = np.int64(19)
METHOD_SLOTS = 20

# Slots of `clock`: time, next step, logarithm of the last step's error, and its error
# in units of the tolerance.
T, NEXT_DT, LAST_LOG_ERROR, ERROR = numbers(4)
# Instant of the last event, start of the current smooth piece of the trajectory, length
# of the previous piece, and rates of a guard below and above its surface.
INSTANT, SEGMENT, GAP, RATE_BELOW, RATE_ABOVE = numbers(5, 4)
# Length of the step that the interpolant belongs to (0: none); length, s, of the piece
# of a step in which the guards are judged first; where to divide a piece, and where
# those begin that only signs have decided (see `proof`).
SPAN, PIECE, CUT, AROUND, DOUBT_AT = numbers(5, 9)
# Bound on the change of any event function since the start, and the bound on their
# rates.
TRAVEL, SPEED = numbers(2, 14)
# Number of steps limited by stability, and squared fastest motion in the last step's
# Jacobian.
STIFF_SCORE, MOTION = numbers(2, 16)
# Start and end of the time for which the ranges over several steps hold, and how many
# of the expected steps they reach ahead (see `ahead`).
BOX_FROM, BOX_TO, REACH = numbers(3, 18)
# Known instants (see `known`): the next one (infinite: none), the last time before it
# and the first time after it at which the field is as on that side; up to where the
# field's own are sought, and how far ahead of there it is looked at first.
STOP, BEFORE_STOP, AFTER_STOP, SOUGHT, LOOK_LENGTH = numbers(5, 21)
# The last time before the known instants that were passed last. Then:
# times between which guards may be left out, and how far the next box for this reaches
# beyond its piece, in pieces (see `sleep`).
PASSED = np.int64(26)
LEFT_FROM, LEFT_TO, LEFT_REACH = numbers(3, 27)
# How far ahead known instants are sought, at least (see `known`).
SEEK_LENGTH = np.int64(30)
CLOCK_SLOTS = 31

# Slots of `counts`: evaluations, steps, events, and the rows of output written.
NFEV, NGEV, STEPS, REJECTED, EVENTS, ROWS, EVENT_ROWS, SAMPLES = numbers(8)
# Method, and degree of its interpolant if it has one; steps in which the guards were
# not proven, and steps in which one turned closer to its surface than the tolerance
# can tell.
METHOD, DEGREE, UNPROVEN, CLOSE = numbers(4, 8)
# Number of guards in each of the lists, in their order; guard to report; pieces of
# steps that were examined.
N_AWAKE, N_ASLEEP, N_NEAR, N_DUE, CULPRIT, LOOKS = numbers(6, 12)
# Instants; instants too close to each other; changes of the state by handlers, and
# those before this instant; whether a guard was back before it was clear.
INSTANTS, CROWD, JUMPS, JUMPS_BEFORE, LOW = numbers(5, 18)
# The instant that is being processed (see `instant`): whether it has begun, flips so
# far, jumps of the state before it, the guard that flips next (-1: none), whether
# several guards met their surfaces together, and whether an event has ended the
# integration.
BEGUN, CASCADE, JUMPS_AT_ENTRY, NEXT, TIED, ENDED = numbers(6, 23)
# Changes of the mode that the log holds.
CHANGES = np.int64(29)
# The proof of a step (see `proof`): steps whose budget of pieces did not suffice;
# whether this step is not proven, whether only signs have decided the last pieces and
# the last one, whether all pieces so far; whether the guards at the start of the piece
# are known; whether one turns too close to tell; where the interpolant in powers of
# theta stands, from the start of the step and of the piece (0: nowhere); the first rows
# of its coefficients in the piece, and of those from the start of a piece; whether it
# is in powers as it comes, and whether the ranges are those of the whole step. Known
# instants that were passed, place of the next single one, stretches of time in which
# those of the field could not be told apart, and instants of which is not known how
# they depend on the parameters (see `moving_instants`). Then the memory of answers to
# comparisons in the code for ranges (see `numbers.answers`).
EXHAUSTED, UNSURE, PENDING, DOUBT, FROM_START, KNOWN, IS_CLOSE = numbers(7, 30)
POWERS_AT, TERMS_AT, PIECE_AT, SHIFTED_AT, ARE_POWERS, ARE_WHOLE = numbers(6, 37)
N_STOPS, NEXT_SINGLE, UNSOUGHT, HELD_FIXED = numbers(4, 43)
# Guards that are left out of evaluations for ranges; pieces for which they have been;
# pieces until this is tried again, and the last number of these.
LEFT_OUT, LEFT_USES, LEFT_WAIT, LEFT_PAUSE = numbers(4, 47)
# Whether an instant was sought along the path at one state only (see `known`), and how
# many guards pass a pole where the step ends; open locks of guards that are zero at the
# start.
BY_STATE, N_POLES, ON_SURFACE, ANSWERS = numbers(4, 51)
COUNT_SLOTS = 54 + answers.N_SLOTS


# Slots of the argument block: addresses of the callbacks and of the driver, room for
# rows and events, steps until control returns to Python, addresses of the code for
# Jacobians (0: not wanted) and of the argument block itself, address of the guards'
# code for ranges (see `numbers`), room for changes of the mode, whether the end of the
# time span is infinite; of known instants, the address of the field's code for ranges,
# whether there may be any, and the number of states that vary. Then address and width
# of each array, and the request (floats stored in the memory of integers; its last
# entries are the number of rows written per step, and whether events are kept). The
# initial state and the parameters follow, so a caller writes its whole request at once.
FIELD, GUARDS, GUARD, RATE_BOUND, ON_EVENT, RUN = numbers(6)
N_ROWS, N_LOG_ROWS, PATIENCE = numbers(3, 6)
FIRST_ORDER, HERE, BRANCHES, N_CHANGES, ENDLESS = numbers(5, 9)
SWITCHES, HAS_STOPS, N_VARYING = numbers(3, 14)
BLOCK_ARRAYS = 17  # slot of the first array
N_BLOCK_ARRAYS = 24
N_BLOCK_ASKED = 9
BLOCK_ASKED = BLOCK_ARRAYS + 2 * N_BLOCK_ARRAYS
T_START, T_END, RTOL, MAX_STEP, FIRST_STEP = numbers(5, BLOCK_ASKED)
MAX_STEPS, MAX_EVENTS, ROWS_PER_STEP, KEEP_EVENTS = numbers(4, BLOCK_ASKED + 5)
BLOCK_SLOTS = BLOCK_ASKED + N_BLOCK_ASKED
BLOCK_PLACES = BLOCK_ARRAYS + 2 * numbers(N_BLOCK_ARRAYS)
PARAMS, MODE, RULES, ATOL = BLOCK_PLACES[:4]
STATE_TABLE, GUARD_TABLE, FLAG_TABLE, LIST_TABLE = BLOCK_PLACES[4:8]
WAKE_AT, CLOCK, COUNTS, METHOD_TABLE = BLOCK_PLACES[8:12]
TANGENT_TABLE, WANTED, SAMPLE_TABLE = BLOCK_PLACES[12:15]
ROW_TABLE, LOG_TABLE, CHANGE_TABLE, LOGGED, START_STATE, KEPT = BLOCK_PLACES[15:21]
# Machine code and rooms for duals (see `numbers.along`); only for Jacobians.
DUAL_TABLE = BLOCK_PLACES[21]
# Known instants: single ones, increasing, and the first and the period of others.
SINGLES, PERIODS = BLOCK_PLACES[22:24]

# The log (see `driver.log`). Each row of its table of events is an event: time, guard,
# direction, number of changes of the mode up to and including it, state before and
# after the handler. Integers are stored in the memory of floats. Each row of the table
# of changes is a place in the mode and its new value: one change takes two numbers,
# where the mode itself would take one per guard.
LOG_TIME, LOG_GUARD, LOG_DIRECTION, LOG_CHANGES, LOG_STATES = numbers(5)
CHANGE_PLACE, CHANGE_VALUE = numbers(2)
CHANGE_WIDTH = 2
# Value of the modes before the first change; a mode of this value is right, too.
UNKNOWN = -(2**63)

# Flags of a run: it resumes where it was; the mode is given (zeros otherwise).
RESUMED = 1
GIVEN_MODE = 2

# Values of HAS_STOPS: there are known instants, and those of the field do not depend on
# the mode.
STOPS, STOPS_IN_ALL_MODES = 1, 2


class Memory(NamedTuple):
    """All memory that changes during an integration, except the mode and the output."""

    states: FloatTable
    guards: FloatTable
    flags: IntTable
    lists: IntTable
    wake_at: FloatVector  # travel at which each guard in the heap must be checked
    clock: FloatVector
    counts: IntVector


# How an integration ended: codes as in SciPy (0 end, 1 event, negative failure), and
# their texts.

FINISHED = 0
TERMINATED = 1
STEP_UNDERFLOW = -1
FIELD_NOT_FINITE = -2
GUARD_NOT_FINITE = -3
TOO_MANY_STEPS = -4
TOO_MANY_EVENTS = -5
SLIDING = -6
ZENO = -7
GRAZING_IN_JACOBIAN = -8
AFFINE_DIFFERS = -9
JACOBIAN_NOT_FINITE = -10
TIE_IN_JACOBIAN = -11
RATE_DIFFERS = -12
RAISED = -13
NO_LOCK = -14
NO_END = -15
STATE_NOT_FINITE = -16
NOT_UNIQUE = -17
INSTANTS_IN_JACOBIAN = -18
UNSOUGHT_IN_JACOBIAN = -19
# Inside the driver only: it goes on, or could not start.
RUNNING = 2
NEEDS_ROOM = 3
PAUSED = 4
NEEDS_METHOD = 5
BAD_START = 6
BAD_NUMBERS = 7

SENTENCES = {
    FINISHED: "The integration reached the end of t_span.",
    TERMINATED: "Event '{guard}' ended the integration at {at}.",
    STEP_UNDERFLOW: "The step fell below the spacing of floating-point times at {at}: "
    "the field is stiff or singular there, the tolerance cannot be met, or states are "
    "near the largest number.",
    FIELD_NOT_FINITE: "The field is NaN or infinite at, or directly after, {at}.",
    GUARD_NOT_FINITE: "Guard '{guard}' is NaN or infinite at, or directly after, {at}.",
    TOO_MANY_STEPS: "max_steps was reached at {at}.",
    TOO_MANY_EVENTS: "max_events was reached at {at}; the last was '{guard}'.",
    SLIDING: "Guard '{guard}' is not live at {at}: the field points into its surface "
    "from both sides (rates {below:+.6g} below and {above:+.6g} above, per second), "
    "so the trajectory would slide along it. Event-selected systems cross their "
    "guards; System(..., sliding=('{guard}',)) lets it slide (docs/sliding.md).",
    ZENO: "Events pile up at {at}, the last of them '{guard}': the time between them "
    "falls below what floating-point numbers resolve (a Zeno sequence, chattering, or "
    "handlers that push guards across without an end, as one does that acts at rises "
    "and falls alike: let it look at direction, or give System(directions=...)).",
    TIE_IN_JACOBIAN: "Several guards flip at {at}, and their order may matter: the "
    "flow depends on it, their handlers change the field or the state, one of them "
    "turns another back, or a handler leaves the state on the surface of another guard "
    "from this start only. So the Jacobian of the flow does not exist or is unknown. "
    "Each order has its own: see `first_order.bouligand_derivative` "
    "(docs/integrator_reference.md, Is it one smooth map?). Impacts with friction: "
    "docs/sliding.md, A foot that lands.",
    INSTANTS_IN_JACOBIAN: "The field jumps at {at}, at an instant that moves with the "
    "parameters in more than one way: two such instants meet there, or t_span begins "
    "there. The flow has no derivative by the parameters.",
    UNSOUGHT_IN_JACOBIAN: "The field may jump near {at}, at instants that were not "
    "found apart: how they move with the parameters, and so the derivative by these, "
    "is unknown. Give them as tstops to System(..., find_tstops=False), which then "
    "takes them as fixed, or write the jump without a pole.",
    JACOBIAN_NOT_FINITE: "The derivative of the field or the flow is NaN or infinite "
    "near {at}.",
    RATE_DIFFERS: "The rate hdot of guard '{guard}' does not match its values h at "
    "{at}, because it jumps there or because @guards computes it wrongly (use dy[0], "
    "say, not y[1]): the flow has no Jacobian across a jump.",
    RAISED: "It was interrupted, or a function of the system raised an exception, "
    "after {at}.",
    NO_LOCK: "on_event has set the lock of guard '{guard}' to neither -1 nor +1 at "
    "{at}: mode[k] is the lock of guard k, and the system's own integers follow the "
    "locks.",
    STATE_NOT_FINITE: "on_event has made the state NaN or infinite at {at}, at a flip "
    "of guard '{guard}': correct what it writes to y.",
    NOT_UNIQUE: "Guard '{guard}' is met at {at} by a trajectory that slides along "
    "another one, and one of them changes the field otherwise for each lock of the "
    "other: the rate along both surfaces is not unique. Let the field be a sum of "
    "terms that each read one lock.",
    NO_END: "Nothing has ended the integration up to {at}, and t_span is infinite: no "
    "terminal event has come, and no handler has returned 1.",
    AFFINE_DIFFERS: "The @affine function does not give the @field function's value "
    "at {at}: they must be the same field, in every mode.",
    GRAZING_IN_JACOBIAN: "Guard '{guard}' is grazed at {at}: its rate is zero to "
    "within the tolerance, and the flow has no Jacobian at a graze.",
}

# Added to these where it is so.
BY_DIFFERENCES = (
    "The Jacobian is in part by finite differences, because these functions do not "
    "compile for dual numbers: {reasons} (docs/gradients.md)."
)
UNPROVEN_STEPS = (
    "In {count} steps it is not proven that no guard flips unseen (docs/integrator.md, "
    "Limits)."
)
ONLY_SAMPLED = (
    "The guards were only sampled, 8 times in a step and 256 times in t_span: a flip "
    "and its return between two samples may be missing. They have no code for ranges: "
    "{reason} (docs/integrator.md, Limits)."
)
CLOSE_CALLS = (
    "In {count} steps a guard turned so close to its surface that the tolerance cannot "
    "tell whether it flips."
)
LIMIT_OF_EVENTS = (
    "By the last gaps between them, their limit is t = {time:.17g}, to within "
    "{error:.2g} s."
)
# What to do, after this sentence; the second if the Jacobian was carried.
PILE_UP = (
    "Let the guard rest there (System(..., sliding=('{guard}',), on_zeno='rest')), or "
    "end the run before, by a handler that returns 1 below a speed (docs/sliding.md, "
    "Events that pile up)."
)
PILE_UP_IN_JACOBIAN = (
    "Its events pile up, {count} of them so far, and their rates vanish: the flow has "
    "no Jacobian through the limit, at rest neither. End the run before, by t_span or "
    "by a handler that returns 1 below a speed (docs/sliding.md, Events that pile up)."
)
DEPENDENT_SURFACES = (
    "Where guards that slide depend on each other, as the friction of two bodies on "
    "the ground and on each other, so that two at rest give a third, no mix of fields "
    "keeps all of them: let the others slide only, and cross the third "
    "(docs/sliding.md, Limits)."
)
HELD_INSTANTS = (
    "The field jumps at {count} known instants of which it cannot be told how they "
    "depend on the parameters: in the derivative by these they are fixed "
    "(docs/known_instants.md)."
)
MISSED_INSTANTS = (
    "Stretches of time in which the field may jump, but its instants were not found: "
    "{count} (`n_unsought`). The derivative by the parameters leaves out how these "
    "move (docs/known_instants.md)."
)
START_ON_SURFACE = (
    "The start lies on the surface of {guards}, where the derivative does not exist: "
    "starts on one side meet the event, those on the other do not. The derivative is "
    "that of the latter; start a little beside the surface, or give `mode`."
)
UNSOUGHT_INSTANTS = (
    "The field's own instants were not sought: {reason}. If it jumps in time, the "
    "derivative by the parameters leaves out how its instants move "
    "(docs/known_instants.md)."
)


def why_unproven(count: int, reason: str) -> str:
    """Return a sentence that says in how many steps nothing is proven, and why.

    Parameters
    ----------
    count : int
        Number of these steps.
    reason : str
        Why the guards have no code for ranges; "" if they have.
    """
    if reason:
        return ONLY_SAMPLED.format(reason=reason)
    return UNPROVEN_STEPS.format(count=count)


# What is left of `TIE_IN_JACOBIAN` where no handler is called.
TIE_OF_LOCKS = (
    "Several guards flip at {at}, and the flow depends on their order, or one of them "
    "turns another back: there is no Jacobian of the flow. Each order has its own: see "
    "`first_order.bouligand_derivative` (docs/c1.md, The derivative of each order)."
)


def describe(
    status: int,
    *,
    time: float,
    culprit: int,
    names: tuple[str, ...],
    rates: FloatArray,
    has_handler: bool = True,
) -> str:
    """Return a sentence that says how an integration ended.

    Parameters
    ----------
    status : int
        One of the codes of this module.
    time : float
        Time at which it ended, s.
    culprit : int
        Index of the guard concerned, -1 if none.
    names : tuple of str
        Names of all guards.
    rates : (2,) array
        Rates of that guard's event function just before its last two flips, 1/s.
    has_handler : bool
        Whether the system has a handler of events.
    """
    guard = names[culprit] if culprit >= 0 else ""
    below, above = rates
    sentence = SENTENCES[status]
    if status == TIE_IN_JACOBIAN and not has_handler:
        sentence = TIE_OF_LOCKS
    return sentence.format(at=f"t = {time:.17g}", guard=guard, below=below, above=above)
