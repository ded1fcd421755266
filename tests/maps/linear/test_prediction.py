import numpy as np
import pandas as pd
import pytest

from hopdata.maps.linear.prediction import MODELS, bootstrap_prediction, error_ratios

SCHEDULES = np.array(["1>2>3", "1>3>2", "2>1>3", "2>3>1", "3>1>2", "3>2>1"])


def study(rng, n=1200, *, difference=0.0, curvature=1.0, noise=0.01):
    """Landings of six schedules: one linear map, its part that differs, and curvature."""
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
    return dict(zip(result.summary["model"], result.summary["median"], strict=True))


def test_one_map_with_curvature_gives_the_printed_picture():
    result = bootstrap_prediction(*study(np.random.default_rng(0)), seed=1, bootstraps=100)
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
    result = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=100, **units)
    row = result.summary.set_index("model").loc["all"]
    # 0.5 length units of sd in one coordinate; a split's rms over 41 tests scatters by 11 %.
    errors = result.errors[result.errors["model"] == "all"]
    assert errors["worst_position_mm"].median() == pytest.approx(0.5 * 29.13 * 1.1, rel=0.1)
    assert errors["worst_velocity_m_s"].median() == pytest.approx(0.2 * 1.0789 * 1.1, rel=0.1)
    assert row["worst_position_mm"] == np.quantile(errors["worst_position_mm"], 0.975)
    assert (errors["mse"] * 2 - errors["mse_position"] - errors["mse_velocity"]).abs().max() < 1e-15
    for kind in ("position", "velocity"):
        interval = [row[f"{kind}_{level}"] for level in ("p2_5", "median", "p97_5")]
        assert interval == np.quantile(errors[f"mse_{kind}"], [0.025, 0.5, 0.975]).tolist()


def test_a_model_does_not_depend_on_which_others_are_there():
    x, y, schedule, spread = study(np.random.default_rng(6))
    whole = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=10, minimum_class=5)
    order = np.flatnonzero(schedule != "1>2>3")
    part = bootstrap_prediction(
        x[order], y[order], schedule[order], spread[order], seed=1, bootstraps=10, minimum_class=5
    )
    columns = ["model", "schedule", "bootstrap", "mse"]
    one, two = (
        table.errors.query("model == 'specialised' and schedule == '3>2>1'")[columns]
        for table in (whole, part)
    )
    pd.testing.assert_frame_equal(one.reset_index(drop=True), two.reset_index(drop=True))
    again = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=10, minimum_class=5)
    pd.testing.assert_frame_equal(whole.errors, again.errors)
    other = bootstrap_prediction(x, y, schedule, spread, seed=2, bootstraps=10, minimum_class=5)
    assert (other.errors["mse"] != whole.errors["mse"]).all()


def test_a_small_class_is_named_and_left_out():
    x, y, schedule, spread = study(np.random.default_rng(7))
    keep = np.r_[np.flatnonzero(schedule != "2>1>3"), np.flatnonzero(schedule == "2>1>3")[:5]]
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
    assert {note["what"] for note in result.notes} >= {"specialised models", "near", "far"}
    assert np.isfinite(result.summary.select_dtypes("number").to_numpy()).all()


@pytest.mark.parametrize(("n", "models"), [(0, []), (1, []), (2, ["mean"]), (12, ["mean"])])
def test_almost_no_landings_do_not_crash(n, models):
    x, y, schedule, spread = (part[:n] for part in study(np.random.default_rng(10), n=40))
    result = bootstrap_prediction(x, y, schedule, spread, seed=1, bootstraps=5)
    assert result.summary["model"].tolist() == models
    assert "affine model of all touchdowns" in {note["what"] for note in result.notes}


def test_constant_columns_and_duplicates_are_harmless():
    x, y, schedule, spread = study(np.random.default_rng(11), n=600)
    x[:, 3], y[:, 3] = 0.499, 0.288
    data = [np.concatenate([part, part]) for part in (x, y, schedule, spread)]
    result = bootstrap_prediction(*data, seed=1, bootstraps=10)
    assert len(result.summary) == 6
    assert np.isfinite(result.errors["mse"]).all()


def test_ratios_are_those_of_the_medians_and_of_touchdowns_used():
    summary = pd.DataFrame(
        {"model": list(MODELS), "median": [4.0, 1.0, 6.0, 9.0, 80.0, 90.0]}
    ).assign(worst_position_mm=1.5, worst_velocity_m_s=0.1)
    order = dict(zip(MODELS, summary["median"], strict=True))
    touchdowns = pd.DataFrame(
        {"spread_s": [0.010, 0.012, 0.014, np.nan], "excluded": [False, False, False, True]}
    )
    found = error_ratios(summary, touchdowns)
    assert found["spread_ms"] == pytest.approx(12.0)
    assert found["all_over_specialised"] == order["all"] / order["specialised"]
    assert found["specialised_over_mean"] == order["specialised"] / order["specialised_mean"]
    without = error_ratios(summary[summary["model"] != "specialised_mean"], touchdowns)
    assert np.isnan(without["specialised_over_mean"])
    assert without["near"] == found["near"]
