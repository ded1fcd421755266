"""Which method takes the next step, if there is a choice.

Where events follow each other closely, each of them cuts a step short, and a cheap step is best;
where they are sparse, a method of high order goes farther for its evaluations.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import (
    DENSER,
    GAP,
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
from hopdata.hybrid.driver.surface import time_resolution
from hopdata.hybrid.methods.rosenbrock import JAC, PIVOTS
from hopdata.hybrid.methods.series import LONGEST
from hopdata.hybrid.methods.stiffness import (
    STIFF,
    explicit_stiffness,
    implicit_stiffness,
    stiffness_score,
)

TIGHT = 1e-7  # relative tolerance from which the method of highest order takes the first step
LONG = 4.0  # steps without an event, after which a method of higher order is worth its cost
SHORT = 2.5  # steps of the cheaper method: events that are nearer to each other are dense
EVERY = 16  # steps: one of so many is tested for stiffness, as long as there is no sign of it
MANY = 1e3  # time resolutions: the shortest step to begin with
VERY_HIGH_ORDER = 16.0  # from which the error obeys its power over many decades: no limits
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
    """Return the method to begin with: of highest order, or one less if tolerances are loose."""
    method = 0
    while p.methods[method, SPARSER] >= 0:
        method = p.methods[method, SPARSER]
    return method - 1 if method > 0 and p.rtol > TIGHT else method


@kernel
def step_ratio(p: Problem, method: int, other: int) -> float:
    """Return how much longer a step of the other method is, by the orders of both."""
    return p.rtol ** (1.0 / p.methods[other, ORDER] - 1.0 / p.methods[method, ORDER])


@kernel
def change_method(p: Problem, m: Memory, other: int) -> None:
    """Change to another method, and guess its step."""
    m.clock[NEXT_DT] *= step_ratio(p, m.counts[METHOD], other)
    m.counts[METHOD] = other


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
def affine_step(p: Problem, m: Memory) -> float:
    """Return the first step in an affine mode: to the end, if its fastest motion allows."""
    left, shortest = p.t_end - m.clock[T], MANY * time_resolution(m.clock[T], 0.0)
    return min(left, max(m.states[LONGEST, 0], shortest))


@kernel
def choose_after_event(p: Problem, m: Memory) -> None:
    """Change to a cheaper method, if the last event is but a few of its steps ago."""
    method = m.counts[METHOD]
    denser, apart = p.methods[method, DENSER], m.clock[T] - m.clock[SEGMENT]
    m.clock[SEGMENT], m.clock[GAP] = m.clock[T], apart
    if p.methods[method, ORDER] >= VERY_HIGH_ORDER:  # the last mode tells nothing of this one
        m.clock[NEXT_DT] = affine_step(p, m)
    if denser >= 0 and apart < SHORT * m.clock[NEXT_DT] * step_ratio(p, method, denser):
        change_method(p, m, denser)
