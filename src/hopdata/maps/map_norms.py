"""Differences between the affine maps of contact orders, in two norms.

Sec. 2.1.3 of the dissertation names the operator norm as the distance between
linearizations, and takes the prediction error for it. The operator norm is the largest
change of an outcome over all inputs of unit size, the Frobenius norm the root of the
summed squares, over all of them. Inputs are whitened here, so that unit size is what
landings show; both norms are relative to those of the map of all landings.

Differences between two orders stand beside differences between two halves of one order:
with noise and curvature alone these differ, too.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.maps.affine import checked, pooled_basis
from hopdata.maps.draws import (
    distinct_draws,
    grouped,
    named_generator,
    schedule_stream,
)
from hopdata.maps.prediction import SPARE_LANDINGS

COLUMNS = ("kind", "schedule_a", "schedule_b", "operator", "frobenius")


@one_blas_thread()
def map_differences(
    x: FloatArray,
    y: FloatArray,
    schedule: ArrayLike,
    *,
    seed: int,
    draws: int = 50,
) -> pd.DataFrame:
    """Compare maps of halves of the orders, within and across orders.

    All maps are fitted to equally many landings: half of the smallest order that allows
    a map. Two halves of one order have no landing in common.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs, in units in which outputs have equal weight.
    schedule
        (n,) mode schedules; landings without one (empty) are left out.
    seed
        Seed of the draws; each order has its own stream.
    draws
        Number of random halvings of each order.

    Returns
    -------
    DataFrame
        One row per order, or pair of orders, and draw: ``kind`` (``in_class`` or
        ``cross_class``), ``schedule_a, schedule_b``, and the norms of the difference
        over those of the map of all landings, ``operator`` and ``frobenius``.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y, schedule)
    inputs = pooled_basis(x)
    needed = inputs.shape[1] + SPARE_LANDINGS
    orders, _ = grouped(np.asarray(schedule, str), 2 * needed)
    if not orders:
        return pd.DataFrame(columns=list(COLUMNS))
    half = min(len(rows) for rows in orders.values()) // 2
    halves = {}
    for name, rows in orders.items():
        generator = named_generator(seed, "map norms", schedule_stream(rows))
        both = distinct_draws(generator, len(rows), (half, half), draws)
        halves[name] = [_slopes(inputs, y, rows[drawn]) for drawn in both]
    whole = _slopes(inputs, y, np.arange(len(x))[None])

    tables = []
    for name, (one, other) in halves.items():
        tables.append(_table("in_class", name, name, one - other, whole))
    for a, b in combinations(halves, 2):
        difference = halves[a][0] - halves[b][1]
        tables.append(_table("cross_class", a, b, difference, whole))
    return pd.concat(tables, ignore_index=True)


def _slopes(inputs: FloatArray, y: FloatArray, rows: IntArray) -> FloatArray:
    """Return the slopes (R, p, q) of affine fits to R sets of rows (R, m)."""
    inverse = np.linalg.pinv(inputs[rows])
    return np.asarray((inverse @ y[rows])[:, 1:])


def _table(
    kind: str, a: str, b: str, difference: FloatArray, whole: FloatArray
) -> pd.DataFrame:
    """Return the norms of differences (R, p, q) over those of the whole map."""
    singular = np.linalg.svd(difference, compute_uv=False)
    of_whole = np.linalg.svd(whole, compute_uv=False)
    # Of the singular values, the operator norm is the first, the Frobenius norm the
    # norm of all.
    columns = {
        "kind": kind,
        "schedule_a": a,
        "schedule_b": b,
        "operator": singular[:, 0] / of_whole[:, 0],
        "frobenius": np.linalg.norm(singular, axis=1) / np.linalg.norm(of_whole),
    }
    return pd.DataFrame(columns)
