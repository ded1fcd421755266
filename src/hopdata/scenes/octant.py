# ruff: noqa: ARG001 (the integrator prescribes the signatures of its callbacks)
"""Table 4.3 of the dissertation: affine modes, switched at the coordinate planes.

State (x, y, z) and time have no dimension. From the initial state, each guard is
crossed once: y rising, z falling, x rising. The modes are affine, so the exact flow is
a matrix exponential. It is integrated only, so it is none of `hopdata.scenes.SCENES`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, affine, field, guards

INITIAL_STATE = (-0.4, -0.15, 0.3)
T_SPAN = (0.0, 0.5)


@field
def octant_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Fill in the affine field of the octant given by the locks."""
    x_side = mode[0] > 0
    y_side = mode[1] > 0
    z_fell = mode[2] > 0
    if x_side and y_side:
        dy[0] = 10.0 * y[0] + 1.0
        dy[1] = y[1] + 1.0
    elif x_side:
        dy[0] = -2.0 * y[1] + 1.0
        dy[1] = 0.5 * y[0] + 2.0
    elif y_side:
        dy[0] = y[1] + 1.0
        dy[1] = -y[0] + 1.0
    else:
        dy[0] = -y[1] + 1.0
        dy[1] = y[0] + 1.0
    if z_fell:
        dy[2] = 3.0 * y[2] - 1.0
    else:
        dy[2] = -y[2] - 1.0


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
    """Fill in the coordinate planes; z is crossed downwards, so that -z rises."""
    h[0] = y[0]
    h[1] = y[1]
    h[2] = -y[2]
    hdot[0] = dy[0]
    hdot[1] = dy[1]
    hdot[2] = -dy[2]


@affine
def octant_affine(
    mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray
) -> None:
    """Fill in the matrix and the constant of the octant given by the locks."""
    x_side = mode[0] > 0
    y_side = mode[1] > 0
    z_fell = mode[2] > 0
    b[0] = 1.0
    b[1] = 1.0
    b[2] = -1.0
    if x_side and y_side:
        a[0, 0] = 10.0
        a[1, 1] = 1.0
    elif x_side:
        a[0, 1] = -2.0
        a[1, 0] = 0.5
        b[1] = 2.0
    elif y_side:
        a[0, 1] = 1.0
        a[1, 0] = -1.0
    else:
        a[0, 1] = -1.0
        a[1, 0] = 1.0
    if z_fell:
        a[2, 2] = 3.0
    else:
        a[2, 2] = -1.0


@cache
def octant() -> System:
    """Return the system: guards ``x``, ``y`` (rising) and ``z`` (falling)."""
    return System(
        field=octant_field,
        guards=octant_guards,
        affine=octant_affine,
        n_states=3,
        guard_names=("x", "y", "z"),
    )


# The exact solution. Each row: matrix and constants of a mode, and the axis whose plane
# ends it.
LEGS = (
    ([[0, -1, 0], [1, 0, 0], [0, 0, -1]], [1, 1, -1], 1),  # until y = 0
    ([[0, 1, 0], [-1, 0, 0], [0, 0, -1]], [1, 1, -1], 2),  # until z = 0
    ([[0, 1, 0], [-1, 0, 0], [0, 0, 3]], [1, 1, -1], 0),  # until x = 0
)
LAST = ([[10, 0, 0], [0, 1, 0], [0, 0, 3]], [1, 1, -1])


def octant_crossings() -> tuple[FloatArray, FloatArray]:
    """Return the exact instants, (3,), and states, (3, 3), at y, z and x = 0.

    Mode by mode with matrix exponentials, to rounding.
    """
    from scipy.linalg import expm
    from scipy.optimize import brentq

    state = np.array([*INITIAL_STATE, 1.0])
    now = 0.0
    times = []
    states = []
    for rows, constants, axis in LEGS:
        flow = affine_flow(rows, constants)

        # The defaults keep what flow and state are in this turn of the loop.
        def height(
            t: float, flow: FloatArray = flow, start: FloatArray = state, k: int = axis
        ) -> float:
            there = expm(flow * t) @ start
            return float(there[k])

        # A plane that has just been left is no root. No mode lasts for 0.3.
        span = brentq(height, 1e-9, 0.3, xtol=1e-16)
        state = expm(flow * span) @ state
        now += span
        times.append(now)
        states.append(state[:3])
    return np.array(times), np.array(states)


def octant_end() -> FloatArray:
    """Return the exact state (3,) at the end of the span, to rounding."""
    from scipy.linalg import expm

    times, states = octant_crossings()
    flow = affine_flow(*LAST)
    left = T_SPAN[1] - times[-1]
    start = np.append(states[-1], 1.0)
    end = expm(flow * left) @ start
    return np.asarray(end[:3])


def affine_flow(rows: ArrayLike, constants: ArrayLike) -> FloatArray:
    """Return the generator (4, 4) of an affine flow of the state with a 1 appended."""
    matrix = np.array(rows)
    column = np.array(constants)[:, None]
    # The appended 1 stays 1.
    last_row = np.zeros((1, 4))
    return np.block([[matrix, column], [last_row]])
