"""Small dense systems of linear equations in rows of the table of states, without allocation."""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import FloatTable


@kernel
def swap_rows(s: FloatTable, first: int, second: int, n: int) -> None:
    """Exchange two rows of the table."""
    for j in range(n):
        s[first, j], s[second, j] = s[second, j], s[first, j]


@kernel
def largest_below(s: FloatTable, lu: int, k: int, n: int) -> int:
    """Return where column `k` is largest, from its diagonal down."""
    best = k
    for i in range(k + 1, n):
        if abs(s[lu + i, k]) > abs(s[lu + best, k]):
            best = i
    return best


@kernel
def factorise(s: FloatTable, lu: int, pivots: int, n: int) -> None:
    """Replace the (n, n) matrix in the rows from `lu` on by its factors, with partial pivoting.

    The diagonal is replaced by its reciprocal; row `pivots` takes the row exchanges. A singular
    matrix gives infinities, and so a solution that is not finite.
    """
    for k in range(n):
        best = largest_below(s, lu, k, n)
        s[pivots, k] = best
        if best != k:
            swap_rows(s, lu + k, lu + best, n)
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
