# ruff: noqa: ARG001 (the integrator prescribes the signatures of its callbacks)
"""The plate for very many springs: rates in constant time, one guard at a time.

The field needs only how many springs are in contact, and the sums of their numbers and of the
squares of these. The handler keeps the three up to date in the memory behind the parameters. They
are whole numbers, so that they stay exact however often springs come and go.
"""

from __future__ import annotations

import math

from numba import njit

from hopdata.hybrid import field, guard, jacobian, on_event, rate_bound
from hopdata.hybrid.solution import FloatArray, IntArray
from hopdata.scenes import plate_forces as pf

COUNT, NUMBERS, SQUARES = pf.N_PARAMS, pf.N_PARAMS + 1, pf.N_PARAMS + 2
N_MEMORY = 3


@njit(error_model="numpy")
def sums_of_arms(y: FloatArray, p: FloatArray) -> pf.Sums:
    """Return the sums over the contacts of 1, a and a^2, where a = x - x_i."""
    arm, step = y[0] - p[pf.FIRST], p[pf.SPACING]
    arms = arm * p[COUNT] - step * p[NUMBERS]
    squares = arm * (arms - step * p[NUMBERS]) + step * step * p[SQUARES]
    return p[COUNT], arms, squares


@field
def plate_field_of_sums(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return gravity, and the push of all springs in contact, from the sums."""
    pf.fill_rates(y, params, sums_of_arms(y, params), dy)


@guard
def plate_guard(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    k: int,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Return the compression of spring k: positive in contact."""
    slope, arm = math.tan(y[2]), y[0] - params[pf.FIRST] - k * params[pf.SPACING]
    h[k] = params[pf.REST_LENGTH] + slope * arm - y[1]
    hdot[k] = slope * dy[0] - dy[1] + (1.0 + slope * slope) * dy[2] * arm


@rate_bound
def plate_rate_bound(
    t: float, y: FloatArray, dy: FloatArray, mode: IntArray, params: FloatArray
) -> float:
    """Return the largest rate of any compression, m/s: that of the first or of the last spring."""
    slope, arm = math.tan(y[2]), y[0] - params[pf.FIRST]
    rate, per_arm = slope * dy[0] - dy[1], (1.0 + slope * slope) * dy[2]
    last = arm - (len(mode) - 1) * params[pf.SPACING]
    return max(abs(rate + per_arm * arm), abs(rate + per_arm * last))


@jacobian
def plate_jacobian(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, jac: FloatArray
) -> None:
    """Return the derivative of the field with respect to the state."""
    pf.fill_jacobian(y, params, sums_of_arms(y, params), jac)


@on_event
def update_sums(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, spring: int, direction: int
) -> int:
    """Add a spring that touches to the sums, take away one that lets go."""
    params[COUNT] += direction
    params[NUMBERS] += direction * spring
    params[SQUARES] += direction * float(spring) * float(spring)
    return 0
