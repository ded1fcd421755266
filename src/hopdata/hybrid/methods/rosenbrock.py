# ruff: noqa: ARG001 (methods are all called alike)
"""One step of the Rosenbrock method Rodas5P, for modes that are too stiff for explicit methods.

Eight linear systems with one matrix; no iteration. L-stable and stiffly accurate: however strongly
a contact is damped, only accuracy limits the step.

`step` and `interpolant` are templates: FIELD, N, FILL_JACOBIAN and TIME_DERIVATIVE are put in, the
last two being specialised functions of `differences`. The field evaluations of a step, which vary,
are left in INFO, and the Jacobian at its start in the rows from JAC on.
"""

from __future__ import annotations

from typing import Any

from hopdata.hybrid.compiled.views import FloatTable, FloatVector
from hopdata.hybrid.methods.dense_linear_algebra import factorise, solve_factorised
from hopdata.hybrid.methods.rodas5p import GAMMA, STAGES, TIME, A, C, D, H
from hopdata.hybrid.methods.rows import END, K1, KEND, P1, SCRATCH, SLOPE, W1, Y, row

NAME = "rosenbrock"
EVALUATIONS = STAGES + 1  # with a given Jacobian and a field that does not depend on time
DEGREE = 4
DENSE_ERROR = 1  # of the interpolant, in units of the estimated error of the step
BASIS = "alternating"
ORDER = 5

FIELD: Any = None
FILL_JACOBIAN: Any = None
TIME_DERIVATIVE: Any = None
N: int = 0

U, PIVOTS, INFO, JAC = W1, W1 + STAGES, W1 + STAGES + 1, W1 + STAGES + 2

TINY = 1e-300


def work_rows(n: int) -> int:
    """Return the number of work rows for `n` states: stages, exchanges, count, two matrices."""
    return STAGES + 2 + 2 * n


def step(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector
) -> float:
    """Take the stages; return the embedded error in units of the tolerance (root mean square)."""
    lu = JAC + N
    s[INFO, 0] = FILL_JACOBIAN(t, dt, s, mode, params, atol, JAC)
    s[INFO, 0] += TIME_DERIVATIVE(t, dt, s, mode, params, KEND) + STAGES
    for i in range(N):
        for j in range(N):
            s[lu + i, j] = -s[JAC + i, j]
        s[lu + i, i] += 1.0 / (GAMMA * dt)
    factorise(s, lu, PIVOTS, N)
    for k in range(STAGES):
        for i in range(N):
            state, bend = s[Y, i], 0.0
            for m in range(k):
                state += A[k, m] * s[U + m, i]
                bend += C[k, m] * s[U + m, i]
            s[SCRATCH, i] = state
            s[U + k, i] = bend / dt + D[k] * dt * s[KEND, i]
        if k == 0:
            for i in range(N):
                s[SLOPE, i] = s[K1, i]
        else:
            FIELD(t + TIME[k] * dt, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for i in range(N):
            s[U + k, i] += s[SLOPE, i]
        solve_factorised(s, lu, PIVOTS, U + k, N)
    total = 0.0
    for i in range(N):
        error = s[U + STAGES - 1, i]
        s[END, i] = s[SCRATCH, i] + error
        size = max(abs(s[Y, i]), abs(s[END, i]))
        total += (error / max(atol[i] + rtol * size, TINY)) ** 2
    FIELD(t + dt, row(s, END), mode, params, row(s, KEND))
    return (total / N) ** 0.5


def interpolant(t: float, dt: float, s: FloatTable, mode: Any, params: Any) -> int:
    """Write the coefficients of the dense output of order 4, in the alternating basis."""
    for i in range(N):
        first, second, third = 0.0, 0.0, 0.0
        for m in range(STAGES):
            first += H[0, m] * s[U + m, i]
            second += H[1, m] * s[U + m, i]
            third += H[2, m] * s[U + m, i]
        s[P1, i] = s[END, i] - s[Y, i]
        s[P1 + 1, i] = first
        s[P1 + 2, i] = second + third
        s[P1 + 3, i] = -third
    return DEGREE
