"""Whether the landings of one contact order are predicted from those of all others.

A C1 map has one derivative for all orders, so that one may do without the data of some
of them, as Sec. 2.1.3 of the dissertation supposes without trying it. Each order in
turn is left out of the fit of an affine map and is predicted by it. The error stands
beside that of a map fitted to as many landings among which the order is, and that of
the mean.

At the spread of contacts of a real study this does not tell a C1 map from another one:
both err mostly by their curvature. It does where the landings draw together about the
simultaneous contact. There the error of a C1 map falls faster than the variation of the
landings, while that of a map with several derivatives falls with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.maps.affine import affine_test_errors, checked, mean_test_errors
from hopdata.maps.draws import grouped, named_generator, schedule_stream
from hopdata.maps.prediction import needed_training

COLUMNS = ("schedule", "landings", "unseen", "seen", "of_mean")


@one_blas_thread()
def leave_one_order_out(
    x: FloatArray, y: FloatArray, schedule: ArrayLike, *, seed: int, folds: int = 5
) -> pd.DataFrame:
    """Predict each contact order from the landings of the others.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs, in units in which outputs have equal weight.
    schedule
        (n,) mode schedules; landings without one (empty) are used only for fits.
    seed
        Seed of the draws of landings; each order has its own stream.
    folds
        Parts into which an order is divided, to predict each part by a map that is
        fitted to the others.

    Returns
    -------
    DataFrame
        One row per order with `folds` landings or more: ``schedule, landings``; and the
        mean squared errors, over all outputs, of an affine map that has not seen the
        order (``unseen``), of one fitted to as many landings that has (``seen``), and
        of the mean of the other orders (``of_mean``). Orders for which too few other
        landings remain for an affine map are left out.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y, schedule)
    needed = needed_training(x)
    orders, _ = grouped(np.asarray(schedule, str), folds)
    rows = []
    for order, own in orders.items():
        others = np.setdiff1d(np.arange(len(x)), own)
        if len(others) < needed:
            continue
        generator = named_generator(seed, "unseen", schedule_stream(own))
        unseen = affine_test_errors(x, y, others[None], own[None])
        seen = _seen(generator, x, y, own, others, folds)
        of_mean = mean_test_errors(y, others[None], own[None])
        rows.append((order, len(own), unseen.mean(), seen, of_mean.mean()))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _seen(
    generator: np.random.Generator,
    x: FloatArray,
    y: FloatArray,
    own: IntArray,
    others: IntArray,
    folds: int,
) -> float:
    """Return the error of maps that have seen an order, but not the landing itself."""
    squared = 0.0
    # Each part is predicted by a map that is fitted to others of the order, too.
    for part in np.array_split(generator.permutation(own), folds):
        rest = np.setdiff1d(np.concatenate([own, others]), part)
        fitted = generator.choice(rest, len(others), replace=False)
        errors = affine_test_errors(x, y, fitted[None], part[None])
        squared += float(errors.mean()) * len(part)
    return squared / len(own)
