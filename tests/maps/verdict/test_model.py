"""The fit of the kinks, with each part checked against known values."""

import numpy as np
import pytest
from kinked_landings import in_section, landings, seen_at_section

from hopdata.maps.coordinates import kinks, monomials
from hopdata.maps.verdict.coordinates import marker_root
from hopdata.maps.verdict.expected import expected_contacts
from hopdata.maps.verdict.inputs import POSITIONS, contact_orders
from hopdata.maps.verdict.linear import symmetric_root
from hopdata.maps.verdict.model import fit_kinks


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize(("size", "degrees"), [(0.0, (1, 2)), (30.0, (1, 2, 3))])
def test_kinks_are_those_of_least_squares(rng, size, degrees):
    """Third-order terms are left out if there are none, and free if they are large."""
    x, y = rng.standard_normal((700, 8)), rng.standard_normal((700, 11))
    cubes = monomials(x, (3,))
    y += size * cubes @ rng.standard_normal((cubes.shape[1], 11))
    landings = in_section(x @ rng.standard_normal((8, 3)), y, x)
    fit = fit_kinks(landings)

    terms = np.column_stack([np.ones(len(fit.rows)), monomials(x[fit.rows], degrees)])
    design = np.column_stack([kinks(landings.expected[fit.rows]), terms])
    direct = np.linalg.lstsq(design, y[fit.rows], rcond=None)[0][:4]
    np.testing.assert_allclose(fit.seen @ fit.coefficients, direct, atol=0.02)


@pytest.mark.parametrize(("feet", "taken"), [(2, False), (3, True)])
def test_fourth_powers_of_the_time_between_two_feet_are_no_kinks(rng, feet, taken):
    x, y = rng.standard_normal((700, 8)), 0.1 * rng.standard_normal((700, 11))
    t = x @ rng.standard_normal((8, feet))
    fourth = (t[:, :1] - t[:, 1:2]) ** 4
    found = [
        fit_kinks(in_section(t, one, x))
        for one in (y, y + fourth * rng.standard_normal(11))
    ]
    moved = np.abs(found[1].coefficients - found[0].coefficients).max()
    assert (moved > 0.1) == (moved > 1e-6) == taken


def test_scores_are_the_errors_of_the_kinks(rng):
    """Their squares add up to the scatter of the kinks from study to study."""
    found, said = [], []
    for _ in range(60):
        x = rng.standard_normal((600, 8))
        y = np.repeat(
            rng.standard_normal((600, 1)), 11, axis=1
        ) + 0.1 * rng.standard_normal(11)
        y += 1e-3 * rng.standard_normal(y.shape)
        fit = fit_kinks(
            in_section(x[:, :2] @ np.array([[1.0, -1.0], [0.2, 0.5]]), y, x)
        )
        found.append(fit.coefficients[0, 0])
        said.append(np.sum(fit.null_scores[:, 0] ** 2))
    assert 0.75 < np.std(found) / np.sqrt(np.mean(said)) < 1.25


def test_wrong_instants_do_not_move_the_expected_ones():
    data = landings(n=600)
    good = expected_contacts(data.x, data.instants).instants
    spoilt = data.instants.copy()
    spoilt[::25] += 0.2 * np.array([1.0, -1.0, 0.5])
    assert np.abs(expected_contacts(data.x, spoilt).instants - good).max() < 2e-4


def test_orders_of_enough_landings_are_those_seen():
    instants = np.array([[0.0, 0.001, 0.02], [0.02, 0.01, 0.0], [0.0, 0.02, 0.01]])
    orders, counts = contact_orders(np.repeat(instants, (30, 20, 19), axis=0), 20)
    assert orders.tolist() == [[0, 1, 2], [2, 1, 0]]
    assert counts.tolist() == [30, 20]


def test_outputs_are_rms_motions_of_the_markers(rng):
    """A small rotation of the body gives them, however its markers are placed."""
    shape = rng.standard_normal((4, 3))
    shape -= shape.mean(axis=0)
    turn = rng.standard_normal(3)
    way = np.sqrt(np.mean(np.sum(np.cross(turn, shape) ** 2, axis=1)))
    assert np.linalg.norm(turn @ marker_root(shape)) == pytest.approx(way)


def test_section_landings_are_in_units_of_their_own():
    data = landings(n=300)
    section = seen_at_section(data)
    assert section.inputs.shape == (300, 8)
    assert section.outputs.shape == (300, 11)
    assert 0 < POSITIONS < 11
    assert np.sqrt(np.mean(np.var(section.expected, axis=1))) == pytest.approx(
        1.0, rel=0.05
    )


def test_parallel_pairs_of_six_feet_on_a_rigid_body_share_their_kinks(rng):
    angle = np.pi / 3 * np.arange(6)
    x, y = rng.normal(size=(900, 8)), rng.normal(size=(900, 11))

    def seen(instants):
        return fit_kinks(in_section(instants, y, x)).seen.shape

    tilts = np.column_stack([np.cos(angle), np.sin(angle)])
    instants = x[:, :2] @ tilts.T + 0.01 * x[:, 2:4] ** 2 @ rng.normal(size=(2, 6))
    assert seen(instants) == (15, 6)
    independent = x[:, :4] @ rng.normal(size=(4, 4))
    assert seen(independent) == (6, 6), "no pair is like another"


def test_the_window_holds_the_landings_of_least_spread():
    data = landings(n=600)
    section = seen_at_section(data)
    fit = fit_kinks(section)
    spread = section.expected.std(axis=1)
    left_out = np.setdiff1d(np.arange(600), fit.rows)
    assert len(fit.rows) == 510
    assert spread[fit.rows].max() <= spread[left_out].min()


def test_the_root_of_a_covariance_does_not_hang_on_the_turn_of_its_eigenvectors(rng):
    """Its spectrum has a double value, where rounding determines the eigenvectors."""
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    covariance = turn @ np.diag([2.0, 2.0, 1.0, 0.0]) @ turn.T
    nudged = covariance + 1e-15 * np.diag([1.0, -1.0, 1.0, -1.0])
    one, other = symmetric_root(covariance), symmetric_root(nudged)
    np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_allclose(one @ one, covariance, atol=1e-9)


def test_the_mean_map_has_no_part_of_the_jumps():
    """Where an input places a landing on one side, its slope looks like a step."""
    smooth, jumping = (
        fit_kinks(seen_at_section(landings(n=1500, seed=3, jump=jump)))
        for jump in (0.0, 1.0)
    )
    apart = np.linalg.norm(jumping.linear - smooth.linear)
    assert apart < 0.07 * np.linalg.norm(smooth.linear)
    steps = jumping.jumps.coefficients
    assert np.linalg.norm(steps) > 20.0 * np.linalg.norm(smooth.jumps.coefficients)
