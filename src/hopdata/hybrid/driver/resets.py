"""The derivative of what a handler does to the state: by duals, or by differences."""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatTable, address_of, square
from hopdata.hybrid.driver.problem import Problem, copy_row, fill_row
from hopdata.hybrid.driver.slopes import ASIDE, look_beside, row_address, size_of
from hopdata.hybrid.driver.tangents import single
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods import tangent as differences
from hopdata.hybrid.numbers import along as duals


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
