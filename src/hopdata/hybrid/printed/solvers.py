"""Classical solvers, which the printed method wraps (contribution 1.3.5).

Any function that fits `ClassicalSolver` can serve. Three makers are here: `Stepping`,
from a class with the interface of `scipy.integrate.OdeSolver` (RK45 is Dormand and
Prince's pair, the solver of section 4.4.1); `Ivp`, from `scipy.integrate.solve_ivp` and
its events; `FixedSteps`, from a function that makes one step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.printed.region import Slope

EventFunction = Callable[[float, FloatArray], float]


@dataclass(frozen=True)
class Mesh:
    """Points of a trajectory: times (N,), s, and states (N, n)."""

    t: FloatArray
    y: FloatArray


class Stop(Protocol):
    """What a classical solver watches while the locks are held."""

    def __call__(self, t: float, y: FloatArray, /) -> bool:
        """Return whether an event function has changed its sign, or the region ends."""
        ...

    @property
    def events(self) -> Sequence[EventFunction]:
        """Functions of time and state that are negative until `stop` holds.

        For solvers with an event detection of their own.
        """
        ...


class ClassicalSolver(Protocol):
    """Integrate `slope` from (t, y) to `t_end`, or until `stop` holds at a mesh point.

    The start itself is not tested. The solver takes at least one step, and its method
    should be of third order or higher.
    """

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop, /
    ) -> Mesh:
        """Return the mesh, including its start."""
        ...


class Stepper(Protocol):
    """The part of `scipy.integrate.OdeSolver` that `Stepping` uses."""

    t: float
    y: FloatArray
    status: str

    def step(self) -> str | None:
        """Take one step; `status` becomes "finished" at the end, or "failed"."""


@dataclass(frozen=True)
class Stepping:
    """A classical solver made of a class of steppers.

    Parameters
    ----------
    kind : callable
        Called as ``kind(slope, t, y, t_end, **options)``, it returns a `Stepper`.
    options : mapping
        Options such as rtol, atol, max_step and first_step; the last is shortened if
        less time is left.
    """

    kind: Callable[..., Stepper]
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop
    ) -> Mesh:
        """Step until `stop` holds or the time is up.

        Raises
        ------
        ArithmeticError
            If a step fails.
        """
        options = within(self.options, t_end - t)
        stepper = self.kind(finite(slope), t, y, t_end, **options)
        times = [t]
        states = [y]
        while stepper.status == "running":
            message = stepper.step()
            if stepper.status == "failed":
                raise failed(stepper.t, str(message))
            times.append(float(stepper.t))
            states.append(np.array(stepper.y, dtype=np.float64))
            if stop(times[-1], states[-1]):
                break
        return Mesh(np.array(times), np.array(states))


@dataclass(frozen=True)
class Ivp:
    """`scipy.integrate.solve_ivp` as a classical solver, with its own event detection.

    It stops at the first event that solve_ivp finds. The printed method needs a point
    of the mesh on each side: the one before is the last that solve_ivp stepped to, the
    one behind is as far from the event, with the locks still held. Then it is Algorithm
    5 that localises, and not solve_ivp.

    Parameters
    ----------
    options : mapping
        Options of solve_ivp, such as method, rtol, atol and max_step.
    """

    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop
    ) -> Mesh:
        """Solve until an event or to the end.

        Raises
        ------
        ArithmeticError
            If solve_ivp fails.
        """
        events = [_terminal(one) for one in stop.events]
        found = self._solved(slope, t, y, t_end, events)
        times, states = found.t, found.y.T
        if found.status == 0:
            return Mesh(times, states)
        instant = float(times[-1])
        ahead = min(instant - float(times[-2]), t_end - instant)
        while ahead > np.spacing(instant):
            behind = instant + ahead
            beyond = self._solved(slope, instant, states[-1], behind, [])
            state = beyond.y[:, -1]
            if stop(behind, state):
                times = np.append(times[:-1], behind)
                return Mesh(times, np.vstack([states[:-1], state]))
            # The event is undone again before that.
            ahead *= 0.5
        return Mesh(times, states)

    def _solved(
        self,
        slope: Slope,
        t: float,
        y: FloatArray,
        t_end: float,
        events: list[EventFunction],
    ) -> Any:
        from scipy.integrate import solve_ivp

        options = within(self.options, t_end - t)
        options = {**options, "events": events or None}
        found = solve_ivp(finite(slope), (t, t_end), y, **options)
        if found.status < 0:
            raise failed(float(found.t[-1]), found.message)
        return found


def _terminal(function: EventFunction) -> EventFunction:
    """Return an event function that ends solve_ivp where it rises through zero."""

    def event(t: float, y: FloatArray) -> float:
        return function(t, y)

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = 1.0  # type: ignore[attr-defined]
    return event


@dataclass(frozen=True)
class FixedSteps:
    """A classical solver that takes steps of one length.

    Parameters
    ----------
    one_step : callable
        ``one_step(slope, t, y, dt)`` returns the state (n,) after a step of length dt.
    length : float
        Length of a step, s; the last one is shortened.
    """

    one_step: Callable[[Slope, float, FloatArray, float], FloatArray]
    length: float

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop
    ) -> Mesh:
        """Step until `stop` holds or the time is up."""
        times = [t]
        states = [y]
        while times[-1] < t_end:
            before = times[-1]
            after = before + self.length
            # A rest of less than a rounding would be a step of length 0.
            if after >= t_end or t_end - after < np.spacing(t_end):
                after = t_end
            states.append(self.one_step(slope, before, states[-1], after - before))
            times.append(after)
            if stop(after, states[-1]):
                break
        return Mesh(np.array(times), np.array(states))


def within(options: Mapping[str, Any], left: float) -> Mapping[str, Any]:
    """Return the options with a first step that is not longer than the time left, s."""
    first = options.get("first_step")
    if first is None:
        return options
    return {**options, "first_step": min(first, left)}


def finite(slope: Slope) -> Slope:
    """Return the slope, with an error where it is not finite.

    Otherwise SciPy's steppers would retry a step size of NaN for ever.
    """

    def rates(t: float, y: FloatArray) -> FloatArray:
        rate = slope(t, y)
        if not np.isfinite(rate).all():
            raise failed(t, "not finite")
        return rate

    return rates


def failed(t: float, message: str) -> ArithmeticError:
    """Return the error of a classical solver that cannot go on."""
    return ArithmeticError(f"the classical solver failed at t = {t}: {message}")
