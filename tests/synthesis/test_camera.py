from dataclasses import replace

import numpy as np
import pytest

from hopdata.scenes.body import rotation_matrices
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.camera import (
    CurvedFloor,
    MotionCapture,
    draw_floor,
    fixed_markers,
    track_markers,
)
from hopdata.synthesis.hops import rest_foot, smooth_step
from hopdata.synthesis.trial import FloorOptions, GapOptions, MarkerOptions, run_trial

FLOOR = draw_floor(FloorOptions(), np.random.default_rng(1))
TRUE = np.random.default_rng(2).uniform(-1, 1, (20_000, 4, 3))
NOBODY = np.zeros(TRUE.shape[:2], dtype=bool)


def seen(noise_m=0.0006, resolution_m=0.0, hidden=NOBODY):
    camera = MotionCapture(noise_m=noise_m, resolution_m=resolution_m)
    return camera.observe(TRUE, FLOOR, hidden, np.random.default_rng(3))


def test_without_noise_only_the_floor_is_added_and_only_to_z():
    error = seen(noise_m=0.0) - TRUE
    np.testing.assert_array_equal(error[..., :2], 0)
    np.testing.assert_allclose(error[..., 2], FLOOR.height(TRUE[..., :2]), atol=1e-15)


def test_noise_is_per_coordinate_and_a_distance_varies_by_sqrt_two_of_it():
    error = seen() - seen(noise_m=0.0)
    np.testing.assert_allclose(error.std(axis=0), 0.0006, rtol=0.03)
    assert abs(np.corrcoef(error[:, 0, 0], error[:, 0, 1])[0, 1]) < 0.03

    def distance(positions):
        return np.linalg.norm(positions[:, 0] - positions[:, 1], axis=-1)

    assert (distance(seen()) - distance(seen(noise_m=0.0))).std() == pytest.approx(
        0.0006 * np.sqrt(2), rel=0.03
    )


def test_the_noise_may_be_that_of_a_distance():
    camera = MotionCapture(noise_m=0.0006, noise_of="distance")
    assert camera.coordinate_noise_m == pytest.approx(0.0006 / np.sqrt(2))
    error = camera.observe(TRUE, FLOOR, NOBODY, np.random.default_rng(3)) - TRUE
    error[..., 2] -= FLOOR.height(TRUE[..., :2])
    pair = TRUE[:, :2] + error[:, :2]
    apart = np.linalg.norm(pair[:, 0] - pair[:, 1], axis=-1)
    true_apart = np.linalg.norm(TRUE[:, 0] - TRUE[:, 1], axis=-1)
    assert (apart - true_apart).std() == pytest.approx(0.0006, rel=0.03)


def test_positions_are_multiples_of_the_resolution():
    step = 2.0**-12
    coarse = seen(resolution_m=step)
    np.testing.assert_array_equal(coarse / step, np.round(coarse / step))
    assert np.abs(coarse - seen()).max() <= step / 2
    fine = seen() / step
    assert np.any(fine != np.round(fine))


def test_hidden_markers_are_missing_in_all_coordinates_and_the_true_ones_are_kept():
    hidden = NOBODY.copy()
    hidden[10:20, 2] = True
    positions = seen(hidden=hidden)
    np.testing.assert_array_equal(np.isnan(positions).all(axis=-1), hidden)
    np.testing.assert_array_equal(np.isnan(positions).any(axis=-1), hidden)
    assert not np.isnan(TRUE).any()


def arena(n=41):
    side = np.linspace(-0.9, 0.9, n)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def test_the_floor_is_curved_by_a_few_millimetres_and_no_cubic():
    xy = arena()
    height = draw_floor(FloorOptions(), np.random.default_rng(1)).height(xy)
    assert 0.002 < np.ptp(height) < 0.010
    x, y = xy.T
    cubic = np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])
    residual = height - cubic @ np.linalg.lstsq(cubic, height)[0]
    assert 1e-6 < residual.std() < 0.0006
    assert np.linalg.matrix_rank(np.column_stack([cubic, height])) == cubic.shape[1] + 1


def test_bowl_rises_to_half_its_depth_at_its_radius():
    flat = np.zeros((0, 2))
    bowl = CurvedFloor(FloorOptions(), flat, np.zeros(0))
    points = np.array([[0.0, 0.0], [1.2, 0.0], [0.0, -1.2]])
    np.testing.assert_allclose(bowl.height(points), [0, 0.002, 0.002])


def test_waves_add_up_and_repeat_after_their_length():
    floor = draw_floor(
        FloorOptions(bowl_depth_m=0.0, waves=1), np.random.default_rng(2)
    )
    k = floor.wave_vectors[0]
    period = 2 * np.pi * k / (k @ k)
    assert 2.4 <= np.linalg.norm(period) <= 3.6
    xy = arena(5)
    np.testing.assert_allclose(floor.height(xy), floor.height(xy + period), atol=1e-15)
    assert np.abs(floor.height(xy)).max() <= 0.001


def test_a_floor_of_no_depth_and_no_waves_is_flat():
    floor = draw_floor(
        FloorOptions(bowl_depth_m=0.0, waves=0), np.random.default_rng(3)
    )
    np.testing.assert_array_equal(floor.height(arena()), 0)


def test_floor_height_keeps_the_shape_of_its_points():
    floor = draw_floor(FloorOptions(), np.random.default_rng(4))
    assert floor.height(np.zeros((5, 3, 2))).shape == (5, 3)
    assert floor.height(np.zeros(2)) == pytest.approx(
        0.001 * np.sin(floor.phases).sum()
    )


def drawn(options, frames=200_000, seed=1):
    return MotionCapture(gaps=options).draw_gaps(frames, 3, np.random.default_rng(seed))


def test_no_gaps_unless_asked_for():
    assert not drawn(GapOptions()).any()


def test_rate_and_length_are_as_asked():
    hidden = drawn(GapOptions(rate_per_min=3.0, mean_s=0.08))
    begins = np.diff(hidden.astype(int), axis=0, prepend=0) == 1
    minutes = 200_000 / 100 / 60
    assert begins.sum() / (3 * minutes) == pytest.approx(3.0, rel=0.1)
    assert hidden.sum() / begins.sum() / 100 == pytest.approx(0.08, rel=0.15)


def test_markers_are_hidden_independently_and_reproducibly():
    options = GapOptions(rate_per_min=3.0)
    hidden = drawn(options)
    assert (hidden[:, 0] & hidden[:, 1]).mean() < 0.2 * hidden[:, 0].mean()
    np.testing.assert_array_equal(hidden, drawn(options))
    assert np.any(hidden != drawn(options, seed=2))


# True marker positions: rigid on the body, on the floor in contact, continuous in
# between.

HOPPER, OPTIONS = HopperParameters(), MarkerOptions()


@pytest.fixture(scope="module")
def trial():
    return run_trial(HOPPER, hops=40, rate_hz=1000.0, rng=np.random.default_rng(7))


@pytest.fixture(scope="module")
def tracks(trial):
    return track_markers(trial, HOPPER, OPTIONS)


def feet_of(tracks):
    return tracks.positions[
        :, [i for i, role in enumerate(tracks.roles) if role == "foot"]
    ]


def test_names_and_roles(tracks):
    assert tracks.names == (
        "body1",
        "body2",
        "body3",
        "foot1",
        "foot2",
        "foot3",
        "boom",
    )
    assert tracks.roles == ("body",) * 3 + ("foot",) * 3 + ("boom",)


def test_body_markers_move_rigidly_with_the_body(trial, tracks):
    turn = rotation_matrices(trial.states[:, 3:6])
    in_body = np.einsum(
        "nji,nbj->nbi", turn, tracks.positions[:, :3] - trial.states[:, None, :3]
    )
    np.testing.assert_allclose(
        in_body, np.broadcast_to(OPTIONS.body_m, in_body.shape), atol=1e-12
    )
    boom = np.einsum("nji,nj->ni", turn, tracks.positions[:, 6] - trial.states[:, :3])
    np.testing.assert_allclose(
        boom, np.broadcast_to([0, 0, -0.03], boom.shape), atol=1e-12
    )


def test_boom_marker_follows_the_counterweight_to_and_fro():
    hopper = replace(HOPPER, boom_swing_rad=0.3, boom_duration_s=0.15)
    swinging = run_trial(hopper, hops=6, rate_hz=100.0, rng=np.random.default_rng(7))
    options = MarkerOptions(boom_m=(0.0, 0.0, 0.08))
    marker = (
        track_markers(swinging, hopper, options).positions[:, -1]
        - swinging.states[:, :3]
    )
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
    gaps = np.stack(
        [rest_foot(HOPPER, trial.states, leg)[:, 2] for leg in range(3)], axis=1
    )
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
        below = (
            rest_foot(HOPPER, trial.states[lifted], leg)[:, 2] - feet[lifted, leg, 2]
        )
        np.testing.assert_allclose(below, HOPPER.release_extension_m, atol=1e-3)


def test_smooth_step_rises_from_zero_to_one_and_is_flat_at_both_ends():
    s = np.linspace(-0.2, 1.2, 1401)
    values = smooth_step(s)
    np.testing.assert_allclose(
        values[[0, 200, 700, 1200, 1400]], [0, 0, 0.5, 1, 1], atol=1e-12
    )
    assert np.all(np.diff(values) >= -1e-15)
    curvature = np.diff(values, 2) / 1e-6
    assert np.abs(curvature[[199, 200, 1198, 1199]]).max() < 0.1


def test_fixed_markers_of_a_turned_body():
    state = np.zeros((1, 12))
    state[0, :6] = [1, 2, 3, np.pi / 2, 0, 0]
    np.testing.assert_allclose(
        fixed_markers(state, np.array([[0.1, 0, 0.5]])), [[[1, 2.1, 3.5]]], atol=1e-15
    )
