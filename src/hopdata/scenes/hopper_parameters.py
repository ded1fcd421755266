"""Parameters of the legged hopper, in SI units, and the flat vector that its field reads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.scenes.scene import Scene, Variant

if TYPE_CHECKING:
    from hopdata.hybrid import System

# Indices into the flat vector: scalars first, then (preload, x, y) of each leg's rest
# foot.
N_LEGS, GRAVITY, MASS, COUNTERWEIGHT, INERTIA_X, INERTIA_Y, INERTIA_Z = range(7)
STIFFNESS, DAMPING, FRICTION, SLIP_VELOCITY, RELEASE_EXTENSION, LEG_LENGTH = range(
    7, 13
)
BOOM_RADIUS, BOOM_OFFSET, BOOM_HEIGHT, BOOM_ANGLE, BOOM_SWING, BOOM_START = range(
    13, 19
)
BOOM_DURATION, TILT_LIMIT, LEGS = range(19, 22)
LEG_STRIDE = 3


@dataclass(frozen=True, kw_only=True)
class HopperParameters(Scene):
    """A rigid chassis on evenly spaced, preloaded springy legs, with a counterweight on a boom.

    With the defaults it hops like the dissertation's robot: 0.63 s per hop, 0.24 m
    high, with contacts some 10 ms apart. The origin of the body axes is the chassis'
    centre of mass; z points up and x towards the first leg.

    Parameters
    ----------
    n_legs : int
        Number of legs, evenly spaced around z.
    mass_kg, counterweight_mass_kg : float
        Mass of the chassis, and of the point mass at the end of the boom.
    inertia_x_kg_m2, inertia_y_kg_m2, inertia_z_kg_m2 : float
        Moments of inertia of the chassis about its principal (body) axes.
    stiffness_n_m, damping_n_s_m : float
        Stiffness and damping of one leg against vertical compression.
    preload_n : float
        Force of a leg at its rest length; the contact force jumps to it at touchdown.
    foot_radius_m, leg_length_m : float
        Position of the rest feet: distance from the body z-axis, and distance below the
        origin.
    friction, slip_velocity_m_s : float
        Coefficient of friction, and the sliding speed at which friction reaches 71 % of
        its limit.
    release_extension_m : float
        Extension beyond rest length up to which a leg pushes once all legs have stood,
        which restores energy.
    boom_radius_m, boom_offset_m, boom_height_m : float
        The counterweight moves on a circle of this radius about (offset, 0, height) in
        the body.
    boom_angle_rad : float
        Angle of the boom; at pi, with radius = offset, the counterweight is on the body
        z-axis.
    boom_swing_rad, boom_start_s, boom_duration_s : float
        Angle, start and duration of the cycloidal move. Time counts from the apex at
        which a hop begins; some 0.2 s of flight remain then.
    tilt_limit_rad : float
        Angle between the body z-axis and the vertical beyond which the hopper has
        fallen.
    gravity_m_s2 : float
        Acceleration due to gravity.
    """

    controls: ClassVar[tuple[str, ...]] = ("coupling", "impulse", "delay_s")
    has_boom: ClassVar[bool] = True

    # The scalars of the flat vector, in its order.
    n_legs: int = 3
    gravity_m_s2: float = 9.81
    mass_kg: float = 2.3
    counterweight_mass_kg: float = 0.4
    inertia_x_kg_m2: float = 0.08
    inertia_y_kg_m2: float = 0.08
    inertia_z_kg_m2: float = 0.11
    stiffness_n_m: float = 90.0
    damping_n_s_m: float = 4.8
    friction: float = 0.4
    slip_velocity_m_s: float = 0.17
    release_extension_m: float = 0.125
    leg_length_m: float = 0.27
    boom_radius_m: float = 0.25
    boom_offset_m: float = 0.25
    boom_height_m: float = -0.03
    boom_angle_rad: float = np.pi
    boom_swing_rad: float = 0.0
    boom_start_s: float = 0.0
    boom_duration_s: float = 0.15
    tilt_limit_rad: float = 1.0
    # The parameters that define the legs' entries of the vector.
    preload_n: float = 22.0
    foot_radius_m: float = 0.38

    @property
    def total_mass_kg(self) -> float:
        """Mass of the chassis and the counterweight, kg."""
        return self.mass_kg + self.counterweight_mass_kg

    def rest_feet(self) -> FloatArray:
        """Return the feet at rest length, (n, 3), body frame, m."""
        angle = 2 * np.pi * np.arange(self.n_legs) / self.n_legs
        below = np.full(self.n_legs, -self.leg_length_m)
        return np.column_stack(
            [
                self.foot_radius_m * np.cos(angle),
                self.foot_radius_m * np.sin(angle),
                below,
            ]
        )

    def system(self, variant: Variant | None = None) -> System:
        """Return the hybrid system of the hopper, of its control, or with a `HopperDrag`."""
        from hopdata.scenes import (
            hopper_control,
        )  # imported here: it imports this module

        return hopper_control.system_of(self.n_legs, variant)

    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None
    ) -> FloatArray:
        """Return the flat parameter vector; the numbers of a variant come last."""
        legs = np.empty((self.n_legs, LEG_STRIDE))
        legs[:, 0] = self.preload_n if preloads_n is None else preloads_n
        legs[:, 1:] = self.rest_feet()[:, :2]
        scalars = [float(getattr(self, one.name)) for one in fields(self)[:LEGS]]
        return np.array(
            [*scalars, *legs.ravel(), *(variant.numbers if variant else ())]
        )

    def vectors(
        self,
        preloads_n: FloatArray,
        variant: Variant | None,
        since_apex_s: FloatArray | float,
    ) -> FloatArray:
        """Return the parameter vectors (L, p) for a boom that has already swung for some time."""
        vectors = np.tile(self.vector(None, variant), (len(preloads_n), 1))
        vectors[:, LEGS + LEG_STRIDE * np.arange(self.n_legs)] = preloads_n
        vectors[:, BOOM_START] -= since_apex_s
        return vectors

    def boom_places(self, times_s: FloatArray) -> FloatArray:
        """Return the positions of the counterweight, (N, 3), body frame, m."""
        angle = self._boom_angles(times_s)
        x = self.boom_offset_m + self.boom_radius_m * np.cos(angle)
        y = self.boom_radius_m * np.sin(angle)
        return np.column_stack([x, y, np.full(len(times_s), self.boom_height_m)])

    def after(self, time_s: float) -> Self:
        """Return the hopper with its boom where it is at `time_s`, about to swing back."""
        angle = float(self._boom_angles(time_s))
        return replace(self, boom_angle_rad=angle, boom_swing_rad=-self.boom_swing_rad)

    def still(self) -> Self:
        """Return the hopper with a boom that rests at its present angle."""
        return replace(self, boom_swing_rad=0.0)

    def by_hop(self, count: int) -> Iterator[tuple[Self, IntArray]]:
        """Yield, for each starting angle of the boom, the hopper and the indices of its hops."""
        if self.boom_swing_rad == 0:
            yield from super().by_hop(count)
            return
        hops, back = np.arange(count), self.boom_angle_rad + self.boom_swing_rad
        yield self, hops[::2]
        yield (
            replace(self, boom_angle_rad=back, boom_swing_rad=-self.boom_swing_rad),
            hops[1::2],
        )

    def _boom_angles(self, times_s: FloatArray | float) -> FloatArray:
        from hopdata.scenes.hopper import (
            boom_angle,
        )  # imported here: it imports this module

        return np.asarray(boom_angle.py_func(times_s, self.vector())[0])
