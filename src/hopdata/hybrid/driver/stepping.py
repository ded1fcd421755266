"""One step that meets the tolerance; the size and the method of the next."""

from math import exp, isfinite, log

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import call_step, kernel, kernel_in_loop
from hopdata.hybrid.driver.problem import (
    Problem,
    eval_field,
    first_not_finite,
    guards_at_end,
    next_end,
    time_resolution,
)
from hopdata.hybrid.driver.sleep import wake
from hopdata.hybrid.driver.watch import clipped
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods import stiff
from hopdata.hybrid.methods.taylor import LONGEST

# The choice of the method for the next step.
#
# Where events follow each other closely, each cuts a step short, and a cheap step is
# best. Where they are sparse, a method of high order goes farther per evaluation.

#: Largest relative tolerance at which the method of highest order takes the first step.
#: Unit: 1. Origin: chosen.
TIGHT = 1e-7

#: Steps without an event after which a method of higher order pays off.
#: Unit: 1. Origin: chosen.
LONG = 4.0

#: Events closer than this many steps of the cheaper method are dense: that method takes
#: over.
#: Unit: 1. Origin: chosen.
SHORT = 2.5

#: Steps between two tests for stiffness while there is no sign of it.
#: Unit: 1. Origin: chosen.
EVERY = 16

#: Shortest first step in an affine mode.
#: Unit: time resolutions. Origin: chosen.
MANY = 1e3

#: Order from which on the controller has no limits: the error obeys its power over many
#: decades.
#: Unit: 1. Origin: chosen.
VERY_HIGH_ORDER = 16.0

#: Dt times the fastest rate, below which an explicit step of this length suffices.
#: Unit: 1. Origin: chosen.
RELIEVED = 1.0


@kernel
def watch_stiffness(p: Problem, m: Memory, dt: float) -> None:
    """Update the stiffness score by the step just accepted."""
    method = m.counts[at.METHOD]
    if p.methods[method, at.STIFFER] < 0:
        return
    score = m.clock[at.STIFF_SCORE]
    if score == 0.0 and m.counts[at.STEPS] % EVERY != 0:
        return
    last_slope = p.methods[method, at.LAST_SLOPE]
    limit = 0.1 * p.methods[method, at.STIFF_TENTHS]
    found = stiff.explicit_stiffness(
        m.states, dt, p.rtol, p.atol, last_slope, m.states.width
    )
    m.clock[at.STIFF_SCORE] = stiff.stiffness_score(score, found, limit)


@kernel
def relieved(p: Problem, m: Memory) -> bool:
    """Return whether an explicit method could take a step like the next one."""
    if m.counts[at.STEPS] % EVERY != 0:
        return False
    s = m.states
    ahead = m.clock[at.NEXT_DT]
    structure = int(s[at.STRUCTURE, 0])
    found = stiff.implicit_stiffness(
        s, ahead, p.rtol, p.atol, stiff.JAC, stiff.PIVOTS, s.width, structure
    )
    return found < RELIEVED


@kernel
def first_method(p: Problem) -> int:
    """Return the first method: the highest order, or one less at a loose tolerance."""
    method = 0
    while p.methods[method, at.SPARSER] >= 0:
        method = p.methods[method, at.SPARSER]
    if method > 0 and p.rtol > TIGHT:
        return method - 1
    return method


@kernel
def step_ratio(p: Problem, method: int, other: int) -> float:
    """Return the ratio of the other method's step to this method's, by their orders."""
    order = p.methods[method, at.ORDER]
    other_order = p.methods[other, at.ORDER]
    return p.rtol ** (1.0 / other_order - 1.0 / order)


@kernel
def change_method(p: Problem, m: Memory, other: int) -> None:
    """Change to another method, and estimate its step."""
    m.clock[at.NEXT_DT] *= step_ratio(p, m.counts[at.METHOD], other)
    m.counts[at.METHOD] = other


@kernel
def choose_after_step(p: Problem, m: Memory) -> None:
    """Change the method where that pays.

    The mode has become stiff or is no longer so, or events are sparse.
    """
    method = m.counts[at.METHOD]
    stiffer = p.methods[method, at.STIFFER]
    if stiffer >= 0 and m.clock[at.STIFF_SCORE] >= stiff.STIFF:
        m.clock[at.STIFF_SCORE] = 0.0
        m.counts[at.METHOD] = stiffer
        return
    relaxed = p.methods[method, at.RELAXED]
    if relaxed >= 0 and relieved(p, m):
        m.counts[at.METHOD] = relaxed
        return
    sparser = p.methods[method, at.SPARSER]
    since_event = m.clock[at.T] - m.clock[at.SEGMENT]
    if sparser >= 0 and since_event > LONG * m.clock[at.NEXT_DT]:
        change_method(p, m, sparser)


@kernel
def affine_step(p: Problem, m: Memory) -> float:
    """Return the first step in an affine mode: to the end, if its motion allows."""
    remaining = next_end(p, m) - m.clock[at.T]
    shortest = MANY * time_resolution(m.clock[at.T], 0.0)
    return min(remaining, max(m.states[LONGEST, 0], shortest))


@kernel
def choose_after_event(p: Problem, m: Memory) -> None:
    """Change to a cheaper method if the last event is only a few of its steps ago."""
    method = m.counts[at.METHOD]
    since_event = m.clock[at.T] - m.clock[at.SEGMENT]
    m.clock[at.SEGMENT] = m.clock[at.T]
    m.clock[at.GAP] = since_event
    if p.methods[method, at.ORDER] >= VERY_HIGH_ORDER:
        # The step in the last mode says nothing about this one.
        m.clock[at.NEXT_DT] = affine_step(p, m)
    denser = p.methods[method, at.DENSER]
    if denser < 0:
        return
    ratio = step_ratio(p, method, denser)
    if since_event < SHORT * m.clock[at.NEXT_DT] * ratio:
        change_method(p, m, denser)


# The step size: the PI controller of Hairer and Wanner's DOPRI5 and DOP853.

#: Weight of the last step's error in the growth of a step; divided by the order, it is
#: the exponent.
#: Unit: 1. Origin: convention: that of DOPRI5, 0.04, times its order.
BETA = 0.2

#: Weight of this step's error in the growth of a step; divided by the order, it is the
#: exponent.
#: Unit: 1. Origin: derived: from BETA as in DOPRI5.
ALPHA = 1.0 - 0.75 * BETA

#: Fraction of the step at which the expected error equals the tolerance.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's codes.
SAFETY = 0.9

#: Least factor between two steps.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's DOPRI5.
SHRINK_MOST = 0.2

#: Largest factor between two steps.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's DOPRI5.
GROW_MOST = 10.0

#: Factor by which a step is shortened if it reaches where field or guards are not
#: finite.
#: Unit: 1. Origin: chosen.
SHRINK_AT_NAN = 0.1

#: Least error of the last step, in tolerances, that the controller remembers, as its
#: logarithm.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's codes.
LOG_ERROR_FLOOR = log(1e-4)

EPS = 2.0**-52
TINY = 1e-300  # avoids divisions by zero and the logarithm of zero

#: Smallest step, relative to the time to which it is added.
#: Unit: 1. Origin: rounding: four units in the last place of a double.
STEP_FLOOR = 4 * EPS

#: Factor by which the last step may be stretched to avoid a tiny one after it.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's codes.
ALMOST_THERE = 1.01


@kernel
def take_step(p: Problem, m: Memory, t: float, dt: float) -> float:
    """Step from Y (with K1 known) over `dt` into END and KEND.

    Returns the error in units of the tolerance; NaN if the field is not finite or has
    raised.
    """
    s = m.states
    method = m.counts[at.METHOD]
    m.clock[at.SPAN] = 0.0
    m.counts[at.NFEV] += p.methods[method, at.EVALUATIONS]
    s[at.KEND, 0] = np.nan  # remains if the user's function raises
    address = p.methods[method, at.STEP]
    error = call_step(address, t, dt, p.rtol, s, p.mode, p.params, p.atol, p.field)
    if first_not_finite(s, at.KEND) >= 0:
        return np.nan
    return error


@kernel
def tolerance(p: Problem, i: int, size: float) -> float:
    """Return the error allowed in component `i` for this size; never 0."""
    return max(p.atol[i] + p.rtol * size, TINY)


@kernel
def shrink_factor(error: float, order: float) -> float:
    """Return the factor by which to shorten a step rejected for its error."""
    factor = SAFETY / error ** (1.0 / order)
    if order >= VERY_HIGH_ORDER:
        return factor
    return max(SHRINK_MOST, factor)


@kernel
def growth(log_error: float, last_log_error: float, order: float) -> float:
    """Return the growth factor of an accepted step, from the logarithms of errors."""
    factor = SAFETY * exp((BETA * last_log_error - ALPHA * log_error) / order)
    if order >= VERY_HIGH_ORDER:
        return factor
    return min(GROW_MOST, max(SHRINK_MOST, factor))


@kernel
def resize_next(
    m: Memory, dt: float, error: float, rejected: bool, proposed: float, order: float
) -> None:
    """Propose the next step after one of size `dt` was accepted (PI controller).

    A step clipped to less than `proposed` says little, so the proposal stands.
    """
    log_error = log(max(error, TINY))
    factor = growth(log_error, m.clock[at.LAST_LOG_ERROR], order)
    m.clock[at.ERROR] = error
    if rejected:
        m.clock[at.NEXT_DT] = dt * min(1.0, factor)
    elif dt < proposed:
        m.clock[at.NEXT_DT] = max(dt * factor, proposed)
        return
    else:
        m.clock[at.NEXT_DT] = dt * factor
    m.clock[at.LAST_LOG_ERROR] = max(log_error, LOG_ERROR_FLOOR)


@kernel_in_loop
def accepted_step(p: Problem, m: Memory) -> float:
    """Try steps until one meets the tolerance.

    Leaves its end in END, the guards there in H1, and a proposal for the next step in
    NEXT_DT. Returns the size of the step, or a negative status on failure.
    """
    t = m.clock[at.T]
    remaining = next_end(p, m) - t
    order = float(p.methods[m.counts[at.METHOD], at.ORDER])
    proposed = min(m.clock[at.NEXT_DT], p.max_step)
    dt = clipped(p, m, proposed)
    shrink = 1.0
    reason = float(at.STEP_UNDERFLOW)
    while True:
        if dt * ALMOST_THERE >= remaining:
            dt = remaining
        if shrink < 1.0 and dt <= STEP_FLOOR * abs(t):
            return reason
        error = take_step(p, m, t, dt)
        if not isfinite(error):
            shrink = SHRINK_AT_NAN
            reason = float(at.FIELD_NOT_FINITE)
        elif error > 1.0:
            shrink = shrink_factor(error, order)
            reason = float(at.STEP_UNDERFLOW)
        elif guards_at_end(p, m, t + dt):
            break
        else:
            shrink = SHRINK_AT_NAN
            reason = float(at.GUARD_NOT_FINITE)
        m.counts[at.REJECTED] += 1
        dt *= shrink
    watch_stiffness(p, m, dt)
    wake(p, m, dt)
    resize_next(m, dt, error, shrink < 1.0, proposed, order)
    m.counts[at.STEPS] += 1
    return dt


@kernel
def first_step(p: Problem, m: Memory) -> float:
    """Propose a first step from two slopes (Hairer, Norsett, Wanner, section II.4).

    At a very high order, a step that is too long costs less than this estimate.
    """
    longest = min(next_end(p, m) - m.clock[at.T], p.max_step)
    if p.methods[m.counts[at.METHOD], at.ORDER] >= VERY_HIGH_ORDER:
        return min(longest, affine_step(p, m))
    s = m.states
    size = 0.0
    slope = 0.0
    for i in range(s.width):
        scale = tolerance(p, i, abs(s[at.Y, i]))
        size = max(size, abs(s[at.Y, i]) / scale)
        slope = max(slope, abs(s[at.K1, i]) / scale)
    trial = 1e-3 * longest
    if size > 0.0 and slope > 0.0:
        trial = 0.01 * size / slope
    trial = min(trial, longest)
    if trial == 0.0:
        return longest
    steepest = max(slope, bend_over(p, m, trial))
    step = longest
    if isfinite(steepest) and steepest > 0.0:
        power = 1.0 / p.methods[m.counts[at.METHOD], at.ORDER]
        step = (0.01 / steepest) ** power
    return min(100.0 * trial, step, longest)


@kernel
def bend_over(p: Problem, m: Memory, trial: float) -> float:
    """Return the change of the slopes over a trial step, per second, in tolerances."""
    s = m.states
    for i in range(s.width):
        s[at.SCRATCH, i] = s[at.Y, i] + trial * s[at.K1, i]
    eval_field(p, m, m.clock[at.T] + trial, at.SCRATCH, at.SLOPE)
    bend = 0.0
    for i in range(s.width):
        allowed = trial * tolerance(p, i, abs(s[at.Y, i]))
        bend = max(bend, abs(s[at.SLOPE, i] - s[at.K1, i]) / allowed)
    return bend
