"""True marker positions: rigid on the body, on the floor in contact, continuous in between."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.rigid_body import rotation_matrices
from hopdata.synthesis.hops import rest_foot
from hopdata.synthesis.markers import fixed_markers, smooth_step, track_markers
from hopdata.synthesis.options import MarkerOptions
from hopdata.synthesis.trial import run_trial

HOPPER, OPTIONS = HopperParameters(), MarkerOptions()


@pytest.fixture(scope="module")
def trial():
    return run_trial(HOPPER, hops=40, rate_hz=1000.0, rng=np.random.default_rng(7))


@pytest.fixture(scope="module")
def tracks(trial):
    return track_markers(trial, HOPPER, OPTIONS)


def feet_of(tracks):
    return tracks.positions[:, [i for i, role in enumerate(tracks.roles) if role == "foot"]]


def test_names_and_roles(tracks):
    assert tracks.names == ("body1", "body2", "body3", "foot1", "foot2", "foot3", "boom")
    assert tracks.roles == ("body",) * 3 + ("foot",) * 3 + ("boom",)


def test_body_markers_move_rigidly_with_the_body(trial, tracks):
    turn = rotation_matrices(trial.states[:, 3:6])
    in_body = np.einsum("nji,nbj->nbi", turn, tracks.positions[:, :3] - trial.states[:, None, :3])
    np.testing.assert_allclose(in_body, np.broadcast_to(OPTIONS.body_m, in_body.shape), atol=1e-12)
    boom = np.einsum("nji,nj->ni", turn, tracks.positions[:, 6] - trial.states[:, :3])
    np.testing.assert_allclose(boom, np.broadcast_to([0, 0, -0.03], boom.shape), atol=1e-12)


def test_boom_marker_follows_the_counterweight_to_and_fro():
    hopper = replace(HOPPER, boom_swing_rad=0.3, boom_duration_s=0.15)
    swinging = run_trial(hopper, hops=6, rate_hz=100.0, rng=np.random.default_rng(7))
    options = MarkerOptions(boom_m=(0.0, 0.0, 0.08))
    marker = track_markers(swinging, hopper, options).positions[:, -1] - swinging.states[:, :3]
    turn = rotation_matrices(swinging.states[:, 3:6])
    x, y, z = np.einsum("nji,nj->in", turn, marker)
    np.testing.assert_allclose(z, 0.05, atol=1e-12)
    np.testing.assert_allclose(np.hypot(x - 0.25, y), 0.25, atol=1e-12)
    angle = np.arctan2(y, x - 0.25) % (2 * np.pi) - np.pi
    ends = np.searchsorted(np.arange(len(x)) / 100, swinging.hop_start_s + 0.3)
    np.testing.assert_allclose(angle[ends], [0.3, 0, 0.3, 0, 0.3, 0], atol=1e-9)
    assert np.abs(np.diff(angle)).max() < 0.05


def test_body_markers_are_neither_collinear_nor_symmetric():
    a, b, c = np.array(OPTIONS.body_m)
    assert np.linalg.norm(np.cross(b - a, c - a)) > 0.01
    sides = [np.linalg.norm(v) for v in (a - b, b - c, c - a)]
    assert min(abs(sides[i] - sides[j]) for i, j in ((0, 1), (1, 2), (2, 0))) > 0.005


def test_feet_in_contact_are_on_the_floor_and_others_above_it(tracks):
    height = feet_of(tracks)[..., 2]
    np.testing.assert_array_equal(height[tracks.foot_down], 0)
    assert height[~tracks.foot_down].min() > -1e-4
    assert 0.2 < tracks.foot_down.mean() < 0.8


def test_contact_follows_the_gap_and_the_release(trial, tracks):
    gaps = np.stack([rest_foot(HOPPER, trial.states, leg)[:, 2] for leg in range(3)], axis=1)
    assert gaps[tracks.foot_down].max() < HOPPER.release_extension_m + 1e-9
    assert gaps[~tracks.foot_down].min() > -1e-9


def test_feet_do_not_jump(tracks):
    feet = feet_of(tracks)
    speed = np.linalg.norm(np.diff(feet, axis=0), axis=-1) * 1000
    assert speed.max() < 4.0
    landed = np.diff(tracks.foot_down.astype(int), axis=0) == 1
    lifted = np.diff(tracks.foot_down.astype(int), axis=0) == -1
    assert landed.sum() >= 3 * 38
    assert speed[lifted].max() < 2.5


def test_legs_are_back_at_rest_length_before_they_land(trial, tracks):
    feet = feet_of(tracks)
    for leg in range(3):
        landed = np.flatnonzero(np.diff(tracks.foot_down[:, leg].astype(int)) == 1)
        before = landed - 50
        np.testing.assert_allclose(
            feet[before, leg], rest_foot(HOPPER, trial.states[before], leg), atol=1e-12
        )
        lifted = np.flatnonzero(np.diff(tracks.foot_down[:, leg].astype(int)) == -1) + 1
        below = rest_foot(HOPPER, trial.states[lifted], leg)[:, 2] - feet[lifted, leg, 2]
        np.testing.assert_allclose(below, HOPPER.release_extension_m, atol=1e-3)


def test_smooth_step_rises_from_zero_to_one_and_is_flat_at_both_ends():
    s = np.linspace(-0.2, 1.2, 1401)
    values = smooth_step(s)
    np.testing.assert_allclose(values[[0, 200, 700, 1200, 1400]], [0, 0, 0.5, 1, 1], atol=1e-12)
    assert np.all(np.diff(values) >= -1e-15)
    curvature = np.diff(values, 2) / 1e-6
    assert np.abs(curvature[[199, 200, 1198, 1199]]).max() < 0.1


def test_fixed_markers_of_a_turned_body():
    state = np.zeros((1, 12))
    state[0, :6] = [1, 2, 3, np.pi / 2, 0, 0]
    np.testing.assert_allclose(
        fixed_markers(state, np.array([[0.1, 0, 0.5]])), [[[1, 2.1, 3.5]]], atol=1e-15
    )
