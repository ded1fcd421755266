# ruff: noqa: ARG001 (methods are all called alike)
"""Derivatives of the field by differences, where the user gives none.

`jacobian_by_user` and `jacobian_by_differences` are templates with one signature: FIELD, JACOBIAN
and N are put in. Either fills the rows from `first` on with the (n, n) derivative at (t, Y).
"""

from __future__ import annotations

from typing import Any

from hopdata.hybrid.compiled.views import FloatTable, FloatVector
from hopdata.hybrid.methods.rows import K1, SCRATCH, SLOPE, Y, matrix, row

FIELD: Any = None
JACOBIAN: Any = None
N: int = 0

CUBE_ROOT_OF_EPS = 2.0 ** (-52 / 3)
TINY = 1e-290
# Three values ahead in time: an increment of 2^-9 steps balances their rounding and truncation.
TIME_INCREMENT = 2.0**-9
LEAST_INCREMENT = 2.0**-40  # of the time itself


def jacobian_by_user(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector, first: int
) -> int:
    """Fetch the user's derivative (entries left alone are zero); return field evaluations, 0."""
    for i in range(N):
        for j in range(N):
            s[first + i, j] = 0.0
    JACOBIAN(t, row(s, Y), mode, params, matrix(s, first, N))
    return 0


def jacobian_by_differences(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector, first: int
) -> int:
    """Take central differences; return field evaluations, 2 n.

    The increment of a state is a cube root of the rounding error times its size, or its change
    within the step if that is larger: no unit of length or time enters. A state that is smaller
    than its absolute tolerance counts as zero, and is changed by that tolerance.
    """
    for i in range(N):
        s[SCRATCH, i] = s[Y, i]
    for j in range(N):
        size = max(abs(s[Y, j]), dt * abs(s[K1, j]))
        increment = CUBE_ROOT_OF_EPS * size if size > atol[j] else max(atol[j], TINY)
        above, below = s[Y, j] + increment, s[Y, j] - increment
        s[SCRATCH, j] = above
        FIELD(t, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for i in range(N):
            s[first + i, j] = s[SLOPE, i]
        s[SCRATCH, j] = below
        FIELD(t, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for i in range(N):
            s[first + i, j] = (s[first + i, j] - s[SLOPE, i]) / (above - below)
        s[SCRATCH, j] = s[Y, j]
    return 2 * N


def time_derivative(t: float, dt: float, s: FloatTable, mode: Any, params: Any, into: int) -> int:
    """Fill row `into` with df/dt at (t, Y), where K1 is the field; return field evaluations.

    Third-order forward differences, which stay inside the step. A field that does not change at
    all is taken not to depend on time, for one evaluation.
    """
    increment = max(TIME_INCREMENT * dt, LEAST_INCREMENT * abs(t))
    FIELD(t + increment, row(s, Y), mode, params, row(s, SLOPE))
    changed = False
    for i in range(N):
        rise = s[SLOPE, i] - s[K1, i]
        changed = changed or rise != 0.0
        s[into, i] = 3.0 * rise / increment
    if not changed:
        return 1
    FIELD(t + 2.0 * increment, row(s, Y), mode, params, row(s, SLOPE))
    for i in range(N):
        s[into, i] -= 1.5 * (s[SLOPE, i] - s[K1, i]) / increment
    FIELD(t + 3.0 * increment, row(s, Y), mode, params, row(s, SLOPE))
    for i in range(N):
        s[into, i] += (s[SLOPE, i] - s[K1, i]) / (3.0 * increment)
    return 3
