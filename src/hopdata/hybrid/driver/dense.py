"""The interpolant of a step, and its derivative.

Its coefficients stand in the rows P1 ... of the states: y = Y + x (P1 + r (P2 + x (P3 + r (...)))),
where x is the fraction of the step and r = 1 - x (as in Hairer's dense outputs), or r = x.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.calls import call_interpolant
from hopdata.hybrid.compiled.fused import fma
from hopdata.hybrid.compiled.kernel import kernel, kernel_in_loop
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

# Where events are dense a step costs little more than its interpolant: with this number as a
# constant the loops over its coefficients become straight lines.
LAST_OF_DOPRI5 = 3


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
    s, last = m.states, m.counts[DEGREE] - 1
    rest = theta if p.methods[m.counts[METHOD], IN_POWERS] != 0 else 1.0 - theta
    top, square = last | 1, theta * rest
    full = last == top
    for i in range(s.width):
        value = fma(rest, s[P1 + top, i] if full else 0.0, s[P1 + top - 1, i])
        for j in range(top - 2, 0, -2):
            value = fma(square, value, fma(rest, s[P1 + j, i], s[P1 + j - 1, i]))
        s[target, i] = fma(theta, value, s[Y, i])


@kernel
def interpolate_with_slope(p: Problem, m: Memory, theta: float, dt: float) -> None:
    """Write the state at `theta` into SCRATCH, and its time derivative into SLOPE."""
    last = m.counts[DEGREE] - 1
    if p.methods[m.counts[METHOD], IN_POWERS] != 0:
        sum_with_slope(m, theta, theta, 1.0, 1.0 / dt, last)
    elif last == LAST_OF_DOPRI5:
        sum_with_slope(m, theta, 1.0 - theta, -1.0, 1.0 / dt, LAST_OF_DOPRI5)
    else:
        sum_with_slope(m, theta, 1.0 - theta, -1.0, 1.0 / dt, last)


@kernel_in_loop
def sum_with_slope(m: Memory, x: float, r: float, turn: float, per_s: float, last: int) -> None:
    """Sum an interpolant and its derivative, for r = x or 1 - x, whose derivative is `turn`.

    It is Y + x V, where V is a sum of pairs (of a coefficient and r times the next) in powers of
    x r: half as long a chain as one after the other, and as exact where they alternate.
    """
    s, top, square, bend = m.states, last | 1, x * r, r + turn * x
    full = last == top
    for i in range(s.width):
        odd = s[P1 + top, i] if full else 0.0  # the sum of every second coefficient
        value, value_slope = fma(r, odd, s[P1 + top - 1, i]), 0.0  # its slope by the square
        for j in range(top - 2, 0, -2):
            value_slope = fma(square, value_slope, value)
            value = fma(square, value, fma(r, s[P1 + j, i], s[P1 + j - 1, i]))
            odd = fma(square, odd, s[P1 + j, i])
        slope = fma(bend, value_slope, turn * odd)
        s[SCRATCH, i] = fma(x, value, s[Y, i])
        s[SLOPE, i] = fma(x, slope, value) * per_s
