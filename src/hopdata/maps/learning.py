"""How the error of an affine map falls with the number of landings it is fitted to.

The dissertation expects 100 impacts of any order to do for an accurate model (Sec.
1.4), without a figure. The error on other landings has a part that falls with their
number and one that does not: noise, and the curvature of the map over the spread of the
landings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.maps.affine import affine_test_errors, checked, mean_test_errors
from hopdata.maps.corrected.regression import ols_map
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.prediction import needed_training
from hopdata.maps.truth.maps import ExactMap

#: Landings that are only predicted, in each draw.
#: Unit: landings. Origin: chosen.
HELD_OUT = 200

COLUMNS = ("landings", "median_error", "q05", "q95")


@one_blas_thread()
def prediction_by_landings(
    x: FloatArray,
    y: FloatArray,
    sizes: Sequence[int],
    *,
    seed: int,
    draws: int = 100,
    held_out: int = HELD_OUT,
) -> pd.DataFrame:
    """Measure the error of predictions by the number of landings of any order.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs, in units in which outputs have equal weight.
    sizes
        Numbers of landings to fit.
    seed
        Seed of the draws; each size has its own stream.
    draws
        Number of random sets of landings of each size.
    held_out
        Number of other landings that are predicted in each draw.

    Returns
    -------
    DataFrame
        One row per size that the landings allow: ``landings``; median and quantiles of
        the mean squared error of affine maps (``median_error, q05, q95``); and the
        median error of the mean, ``of_mean``.

    Raises
    ------
    AnalysisError
        If there are not more landings than are held out.
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y)
    if len(x) <= held_out:
        wanted = f"more landings than the {held_out} that are only predicted"
        raise AnalysisError.at("learning", wanted, len(x))
    needed = needed_training(x)
    rows = []
    for size in sizes:
        if size < needed or size + held_out > len(x):
            continue
        generator = named_generator(seed, "learning", str(size))
        fitted, tested = distinct_draws(generator, len(x), (size, held_out), draws)
        errors = affine_test_errors(x, y, fitted, tested).mean(axis=1)
        of_mean = mean_test_errors(y, fitted, tested).mean(axis=1)
        low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
        rows.append((size, median, low, high, np.median(of_mean)))
    return pd.DataFrame(rows, columns=[*COLUMNS, "of_mean"])


@one_blas_thread()
def map_error_by_landings(
    exact: ExactMap,
    x: FloatArray,
    y: FloatArray,
    sizes: Sequence[int],
    *,
    seed: int,
    draws: int = 20,
) -> pd.DataFrame:
    """Measure the error of the least-squares map itself by the number of landings.

    Parameters
    ----------
    exact
        The exact derivative of a simulated study.
    x, y
        (n, 8) inputs and (n, 11) outcomes; see `hopdata.maps.coordinates`.
    sizes
        Numbers of landings to fit.
    seed
        Seed of the draws; each size has its own stream.
    draws
        Number of random sets of landings of each size.

    Returns
    -------
    DataFrame
        One row per size that the landings allow: ``landings``, and median and quantiles
        of the relative error of the map, ``median_error, q05, q95``: see
        `ExactMap.error`.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y)
    needed = needed_training(x)
    rows = []
    for size in sizes:
        if size < needed or size > len(x):
            continue
        generator = named_generator(seed, "map learning", str(size))
        (fitted,) = distinct_draws(generator, len(x), (size,), draws)
        errors = [exact.error(ols_map(x[one], y[one]).coefficients) for one in fitted]
        low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
        rows.append((size, median, low, high))
    return pd.DataFrame(rows, columns=list(COLUMNS))
