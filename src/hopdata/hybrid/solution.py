"""What an integration returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Record = TypeVar("Record")


def filled(kind: type[Record], **values: Any) -> Record:
    """Return a frozen dataclass with these values: its own `__init__` takes a microsecond."""
    record = object.__new__(kind)
    record.__dict__.update(values)
    return record


@dataclass(frozen=True)
class EventLog:
    """Events in the order in which they happened; E of them.

    Parameters
    ----------
    time : (E,) array
        Instant of each event, s.
    guard : (E,) array of int
        Number of the guard.
    direction : (E,) array of int
        +1 where the event function rose through zero, -1 where it fell.
    before, after : (E, n) array
        State directly before and after the event's handler.
    mode : (E, m) array of int
        Mode after it.
    guard_names : tuple of str
        Names of all guards of the system.
    """

    time: FloatArray
    guard: IntArray
    direction: IntArray
    before: FloatArray
    after: FloatArray
    mode: IntArray
    guard_names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    def of(self, guard: str, *, direction: int = 0) -> EventLog:
        """Return the events of one guard, by name; in one direction only if it is not 0."""
        chosen = self.guard == self.guard_names.index(guard)
        if direction != 0:
            chosen &= self.direction == direction
        return EventLog(
            self.time[chosen],
            self.guard[chosen],
            self.direction[chosen],
            self.before[chosen],
            self.after[chosen],
            self.mode[chosen],
            self.guard_names,
        )


@dataclass(frozen=True)
class Solution:
    """Trajectory, events and how it ended, in the vocabulary of `scipy.integrate.solve_ivp`.

    Parameters
    ----------
    t : (N,) array
        Times: `t_eval` as far as it was reached, or every step and event, s.
    y : (n, N) array
        States at those times. At the instant of an event, the state after it.
    events : EventLog
        All events.
    status : int
        0: reached the end; 1: ended by an event; negative: failed, see `message`.
    message : str
        How the integration ended, in words.
    nfev, n_guard_evaluations, n_steps, n_rejected : int
        Evaluations of field and guards, accepted and rejected steps.
    mode : (m,) array of int
        Mode at the end.
    t_end : float
        Time reached, s.
    y_end : (n,) array
        State reached.
    jacobian : (n, n) array, optional
        Derivative of `y_end` by the initial state at fixed times, through all events, if asked for.
    """

    t: FloatArray
    y: FloatArray
    events: EventLog
    status: int
    message: str
    nfev: int
    n_guard_evaluations: int
    n_steps: int
    n_rejected: int
    mode: IntArray
    t_end: float
    y_end: FloatArray
    jacobian: FloatArray | None = None

    @property
    def success(self) -> bool:
        """Whether it reached the end of the time span, or an event that ends it."""
        return self.status >= 0
