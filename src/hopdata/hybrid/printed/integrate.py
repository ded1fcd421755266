"""The loop around a classical solver: it runs to a change of sign, which is resolved.

`integrate` stays within one event-selected region, in which each guard is crossed once
(section 4.3). Rhythmic systems chain regions: `hopdata.hybrid.printed.alternate`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import check_shape
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region
from hopdata.hybrid.printed.resolution import Resolution, resolve_contacts
from hopdata.hybrid.printed.solvers import (
    ClassicalSolver,
    EventFunction,
    Mesh,
    Stepping,
)
from hopdata.hybrid.printed.trajectory import Leg, PrintedSolution, Trail

Ended = Callable[[float, FloatArray], bool]


@dataclass(frozen=True)
class RegionStop:
    """Where a classical solver stops: a guard changed sign, or the region ended.

    It fits `hopdata.hybrid.printed.solvers.Stop`.
    """

    region: Region
    locks: IntArray
    ended: Ended | None = None

    def __call__(self, t: float, y: FloatArray) -> bool:
        """Return whether the solver stops at this point of its mesh."""
        crossed = len(self.region.crossed(t, y, self.locks)) > 0
        return crossed or self.has_ended(t, y)

    def has_ended(self, t: float, y: FloatArray) -> bool:
        """Return whether the region has ended."""
        return self.ended is not None and self.ended(t, y)

    @property
    def events(self) -> Sequence[EventFunction]:
        """Event functions of the guards that are not crossed yet, and of the end."""
        functions = [self._height(int(k)) for k in np.flatnonzero(self.locks < 0)]
        if self.ended is not None:
            functions.append(self._end)
        return functions

    def _height(self, k: int) -> EventFunction:
        def height(t: float, y: FloatArray) -> float:
            return float(self.region.heights(t, y, self.locks)[k])

        return height

    def _end(self, t: float, y: FloatArray) -> float:
        if self.has_ended(t, y):
            return 1.0
        return -1.0


def integrate(
    region: Region,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
    ended: Ended | None = None,
) -> PrintedSolution:
    """Integrate within one region, in which each guard is crossed at most once.

    Parameters
    ----------
    region : Region
        Field and event functions, from `region_of`.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    solver : ClassicalSolver, optional
        By default `Stepping` with scipy's `RK45`. Set a `max_step`: a sign that changes
        twice between two mesh points goes unnoticed, and the step after an event has no
        error control (but see `PrintedOptions.tail`).
    options : PrintedOptions, optional
        Choices within the method.
    ended : callable, optional
        ``ended(t, y) -> bool``: stop at the first mesh point after the start where it
        is true.

    Returns
    -------
    PrintedSolution
        Mesh and events.

    Raises
    ------
    ArithmeticError
        If the classical solver fails, or returns without having advanced.
    """
    if options is None:
        options = PrintedOptions()
    if solver is None:
        solver = default_solver()
    t_start = float(t_span[0])
    t_end = float(t_span[1])
    y = check_shape("y0", y0, region.system.n_states)
    start = Mesh(np.array([t_start]), y[None])
    trail = Trail(region.system, [start])
    locks = run_region(trail, region, (t_start, t_end), solver, options, ended)
    return trail.solution(region.mode(locks))


def run_region(
    trail: Trail,
    region: Region,
    span: tuple[float, float],
    solver: ClassicalSolver,
    options: PrintedOptions,
    ended: Ended | None,
) -> IntArray:
    """Append what happens in one region to a trail; return the locks at its end."""
    t, t_end = span
    y = trail.legs[-1].y[-1]
    locks = locks_at(region, t, y, options)
    done = False
    while t < t_end and not done:
        stop = RegionStop(region, locks, ended)
        leg, resolved = one_leg(stop, solver, t, y, t_end, options)
        trail.add(leg, region, locks)
        t = resolved.t
        y = resolved.y
        locks = resolved.locks
        if not options.keep_locks:
            locks = region.signs(t, y)
        done = stop.has_ended(t, y)
    return locks


def default_solver() -> ClassicalSolver:
    """Return the classical solver of section 4.4.1: Dormand and Prince's, of SciPy."""
    from scipy.integrate import RK45

    return Stepping(RK45)


def locks_at(
    region: Region, t: float, y: FloatArray, options: PrintedOptions
) -> IntArray:
    """Return the locks (m,) at a start, by rates too or, as printed, by signs alone."""
    if options.keep_locks:
        return region.first_locks(t, y)
    return region.signs(t, y)


class Asked:
    """A stop that knows up to when a solver has asked it."""

    def __init__(self, stop: RegionStop) -> None:
        self.stop = stop
        self.last_t = -np.inf

    @property
    def events(self) -> Sequence[EventFunction]:
        """Event functions of the guards that are not crossed yet, and of the end."""
        return self.stop.events

    def __call__(self, t: float, y: FloatArray) -> bool:
        """Return whether the solver stops at this point of its mesh."""
        self.last_t = max(self.last_t, t)
        return self.stop(t, y)


def require_stopped(mesh: Mesh, stop: RegionStop) -> None:
    """Refuse a mesh that goes on after a point at which the solver had to stop.

    A solver that does not ask loses all events but those of its last step.
    """
    inner = zip(mesh.t[1:-1].tolist(), mesh.y[1:-1], strict=True)
    for t, y in inner:
        if stop(t, y):
            raise ArithmeticError(
                f"the classical solver went on after t = {t}, where it had to stop:"
                " expected the first point of its mesh at which `stop(t, y)` is true"
            )


def one_leg(
    stop: RegionStop,
    solver: ClassicalSolver,
    t: float,
    y: FloatArray,
    t_end: float,
    options: PrintedOptions,
) -> tuple[Leg, Resolution]:
    """Run the solver in one mode until it stops, and resolve its last step.

    Returns
    -------
    leg : Leg
        The points after the start, with the instants of events.
    resolved : Resolution
        Where the leg ends.

    Raises
    ------
    ArithmeticError
        If the solver fails, returns without having advanced, or goes past a point of
        its mesh at which it should have stopped.
    """
    region = stop.region
    locks = stop.locks
    asked = Asked(stop)
    mesh = solver(region.slope_in(locks), t, y, t_end, asked)
    if len(mesh.t) < 2 or not mesh.t[-1] > t:
        raise ArithmeticError(f"the classical solver did not advance from t = {t}")
    if asked.last_t < mesh.t[-1]:
        require_stopped(mesh, stop)
    t0, t1 = mesh.t[-2:].tolist()
    y0, y1 = mesh.y[-2:]
    if len(region.crossed(t1, y1, locks)) == 0:
        # Nothing was crossed: the leg ends at the end of the span or of the region.
        leg = Leg(Mesh(mesh.t[1:], mesh.y[1:]))
        return leg, Resolution(t1, y1, locks, ())
    resolved = resolve_contacts(region, t0, y0, t1, y1, locks, options)
    # In place of the last point, which lies beyond the events, stand the events.
    times = list(mesh.t[1:-1])
    states = list(mesh.y[1:-1])
    for crossing in resolved.crossings:
        times.append(crossing.time)
        states.append(crossing.state)
    n_behind = len(resolved.crossings) - 1
    if options.tail == "heun":
        times.append(resolved.t)
        states.append(resolved.y)
        n_behind += 1
    whole = Mesh(np.array(times), np.array(states))
    return Leg(whole, resolved.crossings, n_behind), resolved
