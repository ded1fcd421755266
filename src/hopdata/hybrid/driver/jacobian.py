"""The flow's Jacobian across an instant: a saltation matrix for each guard that flips.

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
from hopdata.hybrid.compiled.memory import FloatTable, address_of, square
from hopdata.hybrid.driver import moving_instants as moving
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import (
    ROUNDING,
    Problem,
    blur,
    copy_row,
    fill_row,
    has_flipped,
)
from hopdata.hybrid.driver.problem import way as some_way
from hopdata.hybrid.driver.stepping import SAFETY, SHRINK_MOST, TINY, tolerance
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods import tangent as differences
from hopdata.hybrid.numbers import along as duals

# The driver calls this code by address, so it is compiled only when a Jacobian is first
# requested. Its parts:
CARRY = 0
RESET = 1
SALTATE = 2
HANDLERS = 3
INSTANT = 4

# How a guard comes to flip: alone; together with others that met their surfaces at this
# instant; pushed across by a handler; or at the start, because it is past its surface
# there.
ALONE = 0
TOGETHER = 1
PUSHED = 2
PAST_AT_START = 3

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

#: How far ahead a guard's rate is evaluated for its bend, as a fraction of the time
#: since the last event.
#: Unit: 1. Origin: chosen.
LOOK = 1e-6

#: The least that it is evaluated ahead, as a fraction of the time span.
#: Unit: 1. Origin: chosen.
LEAST_LOOK = 1e-9

#: Displacements of a state that are tried in turn, as fractions of its size: at small
#: ones values may coincide by rounding, and at large ones a guard may bend.
#: Unit: 1. Origin: chosen.
ASIDE = (1e-7, 1e-5, 1e-3, 1e-9)

#: Jump of the field that counts as none.
#: Unit: 1, of the field. Origin: chosen: what the field may change by within the
#: rounding of an instant, of motions as fast as 1e5 per unit of the time.
NO_JUMP = 1e-10

#: Largest relative difference of a guard's slopes by its rates and by its values.
#: Unit: 1. Origin: chosen.
SAME_SLOPE = 1e-3


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


@kernel
def rate_along(
    p: Problem, m: Memory, k: int, row: int, t: float, states: FloatTable, y: int
) -> float:
    """Return guard k's rate at row `y` of `states`.

    The state's rate is in row `row` of phi.
    """
    phi = p.tangent
    g = m.guards
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
def row_address(m: Memory, table: FloatTable, row: int) -> int:
    """Return the address of a row of a table as wide as the state."""
    return address_of(table) + duals.BYTES * m.states.width * row


@kernel_apart
def gradient_of(p: Problem, m: Memory, k: int) -> float:
    """Write Dh of guard k into row GRADIENT; return its rate Dh f- + dh/dt."""
    phi = p.tangent
    n = m.states.width
    before = single(m, at.F_BEFORE)
    gradient = single(m, at.GRADIENT)
    if p.along[duals.GUARD] == 0:
        return gradient_by_rates(p, m, k)
    y = row_address(m, m.states, at.Y)
    into = row_address(m, phi, gradient)
    rate = duals.guard_gradient(
        p.along, m.clock[at.T], y, n, m.states, at.K1, p.mode, p.params, k, into
    )
    for i in range(n):
        rate += phi[gradient, i] * phi[before, i]
    return rate


@kernel
def gradient_by_rates(p: Problem, m: Memory, k: int) -> float:
    """Write Dh of a guard that does not compile for duals; return its rate.

    The rate is affine in f-, so Dh follows from changing one component of f- after the
    other by the size of the largest. Only components that the guards' code may use are
    changed.
    """
    phi = p.tangent
    n = m.states.width
    rate = m.guards[at.RATE0, k]
    moved = single(m, at.COLUMN)
    before = single(m, at.F_BEFORE)
    gradient = single(m, at.GRADIENT)
    inputs = single(m, at.RATE_INPUTS)
    change = 0.0
    for i in range(n):
        phi[moved, i] = phi[before, i]
        phi[gradient, i] = 0.0
        change = max(change, phi[inputs, i] * abs(phi[before, i]))
    if not change > 0.0:
        change = 1.0
    for i in range(n):
        if phi[inputs, i] == 0.0:
            continue
        phi[moved, i] += change
        moved_rate = rate_along(p, m, k, moved, m.clock[at.T], m.states, at.Y)
        slope = (moved_rate - rate) / (phi[moved, i] - phi[before, i])
        phi[gradient, i] = slope
        phi[moved, i] = phi[before, i]
    return rate


@kernel
def project(p: Problem, m: Memory, rate: float) -> float:
    """Write Dh Phi / rate into row ALONG, where `rate` is Dh f- + dh/dt.

    Returns the uncertainty of the guard's instant, s. Dh is in row GRADIENT.
    """
    phi = p.tangent
    n = m.states.width
    along = single(m, at.ALONG)
    gradient = single(m, at.GRADIENT)
    unknown = 0.0
    for j in range(n):
        phi[along, j] = 0.0
    for i in range(n):
        time_per_state = phi[gradient, i] / rate
        if time_per_state != 0.0:
            for j in range(n):
                phi[along, j] += time_per_state * phi[i, j]
        unknown += abs(time_per_state) * tolerance(p, i, abs(m.states[at.Y, i]))
    return unknown


@kernel_apart
def bend_of(p: Problem, m: Memory, k: int, rate: float) -> float:
    """Return the second time derivative of guard k, with the field before its flip."""
    phi = p.tangent
    since_event = m.clock[at.T] - m.clock[at.SEGMENT]
    ahead = max(LOOK * since_event, LEAST_LOOK * (p.t_end - p.t_start))
    before = single(m, at.F_BEFORE)
    moved = single(m, at.PHI_SHIFTED)
    slope = single(m, at.PHI_SLOPE)
    for i in range(m.states.width):
        phi[moved, i] = m.states[at.Y, i] + ahead * phi[before, i]
    t = m.clock[at.T] + ahead
    code.call_field(p.field, t, phi, moved, p.mode, p.params, phi, slope)
    return (rate_along(p, m, k, slope, t, phi, moved) - rate) / ahead


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
def size_of(p: Problem, m: Memory, i: int, value: float) -> float:
    """Return the size of state i: the largest of three.

    They are its value, its change since the last event, and where its absolute
    tolerance takes over from the relative one.
    """
    since_event = m.clock[at.T] - m.clock[at.SEGMENT]
    change = since_event * abs(p.tangent[single(m, at.F_BEFORE), i])
    return max(abs(value), change, p.atol[i] / p.rtol)


@kernel
def look_beside(p: Problem, m: Memory, side: float, aside: float) -> None:
    """Write a displaced state into PHI_SHIFTED and COLUMN.

    The direction of the displacement is written into PHI_SLOPE.
    """
    phi = p.tangent
    moved = single(m, at.PHI_SHIFTED)
    given = single(m, at.COLUMN)
    slope = single(m, at.PHI_SLOPE)
    for i in range(m.states.width):
        y = m.states[at.Y, i]
        phi[slope, i] = side * some_way(i) * size_of(p, m, i, y)
        phi[moved, i] = y + aside * phi[slope, i]
        phi[given, i] = phi[moved, i]


@kernel_apart
def has_slope_of_rate(p: Problem, m: Memory, k: int) -> bool:
    """Return whether guard k's rate agrees with its values for a motion of the state.

    The motion is along one direction and back. Several displacements are tried. A guard
    that jumps there has values that no rate describes.
    """
    phi = p.tangent
    moved = single(m, at.PHI_SHIFTED)
    slope = single(m, at.PHI_SLOPE)
    gradient = single(m, at.GRADIENT)
    for aside in ASIDE:
        by_rate = 0.0
        by_value = 0.0
        for side in (1.0, -1.0):
            look_beside(p, m, side, aside)
            rate = rate_along(p, m, k, slope, m.clock[at.T], phi, moved)
            by_value += side * m.guards[at.H, k] / aside
            if p.along[duals.GUARD] == 0:
                by_rate += side * rate
            else:
                for i in range(m.states.width):
                    by_rate += side * phi[gradient, i] * phi[slope, i]
        if abs(by_rate - by_value) <= SAME_SLOPE * max(abs(by_rate), abs(by_value)):
            return True
    return False


@kernel
def has_slope_along(p: Problem, m: Memory, k: int, rate: float) -> bool:
    """Return whether guard k's slope agrees with its values where the neighbours are.

    They are beside the state in a direction that Phi gives. Their slopes, divided by
    the guard's rate, are in row ALONG.
    """
    phi = p.tangent
    n = m.states.width
    moved = single(m, at.PHI_SHIFTED)
    way = single(m, at.PHI_SLOPE)
    along = single(m, at.ALONG)
    largest = 0.0
    for i in range(n):
        phi[way, i] = 0.0
        for j in range(n):
            size = size_of(p, m, j, m.states[at.Y, j])
            phi[way, i] += phi[i, j] * some_way(j) * size
        size = size_of(p, m, i, m.states[at.Y, i])
        largest = max(largest, abs(phi[way, i]) / size)
    if largest == 0.0:
        return True
    expected = 0.0
    for j in range(n):
        size = size_of(p, m, j, m.states[at.Y, j])
        expected += rate * phi[along, j] * some_way(j) * size / largest
    for aside in ASIDE:
        found = 0.0
        for side in (1.0, -1.0):
            for i in range(n):
                y = m.states[at.Y, i]
                phi[moved, i] = y + side * aside * phi[way, i] / largest
            rate_along(p, m, k, way, m.clock[at.T], phi, moved)
            found += 0.5 * side * m.guards[at.H, k] / aside
        noise = ROUNDING * m.guards[at.SIZE, k] / aside
        most = SAME_SLOPE * max(abs(expected), abs(found)) + noise
        if abs(expected - found) <= most:
            return True
    return False


#: Part of its terms by which a guard that grazes may be off its surface.
#: Unit: 1, of `SIZE`. Origin: chosen: far above rounding, far below a jump.
ON_SURFACE = 1e-6


@kernel
def is_off(m: Memory, k: int) -> bool:
    """Return whether guard k is off its surface where it flips, because it jumps."""
    return abs(m.guards[at.H0, k]) > ON_SURFACE * m.guards[at.SIZE, k]


@kernel_apart
def passes_along(p: Problem, m: Memory, k: int) -> int:
    """Do what `passes` does, by the slopes in the directions of the neighbours only.

    Where a solution slides, they are on the surface as well. A field that has a kink on
    the surface has none along it.
    """
    phi = p.tangent
    n = m.states.width
    before = single(m, at.F_BEFORE)
    along = single(m, at.ALONG)
    rate = duals.guard_along(
        p.along, m.clock[at.T], row_address(m, m.states, at.Y), n, m.states, at.K1,
        p.mode, p.params, k, row_address(m, phi, 0), row_address(m, phi, before),
        row_address(m, phi, along),
    )  # fmt: skip
    given = m.guards[at.RATE0, k]
    if not abs(rate - given) <= SAME_SLOPE * max(abs(rate), abs(given)):
        return at.RATE_DIFFERS
    unsure = 0.0
    for j in range(n):
        phi[along, j] /= rate
        slope = phi[single(m, at.GRADIENT), j] / rate
        unsure += abs(slope) * tolerance(p, j, abs(m.states[at.Y, j]))
    bend = abs(bend_of(p, m, k, given))
    if not unsure * bend <= 0.5 * abs(rate):
        return at.RATE_DIFFERS if is_off(m, k) else at.GRAZING_IN_JACOBIAN
    if not has_slope_along(p, m, k, rate):
        return at.RATE_DIFFERS
    return at.RUNNING


@kernel
def passes(p: Problem, m: Memory, k: int) -> int:
    """Project onto guard k (see `project`) and return a status.

    The guard grazes if its rate may be zero within the uncertainty of its instant.
    """
    status = passes_by_gradient(p, m, k)
    if status == at.RATE_DIFFERS and p.along[duals.GUARD] != 0:
        return passes_along(p, m, k)
    return status


@kernel
def passes_by_gradient(p: Problem, m: Memory, k: int) -> int:
    """Do what `passes` does, by the derivative of the guard by all states."""
    rate = gradient_of(p, m, k)
    given = m.guards[at.RATE0, k]
    if not abs(rate - given) <= SAME_SLOPE * max(abs(rate), abs(given)):
        return at.RATE_DIFFERS
    unsure_s = project(p, m, rate)
    bend = abs(bend_of(p, m, k, given))
    if not unsure_s * bend <= 0.5 * abs(rate):
        return at.RATE_DIFFERS if is_off(m, k) else at.GRAZING_IN_JACOBIAN
    if not has_slope_of_rate(p, m, k):
        return at.RATE_DIFFERS
    return at.RUNNING


@kernel
def on_surface(m: Memory, k: int, resolution: float) -> bool:
    """Return whether guard k is on its surface to within rounding."""
    noise = blur(m.guards[at.SIZE, k], m.guards[at.RATE0, k], resolution)
    return abs(m.guards[at.H0, k]) <= noise


@kernel
def on_another(m: Memory, resolution: float) -> bool:
    """Return whether a due guard is on its surface and has not flipped there yet."""
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
    phi = p.tangent
    copy_row(m.states, at.K1, phi, single(m, at.F_BEFORE))
    if kind == PAST_AT_START:
        fill_row(phi, single(m, at.ALONG), 0.0)
    if kind in (PUSHED, PAST_AT_START):
        return at.RUNNING
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
def keep(p: Problem, part: int) -> None:
    """Store mode and parameters as those before (0) or after (1) a handler."""
    n_modes = p.mode.width
    first = part * (n_modes + p.params.width)
    for i in range(n_modes):
        p.kept[first + i] = p.mode[i]
    for i in range(p.params.width):
        p.kept[first + n_modes + i] = p.params[i]


@kernel
def bring_back(p: Problem, part: int) -> None:
    """Restore the stored mode and parameters."""
    n_modes = p.mode.width
    first = part * (n_modes + p.params.width)
    for i in range(n_modes):
        p.mode[i] = int(p.kept[first + i])
    for i in range(p.params.width):
        p.params[i] = p.kept[first + n_modes + i]


# The derivative of a reset that does not compile for duals, by differences.


@kernel
def reset_by(
    p: Problem, m: Memory, log: FloatTable, row: int, j: int, k: int, way: int
) -> None:
    """Compute the derivative of the reset by state j, or by time if j is n.

    Differences as in `methods.tangent`; the result goes into the first column of the
    third block.
    """
    phi = p.tangent
    n = m.states.width
    values = single(m, at.PHI_VALUES)
    size = p.t_end - p.t_start
    if j < n:
        size = size_of(p, m, j, log[row, at.LOG_STATES + j])
    if not size > differences.ABSOLUTELY_TINY:
        size = 1.0
    step = differences.FIFTH_ROOT_OF_EPS * size
    for i in range(n):
        phi[values + 5, i] = differences.NOISE * abs(m.states[at.Y, i])
    for attempt in range(differences.ATTEMPTS):
        for side in range(4):
            shift = differences.SHIFTS[side] * step
            reset_beside(p, m, log, row, values + side, j, shift, k, way)
        if differences.settle(phi, values, attempt, step, phi, 2 * n, 0, n):
            break
        step *= differences.SHORTER


@kernel
def reset_beside(  # noqa: PLR0913 (the handler's arguments, and their places)
    p: Problem,
    m: Memory,
    log: FloatTable,
    row: int,
    into: int,
    j: int,
    shift: float,
    k: int,
    way: int,
) -> None:
    """Write the state after the handler into row `into` of phi, for a shifted start.

    State j, or the time if j is n, is shifted before the handler of guard k is called.
    """
    phi = p.tangent
    n = m.states.width
    for i in range(n):
        y = log[row, at.LOG_STATES + i]
        phi[into, i] = y + (shift if i == j else 0.0)
    t = m.clock[at.T]
    if j == n:
        t = t + shift
    bring_back(p, 0)
    code.call_on_event(p.on_event, t, phi, into, p.mode, p.params, k, way)


@kernel
def resets(p: Problem, m: Memory, log: FloatTable, row: int, k: int, way: int) -> bool:
    """Return whether a handler has changed the state, or would change one beside it."""
    for i in range(m.states.width):
        if m.states[at.Y, i] != log[row, at.LOG_STATES + i]:
            return True
    phi = p.tangent
    moved = single(m, at.PHI_SHIFTED)
    given = single(m, at.COLUMN)
    look_beside(p, m, 1.0, ASIDE[0])
    bring_back(p, 0)
    t = m.clock[at.T]
    code.call_on_event(p.on_event, t, phi, moved, p.mode, p.params, k, way)
    changed = False
    for i in range(m.states.width):
        changed = changed or phi[moved, i] != phi[given, i]
    return changed


@kernel
def carry_reset_by_duals(
    p: Problem, m: Memory, log: FloatTable, row: int, k: int, way: int
) -> bool:
    """Do what `carry_reset` does, for a handler that compiles for duals.

    Its slopes along the columns of Phi, and along f- with the time, are the products.
    """
    phi = p.tangent
    n = m.states.width
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    y = address_of(log) + duals.BYTES * (log.width * row + at.LOG_STATES)
    bring_back(p, 0)
    duals.handler_along(
        p.along, m.clock[at.T], y, n, p.mode, p.params, k, way,
        row_address(m, phi, 0), row_address(m, phi, before),
        row_address(m, phi, n), row_address(m, phi, after),
    )  # fmt: skip
    bring_back(p, 1)
    jumped = False
    for i in range(n):
        jumped = jumped or m.states[at.Y, i] != log[row, at.LOG_STATES + i]
        jumped = jumped or phi[after, i] != phi[before, i]
        phi[before, i] = phi[after, i]
    for e in range(n * n):
        jumped = jumped or phi[n, e] != phi[0, e]
        phi[0, e] = phi[n, e]
    return jumped


@kernel_apart
def carry_reset(
    p: Problem, m: Memory, log: FloatTable, row: int, k: int, way: int
) -> bool:
    """Multiply Phi and f- by the derivative of the reset, if there is one.

    The state before it is in row `row` of the log. Its time derivative is added to f-,
    so that `saltate_handlers` subtracts it.
    """
    phi = p.tangent
    n = m.states.width
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    keep(p, 1)
    if p.along[duals.HANDLER] != 0:
        return carry_reset_by_duals(p, m, log, row, k, way)
    if not resets(p, m, log, row, k, way):
        bring_back(p, 1)
        return False
    square(phi, n)[:] = 0.0
    fill_row(phi, after, 0.0)
    for j in range(n + 1):
        reset_by(p, m, log, row, j, k, way)
        for i in range(n):
            slope = phi[2 * n + i, 0]
            rate = phi[before, j] if j < n else 1.0  # of state j, or of time
            phi[after, i] += slope * rate
            if j < n and slope != 0.0:
                for column in range(n):
                    phi[n + i, column] += slope * phi[j, column]
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
    before = single(m, at.F_BEFORE)
    after = single(m, at.F_AFTER)
    changed = False
    for i in range(m.states.width):
        p.tangent[after, i] = m.states[at.K1, i]
        changed = changed or p.tangent[after, i] != p.tangent[before, i]
    add_jump(p, m)
    return alone or not changed
