"""Maps as tables, with cubic splines between the nodes: any map at the price of a look-up.

Models and the plant's true map both become tables.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.steering.models.process import TURN, input_rows

# What a controller asks of a model: frame changes of many hops at once.
#
# Conventions of all models: the frame change is (x, y, heading) in the frame of the first stance;
# m, m, rad. Angles in rad. The boom angle is periodic: a whole turn more gives the same frame
# change.

COMPONENTS = ("dx", "dy", "dtheta")


class FrameChangeMap(Protocol):
    """Frame change as a function of boom angle and swing."""

    def change(self, boom_angle: FloatArray, swing: FloatArray, /) -> FloatArray:
        """Return the frame changes (n, 3) of hops from boom angles (n,) by swings (n,)."""
        ...


BEYOND = 1e-3  # of the limit: room for differences at the bounds


@dataclass(frozen=True)
class TabulatedMap:
    """Frame changes by boom angle and swing on a grid; a `FrameChangeMap`.

    Parameters
    ----------
    values : (A, S, 3) array
        Frame changes, m, m, rad; boom angles evenly spaced over a turn from 0, swings from minus to
        plus the limit.
    swing_limit_rad : float
        The limit.
    """

    values: FloatArray
    swing_limit_rad: float

    @cached_property
    def _spline(self) -> Any:
        """Cubic spline of swing and angle: not-a-knot in the swing, periodic in the angle."""
        from scipy.interpolate import NdBSpline, make_interp_spline

        closed = np.concatenate([self.values, self.values[:1]])
        turn = np.append(self.boom_angle_rad, TURN)
        around = make_interp_spline(turn, closed, bc_type="periodic")
        across = make_interp_spline(self.swing_rad, around.c, axis=1)
        return NdBSpline((across.t, around.t), across.c, 3)

    @property
    def boom_angle_rad(self) -> FloatArray:
        """Nodes of the boom angle, (A,)."""
        return turn_nodes(len(self.values))

    @property
    def swing_rad(self) -> FloatArray:
        """Nodes of the swing, (S,)."""
        return np.linspace(-self.swing_limit_rad, self.swing_limit_rad, self.values.shape[1])

    def change(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the frame changes (n, 3) of hops with these inputs, (n,) each.

        Raises
        ------
        AnalysisError
            If a swing is beyond the limit.
        ValueError
            From scipy, if an axis has fewer than four nodes or the values are not all finite.
        """
        angles, swings = input_rows(boom_angle, swing)
        largest = float(np.abs(swings).max(initial=0.0))
        if not largest <= self.swing_limit_rad * (1 + BEYOND):
            wanted = f"swings within {self.swing_limit_rad:.4f} rad"
            raise AnalysisError.at("table", wanted, f"{largest:.4f}")
        return np.asarray(self._spline(np.stack([swings, angles % TURN], axis=-1)))


def tabulated(
    model: FrameChangeMap, swing_limit_rad: float, *, angles: int = 128, swings: int = 33
) -> TabulatedMap:
    """Tabulate a map of boom angle and swing."""
    grid = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    angle, swing = np.meshgrid(turn_nodes(angles), grid, indexing="ij")
    values = model.change(angle.ravel(), swing.ravel())
    return TabulatedMap(values.reshape(angles, swings, 3), swing_limit_rad)


def turn_nodes(number: int) -> FloatArray:
    """Angles evenly spaced over a turn from 0, its end left out, rad."""
    return TURN * np.arange(number) / number


# What a map misses, learned as it shows: a recursive regression, which forgets.

HARMONICS, DEGREE = 2, 2  # of the boom angle and of the swing, in the correction
FIRST_SD = 3.0  # of the constant of the correction, in standard deviations of a hop's chance
FALL_OFF = 0.5  # of that, with each harmonic and each degree
MEMORY_HOPS = 60.0  # in which a correction that is not seen again is forgotten
FARTHEST_SD = 8.0  # a hop that misses by more was disturbed, and counts as one that misses by this


class Correction:
    """What is added to a map: a Bayesian linear model, updated hop by hop (a Kalman filter).

    Its coefficients go back to zero, and their covariance to the first one, over `MEMORY_HOPS`
    hops: an Ornstein-Uhlenbeck prior. Memory and time of a hop are the same for ever.

    Parameters
    ----------
    swing_limit_rad : float
    noise : (3,) array
        Standard deviation of the chance of a hop, m, m, rad.
    """

    def __init__(self, swing_limit_rad: float, noise: FloatArray) -> None:
        self.swing_limit_rad, self.noise = swing_limit_rad, noise
        orders = np.add.outer(np.arange(DEGREE + 1), (np.arange(2 * HARMONICS + 1) + 1) // 2)
        self._first = np.diag((FIRST_SD * FALL_OFF ** orders.ravel()) ** 2)
        self.covariance = self._first.copy()  # (k, k), the same for all three
        self.coefficients = np.zeros((len(self._first), 3))  # in units of the noise

    def functions(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the functions at boom angles and swings (...), (..., k): waves times powers."""
        boom = np.asarray(boom_angle, dtype=float)
        turns = [wave(h * boom) for h in range(1, HARMONICS + 1) for wave in (np.cos, np.sin)]
        waves = np.stack([np.ones_like(boom), *turns], axis=-1)
        powers = (np.asarray(swing)[..., None] / self.swing_limit_rad) ** np.arange(DEGREE + 1)
        return np.asarray((powers[..., :, None] * waves[..., None, :]).reshape(*boom.shape, -1))

    def added(self, functions: FloatArray) -> FloatArray:
        """Return what is added, (..., 3), m, m, rad, where the functions (..., k) are these."""
        return np.asarray(functions @ self.coefficients * self.noise)

    def learn(self, boom_angle: float, swing: float, missed: FloatArray) -> None:
        """Take in by how much the map itself missed a hop, (3,)."""
        kept = np.exp(-1.0 / MEMORY_HOPS)
        self.coefficients *= kept
        self.covariance = kept**2 * self.covariance + (1 - kept**2) * self._first
        at = self.functions(boom_angle, swing)
        gain = self.covariance @ at
        spread = float(at @ gain) + 1.0
        surprise = missed / self.noise - at @ self.coefficients
        surprise = np.clip(surprise, -FARTHEST_SD * spread**0.5, FARTHEST_SD * spread**0.5)
        self.coefficients += np.outer(gain / spread, surprise)
        self.covariance -= np.outer(gain, gain) / spread
