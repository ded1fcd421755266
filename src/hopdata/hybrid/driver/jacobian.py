"""The flow's Jacobian through an instant: one saltation matrix for each guard that flips.

At a crossing of h, Phi becomes Phi + (f+ - f-) (Dh Phi) / (Dh f- + dh/dt), with the field before
and after it (Aizerman and Gantmakher 1958; Kong et al. 2024). Of guards that flip at one instant,
each is given the field that the locks before it name; what a handler adds, by the memory for
instance, is put to the guard that has flipped, if there is only one.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import Problem, next_due
from hopdata.hybrid.driver.stepping import SAFETY, SHRINK_MOST
from hopdata.hybrid.layout import Memory

# The flow's Jacobian over a step: by the method's own tangent, or by that for short steps.

EASY = 0.2  # of the tolerance: a step with so little error may have the short tangent
SHORT = 300.0  # relative tolerances: (step times fastest motion)^5, up to which a step is short
SMALL = 0.1  # error of the Jacobian, in units of the tolerance, that says nothing of the next step


@kernel
def has_short_tangent(p: Problem, m: Memory, dt: float) -> bool:
    """Tell whether the short tangent will do for a step of `dt`, by the last step's motion."""
    if p.methods[m.counts[at.METHOD], at.SHORT_TANGENT] == 0 or m.clock[at.ERROR] > EASY:
        return False
    turn = dt * dt * m.clock[at.MOTION]
    return turn * turn * sqrt(turn) <= SHORT * p.rtol


@kernel_apart
def tangent(p: Problem, m: Memory, dt: float) -> float:
    """Write the new Jacobian behind the old one; return its error in units of the tolerance.

    A step that ends on the interpolant of a longer one has no stages of its own.
    """
    method, t = m.counts[at.METHOD], m.clock[at.T]
    which, evaluations = at.TANGENT, p.methods[method, at.TANGENT_EVALUATIONS]
    if m.clock[at.SPAN] > dt or has_short_tangent(p, m, dt):
        which, evaluations = at.SHORT_TANGENT, p.methods[method, at.SHORT_EVALUATIONS]
        prepare_interpolant(p, m, dt)
        interpolate(p, m, at.GAUSS_1 * dt / m.clock[at.SPAN], at.SCRATCH)
        interpolate(p, m, at.GAUSS_2 * dt / m.clock[at.SPAN], at.SLOPE)
    m.counts[at.NFEV] += evaluations
    address = p.methods[method, which]
    return code.call_tangent(address, t, dt, p.rtol, m.states, p.mode, p.params, p.atol, p.tangent)


@kernel_apart
def carry_jacobian(p: Problem, m: Memory, dt: float) -> float:
    """Multiply the flow's Jacobian by that of the step that ends at END.

    Returns the part of the step by which it must be taken again, as the Jacobian errs by too much;
    1 if it does not, NaN if it is not finite. One that errs by less may yet limit the next step.
    """
    phi, n = p.tangent, m.states.width
    error = tangent(p, m, dt)
    m.clock[at.MOTION] = phi[3 * n + at.PHI_MOTION, 0]
    if error > SMALL:
        part = max(SHRINK_MOST, SAFETY / error ** (1.0 / p.methods[m.counts[at.METHOD], at.ORDER]))
        if error > 1.0:
            return part
        m.clock[at.NEXT_DT] = min(m.clock[at.NEXT_DT], part * dt)
    wrong = 0
    for e in range(n * n):
        wrong += 0 if abs(phi[n, e]) < np.inf else 1
        phi[0, e] = phi[n, e]
    return 1.0 if wrong == 0 else np.nan


@kernel
def single(m: Memory, row: int) -> int:
    """Return where a single row stands in the tangent's table."""
    return 3 * m.states.width + row


@kernel
def rate_along(p: Problem, m: Memory, k: int, row: int) -> float:
    """Return the rate of guard k when the state moves along a row of the tangent's table."""
    t, s, g = m.clock[at.T], m.states, m.guards
    if p.guards != 0:
        code.call_guards(
            p.guards, t, s, at.Y, p.tangent, row, p.mode, p.params, g, at.H, g, at.RATE
        )
    else:
        code.call_guard(
            p.guard, t, s, at.Y, p.tangent, row, p.mode, p.params, k, g, at.H, g, at.RATE
        )
    return g[at.RATE, k]


@kernel
def largest_input(p: Problem, m: Memory) -> int:
    """Return the largest component of f- on which the guards' rates may depend; -1 if all are 0."""
    phi, largest, found = p.tangent, 0.0, -1
    before, inputs = single(m, at.F_BEFORE), single(m, at.RATE_INPUTS)
    for i in range(m.states.width):
        if phi[inputs, i] != 0.0 and abs(phi[before, i]) > largest:
            largest, found = abs(phi[before, i]), i
    return found


@kernel
def add_part(p: Problem, m: Memory, i: int, part: float) -> None:
    """Add `part` times row i of Phi to the row ALONG."""
    phi, along = p.tangent, single(m, at.ALONG)
    for j in range(m.states.width):
        phi[along, j] += part * phi[i, j]


@kernel
def project(p: Problem, m: Memory, k: int, rate: float) -> None:
    """Write Dh Phi / rate of guard k into the row ALONG, for its rate Dh f- + dh/dt.

    The rate is affine in f-: Dh comes by changing one component of it after the other, those alone
    that the guards' code may use, by the size of the largest. What belongs to the largest is what
    is left of the rate, if time does not matter.
    """
    phi, n = p.tangent, m.states.width
    moved, before = single(m, at.COLUMN), single(m, at.F_BEFORE)
    inputs = single(m, at.RATE_INPUTS)
    for i in range(n):
        phi[moved, i] = phi[before, i]
        phi[single(m, at.ALONG), i] = 0.0
    largest, left = largest_input(p, m), 1.0
    change = abs(phi[before, largest]) if largest >= 0 else 1.0
    last = largest if phi[single(m, at.STEADY), 0] != 0.0 else -1
    for i in range(n):
        if phi[inputs, i] != 0.0 and i != last:
            phi[moved, i] += change
            part = (rate_along(p, m, k, moved) - rate) / (phi[moved, i] - phi[before, i]) / rate
            phi[moved, i] = phi[before, i]
            left -= part * phi[before, i]
            add_part(p, m, i, part)
    if last >= 0:
        add_part(p, m, last, left / phi[before, last])


@kernel
def add_jump(p: Problem, m: Memory) -> None:
    """Add (f_after - f_before) times ALONG to the Jacobian; f_after becomes f_before."""
    phi, n = p.tangent, m.states.width
    before, after, along = (
        single(m, at.F_BEFORE),
        single(m, at.F_AFTER),
        single(m, at.ALONG),
    )
    for i in range(n):
        jump = phi[after, i] - phi[before, i]
        phi[before, i] = phi[after, i]
        if jump != 0.0:  # as it is of most, where a force comes or goes
            for j in range(n):
                phi[i, j] += jump * phi[along, j]


@kernel_apart
def saltate(p: Problem, m: Memory) -> None:
    """Pass all guards that are due, one after the other, by their locks alone.

    A single one is only projected: `saltate_handlers` adds its jump, with what handlers make of it.
    """
    phi, before, after = p.tangent, single(m, at.F_BEFORE), single(m, at.F_AFTER)
    for i in range(m.states.width):
        phi[before, i] = m.states[at.K1, i]
    k = next_due(m, -1)
    rate = m.guards[at.RATE0, k]
    if m.counts[at.N_DUE] == 1:
        project(p, m, k, rate)
        return
    while k >= 0:
        project(p, m, k, rate)
        p.mode[k] = -p.mode[k]
        m.counts[at.NFEV] += 1
        code.call_field(p.field, m.clock[at.T], m.states, at.Y, p.mode, p.params, phi, after)
        add_jump(p, m)
        k = next_due(m, k)
        rate = rate_along(p, m, k, before) if k >= 0 else 0.0
    for a in range(m.counts[at.N_DUE]):  # they flip in earnest afterwards
        k = m.lists[at.DUE, a]
        p.mode[k] = -p.mode[k]


@kernel
def saltate_handlers(p: Problem, m: Memory) -> bool:
    """Add how the field has changed since, as part of the last guard's flip.

    Tells whether that is right: not if several guards have flipped, whose shares are unknown.
    """
    before, after = single(m, at.F_BEFORE), single(m, at.F_AFTER)
    changed = False
    for i in range(m.states.width):
        p.tangent[after, i] = m.states[at.K1, i]
        changed = changed or p.tangent[after, i] != p.tangent[before, i]
    add_jump(p, m)
    return m.counts[at.N_DUE] <= 1 or not changed
