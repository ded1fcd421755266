"""What a controller asks of a model: frame changes and their gradients, for many hops at once.

Conventions of all models: the frame change is (x, y, heading) in the frame of the first stance; m,
m, rad. Angles in rad. The boom angle is periodic: a whole turn more gives the same frame change.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

COMPONENTS = ("dx", "dy", "dtheta")


class FrameChangeMap(Protocol):
    """Frame change as a function of boom angle and swing."""

    def change(self, boom_angle: FloatArray, swing: FloatArray, /) -> FloatArray:
        """Return the frame changes (n, 3) of hops from boom angles (n,) by swings (n,)."""
        ...

    def change_and_gradient(
        self, boom_angle: FloatArray, swing: FloatArray, /
    ) -> tuple[FloatArray, FloatArray]:
        """Return frame changes (n, 3), and derivatives (n, 3, 2) by boom angle and swing."""
        ...


class HistoryFrameChangeMap(Protocol):
    """Frame change as a function of boom angle, swing and the swing of the hop before."""

    def change(
        self, boom_angle: FloatArray, swing: FloatArray, previous_swing: FloatArray, /
    ) -> FloatArray:
        """Return the frame changes (n, 3) of hops."""
        ...

    def change_and_gradient(
        self, boom_angle: FloatArray, swing: FloatArray, previous_swing: FloatArray, /
    ) -> tuple[FloatArray, FloatArray]:
        """Return frame changes (n, 3), and derivatives (n, 3, 3) by the three inputs in order."""
        ...
