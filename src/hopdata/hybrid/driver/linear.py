"""The flow's Jacobian over a step: by the method's own tangent, or by that for short steps."""

from __future__ import annotations

from math import sqrt

import numpy as np

from hopdata.hybrid.compiled.calls import call_tangent
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.layout import (
    ERROR,
    GAUSS_1,
    GAUSS_2,
    METHOD,
    MOTION,
    NEXT_DT,
    NFEV,
    ORDER,
    PHI_MOTION,
    SCRATCH,
    SHORT_TANGENT,
    SHORT_TANGENT_EVALUATIONS,
    SLOPE,
    SPAN,
    TANGENT,
    TANGENT_EVALUATIONS,
    Memory,
    T,
)
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.driver.stepping import SAFETY, SHRINK_MOST

EASY = 0.2  # of the tolerance: a step with so little error may have the short tangent
SHORT = 300.0  # relative tolerances: (step times fastest motion)^5, up to which a step is short
SMALL = 0.1  # error of the Jacobian, in units of the tolerance, that says nothing of the next step


@kernel
def has_short_tangent(p: Problem, m: Memory, dt: float) -> bool:
    """Tell whether the short tangent will do for a step of `dt`, by the last step's motion."""
    if p.methods[m.counts[METHOD], SHORT_TANGENT] == 0 or m.clock[ERROR] > EASY:
        return False
    turn = dt * dt * m.clock[MOTION]
    return turn * turn * sqrt(turn) <= SHORT * p.rtol


@kernel_apart
def tangent(p: Problem, m: Memory, dt: float) -> float:
    """Write the new Jacobian behind the old one; return its error in units of the tolerance.

    A step that ends on the interpolant of a longer one has no stages of its own.
    """
    method, t = m.counts[METHOD], m.clock[T]
    which, evaluations = TANGENT, p.methods[method, TANGENT_EVALUATIONS]
    if m.clock[SPAN] > dt or has_short_tangent(p, m, dt):
        which, evaluations = SHORT_TANGENT, p.methods[method, SHORT_TANGENT_EVALUATIONS]
        prepare_interpolant(p, m, dt)
        interpolate(p, m, GAUSS_1 * dt / m.clock[SPAN], SCRATCH)
        interpolate(p, m, GAUSS_2 * dt / m.clock[SPAN], SLOPE)
    m.counts[NFEV] += evaluations
    address = p.methods[method, which]
    return call_tangent(address, t, dt, p.rtol, m.states, p.mode, p.params, p.atol, p.tangent)


@kernel_apart
def carry_jacobian(p: Problem, m: Memory, dt: float) -> float:
    """Multiply the flow's Jacobian by that of the step that ends at END.

    Returns the part of the step by which it must be taken again, as the Jacobian errs by too much;
    1 if it does not, NaN if it is not finite. One that errs by less may yet limit the next step.
    """
    phi, n = p.tangent, m.states.width
    error = tangent(p, m, dt)
    m.clock[MOTION] = phi[3 * n + PHI_MOTION, 0]
    if error > SMALL:
        part = max(SHRINK_MOST, SAFETY / error ** (1.0 / p.methods[m.counts[METHOD], ORDER]))
        if error > 1.0:
            return part
        m.clock[NEXT_DT] = min(m.clock[NEXT_DT], part * dt)
    wrong = 0
    for e in range(n * n):
        wrong += 0 if abs(phi[n, e]) < np.inf else 1
        phi[0, e] = phi[n, e]
    return 1.0 if wrong == 0 else np.nan
