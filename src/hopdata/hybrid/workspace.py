"""The arrays that an integration works in, made once for a system and used again.

The driver finds them by a table of addresses (the desk), because each array that is handed from
Python to machine code would cost as much as a field evaluation. What it returns is copied out.
"""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.hybrid.arguments import (
    check_memory,
    check_params,
    check_shape,
    quick_writer,
    set_tolerance,
)
from hopdata.hybrid.driver import layout
from hopdata.hybrid.driver.layout import FloatArray, IntArray
from hopdata.hybrid.methods.table import MethodTable, tangent_table
from hopdata.hybrid.solution import Widths

# NumPy integers, as the compiled driver wants them, are slow to index with.
ROWS, EVENT_ROWS = int(layout.ROWS), int(layout.EVENT_ROWS)

FIRST_ROWS = 256
FIRST_EVENTS = 64
LARGEST_CHUNK = 1 << 16
LARGEST_KEPT = 1 << 13  # rows that a workspace keeps for the next integration


class Workspace:
    """Memory of one integration at a time.

    Parameters
    ----------
    addresses : tuple of int
        Machine code, in the order of the desk.
    rules : (2, n_guards) array of int
        Directions and terminal flags.
    n_states, n_modes, n_memory : int
        Lengths of state, mode, and the scene's memory.
    guard_names : tuple of str
        For the log of events.
    n_logged_modes : int
        Length of the last part of the mode that the log of events keeps.

    Attributes
    ----------
    clock, counts, mode, state : array
        The driver's times and counters, and mode and state as they are now.
    desk_address : int
        Where the desk stands.
    widths : Widths
        Lengths of what is copied out.
    """

    def __init__(
        self,
        addresses: tuple[int, ...],
        rules: IntArray,
        n_states: int,
        n_modes: int,
        n_memory: int,
        guard_names: tuple[str, ...],
        n_logged_modes: int,
    ) -> None:
        n_guards = len(guard_names)
        self.guard_names = guard_names
        self.desk = np.zeros(layout.DESK_SLOTS, dtype=np.int64)
        self.desk[: len(addresses)] = addresses
        self.desk_address = self.desk.ctypes.data
        self._n_memory = n_memory
        self._make_clockwork(n_modes)
        self._make_states(layout.W1, n_states)
        self._make_params(0)
        self._atol, self._atol_of_all = np.zeros(n_states), 0.0
        self._guards = np.zeros((layout.GUARD_ROWS, n_guards))
        self._flags = np.zeros((layout.FLAG_ROWS, n_guards), dtype=np.int64)
        self._lists = np.zeros((layout.LIST_ROWS, n_guards), dtype=np.int64)
        self._wake_at = np.zeros(n_guards)
        self._methods: MethodTable | None = None
        self._identity = np.eye(n_states)
        self.tangent: FloatArray | None = None
        self._rows = np.empty((FIRST_ROWS, 1 + n_states))
        self._log = np.empty((FIRST_EVENTS + 2 * n_guards, 3 + 2 * n_states + n_logged_modes))
        self._wanted, self._samples = np.empty(0), np.empty((0, n_states))
        self._kept: list[tuple[memoryview, memoryview]] = []  # chunks that are full
        self.widths = Widths(n_states, n_modes, self._log.shape[1])
        self._lay_out(layout.RULES, rules, self._atol)
        self._lay_out(layout.GUARD_TABLE, self._guards, self._flags, self._lists, self._wake_at)
        self._lay_out(layout.WANTED, self._wanted, self._samples)
        self._lay_out_records()

    def _make_clockwork(self, n_modes: int) -> None:
        """Make times, counters and mode, side by side: they are taken out together."""
        lengths = (layout.CLOCK_SLOTS, layout.COUNT_SLOTS, n_modes)
        block = np.zeros(sum(lengths))
        self.clock, counts, mode = np.split(block, np.cumsum(lengths)[:-1])
        self.counts, self.mode = counts.view(np.int64), mode.view(np.int64)
        self._end_bytes = block.data.cast("B")
        self._lay_out(layout.MODE, self.mode)
        self._lay_out(layout.CLOCK, self.clock, self.counts)

    def _make_states(self, n_rows: int, n_states: int) -> None:
        """Make the table of states."""
        self._states = np.zeros((n_rows, n_states))
        self.state = self._states[layout.Y]
        self._write_state = quick_writer(self.state)
        self._lay_out(layout.STATE_TABLE, self._states)

    def _make_params(self, count: int) -> None:
        """Make room for so many parameters and, behind them, the scene's memory."""
        self.params = np.zeros(count + self._n_memory)
        self._caller_params = self.params[:count]
        self._write_params = quick_writer(self._caller_params)
        self._lay_out(layout.PARAMS, self.params)

    def set_state(self, y0: ArrayLike) -> None:
        """Put the initial state in its place; whether it is finite, the driver looks up."""
        if not self._write_state(y0):
            self.state[:] = check_shape("y0", y0, len(self.state))

    def set_params(self, params: ArrayLike, memory: ArrayLike | None) -> None:
        """Put the parameters in their place, and the scene's memory behind them."""
        if not self._write_params(params):
            given = check_params(params)
            self.make_params_room(len(given))
            self._caller_params[:] = given
        if self._n_memory > 0 or memory is not None:
            self.params[len(self._caller_params) :] = check_memory(memory, self._n_memory)

    def make_params_room(self, count: int) -> None:
        """Have room for so many parameters of the caller's."""
        if count != len(self._caller_params):
            self._make_params(count)

    def set_tolerance(self, atol: ArrayLike) -> None:
        """Put the absolute tolerance in its place, unless it is there already."""
        if type(atol) is float and atol == self._atol_of_all:
            return
        self._atol_of_all = nan
        set_tolerance(self._atol, atol)
        if type(atol) is float:
            self._atol_of_all = atol

    def begin(self, methods: MethodTable, t_eval: FloatArray | None, jacobian: bool) -> None:
        """Forget the last integration; states are wanted at `t_eval` or, if None, at each step."""
        if methods is not self._methods:
            self._take(methods)
        if jacobian:
            self._begin_tangent(methods)
        elif self.tangent is not None:
            self.tangent = None
            self.desk[layout.TANGENT_TABLE] = 0
        if self._kept:
            self._kept = []
            if max(len(self._rows), len(self._log)) > LARGEST_KEPT:
                self._change_room(LARGEST_KEPT, LARGEST_KEPT)
        if t_eval is not None or len(self._wanted) > 0:
            self._wanted = np.empty(0) if t_eval is None else t_eval
            self._samples = np.empty((len(self._wanted), len(self.state)))
            self._lay_out(layout.WANTED, self._wanted, self._samples)

    def _begin_tangent(self, methods: MethodTable) -> None:
        """Have room for the flow's Jacobian, which begins as the identity."""
        if self.tangent is None:
            self.tangent = tangent_table(methods, len(self.state))
            self._lay_out(layout.TANGENT_TABLE, self.tangent)
        else:
            self.tangent[: len(self.state)] = self._identity

    def forget_samples(self) -> None:
        """Lay out the workspace's own room for samples again, after another's was used."""
        self._lay_out(layout.WANTED, self._wanted, self._samples)

    def _take(self, methods: MethodTable) -> None:
        """Lay out what other methods than before need."""
        self._methods, self.tangent = methods, None
        self.desk[layout.TANGENT_TABLE] = 0
        self._lay_out(layout.METHOD_TABLE, methods.rows)
        needed = layout.W1 + methods.work_rows
        if len(self._states) < needed:
            self._make_states(needed, len(self.state))

    def enlarge(self) -> None:
        """Put aside what the driver has written, and lay out new and larger room."""
        rows, events = int(self.counts[layout.ROWS]), int(self.counts[layout.EVENT_ROWS])
        self._kept.append((self._row_part(rows), self._log_part(events)))
        n_rows, n_events = len(self._rows), len(self._log)
        n_rows = 2 * n_rows if rows > n_rows // 2 else n_rows
        n_events = 2 * n_events if events > n_events // 2 else n_events
        self._change_room(min(n_rows, LARGEST_CHUNK), min(n_events, LARGEST_CHUNK))
        self.counts[layout.ROWS] = self.counts[layout.EVENT_ROWS] = 0

    def jacobian(self) -> FloatArray | None:
        """Return the flow's Jacobian, if it was asked for."""
        return None if self.tangent is None else self.tangent[: len(self.state)].copy()

    def end(self) -> bytes:
        """Return clock, counts and mode."""
        return self._end_bytes.tobytes()

    def samples(self) -> bytes:
        """Return the wanted times that were reached, and the states there, side by side."""
        count = int(self.counts[layout.SAMPLES])
        return np.column_stack([self._wanted[:count], self._samples[:count]]).tobytes()

    def trajectory(self) -> bytes:
        """Return times and states of all steps, side by side."""
        rows = self._row_part(self.counts.item(ROWS))
        return b"".join([*(k for k, _ in self._kept), rows]) if self._kept else rows.tobytes()

    def events(self) -> bytes:
        """Return the records of all events."""
        log = self._log_part(self.counts.item(EVENT_ROWS))
        return b"".join([*(k for _, k in self._kept), log]) if self._kept else log.tobytes()

    def _row_part(self, count: int) -> memoryview:
        return self._row_bytes[: count * self._row_size]

    def _log_part(self, count: int) -> memoryview:
        return self._log_bytes[: count * self._log_size]

    def _change_room(self, n_rows: int, n_events: int) -> None:
        spare = 2 * len(self.guard_names)  # for the events of one more instant
        self._rows = np.empty((n_rows, self._rows.shape[1]))
        self._log = np.empty((n_events + spare, self._log.shape[1]))
        self._lay_out_records()

    def _lay_out_records(self) -> None:
        self._row_size, self._log_size = self._rows.strides[0], self._log.strides[0]
        self._row_bytes = self._rows.data.cast("B")
        self._log_bytes = self._log.data.cast("B")
        self.desk[layout.N_ROWS], self.desk[layout.N_LOG_ROWS] = len(self._rows), len(self._log)
        self._lay_out(layout.ROW_TABLE, self._rows, self._log)

    def _lay_out(self, first: int, *arrays: NDArray[Any]) -> None:
        """Write address and width of arrays on the desk, from the slot of the first one on."""
        for slot, array in enumerate(arrays):
            place = first + 2 * slot
            self.desk[place], self.desk[place + 1] = array.ctypes.data, array.shape[-1]


class Pool(list[Workspace]):
    """Workspaces that are not in use: a thread takes one, or makes one, and gives it back.

    A copy of a pool is empty, for the addresses in a workspace are those of its own arrays.
    """

    def __reduce__(self) -> tuple[type[Pool], tuple[()]]:
        return Pool, ()
