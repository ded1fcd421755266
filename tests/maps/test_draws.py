import numpy as np
import pytest
from made_up_landings import sklearn_errors

from hopdata.errors import AnalysisError
from hopdata.maps.affine import affine_test_errors
from hopdata.maps.draws import (
    MOST_ONE_BY_ONE,
    distinct_draws,
    draws_together,
    named_generator,
    rare_notes,
    resampled_draws,
)
from hopdata.maps.prediction import bootstrap_prediction
from hopdata.maps.subspaces import bootstrap_subspaces, measure_distances


def test_a_named_stream_depends_on_seed_and_names_only():
    first = named_generator(3, "prediction", "near").random(4)
    named_generator(3, "prediction", "far").random(4)
    assert np.array_equal(named_generator(3, "prediction", "near").random(4), first)
    assert not np.array_equal(named_generator(3, "prediction", "far").random(4), first)
    assert not np.array_equal(named_generator(4, "prediction", "near").random(4), first)


@pytest.mark.parametrize(
    ("population", "sizes"), [(161, (120, 41)), (500, (120, 41)), (30, (30,))]
)
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
    found = (
        np.bincount(drawn[:, 0] * population + drawn[:, 1], minlength=population**2)
        / count
    )
    pairs = [
        a * population + b for a in range(population) for b in range(a + 1, population)
    ]
    assert found[pairs].sum() == pytest.approx(1)
    assert np.abs(found[pairs] - 0.1).max() < 5 * np.sqrt(0.1 * 0.9 / count)


def test_fewer_draws_are_the_first_of_more():
    more = distinct_draws(named_generator(1, "x"), 20, (5, 3), 40)
    fewer = distinct_draws(named_generator(1, "x"), 20, (5, 3), 7)
    assert all(np.array_equal(a[:7], b) for a, b in zip(more, fewer, strict=True))


def test_more_than_there_are_is_refused():
    with pytest.raises(ValueError, match="high"):
        distinct_draws(named_generator(1, "x"), 160, (120, 41), 2)


# A few schedules with too few landings are named; many are counted.


def test_a_few_are_named():
    sizes = {f"{k}": 10 + k for k in range(MOST_ONE_BY_ONE)}
    notes = rare_notes("subspaces", sizes, "30 wanted")
    assert [note["what"] for note in notes] == [
        f"subspaces of schedule {name}" for name in sizes
    ]
    assert notes[1]["reason"] == "11 touchdowns, 30 wanted"
    assert rare_notes("subspaces", {}, "30 wanted") == []


def test_many_are_counted():
    sizes = {f"{k}": 1 + k % 3 for k in range(300)}
    assert rare_notes("specialised models", sizes, "at least 40 wanted") == [
        {
            "what": "specialised models of 300 schedules",
            "reason": "1 to 3 touchdowns each, 600 in all, at least 40 wanted",
        }
    ]


# Awkward data in the statistics: the right answer, or a clear refusal.

SCHEDULES = np.array(["1>2>3", "1>3>2", "2>1>3", "2>3>1", "3>1>2", "3>2>1"])


def study(seed, sizes=(90,) * 6, latent=11, noise=0.01):
    """Return landings of classes of these sizes, with few true dimensions, and their spread."""
    rng = np.random.default_rng(seed)
    schedule = np.repeat(SCHEDULES[: len(sizes)], sizes)
    x = rng.normal(size=(len(schedule), latent)) @ rng.normal(size=(latent, 18))
    y = x @ rng.normal(size=(18, 18)) / 4
    x, y = x + noise * rng.normal(size=x.shape), y + noise * rng.normal(size=y.shape)
    return x, y, schedule, rng.uniform(0, 0.03, len(x))


def predict(x, y, schedule, spread):
    return bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=20)


def test_duplicate_touchdowns_predict_as_the_library_does():
    x, y = (np.repeat(part, 3, axis=0) for part in study(0, (40,))[:2])
    train, test = distinct_draws(named_generator(1, "s"), 120, (60, 30), 5)
    expected = sklearn_errors(x, y, train, test)
    np.testing.assert_allclose(
        affine_test_errors(x, y, train, test), expected, rtol=1e-9
    )


def test_a_class_of_copies_has_no_subspaces_and_says_so():
    x, y, schedule, _ = study(1, (60, 60))
    x[:60], y[:60] = np.repeat(x[:6], 10, axis=0), np.repeat(y[:6], 10, axis=0)
    found = bootstrap_subspaces(x, y, schedule, seed=1, bootstraps=10)
    assert list(found.bases) == ["1>3>2"]
    assert found.notes[0]["reason"] == "10 of 10 draws have fewer than 17 components"


def test_a_missing_class_leaves_the_others_as_they_were():
    x, y, schedule, spread = study(2)
    part = schedule != "2>1>3"
    whole = predict(x, y, schedule, spread).errors
    fewer = np.where(part, schedule, "")  # these landings have no schedule
    less = predict(x, y, fewer, spread).errors
    same = [
        table[(table["model"] == "specialised") & (table["schedule"] == "3>2>1")][
            "mse"
        ].to_numpy()
        for table in (whole, less)
    ]
    assert np.array_equal(*same)
    assert set(less["schedule"]) - {""} == set(SCHEDULES) - {"2>1>3"}
    bases = bootstrap_subspaces(x, y, fewer, seed=1, bootstraps=6).bases
    table = measure_distances(bases, (34, 17), seed=1, pairs=36).summary
    assert table.set_index("kind").loc["cross_class", "n"] == 10 * 36


def test_a_class_of_five_is_left_out_by_name():
    x, y, schedule, spread = study(3, (90, 5))
    assert "1>3>2" not in set(predict(x, y, schedule, spread).errors["schedule"])
    notes = predict(x, y, schedule, spread).notes
    assert any(
        note["what"].endswith("1>3>2") and "5 touchdowns" in note["reason"]
        for note in notes
    )
    found = bootstrap_subspaces(x, y, schedule, seed=1, bootstraps=4)
    assert list(found.bases) == ["1>2>3"]
    assert "5 touchdowns, 30 distinct ones wanted" in found.notes[0]["reason"]


def test_constant_columns_change_no_prediction_and_no_distance():
    x, y, schedule, spread = study(4)
    still = x.copy(), y.copy()
    still[0][:, 5], still[1][:, 5] = 0.0, 0.0
    moved = (
        still[0] + 0.499 * (np.arange(18) == 5),
        still[1] - 7.25 * (np.arange(18) == 5),
    )
    errors = [
        predict(*pair, schedule, spread).errors["mse"].to_numpy()
        for pair in (still, moved)
    ]
    np.testing.assert_allclose(*errors, rtol=1e-9)
    tables = []
    for pair in (still, moved):
        bases = bootstrap_subspaces(*pair, schedule, seed=1, bootstraps=5).bases
        tables.append(
            measure_distances(bases, (34, 17), seed=1, pairs=4).distances[
                "distance_rad"
            ]
        )
    np.testing.assert_allclose(*tables, atol=1e-9)


@pytest.mark.parametrize("condition", [1e4, 1e10])
def test_units_that_differ_by_the_condition_number_change_no_prediction(condition):
    x, y, schedule, spread = study(5)
    scaled = x * np.geomspace(1, 1 / condition, 18)
    errors = [
        predict(inputs, y, schedule, spread).errors["mse"] for inputs in (x, scaled)
    ]
    np.testing.assert_allclose(*errors, rtol=1e-9)


def test_single_precision_is_computed_in_double():
    x, y, schedule, spread = study(6, (60, 60))
    single = x.astype(np.float32), y.astype(np.float32)
    double = single[0].astype(float), single[1].astype(float)
    errors = [
        predict(*pair, schedule, spread).errors["mse"] for pair in (single, double)
    ]
    assert np.array_equal(*errors)
    bases = [
        bootstrap_subspaces(*pair, schedule, seed=1, bootstraps=5).bases["1>2>3"]
        for pair in (single, double)
    ]
    assert np.array_equal(*bases)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(value):
    x, y, schedule, spread = study(7, (60, 60))
    y[17, 3] = value
    with pytest.raises(ValueError, match="finite"):
        predict(x, y, schedule, spread)
    with pytest.raises(AnalysisError, match="found 1 others, the first in row 17"):
        bootstrap_subspaces(x, y, schedule, seed=1, bootstraps=5)


def test_no_true_motion_but_noise_and_none_at_all():
    rng = np.random.default_rng(8)
    noise = rng.normal(size=(2, 120, 18))
    schedule, spread = np.repeat(SCHEDULES[:2], 60), np.linspace(0, 0.03, 120)
    table = predict(*noise, schedule, spread).summary.set_index("model")
    assert (
        1.0 < table.loc["specialised", "median_mse"] < 4.0
    )  # a fit to noise is worse than none
    still = np.zeros((120, 18))
    assert (predict(still, still, schedule, spread).errors["mse"] == 0).all()
    found = bootstrap_subspaces(still, still, schedule, seed=1, bootstraps=5)
    assert not found.bases
    assert len(found.notes) == 2


def test_resampled_sets_repeat_items_but_share_none():
    fitted, tested = resampled_draws(named_generator(1, "x"), 161, (120, 41), 50)
    assert fitted.shape == (50, 120)
    assert tested.shape == (50, 41)
    repeats = [len(np.unique(row)) for row in fitted]
    # Of 120 items drawn 120 times with replacement 1 - 1/e are expected to occur.
    assert np.mean(repeats) == pytest.approx(120 * (1 - np.exp(-1)), rel=0.03)
    for one, other in zip(fitted, tested, strict=True):
        assert not set(one) & set(other)


def test_sets_drawn_together_share_items():
    fitted, tested = draws_together(named_generator(1, "x"), 161, (120, 41), 50)
    shared = [np.isin(row, fitted[i]).mean() for i, row in enumerate(tested)]
    # A test item is missing from the training set with (1 - 1/161)^120.
    assert np.mean(shared) == pytest.approx(1 - (1 - 1 / 161) ** 120, rel=0.05)


def test_every_item_is_as_likely_in_each_resampled_set():
    sets = resampled_draws(named_generator(2, "x"), 12, (6, 3), 4000)
    for drawn in sets:
        share = np.bincount(drawn.ravel(), minlength=12) / drawn.size
        assert np.abs(share - 1 / 12).max() < 0.008


def test_too_few_items_for_two_parts_are_refused():
    with pytest.raises(ValueError, match="1 items do not suffice for 2 parts"):
        resampled_draws(named_generator(1, "x"), 1, (120, 41), 2)
