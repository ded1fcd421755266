"""A whole synthetic recording against its own truth."""

import json

import numpy as np
import pytest

from hopdata.errors import HopdataError
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis import simulate_recording

CLEAN = {
    "noise_m": 0.0,
    "resolution_m": 0.0,
    "floor": {"bowl_depth_m": 0.0, "waves": 0},
}


@pytest.fixture(scope="module")
def simulated():
    return simulate_recording({"hops": 40}, seed=5)


@pytest.fixture(scope="module")
def clean():
    return simulate_recording({"hops": 40}, {**CLEAN, "rate_hz": 500}, seed=5)


def test_shapes_names_and_clock(simulated):
    recording, truth = simulated
    frames = len(recording.time)
    assert recording.positions.shape == (frames, 7, 3)
    assert recording.names("foot") == ("foot1", "foot2", "foot3")
    np.testing.assert_allclose(np.diff(recording.time), 0.01)
    assert truth.contact_times.shape == truth.floor_at_contacts.shape == (40, 3)
    assert truth.contact_points.shape == (40, 3, 2)
    assert truth.apex_states.shape == (40, 12)
    assert truth.foot_down.shape == (frames, 3)
    assert truth.complete.all()


def test_truth_of_the_body_height_is_what_a_perfect_camera_sees(clean):
    recording, truth = clean
    np.testing.assert_allclose(recording.body_height, truth.body_height, atol=1e-12)
    np.testing.assert_array_equal(recording.feet[..., 2][truth.foot_down], 0)


def test_contacts_of_the_truth_are_where_feet_reach_the_floor(clean):
    recording, truth = clean
    time, feet = recording.time, recording.feet
    for landing in range(len(truth.apex_times)):
        for foot, instant in enumerate(truth.contact_times[landing]):
            k = np.searchsorted(time, instant)
            assert truth.apex_times[landing] < instant
            assert truth.foot_down[k, foot]
            assert not truth.foot_down[k - 1, foot]
            assert 0 < feet[k - 1, foot, 2] < 0.006
            point = truth.contact_points[landing, foot]
            np.testing.assert_allclose(feet[k, foot, :2], point, atol=2e-3)


@pytest.mark.parametrize("scene", ["hopper", "quadruped"])
def test_legs_that_scatter_touch_when_their_feet_reach_the_floor(scene):
    scattered = {"scene": scene, "hops": 40, "legs_scatter_m": 0.008}
    camera = {**CLEAN, "rate_hz": 500}
    recording, truth = simulate_recording(scattered, camera, seed=5)
    assert truth.longer_m.shape == truth.contact_times.shape
    assert 0.006 < truth.longer_m.std() < 0.01
    test_contacts_of_the_truth_are_where_feet_reach_the_floor((recording, truth))
    test_truth_of_the_body_height_is_what_a_perfect_camera_sees((recording, truth))
    # Feet do not jump, though legs change their length.
    speed = np.linalg.norm(np.diff(recording.feet, axis=0), axis=2) * 500
    assert speed.max() < 4.0
    # Beside tilt and spin, longer legs touch earlier: by their length over the speed.
    early = truth.contact_times - truth.contact_times.mean(axis=1, keepdims=True)
    longer = truth.longer_m - truth.longer_m.mean(axis=1, keepdims=True)
    body = truth.apex_states[:, [4, 5, 9, 10]]
    for foot in range(early.shape[1]):
        design = np.column_stack([np.ones(len(body)), longer[:, foot], body])
        slopes, *_ = np.linalg.lstsq(design, early[:, foot], rcond=None)
        assert slopes[1] == pytest.approx(-1 / 2.2, rel=0.25)  # m/s


def test_legs_of_one_length_leave_no_trace(simulated):
    _, truth = simulated
    assert truth.longer_m is None
    assert "scatter" not in truth.parameters_json
    _, scattered = simulate_recording({"hops": 2, "legs_scatter_m": 0.008}, seed=5)
    first = scattered.apex_states[0]
    np.testing.assert_array_equal(first, truth.apex_states[0])
    assert '"legs_scatter_m": 0.008' in scattered.parameters_json


def test_a_scene_says_whether_its_legs_can_scatter(monkeypatch):
    monkeypatch.setattr(HopperParameters, "legs_can_scatter", False)
    with pytest.raises(
        HopdataError, match=r"legs_scatter_m: expected 0, since the legs"
    ):
        simulate_recording({"hops": 1, "legs_scatter_m": 0.001}, seed=5)


def test_apexes_are_where_the_body_is_highest(clean):
    recording, truth = clean
    for apex in truth.apex_times[1:]:
        k = np.searchsorted(recording.time, apex)
        around = truth.body_height[k - 50 : k + 50]
        assert around.max() - truth.body_height[k] < 0.002


def test_floor_of_the_truth_is_the_floor_under_the_seen_feet(simulated):
    recording, truth = simulated
    heights = []
    for landing in range(len(truth.apex_times)):
        k = np.searchsorted(recording.time, truth.contact_times[landing].max()) + 1
        heights.append(recording.feet[k : k + 5, :, 2].mean(axis=0))
    error = np.array(heights) - truth.floor_at_contacts
    assert np.ptp(truth.floor_at_contacts) > 0.001
    assert error.std() < 0.0006
    assert abs(error.mean()) < 0.0002


def test_seed_and_parameters_are_kept_in_the_truth(simulated):
    parameters = json.loads(simulated[1].parameters_json)
    assert parameters["seed"] == 5
    assert parameters["simulation"]["hopper"]["stiffness_n_m"] == 90.0
    assert parameters["motion_capture"]["noise_m"] == simulated[1].noise_m == 0.0006
    assert "noise_of" not in parameters["motion_capture"]


def test_the_noise_of_a_distance_is_told_with_that_of_a_coordinate():
    camera = {"noise_of": "distance"}
    _, truth = simulate_recording({"hops": 2}, camera, seed=5)
    parameters = json.loads(truth.parameters_json)
    assert parameters["motion_capture"]["noise_of"] == "distance"
    assert truth.noise_m == pytest.approx(0.0006 / np.sqrt(2))


def test_same_seed_same_recording_and_streams_are_apart(simulated):
    again = simulate_recording({"hops": 40}, seed=5)
    np.testing.assert_array_equal(again[0].positions, simulated[0].positions)
    other = simulate_recording({"hops": 40}, seed=[5, 1])
    assert np.any(other[1].contact_times != simulated[1].contact_times)
    gappy = {"gaps": {"rate_per_min": 30.0}}
    with_gaps = simulate_recording({"hops": 40}, gappy, seed=5)[0].positions
    hidden = np.isnan(with_gaps)
    assert 0.01 < hidden.mean() < 0.2
    np.testing.assert_array_equal(with_gaps[~hidden], simulated[0].positions[~hidden])


def test_hops_are_the_same_whatever_camera_looks(simulated, clean):
    np.testing.assert_allclose(
        simulated[1].contact_times, clean[1].contact_times, rtol=0, atol=1e-12
    )


def test_duration_cuts_the_recording_and_unfinished_landings(simulated):
    recording, truth = simulate_recording({"hops": 1000, "duration_s": 10.0}, seed=5)
    assert len(recording.time) == len(truth.foot_down) == 1000
    np.testing.assert_array_equal(truth.contact_times, simulated[1].contact_times[:15])
    np.testing.assert_array_equal(recording.time, simulated[0].time[:1000])


def test_other_numbers_of_legs_and_body_markers():
    hopper = {
        "n_legs": 4,
        "stiffness_n_m": 67.5,
        "preload_n": 16.5,
        "damping_n_s_m": 3.6,
    }
    body = [[0.1, 0.0, 0.1], [-0.1, 0.1, 0.1], [-0.1, -0.1, 0.12], [0.0, 0.0, 0.2]]
    recording, truth = simulate_recording(
        {"hops": 10, "hopper": hopper}, {"markers": {"body_m": body}}, seed=1
    )
    assert recording.body.shape[1] == recording.feet.shape[1] == 4
    assert truth.contact_times.shape == (10, 4)
    assert truth.complete.all()


@pytest.mark.parametrize(
    ("simulation", "camera", "message"),
    [
        ({"hop": 3}, {}, r"Simulation: .*'hop'; did you mean 'hops'"),
        (
            {"hopper": {"mass": 2.0}},
            {},
            r"HopperParameters: .*'mass'; did you mean 'mass_kg'",
        ),
        ({"hopper": {"preload_n": 18.0}}, {}, "cannot lift off"),
        ({}, {"floor": {"depth": 1}}, r"FloorOptions: .*'depth'"),
    ],
)
def test_a_wrong_key_or_value_is_refused_by_name(simulation, camera, message):
    with pytest.raises(HopdataError, match=message):
        simulate_recording(simulation, camera, seed=1)


def test_falls_are_counted_in_a_remark(simulated):
    assert simulated[0].remarks == ()
    kicks = {"angular_velocity_rad_s": 4.0}
    recording, truth = simulate_recording({"hops": 12, "kicks": kicks}, seed=5)
    (remark,) = recording.remarks
    fell = int(remark.split(" fell in ")[1].split(" of 12 hops")[0])
    # A carry lasts longer than any hop of this gait.
    carried = int((np.diff(truth.apex_times) > 1.5).sum())
    assert 0 < carried <= fell <= 12
