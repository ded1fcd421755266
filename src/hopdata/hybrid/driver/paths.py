"""The guards' ranges over a piece of a step, along all paths through their code.

The states of the piece stand as ranges in the rows LEAST to MOST_SLOPE. Where a
comparison in a guard's code has no single answer, the code is run once for each string
of answers, and each guard gets the hull of its ranges. So a guard whose hull has one
sign has it throughout the piece, whichever branches its code takes. Rates hold along
one path only: a guard whose ranges differ from path to path may jump, and is marked as
BRANCHED.
"""

from math import inf

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import caller, kernel, kernel_apart
from hopdata.hybrid.compiled.memory import address_of
from hopdata.hybrid.driver.enclosure import enclose
from hopdata.hybrid.driver.problem import Problem, awake, fill_row
from hopdata.hybrid.driver.sleep import choose_ranged, is_inside, waits, widen
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.answers import CHOSEN, RANGES_NATIVE

BYTES = 8  # of a number

#: Most runs of the guards' code over a piece, one for each string of answers.
#: Unit: 1. Origin: chosen.
MOST_RUNS = 16

call_ranges = caller(RANGES_NATIVE)


@kernel
def run_once(p: Problem, m: Memory, start: float, end: float, t_rate: float) -> None:
    """Run the guards' code for the ranges of states and slopes, into rows RANGES.

    Of guards that are left out these are the ranges over a larger piece.
    """
    run_on(p, m, at.LEAST, start, end, t_rate)


@kernel_apart
def run_on(
    p: Problem, m: Memory, least: int, start: float, end: float, t_rate: float
) -> None:
    """Run the guards' code for the four rows of ranges from row `least` on.

    The ranges of the guards go into the rows from RANGES on. `t_rate` is the rate of
    time: 1 along the trajectory (`proof.vary` asks for others).
    """
    n = m.states.width
    n_guards = m.guards.width
    states = address_of(m.states)
    m.counts[at.NGEV] += 1 if p.guards != 0 else m.counts[at.N_AWAKE]
    listed = address_of(m.lists) + BYTES * n_guards * at.AWAKE
    count = m.counts[at.N_AWAKE]
    if m.counts[at.LEFT_OUT] > 0:
        listed = address_of(m.flags) + BYTES * n_guards * at.RANGED
        count = CHOSEN
    call_ranges(
        p.branches, start, end, t_rate,
        states + BYTES * n * least, states + BYTES * n * (least + 2), n,
        address_of(p.mode), p.mode.width, address_of(p.params), p.params.width,
        address_of(m.guards) + BYTES * n_guards * at.RANGES, n_guards,
        listed, count, address_of(m.counts) + BYTES * at.ANSWERS,
    )  # fmt: skip


@kernel
def answer_next(m: Memory, bits: int) -> None:
    """Empty the memory of answers; the next run answers by these bits."""
    c = m.counts
    c[at.ANSWERS + answers.OPENED] = 0
    c[at.ANSWERS + answers.ANSWERS] = bits
    c[at.ANSWERS + answers.JUMPED] = 0
    c[at.ANSWERS + answers.KINKED] = 0
    c[at.ANSWERS + answers.LOST] = 0


@kernel_apart
def join(p: Problem, m: Memory, is_first: bool) -> None:
    """Join the ranges of one run with those of the runs before it.

    A guard whose ranges differ between them branches. NaN stands for any number.
    """
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        branches = 0 if is_first else m.flags[at.BRANCHED, k]
        for end in range(4):
            one = g[at.RANGES + end, k]
            is_least = end % 2 == 0
            if one != one:  # NaN
                one = -inf if is_least else inf
            joined = g[at.H_LEAST + end, k]
            if is_first:
                joined = one
            elif joined != one:
                branches = 1
                joined = min(joined, one) if is_least else max(joined, one)
            g[at.H_LEAST + end, k] = joined
        m.flags[at.BRANCHED, k] = branches


@kernel_apart
def join_all_runs(p: Problem, m: Memory, start: float, end: float) -> bool:
    """Run the guards' code for each other string of answers; the first run is done.

    Returns whether all runs could be made and tell something.
    """
    c = m.counts
    bits = 0
    join(p, m, True)
    for run in range(1, MOST_RUNS + 1):
        opened = c[at.ANSWERS + answers.OPENED]
        if c[at.ANSWERS + answers.LOST] != 0 or opened > answers.N_ANSWERS:
            return False
        bits = answers.next_answers(bits, opened)
        if bits < 0:
            return True
        if run < MOST_RUNS:
            answer_next(m, bits)
            run_once(p, m, start, end, 1.0)
            join(p, m, False)
    return False


@kernel_apart
def leave_out(p: Problem, m: Memory, start: float, end: float) -> None:
    """Leave out guards that are clear of their surfaces in a box around a piece."""
    if is_inside(p, m, start, end):
        m.counts[at.LEFT_USES] += 1
        return
    if waits(m):
        return
    end = widen(p, m, start, end)
    answer_next(m, 0)
    run_on(p, m, at.BOX_LEAST, start, end, 1.0)
    if m.counts[at.ANSWERS + answers.LOST] == 0:
        choose_ranged(p, m)


@kernel_apart
def forget_ranges(m: Memory) -> None:
    """Let the ranges be all numbers."""
    fill_row(m.guards, at.H_LEAST, -inf)
    fill_row(m.guards, at.H_MOST, inf)
    fill_row(m.guards, at.RATE_LEAST, -inf)
    fill_row(m.guards, at.RATE_MOST, inf)


@kernel
def look_over(p: Problem, m: Memory, dt: float, a: float, z: float) -> int:
    """Enclose the guards over a piece; return the first of the four rows of ranges."""
    enclose(m, dt, a, z)
    start = m.clock[at.T] + a * dt
    end = m.clock[at.T] + z * dt
    if p.rules[at.LEAVES_OUT, 0] != 0:
        leave_out(p, m, start, end)
    answer_next(m, 0)
    run_once(p, m, start, end, 1.0)
    c = m.counts
    if c[at.ANSWERS + answers.OPENED] == 0 and c[at.ANSWERS + answers.LOST] == 0:
        return int(at.RANGES)
    if not join_all_runs(p, m, start, end):
        forget_ranges(m)
    return at.H_LEAST
