"""The fit of the kinks, each piece against what is known of it."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.maps.verdict.inputs import (
    POSITIONS,
    contact_orders,
    expected_contacts,
    marker_root,
    section_landings,
)
from hopdata.maps.verdict.model import (
    _powers,
    _Terms,
    _terms,
    _variance_ratios,
    fit_kinks,
    symmetric_root,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize("true", [(1.0, 0.0), (0.0, 1.0), (1.0, 0.1), (0.5, 0.5), (0.0, 0.0)])
def test_ratios_of_variances_are_found(true, rng):
    groups = rng.standard_normal((2, 2000, 60)) / 3
    signal = sum(
        group @ (np.sqrt(ratio) * rng.standard_normal((60, 40)))
        for group, ratio in zip(groups, true, strict=True)
    )
    others, bends, none = (
        np.hstack(list(groups)),
        rng.standard_normal((2000, 2)),
        np.empty((2000, 0)),
    )
    terms = _Terms(
        none, np.empty((0, 0)), bends, np.eye(2), bends, others, others.T @ others,
        np.repeat([0, 1], 60),
    )  # fmt: skip
    ratios, noise = _variance_ratios(terms, signal + rng.standard_normal((2000, 40)))
    assert np.allclose(np.median(ratios, axis=0), true, rtol=0.2, atol=0.01)
    assert np.allclose(noise, 1.0, rtol=0.15)


def test_kinks_are_those_of_the_penalised_fit(rng):
    """Kinks and shrunk terms at once, each shrunk one with a row of its own."""
    x, t = rng.standard_normal((700, 8)), rng.standard_normal((700, 3))
    terms = _terms(x, t, 2)
    output = terms.rest(rng.standard_normal((700, 1)))[:, 0]
    ratios = np.array([0.02, 0.0, 0.3, 0.01, 0.1, 0.0, 0.05])
    influence, _ = terms.influence(ratios)
    spreads = np.sqrt(ratios)[terms.groups]
    design = np.hstack([terms.bends, terms.others * spreads])
    price = np.hstack([np.zeros((len(spreads), terms.bends.shape[1])), np.eye(len(spreads))])
    target = np.concatenate([output, np.zeros(len(spreads))])
    direct = np.linalg.lstsq(np.vstack([design, price]), target, rcond=None)[0]
    kinks = terms.bends.shape[1]
    np.testing.assert_allclose(influence @ output, direct[:kinks], atol=1e-9)
    left = output - terms.bends @ direct[:kinks]
    np.testing.assert_allclose(
        terms.without_shrunk(left, ratios),
        left - terms.others @ (spreads * direct[kinks:]),
        atol=1e-9,
    )


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_products_turn_with_their_axes(degree, rng):
    """Their length is a power of that of the vector, whatever the axes."""
    x = rng.standard_normal((20, 3))
    number = len(list(combinations_with_replacement(range(3), degree)))
    assert _powers(x, degree).shape == (20, number)
    np.testing.assert_allclose(
        np.sum(_powers(x, degree) ** 2, axis=1), np.sum(x**2, axis=1) ** degree
    )


def test_wrong_instants_do_not_move_the_expected_ones():
    data = landings(n=600)
    good = expected_contacts(data.x, data.instants)
    spoilt = data.instants.copy()
    spoilt[::25] += 0.2 * np.array([1.0, -1.0, 0.5])
    assert np.abs(expected_contacts(data.x, spoilt) - good).max() < 2e-4


def test_orders_of_enough_landings_are_those_seen():
    instants = np.array([[0.0, 0.001, 0.02], [0.02, 0.01, 0.0], [0.0, 0.02, 0.01]])
    orders, counts = contact_orders(np.repeat(instants, (30, 20, 19), axis=0), 20)
    assert orders.tolist() == [[0, 1, 2], [2, 1, 0]]
    assert counts.tolist() == [30, 20]


def test_outputs_are_rms_motions_of_the_markers(rng):
    """What a small turn of the body does to its markers, however they are placed."""
    shape = rng.standard_normal((4, 3))
    shape -= shape.mean(axis=0)
    turn = rng.standard_normal(3)
    way = np.sqrt(np.mean(np.sum(np.cross(turn, shape) ** 2, axis=1)))
    assert np.linalg.norm(turn @ marker_root(shape)) == pytest.approx(way)


def test_section_landings_are_in_units_of_their_own():
    data = landings(n=300)
    section = section_landings(data.before, data.after, data.instants)
    assert section.inputs.shape == (300, 8)
    assert section.outputs.shape == (300, 11)
    assert 0 < POSITIONS < 11
    assert np.sqrt(np.mean(np.var(section.expected, axis=1))) == pytest.approx(1.0, rel=0.05)


def test_parallel_pairs_of_six_feet_on_a_rigid_body_share_their_kinks(rng):
    angle = np.pi / 3 * np.arange(6)
    x = rng.normal(size=(900, 8))
    tilts = np.column_stack([np.cos(angle), np.sin(angle)])
    instants = x[:, :2] @ tilts.T + 0.01 * x[:, 2:4] ** 2 @ rng.normal(size=(2, 6))
    assert _terms(x, instants, 2).seen.shape == (15, 6)
    independent = x[:, :4] @ rng.normal(size=(4, 4))
    assert _terms(x, independent, 2).seen.shape == (6, 6), "no pair is like another"


def test_the_fit_takes_the_landings_of_least_spread():
    data = landings(n=600)
    section = section_landings(data.before, data.after, data.instants)
    fit = fit_kinks(section)
    spread = section.expected.std(axis=1)
    left_out = np.setdiff1d(np.arange(600), fit.rows)
    assert len(fit.rows) == 426
    assert spread[fit.rows].max() <= spread[left_out].min()


def test_the_root_of_a_covariance_does_not_hang_on_the_turn_of_its_eigenvectors(rng):
    """Its spectrum has a double value: eigenvectors there are whatever rounding makes of them."""
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    covariance = turn @ np.diag([2.0, 2.0, 1.0, 0.0]) @ turn.T
    nudged = covariance + 1e-15 * np.diag([1.0, -1.0, 1.0, -1.0])
    one, other = symmetric_root(covariance), symmetric_root(nudged)
    np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_allclose(one @ one, covariance, atol=1e-9)
