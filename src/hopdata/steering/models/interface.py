"""What a controller, a table and a score ask of a model of strides."""

from __future__ import annotations

from typing import Protocol

from hopdata.arrays import FloatArray
from hopdata.steering.strides import StrideAxes


class StrideModel(Protocol):
    """How a stride changes pose and state, for many strides at once."""

    @property
    def axes(self) -> StrideAxes:
        """Names of states and inputs, and the limits of the inputs."""
        ...

    def change(self, state: FloatArray, inputs: FloatArray, /) -> FloatArray:
        """Return the changes of pose (n, 3) by states (n, S) and inputs (n, U).

        They are x and y, m, and the heading, rad, in the frame of the first stance. A
        whole turn more of a periodic state makes no difference.
        """
        ...

    def next_state(self, state: FloatArray, inputs: FloatArray, /) -> FloatArray:
        """Return the states (n, S) after strides, periodic ones in [0, 2 pi)."""
        ...
