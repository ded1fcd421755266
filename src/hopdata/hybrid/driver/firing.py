"""What happens at an instant: flip the locks, tell the scene, look again, until nothing flips."""

from __future__ import annotations

from typing import NamedTuple

from hopdata.hybrid.compiled.calls import call_on_event, call_refresh
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.views import FloatTable, IntTable
from hopdata.hybrid.driver.layout import (
    CROWD,
    CULPRIT,
    DIRECTION,
    DUE,
    EVENT_ROWS,
    EVENTS,
    FLIPS,
    H0,
    INSTANT,
    INSTANTS,
    JUMPS,
    K1,
    LAST_FLIP,
    LOG_DIRECTION,
    LOG_GUARD,
    LOG_STATES,
    LOG_TIME,
    METHOD,
    N_DUE,
    RATE0,
    RATE_ABOVE,
    RATE_BELOW,
    REFRESH,
    SPEED,
    TERMINAL,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.driver.near import gather_reached
from hopdata.hybrid.driver.problem import Problem, eval_field, first_not_finite, guards_at_start
from hopdata.hybrid.driver.saltation import saltate, saltate_handlers
from hopdata.hybrid.driver.sleep import speed_at, wake_all
from hopdata.hybrid.driver.surface import mark_due, next_due, remember_residuals, time_resolution
from hopdata.hybrid.status import (
    AFFINE_DIFFERS,
    FIELD_NOT_FINITE,
    GUARD_NOT_FINITE,
    RESET_IN_JACOBIAN,
    RUNNING,
    SLIDING,
    TERMINATED,
    TIE_IN_JACOBIAN,
    ZENO,
)

FLIPS_AT_ONCE = 2  # there and back, as at an impact; a third flip means that the guard is not live
CROWDED = 1000  # instants nearer than this many time resolutions are a crowd
CROWD_BASE, CROWD_PER_GUARD = 100, 10
DISAGREEMENT = 1e-9  # of the field and its affine form, relative to their terms


class Log(NamedTuple):
    """Room for events, one row each; floats and integers are views of the same memory."""

    floats: FloatTable
    integers: IntTable
    n_rows: int


@kernel
def flips_alone(m: Memory, k: int) -> bool:
    """Tell whether no other guard than k has flipped at this instant."""
    for other in range(m.flags.width):
        if other != k and m.flags[LAST_FLIP, other] == m.counts[INSTANTS]:
            return False
    return True


@kernel
def flip(p: Problem, m: Memory) -> int:
    """Flip the locks of all guards that are due; refuse the third flip at one instant."""
    now = m.counts[INSTANTS]
    for a in range(m.counts[N_DUE]):
        k = m.lists[DUE, a]
        side = RATE_BELOW if p.mode[k] < 0 else RATE_ABOVE
        m.clock[side] = m.guards[RATE0, k]
        m.flags[FLIPS, k] = m.flags[FLIPS, k] + 1 if m.flags[LAST_FLIP, k] == now else 1
        m.flags[LAST_FLIP, k] = now
        p.mode[k] = -p.mode[k]
        if m.flags[FLIPS, k] > FLIPS_AT_ONCE:
            m.counts[CULPRIT] = k
            into_surface = m.clock[RATE_BELOW] > 0.0 and m.clock[RATE_ABOVE] < 0.0
            return SLIDING if into_surface and flips_alone(m, k) else ZENO
    return RUNNING


@kernel_in_loop
def fire_one(p: Problem, m: Memory, log: Log, k: int) -> int:
    """Tell the scene that guard k has flipped, if that is an event, and log it.

    Returns TERMINATED if it ends the integration, else RUNNING.
    """
    direction = p.mode[k]
    if p.rules[DIRECTION, k] != 0 and p.rules[DIRECTION, k] != direction:
        return RUNNING
    row, n = m.counts[EVENT_ROWS], m.states.width
    for i in range(n):
        log.floats[row, LOG_STATES + i] = m.states[Y, i]
    stop = p.rules[TERMINAL, k]
    if p.on_event != 0:
        stop |= call_on_event(p.on_event, m.clock[T], m.states, Y, p.mode, p.params, k, direction)
    log.floats[row, LOG_TIME] = m.clock[T]
    log.integers[row, LOG_GUARD], log.integers[row, LOG_DIRECTION] = k, direction
    jumped = False
    for i in range(n):
        jumped = jumped or m.states[Y, i] != log.floats[row, LOG_STATES + i]
        log.floats[row, LOG_STATES + n + i] = m.states[Y, i]
    if jumped:
        m.counts[JUMPS] += 1
        wake_all(m)
    first = LOG_STATES + 2 * n
    n_logged = log.floats.width - first
    for i in range(n_logged):
        log.integers[row, first + i] = p.mode[p.mode.width - n_logged + i]
    m.counts[EVENT_ROWS] += 1
    m.counts[EVENTS] += 1
    return TERMINATED if stop != 0 else RUNNING


@kernel_in_loop
def fire_due(p: Problem, m: Memory, log: Log) -> int:
    """Fire all guards that have just flipped, in their order."""
    status, k = RUNNING, next_due(m, -1)
    while k >= 0:
        ended = fire_one(p, m, log, k) == TERMINATED
        if ended or status == RUNNING:
            m.counts[CULPRIT] = k
        status = TERMINATED if ended else status
        k = next_due(m, k)
    return status


@kernel_in_loop
def refresh(p: Problem, m: Memory) -> int:
    """Evaluate field and guards anew at the present state and mode."""
    eval_field(p, m, m.clock[T], Y, K1)
    m.clock[SPEED] = speed_at(p, m, m.clock[T], Y, K1)
    if first_not_finite(m.states, K1) >= 0 or first_not_finite(m.states, Y) >= 0:
        return FIELD_NOT_FINITE
    address = p.methods[m.counts[METHOD], REFRESH]
    if address != 0 and not call_refresh(address, m.states, p.mode, p.params) < DISAGREEMENT:
        return AFFINE_DIFFERS
    return RUNNING if guards_at_start(p, m, m.clock[T]) else GUARD_NOT_FINITE


@kernel
def too_crowded(m: Memory, resolution: float) -> bool:
    """Count instants that follow each other too closely; tell whether there are too many."""
    n_guards = m.flags.width
    gap = m.clock[T] - m.clock[INSTANT]
    if gap > resolution:
        m.counts[INSTANTS] += 1
    m.counts[CROWD] = m.counts[CROWD] + 1 if gap <= CROWDED * resolution else 0
    m.clock[INSTANT] = m.clock[T]
    return m.counts[CROWD] > CROWD_BASE + CROWD_PER_GUARD * n_guards


@kernel
def keep_culprit(m: Memory) -> None:
    """Remember the first guard that is due as the one to report."""
    m.counts[CULPRIT] = next_due(m, -1)


@kernel_apart
def fire_all(p: Problem, m: Memory, log: Log) -> int:
    """Let all guards in DUE flip, and those that their handlers push across; refresh the field.

    Expects the instant's state in Y, its time in the clock, and its guards in H0 and RATE0.
    """
    resolution = time_resolution(m.clock[T], 0.0)
    if too_crowded(m, resolution):
        keep_culprit(m)
        return ZENO
    while True:
        if p.first_order:
            saltate(p, m)
        status = flip(p, m)
        if status == RUNNING:
            status = fire_due(p, m, log)
        ended = status == TERMINATED
        if status == RUNNING or (ended and p.first_order):
            status = refresh(p, m)
        if p.first_order and status == RUNNING:
            if m.counts[JUMPS] > 0:
                return RESET_IN_JACOBIAN
            if not saltate_handlers(p, m):
                return TIE_IN_JACOBIAN
        if ended and status == RUNNING:
            status = TERMINATED
        if status != RUNNING:
            return status
        gather_reached(p, m, H0, RATE0, resolution)
        if mark_due(p, m, H0, RATE0, resolution) == 0:
            return status
        remember_residuals(p, m, H0)
