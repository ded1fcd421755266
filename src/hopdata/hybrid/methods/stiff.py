# ruff: noqa: ARG001 (all methods have the same signature)
"""Detection of stiff modes, and the Rosenbrock method for them.

Explicit methods use Hairer and Wanner's test (*Solving Ordinary Differential Equations
II*, section IV.2). The last stage of DOPRI5 and of DOP853 lies at the end of the step,
near the new state. The two slopes there give the rate of the fastest motion without a
further evaluation. Where stability limits the step, dt times that rate stays near the
edge of the stability region.

The Rosenbrock method has the Jacobian at hand; a few products with it give its spectral
radius.

States are measured by their tolerances, so the result does not depend on units.
"""

from math import ceil, nan
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.kernel import copy, kernel
from hopdata.hybrid.compiled.memory import (
    FloatTable,
    FloatVector,
    address_of,
    array_at,
    int_vector,
    row,
    square,
)
from hopdata.hybrid.layout import END, K1, KEND, P1, SCRATCH, SLOPE, W1, Y
from hopdata.hybrid.methods.directory import DIRECTORY_SLOTS, directory_of
from hopdata.hybrid.methods.explicit import coefficients
from hopdata.hybrid.numbers import along, duals
from hopdata.hybrid.numbers.along import BYTES
from hopdata.hybrid.numbers.duals import width_for

# Small dense linear systems in rows of the table of states, without allocation.


@kernel
def factorise(s: FloatTable, lu: int, pivots: int, n: int) -> None:
    """Replace the (n, n) matrix in the rows from `lu` on by its LU factors.

    Pivoting is partial. The diagonal is replaced by its reciprocal; row `pivots`
    receives the row exchanges. A singular matrix gives infinities, and therefore a
    solution that is not finite.
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


# Derivatives of the field: by duals, by the user's function or, where a field does not
# compile for duals, by differences.
#
# These are templates with one signature: FIELD, JACOBIAN and N are inserted, and for
# duals what `dual_names` returns. They fill the rows from `first` on with the (n, n)
# derivative at (t, Y).

FIELD: Any = None
JACOBIAN: Any = None
N: int = 0
FIRST: int = 0
WIDTH: int = 0
CALL: Any = None
ROOM = EACH = MOMENT = ROWS = DUAL = SEED = SET_MOMENT = HARVEST = IN_PASSES = CALL

#: Increment for central differences, as a fraction of the size of a state.
#: Unit: 1. Origin: derived: the cube root of the rounding error balances rounding and
#: truncation.
CUBE_ROOT_OF_EPS = 2.0 ** (-52 / 3)
TINY = 1e-290  # smallest increment
SMALLEST = 1e-300  # smallest tolerance

#: Distance of three values ahead in time, as a fraction of the step.
#: Unit: 1. Origin: chosen: it balances rounding and truncation.
TIME_INCREMENT = 2.0**-9

#: Smallest such distance, as a fraction of the time itself.
#: Unit: 1. Origin: chosen.
LEAST_INCREMENT = 2.0**-40


def jacobian_by_duals(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Get the exact derivative by duals, and that in time into row KEND.

    Returns 0, the field evaluations with numbers. All directions are taken at once.
    """
    states = ROOM()
    rates = ROOM()
    row_bytes = BYTES * N
    start = address_of(s)
    EACH(states, start + row_bytes * Y)
    CALL(MOMENT(t), ROWS(states, N), mode, params, ROWS(rates, N))
    HARVEST(rates, start + row_bytes * first, start + row_bytes * KEND)
    return 0


def jacobian_in_passes(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Do the same for more directions than a dual carries.

    Directions before number FIRST are left out; if that is N, only the derivative in
    time is written.
    """
    row_bytes = BYTES * N
    start = address_of(s)
    states = start + row_bytes * (JAC + 2 * N)
    rates = states + row_bytes * (1 + WIDTH)
    moment = rates + row_bytes * (1 + WIDTH)
    into = start + row_bytes * first
    for number in range(FIRST, N + 1, WIDTH):
        SEED(states, N, WIDTH, start + row_bytes * Y, number, 0, 0)
        SET_MOMENT(moment, WIDTH, t, number, N)
        CALL(DUAL(moment), ROWS(states, N), mode, params, ROWS(rates, N))
        HARVEST(rates, N, WIDTH, number, into, start + row_bytes * KEND)
    return 0


def no_time_derivative(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, into: int
) -> int:
    """Do nothing: the derivative in time was found with the others."""
    return 0


def time_derivative_by_duals(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, into: int
) -> int:
    """Fill row `into`, which is KEND, with the exact df/dt, beside a user's Df."""
    return IN_PASSES(t, dt, s, mode, params, s, 0)


def jacobian_by_user(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Get the user's derivative; return 0, the field evaluations.

    Entries that the user does not fill are zero.
    """
    square(s, first)[:] = 0.0
    JACOBIAN(t, row(s, Y), mode, params, square(s, first))
    return 0


def jacobian_by_differences(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Take central differences; return the number of field evaluations, 2 n.

    The increment of a state is the cube root of the rounding error times its size, or
    times its change within the step if that is larger, so it does not depend on units.
    A state smaller than its absolute tolerance counts as zero and is changed by that
    tolerance.
    """
    copy(row(s, Y), row(s, SCRATCH))
    for j in range(N):
        size = max(abs(s[Y, j]), dt * abs(s[K1, j]))
        if size > atol[j]:
            increment = CUBE_ROOT_OF_EPS * size
        else:
            increment = max(atol[j], TINY)
        above = s[Y, j] + increment
        below = s[Y, j] - increment
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


def time_derivative(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, into: int
) -> int:
    """Fill row `into` with df/dt at (t, Y), where K1 is the field.

    Returns the number of field evaluations. The differences are forward, of third
    order, and stay inside the step. If the field does not change at all, it is assumed
    not to depend on time, at the cost of one evaluation.
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


# Coefficients of Rodas5P, whose 8 stages need no products with the Jacobian.

STAGES = 8
_RODAS = coefficients("rodas5p")
GAMMA: float = _RODAS["gamma"]


def lower_triangle(rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Return the strictly lower triangular matrix (STAGES, STAGES).

    Its rows are given from row 2 on.
    """
    matrix = np.zeros((STAGES, STAGES))
    for i, values in enumerate(rows, start=1):
        matrix[i, :i] = values
    return matrix


# Stage i is at the state y + sum_j A[i, j] u_j. The new state is the last one plus u_8,
# and u_8 alone is the difference from the embedded solution. u_i solves (1 / (GAMMA dt)
# - J) u_i = f_i + sum_j C[i, j] / dt u_j + D[i] dt df/dt.
A = lower_triangle(_RODAS["a"])
C = lower_triangle(_RODAS["c"])

# Times of the stages in units of the step, and weights of the field's time derivative.
TIME = np.array(_RODAS["time"])
D = np.array(_RODAS["d"])

# Dense output of order 4: y + theta (rise + (1 - theta) (h_1 + theta h_2 + theta^2
# h_3)), where h_i = sum_j H[i, j] u_j.
H = np.array(_RODAS["h"])


# One step of the Rosenbrock method Rodas5P, for modes too stiff for explicit methods.
#
# It solves eight linear systems with one matrix, without iteration. It is L-stable and
# stiffly accurate: however strongly a contact is damped, only accuracy limits the step.
#
# `step` and `interpolant` are templates: FIELD, N, FILL_JACOBIAN, TIME_DERIVATIVE,
# PREPARE and SOLVE are inserted. They are specialised functions for the derivatives and
# for the linear systems, whose matrix is full or sparse (see `sparse`). The number
# of field evaluations of a step, which varies, is left in INFO, and the Jacobian at its
# start in the rows from JAC on.

# Evaluations for a given Jacobian and a field that does not depend on time.
EVALUATIONS = STAGES + 1
DEGREE = 4
DENSE_ERROR = 1  # interpolant's error in units of the step's estimated error
ORDER = 5
FILL_JACOBIAN: Any = None
TIME_DERIVATIVE: Any = None
PREPARE = SOLVE = FILL_JACOBIAN

# Work rows: stages, row exchanges, number of evaluations, and two matrices.
U = W1
PIVOTS = W1 + STAGES
INFO = W1 + STAGES + 1
JAC = W1 + STAGES + 2


def work_rows(n: int) -> int:
    """Return the number of work rows for `n` states.

    The last of them have room for rows of duals of states and rates, and for the time.
    """
    row_of_duals = 1 + width_for(n + 1)
    return STAGES + 2 + 2 * n + 2 * row_of_duals + ceil(row_of_duals / n)


def dual_names(call: Any, n: int, *, time_only: bool) -> dict[str, Any]:
    """Return what is inserted into the templates for duals.

    Parameters
    ----------
    call : callable
        The field, for duals.
    n : int
        Number of states.
    time_only : bool
        Whether only the derivative in time is wanted.
    """
    width = 1 if time_only else width_for(n + 1)
    return {
        "CALL": call,
        "N": n,
        "FIRST": n if time_only else 0,
        "WIDTH": width,
        "BYTES": BYTES,
        "ROOM": duals.stack(n * (1 + width)),
        "EACH": duals.each_alone(n, width) if n < width else None,
        "MOMENT": duals.number_along(n, width) if n < width else None,
        "ROWS": array_at(duals.Dual(width)),
        "DUAL": duals.dual_at(width),
        "SEED": along.seed,
        "SET_MOMENT": along.set_moment,
    }


def prepare_dense(s: FloatTable, shift: float) -> None:
    """Factorise shift - J."""
    lu = JAC + N
    for i in range(N):
        for j in range(N):
            s[lu + i, j] = -s[JAC + i, j]
        s[lu + i, i] += shift
    factorise(s, lu, PIVOTS, N)


def solve_dense(s: FloatTable, shift: float, x: int) -> bool:
    """Replace the right-hand side in row `x` by the solution; return True."""
    solve_factorised(s, JAC + N, PIVOTS, x, N)
    return True


def step(
    t: float,
    dt: float,
    rtol: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    field: int,
) -> float:
    """Take one step; return the embedded error in tolerances (root mean square).

    It is NaN, which shortens the step, if a linear system was not solved exactly.
    """
    s[INFO, 0] = FILL_JACOBIAN(t, dt, s, mode, params, atol, JAC)
    s[INFO, 0] += TIME_DERIVATIVE(t, dt, s, mode, params, KEND) + STAGES
    shift = 1.0 / (GAMMA * dt)
    PREPARE(s, shift)
    exact = True
    for k in range(STAGES):
        for i in range(N):
            state = s[Y, i]
            bend = 0.0
            for m in range(k):
                state += A[k, m] * s[U + m, i]
                bend += C[k, m] * s[U + m, i]
            s[SCRATCH, i] = state
            s[U + k, i] = bend / dt + D[k] * dt * s[KEND, i]
        if k == 0:
            copy(row(s, K1), row(s, SLOPE))
        else:
            FIELD(t + TIME[k] * dt, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for i in range(N):
            s[U + k, i] += s[SLOPE, i]
        exact = SOLVE(s, shift, U + k) and exact
    total = 0.0
    for i in range(N):
        error = s[U + STAGES - 1, i]
        s[END, i] = s[SCRATCH, i] + error
        total += (error / tolerance(s, i, rtol, atol)) ** 2
    FIELD(t + dt, row(s, END), mode, params, row(s, KEND))
    if not exact:
        return nan
    return (total / N) ** 0.5


def interpolant(
    t: float, dt: float, s: FloatTable, mode: Any, params: Any, field: int
) -> int:
    """Write the coefficients of the dense output of order 4.

    They are in the alternating basis.
    """
    for i in range(N):
        first = 0.0
        second = 0.0
        third = 0.0
        for m in range(STAGES):
            first += H[0, m] * s[U + m, i]
            second += H[1, m] * s[U + m, i]
            third += H[2, m] * s[U + m, i]
        s[P1, i] = s[END, i] - s[Y, i]
        s[P1 + 1, i] = first
        s[P1 + 2, i] = second + third
        s[P1 + 3, i] = -third
    return DEGREE


#: Score at which a mode is stiff: steps beyond the stability limit, net of relief.
#: Unit: 1. Origin: convention: as in Hairer and Wanner's codes.
STIFF = 15.0

#: Decrease of the score at each step within the limit.
#: Unit: 1. Origin: chosen.
RELIEF = 2.5


@kernel
def tolerance(s: FloatTable, i: int, rtol: float, atol: FloatVector) -> float:
    """Return the error allowed in component `i` of this step."""
    return max(atol[i] + rtol * max(abs(s[Y, i]), abs(s[END, i])), SMALLEST)


@kernel
def explicit_stiffness(
    s: FloatTable, dt: float, rtol: float, atol: FloatVector, last_slope: int, n: int
) -> float:
    """Return dt times the fastest rate after an accepted explicit step.

    Row `last_slope` holds the slope of the last stage, SCRATCH the state where it was
    taken. The result is NaN, which exceeds no limit, if that state equals the new one.
    """
    slopes = 0.0
    states = 0.0
    for i in range(n):
        allowed = tolerance(s, i, rtol, atol)
        slopes += ((s[KEND, i] - s[last_slope, i]) / allowed) ** 2
        states += ((s[END, i] - s[SCRATCH, i]) / allowed) ** 2
    return dt * (slopes / states) ** 0.5


@kernel
def stiffness_score(score: float, stiffness: float, limit: float) -> float:
    """Return the updated score.

    The integration is stiff when it reaches `STIFF`. The score starts at 0 and is kept
    across events, which may come faster than it grows. While it is 0, testing one step
    in 16 is enough.
    """
    if stiffness > limit:
        return score + 1.0
    return max(score - RELIEF, 0.0)


@kernel
def multiply(
    s: FloatTable, first: int, x: int, product: int, n: int, structure: int
) -> None:
    """Write the product of the Jacobian in the rows from `first` on and row `x`.

    `structure` is the address of its structure if it is sparse, otherwise 0.
    """
    if structure == 0:
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += s[first + i, j] * s[x, j]
            s[product, i] = total
        return
    d = directory_of(int_vector(structure, DIRECTORY_SLOTS))
    for i in range(n):
        total = 0.0
        for p in range(d.row_starts[i], d.row_starts[i + 1]):
            total += s[first, p] * s[x, d.entry_columns[p]]
        s[product, i] = total


@kernel
def implicit_stiffness(
    s: FloatTable,
    dt: float,
    rtol: float,
    atol: FloatVector,
    jac: int,
    spare: int,
    n: int,
    structure: int = 0,
) -> float:
    """Return an estimate of dt times the spectral radius of a Jacobian.

    The Jacobian is in the rows from `jac` on (see `multiply`). It takes four products,
    started from the tolerances. They are taken in pairs, because a vibration turns
    states and rates into each other. SCRATCH and row `spare` are overwritten. An
    explicit method suffices for the next step of length dt if the result is well below
    its limit. The estimate costs as much as half a step.
    """
    after = 0.0
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
        multiply(s, jac, SCRATCH, spare, n, structure)
        multiply(s, jac, spare, SCRATCH, n, structure)
        after = 0.0
        for i in range(n):
            after += (s[SCRATCH, i] / tolerance(s, i, rtol, atol)) ** 2
    return dt * after**0.25
