"""Quantile regression by iteratively reweighted least squares."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.reweighted import Reweighted

_LEAST_RESIDUAL = 1e-6  # smaller ones weigh as this


def quantile_regression(
    columns: FloatArray,
    values: FloatArray,
    *,
    quantile: float,
    tolerance: float = 1e-6,
    most_fits: int = 1000,
) -> FloatArray:
    """Find the combination of `columns` that a share `quantile` of `values` is below.

    Parameters
    ----------
    columns : (n, k) array
        The design. Of columns that depend on each other the shortest coefficients are taken.
    values : (n,) array
        What is regressed, in units of which 1e-6 is nothing.
    quantile : float
        Share, 0 to 1 without the ends.
    tolerance : float
        Ends the steps: largest change of a coefficient.
    most_fits : int
        Ends them too: fits by least squares, the first included.

    Returns
    -------
    (k,) array
        Coefficients.

    Notes
    -----
    Koenker and Bassett 1978. Steps and end are those of
    `statsmodels.regression.quantile_regression.QuantReg`, which is what the tests compare with.
    """
    fits = Reweighted(columns, values)
    found = fits.unweighted()
    for _ in range(most_fits - 1):
        residuals = fits.residuals(found)
        cost = np.where(residuals < 0, quantile, 1.0 - quantile)
        size = np.maximum(np.abs(residuals), _LEAST_RESIDUAL)
        before = found
        found = fits.refit(before, residuals, 1.0 / (cost * size))
        if np.max(np.abs(found - before)) <= tolerance:
            break
    return found
