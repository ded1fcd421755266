"""Terms of a curved map, on average over noisy inputs, against drawn inputs."""

import numpy as np
import pytest
from made_up_landings import inputs

from hopdata.maps.curvature import (
    affordable_degree,
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
    found = mean_terms(x, t, 3, np.zeros((8, 8)))
    np.testing.assert_allclose(found, np.column_stack(plain), rtol=1e-12, atol=1e-15)
    assert mean_terms(x, t, 0, np.zeros((8, 8))).shape == (50, 0)
    assert mean_terms(x, t, 1, np.zeros((8, 8))).shape == (50, 6)
    assert mean_terms(x, t, 2, np.zeros((8, 8))).shape == (50, 42)


def test_terms_on_average_are_those_of_drawn_inputs():
    x, t = inputs(8)
    slopes = np.linalg.lstsq(x, t, rcond=None)[0]
    root = 0.2 * np.random.default_rng(3).normal(size=(8, 8))
    drawn = x[:, None] + np.random.default_rng(4).normal(size=(5000, 8)) @ root.T
    d = time_differences((drawn @ slopes).reshape(-1, 3)).reshape(8, -1, 3)
    cubic = monomials(drawn.reshape(-1, 8), (3,)).reshape(8, 5000, -1)
    found = mean_terms(x, t, 3, root @ root.T)
    for columns, draws in ((slice(36, 39), d * np.abs(d)), (slice(42, None), cubic)):
        mean, error = draws.mean(axis=1), draws.std(axis=1) / np.sqrt(5000)
        assert np.abs((found[:, columns] - mean) / error).max() < 5.0


def test_all_feet_are_down_at_once_at_the_simultaneous_point():
    u, t = inputs(400)
    x = 0.3 + u
    offset = np.array([0.002, -0.001, -0.001])
    bent = t + offset + 0.001 * u[:, :1] ** 2 * np.array([1.0, 0.0, -1.0])
    point = simultaneous_point(x, bent)
    slopes = np.linalg.lstsq(u, t, rcond=None)[0]
    at = (point - 0.3) @ slopes + offset + 0.001 * (point[0] - 0.3) ** 2 * np.array([1, 0, -1])
    assert np.ptp(at) < 1e-9
    assert np.abs(point - x.mean(axis=0)).max() < 1.0


def test_the_point_stays_at_the_mean_if_that_is_simultaneous():
    u, t = inputs(300)
    x = np.vstack([u, -u])
    np.testing.assert_allclose(simultaneous_point(x, np.vstack([t, -t])), 0.0, atol=1e-12)


def test_more_landings_bear_more_terms():
    assert [affordable_degree(n, 8, 3) for n in (40, 60, 203, 204, 683, 684)] == [0, 1, 1, 2, 2, 3]
