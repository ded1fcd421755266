"""What every peer offers: named solvers that take a tolerance and give something to run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Run = Callable[[], FloatArray]

# Where only the nearest guard is watched, an event is placed this far behind the surface, so that
# the guard which has just flipped starts on the right side of zero. It moves an instant by this
# over the speed of crossing: nothing beside the errors that are compared.
HYSTERESIS = 1e-14
MOST_EVENTS = 10_000
TOLERANCES = tuple(10.0**-k for k in range(4, 14))


@dataclass(frozen=True)
class Solver:
    """One way to integrate a scene.

    Parameters
    ----------
    package : str
        What it belongs to; "hopdata" is ours.
    way : str
        How the package is used: what its user functions are, or who calls it.
    method : str
        The integration method.
    prepare : callable
        Takes the tolerance (relative and absolute) and returns a function that integrates the
        scene once and returns the final state; all that can be done beforehand is done in it.
    trajectories : int
        How often one call of that function integrates the scene.
    settings : tuple of float
        What to prepare it for: tolerances, or time steps where it has no tolerance.
    """

    package: str
    way: str
    method: str
    prepare: Callable[[float], Run]
    trajectories: int = 1
    settings: tuple[float, ...] = TOLERANCES


class LostEventError(RuntimeError):
    """An integration did not come to its end."""
