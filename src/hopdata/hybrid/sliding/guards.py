"""Guards by which sliding and rest end, and the user's guards beside them.

Their rates are exact, because the shares are evaluated for numbers that move. Where the
user's functions do not compile for these, they are differences. For ranges and duals,
which have the rates themselves, there are guards of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.hybrid.methods import tangent
from hopdata.hybrid.numbers.moving import as_item, moving, room_like, room_moving
from hopdata.hybrid.sliding.flags import RESTING, SLIDING
from hopdata.hybrid.sliding.mix import size_of

#: How far the share of a field leaves the interval [0, 1] before the guard lets go. The
#: state then errs by its square, and the rate away from the surface exceeds rounding.
#: Unit: 1. Origin: chosen.
BEYOND = 1e-10

#: Rounding of a share, below which its differences tell nothing.
#: Unit: 1. Origin: rounding: 256 units in the last place of a double.
NOISE = tangent.NOISE

#: Rounding of a difference quotient, relative to itself, where it is differentiated.
#: Unit: 1. Origin: chosen.
BLUR = 1e-9

MASK = 1.0  # value of a guard's function while it slides

SHIFTS = tangent.SHIFTS

FIRST_STEP = tangent.FIFTH_ROOT_OF_EPS

ATTEMPTS = tangent.ATTEMPTS

SHORTER = tangent.SHORTER

settle = tangent.settle

# Inserted into the templates (see `sliding.system`).
GUARDS: Any = None
MIX: Any = None
SHARES: Any = None
MOVED_SHARES: Any = None
RATE: Any = None
ENDS: Any = None
PART_OF_RESULTS: Any = None
SINK: Any = None
N = 0
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
SURFACES = (0,)


def shares_template(t: Any, y: Any, mode: Any, params: Any, values: Any) -> None:
    """Fill `values` with the functions of the guards by which sliding ends.

    They are negative inside the interval of the shares, and positive outside or where
    the fields do not point at the surface. That of a guard at rest is negative while
    the field presses on the surface.
    """
    shares = room_like(y, M)
    slopes = room_like(y, M)
    dy = room_like(y, N)
    MIX(t, y, mode, params, dy, shares, slopes)
    for j in range(M):
        flag = mode[M + N_MODES + j]
        if flag == RESTING:
            values[j] = -shares[j]
        elif flag != SLIDING:
            values[j] = -1.0
        elif slopes[j] < 0.0:
            values[j] = shares[j] * (shares[j] - 1.0) - BEYOND
        else:
            values[j] = 1.0


def rate_template(
    t: float, y: Any, dy: Any, mode: Any, params: Any, in_time: bool, hdot: Any
) -> None:
    """Add the rates of what SHARES fills, in time or for the motion `dy`.

    These are the guards that end sliding, or the rates of guards at rest.
    """
    speed = size_of(dy)
    size = size_of(y)
    if in_time:
        step = FIRST_STEP * (abs(t) if t != 0.0 else 1.0)
    elif speed > 0.0:
        step = FIRST_STEP * (size if size > 0.0 else 1.0) / speed
    else:
        return
    values = np.zeros((6, M))
    slopes = np.zeros((M, 1))
    beside = np.empty(len(y))
    for j in range(M):
        values[5, j] = NOISE
    for attempt in range(ATTEMPTS):
        for side in range(4):
            shift = SHIFTS[side] * step
            if in_time:
                SHARES(t + shift, y, mode, params, values[side])
            else:
                for i in range(len(y)):
                    beside[i] = y[i] + shift * dy[i]
                SHARES(t, beside, mode, params, values[side])
        for j in range(M):
            if mode[M + N_MODES + j] >= RESTING:
                values[5, j] = BLUR * abs(values[1, j])
        if settle(values, 0, attempt, step, slopes, 0, 0, M):
            break
        step *= SHORTER
    for j in range(M):
        hdot[j] += slopes[j, 0]


def ends_template(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, h: Any, hdot: Any
) -> None:
    """Fill `h` and `hdot` with the guards that end sliding, and their rates by `dy`.

    They are evaluated for numbers that move.
    """
    place = room_moving(y, N)
    values = room_moving(y, M)
    for i in range(N):
        place[i] = moving(y[i], dy[i])
    MOVED_SHARES(moving(as_item(t, y), 1.0), place, mode, params, values)
    for j in range(M):
        h[j] = values[j].value
        hdot[j] = values[j].rate


def ends_by_differences(
    t: float, y: Any, dy: Any, mode: Any, params: Any, h: Any, hdot: Any
) -> None:
    """Fill `h` and `hdot` with the guards that end sliding, and their rates by `dy`.

    The rate is that in time and that along dy: each has a step of its own, and where
    the shares do not depend on the state, the second is exactly zero.
    """
    SHARES(t, y, mode, params, h)
    for j in range(M):
        hdot[j] = 0.0
    RATE(t, y, dy, mode, params, True, hdot)
    RATE(t, y, dy, mode, params, False, hdot)


def ends_of_numbers(
    t: Any,
    y: Any,
    dy: Any,  # noqa: ARG001 (the arguments of `ends_template`)
    mode: Any,
    params: Any,
    h: Any,
    hdot: Any,  # noqa: ARG001
) -> None:
    """Fill `h` with the guards that end sliding, for numbers that have rates."""
    SHARES(t, y, mode, params, h)


def guards_template(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, h: Any, hdot: Any
) -> None:
    """Fill `h` and `hdot` with the guards that end sliding, and the user's."""
    numbers = params[: len(params) - OWN]
    GUARDS(t, y, dy, mode[M : M + N_MODES], numbers, h[M:], hdot[M:])
    held = 0
    for j in range(M):
        k = M + SURFACES[j]
        h[j] = -1.0
        hdot[j] = 0.0
        if mode[M + N_MODES + j] >= SLIDING:
            held += 1
            h[k] = mode[k] * MASK + 0.0 * h[k]  # NaN and infinity are still seen
            hdot[k] = 0.0
        else:
            h[k] -= params[len(params) - 2 * M + j]
    if held > 0:
        ENDS(t, y, dy, mode, params, h[:M], hdot[:M])


def guards_of_ranges(
    t: Any,
    y: Any,
    dy: Any,
    mode: Any,
    params: Any,
    h: Any,
    hdot: Any,  # noqa: ARG001 (ranges have the rates)
) -> None:
    """Fill `h` with the ranges of the guards that end sliding, and of the user's."""
    numbers = params[: len(params) - OWN]
    own = mode[M : M + N_MODES]
    users = PART_OF_RESULTS(h, M, M + N_GUARDS)
    GUARDS(t, y, dy, own, numbers, users, SINK(N_GUARDS, t.at))
    held = 0
    for j in range(M):
        k = M + SURFACES[j]
        h[j] = -1.0
        if mode[M + N_MODES + j] >= SLIDING:
            held += 1
            h[k] = mode[k] * MASK
        else:
            h[k] = h[k] - params[len(params) - 2 * M + j]
    if held == 0:
        return
    place = room_like(t, N)
    values = room_like(t, M)
    for i in range(N):
        place[i] = y[i]
    SHARES(t, place, mode, params, values)
    for j in range(M):
        h[j] = values[j]
