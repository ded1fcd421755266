"""True marker states, against a noise-free recording of many frames, and the maps as plain data."""

import json

import numpy as np
import pytest

from hopdata.synthesis import simulate_recording
from hopdata.synthesis.known_scene import known_scene
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.section_coordinates import INPUT_NAMES, OUTPUT_NAMES
from hopdata.synthesis.true_sections import exact_maps, true_states

CLEAN = {"noise_m": 0.0, "resolution_m": 0.0, "floor": {"bowl_depth_m": 0.0, "waves": 0}}
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
    for row, landing in enumerate(states.index):
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
    instants = truth.contact_times[states.index]
    names = [">".join(str(foot + 1) for foot in np.argsort(row)) for row in instants]
    assert states.schedule.tolist() == names
    np.testing.assert_allclose(states.spread_s, instants.std(axis=1), rtol=0, atol=1e-9)
    assert np.all(np.diff(states.index) > 0)


def test_exact_maps_are_plain_data(study):
    _, truth, sections, _ = study
    found = json.loads(json.dumps(exact_maps([truth], sections)))
    assert np.shape(found["maps"]) == (6, len(OUTPUT_NAMES), len(INPUT_NAMES)) == (6, 11, 8)
    assert len(found["schedules"]) == len(found["y"]) == 6
    assert np.ptp(found["maps"], axis=0).max() < 1e-12
    np.testing.assert_array_equal(found["body_points_m"], sections.points_m)
