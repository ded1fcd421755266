"""The table of states that a method works on: which row holds what, and rows as arrays.

A method reads Y and K1 (the state at the start of the step and its slope) and fills END and KEND.
Its interpolant is put into P1 and the rows after it; rows from W1 on are its own.
"""

from __future__ import annotations

from typing import Any

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import (
    END,
    K1,
    KEND,
    LARGEST_DEGREE,
    P1,
    SCRATCH,
    SLOPE,
    W1,
    Y,
)

MOST_COEFFICIENTS = LARGEST_DEGREE

__all__ = [
    "END",
    "K1",
    "KEND",
    "MOST_COEFFICIENTS",
    "P1",
    "SCRATCH",
    "SLOPE",
    "W1",
    "Y",
    "matrix",
    "row",
]


@kernel
def row(s: Any, r: int) -> Any:
    """Return row `r` of the table as an array (n,)."""
    return s[r]


@kernel
def matrix(s: Any, first: int, n: int) -> Any:
    """Return the `n` rows of the table from `first` on as an array (n, n)."""
    return s[first : first + n]
