import numpy as np
import pandas as pd
import pytest

from hopdata.errors import ConfigError
from hopdata.maps.prediction import (
    MODELS,
    Population,
    bootstrap_prediction,
    common_split,
    error_ratios,
    large_enough,
    needed_training,
    select_populations,
    split_sizes,
)

SCHEDULES = np.array(["1>2>3", "1>3>2", "2>1>3", "2>3>1", "3>1>2", "3>2>1"])


def study(rng, n=1200, *, difference=0.0, curvature=1.0, noise=0.01):
    """Return landings of six schedules: a linear map, its part that differs, and curvature."""
    labels = rng.integers(0, 6, n)
    spread = rng.uniform(0, 0.03, n)
    x = rng.normal(size=(n, 11)) @ rng.normal(size=(11, 18)) / 4
    shared, own = rng.normal(size=(18, 18)) / 4, rng.normal(size=(6, 18, 18)) / 4
    bend = rng.normal(size=(6, 18))
    y = x @ shared + difference * np.einsum("np,npq->nq", x, own[labels])
    y += curvature * (spread[:, None] / 0.03) ** 2 * bend[labels]
    x, y = x + noise * rng.normal(size=x.shape), y + noise * rng.normal(size=y.shape)
    return x, y, SCHEDULES[labels], spread


def medians(result):
    return dict(zip(result.summary["model"], result.summary["median_mse"], strict=True))


def test_one_map_with_curvature_gives_the_printed_picture():
    result = bootstrap_prediction(
        *study(np.random.default_rng(0)), seed=1, bootstraps=100
    )
    mse = medians(result)
    assert list(mse) == list(MODELS)
    assert mse["near"] < mse["all"] < mse["far"] < 0.5 * mse["mean"]
    assert mse["specialised"] < 0.2 * mse["specialised_mean"]


def test_one_map_without_curvature_makes_all_affine_models_equal():
    data = study(np.random.default_rng(1), curvature=0.0)
    mse = medians(bootstrap_prediction(*data, seed=1, bootstraps=200))
    for model in ("near", "all", "far"):
        assert mse[model] == pytest.approx(mse["specialised"], rel=0.05)


def test_maps_that_differ_are_predicted_by_the_specialised_models_only():
    data = study(np.random.default_rng(2), difference=1.0, curvature=0.0)
    mse = medians(bootstrap_prediction(*data, seed=1, bootstraps=100))
    assert mse["specialised"] < 0.02 * mse["specialised_mean"]
    assert mse["all"] > 20 * mse["specialised"]
    assert mse["near"] > 20 * mse["specialised"]


def test_errors_in_millimetres_and_in_metres_per_second():
    x, y, schedule, spread = study(np.random.default_rng(3), curvature=0.0)
    y = y.copy()
    y[:, 4] += 0.5 * np.random.default_rng(4).normal(size=len(y))
    y[:, 12] += 0.2 * np.random.default_rng(5).normal(size=len(y))
    units = {"length_unit_m": 0.02913, "time_unit_s": 0.027}
    result = bootstrap_prediction(
        x, y, schedule, spread, seed=1, bootstraps=100, **units
    )
    row = result.summary.set_index("model").loc["all"]
    # 0.5 length units of sd in one coordinate; the rms of a split over 41 tests
    # scatters by 11 %.
    errors = result.errors[result.errors["model"] == "all"]
    assert errors["worst_position_mm"].median() == pytest.approx(
        0.5 * 29.13 * 1.1, rel=0.1
    )
    assert errors["worst_velocity_m_s"].median() == pytest.approx(
        0.2 * 1.0789 * 1.1, rel=0.1
    )
    assert row["worst_position_mm"] == np.quantile(errors["worst_position_mm"], 0.975)
    assert (
        errors["mse"] * 2 - errors["mse_position"] - errors["mse_velocity"]
    ).abs().max() < 1e-15
    for kind in ("position", "velocity"):
        interval = [row[f"{kind}_{level}"] for level in ("p2_5", "median", "p97_5")]
        assert (
            interval == np.quantile(errors[f"mse_{kind}"], [0.025, 0.5, 0.975]).tolist()
        )


def test_a_model_does_not_depend_on_which_others_are_there():
    x, y, schedule, spread = study(np.random.default_rng(6))
    whole = bootstrap_prediction(
        x, y, schedule, spread, seed=1, bootstraps=10, minimum_class=5
    )
    order = np.flatnonzero(schedule != "1>2>3")
    part = bootstrap_prediction(
        x[order],
        y[order],
        schedule[order],
        spread[order],
        seed=1,
        bootstraps=10,
        minimum_class=5,
    )
    columns = ["model", "schedule", "bootstrap", "mse"]
    one, two = (
        table.errors.query("model == 'specialised' and schedule == '3>2>1'")[columns]
        for table in (whole, part)
    )
    pd.testing.assert_frame_equal(
        one.reset_index(drop=True), two.reset_index(drop=True)
    )
    again = bootstrap_prediction(
        x, y, schedule, spread, seed=1, bootstraps=10, minimum_class=5
    )
    pd.testing.assert_frame_equal(whole.errors, again.errors)
    other = bootstrap_prediction(
        x, y, schedule, spread, seed=2, bootstraps=10, minimum_class=5
    )
    assert (other.errors["mse"] != whole.errors["mse"]).all()


def test_arrays_that_do_not_match_are_refused():
    x, y, schedule, spread = study(np.random.default_rng(6), n=100)
    for wrong in (
        (x, y, schedule[:10], spread),
        (x, y, schedule, spread[:10]),
        (x, y[:10]),
    ):
        with pytest.raises(
            ValueError, match=r"expected .* of one length, found .*\(10,"
        ):
            bootstrap_prediction(*wrong, *(schedule, spread)[len(wrong) - 2 :], seed=1)
    x[3, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        bootstrap_prediction(x, y, schedule, spread, seed=1)


def test_a_small_class_is_named_and_left_out():
    x, y, schedule, spread = study(np.random.default_rng(7))
    keep = np.r_[
        np.flatnonzero(schedule != "2>1>3"), np.flatnonzero(schedule == "2>1>3")[:5]
    ]
    result = bootstrap_prediction(
        x[keep], y[keep], schedule[keep], spread[keep], seed=1, bootstraps=10
    )
    assert result.summary.set_index("model").loc["specialised", "n_classes"] == 5
    assert "2>1>3" not in set(result.errors["schedule"])
    assert {
        "what": "specialised models of schedule 2>1>3",
        "reason": "5 touchdowns, at least 40 wanted",
    } in result.notes


def test_splits_are_scaled_alike_for_all_models():
    x, y, schedule, spread = study(np.random.default_rng(8), n=480)
    result = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=10)
    smallest = min(np.unique(schedule, return_counts=True)[1])
    assert (result.errors["n_train"] + result.errors["n_test"] == smallest).all()
    assert any("instead of 120 and 41" in note["what"] for note in result.notes)


def test_thirty_nine_landings_give_what_they_can():
    x, y, schedule, spread = study(np.random.default_rng(9), n=39)
    result = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=20)
    assert result.summary["model"].tolist() == ["all", "mean"]
    assert result.summary[["n_train", "n_test"]].to_numpy().tolist() == [[29, 10]] * 2
    assert {note["what"] for note in result.notes} >= {
        "specialised models",
        "affine (near)",
        "affine (far)",
    }
    assert np.isfinite(result.summary.select_dtypes("number").to_numpy()).all()


@pytest.mark.parametrize(
    ("n", "models"), [(0, []), (1, []), (2, ["mean"]), (12, ["mean"])]
)
def test_almost_no_landings_do_not_crash(n, models):
    x, y, schedule, spread = (
        part[:n] for part in study(np.random.default_rng(10), n=40)
    )
    result = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=5)
    assert result.summary["model"].tolist() == models
    assert "affine (all)" in {note["what"] for note in result.notes}


def test_constant_columns_and_duplicates_are_harmless():
    x, y, schedule, spread = study(np.random.default_rng(11), n=600)
    x[:, 3], y[:, 3] = 0.499, 0.288
    data = [np.concatenate([part, part]) for part in (x, y, schedule, spread)]
    result = bootstrap_prediction(*data, seed=1, bootstraps=10)
    assert len(result.summary) == 6
    assert np.isfinite(result.errors["mse"]).all()


def test_ratios_are_those_of_the_medians_and_of_touchdowns_used():
    summary = pd.DataFrame(
        {"model": list(MODELS), "median_mse": [4.0, 1.0, 6.0, 9.0, 80.0, 90.0]}
    ).assign(worst_position_mm=1.5, worst_velocity_m_s=0.1)
    order = dict(zip(MODELS, summary["median_mse"], strict=True))
    touchdowns = pd.DataFrame(
        {
            "spread_s": [0.010, 0.012, 0.014, np.nan],
            "excluded": [False, False, False, True],
        }
    )
    found = error_ratios(summary, touchdowns)
    assert found["spread_ms"] == pytest.approx(12.0)
    assert found["all_over_specialised"] == order["all"] / order["specialised"]
    assert (
        found["specialised_over_mean"]
        == order["specialised"] / order["specialised_mean"]
    )
    without = error_ratios(summary[summary["model"] != "specialised_mean"], touchdowns)
    assert np.isnan(without["specialised_over_mean"])
    assert without["near"] == found["near"]


def test_near_and_far_are_below_and_above_the_median_of_all():
    schedule = np.array(["1>2", "2>1", "1>2", "", "1>2"])
    spread = np.array([1.0, 2.0, 3.0, 4.0, np.nan])
    populations, notes = select_populations(schedule, spread, 2)
    rows = {item.name: item.rows.tolist() for item in populations}
    assert rows == {
        "schedule 1>2": [0, 2, 4],
        "near": [0, 1],
        "all": [0, 1, 2, 3, 4],
        "far": [2, 3],
    }
    assert notes == [
        {
            "what": "specialised models of schedule 2>1",
            "reason": "1 touchdowns, at least 2 wanted",
        }
    ]


def test_no_class_is_said_once_more_for_all():
    _, notes = select_populations(np.array(["", ""]), np.array([np.nan, np.nan]), 40)
    assert notes == [
        {"what": "specialised models", "reason": "no mode schedule has 40 touchdowns"}
    ]


@pytest.mark.parametrize(
    ("population", "expected"),
    [
        (2860, (120, 41)),
        (161, (120, 41)),
        (160, (119, 41)),
        (40, (30, 10)),
        (2, (1, 1)),
    ],
)
def test_splits_scale_down_in_proportion(population, expected):
    assert split_sizes(population, 120, 41) == expected


def test_needed_training_counts_independent_inputs():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 4)) @ rng.normal(size=(4, 9))
    assert needed_training(x) == 4 + 1 + 2
    assert needed_training(rng.normal(size=(50, 9))) == 9 + 1 + 2
    assert needed_training(np.empty((0, 9))) == 3


def test_the_smallest_kept_population_decides_the_split():
    schedule = np.array(["1>2"] * 100 + ["2>1"] * 300)
    populations, _ = select_populations(schedule, np.arange(400.0), 40)
    kept, notes = large_enough(populations, 120, 41, 12)
    assert kept == populations
    assert notes == []
    sizes, scaled = common_split(kept, 120, 41)
    assert sizes == split_sizes(100, 120, 41)
    assert scaled[0] == {
        "what": "All models were trained on 75 and tested on 25 touchdowns instead of 120 and 41",
        "reason": "the rarest order with a model of its own, 1>2, has only 100",
    }
    assert common_split(kept[1:], 120, 41) == ((120, 41), [])
    assert common_split([], 120, 41) == ((120, 41), [])


@pytest.mark.parametrize(
    ("kind", "words"), [("near", "30 near touchdowns"), ("all", "30 touch")]
)
def test_a_split_without_classes_says_how_few_touchdowns_there_are(kind, words):
    (note,) = common_split([Population(kind, "", np.arange(30))], 120, 41)[1]
    assert f"there are only {words}" in note["reason"]


def test_what_is_too_small_does_not_shrink_the_others():
    schedule = np.array(["1>2"] * 10 + ["2>1"] * 29)
    populations, _ = select_populations(schedule, np.arange(39.0), 5)
    kept, notes = large_enough(populations, 120, 41, 20)
    assert [item.name for item in kept] == ["schedule 2>1", "all"]
    kinds = ["affine models of schedule 1>2", "affine (near)", "affine (far)"]
    assert [note["what"] for note in notes] == kinds
    assert common_split(kept, 120, 41)[0] == split_sizes(29, 120, 41)


def test_many_thin_classes_are_counted_together():
    schedule = np.repeat([f"{k}" for k in range(9)], np.arange(20, 29))
    populations, notes = select_populations(
        schedule, np.arange(len(schedule)) * 1.0, 15
    )
    assert notes == []
    kept, notes = large_enough(populations, 120, 41, 26)
    assert [item.name for item in kept] == ["near", "all", "far"]
    assert notes == [
        {
            "what": "affine models of 9 schedules",
            "reason": "15 to 21 touchdowns each, 161 in all, left to fit: an affine "
            "map of these inputs needs 26",
        }
    ]


@pytest.mark.parametrize("name", ["bootstraps", "train", "test"])
@pytest.mark.parametrize("wrong", [0, -1, 1.5])
def test_numbers_below_one_are_refused(name, wrong):
    data = study(np.random.default_rng(6), n=100)
    words = f"^prediction.{name}: expected a whole number, 1 or more, found {wrong}$"
    with pytest.raises(ConfigError, match=words):
        bootstrap_prediction(*data, seed=1, **{name: wrong})


@pytest.mark.parametrize("name", ["bootstraps", "train", "test"])
def test_a_number_of_one_is_enough(name):
    data = study(np.random.default_rng(6), n=100)
    found = bootstrap_prediction(*data, seed=1, **{"bootstraps": 3, name: 1})
    assert "mean" in set(found.summary["model"])
