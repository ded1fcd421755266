# ruff: noqa: ARG001 (all methods have the same signature)
"""The Rosenbrock method of `stiff` with a sparse Jacobian: memory by its entries.

The Jacobian's entries are in the rows from JAC on, row by row; ``s[JAC, p]`` is entry
p, also beyond the first of these rows. The matrix 1 / (GAMMA dt) - J and its factors
follow. What is where stands in the directory (see `sparsity`).
"""

from math import ceil
from typing import Any

from hopdata.hybrid.compiled.kernel import copy, kernel
from hopdata.hybrid.compiled.memory import (
    FloatTable,
    FloatVector,
    address_of,
    array_at,
    float_vector,
    fma,
    int_vector,
    matrix_at,
    row,
)
from hopdata.hybrid.layout import K1, KEND, SCRATCH, SLOPE, STRUCTURE, Y
from hopdata.hybrid.methods.directory import (
    DIRECTORY_SLOTS,
    Directory,
    directory_of,
)
from hopdata.hybrid.methods.stiff import (
    CUBE_ROOT_OF_EPS,
    JAC,
    PIVOTS,
    TINY,
)
from hopdata.hybrid.numbers import along, duals
from hopdata.hybrid.numbers.along import BYTES
from hopdata.hybrid.numbers.duals import width_for


@kernel
def directory_in(s: FloatTable) -> Directory:
    """Return the directory whose address is among the states."""
    return directory_of(int_vector(int(s[STRUCTURE, 0]), DIRECTORY_SLOTS))


# Linear systems. The unknowns are in row `work`, in the order of elimination.


@kernel
def assemble(s: FloatTable, d: Directory, shift: float, size: int) -> None:
    """Fill the matrix, `size` numbers, with shift - J."""
    matrix = d.matrix
    for q in range(size):
        s[matrix, q] = 0.0
    for p in range(d.n_entries):
        s[matrix, d.places[p]] = -s[JAC, p]
    for i in range(s.width):
        s[matrix, d.diagonal[i]] += shift


@kernel
def factorise_band(s: FloatTable, d: Directory) -> None:
    """Replace a band matrix by its LU factors, with partial pivoting.

    Rows are stored one after the other, ``below`` entries left of the diagonal and
    ``above + below`` right of it, where row exchanges may put some. The diagonal is
    replaced by its reciprocal; row PIVOTS receives the exchanges. A singular matrix
    gives infinities.
    """
    n = s.width
    matrix = d.matrix
    below = d.below
    right = d.above + below
    step = below + right  # from an entry to the one below it
    for k in range(n):
        last_row = min(k + below, n - 1)
        last_column = min(k + right, n - 1)
        at = k * (step + 1) + below  # the diagonal of row k
        best = k
        largest = abs(s[matrix, at])
        for i in range(k + 1, last_row + 1):
            size = abs(s[matrix, at + (i - k) * step])
            if size > largest:
                largest = size
                best = i
        s[PIVOTS, k] = best
        if best != k:
            other = at + (best - k) * step
            for j in range(last_column - k + 1):
                kept = s[matrix, at + j]
                s[matrix, at + j] = s[matrix, other + j]
                s[matrix, other + j] = kept
        pivot = 1.0 / s[matrix, at]
        s[matrix, at] = pivot
        for i in range(k + 1, last_row + 1):
            own = at + (i - k) * step
            factor = s[matrix, own] * pivot
            s[matrix, own] = factor
            if factor != 0.0:
                for j in range(1, last_column - k + 1):
                    s[matrix, own + j] -= factor * s[matrix, at + j]


@kernel
def solve_band(s: FloatTable, d: Directory, work: int) -> None:
    """Replace the right-hand side in row `work` by the solution."""
    n = s.width
    matrix = d.matrix
    below = d.below
    right = d.above + below
    step = below + right
    for k in range(n):
        best = int(s[PIVOTS, k])
        value = s[work, best]
        if best != k:
            s[work, best] = s[work, k]
            s[work, k] = value
        at = k * (step + 1) + below
        for i in range(k + 1, min(k + below, n - 1) + 1):
            s[work, i] -= s[matrix, at + (i - k) * step] * value
    for i in range(n - 1, -1, -1):
        at = i * (step + 1) + below
        total = s[work, i]
        for j in range(1, min(right, n - 1 - i) + 1):
            total -= s[matrix, at + j] * s[work, i + j]
        s[work, i] = total * s[matrix, at]


# A narrow band. BELOW and ABOVE, its diagonals, are inserted into these templates, so
# the loops over them are written out; this takes a third of the time. Without an
# exchange of rows, whose number is kept as that of the last row, the factors have no
# more diagonals than the matrix.

BELOW: int = 0
ABOVE: int = 0


def factorise_narrow(s: FloatTable, d: Directory) -> None:
    """Do what `factorise_band` does for a narrow band."""
    n = s.width
    matrix = d.matrix
    step = 2 * BELOW + ABOVE
    exchanges = 0
    for k in range(n):
        at = k * (step + 1) + BELOW
        last_row = min(k + BELOW, n - 1)
        best = k
        largest = abs(s[matrix, at])
        for i in range(k + 1, last_row + 1):
            size = abs(s[matrix, at + (i - k) * step])
            if size > largest:
                largest = size
                best = i
        s[PIVOTS, k] = best
        if best != k:
            exchanges += 1
            other = at + (best - k) * step
            for j in range(min(BELOW + ABOVE, n - 1 - k) + 1):
                kept = s[matrix, at + j]
                s[matrix, at + j] = s[matrix, other + j]
                s[matrix, other + j] = kept
        pivot = 1.0 / s[matrix, at]
        s[matrix, at] = pivot
        if exchanges == 0 and k + BELOW + ABOVE < n:
            for i in range(1, BELOW + 1):
                own = at + i * step
                factor = s[matrix, own] * pivot
                s[matrix, own] = factor
                for j in range(1, ABOVE + 1):
                    s[matrix, own + j] -= factor * s[matrix, at + j]
        else:
            reach = min(BELOW + ABOVE, n - 1 - k)
            for i in range(1, last_row - k + 1):
                own = at + i * step
                factor = s[matrix, own] * pivot
                s[matrix, own] = factor
                for j in range(1, reach + 1):
                    s[matrix, own + j] -= factor * s[matrix, at + j]
    s[PIVOTS, n - 1] = exchanges


def solve_narrow(s: FloatTable, d: Directory, work: int) -> None:
    """Replace the right-hand side in row `work` by the solution."""
    n = s.width
    if s[PIVOTS, n - 1] != 0.0:
        s[PIVOTS, n - 1] = n - 1
        solve_band(s, d, work)
        s[PIVOTS, n - 1] = 1.0
        return
    matrix = d.matrix
    row_size = 2 * BELOW + ABOVE + 1
    for i in range(min(BELOW, n)):
        total = s[work, i]
        for j in range(i, 0, -1):
            total -= s[matrix, i * row_size + BELOW - j] * s[work, i - j]
        s[work, i] = total
    # The nearest unknown, which is the last to be known, comes last.
    for i in range(BELOW, n):
        at = i * row_size + BELOW
        total = s[work, i]
        for j in range(BELOW, 0, -1):
            total = fma(-s[matrix, at - j], s[work, i - j], total)
        s[work, i] = total
    for i in range(n - 1, max(n - 1 - ABOVE, -1), -1):
        at = i * row_size + BELOW
        total = s[work, i]
        for j in range(n - 1 - i, 0, -1):
            total -= s[matrix, at + j] * s[work, i + j]
        s[work, i] = total * s[matrix, at]
    for i in range(n - 1 - ABOVE, -1, -1):
        at = i * row_size + BELOW
        total = s[work, i]
        for j in range(ABOVE, 0, -1):
            total = fma(-s[matrix, at + j], s[work, i + j], total)
        s[work, i] = total * s[matrix, at]


@kernel
def subtract_row(s: FloatTable, d: Directory, k: int) -> None:
    """Eliminate column `k` from the row that is spread out in row `work`."""
    matrix = d.matrix
    work = d.work
    diagonal = d.factor_diagonal[k]
    factor = s[work, k] * s[matrix, diagonal]
    s[work, k] = factor
    for r in range(diagonal + 1, d.factor_starts[k + 1]):
        s[work, d.factor_columns[r]] -= factor * s[matrix, r]


@kernel
def subtract_four(s: FloatTable, d: Directory, k: int) -> None:
    """Eliminate four columns from `k` on, whose rows have the same columns.

    The columns' numbers and the row are then read and written once instead of four
    times.
    """
    matrix = d.matrix
    work = d.work
    first = d.factor_diagonal[k]
    second = d.factor_diagonal[k + 1]
    third = d.factor_diagonal[k + 2]
    fourth = d.factor_diagonal[k + 3]
    a = s[work, k] * s[matrix, first]
    b = s[work, k + 1] - a * s[matrix, first + 1]
    b *= s[matrix, second]
    c = s[work, k + 2] - a * s[matrix, first + 2] - b * s[matrix, second + 1]
    c *= s[matrix, third]
    e = s[work, k + 3] - a * s[matrix, first + 3] - b * s[matrix, second + 2]
    e = (e - c * s[matrix, third + 1]) * s[matrix, fourth]
    s[work, k] = a
    s[work, k + 1] = b
    s[work, k + 2] = c
    s[work, k + 3] = e
    for r in range(1, d.factor_starts[k + 4] - fourth):
        j = d.factor_columns[fourth + r]
        total = a * s[matrix, first + 3 + r] + b * s[matrix, second + 2 + r]
        total += c * s[matrix, third + 1 + r] + e * s[matrix, fourth + r]
        s[work, j] -= total


@kernel
def factorise_sparse(s: FloatTable, d: Directory) -> None:
    """Replace a sparse matrix by its LU factors, without row exchanges.

    Row by row; the row is spread out in row `work` meanwhile. The diagonal is replaced
    by its reciprocal.
    """
    matrix = d.matrix
    work = d.work
    for i in range(s.width):
        first = d.factor_starts[i]
        end = d.factor_starts[i + 1]
        diagonal = d.factor_diagonal[i]
        for q in range(first, end):
            s[work, d.factor_columns[q]] = s[matrix, q]
        q = first
        while q < diagonal:
            k = d.factor_columns[q]
            # A row that has column k has those of the rows like k, too.
            if d.alike[k] >= 4 and q + 4 <= diagonal:
                subtract_four(s, d, k)
                q += 4
            else:
                subtract_row(s, d, k)
                q += 1
        for q in range(first, end):
            s[matrix, q] = s[work, d.factor_columns[q]]
        s[matrix, diagonal] = 1.0 / s[matrix, diagonal]


@kernel
def solve_sparse(s: FloatTable, d: Directory) -> None:
    """Replace the right-hand side in row `work` by the solution."""
    matrix = d.matrix
    work = d.work
    for i in range(s.width):
        total = s[work, i]
        for q in range(d.factor_starts[i], d.factor_diagonal[i]):
            total -= s[matrix, q] * s[work, d.factor_columns[q]]
        s[work, i] = total
    for i in range(s.width - 1, -1, -1):
        total = s[work, i]
        diagonal = d.factor_diagonal[i]
        for q in range(diagonal + 1, d.factor_starts[i + 1]):
            total -= s[matrix, q] * s[work, d.factor_columns[q]]
        s[work, i] = total * s[matrix, diagonal]


#: Largest residual of a linear system, relative to the sizes of its terms in that row.
#: With partial pivoting it is near rounding; without, it shows whether the pivots were
#: too small. Stages as exact as this leave the method's error far below the tolerance.
#: Unit: 1. Origin: chosen.
EXACT = 1e-12

#: Most corrections of a solution by its residual.
#: Unit: 1. Origin: chosen: a matrix that needs more of them has bad pivots, and a
#: shorter step has better ones.
MOST_CORRECTIONS = 3


@kernel
def residual(s: FloatTable, d: Directory, shift: float, x: int) -> float:
    """Write right - (shift - J) x to row `work`, in the order of elimination.

    Returns its largest entry, relative to the sizes of the terms in its row; NaN or
    infinity if the solution is not finite.
    """
    largest = 0.0
    total_size = 0.0
    for place in range(s.width):
        i = d.order[place]
        value = s[d.right, i] - shift * s[x, i]
        size = abs(s[d.right, i]) + abs(shift * s[x, i])
        for p in range(d.row_starts[i], d.row_starts[i + 1]):
            term = s[JAC, p] * s[x, d.entry_columns[p]]
            value += term
            size += abs(term)
        s[d.work, place] = value
        total_size += size
        if size > 0.0:
            largest = max(largest, abs(value) / size)
    return largest + 0.0 * total_size


@kernel
def into_order(s: FloatTable, d: Directory, x: int) -> None:
    """Copy row `x` to row `work`, in the order of elimination."""
    for place in range(s.width):
        s[d.work, place] = s[x, d.order[place]]


SOLVE_BAND: Any = None  # inserted: for a narrow band, or for any


def solve_pivoted(s: FloatTable, shift: float, x: int) -> bool:
    """Solve with a band, whose pivots are chosen; return True."""
    d = directory_in(s)
    if d.is_natural != 0:
        SOLVE_BAND(s, d, x)
        return True
    into_order(s, d, x)
    SOLVE_BAND(s, d, d.work)
    for place in range(s.width):
        s[x, d.order[place]] = s[d.work, place]
    return True


def solve_corrected(s: FloatTable, shift: float, x: int) -> bool:
    """Solve without chosen pivots; return whether the solution is exact.

    It is corrected by its residual where it is not exact at once.
    """
    d = directory_in(s)
    copy(row(s, x), row(s, d.right))
    into_order(s, d, x)
    solve_sparse(s, d)
    for place in range(s.width):
        s[x, d.order[place]] = s[d.work, place]
    for _ in range(MOST_CORRECTIONS):
        if residual(s, d, shift, x) <= EXACT:
            return True
        solve_sparse(s, d)
        for place in range(s.width):
            s[x, d.order[place]] += s[d.work, place]
    return residual(s, d, shift, x) <= EXACT


# Templates; names in capitals are inserted, as in `stiff`.

FIELD: Any = None
JACOBIAN: Any = None
N: int = 0
FACTORISE: Any = None


def prepare(s: FloatTable, shift: float) -> None:
    """Factorise shift - J."""
    d = directory_in(s)
    size = d.factor_columns.width
    if size == 0:
        size = N * (2 * d.below + d.above + 1)
    assemble(s, d, shift, size)
    FACTORISE(s, d)


def jacobian_by_user(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Get the user's derivative in sparse form; return 0, the field evaluations."""
    d = directory_in(s)
    address = address_of(s) + BYTES * d.matrix * N
    given = matrix_at(address, d.given_rows, d.given_columns)
    given[:] = 0.0
    JACOBIAN(t, row(s, Y), mode, params, given)
    for p in range(d.n_entries):
        place = d.given_places[p]
        s[JAC, p] = s[d.matrix, place]
    return 0


@kernel
def increment_of(s: FloatTable, j: int, dt: float, atol: FloatVector) -> float:
    """Return the increment of state `j` for a difference, as `stiff` chooses it."""
    size = max(abs(s[Y, j]), dt * abs(s[K1, j]))
    if size > atol[j]:
        return CUBE_ROOT_OF_EPS * size
    return max(atol[j], TINY)


def jacobian_by_differences(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Take central differences, all columns of a colour at once.

    Returns the number of field evaluations, two for each colour.
    """
    d = directory_in(s)
    copy(row(s, Y), row(s, SCRATCH))
    for colour in range(d.n_colours):
        columns = d.first_column[colour], d.first_column[colour + 1]
        entries = d.first_entry[colour], d.first_entry[colour + 1]
        for a in range(columns[0], columns[1]):
            j = d.columns[a]
            s[SCRATCH, j] = s[Y, j] + increment_of(s, j, dt, atol)
        FIELD(t, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for a in range(entries[0], entries[1]):
            s[JAC, d.entry[a]] = s[SLOPE, d.row_of[a]]
        for a in range(columns[0], columns[1]):
            j = d.columns[a]
            s[SCRATCH, j] = s[Y, j] - increment_of(s, j, dt, atol)
        FIELD(t, row(s, SCRATCH), mode, params, row(s, SLOPE))
        for a in range(entries[0], entries[1]):
            j = d.column_of[a]
            increment = increment_of(s, j, dt, atol)
            span = (s[Y, j] + increment) - (s[Y, j] - increment)
            p = d.entry[a]
            s[JAC, p] = (s[JAC, p] - s[SLOPE, d.row_of[a]]) / span
        for a in range(columns[0], columns[1]):
            j = d.columns[a]
            s[SCRATCH, j] = s[Y, j]
    return 2 * d.n_colours


# Names of `jacobian_by_duals`; the number of colours, which are the directions of the
# states, is that of the time's own direction.
N_COLOURS: int = 0
WIDTH: int = 0
CALL: Any = None
ROWS = DUAL = SET_MOMENT = CALL


def jacobian_by_duals(
    t: float,
    dt: float,
    s: FloatTable,
    mode: Any,
    params: Any,
    atol: FloatVector,
    first: int,
) -> int:
    """Get exact derivatives, all columns of a colour along one direction.

    The derivative in time is written to row KEND. Returns 0, the field evaluations with
    numbers.
    """
    d = directory_in(s)
    row_bytes = BYTES * N
    states = address_of(s) + row_bytes * d.duals
    rates = states + row_bytes * (1 + WIDTH)
    moment = rates + row_bytes * (1 + WIDTH)
    given = float_vector(states, 0)
    found = float_vector(rates, 0)
    for number in range(0, N_COLOURS + 1, WIDTH):
        for i in range(N):
            place = i * (1 + WIDTH)
            given[place] = s[Y, i]
            for j in range(WIDTH):
                given[place + 1 + j] = 1.0 if d.colour_of[i] == number + j else 0.0
        SET_MOMENT(moment, WIDTH, t, number, N_COLOURS)
        CALL(DUAL(moment), ROWS(states, N), mode, params, ROWS(rates, N))
        for i in range(N):
            slopes = i * (1 + WIDTH) + 1
            for p in range(d.row_starts[i], d.row_starts[i + 1]):
                place = d.colour_of[d.entry_columns[p]] - number
                if 0 <= place < WIDTH:
                    s[JAC, p] = found[slopes + place]
            if N_COLOURS - number < WIDTH:
                s[KEND, i] = found[slopes + N_COLOURS - number]
    return 0


def dual_names(call: Any, n_colours: int) -> dict[str, Any]:
    """Return what is inserted into `jacobian_by_duals`, for a field of duals."""
    width = width_for(n_colours + 1)
    return {
        "CALL": call,
        "N_COLOURS": n_colours,
        "WIDTH": width,
        "BYTES": BYTES,
        "ROWS": array_at(duals.Dual(width)),
        "DUAL": duals.dual_at(width),
        "SET_MOMENT": along.set_moment,
    }


def dual_rows(n_states: int, n_colours: int) -> int:
    """Return the rows of states that duals of states, rates and time take."""
    row_of_duals = 1 + width_for(n_colours + 1)
    return 2 * row_of_duals + ceil(row_of_duals / n_states)
