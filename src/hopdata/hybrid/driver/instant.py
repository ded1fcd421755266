"""Events at an instant: flip a guard, call its handler, look at all guards again.

An instant is a sequence. Of the guards that are due, one flips, and its handler is
called. Then field and guards are evaluated again, because the handler may have turned
another guard back or pushed a third one across. This goes on until no guard is due.

The order: guards flip by their number, from the lowest to the highest and then from the
lowest again; backward in time it is the other way round. There is one exception. A
guard whose handler changes the state, and that is due again thereby, flips back before
any other one: a bounce is over before the next one begins. Otherwise a second impact on
the same body would meet a lock that is still on the far side, and the guard would not
see it.

The locks are the guards' part of the mode: -1 below and +1 above a guard's surface.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver import problem
from hopdata.hybrid.driver.end_step import HOVER
from hopdata.hybrid.driver.jacobian import (
    ALONE,
    HANDLERS,
    PAST_AT_START,
    PUSHED,
    PUT,
    RESET,
    SALTATE,
    TOGETHER,
    first_order,
    on_another,
)
from hopdata.hybrid.driver.log import Log, begin_event, end_event, is_full
from hopdata.hybrid.driver.resets import keep
from hopdata.hybrid.driver.sleep import speed_at, wake_all
from hopdata.hybrid.driver.watch import gather_reached
from hopdata.hybrid.layout import Memory

#: Flips of a guard at one instant while the state does not jump; at the next one the
#: guard is not live.
#: Unit: 1. Origin: chosen.
FLIPS_AT_ONCE = 2

#: Flips of all guards at one instant, besides those of CASCADE_PER_PAIR. Two bodies and
#: a wall flip 2 pi sqrt(ratio of masses) times (Galperin 2003), so it allows a ratio of
#: 2.5e6; if 1.5 times larger, the ratio is 2.25 times larger. A cascade that does not
#: end costs some milliseconds up to there.
#: Unit: 1. Origin: chosen.
CASCADE_BASE = 10_000

#: Flips of all guards at one instant, times n (n + 1) for n guards. In a row of n
#: guards between equal bodies each pair collides once, which makes n (n + 1) flips.
#: Unit: 1. Origin: derived: twice the flips of equal bodies.
CASCADE_PER_PAIR = 2

#: Instants of a crowd (see `problem.CROWDED`) at which events pile up, besides those of
#: CROWD_PER_GUARD.
#: Unit: 1. Origin: chosen.
CROWD_BASE = 100

#: Instants of a crowd at which events pile up, for each guard.
#: Unit: 1. Origin: chosen.
CROWD_PER_GUARD = 10

#: Instants of a crowd that a flight hidden by rounding after an impact counts for.
#: Unit: 1. Origin: chosen.
LOW_FLIGHT = 40

#: Allowed difference of field and affine form, relative to their terms.
#: Unit: 1. Origin: chosen.
DISAGREEMENT = 1e-9


# A single flip, and its handler.


@kernel
def flips_alone(m: Memory, k: int) -> bool:
    """Return whether guard k alone has flipped at this instant."""
    others = 0
    for other in range(m.flags.width):
        others += 1 if other != k and problem.has_flipped(m, other) else 0
    return others == 0


@kernel
def why_not_live(m: Memory, k: int) -> int:
    """Return the status of guard k, which flips again and again while the state rests.

    It slides if the field alone, without a handler at this instant, has turned it back.
    """
    into_surface = m.clock[at.RATE_BELOW] > 0.0 and m.clock[at.RATE_ABOVE] < 0.0
    jumped = m.counts[at.JUMPS] > m.counts[at.JUMPS_BEFORE]
    if into_surface and flips_alone(m, k) and not jumped:
        return at.SLIDING
    return at.ZENO


@kernel
def flip(p: problem.Problem, m: Memory, k: int) -> int:
    """Flip the lock of guard k, and return a status.

    It fails at the guard's third flip between two jumps of the state, or in an endless
    cascade.
    """
    side = at.RATE_BELOW if p.mode[k] < 0 else at.RATE_ABOVE
    m.clock[side] = m.guards[at.RATE0, k]
    same_state = m.flags[at.AT_JUMP, k] == m.counts[at.JUMPS]
    flips_before = 0
    if problem.has_flipped(m, k) and same_state:
        flips_before = m.flags[at.FLIPS, k]
    m.flags[at.FLIPS, k] = flips_before + 1
    m.flags[at.LAST_FLIP, k] = m.counts[at.INSTANTS]
    m.flags[at.AT_JUMP, k] = m.counts[at.JUMPS]
    m.counts[at.CASCADE] += 1
    p.mode[k] = -p.mode[k]
    if m.flags[at.FLIPS, k] > FLIPS_AT_ONCE:
        m.counts[at.CULPRIT] = k
        return why_not_live(m, k)
    n = m.flags.width
    if m.counts[at.CASCADE] > CASCADE_BASE + CASCADE_PER_PAIR * n * (n + 1):
        m.counts[at.CULPRIT] = k
        return at.ZENO
    return at.RUNNING


@kernel_in_loop
def fire_one(p: problem.Problem, m: Memory, log: Log, k: int) -> int:
    """Call the handler for the flip of guard k if that is an event, and log it.

    Returns TERMINATED if the event ends the integration, otherwise RUNNING.
    """
    direction = p.mode[k]
    if p.rules[at.DIRECTION, k] != 0 and p.rules[at.DIRECTION, k] != direction:
        return at.RUNNING
    row = begin_event(m, log)
    m.flags[at.FIRED, k] += 1
    ends = 0 < p.rules[at.TERMINAL, k] <= m.flags[at.FIRED, k]
    stop = 1 if ends else 0
    if p.on_event != 0:
        if p.first_order:
            keep(p, 0)
        stop |= code.call_on_event(
            p.on_event, m.clock[at.T], m.states, at.Y, p.mode, p.params, k, direction
        )
    jumped = end_event(p, m, log, row, k, direction)
    if p.first_order and p.on_event != 0:
        jumped = first_order(p, RESET, 0.0, row, k, direction) != 0.0
    if jumped:
        m.counts[at.JUMPS] += 1
        wake_all(m)
    m.counts[at.EVENTS] += 1
    if stop != 0:
        return at.TERMINATED
    return at.RUNNING


@kernel_in_loop
def refresh(p: problem.Problem, m: Memory) -> int:
    """Evaluate field and guards again at the present state; return a status."""
    problem.eval_field(p, m, m.clock[at.T], at.Y, at.K1)
    m.clock[at.SPEED] = speed_at(p, m, m.clock[at.T], at.Y, at.K1)
    wrong = problem.first_not_finite(m.states, at.K1) >= 0
    if wrong or problem.first_not_finite(m.states, at.Y) >= 0:
        return at.FIELD_NOT_FINITE
    address = p.methods[m.counts[at.METHOD], at.REFRESH]
    if address != 0:
        difference = code.call_refresh(address, m.states, p.mode, p.params)
        if not difference < DISAGREEMENT:
            return at.AFFINE_DIFFERS
    if not problem.guards_at_start(p, m, m.clock[at.T]):
        return at.GUARD_NOT_FINITE
    return at.RUNNING


@kernel_apart
def sets_invalid_lock(p: problem.Problem, m: Memory) -> bool:
    """Return whether a handler has set an invalid lock; if so, report its guard."""
    # All guards are checked: a handler can reach the locks of sleeping ones, too.
    for k in range(m.flags.width):
        if p.mode[k] * p.mode[k] != 1:
            m.counts[at.CULPRIT] = k
            return True
    return False


# The beginning of an instant.


@kernel
def too_crowded(m: Memory, resolution: float) -> bool:
    """Count instants that follow each other too closely.

    Returns whether there are too many of them.
    """
    gap = m.clock[at.T] - m.clock[at.INSTANT]
    jumped = m.counts[at.JUMPS] > m.counts[at.JUMPS_BEFORE]
    low = m.counts[at.LOW] != 0 and jumped
    if gap > resolution:
        m.counts[at.INSTANTS] += 1
        m.counts[at.JUMPS_BEFORE] = m.counts[at.JUMPS]
    if low:
        m.counts[at.CROWD] += LOW_FLIGHT
    elif gap <= problem.CROWDED * resolution:
        m.counts[at.CROWD] += 1
    else:
        m.counts[at.CROWD] = 0
    m.clock[at.INSTANT] = m.clock[at.T]
    m.counts[at.LOW] = 0
    return m.counts[at.CROWD] > CROWD_BASE + CROWD_PER_GUARD * m.flags.width


@kernel
def count_overshoot_as_rounding(
    p: problem.Problem, m: Memory, k: int, resolution: float
) -> None:
    """Treat the way of guard k past its surface as rounding.

    It is, if the step could not end nearer. Where several guards are passed at once,
    the step ends on one of them, and the others are past by more than their own
    rounding: a slow one leaves the instant unsure by its rounding over its rate, up to
    the fraction HOVER of a step. If the instant turns such a guard back, it is at its
    surface.
    """
    past = -problem.margin_of(p, m, k, at.H0)
    unsure = problem.CROWDED * resolution
    if m.counts[at.N_DUE] > 1:
        unsure = max(unsure, HOVER * (m.clock[at.T] - m.clock[at.SEGMENT]))
    if 0.0 < past <= unsure * abs(m.guards[at.RATE0, k]):
        problem.raise_scale(m, k, past)


@kernel
def begin_instant(p: problem.Problem, m: Memory, resolution: float) -> None:
    """Prepare the sequence.

    All guards in DUE are at their surfaces, even if others flip first.
    """
    m.counts[at.BEGUN] = 1
    m.counts[at.CASCADE] = 0
    m.counts[at.JUMPS_AT_ENTRY] = m.counts[at.JUMPS]
    m.counts[at.TIED] = 0
    m.counts[at.ENDED] = 0
    m.counts[at.NEXT] = problem.next_due(p, m, -1)
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        if m.flags[at.AT_POLE, k] == 0:
            count_overshoot_as_rounding(p, m, k, resolution)
        if m.flags[at.LAST_FLIP, k] != m.counts[at.INSTANTS]:
            m.flags[at.LAST_FLIP, k] = m.counts[at.INSTANTS]
            m.flags[at.FLIPS, k] = 0


# The sequence of flips: which guards are due after each.


@kernel
def stops_bouncing(p: problem.Problem, m: Memory, k: int) -> bool:
    """Return whether guard k, which has bounced here, is no longer turned back.

    Each bounce makes the rates smaller, until nothing is left of them but rounding: the
    sequence has no end that floating-point numbers could show (inelastic collapse,
    McNamara and Young 1992).
    """
    since = m.counts[at.INSTANTS] - m.flags[at.BOUNCED, k]
    here = m.flags[at.BOUNCED, k] > 0 and since <= m.counts[at.CROWD]
    return here and problem.margin_of(p, m, k, at.RATE0) >= 0.0


@kernel
def choose_next(p: problem.Problem, m: Memory, k: int, jumped: bool) -> None:
    """Choose the guard that flips after guard k.

    `jumped` says whether the handler of guard k has made the state jump.
    """
    if jumped and problem.is_marked(m, k):
        m.counts[at.NEXT] = k
        m.flags[at.BOUNCED, k] = m.counts[at.INSTANTS]
        return
    m.counts[at.NEXT] = problem.next_due(p, m, k)
    if m.counts[at.NEXT] < 0:
        m.counts[at.NEXT] = problem.next_due(p, m, -1)


@kernel
def is_due_still(p: problem.Problem, m: Memory, k: int, resolution: float) -> bool:
    """Return whether guard k flips now, by the values after the last handler."""
    return problem.flips_now(p, m, k, at.H0, at.RATE0, resolution)


@kernel
def keep_due(p: problem.Problem, m: Memory, resolution: float) -> None:
    """Keep in DUE the guards that are due still and have not flipped here."""
    total = 0
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        if not problem.has_flipped(m, k) and is_due_still(p, m, k, resolution):
            m.lists[at.DUE, total] = k
            total += 1
    m.counts[at.N_DUE] = total


@kernel_apart
def look_after(p: problem.Problem, m: Memory, resolution: float) -> None:
    """Put the guards into DUE that flip now, after those in it have flipped."""
    problem.remember_parts(p, m)
    gather_reached(p, m, at.H0, at.RATE0, resolution)
    problem.mark_due(p, m, at.H0, at.RATE0, resolution)
    problem.remember_residuals(p, m, m.clock[at.T], at.Y, at.H0, at.RATE0, resolution)


@kernel_in_loop
def look_anew(p: problem.Problem, m: Memory, k: int, resolution: float) -> None:
    """Put the guards into DUE that flip now, after guard k has flipped."""
    if m.counts[at.CASCADE] > 1:
        # At the first flip the terms of all due guards are measured, later those of the
        # guard that has flipped.
        problem.mark_one(m, k)
    look_after(p, m, resolution)


# The flow's Jacobian across a flip.


@kernel
def kind_of_flip(p: problem.Problem, m: Memory, k: int, resolution: float) -> int:
    """Return how guard k, the next one, comes to flip, for the Jacobian of the flow."""
    at_start = m.clock[at.T] == p.t_start and m.counts[at.CASCADE] == 0
    if at_start and not problem.on_surface(m, k, resolution):
        return PAST_AT_START
    meets_surface = on_another(m, resolution)
    if m.counts[at.CASCADE] > 0 and not meets_surface:
        return PUSHED
    if m.counts[at.JUMPS] != m.counts[at.JUMPS_AT_ENTRY]:
        return PUT
    if m.counts[at.N_DUE] > 1:
        m.counts[at.TIED] = 1
    if m.counts[at.TIED] != 0:
        return TOGETHER
    return ALONE


@kernel
def turns_back(p: problem.Problem, m: Memory, k: int, resolution: float) -> bool:
    """Return whether the flip of guard k has turned back itself or another due guard.

    Neighbours that meet the other guard first would cross it; those that meet guard k
    first would slide on it until they meet the other one.
    """
    if problem.margin_of(p, m, k, at.RATE0) <= 0.0:
        return True
    for a in range(m.counts[at.N_DUE]):
        j = m.lists[at.DUE, a]
        away = problem.margin_of(p, m, j, at.RATE0) >= 0.0
        if j != k and away and not is_due_still(p, m, j, resolution):
            return True
    return False


@kernel
def all_follow(m: Memory, k: int, margin: float, resolution: float) -> bool:
    """Return whether the neighbours do what guard k, put onto its surface, has done.

    Their locks are those of this run, and they are off the surface by less than counts.
    So they flip as well, unless the guard neither slides nor crosses. `margin` is its
    rate away from the surface.
    """
    slides = not problem.on_surface(m, k, resolution)  # its value is set apart
    return slides or margin > 0.0


@kernel_apart
def saltate_before(p: problem.Problem, m: Memory, k: int, kind: int) -> int:
    """Carry the flow's Jacobian across guard k before it flips; return a status."""
    status = int(first_order(p, SALTATE, 0.0, kind, k, 0))
    if status != at.RUNNING:
        m.counts[at.CULPRIT] = k
    return status


@kernel_apart
def saltate_after(
    p: problem.Problem, m: Memory, k: int, kind: int, jumped: bool, resolution: float
) -> int:
    """Carry the flow's Jacobian across what a handler has changed; return a status.

    `jumped` says whether it has changed the state.
    """
    known = first_order(p, HANDLERS, 0.0, int(kind != TOGETHER), 0, 0) != 0.0
    if kind == TOGETHER:
        since_entry = m.counts[at.JUMPS] > m.counts[at.JUMPS_AT_ENTRY]
        known = known and not since_entry and not turns_back(p, m, k, resolution)
    elif kind == PUT:
        margin = problem.margin_of(p, m, k, at.RATE0)
        known = known and not jumped and all_follow(m, k, margin, resolution)
    if known:
        return at.RUNNING
    return at.TIE_IN_JACOBIAN


# Several guards at once, by a declared law; and rest where events pile up.


@kernel
def is_event(p: problem.Problem, k: int, direction: int) -> bool:
    """Return whether a flip of guard k in this direction is an event."""
    return p.rules[at.DIRECTION, k] == 0 or p.rules[at.DIRECTION, k] == direction


@kernel
def law_decides(p: problem.Problem, m: Memory) -> bool:
    """Return whether the declared law is asked: several events are due."""
    if m.counts[at.N_DUE] < 2 or p.rules[at.BY_LAW, 0] == 0:
        return False
    events = 0
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        events += 1 if is_event(p, k, -p.mode[k]) else 0
    return events > 1


@kernel
def log_due(p: problem.Problem, m: Memory, log: Log, first: int) -> bool:
    """Log the events of the due guards, which have flipped, after the law.

    The state before it is in row `first` of the log. Returns whether it has changed.
    """
    jumped = False
    k = problem.next_due(p, m, -1)
    while k >= 0:
        direction = p.mode[k]
        if m.flags[at.DECIDED, k] != 0:
            direction = m.flags[at.DECIDED, k]
            row = m.counts[at.EVENT_ROWS]
            for i in range(m.states.width):
                before = log.floats[first, at.LOG_STATES + i]
                log.floats[row, at.LOG_STATES + i] = before
            jumped = end_event(p, m, log, row, k, direction) or jumped
            m.flags[at.FIRED, k] += 1
            m.counts[at.EVENTS] += 1
            if 0 < p.rules[at.TERMINAL, k] <= m.flags[at.FIRED, k]:
                m.counts[at.ENDED] = 1
                m.counts[at.CULPRIT] = k
        k = problem.next_due(p, m, k)
    return jumped


@kernel_apart
def fire_together(p: problem.Problem, m: Memory, log: Log, resolution: float) -> int:
    """Flip all due guards, and let the declared law decide; return a status.

    The law finds the directions of the flips in the last entries of the mode, one for
    each guard; they are zero again after it.
    """
    first_due = p.mode.width - m.flags.width
    m.counts[at.CULPRIT] = m.counts[at.NEXT]
    if p.first_order:  # see docs/sliding.md
        return at.TIE_IN_JACOBIAN
    for k in range(m.flags.width):
        m.flags[at.DECIDED, k] = 0
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        status = flip(p, m, k)
        if status != at.RUNNING:
            return status
        p.mode[first_due + k] = p.mode[k]
        m.flags[at.DECIDED, k] = p.mode[k] if is_event(p, k, p.mode[k]) else 0
    row = begin_event(m, log)
    events = m.counts[at.N_DUE]
    stop = code.call_on_event(
        p.on_event, m.clock[at.T], m.states, at.Y, p.mode, p.params, -1, events
    )
    for k in range(m.flags.width):
        p.mode[first_due + k] = 0
    if stop != 0:
        m.counts[at.ENDED] = 1
    if log_due(p, m, log, row):
        m.counts[at.JUMPS] += 1
        wake_all(m)
    if sets_invalid_lock(p, m):
        return at.NO_LOCK
    if problem.first_not_finite(m.states, at.Y) >= 0:
        return at.STATE_NOT_FINITE
    status = refresh(p, m)
    if status != at.RUNNING:
        return status
    if m.counts[at.ENDED] != 0:
        return at.TERMINATED
    look_after(p, m, resolution)
    m.counts[at.NEXT] = problem.next_due(p, m, -1)
    return at.RUNNING


@kernel_apart
def come_to_rest(
    p: problem.Problem, m: Memory, log: Log, k: int, resolution: float
) -> int:
    """Have the handler take guard k to rest, where its events pile up.

    It is told by a direction of 4, times that of the flip that is due. Returns a
    status.
    """
    direction = -p.mode[k]
    m.counts[at.CULPRIT] = k
    if p.first_order:
        return at.ZENO
    row = begin_event(m, log)
    stop = code.call_on_event(
        p.on_event,
        m.clock[at.T],
        m.states,
        at.Y,
        p.mode,
        p.params,
        k,
        4 * direction,
    )
    end_event(p, m, log, row, k, direction)
    m.counts[at.JUMPS] += 1
    m.counts[at.EVENTS] += 1
    m.counts[at.CROWD] = 0
    wake_all(m)
    if sets_invalid_lock(p, m):
        return at.NO_LOCK
    if problem.first_not_finite(m.states, at.Y) >= 0:
        return at.STATE_NOT_FINITE
    status = refresh(p, m)
    if status != at.RUNNING:
        return status
    if stop != 0:
        return at.TERMINATED
    look_after(p, m, resolution)
    m.counts[at.NEXT] = problem.next_due(p, m, -1)
    return at.RUNNING


# The whole instant.


@kernel_in_loop
def flip_and_fire(p: problem.Problem, m: Memory, log: Log, k: int) -> int:
    """Flip guard k, call its handler, and check what it leaves behind; return a status.

    Once an event has ended the integration, its guard is the one that is reported.
    """
    status = flip(p, m, k)
    if status != at.RUNNING:
        return status
    ends = fire_one(p, m, log, k) == at.TERMINATED
    if ends or m.counts[at.ENDED] == 0:
        m.counts[at.CULPRIT] = k
    if ends:
        m.counts[at.ENDED] = 1
    if p.on_event == 0:
        return at.RUNNING
    if sets_invalid_lock(p, m):
        return at.NO_LOCK
    if problem.first_not_finite(m.states, at.Y) >= 0:
        m.counts[at.CULPRIT] = k
        return at.STATE_NOT_FINITE
    return at.RUNNING


@kernel_in_loop
def fire_next(p: problem.Problem, m: Memory, log: Log, resolution: float) -> int:
    """Flip the guard NEXT, call its handler, and choose the one after it.

    Returns a status.
    """
    if law_decides(p, m):
        return fire_together(p, m, log, resolution)
    k = m.counts[at.NEXT]
    jumps_before = m.counts[at.JUMPS]
    kind = ALONE
    if p.first_order:
        kind = kind_of_flip(p, m, k, resolution)
        status = saltate_before(p, m, k, kind)
        if status != at.RUNNING:
            return status
    status = flip_and_fire(p, m, log, k)
    if status != at.RUNNING:
        return status
    last_of_all = m.counts[at.ENDED] != 0 and m.counts[at.N_DUE] == 1
    if last_of_all and p.first_order == 0:
        return at.TERMINATED
    jumped = m.counts[at.JUMPS] > jumps_before
    status = refresh(p, m)
    if p.first_order != 0 and status == at.RUNNING:
        status = saltate_after(p, m, k, kind, jumped, resolution)
    if status != at.RUNNING:
        return status
    if m.counts[at.ENDED] != 0:
        # What is due at this instant is an event still, but nothing else.
        keep_due(p, m, resolution)
    else:
        look_anew(p, m, k, resolution)
    if jumped and stops_bouncing(p, m, k):
        if p.rules[at.MAY_REST, k] == 0:
            return at.ZENO
        p.mode[k] = -p.mode[k]  # to the side on which it bounces
        return come_to_rest(p, m, log, k, resolution)
    choose_next(p, m, k, jumped)
    if m.counts[at.ENDED] != 0 and m.counts[at.N_DUE] == 0:
        return at.TERMINATED
    return at.RUNNING


@kernel_apart
def fire_all(p: problem.Problem, m: Memory, log: Log) -> int:
    """Flip the guards in DUE until none is due, and return a status.

    Their handlers may push further guards across. On entry the state of the instant is
    in Y, its time in the clock, its guards in H0 and RATE0. If the log is full, the
    status is NEEDS_ROOM, and the next call goes on with the same instant.
    """
    resolution = problem.time_resolution(m.clock[at.T], 0.0)
    if m.counts[at.BEGUN] == 0:
        crowded = too_crowded(m, resolution)
        k = problem.next_due(p, m, -1)
        m.counts[at.CULPRIT] = k if crowded else m.counts[at.CULPRIT]
        if crowded and p.rules[at.MAY_REST, k] == 0:
            return at.ZENO
        begin_instant(p, m, resolution)
        # If the log is full, it comes to rest at the next instant.
        if crowded and not is_full(p, m, log):
            status = come_to_rest(p, m, log, k, resolution)
            if status != at.RUNNING:
                m.counts[at.BEGUN] = 0
                return status
    status = at.RUNNING
    while status == at.RUNNING and m.counts[at.NEXT] >= 0:
        if is_full(p, m, log):
            return at.NEEDS_ROOM
        status = fire_next(p, m, log, resolution)
    m.counts[at.BEGUN] = 0
    return status


# The initial locks: decided by the sign of h; on the surface by its rate, and then by
# its bend.

#: Rounds until the locks agree: rates on the surface may depend on the other locks.
#: Unit: 1. Origin: chosen.
PASSES = 4

#: How far ahead the rate of a resting guard shows its bend, as a fraction of the
#: remaining time span.
#: Unit: 1. Origin: chosen.
LOOK_AHEAD = 1e-6


@kernel
def decide(h: float, rate: float, bend: float) -> int:
    """Return a guard's lock by the sign of h.

    If that is zero, the sign of its rate decides, and then that of its bend.
    """
    decisive = h
    if decisive == 0.0:
        decisive = rate
    if decisive == 0.0:
        decisive = bend
    return 1 if decisive > 0.0 else -1


@kernel
def look_ahead(p: problem.Problem, m: Memory) -> None:
    """Write the guards' rates a short time ahead into RATE.

    Of a resting guard, this is the sign of its bend.
    """
    s = m.states
    ahead = LOOK_AHEAD * min(p.t_end - m.clock[at.T], p.max_step)
    for i in range(s.width):
        s[at.SCRATCH, i] = s[at.Y, i] + ahead * s[at.K1, i]
    t = m.clock[at.T] + ahead
    problem.eval_field(p, m, t, at.SCRATCH, at.SLOPE)
    problem.eval_guards(p, m, t, at.SCRATCH, at.SLOPE, at.H, at.RATE)


@kernel
def decide_locks(p: problem.Problem, m: Memory) -> bool:
    """Set each lock that was left open, and return whether any lock has changed."""
    g = m.guards
    changed = False
    for k in range(g.width):
        if m.flags[at.OPEN, k] == 0:
            continue
        if g[at.H0, k] == 0.0 and g[at.RATE0, k] == 0.0:
            look_ahead(p, m)
        lock = decide(g[at.H0, k], g[at.RATE0, k], g[at.RATE, k])
        changed = changed or lock != p.mode[k]
        p.mode[k] = lock
    return changed


@kernel
def lock_by_side(p: problem.Problem, m: Memory) -> None:
    """Set open locks by the sign of h alone.

    The field may be defined on one side only, so it is not evaluated yet.
    """
    problem.fill_row(m.states, at.K1, 0.0)
    problem.guards_at_start(p, m, m.clock[at.T])
    for k in range(m.guards.width):
        if m.flags[at.OPEN, k] != 0 and m.guards[at.H0, k] > 0.0:
            p.mode[k] = 1


@kernel
def settle_locks(p: problem.Problem, m: Memory) -> int:
    """Decide each lock that the caller left open (0), and evaluate field and guards."""
    n_open = 0
    for k in range(m.guards.width):
        m.flags[at.OPEN, k] = 0
        if p.mode[k] == 0:
            m.flags[at.OPEN, k] = 1
            p.mode[k] = -1
            n_open += 1
    if n_open > 0:
        lock_by_side(p, m)
    for _ in range(PASSES):
        status = refresh(p, m)
        if status != at.RUNNING or not decide_locks(p, m):
            return status
    return refresh(p, m)
