"""Quadruped that pronks ahead, steered by the difference between its strides.

The scene's legs (`hopdata.scenes.quadruped`) hold a foot by a spring where it touched.
Here a foot is put down ahead of its rest place by half a stride of its side: the
spring then draws the body forward. The input is the stride on the right less that on
the left, which turns the robot to the left; their mean does not change. So it always
moves ahead, and cannot stop or go back.

A stride is a hop from apex to apex. The turn left over from the last difference is more
than a third, so this difference is the state, which the robot knows.
"""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, on_event
from hopdata.scenes import quadruped as scene
from hopdata.scenes.body import N_STATES, YAW
from hopdata.scenes.scene import Variant
from hopdata.steering.robot import SOFT_KICKS
from hopdata.steering.robots.interface import PathRobot, Stance
from hopdata.steering.strides import Input, State, StrideAxes
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.trial import Kicks, kicked

_event = kept_njit(error_model="numpy")(scene.quadruped_event.function)


@on_event
def stride_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Put a foot that touches down ahead of its rest place by its side's half stride.

    The half strides of left and right are the last two parameters.
    """
    stop = _event(t, y, mode, p, guard, direction)
    if guard < scene.N_LEGS and direction > 0:
        ahead = p[len(p) - 2 + guard % 2]
        aside = N_STATES + 2 * guard
        y[aside] = -ahead * math.cos(y[YAW])
        y[aside + 1] = -ahead * math.sin(y[YAW])
    return int(stop)


SYSTEM = replace(scene.SYSTEM, on_event=stride_event)


@dataclass(frozen=True)
class HalfStrides:
    """How far ahead of their rest places the feet are put down, left and right, m."""

    numbers: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class StridingQuadruped(scene.Quadruped):
    """The scene with feet that are put down ahead."""

    def system(self, _variant: Variant | None = None) -> System:
        """Return the hybrid system."""
        return SYSTEM

    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None
    ) -> FloatArray:
        """Return the flat parameter vector, with the half strides at its end."""
        half_strides = (0.0, 0.0) if variant is None else variant.numbers
        return np.array([*super().vector(preloads_n), *half_strides])


@dataclass(frozen=True, kw_only=True)
class SteeredQuadruped(PathRobot):
    """The steered quadruped; a `SimulatedRobot`.

    Parameters
    ----------
    body : StridingQuadruped
    stride_m : float
        Mean of the strides on the left and on the right.
    preload_shares : tuple of float
        Preload of each leg as a fraction of the body's; no real robot is built evenly.
    kicks : Kicks
        Random disturbances at each apex.
    release_height_m : float
        Height of the feet above the floor at the release.
    """

    axes: ClassVar[StrideAxes] = StrideAxes(
        linear=(State(name="last_difference", unit="m", set_by="difference"),),
        inputs=(Input(name="difference", unit="m", lower=-0.4, upper=0.4),),
    )
    # Three markers of 0.6 mm, some 0.13 m from their middle.
    seen_sd: ClassVar[tuple[float, ...]] = (4e-4, 4e-4, 3e-3, 0.0)

    body: StridingQuadruped = field(default_factory=StridingQuadruped)
    stride_m: float = 0.2
    preload_shares: tuple[float, ...] = (1.02, 0.97, 0.99, 1.02)
    kicks: Kicks = SOFT_KICKS
    release_height_m: float = 0.24

    def release(self, pose: ArrayLike, /) -> Stance:
        """Put the quadruped down level and at rest at a pose (3,)."""
        state = level_state(self.body, self.release_height_m)
        state[[0, 1, YAW]] = pose
        return stance_of(state, 0.0, difference=0.0)

    def path(
        self, stance: Stance, inputs: FloatArray, rng: Generator, times_s: FloatArray
    ) -> tuple[Stance, FloatArray]:
        """Hop with strides whose difference, right less left, is inputs (1,), m."""
        noise = rng.standard_normal(scene.N_LEGS)
        factors = 1 + self.kicks.preload_fraction * noise
        shares = np.array(self.preload_shares)
        difference = float(inputs[0])
        left_m = self.stride_m - difference / 2
        right_m = self.stride_m + difference / 2
        hop = fly_hop(
            self.body,
            kicked(stance.inner, self.kicks, rng),
            variant=HalfStrides((left_m / 2, right_m / 2)),
            preloads_n=self.body.preload_n * shares * factors,
            frame_times_s=times_s,
        )
        time_s = stance.time_s + hop.end_time_s
        end = stance_of(hop.end_state, time_s, difference=difference, fell=hop.fell)
        return end, hop.states


def stance_of(
    state: FloatArray, time_s: float, *, difference: float, fell: bool = False
) -> Stance:
    """Return the stance at an apex, at the place of the body's centre of mass."""
    pose = state[[0, 1, YAW]]
    return Stance(time_s, pose, np.array([difference]), fell=fell, inner=state)
