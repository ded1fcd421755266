import numpy as np

from hopdata.maps.subspaces.grassmann import arc_length, orthonormalised
from hopdata.maps.subspaces.pair_lengths import PairLengths


def bases(counts, seed=0):
    rng = np.random.default_rng(seed)
    return {name: orthonormalised(rng.normal(size=(n, 12, 5))) for name, n in counts.items()}


def test_all_pairs_are_used_once_where_they_are_few():
    draws = bases({"a": 5, "b": 3})
    a, b = draws.values()
    for all_pairs in (False, True):
        found = PairLengths(draws, all_pairs=all_pairs)
        lengths = found.in_class(np.random.default_rng(5), "a", 1000)
        expected = [arc_length(a[i], a[j]) for i in range(5) for j in range(i + 1, 5)]
        np.testing.assert_allclose(np.sort(lengths), np.sort(expected), atol=1e-14)
        lengths = found.cross_class(np.random.default_rng(5), "a", "b", 1000)
        expected = [arc_length(i, j) for i in a for j in b]
        np.testing.assert_allclose(np.sort(lengths), np.sort(expected), atol=1e-14)


def test_in_class_never_compares_a_draw_with_itself():
    found = PairLengths(bases({"a": 30}))
    assert found.in_class(np.random.default_rng(7), "a", 400).min() > 0.1


def test_a_summary_has_what_was_measured():
    draws = bases({"a": 9, "b": 8, "c": 7})
    some, whole = PairLengths(draws), PairLengths(draws, all_pairs=True, workers=2)
    chosen = [found.cross_class(np.random.default_rng(1), "b", "c", 10) for found in (some, whole)]
    np.testing.assert_allclose(*chosen, rtol=0, atol=1e-12)
    assert (some.sums["cross_class"].count, whole.sums["cross_class"].count) == (10, 56)
    assert np.array_equal(np.sort(some.lengths("cross_class")), np.sort(chosen[0]))
    assert len(whole.lengths("cross_class")) == 56
    assert len(whole.lengths("in_class")) == 0


def test_progress_is_shown(capsys):
    PairLengths(bases({"a": 4}), all_pairs=True, progress=True).in_class(
        np.random.default_rng(0), "a", 2
    )
    assert capsys.readouterr().err == "distances: 6 of 6 pairs\n"
