import numpy as np
import pytest

from hopdata.maps.draws import distinct_draws, named_generator


def test_a_named_stream_depends_on_seed_and_names_only():
    first = named_generator(3, "prediction", "near").random(4)
    named_generator(3, "prediction", "far").random(4)
    assert np.array_equal(named_generator(3, "prediction", "near").random(4), first)
    assert not np.array_equal(named_generator(3, "prediction", "far").random(4), first)
    assert not np.array_equal(named_generator(4, "prediction", "near").random(4), first)


@pytest.mark.parametrize(("population", "sizes"), [(161, (120, 41)), (500, (120, 41)), (30, (30,))])
def test_sets_are_disjoint_distinct_and_in_range(population, sizes):
    sets = distinct_draws(named_generator(1, "x"), population, sizes, 50)
    assert [part.shape for part in sets] == [(50, size) for size in sizes]
    joined = np.sort(np.hstack(sets), axis=1)
    assert (np.diff(joined, axis=1) > 0).all()
    assert joined.min() >= 0
    assert joined.max() < population


def test_every_item_is_as_likely_in_each_set():
    count, population = 20_000, 7
    train, test = distinct_draws(named_generator(1, "x"), population, (3, 2), count)
    for part, share in ((train, 3 / 7), (test, 2 / 7)):
        found = np.bincount(part.ravel(), minlength=population) / count
        assert np.abs(found - share).max() < 5 * np.sqrt(share * (1 - share) / count)


def test_pairs_of_items_are_as_likely_as_in_any_draw_without_replacement():
    count, population = 20_000, 5
    (drawn,) = distinct_draws(named_generator(2, "x"), population, (2,), count)
    found = np.bincount(drawn[:, 0] * population + drawn[:, 1], minlength=population**2) / count
    pairs = [a * population + b for a in range(population) for b in range(a + 1, population)]
    assert found[pairs].sum() == pytest.approx(1)
    assert np.abs(found[pairs] - 0.1).max() < 5 * np.sqrt(0.1 * 0.9 / count)


def test_fewer_draws_are_the_first_of_more():
    more = distinct_draws(named_generator(1, "x"), 20, (5, 3), 40)
    fewer = distinct_draws(named_generator(1, "x"), 20, (5, 3), 7)
    assert all(np.array_equal(a[:7], b) for a, b in zip(more, fewer, strict=True))


def test_more_than_there_are_is_refused():
    with pytest.raises(ValueError, match="161 distinct items from 160"):
        distinct_draws(named_generator(1, "x"), 160, (120, 41), 2)
