import mpmath
import numpy as np
import pytest
from made_up_landings import sklearn_errors

from hopdata.errors import AnalysisError
from hopdata.maps import draws
from hopdata.maps.affine import (
    affine_predictions,
    affine_test_errors,
    errors_by,
    leave_one_out_residuals,
    mean_test_errors,
    pooled_basis,
)
from hopdata.maps.draws import distinct_draws, named_generator


def landings(rng, n=200, latent=11, noise=6e-4, p=18, offset=1.0):
    """Return inputs of `latent` true dimensions in `p` noisy coordinates, and affine outputs."""
    x = rng.normal(size=(n, latent)) @ rng.normal(
        size=(latent, p)
    ) + noise * rng.normal(size=(n, p))
    y = x @ rng.normal(size=(p, p)) + 0.01 * rng.normal(size=(n, p))
    return x + offset, y - 3.0


def splits(n, train=120, test=41, count=25):
    return distinct_draws(named_generator(5, "test"), n, (train, test), count)


def statsmodels_errors(x, y, train, test):
    import statsmodels.api as sm

    errors = []
    for fitted, held in zip(train, test, strict=True):
        model = sm.OLS(y[fitted], sm.add_constant(x[fitted], has_constant="add"))
        found = (
            sm.add_constant(x[held], has_constant="add") @ model.fit(method="qr").params
        )
        errors.append(np.mean((y[held] - found) ** 2, axis=0))
    return np.array(errors)


@pytest.mark.parametrize("oracle", [statsmodels_errors, sklearn_errors])
@pytest.mark.parametrize("noise", [1.0, 6e-4])
def test_errors_are_those_of_the_libraries(oracle, noise):
    x, y = landings(np.random.default_rng(0), noise=noise)
    train, test = splits(len(x))
    expected = oracle(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-10
    )


def test_mean_errors_are_those_of_the_library():
    from sklearn.dummy import DummyRegressor

    x, y = landings(np.random.default_rng(0))
    train, test = splits(len(x))
    expected = errors_by(DummyRegressor(), x, y, train, test)
    np.testing.assert_allclose(mean_test_errors(y, train, test), expected, rtol=1e-10)
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(
            affine_test_errors(x, y, train, test), expected, rtol=0.1
        )


def test_exact_dependence_and_constant_columns_change_nothing():
    rng = np.random.default_rng(1)
    x, y = landings(rng, noise=1e-2)
    more = np.column_stack(
        [x, x[:, :2] @ [1.0, -2.0], np.full(len(x), 0.499), np.zeros(len(x))]
    )
    train, test = splits(len(x))
    expected = affine_test_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(more, y, train, test), expected, rtol=1e-9
    )
    np.testing.assert_allclose(
        affine_predictions(more, y), affine_predictions(x, y), rtol=1e-9
    )


def test_eleven_true_dimensions_without_noise():
    rng = np.random.default_rng(2)
    latent = rng.normal(size=(200, 11))
    x = latent @ rng.normal(size=(11, 18))
    y = latent @ rng.normal(size=(11, 18)) + 0.1 * rng.normal(size=(200, 18))
    train, test = splits(len(x))
    expected = affine_test_errors(latent, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-10
    )
    np.testing.assert_allclose(
        affine_predictions(x, y), affine_predictions(latent, y), atol=1e-9
    )


def test_duplicated_landings_match_the_library():
    x, y = landings(np.random.default_rng(3), n=90, noise=1e-2)
    x, y = np.vstack([x, x]), np.vstack([y, y])
    train, test = splits(len(x))
    expected = sklearn_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-10
    )


def test_a_direction_that_only_a_training_set_lacks_gets_the_minimum_norm_map():
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=(60, 5)), rng.normal(size=(60, 3))
    x[:55, 4] = 2.0
    train, test = np.arange(40)[None], np.arange(40, 60)[None]
    errors = affine_test_errors(x, y, train, test)
    np.testing.assert_allclose(errors, sklearn_errors(x, y, train, test), rtol=1e-10)
    full = np.arange(20, 60)[None], np.arange(20)[None]
    both = [np.vstack(pair) for pair in zip((train, test[:, :20]), full, strict=True)]
    np.testing.assert_allclose(
        affine_test_errors(x, y, *both)[0], errors[0], rtol=1e-12
    )


def test_fewer_landings_than_inputs_match_the_library():
    x, y = landings(np.random.default_rng(5), n=30, noise=0.1)
    train, test = splits(30, train=12, test=8)
    expected = sklearn_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-9
    )


def conditioned(rng, condition, n=60, p=6, q=2):
    """Return inputs of this condition number in arbitrary directions, and noisy outputs."""
    base, twist = rng.normal(size=(n, p)), np.linalg.qr(rng.normal(size=(p, p)))[0]
    x = base * np.geomspace(1, 1 / condition, p) @ twist
    return x, base @ rng.normal(size=(p, q)) + 0.1 * rng.normal(size=(n, q))


def exact_errors(x, y, train, test):
    """Return errors of the given floats, computed with 80 digits."""
    errors = []
    with mpmath.workdps(80):
        x, y = (
            mpmath.matrix(np.column_stack(part).tolist())
            for part in ([np.ones(len(x)), x], [y])
        )
        for fitted, held in zip(train, test, strict=True):
            a, b = (_rows(part, fitted) for part in (x, y))
            slopes = mpmath.inverse(a.T * a) * (a.T * b)
            misses = _rows(y, held) - _rows(x, held) * slopes
            squares = np.array((misses.apply(lambda value: value**2)).tolist())
            errors.append([float(sum(column) / len(held)) for column in squares.T])
    return np.array(errors)


def _rows(matrix, rows):
    return mpmath.matrix(
        [[matrix[int(i), j] for j in range(matrix.cols)] for i in rows]
    )


@pytest.mark.parametrize("offset", [0.0, 1.0])
@pytest.mark.parametrize("condition", [1e2, 1e6, 1e10])
def test_error_grows_no_faster_than_the_condition_number(condition, offset):
    x, y = conditioned(np.random.default_rng(6), condition)
    x += offset
    train, test = splits(len(x), 30, 12, count=2)
    expected = exact_errors(x, y, train, test)
    bound = max(2e-13, 5e-16 * condition)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=bound
    )


@pytest.mark.parametrize(
    "shape", [(1, 1), (6, 1), (7, 8), (8, 5), (9, 14), (15, 2), (16, 16)]
)
def test_any_number_of_inputs_and_outputs(shape):
    rng = np.random.default_rng(16)
    x, y = rng.normal(size=(90, shape[0])), rng.normal(size=(90, shape[1]))
    train, test = splits(90, 40, 13, count=5)
    expected = sklearn_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-11
    )
    rows = y[train].mean(axis=1, keepdims=True)
    expected = np.mean((y[test] - rows) ** 2, axis=1)
    np.testing.assert_allclose(mean_test_errors(y, train, test), expected, rtol=1e-12)


def test_scales_of_the_columns_do_not_matter():
    x, y = landings(np.random.default_rng(7), noise=0.1)
    train, test = splits(len(x))
    scaled = x * np.geomspace(1e-9, 1e6, x.shape[1])
    expected = affine_test_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(scaled, y, train, test), expected, rtol=1e-10
    )


def test_replicates_do_not_depend_on_each_other(monkeypatch):
    x, y = landings(np.random.default_rng(8), n=60)
    x[:50, 4] = 2.0  # so that some training sets lack a direction
    train, test = splits(60, 30, 20, count=40)
    whole = affine_test_errors(x, y, train, test)
    monkeypatch.setattr(draws, "CHUNK_BYTES", 1)
    assert np.array_equal(affine_test_errors(x, y, train, test), whole)
    parts = [affine_test_errors(x, y, train[[r]], test[[r]])[0] for r in range(40)]
    assert np.array_equal(parts, whole)


def test_float32_input_is_computed_in_double():
    x, y = (
        part.astype(np.float32)
        for part in landings(np.random.default_rng(9), noise=0.1)
    )
    train, test = splits(len(x))
    expected = affine_test_errors(x.astype(float), y.astype(float), train, test)
    assert np.array_equal(affine_test_errors(x, y, train, test), expected)


def test_predictions_are_those_of_least_squares():
    rng = np.random.default_rng(10)
    x, y = rng.normal(size=(50, 6)), rng.normal(size=(50, 4))
    design = np.column_stack([np.ones(50), x])
    expected = design @ np.linalg.lstsq(design, y, rcond=None)[0]
    np.testing.assert_allclose(affine_predictions(x, y), expected, atol=1e-13)


def test_leave_one_out_is_a_refit_without_the_row():
    x, y = landings(np.random.default_rng(12), n=40, noise=0.1)
    found = leave_one_out_residuals(x, y)
    for row in (0, 17, 39):
        others = np.arange(40) != row
        design = np.column_stack([np.ones(40), x])
        slopes = np.linalg.lstsq(design[others], y[others], rcond=None)[0]
        expected = y[row] - design[row] @ slopes
        np.testing.assert_allclose(found[row], expected, rtol=1e-8)


def test_leave_one_out_refuses_what_it_cannot_do():
    x, y = landings(np.random.default_rng(13), n=19, noise=0.1)
    with pytest.raises(AnalysisError, match="19 landings do not suffice"):
        leave_one_out_residuals(x, y)


def test_mean_errors_by_hand():
    y = np.array([[0.0], [2.0], [10.0], [4.0]])
    found = mean_test_errors(y, np.array([[0, 1], [1, 3]]), np.array([[2, 3], [0, 2]]))
    np.testing.assert_allclose(found, [[(81 + 9) / 2], [(9 + 49) / 2]])


def test_constant_inputs_leave_the_mean():
    rng = np.random.default_rng(14)
    x, y = np.full((200, 3), 0.288), rng.normal(size=(200, 2))
    train, test = splits(len(x))
    expected = mean_test_errors(y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-12
    )


def test_values_that_are_not_finite_are_refused():
    x, y = landings(np.random.default_rng(15))
    x[3, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        affine_test_errors(x, y, *splits(len(x)))
    with pytest.raises(ValueError, match="expected"):
        affine_predictions(x[:10], y)


@pytest.mark.parametrize("count", [30, 256, 257, 700])
@pytest.mark.parametrize("condition", [1.0, 1e5, 1e10])
def test_columns_are_orthogonal_and_span_the_inputs(count, condition):
    rng = np.random.default_rng(0)
    twist = np.linalg.qr(rng.normal(size=(9, 9)))[0]
    x = rng.normal(size=(count, 9)) * np.geomspace(1, 1 / condition, 9) @ twist + 1.0
    design = pooled_basis(x)
    assert design.shape == (count, 10)
    assert (design[:, 0] == 1).all()
    np.testing.assert_allclose(design.T @ design / count, np.eye(10), atol=1e-13)
    rest = x - design @ (design.T @ x / count)
    assert np.abs(rest).max() < 1e-14


def test_directions_that_are_not_there_are_left_out():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 4)) @ rng.normal(size=(4, 7))
    more = np.column_stack([x, np.full(400, 0.499), x[:, 0]])
    assert pooled_basis(x).shape == pooled_basis(more).shape == (400, 5)
    assert pooled_basis(np.full((400, 3), 0.288)).shape == (400, 1)
    assert pooled_basis(x[:3]).shape == (3, 3)
