"""The desk: a table of addresses, on which the driver finds its callbacks and arrays."""

from __future__ import annotations

from hopdata.hybrid.compiled.record import reader
from hopdata.hybrid.driver import layout as at
from hopdata.hybrid.driver.firing import Log
from hopdata.hybrid.driver.layout import Memory
from hopdata.hybrid.driver.output import Output
from hopdata.hybrid.driver.problem import Problem

desk_problem = reader(
    Problem,
    field=at.FIELD, guards=at.GUARDS, guard=at.GUARD, rate_bound=at.RATE_BOUND,
    on_event=at.ON_EVENT, methods=at.METHOD_TABLE, params=at.PARAMS, mode=at.MODE, rules=at.RULES,
    rtol=at.RTOL, atol=at.ATOL, max_step=at.MAX_STEP, t_end=at.T_END, tangent=at.TANGENT_TABLE,
    first_order=at.TANGENT_TABLE, t_start=at.T_START, first_step=at.FIRST_STEP,
    max_steps=at.MAX_STEPS, max_events=at.MAX_EVENTS, start_state=at.START_STATE,
)  # fmt: skip
desk_memory = reader(
    Memory,
    states=at.STATE_TABLE, guards=at.GUARD_TABLE, flags=at.FLAG_TABLE, lists=at.LIST_TABLE,
    wake_at=at.WAKE_AT, clock=at.CLOCK, counts=at.COUNTS,
)  # fmt: skip
desk_output = reader(
    Output,
    wanted=at.WANTED, samples=at.SAMPLE_TABLE, rows=at.ROW_TABLE, n_rows=at.N_ROWS,
    every_step=at.EACH_STEP,
)  # fmt: skip
desk_log = reader(Log, floats=at.LOG_TABLE, integers=at.LOG_TABLE, n_rows=at.N_LOG_ROWS)
