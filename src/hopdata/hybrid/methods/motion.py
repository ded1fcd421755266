"""The fastest motion of a linear flow: by its matrix, whatever the state does."""

from __future__ import annotations

from hopdata.hybrid.compiled.views import FloatTable

N = 0  # put in for each scene


def fastest_motion(table: FloatTable, first: int) -> float:
    """Return the fastest motion squared, 1/s^2, of the matrix in the N rows from `first` on.

    By its diagonal and by pairs of entries: the largest abs(a_ij a_ji), which no choice of units
    changes.
    """
    fastest = 0.0
    for i in range(N):
        fastest_of_row = 0.0  # the processor works on several rows at a time
        for j in range(i + 1):
            fastest_of_row = max(fastest_of_row, abs(table[first + i, j] * table[first + j, i]))
        fastest = max(fastest, fastest_of_row)
    return fastest
