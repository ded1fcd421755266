"""The maps and subspaces of a study as estimators of scikit-learn.

They fit what the stages fit, by the same functions, with scikit-learn's `fit`,
`predict`, `transform` and `score`, so that its cross-validation, pipelines and grids
apply to the landings of a study.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import (
    BaseEstimator,
    ClassNamePrefixFeaturesOutMixin,
    MultiOutputMixin,
    RegressorMixin,
    TransformerMixin,
)
from sklearn.utils.validation import check_is_fitted, validate_data

from hopdata.arrays import FloatArray
from hopdata.errors import ArgumentError, require_choice
from hopdata.maps.one_or_own import map_terms, orders_with_own_maps, standardised
from hopdata.maps.subspaces import COMPONENTS, principal_subspaces

__all__ = ["ConstraintSubspace", "LandingMap"]


class LandingMap(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """A map through the landing: one for all contact orders, or one for each.

    Parameters
    ----------
    curved : bool
        Whether all second-order terms of the inputs are fitted, which one smooth map
        has as well; otherwise the map is affine.
    own_maps : bool
        Whether each contact order with landings enough has an affine map of its own
        beside the shared terms. The first of these, and orders with fewer landings,
        keep the shared map. `fit`, `predict` and `score` then need the orders.

    Attributes
    ----------
    coef_ : (terms, q) array
        Coefficients of the terms of standardised inputs.
    orders_ : tuple of str
        The orders that have a map of their own; empty with one map.
    n_features_in_ : int
        Number of inputs.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> x = rng.normal(size=(200, 3))
    >>> y = x @ rng.normal(size=(3, 2)) + 1
    >>> round(LandingMap(curved=False).fit(x, y).score(x, y), 6)
    1.0
    """

    def __init__(self, *, curved: bool = True, own_maps: bool = False) -> None:
        self.curved = curved
        self.own_maps = own_maps

    def fit(self, X: ArrayLike, y: ArrayLike, order: ArrayLike | None = None) -> Self:
        """Fit the map by ordinary least squares.

        Parameters
        ----------
        X : (n, p) array
            Inputs, such as those of `hopdata.maps.coordinates.section_coordinates`.
        y : (n,) or (n, q) array
            Outcomes.
        order : (n,) array of str, optional
            Contact order of each landing; needed with `own_maps`.
        """
        inputs, outcomes = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=float
        )
        self.mean_ = inputs.mean(axis=0)
        self.scale_ = inputs.std(axis=0).clip(1e-300)
        self.orders_: tuple[str, ...] = ()
        names = self._orders(order, len(inputs))
        if names is not None:
            self._fitted_orders = frozenset(names.tolist())
            self.orders_ = orders_with_own_maps(names, inputs.shape[1] + 1)
        terms = self._terms(inputs, names)
        self.coef_ = np.linalg.lstsq(terms, outcomes, rcond=None)[0]
        return self

    def predict(self, X: ArrayLike, order: ArrayLike | None = None) -> FloatArray:
        """Return the outcomes, (n,) or (n, q), of inputs (n, p).

        Parameters
        ----------
        X : (n, p) array
            Inputs.
        order : (n,) array of str, optional
            Contact order of each landing; needed with `own_maps`.

        Raises
        ------
        ArgumentError
            With `own_maps`, for an order that was not among those that were fitted.
        """
        check_is_fitted(self)
        inputs = validate_data(self, X, reset=False, dtype=float)
        names = self._orders(order, len(inputs))
        if names is not None:
            self._require_fitted(names)
        terms = self._terms(inputs, names)
        return np.asarray(terms @ self.coef_)

    def score(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        order: ArrayLike | None = None,
    ) -> float:
        """Return the coefficient of determination, R², as a mean over the outcomes."""
        from sklearn.metrics import r2_score

        found = self.predict(X, order)
        return float(r2_score(y, found, sample_weight=sample_weight))

    def _orders(self, order: ArrayLike | None, n: int) -> np.ndarray | None:
        """Return the orders that own maps need; None with one map."""
        if not self.own_maps:
            return None
        names = np.asarray(order if order is not None else [], str)
        if names.shape != (n,):
            raise ArgumentError.at("order", f"the order of each of {n} landings", names)
        return names

    def _require_fitted(self, names: np.ndarray) -> None:
        """Raise an error if nothing is known of an order."""
        unknown = sorted({*names.tolist()} - self._fitted_orders)
        if unknown:
            wanted = (
                f"orders that were fitted ({', '.join(sorted(self._fitted_orders))})"
            )
            raise ArgumentError.at("order", wanted, ", ".join(unknown))

    def _terms(self, inputs: FloatArray, orders: np.ndarray | None) -> FloatArray:
        states = standardised(inputs, self.mean_, self.scale_)
        return map_terms(states, orders, self.orders_, curved=self.curved)


class ConstraintSubspace(
    ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator
):
    """The subspace in which the landings of a contact order lie, by PCA.

    Parameters
    ----------
    n_components : int
        Dimension of the subspace.
    which : str
        ``"leading"``, ``"smallest"`` or ``"smallest_spanned"`` components: see
        `hopdata.maps.subspaces.COMPONENTS`.

    Attributes
    ----------
    components_ : (k, p) array
        Orthonormal basis of the subspace, one direction a row.
    mean_ : (p,) array
        Mean of the points.
    n_features_in_ : int
        Number of coordinates.
    """

    def __init__(self, n_components: int = 1, *, which: str = "leading") -> None:
        self.n_components = n_components
        self.which = which

    def fit(self, X: ArrayLike, y: Any = None) -> Self:  # noqa: ARG002
        """Find the subspace of (n, p) points; `y` is not looked at."""
        points = validate_data(self, X, dtype=float, ensure_min_samples=2)
        require_choice("which", self.which, COMPONENTS)
        most = points.shape[1]
        if not 1 <= self.n_components <= most:
            wanted = f"1 to {most}, the number of coordinates"
            raise ArgumentError.at("n_components", wanted, self.n_components)
        every = np.arange(len(points))[None]
        bases, _ = principal_subspaces(points, every, self.n_components, self.which)
        self.components_ = bases[0].T
        self.mean_ = points.mean(axis=0)
        return self

    def transform(self, X: ArrayLike) -> FloatArray:
        """Return the coordinates (n, k) of points (n, p) within the subspace."""
        check_is_fitted(self)
        points = validate_data(self, X, reset=False, dtype=float)
        return np.asarray((points - self.mean_) @ self.components_.T)

    def inverse_transform(self, X: ArrayLike) -> FloatArray:
        """Return the points (n, p) of coordinates (n, k) within the subspace."""
        check_is_fitted(self)
        return np.asarray(np.asarray(X, float) @ self.components_ + self.mean_)

    def score(self, X: ArrayLike, y: Any = None) -> float:  # noqa: ARG002
        """Return the share of the variance of points (n, p) within the subspace."""
        within = self.transform(X)
        points = np.asarray(X, float) - self.mean_
        return float((within**2).sum() / (points**2).sum())

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)
