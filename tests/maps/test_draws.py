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


def test_chunks_do_not_show(monkeypatch):
    whole = distinct_draws(named_generator(1, "x"), 20, (5, 3), 40)
    monkeypatch.setattr("hopdata.maps.draws._CHUNK_BYTES", 8 * 20 * 7)
    parts = distinct_draws(named_generator(1, "x"), 20, (5, 3), 40)
    assert all(np.array_equal(a, b) for a, b in zip(whole, parts, strict=True))


def test_more_than_there_are_is_refused():
    with pytest.raises(ValueError, match="161 distinct items from 160"):
        distinct_draws(named_generator(1, "x"), 160, (120, 41), 2)
