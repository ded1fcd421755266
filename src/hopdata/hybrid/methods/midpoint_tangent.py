"""The flow's Jacobian over a very short step, by the field's derivative in its middle: of order 2.

Phi' = A(t) Phi, with A as in the middle throughout; its exponential is taken to the third power of
the step. One evaluation of A and three products: where events follow each other closely, most
steps turn the state by so little that no more is needed.

The driver puts the state in the middle into the row SCRATCH.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from hopdata.hybrid.compiled.views import FloatTable
from hopdata.hybrid.driver.layout import PHI_MOTION, PHI_ROWS
from hopdata.hybrid.methods.tangent import LOOSER

# Put in for each scene.
STAGE_JACOBIAN: Any = None
ADD_PRODUCT: Any = None
FASTEST_MOTION: Any = None
N = 0

ERROR = 0.1  # times (step times fastest motion)^3: a bend of A and its change, 1 / 24 and 1 / 12


def midpoint_tangent(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any
) -> float:
    """Write the new Jacobian into the second block; return its error in units of the tolerance."""
    first, second, new = 3 * N + PHI_ROWS, 4 * N + PHI_ROWS, 2 * N
    STAGE_JACOBIAN(t + 0.5 * dt, dt, rtol, s, mode, params, atol, phi)
    fastest = FASTEST_MOTION(phi, N)
    ADD_PRODUCT(phi, first, 0, N, 0, dt / 3.0)
    ADD_PRODUCT(phi, second, 0, N, first, 0.5 * dt)
    ADD_PRODUCT(phi, new, 0, N, second, dt)
    for e in range(N * N):
        phi[N, e] = phi[new, e]
    phi[3 * N + PHI_MOTION, 0] = fastest
    turn = dt * dt * fastest
    return ERROR * turn * sqrt(turn) / (LOOSER * rtol)
