"""One event-selected region of a system: every event function rises through zero, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.printed.classical import Slope
from hopdata.hybrid.solution import FloatArray, IntArray
from hopdata.hybrid.system import System


@dataclass(frozen=True)
class Region:
    """A system near one corner of its guards; b_k = -1 before guard k is crossed, +1 after.

    Parameters
    ----------
    system : System
        Its field and guards are called as plain Python.
    params : (p,) array
        Numbers handed to them.
    orientation : (m,) array of int
        +1 where the event function of the region is h_k, -1 where it is -h_k: there h_k falls.
    """

    system: System
    params: FloatArray
    orientation: IntArray

    def mode(self, locks: IntArray) -> IntArray:
        """Return the system's mode for the region's locks."""
        mode = np.zeros(self.system.n_modes, dtype=np.int64)
        mode[: self.system.n_guards] = self.orientation * locks
        return mode

    def slope(self, t: float, y: FloatArray, locks: IntArray) -> FloatArray:
        """Return the field (n,) with the locks held."""
        return self.slope_in(locks)(t, y)

    def slope_in(self, locks: IntArray) -> Slope:
        """Return the field with these locks held, as a function of time and state."""
        mode, field = self.mode(locks), self.system.field.function

        def slope(t: float, y: FloatArray) -> FloatArray:
            dy = np.zeros(len(y))
            field(t, y, mode, self.params, dy)
            return dy

        return slope

    def events(
        self, t: float, y: FloatArray, dy: FloatArray, locks: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return event functions (m,) and their rates (m,) along dy, 1/s, both oriented."""
        h, rates = np.zeros((2, self.system.n_guards))
        if self.system.guards is not None:
            self.system.guards.function(t, y, dy, self.mode(locks), self.params, h, rates)
        return self.orientation * h, self.orientation * rates

    def crossed(self, t: float, y: FloatArray, locks: IntArray) -> IntArray:
        """Return the guards that are locked as not crossed, although h >= 0 (candidates)."""
        h, _ = self.events(t, y, np.zeros(self.system.n_states), locks)
        return np.flatnonzero((locks < 0) & (h >= 0.0))

    def first_locks(self, t: float, y: FloatArray) -> IntArray:
        """Return the locks at a start: the sign of h, or where h = 0 that of its rate.

        By the sign alone a guard at zero would be neither before its event nor after it. A guard
        that rests at zero counts as not crossed.
        """
        before = -np.ones(self.system.n_guards, dtype=np.int64)
        h, _ = self.events(t, y, np.zeros(self.system.n_states), before)
        locks = np.where(h > 0.0, 1, before)
        if (h == 0.0).any():
            _, rates = self.events(t, y, self.slope(t, y, locks), locks)
            locks[(h == 0.0) & (rates > 0.0)] = 1
        return locks


def region_of(
    system: System, params: ArrayLike = (), *, orientation: Sequence[int] | None = None
) -> Region:
    """Return the region of a system in which its guards are crossed in the given directions.

    Parameters
    ----------
    system : System
        A system without a handler: the printed method knows no resets.
    params : (p,) array_like
        Numbers handed to its functions.
    orientation : sequence of int, optional
        For each guard +1 if its event function rises, -1 if it falls. By default all rise.

    Raises
    ------
    ValueError
        If the system has a handler, or no one function for all guards, or if `orientation` is
        not one sign a guard.
    """
    if system.n_guards > 0 and system.guards is None:
        raise ValueError("system: expected all event functions in one function, @guards")
    if system.on_event is not None:
        raise ValueError("system: the printed method does not call on_event; use hybrid.solve")
    signs = (1,) * system.n_guards if orientation is None else tuple(orientation)
    if len(signs) != system.n_guards or not set(signs) <= {-1, 1}:
        raise ValueError(f"orientation: expected {system.n_guards} times -1 or +1, found {signs}")
    numbers = np.array(params, dtype=np.float64).ravel()
    return Region(system, numbers, np.array(signs, dtype=np.int64))
