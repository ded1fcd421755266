"""Locks at the start: decided by the sign of h, on the surface by its rate, and then its bend."""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.firing import refresh
from hopdata.hybrid.driver.layout import H0, K1, OPEN, RATE, RATE0, SCRATCH, SLOPE, Memory, T, Y
from hopdata.hybrid.driver.problem import Problem, eval_field, guards_at_start, guards_inside
from hopdata.hybrid.status import RUNNING

PASSES = 4  # rates on the surface may depend on the other locks: go round until they agree
LOOK_AHEAD = 1e-6  # of the way to the end of t_span


@kernel
def decide(h: float, rate: float, bend: float) -> int:
    """Return the lock of a guard with these values; exactly zero passes the question on."""
    if h != 0.0:
        return 1 if h > 0.0 else -1
    if rate != 0.0:
        return 1 if rate > 0.0 else -1
    return 1 if bend > 0.0 else -1


@kernel
def look_ahead(p: Problem, m: Memory) -> None:
    """Put the guards' rates a short way ahead into RATE: for a guard at rest, where it bends."""
    s = m.states
    ahead = LOOK_AHEAD * min(p.t_end - m.clock[T], p.max_step)
    for i in range(s.width):
        s[SCRATCH, i] = s[Y, i] + ahead * s[K1, i]
    eval_field(p, m, m.clock[T] + ahead, SCRATCH, SLOPE)
    guards_inside(p, m, m.clock[T] + ahead)


@kernel
def decide_locks(p: Problem, m: Memory) -> bool:
    """Set each lock that was left open; tell whether one has changed."""
    g, changed = m.guards, False
    for k in range(g.width):
        if m.flags[OPEN, k] != 0:
            if g[H0, k] == 0.0 and g[RATE0, k] == 0.0:
                look_ahead(p, m)
            lock = decide(g[H0, k], g[RATE0, k], g[RATE, k])
            changed = changed or lock != p.mode[k]
            p.mode[k] = lock
    return changed


@kernel
def lock_by_side(p: Problem, m: Memory) -> None:
    """Set open locks by the sign of h alone: the field may exist on its own side only."""
    for i in range(m.states.width):
        m.states[K1, i] = 0.0
    guards_at_start(p, m, m.clock[T])
    for k in range(m.guards.width):
        if m.flags[OPEN, k] != 0 and m.guards[H0, k] > 0.0:
            p.mode[k] = 1


@kernel
def settle_locks(p: Problem, m: Memory) -> int:
    """Decide each lock that the caller left open (0), and evaluate field and guards."""
    open_ones = 0
    for k in range(m.guards.width):
        m.flags[OPEN, k] = 1 if p.mode[k] == 0 else 0
        if p.mode[k] == 0:
            p.mode[k] = -1
            open_ones += 1
    if open_ones > 0:
        lock_by_side(p, m)
    for _ in range(PASSES):
        status = refresh(p, m)
        if status != RUNNING or not decide_locks(p, m):
            return status
    return refresh(p, m)
