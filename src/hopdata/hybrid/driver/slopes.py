"""A guard's slope where it flips, and whether it has one there.

`passes` divides it by the guard's rate: by how much the instant moves with the state.
A guard that grazes, that jumps, or whose rates do not agree with its values has none.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatTable, address_of
from hopdata.hybrid.driver.problem import ROUNDING, Problem
from hopdata.hybrid.driver.problem import way as some_way
from hopdata.hybrid.driver.stepping import tolerance
from hopdata.hybrid.driver.tangents import single
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import along as duals

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

#: Largest relative difference of a guard's slopes by its rates and by its values.
#: Unit: 1. Origin: chosen.
SAME_SLOPE = 1e-3


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
