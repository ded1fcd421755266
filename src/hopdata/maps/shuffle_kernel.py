"""Compiled core of the draws: the first steps of many shuffles."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def partial_shuffles(steps, items, drawn):  # type: ignore[no-untyped-def]
    """Fill `drawn` with the items that m steps of each of R shuffles of `items` draw.

    Parameters
    ----------
    steps : (R, m) int64 array
        Which of the items that are left, counted from the place of the step, each step takes.
    items : (n,) int64 array
        What is drawn from; in the same order afterwards.
    drawn : (R, m) int64 array
        Filled.
    """
    for r in range(steps.shape[0]):
        for k in range(steps.shape[1]):
            place = k + steps[r, k]
            items[k], items[place] = items[place], items[k]
            drawn[r, k] = items[k]
        for k in range(steps.shape[1] - 1, -1, -1):  # undone: every row starts from one order
            place = k + steps[r, k]
            items[k], items[place] = items[place], items[k]
