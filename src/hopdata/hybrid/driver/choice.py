"""Which method takes the next step, if there is a choice.

Where events follow each other closely, each of them cuts a step short, and a cheap step is best;
where they are sparse, a method of high order goes farther for its evaluations.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import (
    DENSER,
    LAST_SLOPE,
    METHOD,
    NEXT_DT,
    ORDER,
    RELAXED,
    SEGMENT,
    SPARSER,
    STEPS,
    STIFF_SCORE,
    STIFF_TENTHS,
    STIFFER,
    Memory,
    T,
)
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.methods.rosenbrock import JAC, PIVOTS
from hopdata.hybrid.methods.stiffness import (
    STIFF,
    explicit_stiffness,
    implicit_stiffness,
    stiffness_score,
)

TIGHT = 1e-7  # relative tolerance from which the method of high order takes the first step
LONG = 3.0  # steps without an event, after which events count as sparse
SHORT = 0.7  # of a step: events that are nearer to each other are dense


EVERY = 16  # steps: one of so many is tested for stiffness, as long as there is no sign of it
RELIEVED = 1.0  # dt times the fastest rate, below which an explicit step of this length will do


@kernel
def watch_stiffness(p: Problem, m: Memory, dt: float) -> None:
    """Count the step just accepted, if stability limits it."""
    method = m.counts[METHOD]
    if p.methods[method, STIFFER] < 0:
        return
    score = m.clock[STIFF_SCORE]
    if score == 0.0 and m.counts[STEPS] % EVERY != 0:
        return
    last, limit = p.methods[method, LAST_SLOPE], 0.1 * p.methods[method, STIFF_TENTHS]
    found = explicit_stiffness(m.states, dt, p.rtol, p.atol, last, m.states.width)
    m.clock[STIFF_SCORE] = stiffness_score(score, found, limit)


@kernel
def relieved(p: Problem, m: Memory) -> bool:
    """Tell whether an explicit method could take a step like the next one."""
    if m.counts[STEPS] % EVERY != 0:
        return False
    n = m.states.width
    found = implicit_stiffness(m.states, m.clock[NEXT_DT], p.rtol, p.atol, JAC, PIVOTS, n)
    return found < RELIEVED


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
    """Change to a method for stiff fields or back, or to one of high order where events are few."""
    method = m.counts[METHOD]
    stiffer, relaxed = p.methods[method, STIFFER], p.methods[method, RELAXED]
    if stiffer >= 0 and m.clock[STIFF_SCORE] >= STIFF:
        m.clock[STIFF_SCORE] = 0.0
        m.counts[METHOD] = stiffer
        return
    if relaxed >= 0 and relieved(p, m):
        m.counts[METHOD] = relaxed
        return
    sparser = p.methods[method, SPARSER]
    if sparser >= 0 and m.clock[T] - m.clock[SEGMENT] > LONG * m.clock[NEXT_DT]:
        change_method(p, m, sparser)


@kernel
def choose_after_event(p: Problem, m: Memory) -> None:
    """Change to the cheap method, if the last event is less than a step ago."""
    denser = p.methods[m.counts[METHOD], DENSER]
    if denser >= 0 and m.clock[T] - m.clock[SEGMENT] < SHORT * m.clock[NEXT_DT]:
        change_method(p, m, denser)
    m.clock[SEGMENT] = m.clock[T]
