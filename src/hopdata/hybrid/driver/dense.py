"""The interpolant of a step, and its derivative.

Its coefficients are in the rows P1 ... of the states: y = Y + x (P1 + r (P2 + x (P3 + r
(...)))). Here x is the fraction of the step, and r = 1 - x (as in Hairer's dense
outputs) or r = x.
"""

from math import cos, pi
from typing import NamedTuple

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import (
    call_interpolant,
    kernel,
    kernel_apart,
    kernel_in_loop,
)
from hopdata.hybrid.compiled.memory import FloatTable, FloatVector, fma
from hopdata.hybrid.driver.problem import (
    Problem,
    copy_row,
    first_not_finite,
)
from hopdata.hybrid.layout import Memory

# Last coefficient of the interpolant of DOPRI5. Where events are dense, a step costs
# little more than its interpolant; with this constant the compiler unrolls the loops
# over the coefficients.
LAST_OF_DOPRI5 = 3


@kernel
def prepare_interpolant(p: Problem, m: Memory, dt: float) -> None:
    """Compute the interpolant of the step of length `dt`, unless it is available."""
    if m.clock[at.SPAN] > 0.0:
        return
    m.clock[at.SPAN] = dt
    method = m.counts[at.METHOD]
    m.counts[at.NFEV] += p.methods[method, at.INTERPOLANT_EVALUATIONS]
    m.counts[at.DEGREE] = call_interpolant(
        p.methods[method, at.INTERPOLANT],
        m.clock[at.T],
        dt,
        m.states,
        p.mode,
        p.params,
        p.field,
    )


@kernel
def interpolate(p: Problem, m: Memory, theta: float, target: int, per_s: float) -> None:
    """Write the state at the fraction `theta` of the step into row `target`.

    If `per_s` (one over the step's length) is not 0, write its time derivative into
    SLOPE as well.
    """
    last = m.counts[at.DEGREE] - 1
    if p.methods[m.counts[at.METHOD], at.IN_POWERS] != 0:
        sum_up(m, theta, theta, 1.0, per_s, last, target)
    elif last == LAST_OF_DOPRI5:
        sum_up(m, theta, 1.0 - theta, -1.0, per_s, LAST_OF_DOPRI5, target)
    else:
        sum_up(m, theta, 1.0 - theta, -1.0, per_s, last, target)


@kernel_in_loop
def sum_up(
    m: Memory, x: float, r: float, turn: float, per_s: float, last: int, target: int
) -> None:
    """Sum an interpolant for r = x or r = 1 - x, and its derivative.

    The derivative of r is `turn`. The result is Y + x V, where V is a polynomial in x r
    whose coefficients are pairs: one coefficient plus r times the next. This halves the
    chain of operations of Horner's scheme, and it is as accurate where the coefficients
    alternate in sign.
    """
    s = m.states
    top = last | 1  # the odd coefficient of the highest pair
    has_top = last == top
    square = x * r
    square_slope = r + turn * x
    for i in range(s.width):
        odd = s[at.P1 + top, i] if has_top else 0.0  # sum of every second coefficient
        value = fma(r, odd, s[at.P1 + top - 1, i])
        value_slope = 0.0  # d(value) / d(x r)
        for j in range(top - 2, 0, -2):
            pair = fma(r, s[at.P1 + j, i], s[at.P1 + j - 1, i])
            value_slope = fma(square, value_slope, value)
            value = fma(square, value, pair)
            odd = fma(square, odd, s[at.P1 + j, i])
        slope = fma(square_slope, value_slope, turn * odd)
        s[target, i] = fma(x, value, s[at.Y, i])
        if per_s != 0.0:
            s[at.SLOPE, i] = fma(x, slope, value) * per_s


# Rows of the trajectory: samples at the requested times, or else one row for each step.


class Output(NamedTuple):
    """Room for the trajectory."""

    wanted: FloatVector  # requested times of the samples
    samples: FloatTable
    rows: FloatTable  # time and state of each step
    n_rows: int  # number of rows that fit
    per_step: int  # rows per step: none, its end, or several points within as well


@kernel
def write_row(m: Memory, out: Output, t: float, source: int) -> None:
    """Append a row with a time and a row of the states, if rows are wanted."""
    if out.per_step > 0:
        out.rows[m.counts[at.ROWS], 0] = t
        copy_row(m.states, source, out.rows, m.counts[at.ROWS], 1)
        m.counts[at.ROWS] += 1


@kernel_apart
def write_inside(p: Problem, m: Memory, out: Output, dt: float) -> bool:
    """Write rows at Chebyshev points within the step, which hold its polynomial.

    Returns False if the polynomial overflows.
    """
    prepare_interpolant(p, m, dt)
    for j in range(1, out.per_step):
        part = 0.5  # exactly, where the cosine would leave its rounding
        if 2 * j != out.per_step:
            part = 0.5 - 0.5 * cos(pi * j / out.per_step)
        interpolate(p, m, part * dt / m.clock[at.SPAN], at.SCRATCH, 0.0)
        if first_not_finite(m.states, at.SCRATCH) >= 0:
            return False
        write_row(m, out, m.clock[at.T] + part * dt, at.SCRATCH)
    return True


@kernel
def take_back_row(m: Memory, out: Output) -> None:
    """Remove the last row, which `write_row` writes again once there is more room."""
    if out.per_step > 0:
        m.counts[at.ROWS] -= 1


@kernel
def rewrite_row(m: Memory, out: Output) -> None:
    """Overwrite the last row with the state after an event."""
    if out.per_step > 0 and m.counts[at.ROWS] > 0:
        copy_row(m.states, at.Y, out.rows, m.counts[at.ROWS] - 1, 1)
    last = m.counts[at.SAMPLES] - 1
    if last >= 0 and out.wanted[last] == m.clock[at.T]:
        copy_row(m.states, at.Y, out.samples, last)


@kernel
def sample_start(m: Memory, out: Output) -> None:
    """Write the initial state if its time is requested."""
    if out.wanted.width > 0 and out.wanted[0] == m.clock[at.T]:
        copy_row(m.states, at.Y, out.samples, 0)
        m.counts[at.SAMPLES] = 1


@kernel
def sample_step(p: Problem, m: Memory, out: Output, t_new: float, dt: float) -> bool:
    """Write samples at the requested times within the step, which ends at `t_new`.

    Returns False if its polynomial overflows, as it may where states are near the
    largest number.
    """
    j = m.counts[at.SAMPLES]
    n = out.wanted.width
    if j == n or out.wanted[j] > t_new:
        return True
    prepare_interpolant(p, m, dt)
    while j < n and out.wanted[j] < t_new:
        theta = (out.wanted[j] - m.clock[at.T]) / m.clock[at.SPAN]
        interpolate(p, m, theta, at.SCRATCH, 0.0)
        if first_not_finite(m.states, at.SCRATCH) >= 0:
            return False
        copy_row(m.states, at.SCRATCH, out.samples, j)
        j += 1
    if j < n and out.wanted[j] == t_new:
        copy_row(m.states, at.END, out.samples, j)
        j += 1
    m.counts[at.SAMPLES] = j
    return True
