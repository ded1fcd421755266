"""Scaled landings of the hopper and of its controls: what decides whether a map is C1."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.truth.scaling import scaling_table
from hopdata.scenes.hopper_control import HopperControl
from hopdata.synthesis import simulate_recording
from hopdata.synthesis.known_scene import common_scene, known_scene
from hopdata.synthesis.scaling import scaling_cases, study_landings

STRENGTHS = {"coupling": 0.2, "impulse": 0.3, "delay_s": 0.01}
HEIGHTS = {"pre_m": 0.5, "post_m": 0.28, "body": ("body1", "body2", "body3")}


@pytest.fixture(scope="module")
def truths():
    return [simulate_recording({"hops": 200}, seed=(5, k))[1] for k in range(2)]


@pytest.fixture(scope="module")
def table(truths):
    return scaling_table(study_landings(truths, **HEIGHTS, landings=400))


def test_one_map_serves_the_hopper_and_no_control(table):
    slope = table.groupby("case")["slope"].first()
    assert slope["hopper"] == pytest.approx(2.0, abs=0.15)
    assert slope[["coupling", "impulse", "delay"]].max() <= 1.4
    last = table[table["scale"] == table["scale"].min()].set_index("case")
    assert last.loc["hopper", "pooled_over_specialised"] < 15
    assert last.drop("hopper")["pooled_over_specialised"].min() > 50


def test_fitted_maps_come_to_the_exact_ones(table):
    last = table[table["scale"] == table["scale"].min()].set_index("case")
    assert last.loc["hopper", "exact_difference"] < 1e-12
    assert last.loc["hopper", "map_difference"] < 0.15
    for case in ("coupling", "impulse", "delay"):
        fitted, exact = last.loc[case, ["map_difference", "exact_difference"]]
        assert fitted == pytest.approx(exact, rel=0.25)
    tenth = table[(table["case"] == "hopper") & (table["scale"] == 0.125)]
    assert tenth["map_error"].item() < 0.04


def test_the_spread_of_the_contacts_is_scaled(table):
    hopper = table[table["case"] == "hopper"]
    per_scale = hopper["spread_ms"] / hopper["scale"]
    assert per_scale.max() / per_scale.min() < 1.15
    assert hopper["spread_ms"].iloc[0] > 8


def test_a_case_that_does_not_sink_to_the_section_has_no_landings(truths):
    heights = {**HEIGHTS, "post_m": 0.245}
    strong = {"coupling": 0.2, "impulse": 0.6, "delay_s": 0.01}
    found = scaling_table(
        study_landings(truths[:1], **heights, **strong, scales=(0.5, 0.25))
    ).set_index("case")
    assert (found.loc["impulse", "landings"] == 0).all()
    assert (found.loc["impulse", "failed"] == 200).all()
    assert (found.loc["hopper", "landings"] > 150).all()


def test_the_study_s_own_control_takes_the_place_of_its_kind():
    cases = scaling_cases(HopperControl(coupling=0.4), **STRENGTHS)
    assert list(cases) == ["hopper", "coupling", "impulse", "delay"]
    assert cases["coupling"].coupling == 0.4
    mixture = HopperControl(coupling=0.4, impulse=0.1)
    assert scaling_cases(mixture, **STRENGTHS)["study"] == mixture


def test_the_scene_is_read_from_the_truth():
    swing = {"boom_swing_rad": 0.3, "stiffness_n_m": 88.0}
    options = {"hops": 5, "hopper": swing, "control": {"delay_s": 0.004}}
    truth = simulate_recording(options, seed=1)[1]
    scene = known_scene(truth)
    assert scene.hopper.stiffness_n_m == 88.0
    assert scene.control == HopperControl(delay_s=0.004)
    assert scene.body_points_m.shape == (3, 3)
    np.testing.assert_array_equal(scene.points_of(["body3"]), scene.body_points_m[2:])
    there, back = scene.by_boom(5)
    assert (there[1].tolist(), back[1].tolist()) == ([0, 2, 4], [1, 3])
    assert back[0].boom_swing_rad == -0.3
    assert back[0].boom_angle_rad == pytest.approx(np.pi + 0.3)


def test_recordings_of_two_scenes_are_no_study(truths):
    other = simulate_recording({"hops": 3, "hopper": {"mass_kg": 2.4}}, seed=1)[1]
    assert common_scene(truths).hopper.mass_kg == 2.3
    with pytest.raises(AnalysisError, match="one scene, found 2"):
        common_scene([*truths, other])
