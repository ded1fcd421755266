"""The knots of a step: where its guards are known, and between which a cubic stands for each.

Mostly these are the step's two ends. A series may be good over most of a swing, in which a guard
can fall and rise again unseen from the ends: then there are knots inside, too.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.dense import interpolate_with_slope, prepare_interpolant
from hopdata.hybrid.driver.layout import (
    DEGREE,
    H0,
    H1,
    IN_POWERS,
    METHOD,
    PIECE,
    PIECES,
    SCRATCH,
    SLOPE,
    H,
    Memory,
    T,
)
from hopdata.hybrid.driver.problem import Problem, eval_guards

# Degrees that a series needs for 1.5 and 3 radians of the fastest motion that shows in it.
ONE_PIECE, TWO_PIECES = 22, 28
THIRD = 1.0 / 3.0


@kernel
def knot(m: Memory, number: int) -> int:
    """Return the row of the guards at a knot; that of their rates comes next."""
    return H1 if number == m.counts[PIECES] else H0 + 2 * number


@kernel
def piece_ends(
    m: Memory, k: int, lock: int, piece: int, dt: float
) -> tuple[float, float, float, float]:
    """Return margin and slope of guard k, per piece, at both ends of a piece of the step."""
    return ends_between(m, k, lock, H0 + 2 * piece, knot(m, piece + 1), dt * m.clock[PIECE])


@kernel
def ends_between(
    m: Memory, k: int, lock: int, start: int, end: int, span: float
) -> tuple[float, float, float, float]:
    """Return margin and slope of guard k, per `span`, by the rows of its values at two places."""
    g = m.guards
    g0, d0 = lock * g[start, k], lock * g[start + 1, k] * span
    return g0, d0, lock * g[end, k], lock * g[end + 1, k] * span


@kernel
def piece_before(m: Memory, piece: int, end: float) -> tuple[int, float, float]:
    """Return where a piece of the step that ends at `end` has its end, as a row, start and length.

    The last piece before `end` is cut off there: the guards have been evaluated there last.
    """
    part = m.clock[PIECE]
    start = piece * part
    if (piece + 1) * part <= end:
        return knot(m, piece + 1), start, part
    return H, start, end - start


@kernel
def set_knots(p: Problem, m: Memory, dt: float) -> None:
    """Choose the knots of a step, and evaluate the guards at those inside."""
    m.counts[PIECES], m.clock[PIECE] = 1, 1.0
    if p.methods[m.counts[METHOD], IN_POWERS] == 0:
        return
    prepare_interpolant(p, m, dt)
    if m.counts[DEGREE] <= ONE_PIECE:
        return
    if m.counts[DEGREE] <= TWO_PIECES:
        m.counts[PIECES], m.clock[PIECE] = 2, 0.5
    else:
        m.counts[PIECES], m.clock[PIECE] = 3, THIRD
    for number in range(1, m.counts[PIECES]):
        theta, row = number * m.clock[PIECE], H0 + 2 * number
        interpolate_with_slope(p, m, theta, dt)
        eval_guards(p, m, m.clock[T] + theta * dt, SCRATCH, SLOPE, row, row + 1)
