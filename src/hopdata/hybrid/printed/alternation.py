"""A rhythmic system as two one-shot regions in turn, parted by a velocity's sign (Algorithm 7)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.arguments import check_shape
from hopdata.hybrid.printed.classical import ClassicalSolver, Stop
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region
from hopdata.hybrid.printed.supervisor import PrintedSolution, event_log, integrate
from hopdata.hybrid.solution import EventLog, FloatArray


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
