"""The flow's Jacobian over a short step, along the interpolant of the state: of order four.

Phi' = A(t) Phi, where A, the field's derivative, is taken at the two Gauss points of the step and a
straight line between them: its integral and its first moment, on which alone order four depends,
are then right (Blanes, Casas, Oteo, Ros 2009, section 5.2). The linear equation is stepped over by
the classical Runge-Kutta method. Two evaluations of A and four products do the work of one each for
each stage of a method, and the stages need not be those of a step that ends where the flip is.

The driver puts the states at the two points into the rows SCRATCH and SLOPE.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from hopdata.hybrid.compiled.views import FloatTable
from hopdata.hybrid.driver.layout import GAUSS_1, GAUSS_2, PHI_MOTION, PHI_ROWS, SCRATCH, SLOPE
from hopdata.hybrid.methods.tangent import LOOSER

# Put in for each scene.
STAGE_JACOBIAN: Any = None
ADD_PRODUCT: Any = None
FASTEST_MOTION: Any = None
N = 0

HIGHEST_ORDER = 5  # of a method: one of higher order takes steps that are long for this
TILT = 0.5 * sqrt(3.0)  # from the mean of the Gauss points to an end, in units of their distance
BLOCKS = 5  # of the table, behind the single rows
ERROR = 0.01  # times (step times fastest motion)^5: 1 / 120, and a little for the two points


def short_tangent(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any
) -> float:
    """Write the new Jacobian into the second block; return its error in units of the tolerance."""
    begin, middle = 3 * N + PHI_ROWS, 4 * N + PHI_ROWS  # A there
    end, second, third, fourth = 5 * N + PHI_ROWS, 6 * N + PHI_ROWS, 7 * N + PHI_ROWS, 2 * N
    STAGE_JACOBIAN(t + GAUSS_1 * dt, dt, rtol, s, mode, params, atol, phi)
    for e in range(N * N):
        phi[begin, e] = phi[N, e]
    for i in range(N):
        s[SCRATCH, i] = s[SLOPE, i]
    STAGE_JACOBIAN(t + GAUSS_2 * dt, dt, rtol, s, mode, params, atol, phi)
    for e in range(N * N):
        mean, tilt = 0.5 * (phi[begin, e] + phi[N, e]), TILT * (phi[N, e] - phi[begin, e])
        phi[begin, e] = mean - tilt
        phi[middle, e] = mean
        phi[end, e] = mean + tilt
    ADD_PRODUCT(phi, second, 0, begin, 0, 0.5 * dt)
    ADD_PRODUCT(phi, third, 0, middle, second, 0.5 * dt)
    ADD_PRODUCT(phi, fourth, 0, middle, third, dt)
    for e in range(N * N):
        phi[second, e] = (phi[second, e] + 2.0 * phi[third, e] + phi[fourth, e] - phi[0, e]) / 3.0
    ADD_PRODUCT(phi, N, second, end, fourth, dt / 6.0)
    fastest = FASTEST_MOTION(phi, middle)
    phi[3 * N + PHI_MOTION, 0] = fastest
    turn = dt * dt * fastest
    return ERROR * turn * turn * sqrt(turn) / (LOOSER * rtol)
