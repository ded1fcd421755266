"""The classical solver that the printed method wraps: it goes on until it is told to stop.

Any function that fits `ClassicalSolver` will do. `Stepping` makes one of a class that steps in the
vocabulary of `scipy.integrate.OdeSolver`: RK45 (Dormand and Prince's pair, the solver of section
4.4.1), DOP853, Radau, LSODA.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.system import System

Slope = Callable[[float, FloatArray], FloatArray]
Stop = Callable[[float, FloatArray], bool]


@dataclass(frozen=True)
class Mesh:
    """Points of a trajectory: times (N,), s, and states (N, n); the first is where it started."""

    t: FloatArray
    y: FloatArray


class ClassicalSolver(Protocol):
    """Integrate `slope` from (t, y) to `t_end`, or to the first mesh point where `stop` holds.

    The start itself is not tested. At least one step is taken, and the method behind it should be
    of third order or higher.
    """

    def __call__(self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop) -> Mesh:
        """Return the mesh, its start included."""


class Stepper(Protocol):
    """What `Stepping` uses of `scipy.integrate.OdeSolver`."""

    t: float
    y: FloatArray
    status: str

    def step(self) -> str | None:
        """Take one step; `status` becomes "finished" at the end of the span, or "failed"."""


@dataclass(frozen=True)
class Stepping:
    """A classical solver made of a class of steppers.

    Parameters
    ----------
    kind : callable
        Called as ``kind(slope, t, y, t_end, **options)``, it returns a `Stepper`.
    options : mapping
        Such as rtol, atol, max_step and first_step; the last is cut where less time is left.
    """

    kind: Callable[..., Stepper]
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop) -> Mesh:
        """Step until `stop` holds or the time is up; raise ArithmeticError if a step fails."""

        def rates(time: float, state: FloatArray) -> FloatArray:
            rate = slope(time, state)
            if not np.isfinite(rate).all():  # a step size of NaN would be tried for ever
                raise ArithmeticError(f"the classical solver failed at t = {time}: not finite")
            return rate

        stepper = self.kind(rates, t, y, t_end, **self._within(t_end - t))
        times, states = [t], [y]
        while stepper.status == "running":
            message = stepper.step()
            if stepper.status == "failed":
                raise ArithmeticError(f"the classical solver failed at t = {stepper.t}: {message}")
            times.append(float(stepper.t))
            states.append(np.array(stepper.y, dtype=np.float64))
            if stop(times[-1], states[-1]):
                break
        return Mesh(np.array(times), np.array(states))

    def _within(self, left: float) -> Mapping[str, Any]:
        first = self.options.get("first_step")
        return self.options if first is None else {**self.options, "first_step": min(first, left)}


# What may be chosen in the printed method.

ROOT_FINDERS = ("illinois", "cubic")


@dataclass(frozen=True)
class PrintedOptions:
    """Choices within Algorithms 5 and 6.

    Parameters
    ----------
    root_finder : str
        Root of a Hermite spline: ``"illinois"``, as section 4.3.3 recommends, or ``"cubic"``, the
        closed form that section 4.4.1 says was used.
    refresh_slopes : bool
        Whether the slopes at both ends of the step are evaluated again after each crossing.
        False is Algorithm 5 to the letter, which sets them once: the state at every later event
        of the step is then interpolated with slopes of a mode that has ended. For the record only.
    """

    root_finder: str = "illinois"
    refresh_slopes: bool = True

    def __post_init__(self) -> None:
        if self.root_finder not in ROOT_FINDERS:
            raise ValueError(
                f"root_finder: expected one of {', '.join(ROOT_FINDERS)}, found {self.root_finder}"
            )


# One event-selected region of a system: every event function rises through zero, once.


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
