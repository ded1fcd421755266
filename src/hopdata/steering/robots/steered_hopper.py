"""The steered hopper of chapter III behind the interface of all robots.

A stride leads from one stance, its lowest point, to the next. The state is the boom
angle, to which the swing of the flight between is added.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.robot import SteeredHopper, released, steer_hop
from hopdata.steering.robots.interface import Stance
from hopdata.steering.strides import StrideAxes


@dataclass(frozen=True)
class StridingHopper:
    """The steered hopper; a `SimulatedRobot`.

    Parameters
    ----------
    hopper : SteeredHopper
    """

    hopper: SteeredHopper = field(default_factory=SteeredHopper)

    # Three markers of 0.6 mm, some 0.13 m from their middle; the boom's, at 0.25 m.
    @property
    def seen_sd(self) -> tuple[float, ...]:
        """Deviations with which pose and boom angle are seen, (4,)."""
        return (4e-4, 4e-4, 3e-3, 4e-3)

    @cached_property
    def axes(self) -> StrideAxes:
        """Boom angle and swing."""
        return hopper_axes(self.hopper.swing_limit_rad)

    def release(self, pose: ArrayLike, /) -> Stance:
        """Put the hopper down at a pose (3,), with the boom in neutral."""
        apex = released(self.hopper, pose)
        state = np.array([apex.boom_angle_rad])
        return Stance(0.0, np.asarray(pose, dtype=float), state, inner=apex)

    def stride(
        self, stance: Stance, inputs: FloatArray, rng: np.random.Generator
    ) -> Stance:
        """Hop with a swing of the boom by inputs (1,), rad."""
        hop = steer_hop(self.hopper, stance.inner, float(inputs[0]), rng=rng)
        landed = hop.stance
        state = np.array([landed.boom_angle_rad])
        return Stance(
            landed.time_s, landed.pose, state, fell=landed.fell, inner=hop.end
        )
