"""One Dormand-Prince step, its error, and the next step's size."""

from __future__ import annotations

from math import exp, isfinite, log, sqrt

from hopdata.hybrid.compiled.kernel import kernel, kernel_in_loop
from hopdata.hybrid.driver.layout import (
    END,
    ERROR,
    K1,
    K2,
    K3,
    K4,
    K5,
    K6,
    K7,
    LAST_LOG_ERROR,
    NEXT_DT,
    REJECTED,
    SCRATCH,
    SPAN,
    STEPS,
    Memory,
    T,
    Y,
)  # fmt: skip
from hopdata.hybrid.driver.prediction import clipped
from hopdata.hybrid.driver.problem import Problem, eval_field, guards_at_end
from hopdata.hybrid.methods.dopri5 import (
    A21,
    A31,
    A32,
    A41,
    A42,
    A43,
    A51,
    A52,
    A53,
    A54,
    A61,
    A62,
    A63,
    A64,
    A65,
    B1,
    B3,
    B4,
    B5,
    B6,
    C2,
    C3,
    C4,
    C5,
    E1,
    E3,
    E4,
    E5,
    E6,
    E7,
)  # fmt: skip
from hopdata.hybrid.status import FIELD_NOT_FINITE, GUARD_NOT_FINITE, STEP_UNDERFLOW

# PI controller of Hairer and Wanner's DOPRI5.
BETA = 0.04
ALPHA = 0.2 - 0.75 * BETA
SAFETY = 0.9
SHRINK_MOST, GROW_MOST = 0.2, 10.0
SHRINK_AT_NAN = 0.1
LOG_ERROR_FLOOR = log(1e-4)

EPS = 2.0**-52
TINY = 1e-300
STEP_FLOOR = 4 * EPS  # smallest step, relative to the time it is added to
ALMOST_THERE = 1.01  # stretch the last step by this much rather than leave a sliver


@kernel
def take_stages(p: Problem, m: Memory, t: float, dt: float) -> None:
    """Step from Y (with K1 known) over `dt` into END and K7."""
    m.clock[SPAN] = 0.0
    s = m.states
    n = s.width
    for i in range(n):
        s[SCRATCH, i] = s[Y, i] + dt * A21 * s[K1, i]
    eval_field(p, m, t + C2 * dt, SCRATCH, K2)
    for i in range(n):
        s[SCRATCH, i] = s[Y, i] + dt * (A31 * s[K1, i] + A32 * s[K2, i])
    eval_field(p, m, t + C3 * dt, SCRATCH, K3)
    for i in range(n):
        s[SCRATCH, i] = s[Y, i] + dt * (A41 * s[K1, i] + A42 * s[K2, i] + A43 * s[K3, i])
    eval_field(p, m, t + C4 * dt, SCRATCH, K4)
    for i in range(n):
        early = A51 * s[K1, i] + A52 * s[K2, i]
        s[SCRATCH, i] = s[Y, i] + dt * (early + A53 * s[K3, i] + A54 * s[K4, i])
    eval_field(p, m, t + C5 * dt, SCRATCH, K5)
    for i in range(n):
        early = A61 * s[K1, i] + A62 * s[K2, i] + A63 * s[K3, i]
        s[SCRATCH, i] = s[Y, i] + dt * (early + A64 * s[K4, i] + A65 * s[K5, i])
    eval_field(p, m, t + dt, SCRATCH, K6)
    for i in range(n):
        late = B4 * s[K4, i] + B5 * s[K5, i] + B6 * s[K6, i]
        s[END, i] = s[Y, i] + dt * (B1 * s[K1, i] + B3 * s[K3, i] + late)
    eval_field(p, m, t + dt, END, K7)


@kernel
def tolerance(p: Problem, i: int, size: float) -> float:
    """Return the error allowed in component `i` at this size; never 0."""
    return max(p.atol[i] + p.rtol * size, TINY)


@kernel
def error_norm(p: Problem, m: Memory, dt: float) -> float:
    """Return the estimated error in units of the tolerance (root mean square; 1 is just met)."""
    s = m.states
    total = 0.0
    for i in range(s.width):
        early = E1 * s[K1, i] + E3 * s[K3, i] + E4 * s[K4, i]
        error = dt * (early + E5 * s[K5, i] + E6 * s[K6, i] + E7 * s[K7, i])
        total += (error / tolerance(p, i, max(abs(s[Y, i]), abs(s[END, i])))) ** 2
    return sqrt(total / s.width)


@kernel
def growth(log_error: float, last_log_error: float) -> float:
    """Return the factor by which an accepted step may grow, by the logarithms of two errors."""
    factor = SAFETY * exp(BETA * last_log_error - ALPHA * log_error)
    return min(GROW_MOST, max(SHRINK_MOST, factor))


@kernel
def resize_next(m: Memory, dt: float, error: float, rejected: bool, proposed: float) -> None:
    """Propose the next step after one of size `dt` was accepted (PI controller).

    A step that was clipped to less than `proposed` says little: the proposal stands.
    """
    log_error = log(max(error, TINY))
    factor = growth(log_error, m.clock[LAST_LOG_ERROR])
    m.clock[ERROR] = error
    if rejected:
        m.clock[NEXT_DT] = dt * min(1.0, factor)
    elif dt < proposed:
        m.clock[NEXT_DT] = max(dt * factor, proposed)
        return
    else:
        m.clock[NEXT_DT] = dt * factor
    m.clock[LAST_LOG_ERROR] = max(log_error, LOG_ERROR_FLOOR)


@kernel_in_loop
def accepted_step(p: Problem, m: Memory) -> float:
    """Try steps until one meets the tolerance.

    Leaves its end in END, the guards there in H1, and a proposal for the next in NEXT_DT.
    Returns its size, or a status (negative) if there is none.
    """
    t = m.clock[T]
    left = p.t_end - t
    proposed = min(m.clock[NEXT_DT], p.max_step)
    dt = clipped(p, m, proposed)
    shrink, reason = 1.0, float(STEP_UNDERFLOW)
    while True:
        dt = left if dt * ALMOST_THERE >= left else dt
        if shrink < 1.0 and dt <= STEP_FLOOR * abs(t):
            return reason
        take_stages(p, m, t, dt)
        error = error_norm(p, m, dt)
        if not isfinite(error):
            shrink, reason = SHRINK_AT_NAN, float(FIELD_NOT_FINITE)
        elif error > 1.0:
            shrink, reason = max(SHRINK_MOST, SAFETY / error**0.2), float(STEP_UNDERFLOW)
        elif guards_at_end(p, m, t + dt):
            break
        else:
            shrink, reason = SHRINK_AT_NAN, float(GUARD_NOT_FINITE)
        m.counts[REJECTED] += 1
        dt *= shrink
    resize_next(m, dt, error, shrink < 1.0, proposed)
    m.counts[STEPS] += 1
    return dt


@kernel
def first_step(p: Problem, m: Memory) -> float:
    """Propose a first step from two slopes (Hairer, Norsett, Wanner, section II.4)."""
    s, t = m.states, m.clock[T]
    longest = min(p.t_end - t, p.max_step)
    size, slope, bend = 0.0, 0.0, 0.0
    for i in range(s.width):
        scale = tolerance(p, i, abs(s[Y, i]))
        size = max(size, abs(s[Y, i]) / scale)
        slope = max(slope, abs(s[K1, i]) / scale)
    trial = 0.01 * size / slope if size > 0.0 and slope > 0.0 else 1e-3 * longest
    trial = min(trial, longest)
    if trial == 0.0:
        return longest
    for i in range(s.width):
        s[SCRATCH, i] = s[Y, i] + trial * s[K1, i]
    eval_field(p, m, t + trial, SCRATCH, K2)
    for i in range(s.width):
        bend = max(bend, abs(s[K2, i] - s[K1, i]) / (trial * tolerance(p, i, abs(s[Y, i]))))
    steepest = max(slope, bend)
    step = (0.01 / steepest) ** 0.2 if isfinite(steepest) and steepest > 0.0 else longest
    return min(100.0 * trial, step, longest)
