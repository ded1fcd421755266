"""Weighted least squares on one design, again and again with other weights."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray

_SURE = 1e-9  # least over largest eigenvalue down to which the normal equations are solved


class Reweighted:
    """Solve min sum w (values - columns x)^2 for many weights w; x is the shortest of its kind.

    An orthonormal basis of the columns is found once. In it normal equations with weights of one
    order lose no digits, and since they are solved for the change since the last solution, what
    they lose is a share of that change. Where the weights leave a direction out, the weighted
    design is decomposed itself.

    Parameters
    ----------
    columns : (n, k) array
        The design; columns may depend on each other.
    values : (n,) array
        What is regressed.
    """

    def __init__(self, columns: FloatArray, values: FloatArray) -> None:
        left, singular, right = np.linalg.svd(columns, full_matrices=False)
        keep = singular > max(columns.shape) * np.finfo(float).eps * singular.max(initial=0.0)
        self.columns = columns
        self.values = values
        self._basis = left[:, keep]
        self._to_coefficients = (right[keep] / singular[keep, np.newaxis]).T

    def unweighted(self) -> FloatArray:
        """Coefficients (k,) with all weights equal."""
        found: FloatArray = self._to_coefficients @ (self._basis.T @ self.values)
        return found

    def residuals(self, coefficients: FloatArray) -> FloatArray:
        """Values less what `coefficients` make of the columns, (n,)."""
        rest: FloatArray = self.values - self.columns @ coefficients
        return rest

    def refit(
        self, coefficients: FloatArray, residuals: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Coefficients (k,) with `weights` (n,), from others and their residuals."""
        weighted = self._basis * weights[:, np.newaxis]
        values, vectors = np.linalg.eigh(self._basis.T @ weighted)
        if len(values) and values[0] <= _SURE * values[-1]:
            roots = np.sqrt(weights)
            design = self.columns * roots[:, np.newaxis]
            return np.asarray(np.linalg.lstsq(design, self.values * roots, rcond=None)[0], float)
        change = vectors @ ((vectors.T @ (weighted.T @ residuals)) / values)
        found: FloatArray = coefficients + self._to_coefficients @ change
        return found
