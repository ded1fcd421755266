"""The guards' ranges over a piece of a step, along all paths through their code.

The states of the piece stand as ranges in the rows LEAST to MOST_SLOPE. Where a
comparison in a guard's code has no single answer, the code is run once for each string
of answers, and each guard gets the hull of its ranges. So a guard whose hull has one
sign has it throughout the piece, whichever branches its code takes. Rates hold along
one path only: where a branch is open, a guard may jump, and its rate says nothing.
"""

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import caller, kernel, kernel_apart
from hopdata.hybrid.compiled.memory import IntVector, address_of, int_vector
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.answers import RANGES_NATIVE

BYTES = 8  # of a number

#: Paths through the guards' code that are followed in one piece; beyond them nothing is
#: known of the guards there.
#: Unit: 1. Origin: chosen.
MOST_PATHS = 16

call_ranges = caller(RANGES_NATIVE)


@kernel
def answers_of(m: Memory) -> IntVector:
    """Return the integers in the memory of answers."""
    return int_vector(
        address_of(m.clock) + BYTES * at.ANSWERS,
        answers.N_INTEGERS,
    )


@kernel
def follow(
    p: Problem,
    m: Memory,
    start: float,
    end: float,
    pace: float,
    row: int,
    listed: int,
    count: int,
) -> None:
    """Evaluate guards along one path, into four rows from `row` on.

    Guards that were declared one by one are taken from a list, by its address.
    """
    n = m.states.width
    n_guards = m.guards.width
    states = address_of(m.states)
    call_ranges(
        p.branches, start, end, pace,
        states + BYTES * n * at.LEAST, states + BYTES * n * at.LEAST_SLOPE, n,
        address_of(p.mode), p.mode.width, address_of(p.params), p.params.width,
        address_of(m.guards) + BYTES * n_guards * row, n_guards,
        listed, count, address_of(m.clock) + BYTES * at.ANSWERS,
    )  # fmt: skip


@kernel
def chosen(p: Problem, listed: int, count: int, a: int) -> int:
    """Return guard number `a` of those that are evaluated."""
    return a if p.guard == 0 else int_vector(listed, count)[a]


@kernel
def forget_answers(m: Memory) -> None:
    """Begin a path of no answers."""
    told = answers_of(m)
    for slot in range(answers.N_INTEGERS):
        told[slot] = 0


@kernel_apart
def settle(p: Problem, m: Memory, row: int, listed: int, count: int) -> None:
    """Replace what is not a number by all numbers; all if the path was lost."""
    g = m.guards
    lost = answers_of(m)[answers.LOST] != 0
    for a in range(count):
        k = chosen(p, listed, count, a)
        if lost or not g[row, k] <= g[row + 1, k]:
            g[row, k] = -np.inf
            g[row + 1, k] = np.inf
        if lost or not g[row + 2, k] <= g[row + 3, k]:
            g[row + 2, k] = -np.inf
            g[row + 3, k] = np.inf


@kernel_apart
def first_path(p: Problem, m: Memory, start: float, end: float, pace: float) -> None:
    """Evaluate the guards that are awake along one path, into the rows of the hull."""
    lists = address_of(m.lists)
    listed = lists + BYTES * m.guards.width * at.AWAKE
    forget_answers(m)
    follow(p, m, start, end, pace, at.H_LEAST, listed, m.counts[at.N_AWAKE])


@kernel
def is_open(m: Memory) -> bool:
    """Return whether the last path met an open branch or a jump."""
    told = answers_of(m)
    met = told[answers.OPENED] + told[answers.JUMPED] + told[answers.LOST]
    return met > 0


@kernel
def is_bent(m: Memory) -> bool:
    """Return whether the last path met an open branch, a jump or a kink."""
    return is_open(m) or answers_of(m)[answers.KINKED] > 0


@kernel_apart
def evaluate(
    p: Problem,
    m: Memory,
    start: float,
    end: float,
    pace: float,
    listed: int,
    count: int,
) -> int:
    """Write the guards' ranges over a piece; return the number of evaluations.

    They are written to the rows H_LEAST to RATE_MOST. OPENED, JUMPED, KINKED and LOST
    in the memory of answers then hold what all paths have met, so `is_open` tells
    whether rates say nothing; the other slots hold where it changes sign.

    Parameters
    ----------
    start, end : float
        Times between which the piece lies, s.
    pace : float
        Rate of time along it: 1; or 0, if the rows of the states' rates hold other
        directions.
    listed, count : int
        Address of a list of guards, for those that were declared one by one, and its
        length. If they were declared together, all are evaluated, and `count` is their
        number.
    """
    told = answers_of(m)
    forget_answers(m)
    follow(p, m, start, end, pace, at.H_LEAST, listed, count)
    settle(p, m, at.H_LEAST, listed, count)
    paths = 1
    opened = told[answers.OPENED]
    if opened == 0:
        return paths
    jumped = told[answers.JUMPED]
    kinked = told[answers.KINKED]
    lost = told[answers.LOST]
    bits = next_answers(0, opened)
    while bits >= 0 and paths < MOST_PATHS:
        told[answers.OPENED] = 0
        told[answers.ANSWERS] = bits
        told[answers.JUMPED] = 0
        told[answers.LOST] = 0
        follow(p, m, start, end, pace, at.PATH_LEAST, listed, count)
        settle(p, m, at.PATH_LEAST, listed, count)
        widen(p, m, listed, count)
        paths += 1
        jumped += told[answers.JUMPED]
        kinked = max(kinked, told[answers.KINKED])
        lost |= told[answers.LOST]
        bits = next_answers(bits, told[answers.OPENED])
    if bits >= 0:  # there are more paths
        lost = 1
    told[answers.OPENED] = opened
    told[answers.JUMPED] = jumped
    told[answers.KINKED] = kinked
    told[answers.LOST] = lost
    if bits >= 0:
        settle(p, m, at.H_LEAST, listed, count)
    return paths


@kernel
def next_answers(bits: int, opened: int) -> int:
    """Return the next string of answers, -1 if there is none.

    The first answers are the lowest bits. Strings are taken in the order of a binary
    tree whose leaves are the paths: the last answer that was no becomes yes, and those
    after it are no.
    """
    place = opened - 1
    if place >= answers.N_ANSWERS:
        place = answers.N_ANSWERS - 1
    while place >= 0 and (bits >> place) & 1 == 1:
        place -= 1
    if place < 0:
        return -1
    return (bits & ((1 << place) - 1)) | (1 << place)


@kernel_apart
def widen(p: Problem, m: Memory, listed: int, count: int) -> None:
    """Widen the guards' ranges to those of the last path."""
    g = m.guards
    for a in range(count):
        k = chosen(p, listed, count, a)
        g[at.H_LEAST, k] = min(g[at.H_LEAST, k], g[at.PATH_LEAST, k])
        g[at.H_MOST, k] = max(g[at.H_MOST, k], g[at.PATH_MOST, k])
        g[at.RATE_LEAST, k] = min(g[at.RATE_LEAST, k], g[at.PATH_LEAST_RATE, k])
        g[at.RATE_MOST, k] = max(g[at.RATE_MOST, k], g[at.PATH_MOST_RATE, k])
