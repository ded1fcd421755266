"""What is integrated, and how closely; evaluation of its field and guards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hopdata.hybrid.compiled.calls import call_field, call_guard, call_guards
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.views import FloatTable, FloatVector, IntTable, IntVector
from hopdata.hybrid.driver.layout import (
    AWAKE,
    CULPRIT,
    END,
    H0,
    H1,
    K1,
    KEND,
    N_AWAKE,
    N_NEAR,
    NEAR,
    NFEV,
    NGEV,
    RATE,
    RATE0,
    RATE1,
    SCRATCH,
    SLOPE,
    H,
    Memory,
    Y,
)


class Problem(NamedTuple):
    """What the caller has asked for: it does not change, but for the mode."""

    field: int  # addresses of the callbacks; 0 where there is none
    guards: int
    guard: int
    rate_bound: int
    on_event: int
    methods: IntTable
    params: FloatVector
    mode: IntVector  # locks first, then the scene's own
    rules: IntTable
    rtol: float
    atol: FloatVector
    max_step: float
    t_end: float
    tangent: FloatTable  # the flow's Jacobian, and room for it
    first_order: bool  # whether it is wanted
    t_start: float
    first_step: float  # 0: to be chosen
    max_steps: int
    max_events: int
    start_state: FloatVector


@kernel
def awake(p: Problem, m: Memory, a: int) -> int:
    """Return the guard at a place of the list AWAKE: where none sleeps, that of this number.

    A loop over all guards is then compiled without the list, into vector instructions.
    """
    return a if p.rate_bound == 0 else m.lists[AWAKE, a]


@kernel
def eval_field(p: Problem, m: Memory, t: float, y: int, dy: int) -> None:
    """Evaluate the field at row `y` of the states into row `dy`.

    NaN stays behind where the user's function does not fill it.
    """
    fill_row(m.states, dy, np.nan)
    m.counts[NFEV] += 1
    call_field(p.field, t, m.states, y, p.mode, p.params, m.states, dy)


@kernel_apart
def eval_guards(p: Problem, m: Memory, t: float, y: int, dy: int, h: int, rate: int) -> None:
    """Evaluate the guards that are awake at rows `y` and `dy` into rows `h` and `rate`."""
    if p.guards != 0:
        eval_all(p, m, t, y, dy, h, rate)
    elif p.guard != 0:
        eval_listed(p, m, AWAKE, m.counts[N_AWAKE], t, y, dy, h, rate)


@kernel_in_loop
def eval_all(p: Problem, m: Memory, t: float, y: int, dy: int, h: int, rate: int) -> None:
    """Evaluate the guards of a system that gives all at once."""
    s, g = m.states, m.guards
    g[h, 0] = np.nan
    m.counts[NGEV] += 1
    call_guards(p.guards, t, s, y, s, dy, p.mode, p.params, g, h, g, rate)


@kernel
def eval_listed(
    p: Problem, m: Memory, which: int, count: int, t: float, y: int, dy: int, h: int, rate: int
) -> None:
    """Evaluate the guards in a list, one by one."""
    m.counts[NGEV] += count
    for a in range(count):
        eval_guard(p, m, t, y, dy, m.lists[which, a], h, rate)


@kernel
def eval_guard(p: Problem, m: Memory, t: float, y: int, dy: int, k: int, h: int, rate: int) -> None:
    """Evaluate one of many guards; NaN stays behind where the user's function does not fill it."""
    s, g = m.states, m.guards
    g[h, k], g[rate, k] = np.nan, np.nan
    call_guard(p.guard, t, s, y, s, dy, p.mode, p.params, k, g, h, g, rate)


@kernel
def guards_at_start(p: Problem, m: Memory, t: float) -> bool:
    """Evaluate the guards at the start of the step; tell whether all are filled and finite."""
    if p.guards != 0:
        fill_row(m.guards, H0, np.nan)
        fill_row(m.guards, RATE0, np.nan)
    eval_guards(p, m, t, Y, K1, H0, RATE0)
    return guards_are_finite(p, m, H0, RATE0)


@kernel
def guards_at_end(p: Problem, m: Memory, t: float) -> bool:
    """Evaluate the guards at the end of the step; tell whether all are finite."""
    eval_guards(p, m, t, END, KEND, H1, RATE1)
    return guards_are_finite(p, m, H1, RATE1)


@kernel
def guards_inside(p: Problem, m: Memory, t: float) -> None:
    """Evaluate the guards at the state and slope that stand in the working rows."""
    eval_guards(p, m, t, SCRATCH, SLOPE, H, RATE)


@kernel
def near_inside(p: Problem, m: Memory, t: float) -> None:
    """Evaluate there at least the guards that the step may concern."""
    if p.guards != 0:
        eval_all(p, m, t, SCRATCH, SLOPE, H, RATE)
    else:
        eval_listed(p, m, NEAR, m.counts[N_NEAR], t, SCRATCH, SLOPE, H, RATE)


@kernel_apart
def guards_are_finite(p: Problem, m: Memory, h: int, rate: int) -> bool:
    """Tell whether rows `h` and `rate` are finite; else keep the guard that is not."""
    g, wrong = m.guards, 0
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        wrong += 0 if (abs(g[h, k]) < np.inf) & (abs(g[rate, k]) < np.inf) else 1
    if wrong == 0:
        return True
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        if not (np.isfinite(g[h, k]) and np.isfinite(g[rate, k])):
            m.counts[CULPRIT] = k
            break
    return False


@kernel
def first_not_finite(table: FloatTable, row: int) -> int:
    """Return the index of the first value in a row that is NaN or infinite, or -1."""
    for i in range(table.width):
        if not np.isfinite(table[row, i]):
            return i
    return -1


@kernel
def copy_row(table: FloatTable, source: int, target: int) -> None:
    """Copy row `source` of a table to row `target`."""
    for i in range(table.width):
        table[target, i] = table[source, i]


@kernel
def fill_row(table: FloatTable, row: int, value: float) -> None:
    """Set a whole row of a table to one value."""
    for i in range(table.width):
        table[row, i] = value
