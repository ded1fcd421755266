"""Scaled landings of the hopper and of its controls: what decides whether a map is C1."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.truth.scaling import scaling_table
from hopdata.rigid import INPUT_NAMES, OUTPUT_NAMES
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis import simulate_recording
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import (
    UNKNOWN,
    KnownScene,
    common_scene,
    exact_maps,
    known_scene,
    scaling_cases,
    study_landings,
    true_states,
)

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


def known(control):
    return KnownScene("hopper", HopperParameters(), control, np.zeros((3, 3)))


def test_the_study_s_own_control_takes_the_place_of_its_kind():
    cases = scaling_cases(known(Control(coupling=0.4)), **STRENGTHS)
    assert list(cases) == ["hopper", "coupling", "impulse", "delay"]
    assert cases["coupling"].coupling == 0.4
    mixture = Control(coupling=0.4, impulse=0.1)
    assert scaling_cases(known(mixture), **STRENGTHS)["study"] == mixture


def test_the_scene_is_read_from_the_truth():
    swing = {"boom_swing_rad": 0.3, "stiffness_n_m": 88.0}
    options = {"hops": 5, "hopper": swing, "control": {"delay_s": 0.004}}
    truth = simulate_recording(options, seed=1)[1]
    scene = known_scene(truth)
    assert scene.name == "hopper"
    assert scene.scene.stiffness_n_m == 88.0
    assert scene.control == Control(delay_s=0.004)
    assert scene.body_points_m.shape == (3, 3)
    np.testing.assert_array_equal(scene.points_of(["body3"]), scene.body_points_m[2:])
    there, back = scene.scene.by_hop(5)
    assert (there[1].tolist(), back[1].tolist()) == ([0, 2, 4], [1, 3])
    assert back[0].boom_swing_rad == -0.3
    assert back[0].boom_angle_rad == pytest.approx(np.pi + 0.3)


def test_recordings_of_two_scenes_are_no_study(truths):
    other = simulate_recording({"hops": 3, "hopper": {"mass_kg": 2.4}}, seed=1)[1]
    assert common_scene(truths).scene.mass_kg == 2.3
    with pytest.raises(AnalysisError, match="one scene, found 2"):
        common_scene([*truths, other])


# True marker states against a noise-free recording of many frames, and the maps as
# plain data.

CLEAN = {
    "noise_m": 0.0,
    "resolution_m": 0.0,
    "floor": {"bowl_depth_m": 0.0, "waves": 0},
}
RATE_HZ = 1000.0


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["still", "swinging"])
def study(request):
    hopper = {"boom_swing_rad": request.param, "boom_duration_s": 0.1}
    recording, truth = simulate_recording(
        {"hops": 30, "hopper": hopper}, {**CLEAN, "rate_hz": RATE_HZ}, seed=3
    )
    scene = known_scene(truth)
    sections = SectionHeights(0.5, 0.278, scene.points_of(recording.names("body")))
    return recording, truth, sections, true_states(truth, scene, sections)


def test_states_are_those_of_a_recording_without_noise(study):
    recording, truth, sections, states = study
    assert len(states.x) >= 28
    for row, landing in enumerate(states.touchdown - 1):
        begin = np.searchsorted(recording.time, truth.apex_times[landing])
        below = recording.body_height[begin:]
        for found, height in ((states.x, sections.pre_m), (states.y, sections.post_m)):
            k = begin + int(np.argmax(below < height))
            share = (height - recording.body_height[k - 1]) / np.diff(
                recording.body_height[k - 1 : k + 1]
            )
            before, after = recording.body[k - 1], recording.body[k]
            at = before + share * (after - before)
            position, velocity = np.split(found[row], 2)
            np.testing.assert_allclose(position, at.ravel(), rtol=0, atol=3e-5)
            np.testing.assert_allclose(
                velocity, RATE_HZ * (after - before).ravel(), rtol=0, atol=0.05
            )


def test_schedules_and_spreads_are_those_of_the_truth(study):
    _, truth, _, states = study
    instants = truth.contact_times[states.touchdown - 1]
    names = [">".join(str(foot + 1) for foot in np.argsort(row)) for row in instants]
    assert states.schedule.tolist() == names
    np.testing.assert_allclose(states.spread_s, instants.std(axis=1), rtol=0, atol=1e-9)
    assert np.all(np.diff(states.touchdown) > 0)


def test_without_exact_maps_the_reason_is_given(study):
    """A pre section below the contacts: the study goes on without them."""
    _, truth, sections, _ = study
    low = replace(sections, pre_m=sections.post_m + 0.01)
    found = exact_maps([truth], low)
    assert [*found] == [UNKNOWN]
    assert "contact below the pre section" in found[UNKNOWN]


def test_exact_maps_are_plain_data(study):
    _, truth, sections, _ = study
    found = json.loads(json.dumps(exact_maps([truth], sections)))
    assert (
        np.shape(found["maps"])
        == (6, len(OUTPUT_NAMES), len(INPUT_NAMES))
        == (6, 11, 8)
    )
    assert len(found["schedules"]) == len(found["y"]) == 6
    assert np.ptp(found["maps"], axis=0).max() < 1e-12
    np.testing.assert_array_equal(found["body_points_m"], sections.points_m)
