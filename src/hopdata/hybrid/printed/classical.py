"""The classical solver that the printed method wraps: it goes on until it is told to stop.

Any function that fits `ClassicalSolver` will do. `Stepping` makes one of a class that steps in the
vocabulary of `scipy.integrate.OdeSolver`: our own `Dopri5`, or scipy's RK45, DOP853, Radau, LSODA.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from hopdata.hybrid.solution import FloatArray

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
