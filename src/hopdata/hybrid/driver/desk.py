"""The desk: a table of addresses, on which the driver finds its callbacks and arrays."""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import (
    FloatTable,
    FloatVector,
    IntTable,
    IntVector,
    float_table,
    float_vector,
    int_table,
    int_vector,
)
from hopdata.hybrid.driver.firing import Log
from hopdata.hybrid.driver.layout import (
    ATOL,
    CLOCK,
    COUNTS,
    FIELD,
    FLAG_TABLE,
    GUARD,
    GUARD_TABLE,
    GUARDS,
    LIST_TABLE,
    LOG_TABLE,
    METHOD_TABLE,
    MODE,
    N_LOG_ROWS,
    N_ROWS,
    ON_EVENT,
    PARAMS,
    RATE_BOUND,
    ROW_TABLE,
    RULES,
    SAMPLE_TABLE,
    STATE_TABLE,
    TANGENT_TABLE,
    WAKE_AT,
    WANTED,
    Memory,
)
from hopdata.hybrid.driver.output import Output
from hopdata.hybrid.driver.problem import Problem


@kernel
def vector_on(desk: IntVector, slot: int) -> FloatVector:
    """Return the view of the floats whose address and width stand at a slot of the desk."""
    return float_vector(desk[slot], desk[slot + 1])


@kernel
def table_on(desk: IntVector, slot: int) -> FloatTable:
    """Return the view of a table of floats."""
    return float_table(desk[slot], desk[slot + 1])


@kernel
def int_vector_on(desk: IntVector, slot: int) -> IntVector:
    """Return the view of integers."""
    return int_vector(desk[slot], desk[slot + 1])


@kernel
def int_table_on(desk: IntVector, slot: int) -> IntTable:
    """Return the view of a table of integers."""
    return int_table(desk[slot], desk[slot + 1])


@kernel
def desk_memory(desk: IntVector) -> Memory:
    """Return what changes during an integration."""
    return Memory(
        table_on(desk, STATE_TABLE), table_on(desk, GUARD_TABLE), int_table_on(desk, FLAG_TABLE),
        int_table_on(desk, LIST_TABLE), vector_on(desk, WAKE_AT),
        vector_on(desk, CLOCK), int_vector_on(desk, COUNTS),
    )  # fmt: skip


@kernel
def desk_problem(desk: IntVector, rtol: float, max_step: float, t_end: float) -> Problem:
    """Return what is integrated."""
    return Problem(
        desk[FIELD], desk[GUARDS], desk[GUARD], desk[RATE_BOUND], desk[ON_EVENT],
        int_table_on(desk, METHOD_TABLE), vector_on(desk, PARAMS), int_vector_on(desk, MODE),
        int_table_on(desk, RULES), rtol, vector_on(desk, ATOL), max_step, t_end,
        table_on(desk, TANGENT_TABLE), desk[TANGENT_TABLE] != 0,
    )  # fmt: skip


@kernel
def desk_output(desk: IntVector, every_step: bool) -> Output:
    """Return room for the trajectory."""
    return Output(
        vector_on(desk, WANTED), table_on(desk, SAMPLE_TABLE),
        table_on(desk, ROW_TABLE), desk[N_ROWS], every_step,
    )  # fmt: skip


@kernel
def desk_log(desk: IntVector) -> Log:
    """Return room for events."""
    return Log(table_on(desk, LOG_TABLE), int_table_on(desk, LOG_TABLE), desk[N_LOG_ROWS])
