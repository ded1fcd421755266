# ruff: noqa: ARG001 (methods are all called alike)
"""When a mode is too stiff for an explicit method, and when it is no longer.

Explicit methods: Hairer and Wanner's test (*Solving Ordinary Differential Equations II*, section
IV.2). The last stage of DOPRI5 and of DOP853 stands at the end of the step, near the new state;
two slopes there give, for no further evaluation, the rate of the fastest motion. Where stability
limits the step, dt times that rate stays near the edge of the region of stability.

Rosenbrock: the Jacobian is at hand, and a few products with it give its spectral radius.

States are measured by their tolerances, so that no unit of length or time enters.
"""

from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.memory import FloatTable, FloatVector, row, square
from hopdata.hybrid.layout import END, K1, KEND, P1, SCRATCH, SLOPE, W1, Y
from hopdata.hybrid.methods.explicit import coefficients

# Small dense systems of linear equations in rows of the table of states, without allocation.


@kernel
def factorise(s: FloatTable, lu: int, pivots: int, n: int) -> None:
    """Replace the (n, n) matrix in the rows from `lu` on by its factors, with partial pivoting.

    The diagonal is replaced by its reciprocal; row `pivots` takes the row exchanges. A singular
    matrix gives infinities, and so a solution that is not finite.
    """
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(s[lu + i, k]) > abs(s[lu + best, k]):
                best = i
        s[pivots, k] = best
        if best != k:
            for j in range(n):
                s[lu + k, j], s[lu + best, j] = s[lu + best, j], s[lu + k, j]
        s[lu + k, k] = 1.0 / s[lu + k, k]
        for i in range(k + 1, n):
            factor = s[lu + i, k] * s[lu + k, k]
            s[lu + i, k] = factor
            for j in range(k + 1, n):
                s[lu + i, j] -= factor * s[lu + k, j]


@kernel
def solve_factorised(s: FloatTable, lu: int, pivots: int, x: int, n: int) -> None:
    """Replace the right-hand side in row `x` by the solution."""
    for k in range(n):
        best = int(s[pivots, k])
        s[x, k], s[x, best] = s[x, best], s[x, k]
    for i in range(1, n):
        total = s[x, i]
        for j in range(i):
            total -= s[lu + i, j] * s[x, j]
        s[x, i] = total
    for i in range(n - 1, -1, -1):
        total = s[x, i]
        for j in range(i + 1, n):
            total -= s[lu + i, j] * s[x, j]
        s[x, i] = total * s[lu + i, i]


# Derivatives of the field by differences, where the user gives none.
#
# `jacobian_by_user` and `jacobian_by_differences` are templates with one signature: FIELD, JACOBIAN
# and N are put in. Either fills the rows from `first` on with the (n, n) derivative at (t, Y).

FIELD: Any = None
JACOBIAN: Any = None
N: int = 0

CUBE_ROOT_OF_EPS = 2.0 ** (-52 / 3)
TINY, SMALLEST = 1e-290, 1e-300  # no increment, and no tolerance, is smaller
# Three values ahead in time: an increment of 2^-9 steps balances their rounding and truncation.
TIME_INCREMENT = 2.0**-9
LEAST_INCREMENT = 2.0**-40  # of the time itself


def jacobian_by_user(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector, first: int
) -> int:
    """Fetch the user's derivative (entries left alone are zero); return field evaluations, 0."""
    square(s, first)[:] = 0.0
    JACOBIAN(t, row(s, Y), mode, params, square(s, first))
    return 0


def jacobian_by_differences(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector, first: int
) -> int:
    """Take central differences; return field evaluations, 2 n.

    The increment of a state is a cube root of the rounding error times its size, or its change
    within the step if that is larger: no unit of length or time enters. A state that is smaller
    than its absolute tolerance counts as zero, and is changed by that tolerance.
    """
    row(s, SCRATCH)[:] = row(s, Y)
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


# Coefficients of Rodas5P, whose 8 stages need no product with the Jacobian.

STAGES = 8
_RODAS = coefficients("rodas5p")
GAMMA: float = _RODAS["gamma"]


def lower_triangle(rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Return a strictly lower triangular matrix (STAGES, STAGES) of the rows from the second on."""
    matrix = np.zeros((STAGES, STAGES))
    for i, values in enumerate(rows, start=1):
        matrix[i, :i] = values
    return matrix


# Stage i stands at the state y + sum_j A[i, j] u_j; the new state is the last one plus u_8, and
# u_8 alone is the difference to the embedded solution.
# u_i solves (1 / (GAMMA dt) - J) u_i = f_i + sum_j C[i, j] / dt u_j + D[i] dt df/dt.
A, C = lower_triangle(_RODAS["a"]), lower_triangle(_RODAS["c"])

# Times of the stages, in steps, and weights of the field's time derivative.
TIME, D = np.array(_RODAS["time"]), np.array(_RODAS["d"])

# Dense output of order 4: y + theta (rise + (1 - theta) (h_1 + theta h_2 + theta^2 h_3)) with
# h_i = sum_j H[i, j] u_j.
H = np.array(_RODAS["h"])


# One step of the Rosenbrock method Rodas5P, for modes that are too stiff for explicit methods.
#
# Eight linear systems with one matrix; no iteration. L-stable and stiffly accurate: however
# strongly a contact is damped, only accuracy limits the step.
#
# `step` and `interpolant` are templates: FIELD, N, FILL_JACOBIAN and TIME_DERIVATIVE are put in,
# the last two being specialised functions of `differences`. The field evaluations of a step, which
# vary, are left in INFO, and the Jacobian at its start in the rows from JAC on.

EVALUATIONS = STAGES + 1  # with a given Jacobian and a field that does not depend on time
DEGREE = 4
DENSE_ERROR = 1  # of the interpolant, in units of the estimated error of the step
ORDER = 5
FILL_JACOBIAN: Any = None
TIME_DERIVATIVE: Any = None

U, PIVOTS, INFO, JAC = W1, W1 + STAGES, W1 + STAGES + 1, W1 + STAGES + 2


def work_rows(n: int) -> int:
    """Return the number of work rows for `n` states: stages, exchanges, count, two matrices."""
    return STAGES + 2 + 2 * n


def step(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: FloatVector,
    field: int,
) -> float:  # fmt: skip
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
            row(s, SLOPE)[:] = row(s, K1)
        else:
            FIELD(t + TIME[k] * dt, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for i in range(N):
            s[U + k, i] += s[SLOPE, i]
        solve_factorised(s, lu, PIVOTS, U + k, N)
    total = 0.0
    for i in range(N):
        error = s[U + STAGES - 1, i]
        s[END, i] = s[SCRATCH, i] + error
        total += (error / tolerance(s, i, rtol, atol)) ** 2
    FIELD(t + dt, row(s, END), mode, params, row(s, KEND))
    return (total / N) ** 0.5


def interpolant(t: float, dt: float, s: FloatTable, mode: Any, params: Any, field: int) -> int:
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


STIFF = 15.0  # steps beyond the limit, more or less in a row
RELIEF = 2.5  # of these are forgotten at each step within it


@kernel
def tolerance(s: FloatTable, i: int, rtol: float, atol: FloatVector) -> float:
    """Return the error allowed in component `i` of this step."""
    return max(atol[i] + rtol * max(abs(s[Y, i]), abs(s[END, i])), SMALLEST)


@kernel
def explicit_stiffness(
    s: FloatTable, dt: float, rtol: float, atol: FloatVector, last_slope: int, n: int
) -> float:
    """Return dt times the fastest rate, after an accepted explicit step.

    Row `last_slope` holds the slope of the last stage, SCRATCH the state where it was taken. The
    result is NaN, which exceeds no limit, if that state is the new one.
    """
    slopes, states = 0.0, 0.0
    for i in range(n):
        allowed = tolerance(s, i, rtol, atol)
        slopes += ((s[KEND, i] - s[last_slope, i]) / allowed) ** 2
        states += ((s[END, i] - s[SCRATCH, i]) / allowed) ** 2
    return dt * (slopes / states) ** 0.5


@kernel
def stiffness_score(score: float, stiffness: float, limit: float) -> float:
    """Count a step; the integration is stiff when the score reaches `STIFF`.

    The score starts at 0 and outlives events, which may come faster than it grows. While it is 0,
    testing one step in 16 is enough.
    """
    return score + 1.0 if stiffness > limit else max(score - RELIEF, 0.0)


@kernel
def multiply(s: FloatTable, first: int, x: int, product: int, n: int) -> None:
    """Write the product of the matrix in the rows from `first` on and row `x` to a row."""
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += s[first + i, j] * s[x, j]
        s[product, i] = total


@kernel
def implicit_stiffness(
    s: FloatTable, dt: float, rtol: float, atol: FloatVector, jac: int, spare: int, n: int
) -> float:
    """Return an estimate of dt times the spectral radius of the Jacobian in the rows from `jac`.

    Four products (of pairs, because a vibration turns states and rates into each other), started
    from the tolerances. Overwrites SCRATCH and row `spare`. An explicit method will do for the next
    step of length dt if this is well below its limit. It costs as much as half a step.
    """
    before, after = 0.0, 0.0
    for i in range(n):
        s[SCRATCH, i] = tolerance(s, i, rtol, atol)
    for _ in range(2):
        before = 0.0
        for i in range(n):
            before += (s[SCRATCH, i] / tolerance(s, i, rtol, atol)) ** 2
        if before == 0.0:
            return 0.0
        for i in range(n):
            s[SCRATCH, i] /= before**0.5
        multiply(s, jac, SCRATCH, spare, n)
        multiply(s, jac, spare, SCRATCH, n)
        after = 0.0
        for i in range(n):
            after += (s[SCRATCH, i] / tolerance(s, i, rtol, atol)) ** 2
    return dt * after**0.25
