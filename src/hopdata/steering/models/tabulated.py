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

    def change(self, *inputs: ArrayLike) -> FloatArray:
        """Return the frame changes (n, 3) of hops with these inputs, (n,) each.

        Raises
        ------
        AnalysisError
            If a swing is beyond the limit, or the number of inputs is wrong.
        ValueError
            From scipy, if an axis has fewer than four nodes or the values are not all finite.
        """
        angles, swings = input_rows(inputs, 2)
        largest = float(np.abs(swings).max(initial=0.0))
        if not largest <= self.swing_limit_rad * (1 + BEYOND):
            raise AnalysisError(
                f"table: expected swings within {self.swing_limit_rad:.4f} rad, found {largest:.4f}"
            )
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
