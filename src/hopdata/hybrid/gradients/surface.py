"""Back through the instant at which a guard meets its surface.

A line belongs here if it differentiates that instant: with the guard h(tau, y) = 0 and
the field f- before it,

    dtau = -(D h dy- + dh/dp dp) / (D h f- + dh/dt).

All functions expect the field before the flip in F_BEFORE.
"""

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel_apart
from hopdata.hybrid.driver.slopes import LEAST_LOOK, LOOK
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.sweep import restore_params, rewind, set_params_aside
from hopdata.hybrid.gradients.user_functions import differentiate_guard, field_value
from hopdata.hybrid.gradients.workspace import (
    AHEAD,
    BY_STATE,
    F_BEFORE,
    GUARD_BY_STATE,
    SCRATCH,
    FlipInstant,
    Room,
    Tolerance,
)

#: Distance from its surface within which a guard has met it at an instant.
#: Unit: 1, of its way since the last event. Origin: chosen.
MET = 1e-7

#: Distance from its surface that rounding of the states may cause.
#: Unit: 1, of the terms of the guard. Origin: chosen.
ROUNDED = 1e-12


@kernel_apart
def guard_at(
    code: Recorders,
    room: Room,
    k: int,
    instant: FlipInstant,
    y: FloatArray,
    mode: IntArray,
) -> tuple[float, float, float]:
    """Return guard k's derivative by the time, its rate, and the size of its terms.

    Its derivatives by states and parameters are where `differentiate_guard` puts them.
    """
    by_time = differentiate_guard(code, room, k, instant.t, y, mode)
    rate = by_time
    size = abs(by_time * instant.t)
    for i in range(len(y)):
        slope = room.rows[GUARD_BY_STATE, i]
        f = room.rows[F_BEFORE, i]
        rate += slope * f
        size += abs(slope) * (abs(y[i]) + instant.since * abs(f))
    return by_time, rate, size


@kernel_apart
def has_met(
    code: Recorders,
    room: Room,
    k: int,
    instant: FlipInstant,
    y: FloatArray,
    mode: IntArray,
) -> bool:
    """Return whether guard k is at its surface."""
    p = len(room.params)
    rewind(room, p)
    set_params_aside(room, p)
    _, rate, size = guard_at(code, room, k, instant, y, mode)
    restore_params(room, p, 0.0)
    return abs(room.h[k, 0]) <= MET * instant.since * abs(rate) + ROUNDED * size


@kernel_apart
def grazes(
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    k: int,
    instant: FlipInstant,
    y: FloatArray,
    mode: IntArray,
    rate: float,
) -> bool:
    """Return whether the rate may be zero within the uncertainty of the instant.

    The guard's derivative is in GUARD_BY_STATE, and is overwritten.
    """
    n = len(y)
    ahead = max(LOOK * instant.since, LEAST_LOOK * instant.span)
    unsure = 0.0
    for i in range(n):
        allowed = tolerance.absolute[i] + tolerance.relative[0] * abs(y[i])
        unsure += abs(room.rows[GUARD_BY_STATE, i]) * allowed
        room.rows[AHEAD, i] = y[i] + ahead * room.rows[F_BEFORE, i]
    rewind(room, len(room.params))
    moved = room.rows[AHEAD]
    later = instant.t + ahead
    field_value(code, room, later, moved, mode, SCRATCH)
    rate_ahead = differentiate_guard(code, room, k, later, moved, mode)
    for i in range(n):
        rate_ahead += room.rows[GUARD_BY_STATE, i] * room.rows[SCRATCH, i]
    bend = abs(rate_ahead - rate) / ahead
    return not unsure / abs(rate) * bend <= 0.5 * abs(rate)


@kernel_apart
def meeting_back(
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    k: int,
    instant: FlipInstant,
    y: FloatArray,
    mode: IntArray,
    by_instant: float,
) -> int:
    """Carry the loss's derivative by a guard's instant to state and parameters.

    Returns a status.
    """
    p = len(room.params)
    n = len(y)
    rewind(room, p)
    set_params_aside(room, p)
    rate = differentiate_guard(code, room, k, instant.t, y, mode)
    for i in range(n):
        rate += room.rows[GUARD_BY_STATE, i] * room.rows[F_BEFORE, i]
    factor = 0.0
    if by_instant != 0.0:
        factor = -by_instant / rate
    restore_params(room, p, factor)
    for i in range(n):
        room.rows[BY_STATE, i] += factor * room.rows[GUARD_BY_STATE, i]
    set_params_aside(room, p)
    grazed = grazes(code, room, tolerance, k, instant, y, mode, rate)
    restore_params(room, p, 0.0)
    return at.GRAZING_IN_JACOBIAN if grazed else at.RUNNING
