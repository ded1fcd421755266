"""The interpolant of a step, and its derivative.

Its coefficients stand in the rows P1 ... of the states: y = Y + x (P1 + r (P2 + x (P3 + r (...)))),
where x is the fraction of the step and r = 1 - x (as in Hairer's dense outputs), or r = x.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.calls import call_interpolant
from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import (
    DEGREE,
    IN_POWERS,
    INTERPOLANT,
    INTERPOLANT_EVALUATIONS,
    METHOD,
    NFEV,
    P1,
    SCRATCH,
    SLOPE,
    SPAN,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.driver.problem import Problem


@kernel
def prepare_interpolant(p: Problem, m: Memory, dt: float) -> None:
    """Compute the interpolant of the step of length `dt`, unless it is there already."""
    if m.clock[SPAN] > 0.0:
        return
    m.clock[SPAN] = dt
    s, t, method = m.states, m.clock[T], m.counts[METHOD]
    address = p.methods[method, INTERPOLANT]
    m.counts[NFEV] += p.methods[method, INTERPOLANT_EVALUATIONS]
    m.counts[DEGREE] = call_interpolant(address, t, dt, s, p.mode, p.params, p.field)


@kernel
def interpolate(p: Problem, m: Memory, theta: float, target: int) -> None:
    """Write the state at the fraction `theta` of the step into a row of the states."""
    s, method, last = m.states, m.counts[METHOD], m.counts[DEGREE] - 1
    rest = theta if p.methods[method, IN_POWERS] != 0 else 1.0 - theta
    for i in range(s.width):
        value = s[P1 + last, i]
        for j in range(last - 1, -1, -1):
            value = s[P1 + j, i] + (theta if j & 1 else rest) * value
        s[target, i] = s[Y, i] + theta * value


@kernel
def interpolate_with_slope(p: Problem, m: Memory, theta: float, dt: float) -> None:
    """Write the state at `theta` into SCRATCH, and its time derivative into SLOPE."""
    s, method, last = m.states, m.counts[METHOD], m.counts[DEGREE] - 1
    in_powers = p.methods[method, IN_POWERS] != 0
    rest = theta if in_powers else 1.0 - theta
    turn = 1.0 if in_powers else -1.0
    for i in range(s.width):
        value, slope = s[P1 + last, i], 0.0
        for j in range(last - 1, -1, -1):
            if j & 1:
                slope = value + theta * slope
                value = s[P1 + j, i] + theta * value
            else:
                slope = turn * value + rest * slope
                value = s[P1 + j, i] + rest * value
        s[SCRATCH, i] = s[Y, i] + theta * value
        s[SLOPE, i] = (value + theta * slope) / dt
