"""Guards at rest: the reactions that keep their rates at zero.

A reaction's size follows from the second time derivative of its guard, the bend. The
guard's rate is evaluated for numbers that move, which gives the bend exactly; functions
that do not compile for them have it by differences.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.hybrid.methods import tangent
from hopdata.hybrid.numbers.moving import (
    as_item,
    moving,
    room_like,
    room_moving,
)
from hopdata.hybrid.sliding.flags import RESTING, STUCK
from hopdata.hybrid.sliding.mix import size_of, solve_small

FIRST_STEP = tangent.FIFTH_ROOT_OF_EPS

# Inserted into the templates (see `sliding.system`).
HANDLER: Any = None
SLIDE: Any = None
RATED: Any = None
APPROACH: Any = None
MOVED_APPROACH: Any = None
RATE: Any = None
BENDS: Any = None
ALONG: Any = None
N = 0
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
N_MATRIX = 0
SURFACES = (0,)


def approach_template(t: Any, y: Any, mode: Any, params: Any, values: Any) -> None:
    """Fill `values` with the rates of the guards that rest; zero for the others."""
    dy = room_like(y, N)
    shares = room_like(y, M)
    slopes = room_like(y, M)
    SLIDE(t, y, mode, params, dy, shares, slopes)
    h = room_like(y, N_GUARDS)
    hdot = room_like(y, N_GUARDS)
    numbers = params[: len(params) - OWN]
    RATED(t, y, dy, mode[M : M + N_MODES], numbers, h, hdot)
    for j in range(M):
        values[j] = 0.0
        if mode[M + N_MODES + j] >= RESTING:
            values[j] = hdot[SURFACES[j]]


def bends_template(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, values: Any
) -> None:
    """Fill `values` with the changes of the resting guards' rates, by time and `dy`."""
    place = room_moving(y, N)
    rates = room_moving(y, M)
    for i in range(N):
        place[i] = moving(y[i], dy[i])
    MOVED_APPROACH(moving(as_item(t, y), 1.0), place, mode, params, rates)
    for j in range(M):
        values[j] = rates[j].rate


def bends_by_differences(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, values: Any
) -> None:
    """Fill `values` with the changes of the resting guards' rates, by time and `dy`."""
    for j in range(M):
        values[j] = 0.0
    RATE(t, y, dy, mode, params, True, values)
    RATE(t, y, dy, mode, params, False, values)


def along_template(t: Any, y: Any, mode: Any, params: Any, j: int, values: Any) -> None:
    """Fill `values` with the change of all resting guards' rates by a unit reaction."""
    first = len(params) - OWN + j * N
    place = room_moving(y, N)
    rates = room_moving(y, M)
    for i in range(N):
        place[i] = moving(y[i], params[first + i])
    MOVED_APPROACH(moving(as_item(t, y), 0.0), place, mode, params, rates)
    for other in range(M):
        values[other] = rates[other].rate


def along_by_differences(
    t: float, y: Any, mode: Any, params: Any, j: int, values: Any
) -> None:
    """Fill `values` with the change of all resting guards' rates by a unit reaction."""
    n = len(y)
    first = len(params) - OWN + j * n
    step = FIRST_STEP * max(size_of(y), params[len(params) - M + j])
    if step == 0.0:
        step = FIRST_STEP
    beside = np.empty(n)
    above = np.empty(M)
    for side in range(2):
        for i in range(n):
            beside[i] = y[i] + (1.0 - 2.0 * side) * step * params[first + i]
        APPROACH(t, beside, mode, params, values if side == 1 else above)
    for other in range(M):
        values[other] = (above[other] - values[other]) / (2.0 * step)


def mix_template(
    t: Any, y: Any, mode: Any, params: Any, dy: Any, shares: Any, slopes: Any
) -> None:
    """Fill `dy` with the field: mixed, and with the reactions of guards that rest.

    A reaction acts along the change of the state by the guard's handler. It keeps the
    guard's rate at zero. In place of a share, `shares` receives what causes it: the
    bend of the guard without reactions, positive while the field presses on it.
    """
    SLIDE(t, y, mode, params, dy, shares, slopes)
    listed = np.empty(M, dtype=np.int64)
    count = 0
    for j in range(M):
        if mode[M + N_MODES + j] == RESTING:
            listed[count] = j
            count += 1
    if count == 0:
        return
    matrix = room_like(y, N_MATRIX)[: count * count]
    again = room_like(y, N_MATRIX)[: count * count]
    column = room_like(y, M)
    for b in range(count):
        ALONG(t, y, mode, params, listed[b], column)
        for a in range(count):
            matrix[a * count + b] = column[listed[a]]
    force = room_like(y, M)[:count]
    bends = room_like(y, M)
    # The second time, what rounding has left of the bend is taken away.
    for turn in range(2):
        BENDS(t, y, dy, mode, params, bends)
        for b in range(count):
            force[b] = -bends[listed[b]]
            if turn == 0:
                lock = mode[M + SURFACES[listed[b]]]
                shares[listed[b]] = -lock * bends[listed[b]]
        for e in range(count * count):
            again[e] = matrix[e]
        solve_small(again, force)
        for b in range(count):
            first = len(params) - OWN + listed[b] * N
            for i in range(N):
                dy[i] += force[b] * params[first + i]


def rest_template(
    t: float, y: Any, mode: Any, params: Any, j: int, direction: int
) -> int:
    """Bring guard j to rest, and return its flag, RESTING or STUCK.

    Its reaction acts along what its handler would do to the state.
    """
    own = mode[M : M + N_MODES].copy()
    numbers = params[: len(params) - OWN].copy()
    after = y.copy()
    own[SURFACES[j]] = direction
    HANDLER(t, after, own, numbers, SURFACES[j], direction)
    for i in range(len(y)):
        after[i] -= y[i]
    size = size_of(after)
    if not size > 0.0:
        return STUCK
    first = len(params) - OWN + j * len(y)
    for i in range(len(y)):
        params[first + i] = after[i] / size
    params[len(params) - M + j] = size_of(y)
    mode[M + N_MODES + j] = RESTING
    rates = np.empty(M)
    slopes = np.empty(M)
    APPROACH(t, y, mode, params, rates)
    ALONG(t, y, mode, params, j, slopes)
    if slopes[j] == 0.0:
        return STUCK
    for i in range(len(y)):
        y[i] -= rates[j] / slopes[j] * params[first + i]
    return RESTING


def no_approach(
    t: float,  # noqa: ARG001 (the arguments of `approach_template`)
    y: Any,  # noqa: ARG001
    mode: Any,  # noqa: ARG001
    params: Any,  # noqa: ARG001
    values: Any,
) -> None:
    """Fill `values` with zeros: no guard rests."""
    values[:] = 0.0


def no_rest(
    t: float,  # noqa: ARG001 (the arguments of `rest_template`)
    y: Any,  # noqa: ARG001
    mode: Any,  # noqa: ARG001
    params: Any,  # noqa: ARG001
    j: int,  # noqa: ARG001
    direction: int,  # noqa: ARG001
) -> int:
    """Return STUCK: the driver does not ask for rest."""
    return STUCK
