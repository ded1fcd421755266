"""Forces of the springs under the plate, and their derivatives, from three sums over contacts.

Each spring stands upright at x_i, guided so that its end moves on a vertical line, without mass or
friction. The plate's line passes above it at z - tan(theta) (x - x_i), so that its compression is

    h_i = L0 + tan(theta) (x - x_i) - z.

While h_i > 0 it pushes up with F_i = k h_i + c dh_i/dt. The generalised forces are -F_i Dh_i, the
gradient of the potential (k / 2) h_i^2: energy is kept for c = 0. In other words, the reaction is
normal to the plate, as it must be without friction, and its vertical part is F_i. Contact depends
on position alone: a damped spring pulls a little just before it lets go.

With a_i = x - x_i, compression and rate are affine in a_i, and so is F_i = P + Q a_i. All that the
plate feels are sums over the contacts of 1, a_i and a_i^2.
"""

from __future__ import annotations

import math

from numba import njit

from hopdata.hybrid.solution import FloatArray, IntArray

# Places in the flat vector of parameters; the i-th spring stands at first + i * spacing.
GRAVITY, MASS, INERTIA, REST_LENGTH, STIFFNESS, DAMPING, FIRST, SPACING = range(8)
N_PARAMS = 8

Sums = tuple[float, float, float]  # over the contacts of 1, a and a^2


@njit(error_model="numpy")
def compression(i: float, y: FloatArray, p: FloatArray) -> float:
    """Compression h_i of spring i, m; negative where the plate is above it."""
    arm = y[0] - p[FIRST] - i * p[SPACING]
    return p[REST_LENGTH] + math.tan(y[2]) * arm - y[1]


@njit(error_model="numpy")
def added_up(y: FloatArray, mode: IntArray, p: FloatArray) -> Sums:
    """Return the sums over the springs whose locks say contact."""
    count, arms, squares = 0.0, 0.0, 0.0
    arm = y[0] - p[FIRST]
    for i in range(len(mode)):
        if mode[i] > 0:
            a = arm - i * p[SPACING]
            count += 1.0
            arms += a
            squares += a * a
    return count, arms, squares


@njit(error_model="numpy")
def push(y: FloatArray, p: FloatArray, slope: float) -> tuple[float, float]:
    """Coefficients (P, Q) of the force P + Q a of a spring in contact, at this slope."""
    steepening = (1.0 + slope * slope) * y[5]
    force = p[STIFFNESS] * (p[REST_LENGTH] - y[1]) + p[DAMPING] * (slope * y[3] - y[4])
    return force, p[STIFFNESS] * slope + p[DAMPING] * steepening


@njit(error_model="numpy")
def fill_rates(y: FloatArray, p: FloatArray, sums: Sums, dy: FloatArray) -> None:
    """Fill the rate of the state, (6,)."""
    slope = math.tan(y[2])
    at_centre, per_arm = push(y, p, slope)
    force = at_centre * sums[0] + per_arm * sums[1]
    moment = at_centre * sums[1] + per_arm * sums[2]
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3] = -slope * force / p[MASS]
    dy[4] = force / p[MASS] - p[GRAVITY]
    dy[5] = -(1.0 + slope * slope) * moment / p[INERTIA]


@njit(error_model="numpy")
def fill_force_row(y: FloatArray, p: FloatArray, s0: float, s1: float, row: FloatArray) -> None:
    """Fill the gradient, (6,), of the sum of F_i w_i at fixed weights, sums s0 of w, s1 of w a."""
    slope, k, c = math.tan(y[2]), p[STIFFNESS], p[DAMPING]
    grow = 1.0 + slope * slope  # derivative of the slope with respect to the angle
    row[0] = push(y, p, slope)[1] * s0
    row[1] = -k * s0
    row[2] = grow * (c * y[3] * s0 + (k + 2.0 * c * slope * y[5]) * s1)
    row[3] = c * slope * s0
    row[4] = -c * s0
    row[5] = c * grow * s1


@njit(error_model="numpy")
def fill_jacobian(y: FloatArray, p: FloatArray, sums: Sums, jac: FloatArray) -> None:
    """Fill the derivative of the rates with respect to the state, (6, 6), which begins as zeros."""
    slope = math.tan(y[2])
    grow = 1.0 + slope * slope
    at_centre, per_arm = push(y, p, slope)
    force = at_centre * sums[0] + per_arm * sums[1]
    moment = at_centre * sums[1] + per_arm * sums[2]
    for i in range(3):
        jac[i, 3 + i] = 1.0
    fill_force_row(y, p, sums[0], sums[1], jac[4])
    fill_force_row(y, p, sums[1], sums[2], jac[5])
    jac[5, 0] += force  # the arms are not fixed: each grows with x
    for j in range(6):
        jac[4, j] /= p[MASS]
        jac[3, j] = -slope * jac[4, j]
        jac[5, j] *= -grow / p[INERTIA]
    jac[3, 2] -= grow * force / p[MASS]
    jac[5, 2] -= 2.0 * slope * grow * moment / p[INERTIA]
