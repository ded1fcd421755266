"""Hopper and plate in MuJoCo, with its contacts and with springs of ours, and their simulation.

There are several ways to make a spring that pushes only in contact:

- ``default contact``: MuJoCo's own soft contact, frictionless, with stiffness and
  damping over mass given directly (negative `solref`), as its manual suggests, and its
  default impedance.
- ``contact``: the same with a constant impedance d. MuJoCo adds d / (1 - d) / w of
  inertia to each contact, where w is the body's inverse weight; the smaller d, the
  closer it is to a spring. It pushes along the normal of the plate by the depth along
  that normal, with k cos^2(theta) in place of k, and never pulls.
- ``tendon`` (hopper): a spring of a tendon with a range of lengths in which it is
  slack.
- ``callback``: the scene's own springs, compiled, which MuJoCo calls for its passive
  forces.
- ``contact law`` (plate): the same, but normal to the plate and without pull, like a
  contact in the limit of zero impedance. With small steps, ``contact`` should approach
  it.

The plate is a thick box whose lower face is the plate's line. Each spring is a fixed
sphere so small that it acts as a point; the face is lowered by its radius, so that
depth / cos(theta) is exactly h_i.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic
from numpy.typing import ArrayLike

from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper
from peers import FloatArray, Found, Problem, Run, Solver

try:
    import mujoco
    from mujoco import rollout
except ImportError as error:  # then nothing is simulated, and the tables say so
    ABSENT = f"absent: {error}"
else:
    ABSENT = ""


INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")
CONTACTS = ("contact", "default contact")
SMALLEST_IMPEDANCE = 1e-4  # the smallest that MuJoCo allows
SPHERE_M = 1e-3
HALF_BOX_M = 6.0  # of the plate's box: larger than the bed and than any penetration


@dataclass(frozen=True)
class Setting:
    """Settings of a MuJoCo simulation: kind of springs, integrator, time step, impedance."""

    spring: str = "contact"
    integrator: str = "implicitfast"
    timestep_s: float = 2e-3
    impedance: float = SMALLEST_IMPEDANCE

    @property
    def name(self) -> str:
        """Name in tables."""
        impedance = f" d={self.impedance:g}" if self.spring == "contact" else ""
        return f"{self.spring}{impedance} {self.integrator}"


@dataclass(frozen=True)
class Simulation:
    """A compiled model with its data, and the function for passive forces, if any."""

    model: Any
    data: Any
    passive: Any = None

    def start(self, state: ArrayLike) -> None:
        """Start at the given positions and velocities, (2 nv,)."""
        mujoco.mj_resetData(self.model, self.data)
        positions, velocities = np.split(np.asarray(state, dtype=np.float64), 2)
        self.data.qpos[:], self.data.qvel[:] = positions, velocities

    def state(self) -> FloatArray:
        """Return positions and velocities, (2 nv,)."""
        return np.concatenate([self.data.qpos, self.data.qvel])

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
        """Return the states after each step from `state`, (2 nv, count), by `rollout`."""
        start = np.concatenate([[0.0], np.asarray(state, dtype=np.float64)])[None]
        with calling(self.passive):
            states, _ = rollout.rollout(self.model, self.data, start, nstep=count)
        return np.ascontiguousarray(states[0, :, 1:].T)


@contextmanager
def calling(passive: Any) -> Iterator[None]:
    """Let MuJoCo call a function for passive forces within this context."""
    if passive is not None:
        mujoco.set_mjcb_passive(passive.ctypes)
    try:
        yield
    finally:
        if passive is not None:
            mujoco.set_mjcb_passive(None)


def steps(setting: Setting, until_s: float) -> int:
    """Return the number of steps to the end, which the time step must divide."""
    count = round(until_s / setting.timestep_s)
    if abs(count * setting.timestep_s - until_s) > 1e-9:
        raise ValueError(f"time step {setting.timestep_s} does not divide {until_s} s")
    return count


def hopper_simulation(hopper: VerticalHopper, setting: Setting) -> Simulation:
    """Return the undamped hopper without preload: a sphere whose radius is the contact length."""
    length, mass, k = hopper.contact_length_m, hopper.mass_kg, hopper.stiffness_n_m
    touching = int(setting.spring in CONTACTS)
    slack = f'<fixed stiffness="{k}" springlength="{length} 1e9"><joint joint="z" coef="1"/></fixed>'
    bodies = f"""
        <geom type="plane" size="5 5 1" contype="{touching}" conaffinity="{touching}"/>
        <body>
          <joint name="z" type="slide" axis="0 0 1"/>
          <geom type="sphere" size="{length}" mass="{mass}" condim="1"
                contype="{touching}" conaffinity="{touching}"/>
        </body>"""
    tendon = f"<tendon>{slack}</tendon>" if setting.spring == "tendon" else ""
    model = compiled(hopper.gravity_m_s2, setting, bodies, tendon)
    weight = model.body_invweight0[1, 0]
    added = setting.impedance / (1 - setting.impedance) / weight
    with_added = k * (1 + added / mass)  # the added mass must move too
    set_contacts(model, setting, with_added if setting.spring == "contact" else k, 0.0)
    passive = None

    def run(qpos: FloatArray, _qvel: FloatArray, force: FloatArray) -> None:
        force[0] += k * (length - qpos[0]) if qpos[0] < length else 0.0

    data = mujoco.MjData(model)
    if setting.spring == "callback":
        passive = passive_force(data, run)
    return Simulation(model, data, passive)


def plate_simulation(plate: Plate, setting: Setting) -> Simulation:
    """Return the plate over its bed of springs."""
    touching = int(setting.spring in CONTACTS)
    inertia = plate.inertia_kg_m2
    spheres = "".join(
        f'<geom type="sphere" size="{SPHERE_M}" pos="{x} 0 {plate.rest_length_m}" condim="1"'
        ' contype="1" conaffinity="0"/>'
        for x in (plate.spring_places_m if touching else ())
    )
    box = f'<geom type="box" size="{HALF_BOX_M} 1 {HALF_BOX_M}" pos="0 0 {HALF_BOX_M + SPHERE_M}"'
    bodies = f"""
        {spheres}
        <body>
          <joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 0 1"/>
          <joint type="hinge" axis="0 -1 0"/>
          <inertial pos="0 0 0" mass="{plate.mass_kg}" diaginertia="{inertia} {inertia} {inertia}"/>
          {box} condim="1" contype="0" conaffinity="{touching}"/>
        </body>"""
    model = compiled(plate.gravity_m_s2, setting, bodies)
    stiffness, damping = plate.params[4:6]
    set_contacts(model, setting, stiffness, damping)
    data = mujoco.MjData(model)
    passive = None
    if setting.spring not in CONTACTS:
        passive = passive_force(
            data, plate_force(plate, as_contact=setting.spring != "callback")
        )
    return Simulation(model, data, passive)


def compiled(gravity_m_s2: float, setting: Setting, bodies: str, more: str = "") -> Any:
    """Return the compiled model of these bodies."""
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{setting.timestep_s}" integrator="{setting.integrator}"
                  gravity="0 0 {-gravity_m_s2}"/>
          <worldbody>{bodies}</worldbody>
          {more}
        </mujoco>""")


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


@intrinsic
def _pointer(typing: Any, address: Any) -> Any:  # noqa: ARG001
    """Return an address as a pointer to floats."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(sign.return_type))

    return types.CPointer(types.float64)(types.int64), generate


def passive_force(data: Any, force: Callable[..., None]) -> Any:
    """Return compiled code that adds ``force(qpos, qvel, out)`` to the passive forces of `data`."""
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


# MuJoCo as a peer: fixed time steps in place of tolerances.


TIMESTEPS_S = tuple(2e-3 / 2**k for k in range(7))
WAYS = (
    ("contact", "implicitfast"),
    ("callback", "RK4"),
)  # its own contact; the scene's springs


def solvers(problem: Problem) -> list[Solver]:
    """Return its soft contact and our springs; nothing if the scene is not mechanical."""
    if ABSENT:
        raise ImportError(ABSENT.removeprefix("absent: "))
    if problem.name not in ("vertical_hopper", "plate"):
        return []
    return [
        Solver(
            "MuJoCo", "MuJoCo", f"{integrator}, {spring}",
            partial(prepare, problem, spring, integrator), settings=TIMESTEPS_S,
        )
        for spring, integrator in WAYS
    ]  # fmt: skip


def prepare(problem: Problem, spring: str, integrator: str, timestep_s: float) -> Run:
    """Return a function that takes all steps from start to end in one call of C."""
    setting = Setting(spring, integrator, timestep_s)
    simulation: Any = (
        plate_simulation(Plate(), setting)
        if problem.name == "plate"
        else hopper_simulation(VerticalHopper(), setting)
    )
    count = steps(setting, problem.t_span[1] - problem.t_span[0])

    def run() -> Found:
        simulation.start(problem.y0)
        simulation.step_in_c(count)
        return np.array(simulation.state()), None

    return run
