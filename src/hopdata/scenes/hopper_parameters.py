"""The scene of the legged hopper: its parameters in SI units, and where its boom is.

Loading it takes no compiler: the field (`hopdata.scenes.hopper`) and the control
(`hopdata.scenes.hopper_control`) are imported by the functions that need them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.scene import Scene, Variant

if TYPE_CHECKING:
    from hopdata.hybrid import System


@dataclass(frozen=True, kw_only=True)
class HopperParameters(Scene):
    """A rigid chassis on evenly spaced, preloaded springy legs, with a boom.

    A counterweight is at the end of the boom. With the defaults it hops like the
    dissertation's robot: 0.63 s per hop, 0.24 m high, with contacts some 10 ms apart.
    The origin of the body axes is the chassis' centre of mass; z points up and x
    towards the first leg.

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
    legs_can_scatter: ClassVar[bool] = True
    resets_state: ClassVar[bool] = False

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
        feet = _rest_feet(self.n_legs, self.foot_radius_m, self.leg_length_m)
        return feet.copy()

    def system(self, variant: Variant | None = None) -> System:
        """Return the system of the hopper, of its control, or with a `HopperDrag`."""
        from hopdata.scenes.hopper_control import system_of

        return system_of(self.n_legs, variant)

    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None
    ) -> FloatArray:
        """Return the flat parameter vector; the numbers of a variant come last."""
        numbers = () if variant is None else variant.numbers
        end_of_legs = at.LEGS + at.LEG_STRIDE * self.n_legs
        vector = np.empty(end_of_legs + len(numbers))
        vector[: at.LEGS] = SCALARS(self)
        legs = vector[at.LEGS : end_of_legs].reshape(self.n_legs, at.LEG_STRIDE)
        legs[:, at.PRELOAD] = self.preload_n if preloads_n is None else preloads_n
        feet = _rest_feet(self.n_legs, self.foot_radius_m, self.leg_length_m)
        legs[:, at.FOOT_X : at.LONGER] = feet[:, :2]
        legs[:, at.LONGER] = 0.0
        vector[end_of_legs:] = numbers
        return vector

    def vectors(
        self,
        preloads_n: FloatArray,
        variant: Variant | None,
        since_apex_s: FloatArray | float,
    ) -> FloatArray:
        """Return the parameter vectors (L, p); the boom has swung since the apex."""
        vectors = np.tile(self.vector(None, variant), (len(preloads_n), 1))
        first_entries = at.LEGS + at.LEG_STRIDE * np.arange(self.n_legs)
        vectors[:, first_entries + at.PRELOAD] = preloads_n
        vectors[:, at.BOOM_START] -= since_apex_s
        return vectors

    def lengthened(self, vectors: FloatArray, longer_m: FloatArray) -> FloatArray:
        """Return parameter vectors with legs that are longer than usual."""
        first_entries = at.LEGS + at.LEG_STRIDE * np.arange(self.n_legs)
        changed = vectors.copy()
        changed[..., first_entries + at.LONGER] = longer_m
        return changed

    def boom_places(self, times_s: FloatArray) -> FloatArray:
        """Return the positions of the counterweight, (N, 3), body frame, m."""
        angle = self._boom_angles(times_s)
        places = np.empty((len(times_s), 3))
        places[:, 0] = self.boom_offset_m + self.boom_radius_m * np.cos(angle)
        places[:, 1] = self.boom_radius_m * np.sin(angle)
        places[:, 2] = self.boom_height_m
        return places

    def boom_angle(self, time_s: float) -> float:
        """Return the angle of the boom at a time since the apex, rad."""
        return float(self._boom_angles(time_s))

    def after(self, time_s: float) -> Self:
        """Return the hopper with its boom where it is at `time_s`, to swing back."""
        angle = self.boom_angle(time_s)
        return replace(self, boom_angle_rad=angle, boom_swing_rad=-self.boom_swing_rad)

    def still(self) -> Self:
        """Return the hopper with a boom that rests at its present angle."""
        return replace(self, boom_swing_rad=0.0)

    def by_hop(self, count: int) -> Iterator[tuple[Self, IntArray]]:
        """Yield, for each starting angle of the boom, the hopper and its hops."""
        if self.boom_swing_rad == 0:
            yield from super().by_hop(count)
            return
        hops = np.arange(count)
        yield self, hops[::2]
        swung = self.boom_angle_rad + self.boom_swing_rad
        back = replace(self, boom_angle_rad=swung, boom_swing_rad=-self.boom_swing_rad)
        yield back, hops[1::2]

    def _boom_angles(self, times_s: FloatArray | float) -> FloatArray:
        from hopdata.scenes.hopper import boom_angle

        return np.asarray(boom_angle.py_func(times_s, self.vector())[0])


# Reads the scalars of the flat vector, in its order.
SCALARS = attrgetter(*(one.name for one in fields(HopperParameters)[: at.LEGS]))


@cache
def _rest_feet(n_legs: int, radius_m: float, length_m: float) -> FloatArray:
    """Return the feet at rest length, (n, 3), body frame, m; not to be changed."""
    angle = 2 * np.pi * np.arange(n_legs) / n_legs
    x = radius_m * np.cos(angle)
    y = radius_m * np.sin(angle)
    feet = np.column_stack([x, y, np.full(n_legs, -length_m)])
    feet.flags.writeable = False
    return feet
