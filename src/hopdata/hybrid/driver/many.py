"""Many integrations in a row, without Python in between."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from numba import types

from hopdata.hybrid.compiled.views import (
    address_of,
    float_table,
    float_vector,
    int_vector,
    view,
)
from hopdata.hybrid.driver.entry import call_run, compiled_entry
from hopdata.hybrid.driver.layout import (
    CLOCK,
    COUNTS,
    EACH_STEP,
    EVENT_ROWS,
    FIRST_STEP,
    GIVEN_MODE,
    MAX_EVENTS,
    MAX_STEP,
    MAX_STEPS,
    MODE,
    PARAMS,
    RATE_ABOVE,
    RATE_BELOW,
    RESUMED,
    RTOL,
    RUN,
    SAMPLE_TABLE,
    START_STATE,
    STATE_TABLE,
    T_END,
    T_START,
    TANGENT_TABLE,
    WANTED,
    FloatArray,
    IntArray,
    T,
    Y,
)
from hopdata.hybrid.status import NEEDS_METHOD, NEEDS_ROOM, PAUSED

_INT, _FLOAT = types.int64, types.float64
_INTS, _FLOATS = types.int64[:, ::1], types.float64[:, ::1]
BYTES = 8
END_STATE = 3  # column of `ends` where the state begins, behind time and the culprit's rates

MANY_NATIVE = _INT(
    types.int64[::1], _INT, _INT, _FLOATS, _FLOATS, _INTS,
    _INTS, _FLOATS, _INTS, _INTS, types.float64[:, :, ::1], types.float64[:, :, ::1],
    _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _INT, _INT,
)  # fmt: skip


def _enter_many(
    desk: IntArray, first: int, last: int, y0: FloatArray, params: FloatArray, modes: IntArray,
    status: IntArray, ends: FloatArray, end_modes: IntArray,
    counts: IntArray, samples: FloatArray, jacobians: FloatArray,
    t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int,
) -> int:  # fmt: skip
    """Integrate from the rows `first` to `last` of y0; return the row that could not be done.

    Rows of `params` and `modes` are taken in turn or, if there is one, again and again. `ends`
    receives time, rates and state, `counts` the driver's counters, `samples` and `jacobians`, if
    they have any room, the states at the wanted times and the flow's Jacobians.
    """
    n, n_modes, n_params = y0.shape[1], modes.shape[1], params.shape[1]
    mode, clock = int_vector(desk[MODE], n_modes), float_vector(desk[CLOCK], 0)
    count, state = int_vector(desk[COUNTS], 0), float_table(desk[STATE_TABLE], n)
    start = float_vector(desk[START_STATE], n)
    phi, n_wanted = float_table(desk[TANGENT_TABLE], n), desk[WANTED + 1]
    here, own = address_of(view(desk)), float_vector(desk[PARAMS], n_params)
    numbers = float_vector(here, len(desk))
    numbers[T_START], numbers[T_END], numbers[RTOL] = t_start, t_end, rtol
    numbers[MAX_STEP], numbers[FIRST_STEP] = max_step, step
    desk[MAX_STEPS], desk[MAX_EVENTS], desk[EACH_STEP] = max_steps, max_events, 0
    for b in range(first, last):
        for i in range(n_params):
            own[i] = params[b % len(params), i]
        for i in range(n_modes):
            mode[i] = modes[b % len(modes), i]
        if n_wanted > 0:
            desk[SAMPLE_TABLE] = address_of(view(samples)) + b * n_wanted * n * BYTES
        for i in range(n if len(jacobians) > 0 else 0):
            for j in range(n):
                phi[i, j] = 1.0 if i == j else 0.0
        for i in range(n):
            start[i] = y0[b, i]
        code = call_run(desk[RUN], here, GIVEN_MODE)
        while code in (NEEDS_ROOM, PAUSED):
            count[EVENT_ROWS] = 0 if code == NEEDS_ROOM else count[EVENT_ROWS]
            code = call_run(desk[RUN], here, RESUMED)
        if code == NEEDS_METHOD:
            return b
        status[b, 0], ends[b, 0] = code, clock[T]
        ends[b, 1], ends[b, 2] = clock[RATE_BELOW], clock[RATE_ABOVE]
        for i in range(n):
            ends[b, END_STATE + i] = state[Y, i]
        for i in range(n_modes):
            end_modes[b, i] = mode[i]
        for i in range(counts.shape[1]):
            counts[b, i] = count[i]
        for i in range(n if len(jacobians) > 0 else 0):
            for j in range(n):
                jacobians[b, i, j] = phi[i, j]
    return last


@cache
def many_entry() -> Callable[..., int]:
    """Return `_enter_many` without the search for a signature: arguments must be exact."""
    (compiled,) = compiled_entry(_enter_many, MANY_NATIVE).overloads.values()
    entry: Callable[..., int] = compiled.entry_point
    return entry
