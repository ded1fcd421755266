"""The flow's Jacobian across an instant: one saltation matrix for each guard that flips.

At a crossing of h, Phi becomes DR Phi + (f+ - DR f- - dR/dt) (Dh Phi) / (Dh f- +
dh/dt), with the fields f- before and f+ after it, and the reset R of the handler
(Aizerman and Gantmakher 1958; Kong et al. 2024). If several guards meet their surfaces
at one instant, they are passed in the order in which they flip, and each is assigned
the field selected by the locks so far. This is the derivative if the order does not
matter. It may matter if a handler changes state or field there, or if one guard's flip
turns another one back: then there is no derivative. The change of the field by a single
guard's handler (through the memory, for instance) is attributed to that guard. Guards
that a reset pushes across flip at that moment. They have no instant of their own, and
therefore no projection.
"""

from math import inf, nan, sqrt

from numba import types

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatTable, square
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import Problem, blur, copy_row, fill_row, has_flipped
from hopdata.hybrid.driver.problem import way as some_way
from hopdata.hybrid.driver.stepping import SAFETY, SHRINK_MOST, tolerance
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods import tangent as differences

# The driver calls this code by address, so it is compiled only when a Jacobian is first
# requested.
CARRY, RESET, SALTATE, HANDLERS = range(4)
# How a guard comes to flip: alone; together with others that met their surfaces at this
# instant; pushed across by a handler; or at the start, because it is past its surface
# there.
ALONE, TOGETHER, PUSHED, PAST_AT_START = range(4)
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


# The flow's Jacobian over a step: by the method's own tangent, or by the short tangent.

EASY = 0.2  # tolerances: step error below which the short tangent may be used
SHORT = 300.0  # multiple of rtol: largest (step times fastest motion)^5 of a short step
SMALL = (
    0.1  # tolerances: error of the Jacobian below which it does not limit the next step
)
LOOK, LEAST_LOOK = (
    1e-6,
    1e-9,
)  # fractions of a piece and of t_span: look-ahead for a guard's rate
ASIDE = (
    1e-7,
    1e-5,
    1e-3,
    1e-9,
)  # fractions of a state's size: displacements that are tried
SAME_SLOPE = (
    1e-3  # largest relative difference of a guard's slopes by its rates and its values
)


@kernel
def has_short_tangent(p: Problem, m: Memory, dt: float) -> bool:
    """Return whether the short tangent suffices for a step of `dt`, by the last step's motion."""
    if (
        p.methods[m.counts[at.METHOD], at.SHORT_TANGENT] == 0
        or m.clock[at.ERROR] > EASY
    ):
        return False
    turn = dt * dt * m.clock[at.MOTION]
    return turn * turn * sqrt(turn) <= SHORT * p.rtol


@kernel_apart
def tangent(p: Problem, m: Memory, dt: float) -> float:
    """Write the new Jacobian after the old one; return its error in units of the tolerance.

    A step that ends on the interpolant of a longer step has no stages of its own.
    """
    method, t = m.counts[at.METHOD], m.clock[at.T]
    which, evaluations = at.TANGENT, p.methods[method, at.TANGENT_EVALUATIONS]
    if m.clock[at.SPAN] > dt or has_short_tangent(p, m, dt):
        which, evaluations = at.SHORT_TANGENT, p.methods[method, at.SHORT_EVALUATIONS]
        prepare_interpolant(p, m, dt)
        interpolate(p, m, at.GAUSS_1 * dt / m.clock[at.SPAN], at.SCRATCH, 0.0)
        interpolate(p, m, at.GAUSS_2 * dt / m.clock[at.SPAN], at.SLOPE, 0.0)
    m.counts[at.NFEV] += evaluations
    return code.call_tangent(
        p.methods[method, which], t, dt, p.rtol, m.states, p.mode, p.params, p.atol, p.tangent,
        p.field, p.methods[method, at.DERIVATIVE],
    )  # fmt: skip


@kernel_apart
def carry_jacobian(p: Problem, m: Memory, dt: float) -> float:
    """Multiply the flow's Jacobian by that of the step that ends at END.

    Returns the fraction to which the step must be shortened because the Jacobian's
    error is too large, 1 if it is acceptable, and NaN if it is not finite. A smaller
    error may still limit the next step.
    """
    phi, n = p.tangent, m.states.width
    error = tangent(p, m, dt)
    m.clock[at.MOTION] = phi[3 * n + at.PHI_MOTION, 0]
    if error > SMALL:
        part = max(
            SHRINK_MOST,
            SAFETY / error ** (1.0 / p.methods[m.counts[at.METHOD], at.ORDER]),
        )
        if error > 1.0:
            return part
        m.clock[at.NEXT_DT] = min(m.clock[at.NEXT_DT], part * dt)
    wrong = 0
    for e in range(n * n):
        wrong += 0 if abs(phi[n, e]) < inf else 1
        phi[0, e] = phi[n, e]
    return 1.0 if wrong == 0 else nan


@kernel
def single(m: Memory, row: int) -> int:
    """Return the index of a single row in the tangent's table."""
    return 3 * m.states.width + row


@kernel
def rate_along(
    p: Problem, m: Memory, k: int, row: int, t: float, states: FloatTable, y: int
) -> float:
    """Return guard k's rate at row `y` of `states` for the state's rate in row `row` of phi."""
    phi, g = p.tangent, m.guards
    if p.guards != 0:
        code.call_guards(
            p.guards, t, states, y, phi, row, p.mode, p.params, g, at.H, g, at.RATE
        )
    else:
        code.call_guard(
            p.guard, t, states, y, phi, row, p.mode, p.params, k, g, at.H, g, at.RATE
        )
    return g[at.RATE, k]


@kernel
def project(p: Problem, m: Memory, k: int, rate: float) -> float:
    """Write Dh Phi / rate of guard k into row ALONG, where `rate` is Dh f- + dh/dt.

    Returns the uncertainty of its instant, s.

    The rate is affine in f-, so Dh follows from changing one component of f- after the
    other by the size of the largest. Only components that the guards' code may use are
    changed.
    """
    phi, n, unknown, change = p.tangent, m.states.width, 0.0, 0.0
    moved, before = single(m, at.COLUMN), single(m, at.F_BEFORE)
    inputs = single(m, at.RATE_INPUTS)
    for i in range(n):
        phi[moved, i] = phi[before, i]
        phi[single(m, at.ALONG), i] = 0.0
        change = max(change, phi[inputs, i] * abs(phi[before, i]))
    change = change if change > 0.0 else 1.0
    for i in range(n):
        if phi[inputs, i] != 0.0:
            phi[moved, i] += change
            moved_rate = rate_along(p, m, k, moved, m.clock[at.T], m.states, at.Y)
            part = (moved_rate - rate) / (phi[moved, i] - phi[before, i]) / rate
            phi[moved, i] = phi[before, i]
            for j in range(n):
                phi[single(m, at.ALONG), j] += part * phi[i, j]
            unknown += abs(part) * tolerance(p, i, abs(m.states[at.Y, i]))
    return unknown


@kernel_apart
def bend_of(p: Problem, m: Memory, k: int, rate: float) -> float:
    """Return the second time derivative of guard k, with the field before its flip."""
    ahead, n = LOOK * (m.clock[at.T] - m.clock[at.SEGMENT]), m.states.width
    ahead = max(ahead, LEAST_LOOK * (p.t_end - p.t_start))
    moved, slope = single(m, at.PHI_SHIFTED), single(m, at.PHI_SLOPE)
    for i in range(n):
        p.tangent[moved, i] = (
            m.states[at.Y, i] + ahead * p.tangent[single(m, at.F_BEFORE), i]
        )
    t = m.clock[at.T] + ahead
    code.call_field(p.field, t, p.tangent, moved, p.mode, p.params, p.tangent, slope)
    return (rate_along(p, m, k, slope, t, p.tangent, moved) - rate) / ahead


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
        if jump != 0.0:  # most entries are zero where a force comes or goes
            for j in range(n):
                phi[i, j] += jump * phi[along, j]


@kernel
def size_of(p: Problem, m: Memory, i: int, value: float) -> float:
    """Return the size of state i: its value, its change since the last event, or its tolerance."""
    change = (m.clock[at.T] - m.clock[at.SEGMENT]) * abs(
        p.tangent[single(m, at.F_BEFORE), i]
    )
    return max(abs(value), change, p.atol[i] / p.rtol)


@kernel
def look_beside(p: Problem, m: Memory, side: float, aside: float) -> None:
    """Write a displaced state into two rows, and the direction of the displacement into a third."""
    moved, slope, given = (
        single(m, at.PHI_SHIFTED),
        single(m, at.PHI_SLOPE),
        single(m, at.COLUMN),
    )
    for i in range(m.states.width):
        y = m.states[at.Y, i]
        p.tangent[slope, i] = side * some_way(i) * size_of(p, m, i, y)
        p.tangent[moved, i] = p.tangent[given, i] = y + aside * p.tangent[slope, i]


@kernel_apart
def has_slope_of_rate(p: Problem, m: Memory, k: int) -> bool:
    """Return whether guard k's rate agrees with its values for another motion of the state.

    Several displacements are tried: at small ones values may coincide by rounding, and
    at large ones a guard may bend.
    """
    moved, slope = single(m, at.PHI_SHIFTED), single(m, at.PHI_SLOPE)
    for aside in ASIDE:
        told, seen = 0.0, 0.0
        for side in (1.0, -1.0):
            look_beside(p, m, side, aside)
            told += side * rate_along(p, m, k, slope, m.clock[at.T], p.tangent, moved)
            seen += side * m.guards[at.H, k] / aside
        if abs(told - seen) <= SAME_SLOPE * max(abs(told), abs(seen)):
            return True
    return False


@kernel
def passes(p: Problem, m: Memory, k: int, rate: float) -> int:
    """Project onto guard k (see `project`) and return a status.

    The guard grazes if its rate may be zero within the uncertainty of its instant.
    """
    if not project(p, m, k, rate) * abs(bend_of(p, m, k, rate)) <= 0.5 * abs(rate):
        return at.GRAZING_IN_JACOBIAN
    return at.RUNNING if has_slope_of_rate(p, m, k) else at.RATE_DIFFERS


@kernel
def on_surface(m: Memory, k: int, resolution: float) -> bool:
    """Return whether guard k is on its surface to within rounding."""
    noise = blur(m.guards[at.SIZE, k], m.guards[at.RATE0, k], resolution)
    return abs(m.guards[at.H0, k]) <= noise


@kernel
def on_another(m: Memory, resolution: float) -> bool:
    """Return whether a due guard is on its surface and has not flipped at this instant."""
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        if not has_flipped(m, k) and on_surface(m, k, resolution):
            return True
    return False


@kernel_apart
def saltate(p: Problem, m: Memory, k: int, kind: int) -> int:
    """Pass guard k before it flips, and return a status.

    A guard that flips alone is only projected: `saltate_handlers` adds its jump
    together with the handler's. One of several that flip together is assigned the jump
    by its lock. A guard that is pushed across is passed together with the reset.
    Neighbours of a start past a surface start past it as well, so the instant does not
    depend on the state.
    """
    phi, before, after = p.tangent, single(m, at.F_BEFORE), single(m, at.F_AFTER)
    copy_row(m.states, at.K1, phi, before)
    if kind == PAST_AT_START:
        fill_row(phi, single(m, at.ALONG), 0.0)
    if kind in (PUSHED, PAST_AT_START):
        return at.RUNNING
    status = passes(p, m, k, m.guards[at.RATE0, k])
    if kind == TOGETHER:
        p.mode[k] = -p.mode[k]  # a trial: the guard flips later
        m.counts[at.NFEV] += 1
        code.call_field(
            p.field, m.clock[at.T], m.states, at.Y, p.mode, p.params, phi, after
        )
        add_jump(p, m)
        p.mode[k] = -p.mode[k]
    return status


@kernel
def keep(p: Problem, part: int) -> None:
    """Store mode and parameters as those before (0) or after (1) a handler."""
    first, n_modes = part * (p.mode.width + p.params.width), p.mode.width
    for i in range(n_modes):
        p.kept[first + i] = p.mode[i]
    for i in range(p.params.width):
        p.kept[first + n_modes + i] = p.params[i]


@kernel
def bring_back(p: Problem, part: int) -> None:
    """Restore the stored mode and parameters."""
    first, n_modes = part * (p.mode.width + p.params.width), p.mode.width
    for i in range(n_modes):
        p.mode[i] = int(p.kept[first + i])
    for i in range(p.params.width):
        p.params[i] = p.kept[first + n_modes + i]


@kernel
def reset_by(
    p: Problem, m: Memory, log: FloatTable, row: int, j: int, k: int, way: int
) -> None:
    """Compute the derivative of the reset with respect to state j, or to time if j is n.

    Differences as in `methods.tangent`; the result goes into the first column of the
    third block.
    """
    phi, n, t = p.tangent, m.states.width, m.clock[at.T]
    values, before = single(m, at.PHI_VALUES), at.LOG_STATES
    size = size_of(p, m, j, log[row, before + j]) if j < n else p.t_end - p.t_start
    step = differences.FIFTH_ROOT_OF_EPS * (
        size if size > differences.ABSOLUTELY_TINY else 1.0
    )
    for i in range(n):
        phi[values + 5, i] = differences.NOISE * abs(m.states[at.Y, i])
    for attempt in range(differences.ATTEMPTS):
        for side in range(4):
            shift = differences.SHIFTS[side] * step
            for i in range(n):
                phi[values + side, i] = log[row, before + i] + (
                    shift if i == j else 0.0
                )
            bring_back(p, 0)
            then = t + shift if j == n else t
            code.call_on_event(
                p.on_event, then, phi, values + side, p.mode, p.params, k, way
            )
        if differences.settle(phi, values, attempt, step, phi, 2 * n, 0, n):
            break
        step *= differences.SHORTER


@kernel
def resets(p: Problem, m: Memory, log: FloatTable, row: int, k: int, way: int) -> bool:
    """Return whether a handler has changed the state, or would change a neighbouring one."""
    phi, t, changed = p.tangent, m.clock[at.T], False
    moved, given = single(m, at.PHI_SHIFTED), single(m, at.COLUMN)
    for i in range(m.states.width):
        changed = changed or m.states[at.Y, i] != log[row, at.LOG_STATES + i]
    if not changed:
        look_beside(p, m, 1.0, ASIDE[0])
        bring_back(p, 0)
        code.call_on_event(p.on_event, t, phi, moved, p.mode, p.params, k, way)
        for i in range(m.states.width):
            changed = changed or phi[moved, i] != phi[given, i]
    return changed


@kernel_apart
def carry_reset(
    p: Problem, m: Memory, log: FloatTable, row: int, k: int, way: int
) -> bool:
    """Multiply Phi and f- by the derivative of the reset in row `row` of the log, if there is one.

    Its time derivative is added to f-, so that `saltate_handlers` subtracts it.
    """
    phi, n = p.tangent, m.states.width
    before, after = single(m, at.F_BEFORE), single(m, at.F_AFTER)
    keep(p, 1)
    if not resets(p, m, log, row, k, way):
        bring_back(p, 1)
        return False
    square(phi, n)[:] = 0.0
    fill_row(phi, after, 0.0)
    for j in range(n + 1):
        reset_by(p, m, log, row, j, k, way)
        for i in range(n):
            slope = phi[2 * n + i, 0]
            phi[after, i] += slope * (phi[before, j] if j < n else 1.0)
            for c in range(n if j < n and slope != 0.0 else 0):
                phi[n + i, c] += slope * phi[j, c]
    for i in range(n):
        copy_row(phi, n + i, phi, i)
    copy_row(phi, after, phi, before)
    bring_back(p, 1)
    return True


@kernel
def saltate_handlers(p: Problem, m: Memory, alone: bool) -> bool:
    """Add the remaining change of the field as part of the last guard's flip.

    Returns whether that is correct. It is not if several guards flip together, because
    their shares are unknown.
    """
    before, after = single(m, at.F_BEFORE), single(m, at.F_AFTER)
    changed = False
    for i in range(m.states.width):
        p.tangent[after, i] = m.states[at.K1, i]
        changed = changed or p.tangent[after, i] != p.tangent[before, i]
    add_jump(p, m)
    return alone or not changed
