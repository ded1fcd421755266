# ruff: noqa: ARG001 (the integrator prescribes the signatures of field and guards)
"""A hopper in one dimension (section 4.3.4 of the dissertation): a mass on a preloaded springy leg.

State: its height above the floor, m, and velocity, m/s. The leg touches the floor where the height
is the contact length, in both directions: one two-way guard.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.hybrid import System, affine, field, guards
from hopdata.hybrid.solution import FloatArray, IntArray


@field
def hopper_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return gravity, and in stance (lock -1) the spring's and the damper's push."""
    gravity, stiffness, rest_length, damping = params[0], params[1], params[2], params[3]
    dy[0] = y[1]
    dy[1] = -gravity
    if mode[0] < 0:
        dy[1] += stiffness * (rest_length - y[0]) - damping * y[1]


@guards
def hopper_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Return the height above contact: negative in stance."""
    h[0] = y[0] - params[4]
    hdot[0] = dy[0]


@affine
def hopper_affine(mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """Return the matrix and the constant of flight, or of stance (lock -1)."""
    gravity, stiffness, rest_length, damping = params[0], params[1], params[2], params[3]
    a[0, 1] = 1.0
    b[1] = -gravity
    if mode[0] < 0:
        a[1, 0], a[1, 1] = -stiffness, -damping
        b[1] += stiffness * rest_length


SYSTEM = System(
    field=hopper_field, guards=hopper_guards, affine=hopper_affine, n_states=2,
    guard_names=("contact",),
)  # fmt: skip


@dataclass(frozen=True)
class VerticalHopper:
    """Parameters of the hopper, in SI units.

    Parameters
    ----------
    mass_kg : float
        Mass.
    stiffness_n_m : float
        Stiffness of the leg, N/m.
    contact_length_m : float
        Height of the mass at which the leg touches the floor (L).
    rest_length_m : float
        Length at which the leg's spring is relaxed (L0); longer than L means preload: the force
        jumps at contact.
    gravity_m_s2 : float
        Acceleration of gravity.
    damping_n_s_m : float
        Viscous damping of the leg, N s/m.
    """

    mass_kg: float = 1.0
    stiffness_n_m: float = 1000.0
    contact_length_m: float = 1.0
    rest_length_m: float = 1.0
    gravity_m_s2: float = 9.81
    damping_n_s_m: float = 0.0

    def __post_init__(self) -> None:
        if not (self.mass_kg > 0 and self.stiffness_n_m > 0 and self.damping_n_s_m >= 0):
            raise ValueError(f"expected mass and stiffness > 0 and damping >= 0, found {self}")

    @property
    def params(self) -> tuple[float, ...]:
        """Parameters as the compiled functions take them."""
        return (
            self.gravity_m_s2,
            self.stiffness_n_m / self.mass_kg,
            self.rest_length_m,
            self.damping_n_s_m / self.mass_kg,
            self.contact_length_m,
        )

    def system(self) -> System:
        """Return the hybrid system: its guard ``contact`` falls at touchdown, rises at lift-off."""
        return SYSTEM

    def energy(self, y: ArrayLike) -> NDArray[np.float64]:
        """Return the mechanical energy of states (2, ...), J; the floor is at height 0."""
        height, velocity = np.asarray(y, dtype=np.float64)
        length = np.minimum(height, self.contact_length_m)  # the leg's, in stance and in flight
        spring = 0.5 * self.stiffness_n_m * (self.rest_length_m - length) ** 2
        fall = self.mass_kg * self.gravity_m_s2 * height
        return 0.5 * self.mass_kg * velocity**2 + fall + spring
