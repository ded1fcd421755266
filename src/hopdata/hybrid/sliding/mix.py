"""Filippov's mix of the fields on both sides of the surfaces.

The templates of this package become functions of one system: the user's functions, the
numbers of states, of guards that may slide, of all guards and of modes, the guards that
may slide, and other templates are inserted by their names in capitals (see
`sliding.system`). They are written for any kind of number: floats, duals, ranges, and
numbers of these kinds that move (`numbers.moving`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.numbers.moving import (
    as_item,
    moving,
    plain,
    room_like,
    room_moving,
)
from hopdata.hybrid.sliding.flags import SLIDING

#: Largest dependence of one lock's change of the field on another lock, relative to
#: the changes, up to which the mix counts as unique.
#: Unit: 1. Origin: rounding: some thousands of units in the last place.
ADDITIVE = 1e-12

#: Fastest pace at which the steps' rest of a guard fades.
#: Unit: 1 over the size of the time. Origin: derived: what the rounding of the time
#: leaves of a guard then changes the field by the root of the rounding, at most. The
#: size of the state is no measure where a corner is at zero.
FASTEST = 2.0**26

UNKNOWN = math.nan  # how the rates of the states change: no guard's value may need it

# Inserted into the templates (see `sliding.system`).
FIELD: Any = None
GUARDS: Any = None
CORNERS: Any = None
DIFFER: Any = None
MIX: Any = None
RATED: Any = None
N = 0
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
N_FIELDS = 0
N_RATES = 0
N_MATRIX = 0
SURFACES = (0,)


@kernel
def solve_small(matrix: Any, x: Any) -> None:
    """Solve matrix x = x in place, by elimination with pivots; NaN if singular.

    The rows of the matrix follow each other.
    """
    n = len(x)
    for i in range(n):
        pivot = i
        for j in range(i + 1, n):
            if abs(plain(matrix[j * n + i])) > abs(plain(matrix[pivot * n + i])):
                pivot = j
        for j in range(n):
            kept = matrix[i * n + j]
            matrix[i * n + j] = matrix[pivot * n + j]
            matrix[pivot * n + j] = kept
        kept = x[i]
        x[i] = x[pivot]
        x[pivot] = kept
        for j in range(i + 1, n):
            factor = matrix[j * n + i] / matrix[i * n + i]
            for c in range(i, n):
                matrix[j * n + c] -= factor * matrix[i * n + c]
            x[j] -= factor * x[i]
    for a in range(n):
        i = n - 1 - a
        for c in range(i + 1, n):
            x[i] -= matrix[i * n + c] * x[c]
        x[i] /= matrix[i * n + i]


@kernel
def size_of(values: Any) -> Any:
    """Return the sum of the sizes of some numbers."""
    total = abs(values[0])
    for i in range(1, len(values)):
        total += abs(values[i])
    return total


# Templates. Each becomes a function of one system.


def rated_template(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, h: Any, rates: Any
) -> None:
    """Fill `h` and `rates` with the guards, and their rates by a motion `dy`.

    The guards run on numbers that move.
    """
    place = room_moving(y, N)
    motion = room_moving(y, N)
    values = room_moving(y, N_GUARDS)
    given = room_moving(y, N_GUARDS)
    for i in range(N):
        place[i] = moving(y[i], dy[i])
        motion[i] = moving(dy[i], UNKNOWN)
    now = moving(as_item(t, y), 1.0)
    GUARDS(now, place, motion, mode, params, values, given)
    for k in range(N_GUARDS):
        h[k] = values[k].value
        rates[k] = values[k].rate


def corners_template(
    t: Any,
    y: Any,
    mode: Any,
    params: Any,
    which: Any,
    fields: Any,
    rates: Any,
    h: Any,
) -> None:
    """Fill `fields` and `rates` with those for each lock of the guards that slide.

    Row a belongs to the lock of guard ``which[a]`` at +1 and the others at -1, and the
    last row to all at -1; the rows follow each other. `h` receives the guards' values.
    """
    own = mode[M : M + N_MODES]
    numbers = params[: len(params) - OWN]
    count = len(which)
    locks = np.empty(count, dtype=np.int64)
    for a in range(count):
        locks[a] = own[SURFACES[which[a]]]
        own[SURFACES[which[a]]] = -1
    for a in range(count + 1):
        if a < count:
            own[SURFACES[which[a]]] = 1
        field = fields[a * N : (a + 1) * N]
        FIELD(t, y, own, numbers, field)
        RATED(t, y, field, own, numbers, h, rates[a * N_GUARDS : (a + 1) * N_GUARDS])
        if a < count:
            own[SURFACES[which[a]]] = -1
    for a in range(count):
        own[SURFACES[which[a]]] = locks[a]


@kernel
def add_mix(dy: Any, fields: Any, share: Any, factor: Any) -> None:
    """Add to `dy`, for each share, what its upper field changes, times a factor.

    It changes the lowest field, in which all locks are at -1.
    """
    count = len(share)
    n = len(dy)
    for a in range(count):
        for i in range(n):
            dy[i] += factor * share[a] * (fields[a * n + i] - fields[count * n + i])


def differs_template(
    t: Any, y: Any, mode: Any, params: Any, which: Any, fields: Any
) -> bool:
    """Return whether the changes of the field by several guards do not add up."""
    own = mode[M : M + N_MODES]
    count = len(which)
    locks = np.empty(count, dtype=np.int64)
    for a in range(count):
        locks[a] = own[SURFACES[which[a]]]
        own[SURFACES[which[a]]] = 1
    together = room_like(y, N)
    FIELD(t, y, own, params[: len(params) - OWN], together)
    for a in range(count):
        own[SURFACES[which[a]]] = locks[a]
    for i in range(N):
        lowest = fields[count * N + i]
        off = together[i] - lowest
        size = abs(together[i]) + abs(lowest)
        for a in range(count):
            off -= fields[a * N + i] - lowest
            size += abs(fields[a * N + i])
        if not abs(off) <= ADDITIVE * size:
            return True
    return False


def never_differs(
    t: Any,  # noqa: ARG001 (the arguments of `differs_template`)
    y: Any,  # noqa: ARG001
    mode: Any,  # noqa: ARG001
    params: Any,  # noqa: ARG001
    which: Any,  # noqa: ARG001
    fields: Any,  # noqa: ARG001
) -> bool:
    """Return False: the field itself, of floats, tells where the mix is not unique."""
    return False


def slide_template(
    t: Any, y: Any, mode: Any, params: Any, dy: Any, shares: Any, slopes: Any
) -> None:
    """Fill `dy` with the field, mixed for the guards that slide.

    `shares` receives the share of each guard's upper field, and `slopes` the difference
    of its rates by the upper and the lower field, which is negative where both point at
    the surface; 0.5 and -1 where a guard does not slide.
    """
    listed = np.empty(M, dtype=np.int64)
    count = 0
    for j in range(M):
        shares[j] = 0.5
        slopes[j] = -1.0
        if mode[M + N_MODES + j] == SLIDING:
            listed[count] = j
            count += 1
    if count == 0:
        FIELD(t, y, mode[M : M + N_MODES], params[: len(params) - OWN], dy)
        return
    which = listed[:count]
    h = room_like(y, N_GUARDS)
    rates = room_like(y, N_RATES)
    fields = room_like(y, N_FIELDS)
    CORNERS(t, y, mode, params, which, fields, rates, h)
    if count > 1 and DIFFER(t, y, mode, params, which, fields):
        for i in range(N):
            dy[i] = np.nan
        return
    matrix = room_like(y, N_MATRIX)[: count * count]
    again = room_like(y, N_MATRIX)[: count * count]
    share = room_like(y, M)[:count]
    back = room_like(y, M)[:count]
    scale = size_of(y)
    for a in range(count):
        k = SURFACES[which[a]]
        lowest = rates[count * N_GUARDS + k]
        for b in range(count):
            matrix[a * count + b] = rates[b * N_GUARDS + k] - lowest
            again[a * count + b] = matrix[a * count + b]
        slopes[which[a]] = matrix[a * count + a]
        share[a] = -lowest
        back[a] = -h[k]
        scale = max(scale, params[len(params) - M + which[a]])
    solve_small(matrix, share)
    for i in range(N):
        dy[i] = fields[count * N + i]
    add_mix(dy, fields, share, 1.0)
    for a in range(count):
        shares[which[a]] = share[a]
    # What the steps leave of h fades as fast as the motion changes the state.
    speed = size_of(dy)
    if speed > 0.0 and scale > 0.0 and size_of(back) > 0.0:
        solve_small(again, back)
        pace = speed / scale
        if plain(pace) * abs(plain(t)) > FASTEST:
            pace *= FASTEST / (plain(pace) * abs(plain(t)))
        add_mix(dy, fields, back, pace)


def field_template(t: Any, y: Any, mode: Any, params: Any, dy: Any) -> None:
    """Fill `dy` with the field of the derived system."""
    shares = room_like(y, M)
    slopes = room_like(y, M)
    MIX(t, y, mode, params, dy, shares, slopes)


def field_of_ranges(t: Any, y: Any, mode: Any, params: Any, dy: Any) -> None:
    """Fill `dy` with the field's ranges, of states that are given as ranges."""
    place = room_like(t, N)
    rates = room_like(t, N)
    shares = room_like(t, M)
    slopes = room_like(t, M)
    for i in range(N):
        place[i] = y[i]
    MIX(t, place, mode, params, rates, shares, slopes)
    for i in range(N):
        dy[i] = rates[i]
