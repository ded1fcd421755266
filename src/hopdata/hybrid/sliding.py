"""Sliding along guards (Filippov): the derived system whose field may be a mix.

Where the fields on both sides of a guard's surface point at it, a solution can neither
cross nor stay on one side: it slides along the surface, at the rate of that convex
combination of the two fields which keeps the guard at zero (Filippov 1988). The share
of the upper field is a = r- / (r- - r+), with the guard's rates r- > 0 and r+ < 0 by
the lower and the upper field. The solution slides as long as 0 < a < 1, and leaves to
the side whose field lets go: upward at a = 1, where r+ = 0, downward at a = 0.

The driver knows nothing of this. The derived system has one more guard for each guard
that may slide, which comes before the user's: it grows through zero where the share
leaves the interval. Its mode is longer: the locks of these guards, the user's mode, and
a flag for each guard that may slide. Its handler decides at each flip whether the guard
is crossed or the solution begins to slide; the user's handler is told by the direction.
While a guard slides, its own function is hidden from the driver, because it is zero but
for rounding, and the user's functions are called with its lock at -1 and at +1; only
the handler, and the reader of a solution, see a lock of 0.

With several guards that slide at once, the field is taken as a sum: the field with all
their locks at -1, and for each lock a change that does not depend on the others. Then
one mix keeps all guards at zero. If the changes do depend on each other, there is a
family of mixes (Filippov's set allows them all), and the run ends with a status.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import SIGNATURES, kernel, kernel_apart
from hopdata.hybrid.methods import tangent
from hopdata.hybrid.methods.method import put_in

# Directions in the log and for the handler, times the sign of the motion: +1 and -1
# cross the guard, +2 and -2 arrive from below and above and begin to slide, +3 and -3
# leave upward and downward.
SLIDES = 2
LEAVES = 3

# The handler brings the guard to rest, where its events pile up.
RESTS = 4

# Values of a flag: crossing as usual, sliding, resting, a mix that is not unique, and a
# guard that its handler does not turn back, which therefore cannot rest.
FREE = 0
SLIDING = 1
RESTING = 2
UNCLEAR = 3
STUCK = 4

#: How far the share of a field leaves the interval [0, 1] before the guard lets go. The
#: state then errs by its square, and the rate away from the surface exceeds rounding.
#: Unit: 1. Origin: chosen.
BEYOND = 1e-10

#: Largest value of a guard that is taken for zero where it begins to slide, as a share
#: of the terms of its rate when the state moves by its own size. A guard that flips
#: farther from its surface has jumped.
#: Unit: 1. Origin: chosen.
NEAR = 5e-3

#: The same as a share of the time since zero, times its rates.
#: Unit: 1. Origin: chosen.
NEAR_IN_TIME = 1e-6

#: Largest value of a guard that slides, where a handler has moved the state, at which
#: it still slides.
#: Unit: 1, of the terms of its rate. Origin: chosen.
KEPT = 1e-9

#: Largest dependence of one lock's change of the field on another lock, relative to
#: the changes, up to which the mix counts as unique.
#: Unit: 1. Origin: rounding: some thousands of units in the last place.
ADDITIVE = 1e-12

#: Rounding of a share, below which its differences tell nothing.
#: Unit: 1. Origin: rounding: 256 units in the last place of a double.
NOISE = tangent.NOISE

#: Rounding of a difference quotient, relative to itself, where it is differentiated.
#: Unit: 1. Origin: chosen.
BLUR = 1e-9

# Inserted into the templates below: the user's functions; the numbers of guards that
# may slide, of all guards, and of the user's modes; the guards that may slide.
FIELD: Any = None
GUARDS: Any = None
HANDLER: Any = None
CORNERS: Any = None
SLIDE: Any = None
APPROACH: Any = None
BENDS: Any = None
ALONG: Any = None
REST: Any = None
DIFFER: Any = None
MIX: Any = None
SHARES: Any = None
RATES: Any = None
BEGINS: Any = None
LOSES: Any = None
TERMS: Any = None
RATE: Any = None
LEAVE: Any = None
CALL: Any = None
RELEASE: Any = None
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
SURFACES = (0,)

MASK = 1.0  # value of a guard's function while it slides
SHIFTS = tangent.SHIFTS
FIRST_STEP = tangent.FIFTH_ROOT_OF_EPS
ATTEMPTS = tangent.ATTEMPTS
SHORTER = tangent.SHORTER
settle = tangent.settle


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


# Templates. Each becomes a function of one system.


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


def approach_template(t: float, y: Any, mode: Any, params: Any, values: Any) -> None:
    """Fill `values` with the rates of the guards that rest; zero for the others."""
    dy = np.empty(len(y))
    shares = np.empty(M)
    slopes = np.empty(M)
    SLIDE(t, y, mode, params, dy, shares, slopes)
    h = np.empty(N_GUARDS)
    hdot = np.empty(N_GUARDS)
    numbers = params[: len(params) - OWN]
    GUARDS(t, y, dy, mode[M : M + N_MODES], numbers, h, hdot)
    for j in range(M):
        values[j] = 0.0
        if mode[M + N_MODES + j] >= RESTING:
            values[j] = hdot[SURFACES[j]]


def along_template(
    t: float, y: Any, mode: Any, params: Any, j: int, values: Any
) -> None:
    """Fill `values` with the change of all resting guards' rates by reaction j."""
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
    t: float, y: Any, mode: Any, params: Any, dy: Any, shares: Any, slopes: Any
) -> None:
    """Fill `dy` with the field: mixed, and with the reactions of guards that rest.

    A reaction acts along the change of the state by the guard's handler. It keeps the
    guard's rate at zero. The guard's share is that reaction's cause, the bend of the
    guard without it, which is positive while the field presses on the surface.
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
    matrix = np.empty((count, count))
    column = np.empty(M)
    for b in range(count):
        ALONG(t, y, mode, params, listed[b], column)
        for a in range(count):
            matrix[a, b] = column[listed[a]]
    force = np.empty(count)
    bends = np.empty(M)
    # The second time, what rounding has left of the bend is taken away.
    for turn in range(2):
        bends[:] = 0.0
        BENDS(t, y, dy, mode, params, True, bends)
        BENDS(t, y, dy, mode, params, False, bends)
        for b in range(count):
            force[b] = -bends[listed[b]]
            if turn == 0:
                lock = mode[M + SURFACES[listed[b]]]
                shares[listed[b]] = -lock * bends[listed[b]]
        solve_small(matrix.copy(), force)
        for b in range(count):
            first = len(params) - OWN + listed[b] * len(y)
            for i in range(len(y)):
                dy[i] += force[b] * params[first + i]


def field_template(t: float, y: Any, mode: Any, params: Any, dy: Any) -> None:
    """Fill `dy` with the field of the derived system."""
    shares = np.empty(M)
    slopes = np.empty(M)
    MIX(t, y, mode, params, dy, shares, slopes)


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


def rates_template(
    t: float, y: Any, mode: Any, params: Any, j: int, rates: Any
) -> float:
    """Fill `rates` with a guard's rates by the lower and the upper field.

    Other guards that slide go on sliding. Returns the guard's value.
    """
    own = mode[M : M + N_MODES]
    numbers = params[: len(params) - OWN]
    k = SURFACES[j]
    lock = own[k]
    flag = mode[M + N_MODES + j]
    mode[M + N_MODES + j] = FREE
    dy = np.empty(len(y))
    h = np.empty(N_GUARDS)
    hdot = np.empty(N_GUARDS)
    shares = np.empty(M)
    slopes = np.empty(M)
    for side in range(2):
        own[k] = 2 * side - 1
        MIX(t, y, mode, params, dy, shares, slopes)
        GUARDS(t, y, dy, own, numbers, h, hdot)
        rates[side] = hdot[k]
    own[k] = lock
    mode[M + N_MODES + j] = flag
    return h[k]


def depends_template(t: float, y: Any, mode: Any, params: Any, j: int) -> bool:
    """Return whether guard j changes the field otherwise for a guard that slides."""
    own = mode[M : M + N_MODES]
    numbers = params[: len(params) - OWN]
    k = SURFACES[j]
    lock = own[k]
    fields = np.empty((4, len(y)))
    depends = False
    for other in range(M):
        if other == j or mode[M + N_MODES + other] != SLIDING:
            continue
        its_lock = own[SURFACES[other]]
        for corner in range(4):
            own[k] = 2 * (corner % 2) - 1
            own[SURFACES[other]] = 2 * (corner // 2) - 1
            FIELD(t, y, own, numbers, fields[corner])
        own[SURFACES[other]] = its_lock
        for i in range(len(y)):
            mixed = fields[3, i] - fields[2, i] - fields[1, i] + fields[0, i]
            size = 0.0
            for corner in range(4):
                size += abs(fields[corner, i])
            depends = depends or not abs(mixed) <= ADDITIVE * size
    own[k] = lock
    return depends


def terms_template(t: float, y: Any, mode: Any, params: Any, j: int) -> float:
    """Return the size of the terms of a guard's rate if y changes by its own size."""
    own = mode[M : M + N_MODES]
    numbers = params[: len(params) - OWN]
    k = SURFACES[j]
    values = np.empty(N_GUARDS)
    still = np.empty(N_GUARDS)
    moving = np.empty(N_GUARDS)
    motion = np.zeros(len(y))
    GUARDS(t, y, motion, own, numbers, values, still)
    terms = 0.0
    for i in range(len(y)):
        motion[i] = y[i]
        GUARDS(t, y, motion, own, numbers, values, moving)
        terms += abs(moving[k] - still[k])
        motion[i] = 0.0
    return terms


def begins_template(t: float, y: Any, mode: Any, params: Any, j: int) -> int:
    """Return the flag of guard j, which has flipped: FREE, SLIDING or UNCLEAR."""
    rates = np.empty(2)
    h = RATES(t, y, mode, params, j, rates)
    if not (rates[0] > 0.0 and rates[1] < 0.0):
        return FREE
    terms = TERMS(t, y, mode, params, j)
    most = NEAR * terms + NEAR_IN_TIME * abs(t) * (rates[0] - rates[1])
    if abs(h) > most:
        return FREE
    if LOSES(t, y, mode, params, j):
        return UNCLEAR
    return SLIDING


def no_handler(
    t: float,  # noqa: ARG001 (the handler's arguments)
    y: Any,  # noqa: ARG001
    mode: Any,  # noqa: ARG001
    params: Any,  # noqa: ARG001
    guard: int,  # noqa: ARG001
    direction: int,  # noqa: ARG001
) -> int:
    """Do nothing at an event: the handler of a system that has none."""
    return 0


def leave_template(t: float, y: Any, mode: Any, params: Any, j: int) -> int:
    """Let guard j go, and return the direction that the handler is told."""
    rates = np.empty(2)
    # Its function is counted from here on, so that what the steps have left of it is
    # not taken for a crossing.
    params[len(params) - 2 * M + j] = RATES(t, y, mode, params, j, rates)
    way = -1
    if rates[0] + rates[1] > 0.0:
        way = 1
    if mode[M + N_MODES + j] == RESTING:
        # It stays on its side, and its rate there is zero but for rounding.
        way = mode[M + SURFACES[j]]
        off = NOISE * TERMS(t, y, mode, params, j)
        params[len(params) - 2 * M + j] -= way * off
    mode[j] = -1  # it waits again
    mode[M + N_MODES + j] = FREE
    mode[M + SURFACES[j]] = way
    return LEAVES * way


def call_template(
    t: float, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Call the user's handler, which sees a lock of 0 where a guard slides.

    Where it sets such a lock, the guard does not slide any longer.
    """
    own = mode[M : M + N_MODES]
    flags = mode[M + N_MODES :]
    locks = np.empty(M, dtype=np.int64)
    for j in range(M):
        locks[j] = own[SURFACES[j]]
        if flags[j] >= SLIDING:
            own[SURFACES[j]] = 0
    stop = HANDLER(t, y, own, params[: len(params) - OWN], guard, direction)
    for j in range(M):
        if flags[j] >= SLIDING and own[SURFACES[j]] == 0:
            own[SURFACES[j]] = locks[j]
        elif flags[j] >= SLIDING:
            flags[j] = FREE
            params[len(params) - 2 * M + j] = 0.0
    return stop


def release_template(t: float, y: Any, mode: Any, params: Any, before: Any) -> None:
    """Let the guards go whose surface the handler has taken the state off."""
    moved = False
    for i in range(len(y)):
        moved = moved or y[i] != before[i]
    if not moved:
        return
    rates = np.empty(2)
    now_moving = np.empty(M)
    was_moving = np.empty(M)
    APPROACH(t, y, mode, params, now_moving)
    APPROACH(t, before, mode, params, was_moving)
    for j in range(M):
        rests = mode[M + N_MODES + j] == RESTING
        if rests and abs(now_moving[j]) > abs(was_moving[j]):
            mode[M + N_MODES + j] = FREE
        if mode[M + N_MODES + j] == FREE:
            params[len(params) - 2 * M + j] = 0.0
        if mode[M + N_MODES + j] != SLIDING:
            continue
        now = RATES(t, y, mode, params, j, rates)
        was = RATES(t, before, mode, params, j, rates)
        terms = TERMS(t, y, mode, params, j)
        if abs(now) > abs(was) + KEPT * terms:
            mode[M + N_MODES + j] = FREE
            params[len(params) - 2 * M + j] = 0.0
            mode[M + SURFACES[j]] = 1 if now > 0.0 else -1


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


def handler_template(
    t: float, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Begin to slide, leave, or cross; then call the user's handler."""
    flags = mode[M + N_MODES :]
    told = direction
    k = guard - M
    if guard < M:
        k = SURFACES[guard]
        told = LEAVE(t, y, mode, params, guard)
    for j in range(M):
        if SURFACES[j] != k or guard < M:
            continue
        if abs(direction) == RESTS:
            flags[j] = REST(t, y, mode, params, j, direction // RESTS)
            if flags[j] == STUCK:
                return 1
            continue
        flags[j] = BEGINS(t, y, mode, params, j)
        if flags[j] == UNCLEAR:
            return 1
        if flags[j] == SLIDING:
            params[len(params) - M + j] = size_of(y)
            told = SLIDES * direction
    before = y.copy()
    stop = CALL(t, y, mode, params, k, told)
    RELEASE(t, y, mode, params, before)
    return stop


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


# What takes the place of a template where no guard may rest; None: nothing.
WITHOUT_REST: dict[str, Any] = {
    "APPROACH": no_approach,
    "ALONG": None,
    "BENDS": None,
    "MIX": None,
    "REST": no_rest,
}

# Each may call those before it.
TEMPLATES = {
    "CORNERS": corners_template,
    "DIFFER": differs_template,
    "SLIDE": mix,
    "APPROACH": approach_template,
    "ALONG": along_template,
    "BENDS": rate_template,
    "MIX": mix_template,
    "SHARES": shares_template,
    "RATE": rate_template,
    "RATES": rates_template,
    "LOSES": depends_template,
    "TERMS": terms_template,
    "BEGINS": begins_template,
    "LEAVE": leave_template,
    "CALL": call_template,
    "RELEASE": release_template,
    "REST": rest_template,
}


class Mixed(Callback):
    """A function of the derived system, made from a template.

    Parameters
    ----------
    kind : str
        Kind of function, a key of `SIGNATURES`.
    template : callable
        The template.
    inner : Callback
        The user's function of this kind; the field where there is none.
    users : tuple of Callback
        All of the user's functions that it calls.
    **names : object
        What is inserted into the templates.
    """

    no_dual = "duals do not follow the mix of fields of a guard that slides"

    def __init__(
        self,
        kind: str,
        template: Callable[..., Any],
        inner: Callback,
        users: tuple[Callback, ...],
        **names: Any,
    ) -> None:
        super().__init__(with_digest(template, **names), SIGNATURES[kind])
        self.inner = inner
        self._users = users
        # Otherwise the code contains the address of a Python function.
        self.kept = self.compiled

    @cached_property
    def dispatcher(self) -> Any:
        """The function, callable from other code in Numba."""
        return put_in(self.function)

    @cached_property
    def ranged(self) -> Any:
        """Nothing: ranges know of no mix, so guards that may slide are sampled."""
        raise TypeError("ranges do not follow the mix of fields of a guard that slides")

    @cached_property
    def constants(self) -> Constants:
        """Nothing of its own: the user's system looks at the user's functions."""
        return Constants()

    @property
    def compiled(self) -> bool:
        """Whether the user's functions are compiled."""
        return all(one.compiled for one in self._users)

    @property
    def n_params(self) -> int:  # type: ignore[override]
        """Smallest number of parameters that the user's functions require."""
        return max(one.n_params for one in self._users)

    def check_lengths(self, **lengths: int) -> None:
        """Check nothing: the user's system has checked the user's functions."""


@dataclass(frozen=True)
class Slides:
    """How the records of a derived system show what the user knows.

    Parameters
    ----------
    surfaces : tuple of int
        The user's guards that may slide.
    n_guards, n_modes : int
        Numbers of the user's guards, and of integers in the user's mode.
    """

    surfaces: tuple[int, ...]
    n_guards: int
    n_modes: int

    @property
    def count(self) -> int:
        """Number of guards that may slide."""
        return len(self.surfaces)

    def guards(self, found: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the user's guards, of the derived system's; -1 stays."""
        known = np.array((*self.surfaces, *range(self.n_guards), -1))
        return known[found]

    def modes(self, found: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the user's modes (..., m), with a lock of 0 where a guard slides."""
        own = found[..., self.count : self.count + self.n_modes].copy()
        flags = found[..., self.count + self.n_modes :]
        for j, k in enumerate(self.surfaces):
            held = np.isin(flags[..., j], (SLIDING, RESTING))
            own[..., k] = np.where(held, 0, own[..., k])
        return own

    def directions(
        self,
        guard: NDArray[np.int64],
        direction: NDArray[np.int64],
        modes: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the directions that tell what has happened, of the driver's."""
        told = direction.copy()
        flags = modes[:, self.count + self.n_modes :]
        for j, k in enumerate(self.surfaces):
            begun = (guard == self.count + k) & (flags[:, j] == SLIDING)
            told[begun] *= SLIDES
            rests = (guard == self.count + k) & (flags[:, j] == RESTING)
            told[rests] *= RESTS
            left = guard == j
            told[left] = LEAVES * modes[left, self.count + k]
        return told

    def status(
        self, status: NDArray[np.int64], modes: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the statuses, of the driver's and the final modes (..., m)."""
        flags = modes[..., self.count + self.n_modes :]
        told = np.where((flags == UNCLEAR).any(axis=-1), at.NOT_UNIQUE, status)
        return np.where((flags == STUCK).any(axis=-1), at.ZENO, told)

    def start_mode(self, mode: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the derived system's mode at the start, of the user's."""
        free = np.zeros(self.count, dtype=np.int64)
        return np.concatenate([free - 1, mode, free])


def insert_templates(names: dict[str, Any], *, rests: bool) -> None:
    """Add the functions made from the templates to the names.

    Without rest, its parts are left out, which halves the time of compilation.
    """
    for name, template in TEMPLATES.items():
        known = names
        if name == "BENDS":  # the rates of what APPROACH gives
            known = {**names, "SHARES": names["APPROACH"]}
        made = template
        if not rests:
            made = WITHOUT_REST.get(name, template)
        if made is not None:
            names[name] = kernel_apart(with_digest(made, **known))
        elif name == "MIX":
            names[name] = names["SLIDE"]


def sliding_system(system: Any) -> Any:
    """Return the derived system that slides along the guards declared for it."""
    if "sliding" in system.made:
        return system.made["sliding"]
    surfaces = tuple(system.guard_names.index(one) for one in system.sliding)
    count = len(surfaces)
    slides = Slides(surfaces, system.n_guards, system.n_modes)
    n_memory = 2 * count
    if system.on_zeno == "rest":
        n_memory += count * system.n_states
    names: dict[str, Any] = {
        "M": count,
        "OWN": n_memory,
        "N_GUARDS": system.n_guards,
        "N_MODES": system.n_modes,
        "SURFACES": surfaces,
        "FIELD": system.field.dispatcher,
        "GUARDS": system.guards.dispatcher,
    }
    users: tuple[Callback, ...] = (system.field, system.guards)
    inner = system.field
    names["HANDLER"] = put_in(no_handler)
    if system.on_event is not None:
        names["HANDLER"] = system.on_event.dispatcher
        inner = system.on_event
        users = (*users, inner)
    insert_templates(names, rests=system.on_zeno == "rest")
    field = Mixed("field", field_template, system.field, users, **names)
    guards = Mixed("guards", guards_template, system.guards, users, **names)
    handler = Mixed("on_event", handler_template, inner, users, **names)
    none = (0,) * system.n_guards
    ending = [f"{one} lets go" for one in system.sliding]
    made = replace(
        system,
        field=field,
        guards=guards,
        on_event=handler,
        undo=None,
        jacobian=None,
        affine=None,
        sparsity=None,
        guard_names=(*ending, *system.guard_names),
        directions=(*((1,) * count), *(system.directions or none)),
        terminal=(*((0,) * count), *(system.terminal or none)),
        n_extra_modes=system.n_extra_modes + count,
        n_memory=system.n_memory + n_memory,
        sliding=(),
        on_zeno="stop",
    )
    vars(made).update(way=system.way, n_shown=system.n_shown, slides=slides)
    if system.on_zeno == "rest":
        vars(made)["rests"] = tuple(count + k for k in surfaces)
    system.made["sliding"] = made
    return made
