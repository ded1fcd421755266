"""The derivative of an explicit step with respect to its initial state, stage by stage.

It is the derivative of the numerical map itself, so the flow's Jacobian converges with
the order of the method, as the state does. Stage k is at the state Y + dt sum_j a_kj
K_j, whose derivative is M = Phi + dt sum_j a_kj dK_j, and dK_k = Df M. Where the field
compiles for duals, it is evaluated with the columns of M as slopes, which gives dK_k at
once.

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
from hopdata.hybrid.compiled.memory import (
    FloatTable,
    IntVector,
    address_of,
    fma,
    square,
)
from hopdata.hybrid.methods.explicit import INDENT, Tableau, combination
from hopdata.hybrid.methods.taylor import fastest_motion
from hopdata.hybrid.numbers.along import BYTES, FIELD, field_along

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
            a = one * phi[right, j]
            b = one * phi[right, j + 1]
            c = one * phi[right, j + 2]
            d = one * phi[right, j + 3]
            for k in range(1, n):
                one = phi[left + i, k]
                a = fma(one, phi[right + k, j], a)
                b = fma(one, phi[right + k, j + 1], b)
                c = fma(one, phi[right + k, j + 2], c)
                d = fma(one, phi[right + k, j + 3], d)
            phi[target + i, j] = a
            phi[target + i, j + 1] = b
            phi[target + i, j + 2] = c
            phi[target + i, j + 3] = d
        for j in range(n - n % 4, n):
            total = phi[left + i, 0] * phi[right, j]
            for k in range(1, n):
                total = fma(phi[left + i, k], phi[right + k, j], total)
            phi[target + i, j] = total


@code.kernel
def add_product(
    phi: FloatTable, target: int, base: int, left: int, right: int, factor: float
) -> None:
    """Write base + factor left right into the block `target`.

    It is none of these.
    """
    multiply(phi, target, left, right)
    for i in range(phi.width):
        for j in range(phi.width):
            phi[target + i, j] = fma(factor, phi[target + i, j], phi[base + i, j])


# The derivative of a field, or of a reset, that does not compile for duals: by
# fourth-order differences.
#
# Their values are at four places, in two pairs. The pairs are in the golden ratio, so
# no period fits whole turns into both. The difference between the derivatives from
# either pair shows whether the increment is small enough. If not, as for the sine of a
# thousand turns, a smaller one is tried.

#: Increment, as a fraction of the size of a state.
#: Unit: 1. Origin: derived: the best for differences of fourth order.
FIFTH_ROOT_OF_EPS = 2.0 ** (-52 / 5)

ABSOLUTELY_TINY = 1e-290  # a state smaller than this counts as 1

#: Error of the Jacobian allowed per step.
#: Unit: relative tolerances of the state. Origin: chosen.
LOOSER = 10.0

#: Least relative tolerance of a column whose derivatives are by differences.
#: Unit: 1. Origin: derived: they err by 1e-10 (see BENT), however short the step is.
OF_DIFFERENCES = 1e-10

GOLDEN = 0.5 + sqrt(1.25)
SHIFTS = (GOLDEN, 1.0, -1.0, -GOLDEN)  # places of the values, in increments
INNER = 0.5 * GOLDEN  # weights of the two pairs
OUTER = 0.5 / GOLDEN**2

#: Largest relative difference between the derivatives from the two pairs.
#: Unit: 1. Origin: derived: the derivative then errs by 1e-10, its square.
BENT = 1e-5

#: Fraction of a state below which changes are negligible.
#: Unit: 1. Origin: rounding: 256 units in the last place of a double.
NOISE = 2.0**-44

#: Factor to the next increment that is tried.
#: Unit: 1. Origin: chosen.
SHORTER = 1.0 / 16.0

#: Factor by which the first increment exceeds the one that was small enough before.
#: Unit: 1. Origin: derived: one over SHORTER.
LONGER = 16.0

#: Most increments that are tried.
#: Unit: 1. Origin: chosen.
ATTEMPTS = 7


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
    """Write those of n derivatives that are now good into column `j`.

    Returns whether all are good. Where none is, that of the first attempt is kept. The
    rows of `v` from `first` on hold four rows of values, flags of the good ones, and
    the possible errors of the values.
    """
    good_before = first + 4
    noise = first + 5
    again = attempt > 0
    all_good = True
    for i in range(n):
        outer = v[first, i] - v[first + 3, i]
        inner = v[first + 1, i] - v[first + 2, i]
        change = INNER * inner - OUTER * outer
        apart = abs(inner - outer * (GOLDEN - 1.0))
        limit = BENT * abs(change)
        done = again and v[good_before, i] != 0.0
        if again:
            good = apart < limit
        else:
            good = apart <= limit + v[noise, i]
        if not again or (good and not done):
            slopes[into + i, j] = change / step
        v[good_before, i] = 1.0 if good or done else 0.0
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
    """Evaluate the field at SCRATCH with four shifts of state j.

    NaN remains where it raises.
    """
    shifted = 3 * phi.width
    values = shifted + at.PHI_VALUES
    for side in range(4):
        phi[shifted, j] = s[at.SCRATCH, j] + SHIFTS[side] * step
        phi[values + side, 0] = nan
        into = values + side
        code.call_field_on_arrays(field, t, phi, shifted, mode, params, phi, into)


@code.kernel_apart
def stage_jacobian(  # noqa: PLR0913 (the arguments of a tangent)
    t: float,
    dt: float,
    rtol: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: Any,
    phi: Any,
    field: int,
    jacobian: int,
    along: IntVector,
) -> None:
    """Write the field's derivative at SCRATCH: the user's, or by duals.

    Finite differences replace it for a field that does not compile for duals. They are
    central and of fourth order, usually with 4 n field evaluations. Each increment is a
    fraction of the largest of the state's size, its change in the step, and the size at
    which the absolute tolerance exceeds the relative one, so it does not depend on
    units.
    """
    n = phi.width
    if jacobian != 0:
        square(phi, n)[:] = 0.0
        code.call_jacobian(jacobian, t, s, at.SCRATCH, mode, params, square(phi, n))
        return
    if along[FIELD] != 0:
        y = address_of(s) + BYTES * n * at.SCRATCH
        into = address_of(phi) + BYTES * n * n
        field_along(along, t, y, n, mode, params, 0, into)
        return
    shifted = 3 * n
    values = 3 * n + at.PHI_VALUES
    fraction = 3 * n + at.PHI_PART  # of an increment, that was small enough
    per_s = 1.0 / dt
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
        if not size > ABSOLUTELY_TINY:
            size = 1.0
        largest = FIFTH_ROOT_OF_EPS * size
        part = min(phi[fraction, j] * LONGER, 1.0)
        for attempt in range(ATTEMPTS):
            evaluate_beside(t, j, part * largest, s, mode, params, phi, field)
            if settle(phi, values, attempt, part * largest, phi, n, j, n):
                break
            part *= SHORTER
        else:
            part = 1.0
        phi[fraction, j] = part
        phi[shifted, j] = s[at.SCRATCH, j]


def _entry(terms: str) -> str:
    """Return code for a sum of rows of a table as one for entries of blocks."""
    return terms.replace("s[", "phi[").replace(", i]", ", e]")


def _matrices(target: str, weights: Sequence[float]) -> list[str]:
    """Return code that forms a whole block entry by entry, which vectorises."""
    blocks = [f"4 * N + {at.PHI_ROWS} + {stage} * N" for stage in range(len(weights))]
    terms = _entry(combination(weights, blocks))
    return [
        "for e in range(N * N):",
        INDENT + f"phi[{target}, e] = phi[0, e] + dt * ({terms})",
    ]


def error_constant(tableau: Tableau) -> float:
    """Return the coefficient of z^(p + 1) in the error of a step.

    The step has the length z, and y' = y.
    """
    stages = len(tableau.weights)
    matrix = np.zeros((stages, stages))
    for k, weights in enumerate(tableau.stages, start=1):
        matrix[k, : len(weights)] = weights
    power = np.linalg.matrix_power(matrix, tableau.order) @ np.ones(stages)
    exact = 1.0 / factorial(tableau.order + 1)
    return float(abs(exact - np.dot(tableau.weights, power)))


# The error of the columns. A column is the change of the state by one number of the
# start. Its error is a fraction of its own size, so neither the units of that number
# nor its size matter. The rows of a column are compared by the sizes of the states,
# which are the largest ones so far: a state that passes zero does not dominate then.


@code.kernel
def write_sizes(
    phi: FloatTable, s: FloatTable, dt: float, rtol: float, atol: Any
) -> None:
    """Write the sizes of the states, by which the rows of a column are compared."""
    n = phi.width
    largest = 3 * n + at.PHI_LARGEST
    size = 3 * n + at.PHI_SIZE
    for i in range(n):
        one = max(phi[largest, i], abs(s[at.Y, i]), abs(s[at.END, i]))
        one = max(one, dt * abs(s[at.K1, i]), atol[i] / rtol)
        phi[size, i] = one if one > ABSOLUTELY_TINY else 1.0


@code.kernel
def size_of_column(phi: FloatTable, first: int, j: int) -> float:
    """Return the size of column `j` of a block: of its largest row, in sizes."""
    n = phi.width
    size = 3 * n + at.PHI_SIZE
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(phi[first + i, j]) / phi[size, i])
    return largest


@code.kernel_apart
def judge_columns(phi: FloatTable, error: int, other: int) -> float:
    """Write the error of each column of the new Jacobian; return the largest.

    The estimates are in the block `error` and, if there are two, in `other`: they are
    combined as those of the state (see `explicit.Tableau`).
    """
    n = phi.width
    into = 3 * n + at.PHI_STEP_ERROR
    worst = 0.0
    for j in range(n):
        found = size_of_column(phi, error, j)
        # Of an error below 1e-162, as of a step of 1e-300, the square is no number.
        squared = found * found
        if other >= 0 and squared > 0.0:
            beside = size_of_column(phi, other, j)
            found *= found / sqrt(squared + 0.01 * beside * beside)
        if found > 0.0:
            found /= max(size_of_column(phi, n, j), ABSOLUTELY_TINY)
        phi[into, j] = found
        worst = max(worst, found)
    return worst


def has_end_slope(tableau: Tableau) -> bool:
    """Return whether an estimate of the error uses the slope at the end of the step."""
    stages = len(tableau.weights)
    return any(any(weights[stages:]) for weights in tableau.errors)


def _embedded_error(tableau: Tableau) -> list[str]:
    """Return code for the error of the columns, from the pair's own estimates.

    They are linear in the slopes, so their derivatives are those of the estimates.
    """
    stages = len(tableau.weights)
    blocks = [f"4 * N + {at.PHI_ROWS} + {stage} * N" for stage in range(stages + 1)]
    lines = []
    if has_end_slope(tableau):
        lines += _end_slope(blocks[-1])
    targets = ("2 * N", blocks[0])
    lines.append("for e in range(N * N):")
    stored = []
    for k, weights in enumerate(tableau.errors):
        terms = _entry(combination(weights, blocks))
        lines.append(INDENT + f"e{k} = dt * ({terms})")
        stored.append(INDENT + f"phi[{targets[k]}, e] = e{k}")
    other = targets[1] if len(tableau.errors) > 1 else "-1"
    return [
        *lines,
        *stored,
        "write_sizes(phi, s, dt, rtol, atol)",
        f"found = judge_columns(phi, {targets[0]}, {other})",
    ]


def _end_slope(target: str) -> list[str]:
    """Return code for the derivative of the slope at the end of the step.

    The new Jacobian is in the second block, and kept there.
    """
    by_derivative = [
        "for i in range(N):",
        INDENT + f"s[{at.SCRATCH}, i] = s[{at.END}, i]",
        "for e in range(N * N):",
        INDENT + "phi[2 * N, e] = phi[N, e]",
        "stage_jacobian(",
        INDENT + "t + dt, dt, rtol, s, mode, params, atol, phi, field, jacobian, along",
        ")",
        f"multiply(phi, {target}, N, 2 * N)",
        "for e in range(N * N):",
        INDENT + "phi[N, e] = phi[2 * N, e]",
    ]
    return [
        "if by_duals:",
        INDENT + "field_along(",
        2 * INDENT + f"along, t + dt, address_of(s) + BYTES * N * {at.END}, N, mode,",
        2 * INDENT + f"params, first + BYTES * N * N, first + BYTES * N * ({target})",
        INDENT + ")",
        "else:",
        *(INDENT + line for line in by_derivative),
    ]


def _error(tableau: Tableau) -> list[str]:
    """Return code that estimates the error of a step's Jacobian.

    It is the larger of two: the embedded error of the columns, and that by the fastest
    motion of the linear flow. The state is no guide to the latter: its error says
    nothing where it rests, and once a fast motion has died out, only the field's
    derivative still shows it.
    """
    power = 0.5 * (tableau.order + 1)
    return [
        "fastest = fastest_motion(phi, N)",
        *_matrices("N", tableau.weights),
        f"phi[3 * N + {at.PHI_MOTION}, 0] = fastest",
        f"error = {error_constant(tableau)!r} * (dt * dt * fastest) ** {power!r}",
        *_embedded_error(tableau),
        "by_differences = jacobian == 0 and along[FIELD] == 0",
        f"allowed = max(rtol, {OF_DIFFERENCES!r}) if by_differences else rtol",
        f"return max(error / rtol, found / allowed) / {LOOSER!r}",
    ]


def tangent_code(tableau: Tableau) -> list[str]:
    """Return the body of a method's tangent (see `methods.method.Method`)."""
    slopes = tableau.slope_rows
    nodes = (0.0, *tableau.nodes)
    stages = ((), *tableau.stages)
    lines = [
        "N = phi.width",
        "by_duals = jacobian == 0 and along[FIELD] != 0",
        f"state = address_of(s) + BYTES * N * {at.SCRATCH}",
        "first = address_of(phi)",
        "of_state = first + BYTES * 2 * N * N",
    ]
    for k, (node, weights) in enumerate(zip(nodes, stages, strict=True)):
        moved = f"dt * ({combination(weights, slopes)})"
        target = f"4 * N + {at.PHI_ROWS} + {k} * N"
        lines += [
            "for i in range(N):",
            INDENT + f"s[{at.SCRATCH}, i] = s[{at.Y}, i] + {moved}",
            *_matrices("2 * N", weights),
            f"time = t + {node!r} * dt",
        ]
        through_derivative = [
            "stage_jacobian(",
            INDENT + "time, dt, rtol, s, mode, params, atol, phi, field, jacobian,",
            INDENT + "along,",
            ")",
            f"multiply(phi, {target}, N, 2 * N)",
        ]
        if k == len(stages) - 1:  # the error is judged by the derivative there
            lines += through_derivative
            continue
        lines += [
            "if by_duals:",
            INDENT + f"into = first + BYTES * N * ({target})",
            INDENT + "field_along(",
            2 * INDENT + "along, time, state, N, mode, params, of_state, into",
            INDENT + ")",
            "else:",
            *(INDENT + line for line in through_derivative),
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
# The driver writes the states at the two points into rows SCRATCH and SLOPE, and that
# in the middle into LEAST. Where A changes, it is evaluated there, too: the second
# difference of the three shows whether A is smooth. If it is, differences fall by the
# same ratio from each order to the next, and the error follows from the first two. If
# it is not, as beside the surface of a contact, they do not fall, and the second
# difference is the error itself.

#: Highest order of a method that has a short tangent: steps of higher ones are too long
#: for it.
#: Unit: 1. Origin: chosen.
HIGHEST_ORDER = 5

# Distance of an end from the mean of the Gauss points, over their distance.
TILT = 0.5 * sqrt(3.0)
BLOCKS = 5  # blocks of the short tangent's table after the single rows

#: Error over (step times fastest motion)^5.
#: Unit: 1. Origin: derived: 1 / 120, and a bit for the two points.
ERROR = 0.01


#: Change of A over the step, as a fraction of the error allowed, below which A counts
#: as constant.
#: Unit: 1. Origin: chosen.
HARDLY = 0.1

#: Ratio of the second to the first difference from which on the second is the error.
#: Unit: 1. Origin: derived: the estimate for a square root that begins, or ends, with
#: the step is then twice its error.
ROUGH = 1.0 / 3.0

#: Ratio from which on A is not smooth.
#: Unit: 1. Origin: derived: a square root has 0.155.
UNEVEN = 0.14


@code.kernel
def change_of(phi: FloatTable, first: int, last: int) -> float:
    """Return by how much A in block `last` differs from that in `first`, in sizes."""
    n = phi.width
    size = 3 * n + at.PHI_SIZE
    worst = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(phi[last + i, j] - phi[first + i, j]) * phi[size, j]
        worst = max(worst, row / phi[size, i])
    return worst


@code.kernel_apart
def error_of_change(phi: FloatTable, first: int, last: int, middle: int) -> float:
    """Return how far a step errs because A varies, in sizes, per unit of its length.

    A is in these blocks at the Gauss points and in the middle. The part of the entries
    that are not smooth is written into row PHI_ROUGH.
    """
    n = phi.width
    size = 3 * n + at.PHI_SIZE
    worst = 0.0
    worst_rough = 0.0
    for i in range(n):
        row = 0.0
        rough = 0.0
        for j in range(n):
            scale = phi[size, j] / phi[size, i]
            change = scale * abs(phi[last + i, j] - phi[first + i, j])
            bend = phi[first + i, j] + phi[last + i, j] - 2.0 * phi[middle + i, j]
            bend = scale * abs(bend)
            is_rough = bend >= UNEVEN * change
            if bend < ROUGH * change:
                bend *= (bend / (ROUGH * change)) ** 2
            if is_rough:
                rough += bend
            row += bend
        worst = max(worst, row)
        worst_rough = max(worst_rough, rough)
    phi[3 * n + at.PHI_ROUGH, 0] = worst_rough
    return worst


def short_tangent(  # noqa: PLR0913 (the arguments of a tangent)
    t: float,
    dt: float,
    rtol: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: Any,
    phi: Any,
    field: int,
    jacobian: int,
    along: Any,
) -> float:
    """Write the new Jacobian into the second block; return its error in tolerances."""
    n = phi.width
    # Blocks: A at the start, the middle and the end of the step; the results of the
    # stages of Runge and Kutta, the last of them in the third block.
    begin = 4 * n + at.PHI_ROWS
    middle = begin + n
    end = begin + 2 * n
    second = begin + 3 * n
    third = begin + 4 * n
    fourth = 2 * n
    first_point = t + at.GAUSS_1 * dt
    stage_jacobian(
        first_point, dt, rtol, s, mode, params, atol, phi, field, jacobian, along
    )
    for e in range(n * n):
        phi[begin, e] = phi[n, e]
    for i in range(n):
        s[at.SCRATCH, i] = s[at.SLOPE, i]
    last_point = t + at.GAUSS_2 * dt
    stage_jacobian(
        last_point, dt, rtol, s, mode, params, atol, phi, field, jacobian, along
    )
    write_sizes(phi, s, dt, rtol, atol)
    allowed = LOOSER * rtol
    if jacobian == 0 and along[FIELD] == 0:
        allowed = LOOSER * max(rtol, OF_DIFFERENCES)
    rough = 3 * n + at.PHI_ROUGH
    phi[rough, 0] = 0.0
    varies = dt * change_of(phi, begin, n)
    if varies > HARDLY * allowed:
        for e in range(n * n):
            phi[end, e] = phi[n, e]
        for i in range(n):
            s[at.SCRATCH, i] = s[at.LEAST, i]
        half = t + 0.5 * dt
        stage_jacobian(
            half, dt, rtol, s, mode, params, atol, phi, field, jacobian, along
        )
        varies = dt * error_of_change(phi, begin, end, n)
        phi[rough, 0] *= dt / allowed
        for e in range(n * n):
            phi[n, e] = phi[end, e]
    for e in range(n * n):
        mean = 0.5 * (phi[begin, e] + phi[n, e])
        tilt = TILT * (phi[n, e] - phi[begin, e])
        phi[begin, e] = mean - tilt
        phi[middle, e] = mean
        phi[end, e] = mean + tilt
    add_product(phi, second, 0, begin, 0, 0.5 * dt)
    add_product(phi, third, 0, middle, second, 0.5 * dt)
    add_product(phi, fourth, 0, middle, third, dt)
    for e in range(n * n):
        total = phi[second, e] + 2.0 * phi[third, e] + phi[fourth, e] - phi[0, e]
        phi[second, e] = total / 3.0
    add_product(phi, n, second, end, fourth, dt / 6.0)
    fastest = fastest_motion(phi, middle)
    phi[3 * n + at.PHI_MOTION, 0] = fastest
    turn = dt * dt * fastest
    for j in range(n):
        phi[3 * n + at.PHI_STEP_ERROR, j] = varies
    of_motion = ERROR * turn * turn * sqrt(turn) / (LOOSER * rtol)
    return max(of_motion, varies / allowed)
