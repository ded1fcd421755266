"""Which method takes the next step, if there is a choice.

Where events follow each other closely, each of them cuts a step short, and a cheap step is best;
where they are sparse, a method of high order goes farther for its evaluations.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import (
    DENSER,
    METHOD,
    NEXT_DT,
    ORDER,
    SEGMENT,
    SPARSER,
    Memory,
    T,
)
from hopdata.hybrid.driver.problem import Problem

TIGHT = 1e-7  # relative tolerance from which the method of high order takes the first step
LONG = 3.0  # steps without an event, after which events count as sparse
SHORT = 0.7  # of a step: events that are nearer to each other are dense


@kernel
def first_method(p: Problem) -> int:
    """Return the method to begin with."""
    sparser = p.methods[0, SPARSER]
    return sparser if sparser >= 0 and p.rtol <= TIGHT else 0


@kernel
def change_method(p: Problem, m: Memory, method: int) -> None:
    """Change to a method, and guess its step by the orders of both."""
    old = p.methods[m.counts[METHOD], ORDER]
    m.clock[NEXT_DT] *= p.rtol ** (1.0 / p.methods[method, ORDER] - 1.0 / old)
    m.counts[METHOD] = method


@kernel
def choose_after_step(p: Problem, m: Memory) -> None:
    """Change to the method of high order, if no event has come for some steps."""
    sparser = p.methods[m.counts[METHOD], SPARSER]
    if sparser >= 0 and m.clock[T] - m.clock[SEGMENT] > LONG * m.clock[NEXT_DT]:
        change_method(p, m, sparser)


@kernel
def choose_after_event(p: Problem, m: Memory) -> None:
    """Change to the cheap method, if the last event is less than a step ago."""
    denser = p.methods[m.counts[METHOD], DENSER]
    if denser >= 0 and m.clock[T] - m.clock[SEGMENT] < SHORT * m.clock[NEXT_DT]:
        change_method(p, m, denser)
    m.clock[SEGMENT] = m.clock[T]
