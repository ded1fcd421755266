"""What happens at a flip: a guard is crossed, begins to slide, or lets go."""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.numbers.moving import plain
from hopdata.hybrid.sliding.flags import (
    FREE,
    LEAVES,
    RESTING,
    RESTS,
    SLIDES,
    SLIDING,
    STUCK,
    UNCLEAR,
)
from hopdata.hybrid.sliding.guards import NOISE
from hopdata.hybrid.sliding.mix import ADDITIVE, size_of

#: Largest value of a guard that is taken for zero where it begins to slide, as a share
#: of the terms of its rate when the state moves by its own size. A guard that flips
#: farther from its surface has jumped.
#: Unit: 1. Origin: chosen.
NEAR = 5e-3

#: The same for time: a share of its size, times the difference of the guard's rates by
#: the two fields.
#: Unit: 1. Origin: chosen.
NEAR_IN_TIME = 1e-6

#: Largest value of a guard that slides, where a handler has moved the state, at which
#: it still slides.
#: Unit: 1, of the terms of its rate. Origin: chosen.
KEPT = 1e-9

# Inserted into the templates (see `sliding.system`).
FIELD: Any = None
GUARDS: Any = None
HANDLER: Any = None
APPROACH: Any = None
MIX: Any = None
RATES: Any = None
BEGINS: Any = None
LOSES: Any = None
TERMS: Any = None
LEAVE: Any = None
CALL: Any = None
RELEASE: Any = None
DECIDE: Any = None
LAW: Any = None
TIES: Any = None
REST: Any = None
M = 0
OWN = 0
N_GUARDS = 0
N_MODES = 0
SURFACES = (0,)


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
    """Return whether what guard j changes in the field depends on one that slides."""
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
    left = RATES(t, y, mode, params, j, rates)
    way = -1
    if rates[0] + rates[1] > 0.0:
        way = 1
    if mode[M + N_MODES + j] == RESTING:
        way = mode[M + SURFACES[j]]
    # Its function is counted from here on, so that what the steps have left of it is
    # not taken for a crossing. Its rate is zero here but for rounding: a little more
    # than rounding keeps it on its side.
    off = NOISE * TERMS(t, y, mode, params, j)
    params[len(params) - 2 * M + j] = left - way * off
    mode[j] = -1  # it waits again
    mode[M + N_MODES + j] = FREE
    mode[M + SURFACES[j]] = way
    return LEAVES * way


def call_template(
    t: Any, y: Any, mode: Any, params: Any, guard: int, direction: int
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
            # The state has moved: what the steps had left of the function is gone.
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


def decide_template(
    t: float, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Begin to slide or rest, leave, or cross.

    Returns the direction that the handler is told; 0 if the run ends here.
    """
    flags = mode[M + N_MODES :]
    if guard < M:
        return LEAVE(t, y, mode, params, guard)
    told = direction
    for j in range(M):
        if SURFACES[j] != guard - M:
            continue
        if abs(direction) == RESTS:
            flags[j] = REST(t, y, mode, params, j, direction // RESTS)
            if flags[j] == STUCK:
                return 0
            continue
        flags[j] = BEGINS(t, y, mode, params, j)
        if flags[j] == UNCLEAR:
            return 0
        if flags[j] == SLIDING:
            params[len(params) - M + j] = size_of(y)
            told = SLIDES * direction
    return told


def ties_template(t: float, y: Any, mode: Any, params: Any) -> int:
    """Let the law decide, where several guards are due at once.

    The directions of their flips are behind the flags. The law is told what a handler
    would be: which guards begin to slide, and which have let go.
    """
    flags = mode[M + N_MODES :]
    given = mode[M + N_MODES + M :]
    due = np.empty(N_GUARDS, dtype=np.int64)
    for k in range(N_GUARDS):
        due[k] = given[M + k]
    for guard in range(M):
        if given[guard] != 0:
            due[SURFACES[guard]] = LEAVE(t, y, mode, params, guard)
    for j in range(M):
        k = SURFACES[j]
        if given[M + k] == 0:
            continue
        flags[j] = BEGINS(t, y, mode, params, j)
        if flags[j] == UNCLEAR:
            return 1
        if flags[j] == SLIDING:
            params[len(params) - M + j] = size_of(y)
            due[k] = SLIDES * given[M + k]
    before = y.copy()
    own = mode[M : M + N_MODES]
    stop = LAW(t, y, own, params[: len(params) - OWN], due)
    RELEASE(t, y, mode, params, before)
    return stop


def no_ties(
    t: float,  # noqa: ARG001 (the arguments of `ties_template`)
    y: Any,  # noqa: ARG001
    mode: Any,  # noqa: ARG001
    params: Any,  # noqa: ARG001
) -> int:
    """Do nothing: without a law the driver does not ask."""
    return 0


def handler_template(
    t: float, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Begin to slide or rest, leave, or cross; then call the user's handler.

    Guard -1 stands for all that are due at once, about which a law decides.
    """
    if guard < 0:
        return TIES(t, y, mode, params)
    told = DECIDE(t, y, mode, params, guard, direction)
    if told == 0:
        return 1
    k = guard - M
    if guard < M:
        k = SURFACES[guard]
    before = y.copy()
    stop = CALL(t, y, mode, params, k, told)
    RELEASE(t, y, mode, params, before)
    return stop


@kernel
def room_of_floats(count: int) -> Any:
    """Return an array of floats, also where the function that calls this has duals.

    There, ``np.empty`` itself makes an array of duals (`numbers.new_arrays`).
    """
    return np.empty(count)


def handler_of_duals(
    t: Any, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Do what the handler does, with duals: their values decide.

    A guard does not come to rest here: there is no derivative through the limit.
    """
    now = plain(t)
    before = room_of_floats(len(y))
    numbers = room_of_floats(len(params))
    for i in range(len(y)):
        before[i] = plain(y[i])
    for i in range(len(params)):
        numbers[i] = plain(params[i])
    told = DECIDE(now, before, mode, numbers, guard, direction)
    if told == 0:
        return 1
    first = len(params) - OWN
    for i in range(first, len(params)):
        params[i] = numbers[i]
    k = guard - M
    if guard < M:
        k = SURFACES[guard]
    stop = CALL(t, y, mode, params, k, told)
    after = room_of_floats(len(y))
    for i in range(len(y)):
        after[i] = plain(y[i])
    for i in range(len(params)):
        numbers[i] = plain(params[i])
    RELEASE(now, after, mode, numbers, before)
    for i in range(first, len(params)):
        params[i] = numbers[i]
    return stop
