# ruff: noqa: ARG001 (the integrator prescribes the signatures of field and guards)
"""The system of the dissertation's table 4.3: three affine modes a coordinate.

They are switched at the coordinate planes. State (x, y, z) and time have no dimension; from the
initial state each guard is crossed once: y rising, z falling, x rising.
"""

from __future__ import annotations

from functools import cache

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, affine, field, guards

INITIAL_STATE = (-0.4, -0.15, 0.3)
T_SPAN = (0.0, 0.5)


@field
def octant_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return the affine field of the octant that the locks name."""
    x_side, y_side, z_fell = mode[0] > 0, mode[1] > 0, mode[2] > 0
    if x_side:
        dy[0] = (10.0 * y[0] if y_side else -2.0 * y[1]) + 1.0
        dy[1] = y[1] + 1.0 if y_side else 0.5 * y[0] + 2.0
    else:
        dy[0] = (y[1] if y_side else -y[1]) + 1.0
        dy[1] = (-y[0] if y_side else y[0]) + 1.0
    dy[2] = 3.0 * y[2] - 1.0 if z_fell else -y[2] - 1.0


@guards
def octant_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Return the coordinate planes; z is crossed downwards, so that -z rises."""
    h[0], hdot[0] = y[0], dy[0]
    h[1], hdot[1] = y[1], dy[1]
    h[2], hdot[2] = -y[2], -dy[2]


@affine
def octant_affine(mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """Return the matrix and the constant of the octant that the locks name."""
    x_side, y_side, z_fell = mode[0] > 0, mode[1] > 0, mode[2] > 0
    b[0], b[1], b[2] = 1.0, 1.0, -1.0
    if x_side and y_side:
        a[0, 0], a[1, 1] = 10.0, 1.0
    elif x_side:
        a[0, 1], a[1, 0], b[1] = -2.0, 0.5, 2.0
    elif y_side:
        a[0, 1], a[1, 0] = 1.0, -1.0
    else:
        a[0, 1], a[1, 0] = -1.0, 1.0
    a[2, 2] = 3.0 if z_fell else -1.0


@cache
def octant() -> System:
    """Return the system of table 4.3: guards ``x`` (rising), ``y`` (rising) and ``z`` (falling)."""
    return System(
        field=octant_field, guards=octant_guards, affine=octant_affine, n_states=3,
        guard_names=("x", "y", "z"),
    )  # fmt: skip
