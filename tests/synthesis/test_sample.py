"""The bundled sample is what the committed code makes from the seed stored in it."""

import json
from pathlib import Path

import numpy as np
import pytest

from hopdata.recordings.readers.hdf5 import read_recording, read_truth
from hopdata.synthesis import simulate_recording

SAMPLE = Path(__file__).parents[2] / "data" / "sample" / "hopper.h5"


@pytest.fixture(scope="module")
def sample():
    return read_recording(SAMPLE), read_truth(SAMPLE)


@pytest.fixture(scope="module")
def made_again(sample):
    made_with = json.loads(sample[1].parameters_json)
    return simulate_recording(
        made_with["simulation"], made_with["motion_capture"], seed=made_with["seed"]
    )


def test_sample_is_small_and_long_enough(sample):
    assert SAMPLE.stat().st_size < 4.7e6  # positions are float64
    assert sample[1].complete.sum() >= 400


def test_positions_are_made_again_to_the_last_step_of_the_resolution(
    sample, made_again
):
    resolution = json.loads(sample[1].parameters_json)["motion_capture"]["resolution_m"]
    recording, again = sample[0], made_again[0]
    assert recording.markers == again.markers
    assert recording.roles == again.roles
    np.testing.assert_array_equal(recording.time, again.time)
    steps = np.abs(recording.positions - again.positions) / resolution
    # Another processor rounds differently, so a value at the edge of a step may move by
    # one step.
    assert steps.max() <= 1
    assert np.mean(steps > 0) < 1e-3


def test_truth_is_made_again(sample, made_again):
    truth, again = sample[1], made_again[1]
    np.testing.assert_allclose(
        truth.contact_times, again.contact_times, rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(truth.apex_states, again.apex_states, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(truth.complete, again.complete)
    assert np.mean(truth.foot_down != again.foot_down) < 1e-4
    stated = json.loads(truth.parameters_json)
    assert restricted(json.loads(again.parameters_json), stated) == stated


def restricted(parameters, stated):
    """Return the part of parameters that a file states.

    A key that is new since it was made takes its default, which is what made it.
    """
    if not isinstance(stated, dict):
        return parameters
    return {key: restricted(parameters[key], one) for key, one in stated.items()}


def test_a_new_key_does_not_invalidate_the_sample_and_another_value_does(sample):
    stated = json.loads(sample[1].parameters_json)
    newer = json.loads(sample[1].parameters_json)
    newer["simulation"]["hopper"]["new_key"] = 0.0
    assert restricted(newer, stated) == stated
    newer["simulation"]["hopper"]["mass_kg"] += 0.1
    assert restricted(newer, stated) != stated


def test_another_seed_makes_another_sample(sample):
    made_with = json.loads(sample[1].parameters_json)
    other, _ = simulate_recording({"hops": 3}, made_with["motion_capture"], seed=1)
    frames = len(other.time)
    assert np.abs(other.positions - sample[0].positions[:frames]).max() > 0.01
