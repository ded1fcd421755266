"""Events at an instant: flip locks, call the handler, and repeat until no guard flips."""

from typing import NamedTuple

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.memory import FloatTable, IntTable
from hopdata.hybrid.driver import problem
from hopdata.hybrid.driver.jacobian import HANDLERS, RESET, SALTATE, first_order, keep, on_another
from hopdata.hybrid.driver.sleep import speed_at, wake_all
from hopdata.hybrid.driver.watch import gather_reached
from hopdata.hybrid.layout import Memory

FLIPS_AT_ONCE = 2  # flips of a guard at one instant, as at an impact; at a third it is not live
CROWD_BASE, CROWD_PER_GUARD = 100, 10
LOW_FLIGHT = 40  # instants of a crowd that a flight hidden by rounding after an impact counts for
DISAGREEMENT = 1e-9  # allowed difference of field and affine form, relative to their terms


class Log(NamedTuple):
    """Room for events, one per row; floats and integers are views of the same memory."""

    floats: FloatTable
    integers: IntTable
    n_rows: int


@kernel
def flips_alone(m: Memory, k: int) -> bool:
    """Return whether guard k alone has flipped at this instant."""
    for other in range(m.flags.width):
        if other != k and m.flags[at.LAST_FLIP, other] == m.counts[at.INSTANTS]:
            return False
    return True


@kernel
def flip(p: problem.Problem, m: Memory) -> int:
    """Flip the locks of all guards that are due; fail at the third flip of one at this instant.

    The guard slides if the field alone, without a handler at this instant, has turned it back.
    """
    now = m.counts[at.INSTANTS]
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        side = at.RATE_BELOW if p.mode[k] < 0 else at.RATE_ABOVE
        m.clock[side] = m.guards[at.RATE0, k]
        m.flags[at.FLIPS, k] = m.flags[at.FLIPS, k] + 1 if m.flags[at.LAST_FLIP, k] == now else 1
        m.flags[at.LAST_FLIP, k] = now
        p.mode[k] = -p.mode[k]
        if m.flags[at.FLIPS, k] > FLIPS_AT_ONCE:
            m.counts[at.CULPRIT] = k
            into_surface = m.clock[at.RATE_BELOW] > 0.0 and m.clock[at.RATE_ABOVE] < 0.0
            jumped = m.counts[at.JUMPS] > m.counts[at.JUMPS_BEFORE]
            return at.SLIDING if into_surface and flips_alone(m, k) and not jumped else at.ZENO
    return at.RUNNING


@kernel_in_loop
def fire_one(p: problem.Problem, m: Memory, log: Log, k: int) -> int:
    """Call the handler for the flip of guard k if that is an event, and log it.

    Returns TERMINATED if the event ends the integration, otherwise RUNNING.
    """
    direction = p.mode[k]
    if p.rules[at.DIRECTION, k] != 0 and p.rules[at.DIRECTION, k] != direction:
        return at.RUNNING
    row, n = m.counts[at.EVENT_ROWS], m.states.width
    problem.copy_row(m.states, at.Y, log.floats, row, at.LOG_STATES)
    m.flags[at.FIRED, k] += 1
    stop = 1 if 0 < p.rules[at.TERMINAL, k] <= m.flags[at.FIRED, k] else 0
    if p.on_event != 0:
        if p.first_order:
            keep(p, 0)
        t, s = m.clock[at.T], m.states
        stop |= code.call_on_event(p.on_event, t, s, at.Y, p.mode, p.params, k, direction)
    log.floats[row, at.LOG_TIME] = m.clock[at.T]
    log.integers[row, at.LOG_GUARD], log.integers[row, at.LOG_DIRECTION] = k, direction
    jumped = False
    for i in range(n):
        jumped = jumped or m.states[at.Y, i] != log.floats[row, at.LOG_STATES + i]
        log.floats[row, at.LOG_STATES + n + i] = m.states[at.Y, i]
    if p.first_order and p.on_event != 0:
        jumped = first_order(p, RESET, 0.0, row, k, direction) != 0.0
    if jumped:
        m.counts[at.JUMPS] += 1
        wake_all(m)
    first = at.LOG_STATES + 2 * n
    n_logged = log.floats.width - first
    for i in range(n_logged):
        log.integers[row, first + i] = p.mode[p.mode.width - n_logged + i]
    m.counts[at.EVENT_ROWS] += 1
    m.counts[at.EVENTS] += 1
    return at.TERMINATED if stop != 0 else at.RUNNING


@kernel_in_loop
def fire_due(p: problem.Problem, m: Memory, log: Log) -> int:
    """Fire all guards that have just flipped, in the order of their indices."""
    status, k = at.RUNNING, problem.next_due(p, m, -1)
    while k >= 0:
        ended = fire_one(p, m, log, k) == at.TERMINATED
        if ended or status == at.RUNNING:
            m.counts[at.CULPRIT] = k
        status = at.TERMINATED if ended else status
        k = problem.next_due(p, m, k)
    return status


@kernel_in_loop
def refresh(p: problem.Problem, m: Memory) -> int:
    """Evaluate field and guards again at the present state and mode."""
    problem.eval_field(p, m, m.clock[at.T], at.Y, at.K1)
    m.clock[at.SPEED] = speed_at(p, m, m.clock[at.T], at.Y, at.K1)
    wrong = problem.first_not_finite(m.states, at.K1) >= 0
    if wrong or problem.first_not_finite(m.states, at.Y) >= 0:
        return at.FIELD_NOT_FINITE
    address = p.methods[m.counts[at.METHOD], at.REFRESH]
    if address != 0 and not code.call_refresh(address, m.states, p.mode, p.params) < DISAGREEMENT:
        return at.AFFINE_DIFFERS
    return at.RUNNING if problem.guards_at_start(p, m, m.clock[at.T]) else at.GUARD_NOT_FINITE


@kernel
def too_crowded(m: Memory, resolution: float) -> bool:
    """Count instants that follow each other too closely; return whether there are too many."""
    gap = m.clock[at.T] - m.clock[at.INSTANT]
    low = m.counts[at.LOW] != 0 and m.counts[at.JUMPS] > m.counts[at.JUMPS_BEFORE]
    near = low or gap <= problem.CROWDED * resolution
    if gap > resolution:
        m.counts[at.INSTANTS] += 1
        m.counts[at.JUMPS_BEFORE] = m.counts[at.JUMPS]
    m.counts[at.CROWD] = m.counts[at.CROWD] + (LOW_FLIGHT if low else 1) if near else 0
    m.clock[at.INSTANT], m.counts[at.LOW] = m.clock[at.T], 0
    return m.counts[at.CROWD] > CROWD_BASE + CROWD_PER_GUARD * m.flags.width


@kernel_apart
def sets_no_lock(p: problem.Problem, m: Memory) -> bool:
    """Return whether a handler has set an invalid lock; if so, report the guard as culprit."""
    for a in range(m.counts[at.N_AWAKE]):
        k = problem.awake(p, m, a)
        if p.mode[k] * p.mode[k] != 1:
            m.counts[at.CULPRIT] = k
            return True
    return False


@kernel_apart
def fire_all(p: problem.Problem, m: Memory, log: Log) -> int:
    """Flip all guards in DUE and those that their handlers push across; refresh the field.

    On entry the state of the instant is in Y, its time in the clock, its guards in H0 and RATE0.
    """
    resolution, jumps = problem.time_resolution(m.clock[at.T], 0.0), m.counts[at.JUMPS]
    if too_crowded(m, resolution):
        m.counts[at.CULPRIT] = problem.next_due(p, m, -1)
        return at.ZENO
    later = False
    while True:
        pushed = p.first_order != 0 and later and not on_another(m, resolution)
        alone, jumped = pushed or m.counts[at.N_DUE] == 1, m.counts[at.JUMPS] > jumps
        if p.first_order:
            wrong = at.TIE_IN_JACOBIAN
            if pushed or not jumped:
                wrong = int(first_order(p, SALTATE, 0.0, int(pushed), 0, 0))
            if wrong != at.RUNNING:
                m.counts[at.CULPRIT] = problem.next_due(p, m, -1)
                return wrong
        status = flip(p, m)
        if status == at.RUNNING:
            status = fire_due(p, m, log)
        if p.on_event != 0 and sets_no_lock(p, m):
            return at.NO_LOCK
        ended = status == at.TERMINATED
        if status == at.RUNNING or (ended and p.first_order != 0):
            status = refresh(p, m)
        if p.first_order != 0 and status == at.RUNNING:
            tied = not alone and m.counts[at.JUMPS] > jumps
            if first_order(p, HANDLERS, 0.0, int(alone), 0, 0) == 0.0 or tied:
                return at.TIE_IN_JACOBIAN
        if ended and status == at.RUNNING:
            status = at.TERMINATED
        if status != at.RUNNING:
            return status
        problem.remember_parts(p, m)
        gather_reached(p, m, at.H0, at.RATE0, resolution)
        if problem.mark_due(p, m, at.H0, at.RATE0, resolution) == 0:
            return status
        problem.remember_residuals(p, m, at.H0)
        later = True


# Initial locks: decided by the sign of h; on the surface by its rate, and then by its bend.

PASSES = 4  # rounds until the locks agree: rates on the surface may depend on the other locks
LOOK_AHEAD = 1e-6  # fraction of the remaining time span


@kernel
def decide(h: float, rate: float, bend: float) -> int:
    """Return a guard's lock by the sign of h; if that is zero, of its rate; if zero, its bend."""
    told = h if h != 0.0 else rate if rate != 0.0 else bend
    return 1 if told > 0.0 else -1


@kernel
def look_ahead(p: problem.Problem, m: Memory) -> None:
    """Write the guards' rates a short time ahead into RATE: the sign of a resting guard's bend."""
    s = m.states
    ahead = LOOK_AHEAD * min(p.t_end - m.clock[at.T], p.max_step)
    for i in range(s.width):
        s[at.SCRATCH, i] = s[at.Y, i] + ahead * s[at.K1, i]
    problem.eval_field(p, m, m.clock[at.T] + ahead, at.SCRATCH, at.SLOPE)
    problem.eval_guards(p, m, m.clock[at.T] + ahead, at.SCRATCH, at.SLOPE, at.H, at.RATE)


@kernel
def decide_locks(p: problem.Problem, m: Memory) -> bool:
    """Set each lock that was left open, and return whether any lock has changed."""
    g, changed = m.guards, False
    for k in range(g.width):
        if m.flags[at.OPEN, k] != 0:
            if g[at.H0, k] == 0.0 and g[at.RATE0, k] == 0.0:
                look_ahead(p, m)
            lock = decide(g[at.H0, k], g[at.RATE0, k], g[at.RATE, k])
            changed = changed or lock != p.mode[k]
            p.mode[k] = lock
    return changed


@kernel
def lock_by_side(p: problem.Problem, m: Memory) -> None:
    """Set open locks by the sign of h alone: the field may be defined on one side only."""
    problem.fill_row(m.states, at.K1, 0.0)
    problem.guards_at_start(p, m, m.clock[at.T])
    for k in range(m.guards.width):
        if m.flags[at.OPEN, k] != 0 and m.guards[at.H0, k] > 0.0:
            p.mode[k] = 1


@kernel
def settle_locks(p: problem.Problem, m: Memory) -> int:
    """Decide each lock that the caller left open (0), and evaluate field and guards."""
    open_ones = 0
    for k in range(m.guards.width):
        m.flags[at.OPEN, k] = 1 if p.mode[k] == 0 else 0
        if p.mode[k] == 0:
            p.mode[k] = -1
            open_ones += 1
    if open_ones > 0:
        lock_by_side(p, m)
    for _ in range(PASSES):
        status = refresh(p, m)
        if status != at.RUNNING or not decide_locks(p, m):
            return status
    return refresh(p, m)
