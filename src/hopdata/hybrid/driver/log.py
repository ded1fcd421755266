"""The log of events: what is written of each.

An event takes a row with its time, guard, direction and the states before and after its
handler. The mode after it would take as many numbers as there are guards, so the log
holds only what has changed in the mode since the event before. `hybrid.solution` puts
the modes together again.
"""

from typing import NamedTuple

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.memory import FloatTable, IntTable, IntVector
from hopdata.hybrid.driver import problem
from hopdata.hybrid.layout import Memory


class Log(NamedTuple):
    """Room for events, and what the log knows of the mode."""

    floats: FloatTable  # events, one per row
    integers: IntTable  # the same memory
    n_rows: int  # rows that both have
    changes: IntTable  # changes of the mode, one per row
    n_changes: int  # rows of `changes`
    logged: IntVector  # the end of the mode, as the log has it: see `log_changes`
    keep_events: int  # 0: only the last event is written, for the handler's derivative


@kernel
def is_full(p: problem.Problem, m: Memory, log: Log) -> bool:
    """Return whether the log has no room for an event that changes the whole mode.

    If a law decides about several guards, there may be one of each that is due.
    """
    due = 1
    if p.rules[at.BY_LAW, 0] != 0:
        due = max(1, m.counts[at.N_DUE])
    no_row = m.counts[at.EVENT_ROWS] + due > log.n_rows
    no_change = m.counts[at.CHANGES] + log.logged.width > log.n_changes
    return log.keep_events != 0 and (no_row or no_change)


@kernel
def forget_mode(log: Log) -> None:
    """Have the next event log the whole mode."""
    if log.keep_events == 0:
        return
    for i in range(log.logged.width):
        log.logged[i] = at.UNKNOWN


@kernel
def begin_event(m: Memory, log: Log) -> int:
    """Log the state before an event's handler; return the row of the event."""
    row = m.counts[at.EVENT_ROWS]
    problem.copy_row(m.states, at.Y, log.floats, row, at.LOG_STATES)
    return row


@kernel
def end_event(
    p: problem.Problem, m: Memory, log: Log, row: int, k: int, direction: int
) -> bool:
    """Log an event of guard k after its handler.

    Returns whether the handler has changed the state.
    """
    n = m.states.width
    jumped = False
    for i in range(n):
        jumped = jumped or m.states[at.Y, i] != log.floats[row, at.LOG_STATES + i]
        log.floats[row, at.LOG_STATES + n + i] = m.states[at.Y, i]
    if log.keep_events != 0:
        log.floats[row, at.LOG_TIME] = m.clock[at.T]
        log.integers[row, at.LOG_GUARD] = k
        log.integers[row, at.LOG_DIRECTION] = direction
        log.integers[row, at.LOG_CHANGES] = log_changes(p, m, log)
        m.counts[at.EVENT_ROWS] += 1
    return jumped


@kernel
def log_changes(p: problem.Problem, m: Memory, log: Log) -> int:
    """Log what has changed in the mode since the last event.

    Only the end of the mode is logged, as many entries as `logged` has. If guards are
    evaluated one by one there may be thousands of them; their locks, which stand first
    in the mode, are then left out.

    Returns the number of all changes in the log.
    """
    total = m.counts[at.CHANGES]
    first = p.mode.width - log.logged.width
    for i in range(log.logged.width):
        value = p.mode[first + i]
        if value != log.logged[i]:
            log.logged[i] = value
            log.changes[total, at.CHANGE_PLACE] = i
            log.changes[total, at.CHANGE_VALUE] = value
            total += 1
    m.counts[at.CHANGES] = total
    return total
