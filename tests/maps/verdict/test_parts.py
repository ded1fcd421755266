"""The pieces of the verdict, each against what is known of it."""

from dataclasses import replace
from itertools import combinations_with_replacement, permutations

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.maps.verdict.effect import (
    EffectSize,
    agreeing,
    detectable_size,
    effect_size,
    outcome_variance,
    squared_size,
)
from hopdata.maps.verdict.estimate import choose_window, fit_kinks, fit_window, window_kinks
from hopdata.maps.verdict.expected_contacts import contact_orders, expected_contacts
from hopdata.maps.verdict.inputs import section_landings
from hopdata.maps.verdict.kinks import foot_sets, kink_slopes, kinks
from hopdata.maps.verdict.shrinkage import variance_ratios
from hopdata.maps.verdict.significance import KinkTest, draws, flip_signs
from hopdata.maps.verdict.smooth import (
    free_terms,
    monomials,
    number_of_free_terms,
    shrunk_terms,
)
from hopdata.maps.verdict.window import landing_window


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize(("feet", "number"), [(2, 1), (3, 4), (4, 6), (6, 15)])
def test_number_of_kinks(feet, number):
    assert len(foot_sets(feet)) == number


@pytest.mark.parametrize("feet", [2, 3, 4])
def test_slopes_of_the_kinks_are_their_derivatives(feet):
    for order in permutations(range(feet)):
        t = np.argsort(order) * 1.0
        steps = np.array(
            [(kinks((t + e)[None]) - kinks((t - e)[None]))[0] / 2e-3 for e in 1e-3 * np.eye(feet)]
        )
        assert np.allclose(steps.T, kink_slopes(order), atol=1e-9)


def test_every_continuous_function_linear_on_each_order_is_a_sum_of_kinks(rng):
    """Values at the six rays (one foot first, or one foot last) are free; linear between them."""
    rays = np.array(
        [np.eye(3)[k] - 1 / 3 for k in range(3)] + [1 / 3 - np.eye(3)[k] for k in range(3)]
    )
    design = np.column_stack([kinks(rays), rays[:, :2]])
    assert np.linalg.matrix_rank(design) == 6
    values = rng.standard_normal(6)
    weights = np.linalg.solve(design, values)
    middle = rays[0] + rays[5]  # between neighbouring rays, inside one order
    found = np.concatenate([kinks(middle[None])[0], middle[:2]]) @ weights
    assert found == pytest.approx(values[0] + values[5])


@pytest.mark.parametrize("degree", [2, 3])
def test_number_of_free_terms(degree, rng):
    x, t = rng.standard_normal((5, 8)), rng.standard_normal((5, 3))
    assert free_terms(x, t, degree).shape[1] == number_of_free_terms(8, 3, degree)
    for group in shrunk_terms(x, t, degree):
        assert np.allclose(np.mean(group**2, axis=0), 1.0)


@pytest.mark.parametrize("true", [(1.0, 0.0), (0.0, 1.0), (1.0, 0.1), (0.5, 0.5), (0.0, 0.0)])
def test_ratios_of_variances_are_found(true, rng):
    groups = rng.standard_normal((2, 2000, 60)) / 3
    signal = sum(
        group @ (np.sqrt(ratio) * rng.standard_normal((60, 40)))
        for group, ratio in zip(groups, true, strict=True)
    )
    found = variance_ratios(tuple(groups), signal + rng.standard_normal((2000, 40)), 0)
    assert np.allclose(np.median(found.ratios, axis=0), true, rtol=0.2, atol=0.01)
    assert np.allclose(found.noise, 1.0, rtol=0.15)


def test_variances_are_those_of_the_projections_themselves(rng):
    """The triangle of terms and outputs together says what projections on the terms say."""
    groups, outputs = rng.standard_normal((2, 200, 30)), rng.standard_normal((200, 5))
    found = variance_ratios(tuple(groups), outputs, 10)
    basis = np.linalg.qr(np.hstack(list(groups)))[0]
    rest = np.sum(outputs**2, axis=0) - np.sum((basis.T @ outputs) ** 2, axis=0)
    assert (rest / 190 <= found.noise * (1 + 1e-12)).all()
    assert (found.noise <= np.sum(outputs**2, axis=0) / 190 * (1 + 1e-12)).all()


def test_monomials_are_products_of_columns(rng):
    x = rng.standard_normal((7, 4))
    expected = [
        np.prod(x[:, list(chosen)], axis=1)
        for degree in (1, 3)
        for chosen in combinations_with_replacement(range(4), degree)
    ]
    np.testing.assert_array_equal(monomials(x, (1, 3)), np.column_stack(expected))


def test_kinks_alone_are_those_of_the_whole_fit():
    data = landings(n=700, strength=0.2, noise=0.02)
    x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
    expected = expected_contacts(x, data.instants)
    rows = np.arange(0, 700, 2)
    whole = fit_window(x, data.y, expected, rows, 0.5, 2)
    seen, coefficients = window_kinks(x, data.y, expected, rows, 2)
    np.testing.assert_array_equal(seen, whole.seen)
    size = np.abs(whole.coefficients).max()
    np.testing.assert_allclose(coefficients, whole.coefficients, rtol=0, atol=1e-11 * size)


def test_kinks_are_those_of_the_penalised_fit():
    """Free terms, kinks and shrunk terms at once, each shrunk one with a row of its own."""
    data = landings(n=700, strength=0.2, noise=0.02)
    x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
    expected, rows = expected_contacts(x, data.instants), np.arange(700)
    part = landing_window(x, data.y, expected, rows, 2)
    _, coefficients = window_kinks(x, data.y, expected, rows, 2)
    for k in (0, 5, 10):
        spreads = np.sqrt(np.repeat(part.variances.ratios[k], part.sizes))
        design = np.hstack([part.bends, part.others * spreads])
        price = np.hstack([np.zeros((len(spreads), part.bends.shape[1])), np.eye(len(spreads))])
        target = np.concatenate([part.outputs[:, k], np.zeros(len(spreads))])
        found = np.linalg.lstsq(np.vstack([design, price]), target, rcond=None)[0]
        direct = found[: part.bends.shape[1]] / part.unit_s
        np.testing.assert_allclose(coefficients[:, k], direct, atol=1e-9 * np.abs(direct).max())


def test_mixed_terms_do_not_depend_on_the_basis_of_the_instants(rng):
    """Three feet have two differences of contact instants, whichever are taken."""
    x, t = rng.standard_normal((300, 8)), rng.standard_normal((300, 3))
    t -= t.mean(axis=1, keepdims=True)
    mixed = shrunk_terms(x, t, 3)[1]
    other = np.column_stack(
        [t[:, i] * t[:, j] * x[:, 0] * x[:, 5] for i in range(2) for j in range(i, 2)]
    )
    rest = other - mixed @ np.linalg.lstsq(mixed, other, rcond=None)[0]
    assert np.abs(rest).max() < 1e-10


def test_noise_free_kinks_are_recovered():
    """Outputs less the kinks found are a smooth function of the inputs, to rounding."""
    data = landings(n=800, strength=0.2, noise=0.0)
    x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
    line = np.column_stack([np.ones(len(x)), x])
    exact = line @ np.linalg.lstsq(line, data.instants - 1.0, rcond=None)[0]
    exact -= exact.mean(axis=1, keepdims=True)
    fit = fit_kinks(x, data.y, exact)[0]
    rest = data.y - kinks(exact) @ fit.seen @ fit.coefficients
    design = free_terms(x, exact / 0.01, 2)[:, :45]
    left = rest - design @ np.linalg.lstsq(design, rest, rcond=None)[0]
    kinked = data.y - design @ np.linalg.lstsq(design, data.y, rcond=None)[0]
    assert np.abs(left).max() < 0.05 * np.abs(kinked).max()


def test_the_map_is_the_mean_of_those_of_the_orders():
    """With kinks of the latest foot alone, whose mean derivative is known."""
    data = landings(n=1200, noise=0.0)
    x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
    t = expected_contacts(x, data.instants)
    latest = np.random.default_rng(4).standard_normal((4, 11))
    y = x @ np.random.default_rng(6).standard_normal((8, 11)) + 100.0 * kinks(t) @ latest
    fit = fit_kinks(x, y, t)[0]
    orders = list(permutations(range(3)))
    slopes = np.mean([kink_slopes(order) for order in orders], axis=0)
    smooth = y - 100.0 * kinks(t) @ latest + 100.0 * t @ slopes.T @ latest
    found = outcome_variance(fit, x, t, orders)
    assert found == pytest.approx(np.var(smooth, axis=0, ddof=1).sum(), rel=1e-6)


def test_wrong_instants_do_not_move_the_expected_ones():
    data = landings(n=600)
    x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
    good = expected_contacts(x, data.instants)
    spoilt = data.instants.copy()
    spoilt[::25] += 0.2 * np.array([1.0, -1.0, 0.5])
    assert np.abs(expected_contacts(x, spoilt) - good).max() < 2e-4


def test_a_narrower_window_is_chosen_where_curvature_is_strong():
    chosen = []
    for curvature in (0.0, 3.0):
        data = landings(n=1500, curvature=curvature, noise=1e-3)
        x = (data.x - data.x.mean(axis=0)) / data.x.std(axis=0)
        fits = fit_kinks(x, _with_high_order(data, curvature), expected_contacts(x, data.instants))
        chosen.append(choose_window(fits).window)
    assert chosen[1] < chosen[0] == 1.0


def _with_high_order(data, strength):
    times = data.instants - data.instants.mean(axis=1, keepdims=True)
    d = (times[:, 0] - times[:, 1]) / times.std()
    return data.y + 0.01 * strength * data.y.std(axis=0) * (d**3 * np.abs(d))[:, None]


def test_orders_of_enough_landings_are_those_seen():
    instants = np.array([[0.0, 0.001, 0.02], [0.02, 0.01, 0.0], [0.0, 0.02, 0.01]])
    found = contact_orders(np.repeat(instants, (30, 20, 19), axis=0), 20)
    assert found == ((0, 1, 2), (2, 1, 0))


@pytest.fixture(scope="module")
def fitted():
    data = landings(n=600, noise=0.3)
    section = section_landings(data.before, data.after, data.instants, 0.05)
    fit = choose_window(fit_kinks(section.inputs, section.outputs, section.expected))
    schedules = list(section.schedules)
    outcome = outcome_variance(fit, section.inputs, section.expected, schedules)
    form = squared_size(fit, section.expected, schedules, outcome)
    return fit, form


def test_the_interval_begins_at_zero_where_the_test_does_not_exclude_it():
    found = EffectSize(estimate=0.2, low=0.1, high=0.3, upper_bound=0.28, detectable=0.1)
    assert agreeing(found, 0.049, 0.05) == found
    assert agreeing(found, 0.05, 0.05) == replace(found, low=0.0)


def test_size_and_bounds_are_in_order(fitted, rng):
    effect = effect_size(*fitted, generator=rng)
    assert effect.low <= effect.estimate <= effect.high
    assert effect.estimate <= effect.upper_bound <= effect.high


def test_more_power_asks_for_a_larger_difference_and_more_landings_for_a_smaller(fitted, rng):
    fit, form = fitted
    sizes = [detectable_size(fit, form, rng, 0.05, power) for power in (0.5, 0.8, 0.95)]
    assert sizes == sorted(sizes)
    quartered = replace(fit, covariance=fit.covariance / 4)
    half = detectable_size(quartered, form, np.random.default_rng(5), 0.05, 0.8)
    whole = detectable_size(fit, form, np.random.default_rng(5), 0.05, 0.8)
    assert half == pytest.approx(whole / 2)


def test_a_difference_of_the_detectable_size_is_found_as_often_as_said(fitted, rng):
    """With an error like the size itself, all kinds are alike and the power is known."""
    from scipy.stats import chi2, ncx2

    fit, form = fitted
    alike = replace(fit, covariance=np.linalg.inv(form))
    size = detectable_size(alike, form, rng, 0.05, 0.8)
    threshold = chi2.ppf(0.95, len(form))
    assert ncx2.sf(threshold, len(form), size**2) == pytest.approx(0.8, abs=1e-6)


def test_false_alarms_are_as_rare_as_said_and_the_statistic_as_large():
    found = []
    for seed in range(60):
        data = landings(n=450, seed=seed)
        section = section_landings(data.before, data.after, data.instants, 0.05)
        fit = choose_window(fit_kinks(section.inputs, section.outputs, section.expected))
        found.append(flip_signs(fit, generator=np.random.default_rng(seed), flips=99))
    mean = np.mean([test.statistic / test.degrees_of_freedom for test in found])
    assert 0.8 < mean < 1.1  # with few landings, noise that looks like curvature counts twice
    assert sum(t.p_value <= 0.1 for t in found) <= 13  # 6 expected; more in one of a thousand


def test_a_p_value_at_its_floor_is_printed_as_a_bound():
    assert KinkTest(90.0, 44, 1 / 2000, 1999).p_text == "p <= 0.0005"
    assert KinkTest(60.0, 44, 2 / 2000, 1999).p_text == "p = 0.001"


def test_parallel_pairs_of_six_feet_on_a_rigid_body_share_their_kinks():
    rng = np.random.default_rng(3)
    angle = np.pi / 3 * np.arange(6)
    x = rng.normal(size=(900, 8))
    tilts = np.column_stack([np.cos(angle), np.sin(angle)])
    instants = 0.005 * (x[:, :2] @ tilts.T + 0.01 * x[:, 2:4] ** 2 @ rng.normal(size=(2, 6)))
    y = rng.normal(size=(900, 2))
    fits = fit_kinks(x, y, instants)
    assert fits[0].seen.shape == (15, 6)
    independent = 0.005 * x[:, :4] @ rng.normal(size=(4, 4))
    assert fit_kinks(x, y, independent)[0].seen.shape == (6, 6), "no pair is like another"


def test_a_verdict_on_other_than_three_feet_says_what_was_not_measured():
    from hopdata.maps.verdict.judge import _feet_notes

    assert _feet_notes(3) == []
    assert "6 feet" in _feet_notes(6)[0]["what"]


def test_draws_of_a_covariance_do_not_hang_on_the_turn_of_its_eigenvectors():
    """Its spectrum has a double value: eigenvectors there are whatever rounding makes of them."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
    covariance = turn @ np.diag([2.0, 2.0, 1.0, 0.0]) @ turn.T
    nudged = covariance + 1e-15 * np.diag([1.0, -1.0, 1.0, -1.0])
    one, other = (draws(c, 2000, np.random.default_rng(7)) for c in (covariance, nudged))
    np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(np.cov(one, rowvar=False), covariance, atol=0.2)
