"""The classical solver that the printed method wraps: it goes on until it is told to stop.

Any function that fits `ClassicalSolver` will do. `Stepping` makes one of a class that steps in the
vocabulary of `scipy.integrate.OdeSolver`: our own `Dopri5`, or scipy's RK45, DOP853, Radau, LSODA.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.solution import FloatArray, IntArray
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
        stepper = self.kind(slope, t, y, t_end, **self._within(t_end - t))
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


# Dormand-Prince 5(4) in plain Python, one step at a time (the solver of section 4.4.1).
#
# Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, table II.5.2, and
# section II.4 for the control of the step size.

C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0)
A = (
    np.array([]),
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
)
B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0


def dopri5_step(
    slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return state and slope after a step whose first slope is f, and the estimated error, (n,)."""
    k = np.empty((7, len(y)))
    k[0] = f
    for stage in range(1, 6):
        k[stage] = slope(t + C[stage] * dt, y + dt * (A[stage] @ k[:stage]))
    end = y + dt * (B @ k[:6])
    k[6] = slope(t + dt, end)
    return end, k[6], dt * (E @ k)


class Dopri5:
    """Dormand-Prince 5(4) with error control, forwards in time.

    Parameters
    ----------
    fun : callable
        Field ``fun(t, y) -> (n,) array``.
    t0, t_bound : float
        Start and end, s.
    y0 : (n,) array
        State at the start.
    rtol, atol : float
        A step's error, component by component, against ``atol + rtol max(|y|)``: root mean square.
    max_step : float
        Longest step, s.
    first_step : float, optional
        First one, s. By default a guess from the slope and the tolerance.
    """

    def __init__(
        self,
        fun: Slope,
        t0: float,
        y0: FloatArray,
        t_bound: float,
        *,
        rtol: float = 1e-6,
        atol: float = 1e-9,
        max_step: float = math.inf,
        first_step: float | None = None,
    ) -> None:
        if not max_step > 0 or not (first_step is None or first_step > 0):
            raise ValueError(f"max_step, first_step: expected > 0, found {max_step}, {first_step}")
        self.t, self.y, self.t_bound = t0, np.array(y0, dtype=np.float64), t_bound
        self.status = "running" if t0 < t_bound else "finished"
        self._fun, self._rtol, self._atol, self._max_step = fun, rtol, atol, max_step
        self._slope = fun(t0, self.y)
        self._next = self._first_guess() if first_step is None else first_step

    def step(self) -> str | None:
        """Take one step that meets the tolerance; say why if there is none."""
        while True:
            dt = min(self._next, self._max_step)
            t = self.t + dt
            if not t < self.t_bound:
                t, dt = self.t_bound, self.t_bound - self.t
            if t <= self.t:
                self.status = "failed"
                return "the step fell below the spacing of floating-point times"
            end, slope, deviation = dopri5_step(self._fun, self.t, self.y, self._slope, dt)
            error = self._norm(deviation, end)
            self._next = dt * _factor(error)
            if error <= 1.0:
                break
        self.t, self.y, self._slope = t, end, slope
        if t >= self.t_bound:
            self.status = "finished"
        return None

    def _norm(self, deviation: FloatArray, end: FloatArray) -> float:
        scale = self._atol + self._rtol * np.maximum(np.abs(self.y), np.abs(end))
        return float(np.sqrt(np.mean((deviation / scale) ** 2)))

    def _first_guess(self) -> float:
        scale = self._atol + self._rtol * np.abs(self.y)
        size, speed = (float(np.max(np.abs(v) / scale)) for v in (self.y, self._slope))
        return 0.01 * size / speed if min(size, speed) > 1e-5 else 1e-6


def _factor(error: float) -> float:
    """Return by what the step may grow; an error that is not a number shrinks it most."""
    if not math.isfinite(error):
        return LEAST
    return MOST if error == 0.0 else min(MOST, max(LEAST, SAFETY * error**-0.2))


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
