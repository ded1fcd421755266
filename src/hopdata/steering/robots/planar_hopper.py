"""Planar hopper: a point mass on one springy leg, steered by the leg's angle.

It moves in the plane x, z and never turns. The leg has the stiffness, damping, preload
and extension of the steered hopper's three together. In contact it pushes along itself
with F0 + k (l0 - l) - c dl/dt, from the rest length l0 until l0 + e: energy comes back.
In flight it is turned ahead of the vertical by `NEUTRAL_S_M` times the forward speed,
which slows it down (Raibert 1986), plus the input. A stride leads from apex to apex;
the speed there is the state, and how it goes on must be learned.
"""

import math
from dataclasses import astuple, dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.steering.robot import SOFT_KICKS
from hopdata.steering.robots.interface import PathRobot, Stance
from hopdata.steering.strides import Input, State, StrideAxes
from hopdata.synthesis.trial import Kicks

#: Angle of the leg ahead of the vertical for each forward speed.
#: Unit: rad s/m. Origin: chosen: half of the speed is left after a stride.
NEUTRAL_S_M = 0.2
#: Time without an apex after which a hop counts as a fall.
#: Unit: s. Origin: chosen.
HOP_LIMIT_S = 3.0

# State: x, z, velocities, x of the standing foot. Parameters: the fields' order.
MASS, STIFFNESS, DAMPING, PRELOAD, LENGTH, EXTENSION, GRAVITY, ANGLE = range(8)
LEG, APEX, FALLEN, TOUCHED = range(4)  # guards, and the mode beside them


@field
def planar_field(
    _t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill in gravity, and in contact the leg's push along itself."""
    dy[:2] = y[2:4]
    dy[2:] = 0.0
    dy[3] = -p[GRAVITY]
    if mode[LEG] > 0:
        ahead = y[0] - y[4]
        length = math.hypot(ahead, y[1])
        rate = (ahead * y[2] + y[1] * y[3]) / length
        push = p[PRELOAD] + p[STIFFNESS] * (p[LENGTH] - length) - p[DAMPING] * rate
        dy[2] += push / p[MASS] * ahead / length
        dy[3] += push / p[MASS] * y[1] / length


@guards
def planar_guards(
    _t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill in the foot's depth or the leg's reach squared, climb rate, and the fall."""
    if mode[LEG] > 0:
        ahead = y[0] - y[4]
        h[LEG] = (p[LENGTH] + p[EXTENSION]) ** 2 - ahead**2 - y[1] ** 2
        hdot[LEG] = -2.0 * (ahead * dy[0] + y[1] * dy[1])
    else:
        h[LEG] = p[LENGTH] * math.cos(p[ANGLE]) - y[1]
        hdot[LEG] = -dy[1]
    h[APEX] = y[3]
    hdot[APEX] = dy[3]
    h[FALLEN] = 0.3 * p[LENGTH] - y[1]
    hdot[FALLEN] = -dy[1]


@on_event
def planar_event(
    _t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Place the foot at touchdown; stop at an apex after it, and at a fall."""
    if guard == LEG and direction > 0:
        y[4] = y[0] + p[LENGTH] * math.sin(p[ANGLE])
        mode[TOUCHED] = 1
    if guard == APEX:
        return 1 if mode[LEG] < 0 and mode[TOUCHED] > 0 else 0
    return 1 if guard == FALLEN else 0


SYSTEM = System(
    field=planar_field,
    guards=planar_guards,
    on_event=planar_event,
    n_states=5,
    guard_names=("leg", "apex", "fallen"),
    directions=(0, -1, 1),
    n_extra_modes=1,
)


@dataclass(frozen=True, kw_only=True)
class PlanarHopper(PathRobot):
    """The planar hopper; a `SimulatedRobot`. Its parameters are m, k, c, F0, l0, e, g.

    The kicks disturb velocity and preload at each apex.
    """

    axes: ClassVar[StrideAxes] = StrideAxes(
        linear=(State(name="speed", unit="m_s"),),
        inputs=(Input(name="leg_angle", lower=-0.05, upper=0.05),),
    )
    # Of three markers of 0.6 mm, and of the speed over ten frames.
    seen_sd: ClassVar[tuple[float, ...]] = (4e-4, 0.0, 0.0, 0.01)

    mass_kg: float = 2.7
    stiffness_n_m: float = 270.0
    damping_n_s_m: float = 14.4
    preload_n: float = 66.0
    leg_length_m: float = 0.5
    extension_m: float = 0.125
    gravity_m_s2: float = 9.81
    kicks: Kicks = SOFT_KICKS
    release_height_m: float = 0.24

    def release(self, pose: ArrayLike, /) -> Stance:
        """Put the hopper down at rest; of the pose (3,) only x counts."""
        height = self.leg_length_m + self.release_height_m
        return stance_of(np.array([np.ravel(pose)[0], height, 0.0, 0.0, 0.0]), 0.0)

    def path(
        self, stance: Stance, inputs: FloatArray, rng: Generator, times_s: FloatArray
    ) -> tuple[Stance, FloatArray]:
        """Hop with the leg turned ahead by inputs (1,) more than its neutral angle."""
        state = stance.inner.copy()
        state[2:4] += self.kicks.velocity_m_s * rng.standard_normal(2)
        params = np.array([*astuple(self)[:7], 0.0])
        params[PRELOAD] *= 1 + self.kicks.preload_fraction * rng.standard_normal()
        params[ANGLE] = NEUTRAL_S_M * state[2] + inputs[0]
        mode = [-1, 1 if state[3] > 0 else -1, -1, 0]
        span = (0.0, HOP_LIMIT_S)
        end = solve(SYSTEM, span, state, params=params, mode=mode, t_eval=times_s)
        fell = end.t_end >= HOP_LIMIT_S or end.events.guard[-1] != APEX
        return stance_of(end.y_end, stance.time_s + end.t_end, fell=fell), end.y.T


def stance_of(state: FloatArray, time_s: float, *, fell: bool = False) -> Stance:
    """Return the stance at an apex."""
    return Stance(time_s, state[:1] * [1, 0, 0], state[2:3], fell=fell, inner=state)
