"""Scores: checked by hand, reproducible by seed, better with more hops."""

from dataclasses import replace

import numpy as np
import pytest
from steered_hops import LIMIT, chained_hops, walked_strides

from hopdata.steering.models.learning import (
    COLUMNS,
    PRINTED_MAP_RAD,
    READINGS,
    SMOOTH_NOISE,
    learning_scores,
    map_table,
    prediction_score,
    printed_map_table,
    random_split,
    smooth_truth,
    smoothness_scores,
    trained_and_scored,
    training_table,
    with_intervals,
)
from hopdata.steering.models.training import PRINTED, RECOMMENDED, trained_process

NOISE = np.array([3e-3, 3e-3, 2e-2])


def test_scores_are_right_by_hand():
    process = trained_process(chained_hops(30, noise=NOISE))
    test = chained_hops(50, seed=3, noise=NOISE)
    score = prediction_score(process, test)
    error = process.change(test.boom_angle_rad, test.swing_rad) - test.change
    assert score.rmse[0] == pytest.approx(1000 * np.sqrt(np.mean(error[:, 0] ** 2)))
    assert score.rmse[2] == pytest.approx(
        np.degrees(np.sqrt(np.mean(error[:, 2] ** 2)))
    )
    spread = np.sum((test.change[:, 1] - test.change[:, 1].mean()) ** 2)
    assert score.r2[1] == pytest.approx(1 - np.sum(error[:, 1] ** 2) / spread)


def test_intervals_of_predictions_hold_what_they_should():
    process = trained_process(chained_hops(150, noise=NOISE))
    coverage = prediction_score(
        process, chained_hops(600, seed=3, noise=NOISE)
    ).coverage
    assert np.all(np.abs(coverage - 0.95) < 0.05)


def test_the_learning_curve_falls_and_is_the_same_again():
    hops = chained_hops(150, noise=NOISE)
    options = {"recommended": RECOMMENDED, "printed": PRINTED}
    scores = learning_scores(hops, options, [15, 60], draws=3, seed=1)
    assert len(scores) == 2 * 3 * 2 * 3
    again = learning_scores(hops, options, [15, 60], draws=3, seed=1)
    assert scores.equals(again)
    table = with_intervals(scores, ["model", "component", "hops"], ["rmse", "r2"])
    assert set(table["draws"]) == {3}
    for _, part in table.groupby(["model", "component"]):
        few, many = part.sort_values("hops")["rmse"]
        assert many < few
    one = scores[(scores["model"] == "recommended") & (scores["component"] == "dx")]
    one = one[one["hops"] == 15]["rmse"]
    row = table[(table["model"] == "recommended") & (table["component"] == "dx")].iloc[
        0
    ]
    assert row["rmse"] == pytest.approx(one.mean())
    assert row["rmse_se"] == pytest.approx(one.std(ddof=1) / np.sqrt(3))


def test_splits_share_nothing():
    train, test = random_split(20, 12, np.random.default_rng(0))
    assert sorted([*train, *test]) == list(range(20))


def test_standardised_processes_of_every_smoothness_learn_a_smooth_truth():
    hops = smooth_truth(160, LIMIT, 0)
    readings = {name: READINGS[name] for name in ("standardised, all fitted",)}
    scores = smoothness_scores(hops, draws=1, seed=0, readings=readings)
    assert scores["smoothness"].nunique() == 4
    assert scores["r2"].min() > 0.97


def test_units_that_are_not_standardised_break_the_c2_kernel_on_a_smooth_truth():
    """The claim of Section 3.4.2 appears if nothing but the units is wrong."""
    name = "printed, length and noise fitted, m"
    hops = smooth_truth(160, LIMIT, 0)
    scores = smoothness_scores(hops, draws=1, seed=0, readings={name: READINGS[name]})
    r2 = scores.pivot_table(index="smoothness", columns="component", values="r2")
    assert r2.loc[1.5, "dx"] > 0.95
    assert r2.loc[2.5, "dx"] < 0.5


def test_the_smooth_truth_has_the_noise_it_says():
    a = smooth_truth(4000, LIMIT, 0)
    assert a.change.tobytes() == smooth_truth(4000, LIMIT, 0).change.tobytes()
    assert SMOOTH_NOISE.max() < 0.05 * a.change.std(axis=0).max()


def test_the_printed_reading_is_the_printed_set_up():
    assert READINGS["printed, all fixed"] is PRINTED


# Tables of maps: three angles, in mm and degrees, with the hops that they come from.

HOPS = chained_hops(40, noise=np.array([2e-3, 2e-3, 1e-2]))


def test_the_map_is_the_process_over_three_turns():
    process = trained_process(HOPS)
    table = map_table(process, LIMIT, swings=5)
    assert table["boom_angle_rad"].agg(["min", "max"]).tolist() == [
        -2 * np.pi,
        4 * np.pi,
    ]
    assert table["swing_rad"].agg(["min", "max"]).tolist() == [-LIMIT, LIMIT]
    inputs = table[["boom_angle_rad", "swing_rad"]].to_numpy().T
    change, sd = process.change(*inputs), process.sd(*inputs)
    np.testing.assert_allclose(table["dy_mm"], 1000 * change[:, 1], atol=1e-9)
    np.testing.assert_allclose(table["dtheta_deg"], np.degrees(change[:, 2]), atol=1e-9)
    np.testing.assert_allclose(table["dx_mm_sd"], 1000 * sd[:, 0], atol=1e-9)


def test_a_process_that_is_not_periodic_shows_it():
    table = map_table(trained_process(HOPS, PRINTED), LIMIT, swings=3)
    rows = table[np.isclose(table["swing_rad"], 0)].set_index("boom_angle_rad")
    last, first = rows["dx_mm"].iloc[-1], rows["dx_mm"].iloc[0]
    assert abs(last - first) > 1


def test_training_hops_stand_there_once():
    for options in (PRINTED, RECOMMENDED):
        table = training_table(trained_process(HOPS, options))
        assert len(table) == len(HOPS)
        np.testing.assert_allclose(
            table[list(COLUMNS)].iloc[0, 0], 1000 * HOPS.change[0, 0]
        )


@pytest.mark.parametrize("learned_by", [RECOMMENDED, PRINTED], ids=["ours", "printed"])
def test_the_printed_map_is_of_the_printed_model_on_the_same_hops(learned_by):
    hops = chained_hops(30, noise=NOISE)
    table = printed_map_table(trained_process(hops, learned_by))
    own = map_table(trained_process(hops, PRINTED), PRINTED_MAP_RAD)
    np.testing.assert_allclose(table[list(COLUMNS)], own[list(COLUMNS)], atol=1e-9)
    assert table["swing_rad"].abs().max() == pytest.approx(np.pi / 4)
    assert table["boom_angle_rad"].min() == pytest.approx(-2 * np.pi)
    assert table["boom_angle_rad"].max() == pytest.approx(4 * np.pi)
    other = map_table(trained_process(hops, RECOMMENDED), PRINTED_MAP_RAD)
    assert not np.allclose(table["dx_mm"], other["dx_mm"], atol=0.1)


def test_only_the_smoothnesses_that_are_asked_for_are_scored():
    scores = smoothness_scores(
        chained_hops(40, noise=NOISE),
        train=20,
        draws=1,
        seed=1,
        readings={"printed": PRINTED},
        smoothnesses=(1.5, 2.5),
    )
    assert sorted(scores["smoothness"].unique()) == [1.5, 2.5]
    assert set(scores["reading"]) == {"printed"}


def test_next_states_that_are_learned_are_scored_beside_the_pose():
    options = replace(RECOMMENDED, restarts=0)
    walked = walked_strides(160)
    train, test = np.arange(110), np.arange(110, 160)
    _, score = trained_and_scored(walked, train, test, options, 0)
    assert score["component"].tolist() == ["dx", "dy", "dtheta", "gait", "speed"]
    assert score["unit"].tolist() == ["mm", "mm", "deg", "rad", "m_s"]
    assert score["r2"].min() > 0.9
    # What follows from nothing is not foretold.
    rng = np.random.default_rng(1)
    drawn = walked.next_state.copy()
    drawn[:, 2] = rng.permutation(drawn[:, 2])
    _, score = trained_and_scored(
        replace(walked, next_state=drawn), train, test, options, 0
    )
    r2 = score.set_index("component")["r2"]
    assert r2["speed"] < 0.2 < r2["gait"]
