"""Excitation and frame changes as printed, and how measured frame changes are scored."""

import numpy as np
import pytest
from frame_change_models import (
    frame_change_errors,
    frame_changes_at_frames,
    random_excitation,
    stance_boom_angles,
    true_pairs,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from test_trial import GRIDS, counts, rng

from hopdata.steering.robot import SteeredHopper
from hopdata.steering.trial import POSE, ControlGrid, record_trial


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, start=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_a_random_sequence_ends_when_all_moves_are_made(grid, start, seed):
    found = random_excitation(grid, rng(seed), start=start)
    assert (counts(grid, found.start, found.steps) >= grid.repeats).all()
    assert (counts(grid, found.start, found.steps[:-1]) < grid.repeats).sum() == 1


def test_the_random_sequence_as_printed_is_near_minimal():
    lengths = [len(random_excitation(ControlGrid(), rng(s)).steps) for s in range(20)]
    assert min(lengths) >= 336
    assert np.median(lengths) < 1.25 * 336


def test_the_draw_prefers_angles_with_more_moves_left():
    # From angle 0 of three, with one repeat and n_steps 1, weights are 3 + 1 each; a move that
    # leads back to angle 0 finds one fewer there on the second draw: 2 + 1 against 3 + 1.
    grid = ControlGrid(n_angles=3, n_steps=1, repeats=1)
    second = []
    for seed in range(4000):
        steps = random_excitation(grid, rng(seed), limit=2).steps
        if steps[0] == 1:
            second.append(steps[1])
    back = np.mean(np.array(second) == -1)  # from 1 to 0
    expected = 3 / (3 + 4 + 4)
    assert abs(back - expected) < 4 * np.sqrt(expected * (1 - expected) / len(second))


def test_a_limit_cuts_the_sequence():
    whole, cut = (random_excitation(ControlGrid(), rng(1), limit=n) for n in (None, 100))
    np.testing.assert_array_equal(cut.steps, whole.steps[:100])


def test_a_seed_gives_the_same_sequence_again():
    first, again = (random_excitation(ControlGrid(), rng(3)).steps for _ in range(2))
    np.testing.assert_array_equal(first, again)


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
