import numpy as np
import pytest

from hopdata.maps.subspaces.dyads import PairSums


def triangle(values):
    """All pairs of draws, valued by how far apart they are, i < j."""
    return np.triu(np.abs(values[:, None] - values), 1)


def test_all_pairs_of_a_set_agree_with_the_jackknife():
    values = np.random.default_rng(0).gamma(2.0, size=60)
    table = triangle(values)
    sums = PairSums(60)
    sums.add_triangle(table, 0)
    others = ~np.eye(60, dtype=bool)
    left_out = [2 * table[others[i]][:, others[i]].sum() / (59 * 58) for i in range(60)]
    jackknife = np.sqrt(59 / 60 * np.sum((left_out - np.mean(left_out)) ** 2))
    assert sums.mean == pytest.approx(2 * table.sum() / (60 * 59), rel=1e-14)
    assert sums.standard_error == pytest.approx(jackknife, rel=0.05)


def test_tables_and_lists_of_pairs_are_the_same():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=7), rng.normal(size=5)
    tables, lists = PairSums(12), PairSums(12)
    tables.add_triangle(triangle(b), 7)
    tables.add_table(a[:, None] - b, 0, 7)
    first, second = np.triu_indices(5, 1)
    lists.add(triangle(b)[first, second], first + 7, second + 7)
    first, second = np.divmod(np.arange(35), 5)
    lists.add(a[first] - b[second], first, second + 7)
    assert tables.count == lists.count == 45
    assert tables.mean == pytest.approx(lists.mean, rel=1e-13)
    assert tables.standard_error == pytest.approx(lists.standard_error, rel=1e-12)


def test_pairs_without_a_draw_in_common_are_independent():
    values = np.random.default_rng(2).normal(size=50)
    sums = PairSums(100)
    sums.add(values, np.arange(0, 100, 2), np.arange(1, 100, 2))
    assert sums.standard_error == pytest.approx(values.std() / np.sqrt(50), rel=1e-12)


@pytest.mark.parametrize("pairs", [40, 400])
def test_the_error_is_that_of_repeated_studies(pairs):
    rng = np.random.default_rng(3)
    means, errors = [], []
    for _ in range(800):
        values = rng.gamma(2.0, size=(2, 25))
        first, second = rng.integers(0, 25, (2, pairs))
        sums = PairSums(50)
        sums.add(np.abs(values[0, first] - values[1, second]), first, second + 25)
        means.append(sums.mean)
        errors.append(sums.standard_error)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(means), rel=0.1)


def test_of_one_pair_there_is_no_error_and_of_none_no_mean():
    sums = PairSums(2)
    assert np.isnan(sums.mean)
    sums.add(np.array([1.5]), np.array([0]), np.array([1]))
    assert sums.mean == 1.5
    assert np.isnan(sums.standard_error)
