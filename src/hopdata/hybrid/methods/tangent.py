"""The derivative of an explicit step with respect to its initial state, stage by stage.

It is the derivative of the numerical map itself, so the flow's Jacobian converges with
the order of the method, as the state does. Stage k is at the state Y + dt sum_j a_kj
K_j, whose derivative is M = Phi + dt sum_j a_kj dK_j, and dK_k = Df M.

The table phi has rows of length N: the flow's Jacobian; blocks of N rows for Df
(finally for the new Jacobian) and for M; some single rows; and one block dK for each
stage (see `driver.layout`).
"""

from collections.abc import Sequence
from math import factorial, nan, sqrt
from typing import Any

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.memory import FloatTable, fma, square
from hopdata.hybrid.methods.explicit import INDENT, Tableau, combination
from hopdata.hybrid.methods.taylor import fastest_motion

# Products of blocks of a tangent's table, named by their first rows. Sums are taken in
# order, and each product and sum is rounded once (see `fma`).


@code.kernel_apart
def multiply(phi: FloatTable, target: int, left: int, right: int) -> None:
    """Write the product of two blocks into a third one.

    Four columns are processed at a time, so that their sums stay in registers and
    vectorise.
    """
    n = phi.width
    for i in range(n):
        for j in range(0, n - 3, 4):
            one = phi[left + i, 0]
            a, b = one * phi[right, j], one * phi[right, j + 1]
            c, d = one * phi[right, j + 2], one * phi[right, j + 3]
            for k in range(1, n):
                one, r = phi[left + i, k], right + k
                a, b = fma(one, phi[r, j], a), fma(one, phi[r, j + 1], b)
                c, d = fma(one, phi[r, j + 2], c), fma(one, phi[r, j + 3], d)
            phi[target + i, j], phi[target + i, j + 1] = a, b
            phi[target + i, j + 2], phi[target + i, j + 3] = c, d
        for j in range(n - n % 4, n):
            total = phi[left + i, 0] * phi[right, j]
            for k in range(1, n):
                total = fma(phi[left + i, k], phi[right + k, j], total)
            phi[target + i, j] = total


@code.kernel
def add_product(
    phi: FloatTable, target: int, base: int, left: int, right: int, factor: float
) -> None:
    """Write base + factor left right into the block `target`, which is none of these."""
    multiply(phi, target, left, right)
    for i in range(phi.width):
        for j in range(phi.width):
            phi[target + i, j] = fma(factor, phi[target + i, j], phi[base + i, j])


FIFTH_ROOT_OF_EPS = 2.0 ** (
    -52 / 5
)  # best relative increment for fourth-order differences
ABSOLUTELY_TINY = 1e-290
LOOSER = (
    10.0  # error of the Jacobian allowed per step, in relative tolerances of the state
)

# Fourth-order differences: places of the values, in increments, and their weights. The
# two pairs are in the golden ratio, so no period fits whole turns into both. The
# difference between the derivatives from either pair shows whether the increment is
# small enough. If not, as for the sine of a thousand turns, a smaller one is tried.
GOLDEN = 0.5 + sqrt(1.25)
SHIFTS = (GOLDEN, 1.0, -1.0, -GOLDEN)
INNER, OUTER = 0.5 * GOLDEN, 0.5 / GOLDEN**2
# Largest relative difference between the two: the derivative then errs by 1e-10
BENT = 1e-5
NOISE = 2.0**-44  # fraction of a state below which changes are negligible
SHORTER, LONGER, ATTEMPTS = 1.0 / 16.0, 16.0, 7


@code.kernel_in_loop
def settle(
    v: Any,
    first: int,
    attempt: int,
    step: float,
    slopes: Any,
    into: int,
    j: int,
    n: int,
) -> bool:
    """Write those of n derivatives that are now good into column `j`; return whether all are.

    Where none is good, that of the first attempt is kept. The rows of `v` from `first`
    on hold four rows of values, flags of the good ones, and the possible errors of the
    values.
    """
    all_good, again = True, attempt > 0
    for i in range(n):
        outer, inner = v[first, i] - v[first + 3, i], v[first + 1, i] - v[first + 2, i]
        change, apart = (
            INNER * inner - OUTER * outer,
            abs(inner - outer * (GOLDEN - 1.0)),
        )
        limit, done = BENT * abs(change), again and v[first + 4, i] != 0.0
        good = apart < limit if again else apart <= limit + v[first + 5, i]
        if not again or (good and not done):
            slopes[into + i, j] = change / step
        v[first + 4, i] = 1.0 if good or done else 0.0
        all_good = all_good and (good or done)
    return all_good


@code.kernel
def evaluate_beside(
    t: float,
    j: int,
    step: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    phi: Any,
    field: int,
) -> None:
    """Evaluate the field at SCRATCH with four shifts of state j; NaN remains if it raises."""
    shifted, values = 3 * phi.width, 3 * phi.width + at.PHI_VALUES
    for side in range(4):
        phi[shifted, j] = s[at.SCRATCH, j] + SHIFTS[side] * step
        phi[values + side, 0] = nan
        code.call_field_on_arrays(
            field, t, phi, shifted, mode, params, phi, values + side
        )


@code.kernel_apart
def stage_jacobian(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any,
    field: int, jacobian: int,
) -> None:  # fmt: skip
    """Write the field's derivative at SCRATCH: the user's, or finite differences.

    The differences are central and of fourth order, usually with 4 n field evaluations.
    Each increment is a fraction of the largest of the state's size, its change in the
    step, and the size at which the absolute tolerance exceeds the relative one, so it
    does not depend on units.
    """
    n = phi.width
    if jacobian != 0:
        square(phi, n)[:] = 0.0
        code.call_jacobian(jacobian, t, s, at.SCRATCH, mode, params, square(phi, n))
        return
    shifted, values, per_s = 3 * n, 3 * n + at.PHI_VALUES, 1.0 / dt
    for i in range(n):
        phi[shifted, i] = s[at.SCRATCH, i]
        phi[values + 5, i] = NOISE * (per_s * abs(s[at.Y, i]) + abs(s[at.K1, i]))
    for j in range(n):
        size = max(
            abs(s[at.SCRATCH, j]),
            abs(s[at.Y, j]),
            dt * abs(s[at.K1, j]),
            atol[j] / rtol,
        )
        part = min(phi[3 * n + at.PHI_PART, j] * LONGER, 1.0)
        largest = FIFTH_ROOT_OF_EPS * (size if size > ABSOLUTELY_TINY else 1.0)
        for attempt in range(ATTEMPTS):
            evaluate_beside(t, j, part * largest, s, mode, params, phi, field)
            if settle(phi, values, attempt, part * largest, phi, n, j, n):
                break
            part *= SHORTER
        else:
            part = 1.0
        phi[3 * n + at.PHI_PART, j] = part
        phi[shifted, j] = s[at.SCRATCH, j]


def _matrices(target: str, weights: Sequence[float]) -> list[str]:
    """Return code that forms a whole block entry by entry, which vectorises."""
    blocks = [f"3 * N + {at.PHI_ROWS} + {stage} * N" for stage in range(len(weights))]
    terms = combination(weights, blocks).replace("s[", "phi[").replace(", i]", ", e]")
    return [
        "for e in range(N * N):",
        INDENT + f"phi[{target}, e] = phi[0, e] + dt * ({terms})",
    ]


def error_constant(tableau: Tableau) -> float:
    """Return the coefficient of z^(p + 1) in the error of a step of length z for y' = y."""
    stages = len(tableau.weights)
    matrix = np.zeros((stages, stages))
    for k, weights in enumerate(tableau.stages, start=1):
        matrix[k, : len(weights)] = weights
    power = np.linalg.matrix_power(matrix, tableau.order) @ np.ones(stages)
    return float(
        abs(1.0 / factorial(tableau.order + 1) - np.dot(tableau.weights, power))
    )


def _error(tableau: Tableau) -> list[str]:
    """Return code that estimates the error from the fastest motion of the linear flow.

    The state is no guide: its error says nothing where it rests, and once a fast motion
    has died out, only the field's derivative still shows it.
    """
    power = 0.5 * (tableau.order + 1)
    return [
        "fastest = fastest_motion(phi, N)",
        *_matrices("N", tableau.weights),
        f"phi[3 * N + {at.PHI_MOTION}, 0] = fastest",
        f"error = {error_constant(tableau)!r} * (dt * dt * fastest) ** {power!r}",
        f"return error / ({LOOSER!r} * rtol)",
    ]


def tangent_code(tableau: Tableau) -> list[str]:
    """Return the body of ``tangent(t, dt, rtol, s, mode, params, atol, phi, field, jacobian)``."""
    slopes = tableau.slope_rows
    lines = ["N = phi.width"]
    for k in range(len(tableau.weights)):
        weights = tableau.stages[k - 1] if k > 0 else ()
        node = tableau.nodes[k - 1] if k > 0 else 0.0
        state = (
            f"s[{at.SCRATCH}, i] = s[{at.Y}, i] + dt * ({combination(weights, slopes)})"
        )
        lines += ["for i in range(N):", INDENT + state, *_matrices("2 * N", weights)]
        lines += [
            f"time = t + {node!r} * dt",
            "stage_jacobian(time, dt, rtol, s, mode, params, atol, phi, field, jacobian)",
            f"multiply(phi, 3 * N + {at.PHI_ROWS} + {k} * N, N, 2 * N)",
        ]
    return [*lines, *_error(tableau)]


# The flow's Jacobian over a short step, along the interpolant of the state, with order
# four.
#
# Phi' = A(t) Phi, where A is the field's derivative. It is evaluated at the step's two
# Gauss points and replaced by a straight line through them. This preserves its integral
# and its first moment, on which alone order four depends (Blanes, Casas, Oteo, Ros
# 2009, section 5.2). The linear equation is then solved by one step of the classical
# Runge-Kutta method. Two evaluations of A and four products replace one of each for
# every stage of a method. No stages are needed, so the step may end anywhere on an
# interpolant, such as at a flip.
#
# The driver writes the states at the two points into rows SCRATCH and SLOPE.

HIGHEST_ORDER = (
    5  # highest order of a method: steps of higher ones are too long for this
)
TILT = 0.5 * sqrt(
    3.0
)  # distance of an end from the mean of the Gauss points, over their distance
BLOCKS = 5  # blocks of the table after the single rows
# Error over (step times fastest motion)^5: 1 / 120, and a bit for the two points
ERROR = 0.01


def short_tangent(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any,
    field: int, jacobian: int,
) -> float:  # fmt: skip
    """Write the new Jacobian into the second block; return its error in units of the tolerance."""
    n = phi.width
    begin = 3 * n + at.PHI_ROWS
    middle, end = begin + n, begin + 2 * n  # A at these places
    second, third, fourth = begin + 3 * n, begin + 4 * n, 2 * n
    first, last = t + at.GAUSS_1 * dt, t + at.GAUSS_2 * dt
    stage_jacobian(first, dt, rtol, s, mode, params, atol, phi, field, jacobian)
    for e in range(n * n):
        phi[begin, e] = phi[n, e]
    for i in range(n):
        s[at.SCRATCH, i] = s[at.SLOPE, i]
    stage_jacobian(last, dt, rtol, s, mode, params, atol, phi, field, jacobian)
    for e in range(n * n):
        mean, tilt = (
            0.5 * (phi[begin, e] + phi[n, e]),
            TILT * (phi[n, e] - phi[begin, e]),
        )
        phi[begin, e] = mean - tilt
        phi[middle, e] = mean
        phi[end, e] = mean + tilt
    add_product(phi, second, 0, begin, 0, 0.5 * dt)
    add_product(phi, third, 0, middle, second, 0.5 * dt)
    add_product(phi, fourth, 0, middle, third, dt)
    for e in range(n * n):
        phi[second, e] = (
            phi[second, e] + 2.0 * phi[third, e] + phi[fourth, e] - phi[0, e]
        ) / 3.0
    add_product(phi, n, second, end, fourth, dt / 6.0)
    fastest = fastest_motion(phi, middle)
    phi[3 * n + at.PHI_MOTION, 0] = fastest
    turn = dt * dt * fastest
    return ERROR * turn * turn * sqrt(turn) / (LOOSER * rtol)
