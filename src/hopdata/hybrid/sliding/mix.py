"""Filippov's mix of the fields on both sides of the surfaces.

The templates of this room become functions of one system: the user's functions, the
numbers of guards that may slide, of all guards and of modes, the guards that may slide,
and other templates are inserted by their names in capitals (see `sliding.system`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.sliding.flags import SLIDING

#: Largest dependence of one lock's change of the field on another lock, relative to
#: the changes, up to which the mix counts as unique.
#: Unit: 1. Origin: rounding: some thousands of units in the last place.
ADDITIVE = 1e-12

# Inserted into the templates (see `sliding.system`).
FIELD: Any = None
GUARDS: Any = None
CORNERS: Any = None
DIFFER: Any = None
MIX: Any = None
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
SURFACES = (0,)


@kernel
def solve_small(matrix: Any, x: Any) -> None:
    """Solve matrix x = x in place, by elimination with pivots; NaN if singular."""
    n = len(x)
    for i in range(n):
        pivot = i
        for j in range(i + 1, n):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        for j in range(n):
            kept = matrix[i, j]
            matrix[i, j] = matrix[pivot, j]
            matrix[pivot, j] = kept
        kept = x[i]
        x[i] = x[pivot]
        x[pivot] = kept
        for j in range(i + 1, n):
            factor = matrix[j, i] / matrix[i, i]
            for c in range(i, n):
                matrix[j, c] -= factor * matrix[i, c]
            x[j] -= factor * x[i]
    for a in range(n):
        i = n - 1 - a
        for c in range(i + 1, n):
            x[i] -= matrix[i, c] * x[c]
        x[i] /= matrix[i, i]


@kernel
def size_of(values: Any) -> float:
    """Return the sum of the sizes of some numbers."""
    total = 0.0
    for i in range(len(values)):
        total += abs(values[i])
    return total


def corners_template(
    t: float,
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
    last row to all at -1. `h` receives the guards' values.
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
        FIELD(t, y, own, numbers, fields[a])
        GUARDS(t, y, fields[a], own, numbers, h, rates[a])
        if a < count:
            own[SURFACES[which[a]]] = -1
    for a in range(count):
        own[SURFACES[which[a]]] = locks[a]


@kernel
def add_mix(dy: Any, fields: Any, share: Any, factor: float) -> None:
    """Add the shares of the upper fields' changes of the lowest, times a factor."""
    count = len(share)
    for a in range(count):
        for i in range(len(dy)):
            dy[i] += factor * share[a] * (fields[a, i] - fields[count, i])


def differs_template(
    t: float, y: Any, mode: Any, params: Any, which: Any, fields: Any
) -> bool:
    """Return whether the changes of the field by several guards do not add up."""
    own = mode[M : M + N_MODES]
    count = len(which)
    locks = np.empty(count, dtype=np.int64)
    for a in range(count):
        locks[a] = own[SURFACES[which[a]]]
        own[SURFACES[which[a]]] = 1
    together = np.empty(len(y))
    FIELD(t, y, own, params[: len(params) - OWN], together)
    for a in range(count):
        own[SURFACES[which[a]]] = locks[a]
    for i in range(len(y)):
        off = together[i] - fields[count, i]
        size = abs(together[i]) + abs(fields[count, i])
        for a in range(count):
            off -= fields[a, i] - fields[count, i]
            size += abs(fields[a, i])
        if not abs(off) <= ADDITIVE * size:
            return True
    return False


def mix(
    t: float, y: Any, mode: Any, params: Any, dy: Any, shares: Any, slopes: Any
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
    h = np.empty(N_GUARDS)
    rates = np.empty((count + 1, N_GUARDS))
    fields = np.empty((count + 1, len(y)))
    CORNERS(t, y, mode, params, which, fields, rates, h)
    if count > 1 and DIFFER(t, y, mode, params, which, fields):
        dy[:] = np.nan
        return
    matrix = np.empty((count, count))
    share = np.empty(count)
    back = np.empty(count)
    scale = size_of(y)
    for a in range(count):
        k = SURFACES[which[a]]
        for b in range(count):
            matrix[a, b] = rates[b, k] - rates[count, k]
        slopes[which[a]] = matrix[a, a]
        share[a] = -rates[count, k]
        back[a] = -h[k]
        scale = max(scale, params[len(params) - M + which[a]])
    again = matrix.copy()
    solve_small(matrix, share)
    for i in range(len(y)):
        dy[i] = fields[count, i]
    add_mix(dy, fields, share, 1.0)
    for a in range(count):
        shares[which[a]] = share[a]
    # What the steps leave of h fades as fast as the motion changes the state.
    speed = size_of(dy)
    if speed > 0.0 and scale > 0.0 and size_of(back) > 0.0:
        solve_small(again, back)
        add_mix(dy, fields, back, speed / scale)


def field_template(t: float, y: Any, mode: Any, params: Any, dy: Any) -> None:
    """Fill `dy` with the field of the derived system."""
    shares = np.empty(M)
    slopes = np.empty(M)
    MIX(t, y, mode, params, dy, shares, slopes)
