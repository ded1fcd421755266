"""The arrays that an integration works in, made once for a system and used again.

The driver finds them by a table of addresses (the desk), because each array that is handed from
Python to machine code would cost as much as a field evaluation. What it returns is copied out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.driver import layout
from hopdata.hybrid.driver.layout import FloatArray, IntArray
from hopdata.hybrid.methods.table import MethodTable, tangent_table

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
    n_states, n_modes : int
        Lengths of state and mode.
    guard_names : tuple of str
        For the log of events.
    n_logged_modes : int
        Length of the last part of the mode that the log of events keeps.
    """

    def __init__(
        self,
        addresses: tuple[int, ...],
        rules: IntArray,
        n_states: int,
        n_modes: int,
        guard_names: tuple[str, ...],
        n_logged_modes: int,
    ) -> None:
        n_guards = len(guard_names)
        self.guard_names = guard_names
        self._states = np.zeros((layout.W1, n_states))
        self.state = self._states[layout.Y]
        self.mode = np.zeros(n_modes, dtype=np.int64)
        self.atol = np.zeros(n_states)
        self.clock = np.zeros(layout.CLOCK_SLOTS)
        self.counts = np.zeros(layout.COUNT_SLOTS, dtype=np.int64)
        self._guards = np.zeros((layout.GUARD_ROWS, n_guards))
        self._flags = np.zeros((layout.FLAG_ROWS, n_guards), dtype=np.int64)
        self._lists = np.zeros((layout.LIST_ROWS, n_guards), dtype=np.int64)
        self._wake_at = np.zeros(n_guards)
        self._methods: MethodTable | None = None
        self.tangent: FloatArray | None = None
        self._rows = np.empty((FIRST_ROWS, 1 + n_states))
        self._log = np.empty((FIRST_EVENTS + 2 * n_guards, 3 + 2 * n_states + n_logged_modes))
        self._wanted, self._samples = np.empty(0), np.empty((0, n_states))
        self._kept: list[tuple[FloatArray, FloatArray]] = []  # chunks that are full
        self.desk = np.zeros(layout.DESK_SLOTS, dtype=np.int64)
        self.desk[: len(addresses)] = addresses
        self._lay_out(
            layout.MODE, self.mode, rules, self.atol,
            self._states, self._guards, self._flags, self._lists, self._wake_at,
            self.clock, self.counts,
        )  # fmt: skip
        self._lay_out(layout.WANTED, self._wanted, self._samples)
        self._lay_out_records()

    def begin(self, methods: MethodTable, t_eval: FloatArray | None, jacobian: bool) -> None:
        """Forget the last integration; states are wanted at `t_eval` or, if None, at each step."""
        if methods is not self._methods:
            self._take(methods)
        if jacobian:
            self.tangent = tangent_table(methods.tangent_rows, len(self.atol))
            self._lay_out(layout.TANGENT_TABLE, self.tangent)
        elif self.tangent is not None:
            self.tangent = None
            self.desk[layout.TANGENT_TABLE] = 0
        if self._kept:
            self._kept = []
            if max(len(self._rows), len(self._log)) > LARGEST_KEPT:
                self._change_room(LARGEST_KEPT, LARGEST_KEPT)
        if t_eval is not None or len(self._wanted) > 0:
            self._wanted = np.empty(0) if t_eval is None else t_eval
            self._samples = np.empty((len(self._wanted), len(self.atol)))
            self._lay_out(layout.WANTED, self._wanted, self._samples)

    def forget_samples(self) -> None:
        """Lay out the workspace's own room for samples again, after another's was used."""
        self._lay_out(layout.WANTED, self._wanted, self._samples)

    def _take(self, methods: MethodTable) -> None:
        """Lay out what other methods than before need."""
        self._methods = methods
        self._lay_out(layout.METHOD_TABLE, methods.rows)
        needed = layout.W1 + methods.work_rows
        if len(self._states) < needed:
            self._states = np.zeros((needed, len(self.atol)))
            self.state = self._states[layout.Y]
            self._lay_out(layout.STATE_TABLE, self._states)

    def enlarge(self) -> None:
        """Put aside what the driver has written, and lay out new and larger room."""
        rows, events = int(self.counts[layout.ROWS]), int(self.counts[layout.EVENT_ROWS])
        self._kept.append((self._rows[:rows], self._log[:events]))
        n_rows, n_events = len(self._rows), len(self._log)
        n_rows = 2 * n_rows if rows > n_rows // 2 else n_rows
        n_events = 2 * n_events if events > n_events // 2 else n_events
        self._change_room(min(n_rows, LARGEST_CHUNK), min(n_events, LARGEST_CHUNK))
        self.counts[layout.ROWS] = self.counts[layout.EVENT_ROWS] = 0

    def samples(self) -> FloatArray:
        """Return the wanted times that were reached, and the states there, side by side."""
        count = int(self.counts[layout.SAMPLES])
        return np.column_stack([self._wanted[:count], self._samples[:count]])

    def trajectory(self) -> FloatArray:
        """Return times and states of all steps, side by side."""
        rows = self._rows[: self.counts.item(ROWS)]
        return np.concatenate([*(k for k, _ in self._kept), rows]) if self._kept else rows.copy()

    def events(self) -> FloatArray:
        """Return the records of all events."""
        log = self._log[: self.counts.item(EVENT_ROWS)]
        return np.concatenate([*(k for _, k in self._kept), log]) if self._kept else log.copy()

    def _change_room(self, n_rows: int, n_events: int) -> None:
        spare = 2 * len(self.guard_names)  # for the events of one more instant
        self._rows = np.empty((n_rows, self._rows.shape[1]))
        self._log = np.empty((n_events + spare, self._log.shape[1]))
        self._lay_out_records()

    def _lay_out_records(self) -> None:
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
