"""One event-selected region of a system: field and guards with the locks held.

In it, every event function rises through zero at most once. The lock b_k of guard k is
-1 before its event and +1 after it (discontinuity locking, section 4.3.1).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.system import System

Slope = Callable[[float, FloatArray], FloatArray]


@dataclass(frozen=True)
class Region:
    """A system near one corner of its guards.

    Parameters
    ----------
    system : System
        Its field and guards are called as plain Python.
    params : (p,) array
        Parameters passed to them.
    orientation : (m,) array of int
        +1 if the event function of the region is h_k, -1 if it is -h_k because h_k
        falls.
    own_modes : (e,) array of int
        The scene's own integers in the mode, which follow the locks.
    """

    system: System
    params: FloatArray
    orientation: IntArray
    own_modes: IntArray

    def turned(self, orientation: IntArray) -> Region:
        """Return the region of the same system with another orientation (m,)."""
        return replace(self, orientation=orientation)

    def with_modes(self, own_modes: IntArray) -> Region:
        """Return the region of the same system with other own modes (e,)."""
        return replace(self, own_modes=own_modes)

    def mode(self, locks: IntArray) -> IntArray:
        """Return the system's mode for the region's locks."""
        mode = np.zeros(self.system.n_modes, dtype=np.int64)
        mode[: self.system.n_guards] = self.orientation * locks
        mode[self.system.n_guards :] = self.own_modes
        return mode

    def slope(self, t: float, y: FloatArray, locks: IntArray) -> FloatArray:
        """Return the field (n,) with the locks held."""
        return self.slope_in(locks)(t, y)

    def slope_in(self, locks: IntArray) -> Slope:
        """Return the field with these locks held, as a function of time and state."""
        mode = self.mode(locks)
        field = self.system.field.function

        def slope(t: float, y: FloatArray) -> FloatArray:
            dy = np.zeros(len(y))
            field(t, y, mode, self.params, dy)
            return dy

        return slope

    def events(
        self, t: float, y: FloatArray, dy: FloatArray, locks: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return event functions (m,) and rates (m,) along dy, 1/s, both oriented.

        The rates are those of ``dot(Dh, f)`` in Algorithm 6; the system's guards give
        them without the matrix Dh.
        """
        h = np.zeros(self.system.n_guards)
        rates = np.zeros(self.system.n_guards)
        if self.system.guards is not None:
            mode = self.mode(locks)
            self.system.guards.function(t, y, dy, mode, self.params, h, rates)
        return self.orientation * h, self.orientation * rates

    def heights(self, t: float, y: FloatArray, locks: IntArray) -> FloatArray:
        """Return the event functions (m,), oriented."""
        h, _ = self.events(t, y, np.zeros(self.system.n_states), locks)
        return h

    def crossed(self, t: float, y: FloatArray, locks: IntArray) -> IntArray:
        """Return the candidates: guards with h >= 0 that are locked as not crossed."""
        h = self.heights(t, y, locks)
        return np.flatnonzero((locks < 0) & (h >= 0.0))

    def signs(self, t: float, y: FloatArray) -> IntArray:
        """Return the signs of the event functions (m,), 0 where one is exactly zero."""
        before = -np.ones(self.system.n_guards, dtype=np.int64)
        return np.sign(self.heights(t, y, before)).astype(np.int64)

    def first_locks(self, t: float, y: FloatArray) -> IntArray:
        """Return the locks at a start: the sign of h, or the sign of its rate if h = 0.

        By the sign of h alone, a guard at zero would be neither before its event nor
        after it. A guard that rests at zero counts as not crossed.
        """
        signs = self.signs(t, y)
        locks = np.where(signs > 0, 1, -1).astype(np.int64)
        at_zero = signs == 0
        if at_zero.any():
            _, rates = self.events(t, y, self.slope(t, y, locks), locks)
            locks[at_zero & (rates > 0.0)] = 1
        return locks


def region_of(
    system: System, params: ArrayLike = (), *, orientation: Sequence[int] | None = None
) -> Region:
    """Return the region in which a system's guards are crossed in given directions.

    Parameters
    ----------
    system : System
        A system without a handler, because the printed method has no resets.
    params : (p,) array_like
        Parameters passed to its functions.
    orientation : sequence of int, optional
        +1 for each guard whose event function rises, -1 for each that falls. By default
        all rise.

    Raises
    ------
    ArgumentError
        If the system has a handler or has no single function for all guards, or if
        `orientation` is not one sign per guard.
    """
    wanted = "no on_event, which the printed method does not call (use hybrid.solve)"
    expect(system.on_event is None, "system", wanted, "one")
    return region_with_handler(system, params, orientation=orientation)


def region_with_handler(
    system: System, params: ArrayLike = (), *, orientation: Sequence[int] | None = None
) -> Region:
    """Return a region as `region_of` does, of a system that may have a handler.

    The caller calls the handler between one region and the next. The scene's own
    integers in the mode are 0.
    """
    one_function = system.n_guards == 0 or system.guards is not None
    wanted = "all event functions in one function, @guards"
    expect(one_function, "system", wanted, "each one by itself")
    signs = (1,) * system.n_guards
    if orientation is not None:
        signs = tuple(orientation)
    are_signs = len(signs) == system.n_guards and set(signs) <= {-1, 1}
    expect(are_signs, "orientation", f"{system.n_guards} times -1 or +1", signs)
    numbers = np.array(params, dtype=np.float64).ravel()
    own_modes = np.zeros(system.n_extra_modes, dtype=np.int64)
    return Region(system, numbers, np.array(signs, dtype=np.int64), own_modes)
