"""The integrator around a classical solver: run, stop at a change of sign, resolve, run on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import check_shape
from hopdata.hybrid.printed.classical import (
    ClassicalSolver,
    Mesh,
    PrintedOptions,
    Region,
    Stepping,
    Stop,
)
from hopdata.hybrid.printed.contacts import Crossing, Resolution, resolve_contacts
from hopdata.hybrid.solution import EventLog


@dataclass(frozen=True)
class PrintedSolution:
    """A trajectory, in the words of `hopdata.hybrid.Solution`.

    Parameters
    ----------
    t : (N,) array
        Times of the mesh, s; an event's instant is a point of it.
    y : (n, N) array
        States there.
    events : EventLog
        All events.
    mode : (m,) array of int
        Mode at the end.
    """

    t: FloatArray
    y: FloatArray
    events: EventLog
    mode: IntArray

    @property
    def t_end(self) -> float:
        """Time reached, s."""
        return float(self.t[-1])

    @property
    def y_end(self) -> FloatArray:
        """State reached, (n,)."""
        return self.y[:, -1]


def integrate(
    region: Region,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
    ended: Stop | None = None,
) -> PrintedSolution:
    """Integrate within one region, in which each guard is crossed at most once (section 4.3).

    Parameters
    ----------
    region : Region
        Field and event functions, from `region_of`.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    solver : ClassicalSolver, optional
        By default `Stepping` of scipy's `RK45`. Give a `max_step`: a sign that changes twice
        between two points of the mesh is not seen, and the step after an event has no error
        control.
    options : PrintedOptions, optional
        Choices within the method.
    ended : callable, optional
        ``ended(t, y) -> bool``: stop at the first mesh point after the start where it holds.

    Returns
    -------
    PrintedSolution
        Mesh and events.

    Raises
    ------
    ArithmeticError
        If the classical solver fails, or returns without having advanced.
    """
    if solver is None:
        from scipy.integrate import RK45

        solver = Stepping(RK45)
    t_start = float(t_span[0])
    y = check_shape("y0", y0, region.system.n_states)
    locks, t, t_end = region.first_locks(t_start, y), t_start, float(t_span[1])
    meshes, done = [Mesh(np.array([t]), y[None])], False
    crossings: list[Crossing] = []
    while t < t_end and not done:
        leg, resolved = _one_leg(region, solver, t, y, t_end, locks, options, ended)
        meshes.append(leg)
        crossings.extend(resolved.crossings)
        t, y, locks = float(leg.t[-1]), leg.y[-1], resolved.locks
        done = ended is not None and ended(t, y)
    joined = Mesh(*(np.concatenate([getattr(m, part) for m in meshes]) for part in ("t", "y")))
    log = event_log(region, crossings)
    return PrintedSolution(joined.t, joined.y.T.copy(), log, region.mode(locks))


def _one_leg(
    region: Region,
    solver: ClassicalSolver,
    t: float,
    y: FloatArray,
    t_end: float,
    locks: IntArray,
    options: PrintedOptions | None,
    ended: Stop | None,
) -> tuple[Mesh, Resolution]:
    """Run the solver in one mode until it stops, and resolve its last step; without the start."""

    def stop(time: float, state: FloatArray) -> bool:
        crossed = len(region.crossed(time, state, locks)) > 0
        return crossed or (ended is not None and ended(time, state))

    mesh = solver(region.slope_in(locks), t, y, t_end, stop)
    if len(mesh.t) < 2 or not mesh.t[-1] > t:
        raise ArithmeticError(f"the classical solver did not advance from t = {t}")
    if len(region.crossed(mesh.t[-1], mesh.y[-1], locks)) == 0:
        return Mesh(mesh.t[1:], mesh.y[1:]), Resolution(mesh.y[-1], locks, ())
    (t0, t1), (y0, y1) = mesh.t[-2:], mesh.y[-2:]
    resolved = resolve_contacts(region, float(t0), y0, float(t1), y1, locks, options)
    times = [*mesh.t[1:-1], *(one.time for one in resolved.crossings), t1]
    states = [*mesh.y[1:-1], *(one.state for one in resolved.crossings), resolved.y]
    return Mesh(np.array(times), np.array(states)), resolved


def event_log(region: Region, crossings: Sequence[Crossing]) -> EventLog:
    """Return crossings as the library's log of events; nothing is reset, so before is after."""
    guards = np.array([one.guard for one in crossings], dtype=np.int64)
    states = np.array([one.state for one in crossings]).reshape(-1, region.system.n_states)
    modes = np.array([region.mode(one.locks) for one in crossings], dtype=np.int64)
    return EventLog.of_columns(
        time=np.array([one.time for one in crossings]),
        guard=guards,
        direction=region.orientation[guards],
        before=states,
        after=states.copy(),
        mode=modes.reshape(-1, region.system.n_modes),
        guard_names=region.system.guard_names,
    )


# A rhythmic system as two one-shot regions in turn, parted by a velocity's sign (Algorithm 7).


def integrate_alternating(
    falling: Region,
    rising: Region,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    velocity: int = 1,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
) -> PrintedSolution:
    """Integrate a hopper by its touchdown and take-off regions, one after the other.

    A region is left at the first mesh point where the velocity no longer has the sign it began
    with; from rest, that sign is the acceleration's. As the test is made on the mesh alone, a step
    long enough to hold apex and touchdown loses the touchdown: bound it by the solver's max_step.

    Parameters
    ----------
    falling, rising : Region
        For negative and positive velocity, of one system: a guard that is crossed in both
        directions has opposite orientations in them.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    velocity : int
        Number of the component whose sign parts the regions.
    solver, options
        As for `integrate`.

    Returns
    -------
    PrintedSolution
        Mesh and events of all regions, one after the other.
    """
    t, t_end = float(t_span[0]), float(t_span[1])
    y = check_shape("y0", y0, falling.system.n_states)
    parts = [_at_rest(falling, t, y)]
    while t < t_end:
        sign = heading(falling, t, y, velocity)
        region, ended = rising if sign > 0 else falling, turned(sign, velocity)
        part = integrate(region, (t, t_end), y, solver=solver, options=options, ended=ended)
        parts.append(replace(part, t=part.t[1:], y=part.y[:, 1:]))
        t, y = part.t_end, part.y_end
    return _joined(parts)


def heading(region: Region, t: float, y: FloatArray, velocity: int) -> int:
    """Return the sign of a velocity, at rest that of the acceleration; +1 where both are zero."""
    value = y[velocity]
    if value == 0.0:
        value = region.slope(t, y, region.first_locks(t, y))[velocity]
    return -1 if value < 0.0 else 1


def turned(sign: int, velocity: int) -> Stop:
    """Return the test whether a velocity has lost its sign."""
    return lambda _, y: bool(sign * y[velocity] <= 0.0)


def _at_rest(region: Region, t: float, y: FloatArray) -> PrintedSolution:
    mode = region.mode(region.first_locks(t, y))
    return PrintedSolution(np.array([t]), y[:, None].copy(), event_log(region, ()), mode)


def _joined(parts: list[PrintedSolution]) -> PrintedSolution:
    first = parts[0].events
    records = np.concatenate([part.events.records for part in parts])
    return PrintedSolution(
        t=np.concatenate([part.t for part in parts]),
        y=np.concatenate([part.y for part in parts], axis=1),
        events=EventLog(records, first.n_states, first.guard_names),
        mode=parts[-1].mode,
    )
