"""Matching of instants: one to one, as many as can be, nearest; against brute force."""

from itertools import permutations

import numpy as np
import pytest

from hopdata.landings.contact_matching import likely_offset, match_instants


def brute_force(first, second, window_s):
    """Most pairs and, among those, the least sum of differences."""
    best = (0, 0.0)
    padded = [*range(len(second)), *[None] * len(first)]
    for chosen in set(permutations(padded, len(first))):
        apart = [abs(first[i] - second[j]) for i, j in enumerate(chosen) if j is not None]
        if all(d <= window_s for d in apart):
            best = min(best, (-len(apart), sum(apart)))
    return -best[0], best[1]


@pytest.mark.parametrize("seed", range(20))
def test_as_many_pairs_as_there_can_be_and_the_nearest(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(0, 0.3, 4), rng.uniform(0, 0.3, 3)
    i, j = match_instants(first, second, window_s=0.05)
    assert len(set(i)) == len(set(j)) == len(i)
    apart = np.abs(first[i] - second[j])
    assert (apart <= 0.05).all()
    number, total = brute_force(first, second, 0.05)
    assert len(i) == number
    assert apart.sum() == pytest.approx(total, abs=1e-12)
    assert (np.diff(first[i]) > 0).all()


def test_long_lists_with_losses():
    rng = np.random.default_rng(1)
    true = np.cumsum(rng.uniform(0.3, 0.6, 3000))
    kept_a, kept_b = rng.random(3000) < 0.95, rng.random(3000) < 0.9
    a, b = true[kept_a], true[kept_b] + rng.normal(0, 0.002, kept_b.sum())
    i, j = match_instants(a, b, window_s=0.05)
    assert len(i) == (kept_a & kept_b).sum()
    np.testing.assert_array_equal(np.flatnonzero(kept_a)[i], np.flatnonzero(kept_b)[j])


@pytest.mark.parametrize(("first", "second"), [([], []), ([1.0], []), ([], [1.0]), ([1.0], [2.0])])
def test_nothing_to_match(first, second):
    i, j = match_instants(np.array(first), np.array(second), window_s=0.1)
    assert len(i) == len(j) == 0


def test_the_offset_of_two_clocks_is_found():
    rng = np.random.default_rng(2)
    true = np.cumsum(rng.uniform(0.4, 0.8, 60))
    found = likely_offset(true[5:], true[:50] - 0.731, window_s=0.02)
    assert found == pytest.approx(0.731, abs=1e-9)
    assert likely_offset(true, rng.uniform(0, 30, 60), window_s=0.001) is None
    assert likely_offset(true, np.empty(0), window_s=0.02) is None
