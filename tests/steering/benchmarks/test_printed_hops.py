"""Printed frame changes, and the scores of measured ones."""

import numpy as np
import pytest
from frame_change_models import (
    frame_change_errors,
    frame_changes_at_frames,
    stance_boom_angles,
    true_pairs,
)

from hopdata.steering.robot import SteeredHopper
from hopdata.steering.trial import POSE, record_trial


def test_the_boom_angle_is_the_median_of_the_frames_after_the_stance():
    booms = np.full(40, 9.0)
    booms[21:24] = [0.1, -0.1, 2.0]
    booms[24:32] = -0.05 + 2 * np.pi * np.array([0, 1, 0, -1, 0, 0, 1, 0])
    window = np.array([0.1, -0.1, 2.0] + [-0.05] * 8)
    found = stance_boom_angles(booms, np.array([20]), 11)
    assert np.angle(np.exp(1j * found[0])) == pytest.approx(np.median(window))


def test_measured_frame_changes_of_the_plant_are_scored_against_the_true_ones():
    swings = np.random.default_rng(2).uniform(-1.1, 1.1, 25)
    trial = record_trial(SteeredHopper(), swings, seed=3)
    options = {"rate_hz": trial.recording.rate_hz, "swing_limit_rad": 1.2}
    pairs, poses = true_pairs(trial.stances), trial.motion[POSE].to_numpy()
    booms = trial.motion["boom_angle_rad"].to_numpy()
    true = frame_changes_at_frames(pairs, poses, booms, **options)
    told = swings[np.flatnonzero(trial.stances["follows"])]
    np.testing.assert_allclose(true.swing_rad, told, atol=1e-9)
    noise = np.random.default_rng(4).normal(0, 1e-3, poses.shape)
    seen = frame_changes_at_frames(pairs[2:] + 1, poses + noise, booms, **options)
    errors = frame_change_errors(seen, true)
    assert (errors.missed, errors.invented) == (2, 0)
    rms = errors.rms()
    assert 0 < rms["dx_m"] < 0.02
    assert rms["swing_rad"] < 1e-9
    same = frame_change_errors(true, true)
    assert same.rms()["dtheta_rad"] == 0
    assert frame_change_errors(true, true.rows([0])).invented == len(true) - 1
