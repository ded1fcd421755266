"""The maps and subspaces as estimators: scikit-learn's checks, and a study's numbers."""

import os

import numpy as np
import pytest
from sklearn.model_selection import cross_val_score
from sklearn.utils.estimator_checks import parametrize_with_checks

from hopdata.errors import HopdataError
from hopdata.maps.affine import affine_predictions
from hopdata.maps.estimators import ConstraintSubspace, LandingMap
from hopdata.maps.one_or_own import FOLDS, _foretold, _terms
from hopdata.maps.subspaces import arc_length

ALL = [LandingMap(), LandingMap(curved=False), ConstraintSubspace()]


@parametrize_with_checks(ALL if "ALL" in os.environ else ALL[1:])
def test_scikit_learn_s_own_checks(estimator, check):
    check(estimator)


def landings(n=900, difference=0.0, seed=0):
    rng = np.random.default_rng(seed)
    order = rng.choice(["1>2", "2>1"], n)
    x = rng.normal(size=(n, 8))
    y = x @ rng.normal(size=(8, 11)) + 0.3 * x[:, :1] ** 2
    y += difference * (order == "1>2")[:, None] * (x @ rng.normal(size=(8, 11)))
    return x, y + 0.05 * rng.normal(size=y.shape), order


def test_predictions_are_those_of_the_study():
    x, y, order = landings(difference=0.2)
    one, own, _ = _terms(x, order)
    held_out = np.arange(len(x)) % FOLDS == 0
    for terms, own_maps in ((one, False), (own, True)):
        fitted = LandingMap(own_maps=own_maps)
        fitted.fit(x[~held_out], y[~held_out], order=order[~held_out])
        found = fitted.predict(x[held_out], order=order[held_out])
        np.testing.assert_allclose(found, _foretold(terms, y)[held_out], atol=1e-10)
    affine = LandingMap(curved=False).fit(x, y)
    np.testing.assert_allclose(affine.predict(x), affine_predictions(x, y), atol=1e-10)


def test_own_maps_gain_where_maps_differ_and_nowhere_else():
    gains = {}
    for difference in (0.0, 0.2):
        x, y, order = landings(difference=difference)
        one = cross_val_score(LandingMap(), x, y).mean()
        own = LandingMap(own_maps=True).fit(x[:700], y[:700], order=order[:700])
        gains[difference] = own.score(x[700:], y[700:], order=order[700:]) - one
    assert abs(gains[0.0]) < 0.001 < 0.01 < gains[0.2]
    with pytest.raises(HopdataError, match="order: expected the order of each of 900"):
        LandingMap(own_maps=True).fit(x, y)


def test_an_order_that_was_not_fitted_has_no_map():
    x, y, order = landings()
    own = LandingMap(own_maps=True).fit(x, y, order=order)
    own.predict(x[:2], order=order[:2])
    with pytest.raises(HopdataError, match="orders that were fitted"):
        own.predict(x[:2], order=["9>9", order[1]])


def test_a_subspace_is_found_again_from_other_points():
    rng = np.random.default_rng(2)
    basis = np.linalg.qr(rng.normal(size=(9, 3)))[0]
    points = rng.normal(size=(2, 400, 3)) @ basis.T + 1e-3 * rng.normal(
        size=(2, 400, 9)
    )
    first, second = (ConstraintSubspace(3).fit(one) for one in points)
    assert arc_length(first.components_.T, second.components_.T) < 1e-3
    assert first.score(points[1]) > 0.9999
    again = first.inverse_transform(first.transform(points[1]))
    np.testing.assert_allclose(again, points[1], atol=0.01)
    with pytest.raises(HopdataError, match="n_components: expected 1 to 9"):
        ConstraintSubspace(10).fit(points[0])
