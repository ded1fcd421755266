"""States between the mesh points of a printed trajectory (Definition 4.2.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.printed.spline import hermite
from hopdata.hybrid.printed.trajectory import PrintedSolution
from hopdata.hybrid.system import System


def states_at(
    solution: PrintedSolution,
    system: System,
    times_s: ArrayLike,
    *,
    params: ArrayLike = (),
) -> FloatArray:
    """Return the states at given times, by the cubic Hermite splines of the mesh.

    The slopes are those of the field in the mode that was held in the step. The error
    is that of the mesh, and a constant times the fourth power of the step.

    Parameters
    ----------
    solution : PrintedSolution
    system : System
        Whose solution it is.
    times_s : (K,) array_like
        Times within the solution, s.
    params : (p,) array_like
        Parameters passed to the field.

    Returns
    -------
    (K, n) array

    Raises
    ------
    ArgumentError
        If a time lies outside.
    """
    times = np.array(times_s, dtype=np.float64)
    numbers = np.array(params, dtype=np.float64).ravel()
    mesh = solution.t
    inside = bool(np.all((times >= mesh[0]) & (times <= mesh[-1])))
    expect(inside, "times_s", f"times from {mesh[0]:g} to {mesh[-1]:g} s", times)
    # The step that ends at or after the time.
    ends = np.clip(np.searchsorted(mesh, times), 1, len(mesh) - 1)
    states = np.empty((len(times), len(solution.y)))
    for row, (time, end) in enumerate(zip(times, ends, strict=True)):
        t0, t1 = (float(instant) for instant in mesh[end - 1 : end + 1])
        y0, y1 = solution.y[:, end - 1], solution.y[:, end]
        # Guards that are crossed together leave steps of no length.
        if time == t0:
            states[row] = y0
            continue
        mode = solution.step_modes[end - 1]
        f0, f1 = np.zeros((2, len(y0)))
        system.field.function(t0, y0, mode, numbers, f0)
        system.field.function(t1, y1, mode, numbers, f1)
        theta = (float(time) - t0) / (t1 - t0)
        states[row] = hermite(theta, y0, y1, f0, f1, t1 - t0)
    return states
