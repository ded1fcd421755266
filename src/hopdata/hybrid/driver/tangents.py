"""The flow's Jacobian over a step: by the method's own tangent, or by the short one."""

from math import inf, nan, sqrt

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatTable
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.driver.stepping import SAFETY, SHRINK_MOST, TINY
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods import tangent as differences
from hopdata.hybrid.numbers import along as duals

#: Error of the step below which the short tangent may be used.
#: Unit: tolerances. Origin: chosen.
EASY = 0.2

#: Largest (step times fastest motion)^5 of a short step, as a multiple of the relative
#: tolerance.
#: Unit: 1. Origin: chosen.
SHORT = 300.0

#: Error of the Jacobian below which it does not limit the next step.
#: Unit: tolerances. Origin: chosen.
SMALL = 0.1

#: Error of the short tangent above which the method's own is taken.
#: Unit: tolerances. Origin: chosen.
DOUBTFUL = 0.5

#: How many times smaller than the error a pair's own estimate may be where a force
#: begins with a square root.
#: Unit: 1. Origin: derived: it is 37 with DOPRI5.
MISSED = 40.0


@kernel
def has_short_tangent(p: Problem, m: Memory, dt: float) -> bool:
    """Return whether the short tangent suffices for a step of length `dt`.

    The fastest motion is that of the last step.
    """
    if p.methods[m.counts[at.METHOD], at.SHORT_TANGENT] == 0:
        return False
    if m.clock[at.ERROR] > EASY:
        return False
    turn = dt * dt * m.clock[at.MOTION]
    return turn * turn * sqrt(turn) <= SHORT * p.rtol


@kernel
def take_tangent(
    p: Problem, m: Memory, dt: float, which: int, evaluations: int
) -> float:
    """Write the new Jacobian by one of the method's tangents; return its error."""
    method = m.counts[at.METHOD]
    if p.along[duals.FIELD] == 0:  # else only numbers of finite differences count
        m.counts[at.NFEV] += p.methods[method, evaluations]
    return code.call_tangent(
        p.methods[method, which],
        m.clock[at.T],
        dt,
        p.rtol,
        m.states,
        p.mode,
        p.params,
        p.atol,
        p.tangent,
        p.field,
        p.methods[method, at.DERIVATIVE],
        p.along,
    )


@kernel_apart
def short_tangent(p: Problem, m: Memory, dt: float) -> float:
    """Write the new Jacobian by the short tangent; return its error in tolerances."""
    prepare_interpolant(p, m, dt)
    interpolate(p, m, at.GAUSS_1 * dt / m.clock[at.SPAN], at.SCRATCH, 0.0)
    interpolate(p, m, at.GAUSS_2 * dt / m.clock[at.SPAN], at.SLOPE, 0.0)
    interpolate(p, m, 0.5 * dt / m.clock[at.SPAN], at.LEAST, 0.0)
    return take_tangent(p, m, dt, at.SHORT_TANGENT, at.SHORT_EVALUATIONS)


@kernel_apart
def tangent(p: Problem, m: Memory, dt: float) -> float:
    """Write the new Jacobian after the old one; return its error in tolerances.

    A step that ends on the interpolant of a longer step has no stages of its own.
    Another one is carried by them if the short tangent is not exact enough. What they
    hardly see, where a law begins with a root at the surface, the short tangent does.
    """
    on_interpolant = m.clock[at.SPAN] > dt
    is_short = on_interpolant or has_short_tangent(p, m, dt)
    begins = m.clock[at.T] == m.clock[at.SEGMENT]
    has_another = p.methods[m.counts[at.METHOD], at.SHORT_TANGENT] != 0
    rough = 0.0
    if is_short or (begins and has_another):
        error = short_tangent(p, m, dt)
        if on_interpolant or (is_short and error <= DOUBTFUL):
            return error
        rough = p.tangent[single(m, at.PHI_ROUGH), 0]
    error = take_tangent(p, m, dt, at.TANGENT, at.TANGENT_EVALUATIONS)
    factor = min(rough, MISSED * error) / max(error, TINY)
    if factor > 1.0:
        for j in range(m.states.width):
            p.tangent[single(m, at.PHI_STEP_ERROR), j] *= factor
        error *= factor
    return error


@kernel
def add_errors(p: Problem, m: Memory) -> None:
    """Add the errors of this step's columns, relative to the sizes of all columns.

    The columns of parameters are left out: they begin as none, so that their growth is
    not that of a deviation of the state.
    """
    phi = p.tangent
    n = m.states.width
    first = single(m, at.PHI_GROWN)
    sizes = single(m, at.COLUMN)
    for k in range(n):
        phi[sizes, k] = differences.size_of_column(phi, n, k)
    for j in range(n):
        error = phi[single(m, at.PHI_STEP_ERROR), j]
        if not error > 0.0:
            continue
        phi[first + j, j] += error
        error *= phi[sizes, j]
        for k in range(p.n_varying):
            if k != j and phi[sizes, k] > 0.0:
                phi[first + j, k] += error / phi[sizes, k]


@kernel
def grown_error(phi: FloatTable) -> float:
    """Return the largest error of a column, in its size, as `workspace.grown_error`.

    It is the same number, for batches. COLUMN of the tangent's table is written.
    """
    n = phi.width
    first = 3 * n + at.PHI_GROWN
    sizes = 3 * n + at.COLUMN
    for k in range(n):
        phi[sizes, k] = differences.size_of_column(phi, 0, k)
    largest = 0.0
    for j in range(n):
        grown = 0.0
        for k in range(n):
            grown = max(grown, phi[first + j, k] * phi[sizes, k])
        if phi[sizes, j] > 0.0:
            largest = max(largest, grown / phi[sizes, j])
        largest = max(largest, phi[3 * n + at.PHI_ERROR, j])
    return largest


@kernel_apart
def carry_jacobian(p: Problem, m: Memory, dt: float) -> float:
    """Multiply the flow's Jacobian by that of the step that ends at END.

    Returns the fraction to which the step must be shortened because the Jacobian's
    error is too large, 1 if it is acceptable, and NaN if it is not finite. A smaller
    error may still limit the next step.
    """
    phi = p.tangent
    n = m.states.width
    error = tangent(p, m, dt)
    m.clock[at.MOTION] = phi[3 * n + at.PHI_MOTION, 0]
    if error > SMALL:
        order = p.methods[m.counts[at.METHOD], at.ORDER]
        fraction = max(SHRINK_MOST, SAFETY / error ** (1.0 / order))
        if error > 1.0:
            return fraction
        m.clock[at.NEXT_DT] = min(m.clock[at.NEXT_DT], fraction * dt)
    for i in range(n):
        largest = phi[single(m, at.PHI_LARGEST), i]
        largest = max(largest, abs(m.states[at.Y, i]), abs(m.states[at.END, i]))
        phi[single(m, at.PHI_LARGEST), i] = largest
        phi[single(m, at.PHI_ERROR), i] += phi[single(m, at.PHI_STEP_ERROR), i]
    add_errors(p, m)
    wrong = 0
    for e in range(n * n):
        wrong += 0 if abs(phi[n, e]) < inf else 1
        phi[0, e] = phi[n, e]
    return 1.0 if wrong == 0 else nan


@kernel
def single(m: Memory, row: int) -> int:
    """Return the index of a single row in the tangent's table."""
    return 3 * m.states.width + row
