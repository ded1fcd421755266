"""Robust linear regression: M-estimates by iteratively reweighted least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import chosen
from hopdata.landings.reweighted import Reweighted

FloatArray = NDArray[np.float64]

_TUKEY, _HUBER = 4.685, 1.345  # 95 % efficiency on normal residuals
NORMAL_MEDIAN = 0.6744897501960817  # median of |z| for a standard normal z


def robust_regression(
    columns: FloatArray,
    values: FloatArray,
    *,
    norm: str,
    tolerance: float = 1e-10,
    most_fits: int = 100,
) -> FloatArray:
    """Regress `values` on `columns` so that outliers count for little.

    Parameters
    ----------
    columns : (n, k) array
        The design. Of columns that depend on each other the shortest coefficients are taken.
    values : (n,) array
        What is regressed.
    norm : {"tukey", "huber"}
        Tukey's biweight with c = 4.685, or Huber's norm with t = 1.345, each in units of the
        scale, which is the median of the absolute residuals, taken as of a normal, at every step.
    tolerance : float
        Ends the steps: largest change of a residual, in units of the scale.
    most_fits : int
        Ends them too: fits by least squares, the first included.

    Returns
    -------
    (k,) array
        Coefficients.

    Notes
    -----
    Start, weights and scale are those of `statsmodels.robust.robust_linear_model.RLM`, which the
    tests compare with, iterated to convergence. Its own end depends on the unit of the values, and
    it finds covariances that nobody reads here (docs/decisions.md).
    """
    weights = chosen("floor.norm", norm, NORMS)
    fits = Reweighted(columns, values)
    found = fits.unweighted()
    residuals = fits.residuals(found)
    rounding = float(np.finfo(float).eps * np.abs(values).max(initial=0.0))
    for _ in range(most_fits - 1):
        scale = robust_rms(residuals)
        if scale <= rounding:  # a perfect fit
            break
        before = residuals
        found = fits.refit(found, residuals, weights(np.abs(residuals) / scale))
        residuals = fits.residuals(found)
        if np.abs(residuals - before).max() <= tolerance * scale:
            break
    return found


def robust_rms(residuals: FloatArray) -> float:
    """Deviation about zero that half the residuals keep to, taken as of a normal."""
    return float(np.median(np.abs(residuals))) / NORMAL_MEDIAN


def _tukey(size: FloatArray) -> FloatArray:
    """Weights (n,) of residuals of some size, in units of the scale."""
    weights: FloatArray = np.maximum(1.0 - (size / _TUKEY) ** 2, 0.0) ** 2
    return weights


def _huber(size: FloatArray) -> FloatArray:
    """Weights (n,) of residuals of some size, in units of the scale."""
    weights: FloatArray = _HUBER / np.maximum(size, _HUBER)
    return weights


NORMS = {"tukey": _tukey, "huber": _huber}
