"""The flow's Jacobian through an instant: one saltation matrix for each guard that flips.

At a crossing of h, Phi becomes Phi + (f+ - f-) (Dh Phi) / (Dh f- + dh/dt), with the field before
and after it (Aizerman and Gantmakher 1958; Kong et al. 2024). Of guards that flip at one instant,
each is given the field that the locks before it name; what a handler adds, by the memory for
instance, is put to the guard that has flipped, if there is only one.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.calls import call_field, call_guard, call_guards
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.layout import (
    ALONG,
    COLUMN,
    DUE,
    F_AFTER,
    F_BEFORE,
    K1,
    N_DUE,
    NFEV,
    RATE,
    RATE0,
    RATE_INPUTS,
    STEADY,
    H,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.driver.surface import next_due


@kernel
def single_row(m: Memory, row: int) -> int:
    """Return where a single row stands in the tangent's table."""
    return 3 * m.states.width + row


@kernel
def rate_along(p: Problem, m: Memory, k: int, row: int) -> float:
    """Return the rate of guard k when the state moves along a row of the tangent's table."""
    t, s, g = m.clock[T], m.states, m.guards
    if p.guards != 0:
        call_guards(p.guards, t, s, Y, p.tangent, row, p.mode, p.params, g, H, g, RATE)
    else:
        call_guard(p.guard, t, s, Y, p.tangent, row, p.mode, p.params, k, g, H, g, RATE)
    return g[RATE, k]


@kernel
def largest_input(p: Problem, m: Memory) -> int:
    """Return the largest component of f- on which the guards' rates may depend; -1 if all are 0."""
    phi, largest, found = p.tangent, 0.0, -1
    before, inputs = single_row(m, F_BEFORE), single_row(m, RATE_INPUTS)
    for i in range(m.states.width):
        if phi[inputs, i] != 0.0 and abs(phi[before, i]) > largest:
            largest, found = abs(phi[before, i]), i
    return found


@kernel
def add_part(p: Problem, m: Memory, i: int, part: float) -> None:
    """Add `part` times row i of Phi to the row ALONG."""
    phi, along = p.tangent, single_row(m, ALONG)
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
    moved, before, inputs = (
        single_row(m, COLUMN), single_row(m, F_BEFORE), single_row(m, RATE_INPUTS),
    )  # fmt: skip
    for i in range(n):
        phi[moved, i] = phi[before, i]
        phi[single_row(m, ALONG), i] = 0.0
    largest, left = largest_input(p, m), 1.0
    change = abs(phi[before, largest]) if largest >= 0 else 1.0
    last = largest if phi[single_row(m, STEADY), 0] != 0.0 else -1
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
    before, after, along = single_row(m, F_BEFORE), single_row(m, F_AFTER), single_row(m, ALONG)
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
    phi, before, after = p.tangent, single_row(m, F_BEFORE), single_row(m, F_AFTER)
    for i in range(m.states.width):
        phi[before, i] = m.states[K1, i]
    k = next_due(m, -1)
    rate = m.guards[RATE0, k]
    if m.counts[N_DUE] == 1:
        project(p, m, k, rate)
        return
    while k >= 0:
        project(p, m, k, rate)
        p.mode[k] = -p.mode[k]
        m.counts[NFEV] += 1
        call_field(p.field, m.clock[T], m.states, Y, p.mode, p.params, phi, after)
        add_jump(p, m)
        k = next_due(m, k)
        rate = rate_along(p, m, k, before) if k >= 0 else 0.0
    for a in range(m.counts[N_DUE]):  # they flip in earnest afterwards
        k = m.lists[DUE, a]
        p.mode[k] = -p.mode[k]


@kernel
def saltate_handlers(p: Problem, m: Memory) -> bool:
    """Add how the field has changed since, as part of the last guard's flip.

    Tells whether that is right: not if several guards have flipped, whose shares are unknown.
    """
    before, after = single_row(m, F_BEFORE), single_row(m, F_AFTER)
    changed = False
    for i in range(m.states.width):
        p.tangent[after, i] = m.states[K1, i]
        changed = changed or p.tangent[after, i] != p.tangent[before, i]
    add_jump(p, m)
    return m.counts[N_DUE] <= 1 or not changed
