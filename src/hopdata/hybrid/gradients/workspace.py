"""The memory of a backward pass: what it reads, and where it writes.

A line belongs here if it says what a number of the pass is or where it stands. What is
done with it stands in the other modules.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.gradients.tape import CELLS, HEAD, RECORD
from hopdata.hybrid.methods import explicit
from hopdata.hybrid.system import System

# What the backward pass returns besides a status of the driver's: the tape is full, or
# a handler does not repeat what it did.
TAPE_FULL = 100
NOT_REPEATED = 101


# What is read: the run, and the method that made its steps.


class Steps(NamedTuple):
    """The steps of a solution: times (S + 1,) and states after events (S + 1, n)."""

    t: FloatArray
    y: FloatArray


class Flips(NamedTuple):
    """The flips of a solution (E,), in chronological order.

    `row` is the number of the time in `Steps` at which a flip is. `counts` is 1 for
    those that are events of the user's, who is told `told_guard` and `told_direction`.
    `before` and `after` are the states, (E, n).
    """

    row: IntArray
    guard: IntArray
    direction: IntArray
    counts: IntArray
    told_guard: IntArray
    told_direction: IntArray
    before: FloatArray
    after: FloatArray


class Replayed(NamedTuple):
    """Mode (E + 1, m) and parameters (E + 1, p) at the start and after each flip.

    Row e is before flip e. All but the first row are filled by `replay`.
    """

    mode: IntArray
    params: FloatArray


class Tolerance(NamedTuple):
    """Relative tolerance, (1,), and absolute one of each state, (n,)."""

    relative: FloatArray
    absolute: FloatArray


class Run(NamedTuple):
    """A solution, as the pass reads it.

    The loss sees the first `n_shown` states. If there is one more, it is the integral
    of a function along the way.
    """

    steps: Steps
    flips: Flips
    replayed: Replayed
    tolerance: Tolerance
    n_shown: int
    ended_by_event: bool


class FlipInstant(NamedTuple):
    """An instant at which guards flip.

    Its time, the time since the last event, the time span of the run, s; and the
    numbers of its first flip and of that after its last.
    """

    t: float
    since: float
    span: float
    first: int
    last: int


class Tableau(NamedTuple):
    """Coefficients of an explicit method: a (s, s), b (s,), c (s,)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray


@cache
def coefficients(tableau: explicit.Tableau) -> Tableau:
    """Return an explicit method's coefficients as arrays."""
    n = len(tableau.weights)
    a = np.zeros((n, n))
    for k, row in enumerate(tableau.stages, start=1):
        a[k, : len(row)] = row
    return Tableau(a, np.array(tableau.weights), np.array([0.0, *tableau.nodes]))


# What is written.


class Room(NamedTuple):
    """Where the pass writes.

    A tape with its adjoint; rows of traced numbers, as pairs of the same memory as
    floats and as integers; and plain numbers. The derivative of the loss stands in two
    places: that by the state in the row BY_STATE, and that by the parameters in the
    adjoint of their places on the tape, the first after that of constants.
    """

    tape: FloatArray
    links: IntArray  # the tape as integers
    adjoint: FloatArray  # of each place, and n + 2 that are not on the tape
    is_full: IntArray  # (1,), 1 once the tape was too short
    y: FloatArray  # states, (n, CELLS)
    after: FloatArray  # states after an event, (n, CELLS)
    dy: FloatArray  # rates of the states, (n, CELLS)
    params: FloatArray  # (p, CELLS)
    changed: FloatArray  # parameters that a handler may change, (p, CELLS)
    h: FloatArray  # guards, (n_guards, CELLS)
    hdot: FloatArray  # their rates, (n_guards, CELLS)
    time: FloatArray  # (1, CELLS)
    result: FloatArray  # of a loss, (1, CELLS)
    slopes: FloatArray  # of the stages of a step, (s, n)
    slope_places: IntArray  # on the tape, (s, n)
    stage_bounds: IntArray  # first place of each stage, and that after its last, (s, 2)
    by_stage: FloatArray  # derivatives by the stages' states, (s, n)
    set_aside: FloatArray  # adjoint of the parameters meanwhile, (p,)
    kept: FloatArray  # the same, while guards are asked about neighbours, (p,)
    mode: IntArray  # as a handler changes it, (m,)
    locked: IntArray  # the mode with a guard's new lock, (m,)
    limits: FloatArray  # first and last time that the field sees, (2,)
    event_loss: FloatArray  # derivatives by the states before and after it, (2, n)
    rows: FloatArray  # plain numbers, (8, n), and what each holds:


F_BEFORE, F_AFTER, GUARD_BY_STATE, AHEAD, SCRATCH, BY_STATE, KEPT, SIZES = range(8)


def room_for(system: System, p: int, n_stages: int, places: int) -> Room:
    """Return the memory of a pass with p parameters and a tape of so many places."""
    n = system.n_states
    tape = np.zeros(HEAD + RECORD * places)
    guards = max(system.n_guards, 1)
    return Room(
        tape=tape,
        links=tape.view(np.int64),
        adjoint=np.zeros(places + n + 2),
        is_full=np.zeros(1, dtype=np.int64),
        y=np.zeros((n, CELLS)),
        after=np.zeros((n, CELLS)),
        dy=np.zeros((n, CELLS)),
        params=np.zeros((p, CELLS)),
        changed=np.zeros((p, CELLS)),
        h=np.zeros((guards, CELLS)),
        hdot=np.zeros((guards, CELLS)),
        time=np.zeros((1, CELLS)),
        result=np.zeros((1, CELLS)),
        slopes=np.zeros((n_stages, n)),
        slope_places=np.zeros((n_stages, n), dtype=np.int64),
        stage_bounds=np.zeros((n_stages, 2), dtype=np.int64),
        by_stage=np.zeros((n_stages, n)),
        set_aside=np.zeros(p),
        kept=np.zeros(p),
        mode=np.zeros(system.n_modes, dtype=np.int64),
        locked=np.zeros(system.n_modes, dtype=np.int64),
        limits=np.array([-np.inf, np.inf]),
        event_loss=np.zeros((2, n)),
        rows=np.zeros((8, n)),
    )
