import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.learning import map_error_by_landings, prediction_by_landings
from hopdata.maps.truth.maps import ExactMap
from plain_columns import shadowed

SIZES = (20, 40, 80, 160, 320)


def landings(*, noise=0.1, bend=0.0, n=700, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 8))
    slopes = rng.normal(size=(8, 11))
    y = x @ slopes + bend * (x[:, :1] ** 2 - 1) + noise * rng.normal(size=(n, 11))
    return x, y, slopes


def test_the_error_falls_to_the_noise_as_theory_says():
    x, y, _ = landings()
    found = prediction_by_landings(x, y, SIZES, seed=1).set_index("landings")
    # A fit of p coefficients to N normal inputs errs by (N + 1) / (N - p - 1) times
    # the noise, out of sample, with p = 9 coefficients of which one is the constant.
    for size in SIZES[1:]:
        expected = 0.01 * (1 + 1 / size) * (size - 2) / (size - 10)
        assert found.loc[size, "median_error"] == pytest.approx(expected, rel=0.06)
    assert (found["q05"] < found["median_error"]).all()
    assert (found["median_error"] < found["q95"]).all()
    assert (found["of_mean"] > 100 * found["median_error"]).all()
    assert shadowed(found) == []


def test_curvature_is_an_error_that_no_number_of_landings_removes():
    x, y, slopes = landings(noise=0.0, bend=0.5)
    found = prediction_by_landings(x, y, SIZES, seed=1).set_index("landings")
    curved = np.var(0.5 * x[:, 0] ** 2)
    assert found.loc[320, "median_error"] == pytest.approx(curved, rel=0.1)
    exact = ExactMap(slopes, x, np.ones(11))
    errors = map_error_by_landings(exact, x, y, SIZES, seed=1).set_index("landings")
    assert errors.loc[320, "median_error"] < 0.4 * errors.loc[40, "median_error"]


def test_the_map_itself_is_found():
    x, y, slopes = landings(noise=0.1)
    exact = ExactMap(slopes, x, np.ones(11))
    found = map_error_by_landings(exact, x, y, SIZES, seed=1).set_index("landings")
    size = np.sqrt(np.sum(slopes**2))
    for n in SIZES[2:]:
        expected = 0.1 * np.sqrt(88 / (n - 9)) / size
        assert found.loc[n, "median_error"] == pytest.approx(expected, rel=0.15)
    other = ExactMap(-slopes, x, np.ones(11))
    far = map_error_by_landings(other, x, y, SIZES, seed=1)
    assert (far["median_error"] > 1.9).all()


def test_sizes_that_the_landings_do_not_allow_are_left_out():
    x, y, slopes = landings(n=250)
    found = prediction_by_landings(x, y, (5, 40, 100), seed=1)
    assert found["landings"].tolist() == [40]
    exact = ExactMap(slopes, x, np.ones(11))
    of_map = map_error_by_landings(exact, x, y, (5, 40, 400), seed=1)
    assert of_map["landings"].tolist() == [40]


def test_as_many_landings_as_are_held_out_are_refused():
    x, y, _ = landings(n=200)
    with pytest.raises(AnalysisError, match="more landings than the 200"):
        prediction_by_landings(x, y, SIZES, seed=1)


def test_a_size_does_not_depend_on_the_others():
    x, y, _ = landings()
    every = prediction_by_landings(x, y, SIZES, seed=1).set_index("landings")
    one = prediction_by_landings(x, y, (80,), seed=1).set_index("landings")
    assert one.loc[80].equals(every.loc[80])
    other = prediction_by_landings(x, y, (80,), seed=2).set_index("landings")
    assert not one.loc[80].equals(other.loc[80])
