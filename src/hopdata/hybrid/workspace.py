"""The arrays that an integration works in, made once for a system and used again.

The driver finds them by a table of addresses (the desk), because each array that is handed from
Python to machine code would cost as much as a field evaluation. What it returns is copied out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.driver import layout
from hopdata.hybrid.driver.layout import FloatArray, IntArray
from hopdata.hybrid.methods.table import MethodTable, tangent_table
from hopdata.hybrid.solution import EventLog, filled

FIRST_ROWS = 256
FIRST_EVENTS = 64
LARGEST_CHUNK = 1 << 16
LARGEST_KEPT = 1 << 13  # rows that a workspace keeps for the next integration

Columns = tuple[NDArray[Any], ...]


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
        self._n_logged_modes = n_logged_modes
        self._guard_names = guard_names
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
        self._rows = self._room_for_rows(FIRST_ROWS)
        self._log = self._room_for_events(FIRST_EVENTS + 2 * n_guards if n_guards else 0)
        self._wanted, self._samples = np.empty(0), np.empty((0, n_states))
        self._kept: list[tuple[Columns, Columns]] = []  # chunks that are full
        self._no_events = self._log_of([column[:0].copy() for column in self._log])
        self.desk = np.zeros(layout.DESK_SLOTS, dtype=np.int64)
        self.desk[: layout.DESK_ARRAYS] = addresses
        self._lay_out(
            layout.MODE, self.mode, rules, self.atol,
            self._states, self._guards, self._flags, self._lists, self._wake_at,
            self.clock, self.counts,
        )  # fmt: skip
        self._lay_out(layout.WANTED, self._wanted, self._samples)
        self._lay_out(layout.ROW_TIME, *self._rows, *self._log)

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
            if max(len(self._rows[0]), len(self._log[0])) > LARGEST_KEPT:
                self._change_room(LARGEST_KEPT, LARGEST_KEPT)
        if t_eval is not None or len(self._wanted) > 0:
            self._wanted = np.empty(0) if t_eval is None else t_eval
            self._samples = np.empty((len(self._wanted), len(self.atol)))
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
        self._kept.append((_first(rows, self._rows), _first(events, self._log)))
        n_rows, n_events = len(self._rows[0]), len(self._log[0])
        n_rows = 2 * n_rows if rows > n_rows // 2 else n_rows
        n_events = 2 * n_events if events > n_events // 2 else n_events
        self._change_room(min(n_rows, LARGEST_CHUNK), min(n_events, LARGEST_CHUNK))
        self.counts[layout.ROWS] = self.counts[layout.EVENT_ROWS] = 0

    def samples(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the first wanted times (N,) and the states (n, N) there."""
        return self._wanted[:count].copy(), self._samples[:count].T.copy()

    def trajectory(self, rows: int) -> tuple[FloatArray, FloatArray]:
        """Return times (N,) and states (n, N) of all steps, `rows` of them in the last chunk."""
        time, states = self._rows
        time, states = time[:rows], states[:rows]
        if self._kept:
            time, states = _joined([*(chunk[0] for chunk in self._kept), (time, states)])
        return time.copy(), states.T.copy()

    def events(self, events: int) -> EventLog:
        """Return the log of all events, `events` of them in the last chunk."""
        if self._kept:
            chunks = [*(chunk[1] for chunk in self._kept), _first(events, self._log)]
            return self._log_of(_joined(chunks))
        if events == 0:
            return self._no_events
        return self._log_of([column[:events].copy() for column in self._log])

    def _log_of(self, columns: Sequence[NDArray[Any]]) -> EventLog:
        time, guard, direction, before, after, mode = columns
        return filled(
            EventLog, time=time, guard=guard, direction=direction, before=before, after=after,
            mode=mode, guard_names=self._guard_names,
        )  # fmt: skip

    def _change_room(self, n_rows: int, n_events: int) -> None:
        spare = 2 * len(self._guard_names)  # for the events of one more instant
        self._rows = self._room_for_rows(n_rows)
        self._log = self._room_for_events(n_events + spare)
        self._lay_out(layout.ROW_TIME, *self._rows, *self._log)

    def _room_for_rows(self, count: int) -> Columns:
        return np.empty(count), np.empty((count, len(self.atol)))

    def _room_for_events(self, count: int) -> Columns:
        n_states, n_modes = len(self.atol), self._n_logged_modes
        return (
            np.empty(count),
            np.empty(count, dtype=np.int64),
            np.empty(count, dtype=np.int64),
            np.empty((count, n_states)),
            np.empty((count, n_states)),
            np.empty((count, n_modes), dtype=np.int64),
        )

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


def _first(count: int, columns: Columns) -> Columns:
    return tuple([column[:count] for column in columns])


def _joined(chunks: list[Columns]) -> Columns:
    return tuple([np.concatenate(column) for column in zip(*chunks, strict=True)])
