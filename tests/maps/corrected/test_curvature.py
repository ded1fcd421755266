"""Terms of a curved map, on average over noisy inputs, against drawn inputs."""

import numpy as np
import pytest
from made_up_landings import CONTACTS, inputs

from hopdata.maps.corrected.curvature import (
    affordable_degree,
    contact_slopes,
    mean_cube,
    mean_signed_square,
    mean_terms,
    simultaneous_point,
)
from hopdata.maps.verdict.kinks import time_differences
from hopdata.maps.verdict.smooth import monomials


@pytest.mark.parametrize("middle", [-3.0, -0.4, 0.0, 0.7, 20.0])
@pytest.mark.parametrize("sd", [0.0, 1e-9, 0.5, 2.0])
def test_means_of_signed_square_and_cube_are_integrals(middle, sd):
    nodes, weights = np.polynomial.legendre.leggauss(60)
    pieces = [middle + sd * e for e in np.linspace(-9, 9, 19)]
    edges = np.unique(np.concatenate([pieces, [0.0]]))
    edges = edges[(edges >= pieces[0]) & (edges <= pieces[-1])]
    square, cube = middle * abs(middle), abs(middle) ** 3
    if sd > 0:
        half = np.diff(edges)[:, None] / 2
        d = edges[:-1, None] + half * (nodes + 1)
        mass = half * weights * np.exp(-0.5 * ((d - middle) / sd) ** 2) / sd / np.sqrt(2 * np.pi)
        square, cube = (mass * d * np.abs(d)).sum(), (mass * np.abs(d) ** 3).sum()
    assert mean_signed_square(np.array(middle), np.array(sd)) == pytest.approx(square, abs=1e-7)
    assert mean_cube(np.array(middle), np.array(sd)) == pytest.approx(cube, abs=1e-6)


def test_without_doubt_the_terms_are_themselves():
    x, t = inputs(50)
    d = time_differences(t)
    plain = [monomials(x, (2,)), d * np.abs(d), np.abs(d) ** 3, monomials(x, (3,))]
    found = mean_terms(x, CONTACTS, 3, np.zeros((8, 8)))
    np.testing.assert_allclose(found, np.column_stack(plain), rtol=1e-9, atol=1e-15)
    assert mean_terms(x, CONTACTS, 0, np.zeros((8, 8))).shape == (50, 0)
    assert mean_terms(x, CONTACTS, 1, np.zeros((8, 8))).shape == (50, 6)
    assert mean_terms(x, CONTACTS, 2, np.zeros((8, 8))).shape == (50, 42)


def test_terms_on_average_are_those_of_drawn_inputs():
    x, _ = inputs(8)
    root = 0.2 * np.random.default_rng(3).normal(size=(8, 8))
    drawn = x[:, None] + np.random.default_rng(4).normal(size=(5000, 8)) @ root.T
    d = time_differences((drawn @ CONTACTS).reshape(-1, 3)).reshape(8, -1, 3)
    cubic = monomials(drawn.reshape(-1, 8), (3,)).reshape(8, 5000, -1)
    found = mean_terms(x, CONTACTS, 3, root @ root.T)
    for columns, draws in ((slice(36, 39), d * np.abs(d)), (slice(42, None), cubic)):
        mean, error = draws.mean(axis=1), draws.std(axis=1) / np.sqrt(5000)
        assert np.abs((found[:, columns] - mean) / error).max() < 5.0


def test_contact_slopes_are_found_beside_outliers():
    x, t = inputs(400)
    x = 0.3 + x
    offset = np.array([0.002, -0.001, -0.001])
    t = t + offset + np.linspace(0, 1, 400)[:, None]
    t[::50, 0] += 0.5
    middle, slopes = contact_slopes(x, t)
    relative = CONTACTS - CONTACTS.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes, relative, atol=1e-4)
    np.testing.assert_allclose(middle, (x.mean(axis=0) - 0.3) @ relative + offset, atol=1e-4)


def test_all_feet_are_down_at_once_at_the_simultaneous_point():
    x, _ = inputs(400)
    middle = np.array([0.002, -0.001, -0.001])
    slopes = CONTACTS - CONTACTS.mean(axis=1, keepdims=True)
    point = simultaneous_point(x, middle, slopes)
    np.testing.assert_allclose(middle + (point - x.mean(axis=0)) @ slopes, 0.0, atol=1e-12)
    # Any other such point is farther from the mean, by the covariance of the inputs.
    away = np.linalg.svd(slopes.T)[2][-1]
    metric = np.linalg.inv(np.cov(x, rowvar=False))
    step = point - x.mean(axis=0)
    for other in (step + 0.1 * away, step - 0.1 * away):
        assert other @ metric @ other > step @ metric @ step


def test_the_point_stays_at_the_mean_if_that_is_simultaneous():
    x, _ = inputs(300)
    np.testing.assert_array_equal(simultaneous_point(x, np.zeros(3), CONTACTS), x.mean(axis=0))


def test_more_landings_bear_more_terms():
    assert [affordable_degree(n, 8, 3) for n in (40, 60, 203, 204, 683, 684)] == [0, 1, 1, 2, 2, 3]
