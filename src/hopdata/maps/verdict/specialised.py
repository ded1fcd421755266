"""One map against one map per schedule, by permutation within matched contact spread.

Affine maps of their own for the schedules are added to the shared smooth terms. How much of the
rest they explain is compared with what they explain once the rest is shuffled among landings of
similar contact spread (Freedman and Lane 1983): inputs, schedules and curvature stay in place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.verdict.residuals import Residuals, shuffled


@dataclass(frozen=True)
class SpecialisedTest:
    """Pooled over specialised.

    Attributes
    ----------
    error_ratio
        Mean squared error, per degree of freedom, of the shared map over that of the specialised
        ones; 1 if the schedules share one map.
    null_high
        Ratio that 95 % of the shuffled data sets stay below.
    p_value
        Share of the shuffled data sets with a ratio as large, the data's own included.
    """

    error_ratio: float
    null_high: float
    p_value: float


def compare_specialised(
    residuals: Residuals,
    weights: FloatArray,
    *,
    generator: np.random.Generator,
    permutations: int = 499,
) -> SpecialisedTest:
    """Compare shared and specialised maps.

    Parameters
    ----------
    residuals
        Landings of the window; see `hopdata.maps.verdict.residuals.smooth_residuals`.
    weights
        (n, schedules) membership of each landing.
    generator
        Source of the permutations.
    permutations
        Number of shuffled data sets.
    """
    own = _specialised_basis(residuals, weights)
    values = residuals.values
    free = len(values) - residuals.basis.shape[1]
    orders = shuffled(residuals.strata, permutations, generator)
    found = _error_ratio(own, values, residuals.basis, free)
    null = np.array([_error_ratio(own, values[o], residuals.basis, free) for o in orders])
    p_value = (1 + int(np.sum(null >= found))) / (1 + permutations)
    return SpecialisedTest(found, float(np.quantile(null, 0.95)), p_value)


def _specialised_basis(residuals: Residuals, weights: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, r) of what specialised maps add to the smooth terms."""
    inputs = np.column_stack([np.ones(len(weights)), residuals.inputs])
    terms = (weights[:, :, None] * inputs[:, None, :]).reshape(len(weights), -1)
    terms = terms - residuals.basis @ (residuals.basis.T @ terms)
    left, values, _ = np.linalg.svd(terms, full_matrices=False)
    basis: FloatArray = left[:, values > 1e-8 * max(values[0], 1.0)]
    return basis


def _error_ratio(own: FloatArray, values: FloatArray, smooth: FloatArray, free: int) -> float:
    """Return the ratio for one data set, mean over the outputs."""
    pooled = np.sum(values**2, axis=0) - np.sum((smooth.T @ values) ** 2, axis=0)
    gained = np.sum((own.T @ values) ** 2, axis=0)
    return float(np.mean(pooled / free / ((pooled - gained) / (free - own.shape[1]))))
