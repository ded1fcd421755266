"""Hopper and plate in MuJoCo, as models and as simulations (sections 4.4.3 and 4.4.4).

The text does not say how it models its springs. There are several ways to make a spring
that pushes only in contact:

- ``default contact``: MuJoCo's own soft contact, frictionless, with stiffness and
  damping over mass given directly (negative `solref`), as its manual suggests, and its
  default impedance.
- ``contact``: the same with a constant impedance d. MuJoCo adds d / (1 - d) / w of
  inertia to each contact, where w is the body's inverse weight; the smaller d, the
  closer it is to a spring. It pushes along the normal of the plate by the depth along
  that normal, with k cos^2(theta) in place of k, and never pulls.
- ``tendon`` (hopper): a spring of a tendon with a range of lengths in which it is
  slack.
- ``body`` (plate): each spring is a joint with stiffness and damping that carries a
  light ball, and MuJoCo's default contact keeps the ball under the plate.
- ``callback``: the scene's own springs, compiled, which MuJoCo calls for its passive
  forces.
- ``contact law`` (plate): the same, but normal to the plate and without pull, like a
  contact in the limit of zero impedance. With small steps, ``contact`` should approach
  it.

The plate is a thick box whose lower face is the plate's line. Each spring is a fixed
sphere so small that it acts as a point; the face is lowered by its radius, so that
depth / cos(theta) is exactly h_i.

This module needs MuJoCo, which is not a dependency of hopdata.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper

#: MuJoCo's integrators, by the names of its XML.
INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")
#: Kinds of springs that are contacts of MuJoCo.
CONTACTS = ("contact", "default contact")
#: The smallest impedance that MuJoCo allows, at which a contact is closest to a spring.
#: Unit: 1. Origin: table: mjMINIMP in MuJoCo's mjmodel.h.
SMALLEST_IMPEDANCE = 1e-4
#: Radius of the spheres that are the ends of the plate's springs: as good as a point.
#: Unit: m. Origin: chosen.
SPHERE_M = 1e-3
#: Mass of a ball that is carried by a spring (``body``): small beside the plate, and
#: large enough for the spring and MuJoCo's contact to be stable at its time step.
#: Unit: kg. Origin: chosen.
BALL_KG = 1e-2
#: Half the width and height of the plate's box: larger than the bed and than any
#: penetration.
#: Unit: m. Origin: chosen.
HALF_BOX_M = 6.0


@dataclass(frozen=True)
class Setting:
    """Settings of a simulation by MuJoCo.

    Parameters
    ----------
    spring : str
        Kind of the springs: ``default contact``, ``contact``, ``tendon``, ``body``,
        ``callback`` or ``contact law``; see the module.
    integrator : str
        One of `INTEGRATORS`.
    timestep_s : float
        Time step, s.
    impedance : float
        Constant impedance of a ``contact``.
    """

    spring: str = "contact"
    integrator: str = "implicitfast"
    timestep_s: float = 2e-3
    impedance: float = SMALLEST_IMPEDANCE

    @property
    def name(self) -> str:
        """Name in tables."""
        if self.spring == "contact":
            return f"{self.spring} d={self.impedance:g} {self.integrator}"
        return f"{self.spring} {self.integrator}"

    @property
    def touches(self) -> bool:
        """Whether the springs are contacts of MuJoCo."""
        return self.spring in CONTACTS


@dataclass(frozen=True)
class Simulation:
    """A compiled model with its data.

    Attributes
    ----------
    model, data
        MuJoCo's `MjModel` and `MjData`.
    n_coordinates : int
        Number of the scene's coordinates, which are the first of the model's.
    passive
        Compiled function for passive forces, or None.
    """

    model: Any
    data: Any
    n_coordinates: int
    passive: Any = None

    def start(self, state: ArrayLike) -> None:
        """Start at the scene's positions and velocities, (2 n,)."""
        mujoco.mj_resetData(self.model, self.data)
        positions, velocities = np.split(np.asarray(state, dtype=np.float64), 2)
        self.data.qpos[: self.n_coordinates] = positions
        self.data.qvel[: self.n_coordinates] = velocities

    def state(self) -> FloatArray:
        """Return the scene's positions and velocities, (2 n,)."""
        positions = self.data.qpos[: self.n_coordinates]
        velocities = self.data.qvel[: self.n_coordinates]
        return np.concatenate([positions, velocities])

    def step_in_c(self, count: int) -> None:
        """Take many steps in one call."""
        with calling(self.passive):
            mujoco.mj_step(self.model, self.data, count)

    def step_in_python(self, count: int) -> None:
        """Take many steps in a Python loop, as most users do."""
        model, data, step = self.model, self.data, mujoco.mj_step
        with calling(self.passive):
            for _ in range(count):
                step(model, data)

    def roll_out(self, state: ArrayLike, count: int) -> FloatArray:
        """Return the states after each step, (2 nv, count), by MuJoCo's `rollout`."""
        start = np.concatenate([[0.0], np.asarray(state, dtype=np.float64)])[None]
        with calling(self.passive):
            states, _ = rollout.rollout(self.model, self.data, start, nstep=count)
        return np.ascontiguousarray(states[0, :, 1:].T)


@contextmanager
def calling(passive: Any) -> Iterator[None]:
    """Let MuJoCo call a function for passive forces within this context."""
    if passive is None:
        yield
        return
    mujoco.set_mjcb_passive(passive.ctypes)
    try:
        yield
    finally:
        mujoco.set_mjcb_passive(None)


def steps(setting: Setting, until_s: float) -> int:
    """Return the number of steps to the end.

    Raises
    ------
    ValueError
        If the time step does not divide the time.
    """
    count = round(until_s / setting.timestep_s)
    if abs(count * setting.timestep_s - until_s) > 1e-9:
        raise ValueError(f"time step {setting.timestep_s} does not divide {until_s} s")
    return count


def hopper_xml(hopper: VerticalHopper, setting: Setting) -> str:
    """Return the model of the hopper: a sphere whose radius is the contact length."""
    length = hopper.contact_length_m
    touching = int(setting.touches)
    tendon = ""
    if setting.spring == "tendon":
        tendon = f"""
          <tendon><fixed stiffness="{hopper.stiffness_n_m}" springlength="{length} 1e9">
            <joint joint="z" coef="1"/>
          </fixed></tendon>"""
    bodies = f"""
        <geom type="plane" size="5 5 1" contype="{touching}" conaffinity="{touching}"/>
        <body>
          <joint name="z" type="slide" axis="0 0 1"/>
          <geom type="sphere" size="{length}" mass="{hopper.mass_kg}" condim="1"
                contype="{touching}" conaffinity="{touching}"/>
        </body>"""
    return document(hopper.gravity_m_s2, setting, bodies, tendon)


def hopper_simulation(hopper: VerticalHopper, setting: Setting) -> Simulation:
    """Return the undamped hopper without preload."""
    length, mass, k = hopper.contact_length_m, hopper.mass_kg, hopper.stiffness_n_m
    model = mujoco.MjModel.from_xml_string(hopper_xml(hopper, setting))
    data = mujoco.MjData(model)
    if setting.spring == "contact":
        weight = model.body_invweight0[1, 0]
        added = setting.impedance / (1 - setting.impedance) / weight
        # The added mass must move too.
        set_contacts(model, setting, k * (1 + added / mass), 0.0)
    if setting.spring == "default contact":
        set_contacts(model, setting, k, 0.0)

    def run(qpos: FloatArray, _qvel: FloatArray, force: FloatArray) -> None:
        if qpos[0] < length:
            force[0] += k * (length - qpos[0])

    passive = None
    if setting.spring == "callback":
        passive = passive_force(data, run)
    return Simulation(model, data, 1, passive)


def plate_xml(plate: Plate, setting: Setting) -> str:
    """Return the model of the plate over a bed with any number of springs."""
    touching = int(setting.touches or setting.spring == "body")
    inertia = plate.inertia_kg_m2
    springs = "".join(spring_xml(plate, setting, x) for x in plate.spring_places_m)
    bodies = f"""
        <body>
          <joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 0 1"/>
          <joint type="hinge" axis="0 -1 0"/>
          <inertial pos="0 0 0" mass="{plate.mass_kg}"
                    diaginertia="{inertia} {inertia} {inertia}"/>
          <geom type="box" size="{HALF_BOX_M} 1 {HALF_BOX_M}"
                pos="0 0 {HALF_BOX_M + SPHERE_M}"
                condim="1" contype="0" conaffinity="{touching}"/>
        </body>
        {springs}"""
    return document(plate.gravity_m_s2, setting, bodies)


def spring_xml(plate: Plate, setting: Setting, place_m: float) -> str:
    """Return the spring at a place; nothing if MuJoCo has no part in its force."""
    at = f'pos="{place_m} 0 {plate.rest_length_m}"'
    sphere = f'type="sphere" size="{SPHERE_M}" condim="1" contype="1" conaffinity="0"'
    if setting.touches:
        return f"<geom {sphere} {at}/>"
    if setting.spring == "body":
        stiffness, damping = plate.params[4:6]
        return f"""
        <body {at} gravcomp="1">
          <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="{damping}"/>
          <geom {sphere} mass="{BALL_KG}"/>
        </body>"""
    return ""


def plate_simulation(plate: Plate, setting: Setting) -> Simulation:
    """Return the plate over its bed of springs."""
    model = mujoco.MjModel.from_xml_string(plate_xml(plate, setting))
    data = mujoco.MjData(model)
    if setting.touches:
        stiffness, damping = plate.params[4:6]
        set_contacts(model, setting, stiffness, damping)
    passive = None
    if setting.spring in ("callback", "contact law"):
        as_contact = setting.spring == "contact law"
        passive = passive_force(data, plate_force(plate, as_contact=as_contact))
    return Simulation(model, data, 3, passive)


def depths(simulation: Simulation, state: ArrayLike) -> FloatArray:
    """Return the depth of each contact that MuJoCo finds in a state, (n,), m."""
    simulation.start(state)
    mujoco.mj_forward(simulation.model, simulation.data)
    return -np.array(simulation.data.contact.dist, dtype=np.float64)


def document(gravity_m_s2: float, setting: Setting, bodies: str, more: str = "") -> str:
    """Return the XML of a model with these bodies."""
    return f"""
        <mujoco>
          <option timestep="{setting.timestep_s}" integrator="{setting.integrator}"
                  gravity="0 0 {-gravity_m_s2}"/>
          <worldbody>{bodies}</worldbody>
          {more}
        </mujoco>"""


def set_contacts(
    model: Any, setting: Setting, stiffness: float, damping: float
) -> None:
    """Give all contacts this stiffness, N/m, and damping, N s/m, at constant impedance.

    For `solref` = (-stiffness, -damping), MuJoCo's reference acceleration is (stiffness
    depth - damping speed) / d, and the resulting force is that times d / (1 - d) / w.
    """
    if setting.spring == "default contact":
        mass = model.body_mass[1]
        model.geom_solref[:] = -stiffness / mass, -damping / mass
        return
    d, weight = setting.impedance, model.body_invweight0[1, 0]
    scale = weight * (1 - d)
    model.geom_solref[:] = -stiffness * scale, -damping * scale
    model.geom_solimp[:] = d, d, 0.001, 0.5, 2.0


def plate_force(plate: Plate, *, as_contact: bool = False) -> Callable[..., None]:
    """Return the forces of the springs as a function of positions and velocities."""
    _, _, _, rest, stiffness, damping, first, spacing = plate.params
    n = plate.n_contacts

    def force(qpos: FloatArray, qvel: FloatArray, out: FloatArray) -> None:
        x, z, cosine, sine = qpos[0], qpos[1], np.cos(qpos[2]), np.sin(qpos[2])
        slope = sine / cosine
        for i in range(n):
            arm = x - first - i * spacing
            depth = rest + slope * arm - z
            if depth > 0.0:
                rate = slope * qvel[0] - qvel[1] + qvel[2] * arm / cosine**2
                if as_contact:
                    rate = rate * cosine - depth * sine * qvel[2]
                    push = max(0.0, stiffness * depth * cosine + damping * rate)
                else:
                    push = (stiffness * depth + damping * rate) / cosine
                out[0] -= sine * push
                out[1] += cosine * push
                out[2] -= push * arm / cosine

    return force


def _as_pointer(typing: Any, address: Any) -> Any:  # noqa: ARG001 (Numba's signature)
    """Return an address as a pointer to floats."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(sign.return_type))

    return types.CPointer(types.float64)(types.int64), generate


_pointer: Any = intrinsic(_as_pointer)


def passive_force(data: Any, force: Callable[..., None]) -> Any:
    """Return compiled code that adds ``force(qpos, qvel, out)`` to passive forces."""
    add, size = njit(error_model="numpy")(force), len(data.qpos)
    places = (
        data.qpos.ctypes.data,
        data.qvel.ctypes.data,
        data.qfrc_passive.ctypes.data,
    )
    qpos, qvel, out = places

    @cfunc(types.void(types.voidptr, types.voidptr))
    def passive(_model: Any, _data: Any) -> None:
        add(
            carray(_pointer(qpos), size),
            carray(_pointer(qvel), size),
            carray(_pointer(out), size),
        )

    return passive
