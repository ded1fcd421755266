import numpy as np
import pytest

from hopdata.maps.subspaces.all_pairs import all_arc_lengths
from hopdata.maps.subspaces.grassmann import exact_arc_length, orthonormalised


def bases(count, seed):
    return orthonormalised(np.random.default_rng(seed).normal(size=(count, 12, 5)))


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (3, 17), (40, 33)])
def test_every_pair_of_two_sets(rows, columns):
    a, b = bases(rows, 0), bases(columns, 1)
    b[0] = a[0]  # one pair that is no distance apart
    found = all_arc_lengths(a, b)
    assert found.shape == (rows, columns)
    first, second = np.divmod(np.arange(rows * columns), columns)
    expected = exact_arc_length(a[first], b[second])
    np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 16, 37])
def test_every_pair_within_a_set(count):
    a = bases(count, 2)
    found = all_arc_lengths(a)
    first, second = np.triu_indices(count, 1)
    expected = exact_arc_length(a[first], a[second])
    np.testing.assert_allclose(found[first, second], expected, rtol=0, atol=1e-12)
    assert not np.tril(found).any()


def test_bytes_do_not_depend_on_the_threads():
    a, b = bases(50, 3), bases(45, 4)
    assert np.array_equal(all_arc_lengths(a, b), all_arc_lengths(a, b, workers=3))
    assert np.array_equal(all_arc_lengths(a), all_arc_lengths(a, workers=3))


@pytest.mark.parametrize("workers", [1, 2])
def test_all_pairs_are_reported(workers):
    told = []
    all_arc_lengths(bases(40, 5), bases(9, 6), workers=workers, report=told.append)
    assert sum(told) == 360
    told.clear()
    all_arc_lengths(bases(40, 5), workers=workers, report=told.append)
    assert sum(told) == 40 * 39 // 2
