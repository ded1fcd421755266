"""The hopper pushing a board along the floor: a drag by Coulomb friction while it stands.

The board of the dissertation's Sec. 3.5 (Fig. 3.7) lies in the way and is pushed along. Here it has
no inertia: while a leg is in contact, it holds the chassis back at its centre of mass with a force
that is constant but for slow motion, and only against motion into the board. Each leg in contact
brings its share of the force, so that forces stay additive over the legs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import ConfigError
from hopdata.hybrid import System, field
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.hopper import fill_rates, hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.legs import total_wrench
from hopdata.scenes.rigid_body import rotation_entries

FloatArray = NDArray[np.float64]
ModeArray = NDArray[np.int64]

# They follow the legs' numbers at the end of the parameters.
DRAG, DIRECTION_X, DIRECTION_Y = -3, -2, -1


@dataclass(frozen=True, kw_only=True)
class HopperDrag:
    """A board that is being pushed.

    Parameters
    ----------
    drag_n : float
        Force of its friction, N, when all legs are in contact.
    direction : (x, y)
        Unit vector, world frame: the way into the board.
    """

    drag_n: float
    direction: tuple[float, float]

    def __post_init__(self) -> None:
        if not self.drag_n >= 0:
            raise ConfigError(f"obstacle.drag_n: expected >= 0, found {self.drag_n}")

    def system(self, n_legs: int) -> System:
        """Return `drag_system` with this number of legs."""
        return drag_system(n_legs)

    def vector(self, hopper: HopperParameters, preloads_n: FloatArray | None = None) -> FloatArray:
        """Flat parameter vector: the hopper's, then force and direction."""
        return np.append(hopper.vector(preloads_n), [self.drag_n, *self.direction])


@field
def drag_field(t: float, y: FloatArray, mode: ModeArray, p: FloatArray, dy: FloatArray) -> None:
    """Fill `dy` with the rate of the state, held back by the board."""
    rot = rotation_entries(y[3], y[4], y[5])
    force, torque = total_wrench(y, mode, rot, p)
    n, standing = int(p[hp.N_LEGS]), 0
    for leg in range(n):
        standing += mode[leg] > 0
    ux, uy = p[DIRECTION_X], p[DIRECTION_Y]
    into = max(y[6] * ux + y[7] * uy, 0.0)
    drag = -p[DRAG] * standing / n * into / math.sqrt(into * into + p[hp.SLIP_VELOCITY] ** 2)
    fx, fy = drag * ux, drag * uy
    held = (
        force[0] + rot[0] * fx + rot[3] * fy,
        force[1] + rot[1] * fx + rot[4] * fy,
        force[2] + rot[2] * fx + rot[5] * fy,
    )
    fill_rates(t, y, rot, (held, torque), p, dy)


@cache
def drag_system(n_legs: int = 3) -> System:
    """Return the hopper with a board as a hybrid system; otherwise as `hopper_system`."""
    return replace(hopper_system(n_legs), field=drag_field)
