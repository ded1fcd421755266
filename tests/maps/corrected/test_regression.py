"""Estimates of a linear map on data whose map and noise are known."""

import numpy as np
import pytest
from made_up_landings import CONTACTS, inputs

from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import affordable_degree, monomials, time_differences
from hopdata.maps.corrected.marker_noise import (
    LEAST_RELIABILITY,
    InputErrors,
    calibration,
)
from hopdata.maps.corrected.regression import (
    contact_slopes,
    corrected_map,
    curved_map,
    mean_cube,
    mean_signed_square,
    mean_terms,
    ols_map,
    simultaneous_point,
)

SLOPES = np.random.default_rng(7).normal(size=(8, 2))
NOISE = 0.15 * np.array(np.random.default_rng(8).normal(size=(8, 8)))
COMMON = np.random.default_rng(6).normal(size=(8, 2))
ERRORS = InputErrors(NOISE @ NOISE.T, NOISE @ NOISE.T @ COMMON)


def measured(count, seed=0, bend=0.0, noise=1.0):
    """Return inputs and outputs with normal errors of moments `ERRORS`, and contact instants."""
    x, instants = inputs(count, seed)
    d = 100 * np.column_stack(
        [instants[:, 0] - instants[:, 1], instants[:, 1] - instants[:, 2]]
    )
    y = x @ SLOPES + bend * d * np.abs(d) + 0.3 * x[:, :2] ** 2 * bend
    rng = np.random.default_rng((seed, 1))
    error = noise * rng.normal(size=(count, 8)) @ NOISE.T
    y = y + error @ COMMON + noise * rng.normal(size=y.shape)
    return x + error, y, instants + 1e-4 * rng.normal(size=instants.shape)


def plain(x, y, _):
    return ols_map(x, y).coefficients


def corrected(x, y, _):
    return corrected_map(x, y, ERRORS).coefficients


def mean_miss(fit, repeats=40, count=400, **options):
    """Return the mean error over repeated data, in units of its own standard error."""
    found = np.array(
        [fit(*measured(count, seed, **options)) for seed in range(repeats)]
    )
    miss = found.mean(axis=0) - SLOPES
    return np.abs(miss).max(), np.abs(
        miss / (found.std(axis=0) / np.sqrt(repeats))
    ).max()


def test_least_squares_is_biased_and_the_correction_is_not():
    biased, _ = mean_miss(plain)
    assert biased > 0.3
    miss, in_errors = mean_miss(corrected)
    assert miss < 0.06
    assert in_errors < 4.5  # largest of 16


def test_the_curved_estimate_is_right_where_least_squares_is_not():
    none = {"bend": 0.5, "noise": 0.0, "count": 900, "repeats": 3}
    straight, _ = mean_miss(plain, **none)
    curved, _ = mean_miss(lambda x, y, t: curved_map(x, y, t).coefficients, **none)
    assert straight > 0.1
    assert curved < 0.02


def test_both_corrections_are_right_where_one_is_not():
    many = {"bend": 0.5, "count": 2500, "repeats": 8}
    ways = {
        "curved": lambda x, y, t: curved_map(x, y, t).coefficients,
        "corrected": corrected,
        "both": lambda x, y, t: curved_map(x, y, t, ERRORS).coefficients,
    }
    miss = {name: mean_miss(fit, **many)[0] for name, fit in ways.items()}
    assert miss["both"] < 0.5 * min(miss["curved"], miss["corrected"])


def test_the_correction_is_the_moment_estimate():
    x, y, _ = measured(300)
    moments = np.cov(np.hstack([x, y]), rowvar=False)
    expected = np.linalg.solve(
        moments[:8, :8] - ERRORS.inputs, moments[:8, 8:] - ERRORS.shared
    )
    np.testing.assert_allclose(
        corrected_map(x, y, ERRORS).coefficients, expected, atol=1e-12
    )


def test_without_noise_the_corrections_are_least_squares():
    x, y, t = measured(300)
    none = InputErrors.none(8, 2)
    straight = ols_map(x, y)
    expected = np.linalg.lstsq(x - x.mean(axis=0), y - y.mean(axis=0), rcond=None)[0]
    np.testing.assert_allclose(straight.coefficients, expected, atol=1e-12)
    same = corrected_map(x, y, none)
    np.testing.assert_allclose(same.coefficients, straight.coefficients, atol=1e-12)
    np.testing.assert_allclose(
        same.standard_errors, straight.standard_errors, rtol=1e-9
    )
    assert same.removed == 1.0
    curved = curved_map(x, y, t, none).coefficients
    np.testing.assert_array_equal(curved, curved_map(x, y, t).coefficients)


def test_standard_errors_are_those_of_repeated_data():
    fits = [corrected_map(*measured(400, seed)[:2], ERRORS) for seed in range(150)]
    found = np.array([fit.coefficients for fit in fits]).std(axis=0)
    said = np.sqrt(np.mean([fit.standard_errors**2 for fit in fits], axis=0))
    assert np.abs(said / found - 1).max() < 0.25
    assert abs(np.mean(said / found) - 1) < 0.1


@pytest.mark.parametrize("count", [11, 12, 14])
def test_hardly_more_landings_than_inputs_have_no_standard_errors_of_zero(count):
    noise = InputErrors(0.25 * np.eye(8), np.zeros((8, 2)))
    for seed in range(100):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=(count, 8))
        y = x @ SLOPES + 0.3 * rng.standard_t(3, (count, 2))
        fit = corrected_map(x + 0.5 * rng.normal(size=x.shape), y, noise)
        assert (fit.standard_errors > 1e-4).all(), seed


def test_the_units_of_inputs_and_outputs_do_not_matter():
    x, y, t = measured(400, bend=0.3)
    a, b = np.logspace(-3, 3, 8), np.array([1e-4, 1e4])
    for fit in (
        lambda x, y, e: corrected_map(x, y, e).coefficients,
        lambda x, y, e: curved_map(x, y, t, e).coefficients,
    ):
        errors = InputErrors(
            a[:, None] * ERRORS.inputs * a, a[:, None] * ERRORS.shared * b
        )
        other = fit(x * a + 5.0 * a, y * b - 3.0, errors)
        np.testing.assert_allclose(other, fit(x, y, ERRORS) / a[:, None] * b, rtol=1e-6)


@pytest.mark.parametrize("factor", [0.0, 0.5, 0.999, 1.0, 1.5, 100.0])
def test_no_more_noise_is_taken_off_than_there_is_spread(factor):
    x, y, _ = measured(200)
    moments = np.cov(x, rowvar=False)
    values, vectors = np.linalg.eigh(moments)
    noise = factor * values[0] * np.outer(vectors[:, 0], vectors[:, 0])
    known = calibration(x, InputErrors(noise, np.zeros((8, 2))))
    left = np.linalg.eigvalsh(moments - known.removed * noise)
    assert left[0] > 0.3 * values[0] * (1 - 1e-9)
    assert known.removed == pytest.approx(
        min(1.0, (1 - LEAST_RELIABILITY) / max(factor, 0.1))
    )
    assert np.isfinite(
        corrected_map(x, y, InputErrors(noise, np.zeros((8, 2)))).coefficients
    ).all()


def test_few_landings_bear_fewer_terms():
    x, y, t = measured(900, bend=0.5, noise=0.0)
    y = y + 0.2 * x[:, :2] ** 3
    degrees = [curved_map(x[:n], y[:n], t[:n]).degree for n in (30, 100, 250, 900)]
    assert degrees == [0, 1, 2, 3]


def test_terms_that_only_scatter_are_left_out():
    degrees = [curved_map(*measured(900, seed)).degree for seed in range(10)]
    assert np.mean(degrees) < 1.0
    x, y, t = measured(900, bend=0.2)
    assert curved_map(x, y * [1.0, 0.0], t).degree == curved_map(x, y[:, :1], t).degree
    loud = np.column_stack([y[:, 0], 1e3 * np.random.default_rng(5).normal(size=900)])
    quiet = curved_map(x, loud, t, units=np.array([1.0, 1e9])).degree
    assert quiet == curved_map(x, y[:, :1], t).degree


def test_bad_input_is_refused():
    x, y, t = measured(60)
    with pytest.raises(ValueError, match="finite"):
        ols_map(np.where(x > 2, np.nan, x), y)
    with pytest.raises(ValueError, match=r"\(n, p\) and \(n, q\)"):
        ols_map(x, y[:-1])
    with pytest.raises(AnalysisError, match="9 landings do not suffice for 8 inputs"):
        ols_map(x[:9], y[:9])
    with pytest.raises(AnalysisError, match="vary in all directions"):
        corrected_map(x * np.array([0, 1, 1, 1, 1, 1, 1, 1]), y, ERRORS)
    with pytest.raises(AnalysisError, match="instants that differ"):
        curved_map(x, y, np.zeros_like(t))


# Terms of a curved map, averaged over noisy inputs, against drawn inputs.


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
        mass = (
            half
            * weights
            * np.exp(-0.5 * ((d - middle) / sd) ** 2)
            / sd
            / np.sqrt(2 * np.pi)
        )
        square, cube = (mass * d * np.abs(d)).sum(), (mass * np.abs(d) ** 3).sum()
    assert mean_signed_square(np.array(middle), np.array(sd)) == pytest.approx(
        square, abs=1e-7
    )
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
    np.testing.assert_allclose(
        middle, (x.mean(axis=0) - 0.3) @ relative + offset, atol=1e-4
    )


def test_all_feet_are_down_at_once_at_the_simultaneous_point():
    x, _ = inputs(400)
    middle = np.array([0.002, -0.001, -0.001])
    slopes = CONTACTS - CONTACTS.mean(axis=1, keepdims=True)
    point = simultaneous_point(x, middle, slopes)
    np.testing.assert_allclose(
        middle + (point - x.mean(axis=0)) @ slopes, 0.0, atol=1e-12
    )
    # Any other such point is farther from the mean in the metric of the inputs'
    # covariance.
    away = np.linalg.svd(slopes.T)[2][-1]
    metric = np.linalg.inv(np.cov(x, rowvar=False))
    step = point - x.mean(axis=0)
    for other in (step + 0.1 * away, step - 0.1 * away):
        assert other @ metric @ other > step @ metric @ step


def test_the_point_stays_at_the_mean_if_that_is_simultaneous():
    x, _ = inputs(300)
    np.testing.assert_array_equal(
        simultaneous_point(x, np.zeros(3), CONTACTS), x.mean(axis=0)
    )


def test_more_landings_bear_more_terms():
    found = [affordable_degree(n, 8, 3, 4.0) for n in (40, 60, 203, 204, 683, 684)]
    assert found == [0, 1, 1, 2, 2, 3]
