"""The flow's Jacobian across an instant: a saltation matrix for each guard that flips.

At a crossing of h, Phi becomes DR Phi + (f+ - DR f- - dR/dt) (Dh Phi) / (Dh f- +
dh/dt), with the fields f- before and f+ after it, and the reset R of the handler
(Aizerman and Gantmakher 1958; Kong et al. 2024). If several guards meet their surfaces
at one instant, they are passed in the order in which they flip, and each is assigned
the field selected by the locks so far. This is the derivative if the order does not
matter (`orders`). If it does, or if a handler changes state or field there, or if one
guard's flip turns another one back, there is no derivative. The change of the field by
a single guard's handler (through the memory, for instance) is its own. Guards
that a reset pushes across flip at that moment. They have no instant of their own, and
therefore no projection. The same holds for a guard that a reset puts exactly onto its
surface, as a plastic impact that ends in sticking does with the slip of a foot, if it
puts the neighbours there, too.
"""

from numba import types

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import address_of
from hopdata.hybrid.driver import moving_instants as moving
from hopdata.hybrid.driver.orders import NO_JUMP, order_matters
from hopdata.hybrid.driver.problem import (
    Problem,
    copy_row,
    fill_row,
    has_flipped,
    on_surface,
    time_resolution,
)
from hopdata.hybrid.driver.slopes import gradient_of, passes, row_address, size_of
from hopdata.hybrid.driver.tangents import single
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import along as duals

# The driver calls this code by address, so it is compiled only when a Jacobian is first
# requested. Its parts:
CARRY = 0
RESET = 1
SALTATE = 2
HANDLERS = 3
INSTANT = 4

# How a guard comes to flip: alone; together with others that met their surfaces at this
# instant; pushed across by a handler; at the start, because it is past its surface
# there; or put onto its surface by a handler.
ALONE = 0
TOGETHER = 1
PUSHED = 2
PAST_AT_START = 3
PUT = 4

#: Change of a guard by the start, at the neighbours' own instants after a reset, below
#: which the reset puts them onto its surface, too.
#: Unit: 1, of the terms of that change. Origin: chosen: far above what differences of a
#: handler leave, far below a dependence that matters.
NOT_MOVED = 1e-6

FIRST_ORDER_NATIVE = types.float64(
    types.int64, types.int64, types.float64, types.int64, types.int64, types.int64
)
call_first_order = code.caller(FIRST_ORDER_NATIVE)


@kernel
def first_order(
    p: Problem, part: int, dt: float, which: int, k: int, way: int
) -> float:
    """Run one part of this module by its address: see `driver.loop`."""
    return call_first_order(p.first_order, p.here, part, dt, which, k, way)


@kernel
def add_jump(p: Problem, m: Memory) -> None:
    """Add (f_after - f_before) ALONG to the Jacobian; f_after becomes f_before."""
    phi = p.tangent
    n = m.states.width
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    along = single(m, at.ALONG)
    for i in range(n):
        jump = phi[after, i] - phi[before, i]
        phi[before, i] = phi[after, i]
        if jump != 0.0:  # most entries are zero where a force comes or goes
            for j in range(n):
                phi[i, j] += jump * phi[along, j]


@kernel
def on_another(m: Memory, resolution: float) -> bool:
    """Return whether a due guard is on its surface and has not flipped there yet."""
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        if not has_flipped(m, k) and on_surface(m, k, resolution):
            return True
    return False


@kernel_apart
def puts_neighbours(p: Problem, m: Memory, k: int) -> bool:
    """Return whether a reset has put the neighbours onto the surface of guard k, too.

    At their own instants of the guard before, whose movements are in row ALONG, the
    value of guard k must not depend on the start: Dh Phi - (Dh f + dh/dt) ALONG = 0.
    Then they are off the surface by the square of their distance, at most.
    """
    phi = p.tangent
    n = m.states.width
    along = single(m, at.ALONG)
    gradient = single(m, at.GRADIENT)
    rate = gradient_of(p, m, k)
    moved = 0.0
    terms = 0.0
    for i in range(n):
        slope = abs(phi[gradient, i])
        terms += slope * size_of(p, m, i, m.states[at.Y, i])
    for j in range(n):
        size = size_of(p, m, j, m.states[at.Y, j])
        change = -rate * phi[along, j]
        terms += size * abs(change)
        for i in range(n):
            part = phi[gradient, i] * phi[i, j]
            change += part
            terms += size * abs(part)
        moved += size * abs(change)
    return moved <= NOT_MOVED * terms


@kernel_apart
def saltate(p: Problem, m: Memory, k: int, kind: int) -> int:
    """Pass guard k before it flips, and return a status.

    A guard that flips alone is only projected: `saltate_handlers` adds its jump
    together with the handler's. One of several that flip together is assigned the jump
    by its lock. A guard that is pushed across, or put onto its surface, is passed
    together with the reset.
    Neighbours of a start past a surface start past it as well, so the instant does not
    depend on the state.
    """
    phi = p.tangent
    copy_row(m.states, at.K1, phi, single(m, at.F_BEFORE))
    if kind == PAST_AT_START:
        fill_row(phi, single(m, at.ALONG), 0.0)
    if kind in (PUSHED, PAST_AT_START):
        return at.RUNNING
    if kind == PUT:
        follows = puts_neighbours(p, m, k)
        return at.RUNNING if follows else at.TIE_IN_JACOBIAN
    if kind == TOGETHER:
        resolution = time_resolution(m.clock[at.T], 0.0)
        if order_matters(p, m, resolution):
            return at.TIE_IN_JACOBIAN
    status = passes(p, m, k)
    if kind == TOGETHER:
        p.mode[k] = -p.mode[k]  # a trial: the guard flips later
        m.counts[at.NFEV] += 1
        t = m.clock[at.T]
        after = single(m, at.F_AFTER)
        code.call_field(p.field, t, m.states, at.Y, p.mode, p.params, phi, after)
        add_jump(p, m)
        p.mode[k] = -p.mode[k]
    return status


@kernel
def jumps(p: Problem, m: Memory) -> bool:
    """Return whether the field in F_AFTER differs from that in F_BEFORE."""
    phi = p.tangent
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    size = 0.0
    change = 0.0
    for i in range(m.states.width):
        size = max(size, abs(phi[before, i]), abs(phi[after, i]))
        change = max(change, abs(phi[after, i] - phi[before, i]))
    return change > NO_JUMP * size


@kernel_apart
def pass_instant(p: Problem, m: Memory) -> int:
    """Add what a known instant adds that moves with the parameters; return a status.

    The field before it is in F_BEFORE, and the one after it in K1. The trailing states
    are the parameters.
    """
    phi = p.tangent
    n = m.states.width
    along = single(m, at.ALONG)
    gradient = single(m, at.GRADIENT)
    copy_row(m.states, at.K1, phi, single(m, at.F_AFTER))
    t = m.clock[at.T]
    start = m.clock[at.PASSED]
    end = p.params[p.params.width - 2]  # the first time that the field sees now
    jump = moving.Jump(
        p.switches, start, end, max(abs(t), p.t_end - p.t_start),
        row_address(m, m.states, at.LEAST), n, p.n_varying,
        address_of(p.mode), p.mode.width, address_of(p.params), p.params.width - 2,
        address_of(m.counts) + duals.BYTES * at.ANSWERS,
    )  # fmt: skip
    y = row_address(m, m.states, at.Y)
    found = moving.movements(jump, y, row_address(m, phi, gradient))
    if found != moving.TOLD:
        if jumps(p, m):
            if found == moving.DIFFERENT:
                return at.INSTANTS_IN_JACOBIAN
            m.counts[at.HELD_FIXED] += 1
        return at.RUNNING
    if moving.stands_still(jump, row_address(m, phi, gradient)):
        return at.RUNNING
    if start <= p.t_start and jumps(p, m):
        return at.INSTANTS_IN_JACOBIAN
    for column in range(n):
        phi[along, column] = 0.0
    for j in range(p.n_varying, n):
        for column in range(n):
            phi[along, column] -= phi[gradient, j] * phi[j, column]
    add_jump(p, m)
    return at.RUNNING


@kernel
def saltate_handlers(p: Problem, m: Memory, alone: bool) -> bool:
    """Add the remaining change of the field as part of the last guard's flip.

    Returns whether that is correct. It is not if several guards flip together, because
    their shares are unknown.
    """
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    changed = False
    for i in range(m.states.width):
        p.tangent[after, i] = m.states[at.K1, i]
        changed = changed or p.tangent[after, i] != p.tangent[before, i]
    add_jump(p, m)
    return alone or not changed
