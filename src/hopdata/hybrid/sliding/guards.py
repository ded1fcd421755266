"""Guards by which sliding and rest end, and the user's guards beside them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.hybrid.methods import tangent
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
RATE: Any = None
M = 0
OWN = 0
N_MODES = 0
SURFACES = (0,)


def shares_template(t: float, y: Any, mode: Any, params: Any, values: Any) -> None:
    """Fill `values` with the functions of the guards by which sliding ends.

    They are negative inside the interval of the shares, and positive outside or where
    the fields do not point at the surface.
    """
    shares = np.empty(M)
    slopes = np.empty(M)
    dy = np.empty(len(y))
    MIX(t, y, mode, params, dy, shares, slopes)
    for j in range(M):
        if slopes[j] < 0.0:
            values[j] = shares[j] * (shares[j] - 1.0) - BEYOND
        else:
            values[j] = 1.0
        if mode[M + N_MODES + j] == RESTING:
            values[j] = -shares[j]
        elif mode[M + N_MODES + j] != SLIDING:
            values[j] = -1.0


def rate_template(
    t: float, y: Any, dy: Any, mode: Any, params: Any, in_time: bool, hdot: Any
) -> None:
    """Add the rates of the guards that end sliding, in time or for the motion `dy`."""
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


def guards_template(
    t: float, y: Any, dy: Any, mode: Any, params: Any, h: Any, hdot: Any
) -> None:
    """Fill `h` and `hdot` with the guards that end sliding, and the user's."""
    numbers = params[: len(params) - OWN]
    GUARDS(t, y, dy, mode[M : M + N_MODES], numbers, h[M:], hdot[M:])
    sliding = 0
    for j in range(M):
        k = M + SURFACES[j]
        h[j] = -1.0
        hdot[j] = 0.0
        if mode[M + N_MODES + j] >= SLIDING:
            sliding += 1
            h[k] = mode[k] * MASK
            hdot[k] = 0.0
        else:
            h[k] -= params[len(params) - 2 * M + j]
    if sliding == 0:
        return
    SHARES(t, y, mode, params, h[:M])
    # The rate is that in time and that along dy: each has a step of its own, and where
    # the shares do not depend on the state, the second is exactly zero.
    RATE(t, y, dy, mode, params, True, hdot)
    RATE(t, y, dy, mode, params, False, hdot)
