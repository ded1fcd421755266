"""Room for a trajectory of unknown length: chunks that double, joined at the end."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.layout import EVENT_ROWS, ROWS, SAMPLES
from hopdata.hybrid.solution import EventLog
from hopdata.hybrid.system import System

FloatArray = NDArray[np.float64]

FIRST_ROWS = 128
FIRST_EVENTS = 64
LARGEST_CHUNK = 1 << 16


class Storage:
    """Rows of steps and events that the driver fills.

    Parameters
    ----------
    system : System
        Gives the sizes of rows, and how many events one instant may bring.
    t_eval : (N,) array or None
        Times at which states are wanted; if None, every step is kept.
    """

    def __init__(self, system: System, t_eval: FloatArray | None) -> None:
        self._system = system
        self._every_step = t_eval is None
        self._wanted = np.empty(0) if t_eval is None else t_eval
        self._samples = np.empty((len(self._wanted), system.n_states))
        self._n_samples = 0
        self._trajectory: list[tuple[NDArray[Any], ...]] = []
        self._events: list[tuple[NDArray[Any], ...]] = []
        self._n_rows = FIRST_ROWS if self._every_step else 0
        self._n_events = FIRST_EVENTS + 2 * system.n_guards if system.n_guards else 0

    def room(self) -> tuple[NDArray[Any], ...]:
        """Return fresh arrays for the driver's next call."""
        n, m = self._system.n_states, self._system.n_modes
        self._rows = (np.empty(self._n_rows), np.empty((self._n_rows, n)))
        self._log = (
            np.empty(self._n_events),
            np.empty(self._n_events, dtype=np.int64),
            np.empty(self._n_events, dtype=np.int64),
            np.empty((self._n_events, n)),
            np.empty((self._n_events, n)),
            np.empty((self._n_events, m), dtype=np.int64),
        )
        self._n_rows = min(2 * self._n_rows, LARGEST_CHUNK)
        return (self._wanted, self._samples, *self._rows, *self._log)

    def collect(self, counts: NDArray[np.int64]) -> None:
        """Take over what the driver has written, and mark the next arrays as empty."""
        rows, events = int(counts[ROWS]), int(counts[EVENT_ROWS])
        self._trajectory.append((self._rows[0][:rows], self._rows[1][:rows]))
        self._events.append(tuple(column[:events] for column in self._log))
        if events > self._n_events // 2:
            self._n_events = min(2 * self._n_events, LARGEST_CHUNK + 2 * self._system.n_guards)
        self._n_samples = int(counts[SAMPLES])
        counts[ROWS] = counts[EVENT_ROWS] = 0

    def trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Return times (N,) and states (n, N)."""
        if not self._every_step:
            return self._wanted[: self._n_samples].copy(), self._samples[: self._n_samples].T.copy()
        time, rows = _joined(self._trajectory)
        return time, np.ascontiguousarray(rows.T)

    def events(self) -> EventLog:
        """Return the log of all events."""
        time, guard, direction, before, after, mode = _joined(self._events)
        names = self._system.guard_names
        return EventLog(time, guard, direction, before, after, mode, names)


def _joined(chunks: list[tuple[NDArray[Any], ...]]) -> tuple[NDArray[Any], ...]:
    if len(chunks) == 1:
        return chunks[0]
    return tuple(np.concatenate(column) for column in zip(*chunks, strict=True))
