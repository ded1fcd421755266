"""Maps as tables with cubic splines between the nodes, as fast as a look-up.

Both models and the robot's true map are tabulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.stride_table import MARGIN, spline_of
from hopdata.steering.strides import TURN, StrideAxes, side_by_side, turn_nodes

# Conventions of all models: the frame change is (x, y, heading) in the frame of the
# first stance, in m, m, rad. Angles are in rad. The boom angle is periodic: adding a
# whole turn gives the same frame change.

COMPONENTS = ("dx", "dy", "dtheta")


class FrameChangeMap(Protocol):
    """Frame change as a function of state and inputs, of many strides at once.

    One state and one input may be arrays (n,), such as the hopper's boom angles and
    swings.
    """

    def change(self, state: FloatArray, inputs: FloatArray, /) -> FloatArray:
        """Return the frame changes (n, 3), by states (n, S) and inputs (n, U)."""
        ...


@dataclass(frozen=True)
class TabulatedMap:
    """Frame changes by boom angle and swing on a grid; a `FrameChangeMap`.

    Parameters
    ----------
    values : (A, S, 3) array
        Frame changes, m, m, rad; boom angles are evenly spaced over a turn from 0,
        swings from minus to plus the limit.
    swing_limit_rad : float
        Largest swing.
    """

    values: FloatArray
    swing_limit_rad: float

    @cached_property
    def _spline(self) -> Any:
        """Cubic spline: not-a-knot in the swing, periodic in the boom angle."""
        nodes = (self.boom_angle_rad, self.swing_rad)
        return spline_of(self.values, nodes, n_periodic=1)

    @property
    def spline_parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Knots of swing and boom angle, and coefficients (S', A', 3), of the spline.

        For code that is compiled.
        """
        of_swing, of_angle = self._spline.t
        return of_swing, of_angle, self._spline.c

    @cached_property
    def axes(self) -> StrideAxes:
        """Axes of the steered hopper with this limit."""
        return hopper_axes(self.swing_limit_rad)

    @property
    def boom_angle_rad(self) -> FloatArray:
        """Nodes of the boom angle, (A,)."""
        return turn_nodes(len(self.values))

    @property
    def swing_rad(self) -> FloatArray:
        """Nodes of the swing, (S,)."""
        return np.linspace(
            -self.swing_limit_rad, self.swing_limit_rad, self.values.shape[1]
        )

    def change(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the frame changes (n, 3) of hops with these inputs, each (n,).

        Raises
        ------
        AnalysisError
            If a swing is beyond the limit.
        ValueError
            From scipy, if an axis has fewer than four nodes or the values are not all
            finite.
        """
        angles, swings = side_by_side(boom_angle, swing, 1, 1).T
        largest = float(np.abs(swings).max(initial=0.0))
        if not largest <= self.swing_limit_rad * (1 + MARGIN):
            wanted = f"swings within {self.swing_limit_rad:.4f} rad"
            raise AnalysisError.at("table", wanted, f"{largest:.4f}")
        return np.asarray(self._spline(np.stack([swings, angles % TURN], axis=-1)))

    def table_within(self, limit: float) -> TabulatedMap:
        """Return the table up to another limit of the swing; itself if it is the same.

        A process has this, too.
        """
        return self if limit == self.swing_limit_rad else tabulated(self, limit)

    def next_state(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the boom angles (n, 1) after hops, in [0, 2 pi)."""
        angles, swings = side_by_side(boom_angle, swing, 1, 1).T
        return np.asarray((angles + swings) % TURN)[:, None]


def tabulated(
    model: FrameChangeMap,
    swing_limit_rad: float,
    *,
    angles: int = 128,
    swings: int = 33,
) -> TabulatedMap:
    """Tabulate a map of boom angle and swing."""
    grid = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    angle, swing = np.meshgrid(turn_nodes(angles), grid, indexing="ij")
    values = model.change(angle.ravel(), swing.ravel())
    return TabulatedMap(values.reshape(angles, swings, 3), swing_limit_rad)


# Errors of a map, learned as they appear: a recursive regression with forgetting.

#: Harmonics of the correction in the boom angle.
#: Unit: 1. Origin: chosen.
HARMONICS = 2
#: Degree of the correction in the swing.
#: Unit: 1. Origin: chosen.
DEGREE = 2
#: Prior deviation of the correction's constant, in deviations of a hop.
#: Unit: 1. Origin: chosen.
FIRST_SD = 3.0
#: Factor of the prior deviation with each harmonic and each degree.
#: Unit: 1. Origin: chosen.
FALL_OFF = 0.5
#: Number of hops after which an unconfirmed correction is forgotten.
#: Unit: hops. Origin: chosen.
MEMORY_HOPS = 60.0
#: Largest miss that is learned from, in expected deviations: larger ones come from
#: disturbances, and are clipped to this.
#: Unit: 1. Origin: chosen.
FARTHEST_SD = 8.0


class Correction:
    """Correction added to a map: a Bayesian linear model, updated hop by hop.

    It is a Kalman filter. Over `MEMORY_HOPS` hops its coefficients decay to zero and
    their covariance returns to its initial value (an Ornstein-Uhlenbeck prior). Memory
    and time per hop stay constant.

    Parameters
    ----------
    swing_limit_rad : float
    noise : (3,) array
        Standard deviation of a hop's random part, m, m, rad.
    """

    def __init__(self, swing_limit_rad: float, noise: FloatArray) -> None:
        self.swing_limit_rad = swing_limit_rad
        self.noise = noise
        # The constant wave has order 0, cosine and sine of a harmonic have its order.
        degrees = np.arange(DEGREE + 1)
        harmonics = (np.arange(2 * HARMONICS + 1) + 1) // 2
        orders = np.add.outer(degrees, harmonics)
        self._first = np.diag((FIRST_SD * FALL_OFF ** orders.ravel()) ** 2)
        self.covariance = self._first.copy()  # (k, k), the same for all three
        self.coefficients = np.zeros((len(self._first), 3))  # in units of the noise

    def functions(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return basis functions (..., k) at boom angles and swings (...).

        They are the products of waves of the boom angle and powers of the swing.
        """
        boom = np.asarray(boom_angle, dtype=float)
        waves = [np.ones_like(boom)]
        for harmonic in range(1, HARMONICS + 1):
            waves += [np.cos(harmonic * boom), np.sin(harmonic * boom)]
        of_boom = np.stack(waves, axis=-1)
        share = np.asarray(swing)[..., None] / self.swing_limit_rad
        of_swing = share ** np.arange(DEGREE + 1)
        products = of_swing[..., :, None] * of_boom[..., None, :]
        return np.asarray(products.reshape(*boom.shape, -1))

    def added(self, functions: FloatArray) -> FloatArray:
        """Return the correction, (..., 3), m, m, rad, by basis functions (..., k)."""
        return np.asarray(functions @ self.coefficients * self.noise)

    def learn(self, boom_angle: float, swing: float, missed: FloatArray) -> None:
        """Update the correction with the error (3,) of the uncorrected map in a hop."""
        kept = np.exp(-1.0 / MEMORY_HOPS)
        self.coefficients *= kept
        self.covariance = kept**2 * self.covariance + (1 - kept**2) * self._first
        functions = self.functions(boom_angle, swing)
        gain = self.covariance @ functions
        # Variance of the innovation: of the correction, and of the hop itself.
        variance = float(functions @ gain) + 1.0
        most = FARTHEST_SD * variance**0.5
        innovation = missed / self.noise - functions @ self.coefficients
        innovation = np.clip(innovation, -most, most)
        self.coefficients += np.outer(gain / variance, innovation)
        self.covariance -= np.outer(gain, gain) / variance
