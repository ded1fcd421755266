"""How a known instant moves with the parameters.

A field jumps where some number g(t, p) of its code changes sign. The field's code for
ranges notes the rate of g. It is run over the short stretch of time in which the
instant was located, with the states as they are: once along the time alone, and once
for each parameter, which then moves as well. The two rates differ by dg/dp, and the
instant tau moves by d tau/dp = -(dg/dp) / (dg/dt).

If several numbers change sign there, they must agree on this. Kinks are left out: the
field is the same on both sides of them, so it does not matter when they are passed.
"""

from math import inf, nan
from typing import NamedTuple

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import float_vector, int_vector
from hopdata.hybrid.driver.paths import BYTES, MOST_RUNS, call_ranges
from hopdata.hybrid.numbers import answers

#: How fast a parameter moves, times the size of the time over that of the parameter.
#: Unit: 1. Origin: chosen: of the size of 1, and no simple fraction, so that the moved
#: place does not stand still.
PACE = 0.6180339887498949

#: Widest range of a rate that counts as known.
#: Unit: 1, of the rate. Origin: chosen.
KNOWN_TO = 1e-6

#: Largest difference between the ways in which one instant moves.
#: Unit: 1, of the movement. Origin: chosen.
SAME_WAY = 1e-6

#: Movement of an instant, for a parameter that changes by its own size, which counts as
#: none.
#: Unit: size of the time. Origin: rounding: some hundred units in the last place.
STILL = 1e-13

#: Jumps on one path through the code that are looked at.
#: Unit: 1. Origin: chosen.
MOST_NOTED = 64

# What is found: no jump, one that moves as is written, one of which this is not known,
# or several that move differently.
NONE = 0
TOLD = 1
UNTOLD = 2
DIFFERENT = 3


class Jump(NamedTuple):
    """Where the field jumps, and the memory to look at it there.

    All memory is given by its address.
    """

    code: int  # the field's code for ranges
    start: float  # the stretch of time in which it jumps
    end: float
    size: float  # of the time
    rows: int  # four rows of states: least, most, least rate, most rate
    n: int  # number of states, with the parameters behind them
    n_varying: int  # number of states without the parameters
    mode: int
    n_modes: int
    params: int  # parameters that are no states
    n_params: int
    answers: int  # memory of answers


@kernel
def set_rows(jump: Jump, y: int) -> None:
    """Let the states be those at address `y`, and the parameters be constant.

    The rates of the states are unknown: so only what depends on time and parameters
    alone has a known rate.
    """
    n = jump.n
    rows = float_vector(jump.rows, 4 * n)
    states = float_vector(y, n)
    for i in range(n):
        varies = i < jump.n_varying
        rows[i] = states[i]
        rows[n + i] = states[i]
        rows[2 * n + i] = -inf if varies else 0.0
        rows[3 * n + i] = inf if varies else 0.0


@kernel
def move(jump: Jump, j: int, pace: float) -> None:
    """Let state j, which is a parameter, change at this pace."""
    rows = float_vector(jump.rows, 4 * jump.n)
    rows[2 * jump.n + j] = pace
    rows[3 * jump.n + j] = pace


@kernel
def size_of(jump: Jump, j: int) -> float:
    """Return the size of state j, 1 if it is zero."""
    size = abs(float_vector(jump.rows, jump.n)[j])
    return size if size > 0.0 else 1.0


@kernel_apart
def look(jump: Jump, bits: int, which: int) -> int:
    """Run the field's code, and note jump number `which`; return how many there are."""
    told = int_vector(jump.answers, answers.N_INTEGERS)
    for slot in range(answers.N_INTEGERS):
        told[slot] = 0
    told[answers.ANSWERS] = bits
    told[answers.WHICH] = which
    call_ranges(
        jump.code, jump.start, jump.end, 1.0,
        jump.rows, jump.rows + 2 * BYTES * jump.n, jump.n,
        jump.mode, jump.n_modes, jump.params, jump.n_params,
        0, 0, 0, 0, jump.answers,
    )  # fmt: skip
    told[answers.WHICH] = 0
    return told[answers.TIMED]


@kernel
def noted_rate(jump: Jump) -> float:
    """Return the rate of what was noted; NaN if it is not known.

    Only what has a rate other than zero is noted.
    """
    note = float_vector(jump.answers, answers.N_SLOTS)
    least = note[answers.TIMED_LEAST_RATE]
    most = note[answers.TIMED_MOST_RATE]
    middle = 0.5 * (least + most)
    if not most - least <= KNOWN_TO * abs(middle):
        return nan
    return middle


@kernel_apart
def movement(jump: Jump, j: int, bits: int, which: int, rate: float) -> float:
    """Return how the instant of a jump moves with parameter j; NaN if it is not known.

    `rate` is the rate along the time alone.
    """
    pace = PACE * size_of(jump, j) / jump.size
    move(jump, j, pace)
    count = look(jump, bits, which)
    moved = noted_rate(jump)
    move(jump, j, 0.0)
    if which >= count:
        return nan
    return (rate - moved) / (pace * rate)


@kernel
def agrees(jump: Jump, j: int, one: float, other: float) -> bool:
    """Return whether two movements with parameter j are the same."""
    least = STILL * jump.size / size_of(jump, j)
    return abs(one - other) <= SAME_WAY * max(abs(one), abs(other)) + least


@kernel_apart
def add_movements(jump: Jump, bits: int, which: int, is_first: bool, into: int) -> int:
    """Write how a jump moves with each parameter, or compare it with the first one."""
    found = float_vector(into, jump.n)
    rate = noted_rate(jump)
    for j in range(jump.n_varying, jump.n):
        moves = movement(jump, j, bits, which, rate)
        if not abs(moves) < inf:
            return UNTOLD
        if is_first:
            found[j] = moves
        elif not agrees(jump, j, moves, found[j]):
            return DIFFERENT
    return TOLD


@kernel_apart
def movements(jump: Jump, y: int, into: int) -> int:
    """Write d tau/dp at the places of the parameters in a row of states.

    The states are at address `y`, the row is at address `into`. Returns what is found:
    NONE, TOLD, UNTOLD or DIFFERENT.
    """
    if jump.code <= 0:
        return NONE
    set_rows(jump, y)
    told = int_vector(jump.answers, answers.N_INTEGERS)
    note = float_vector(jump.answers, answers.N_SLOTS)
    status = NONE
    bits = 0
    for _ in range(MOST_RUNS):
        for which in range(MOST_NOTED):
            if which >= look(jump, bits, which):
                break
            if note[answers.TIMED_KINK] != 0.0:
                continue
            status = add_movements(jump, bits, which, status == NONE, into)
            if status != TOLD:
                return status
        is_lost = told[answers.LOST] != 0 or told[answers.TIMED] > MOST_NOTED
        if is_lost or told[answers.OPENED] > answers.N_ANSWERS:
            return UNTOLD
        bits = answers.next_answers(bits, told[answers.OPENED])
        if bits < 0:
            return status
    return UNTOLD


@kernel
def stands_still(jump: Jump, row: int) -> bool:
    """Return whether an instant does not depend on the parameters."""
    found = float_vector(row, jump.n)
    still = True
    for j in range(jump.n_varying, jump.n):
        still = still and agrees(jump, j, found[j], 0.0)
    return still
