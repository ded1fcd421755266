"""The simulated robot: stances, frame changes and truth are consistent."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.rigid import composed, relative
from hopdata.steering.robot import Board, SteeredHopper, released, steer_hop
from hopdata.steering.trial import record_trial, true_frame_changes
from hopdata.synthesis.camera import MotionCapture
from hopdata.synthesis.trial import FloorOptions

ROBOT = SteeredHopper()
STILL = ROBOT.still()
EXACT = MotionCapture(
    noise_m=0.0, resolution_m=0.0, floor=FloorOptions(bowl_depth_m=0.0, waves=0)
)


def rng(seed=0):
    return np.random.default_rng(np.random.SeedSequence(seed))


def fly(robot, apex, swings, **options):
    hops = []
    for swing in swings:
        hops.append(steer_hop(robot, apex, swing, rng=rng(), **options))
        apex = hops[-1].end
    return hops


def test_a_release_puts_the_markers_where_they_were_asked_for():
    apex = released(STILL, [0.4, -0.3, 2.0], 1.0)
    hop = steer_hop(STILL, apex, 0.0, rng=rng(), rate_hz=100.0)
    np.testing.assert_allclose(
        hop.markers[0, :3, :2].mean(axis=0), [0.4, -0.3], atol=1e-12
    )


def test_frame_changes_do_not_depend_on_place_and_heading():
    swings = [0.5, -0.9, 0.2]
    here = fly(STILL, released(STILL, np.zeros(3)), swings)
    there = fly(STILL, released(STILL, [0.7, -0.2, 2.5]), swings)
    for a, b in zip(here, there, strict=True):
        moved = composed([0.7, -0.2, 2.5], a.stance.pose)
        np.testing.assert_allclose(moved[:2], b.stance.pose[:2], atol=1e-7)


def test_the_boom_goes_where_it_is_told_and_no_farther_than_the_limit():
    hops = fly(STILL, released(STILL, np.zeros(3), 3.0), [0.4, 9.0])
    assert hops[0].stance.boom_angle_rad == pytest.approx(3.4)
    assert hops[1].swing_rad == ROBOT.swing_limit_rad
    assert hops[1].end.boom_angle_rad == pytest.approx(3.4 + ROBOT.swing_limit_rad)


def test_the_stance_is_the_lowest_point_of_the_markers():
    hop = fly(STILL, released(STILL, np.zeros(3)), [0.3], rate_hz=1000.0)[0]
    height = hop.markers[:, :3, 2].mean(axis=1)
    assert hop.frame_time_s[np.argmin(height)] == pytest.approx(
        hop.stance.time_s, abs=1e-3
    )


# Stances are near 0.35 and 0.41 s, where a frame is not quite 35 or 41 times the search
# step.
@pytest.mark.parametrize("height_m", [0.345, 0.495])
def test_frames_within_rounding_of_the_search_do_not_move_the_stance(height_m):
    robot = replace(STILL, release_height_m=height_m)
    apex = released(robot, np.zeros(3))
    seen = steer_hop(robot, apex, 0.5, rng=rng(), rate_hz=100.0)
    alone = steer_hop(robot, apex, 0.5, rng=rng())
    assert seen.stance.time_s == pytest.approx(alone.stance.time_s, abs=1e-9)
    np.testing.assert_allclose(seen.stance.pose, alone.stance.pose, atol=1e-9)


def test_a_board_holds_the_hopper_back_and_is_left_where_it_was_pushed():
    board = Board(direction=(1.0, 0.0), place_m=0.0)
    free = pushing = released(STILL, np.zeros(3), 1.0)
    for _ in range(6):
        free = steer_hop(STILL, free, 0.0, rng=rng()).end
        hop = steer_hop(STILL, pushing, 0.0, rng=rng(), board=board)
        board, pushing = board.pushed(hop), hop.end
    assert 0.05 < pushing.state[0] < free.state[0] - 0.05
    assert hop.stance.touched
    assert board.place_m == pytest.approx(hop.hop.event_state[-1, 0] + board.reach_m)


def test_the_touch_is_an_event_while_the_hopper_stands_and_none_short_of_the_board():
    apex = released(STILL, np.zeros(3), 1.0)
    free = steer_hop(STILL, apex, 0.0, rng=rng())
    down, up = free.hop.event_time[0], free.hop.event_time[-1]
    between = free.hop.event_state[:, 0].min(), free.hop.event_state[:, 0].max()

    def touch(centre_m):
        board = Board(direction=(1.0, 0.0), place_m=centre_m + 0.38)
        return steer_hop(STILL, apex, 0.0, rng=rng(), board=board)

    assert touch(between[0] - 0.5).hop.touched_s == pytest.approx(down)
    half_way = touch(sum(between) / 2).hop.touched_s
    assert down < half_way < up
    far = touch(between[1] + 0.05)
    assert np.isnan(far.hop.touched_s)
    assert not far.stance.touched
    np.testing.assert_allclose(far.stance.pose, free.stance.pose, atol=1e-6)


def test_a_board_behind_the_back_does_not_hold_the_hopper():
    away = fly(STILL, released(STILL, np.zeros(3), 1.0), [0.0])[0]
    board = Board(direction=(-1.0, 0.0), place_m=-1.0)
    held = steer_hop(STILL, away.end, 0.0, rng=rng(), board=board)
    free = steer_hop(STILL, away.end, 0.0, rng=rng())
    np.testing.assert_allclose(held.stance.pose, free.stance.pose, atol=1e-6)


def test_a_trial_s_truth_agrees_with_its_markers():
    swings = rng(3).uniform(-1.0, 1.0, 40)
    trial = record_trial(ROBOT, swings, seed=4, camera=EXACT)
    stances = trial.stances
    begins = stances.frame - 1
    assert len(stances.frame) == 40
    np.testing.assert_allclose(np.diff(stances.boom_angle_rad), swings[1:], atol=1e-9)
    seen = trial.recording.body[begins][..., :2].mean(axis=1)
    np.testing.assert_allclose(seen, stances[["x_m", "y_m"]], atol=1e-12)
    height = trial.recording.body_height
    assert np.all(height[begins] <= height[begins + 1])
    assert np.all(height[begins] <= height[begins - 1])


def test_handling_breaks_the_chain_of_stances():
    trial = record_trial(ROBOT, np.zeros(60), seed=5, camera=EXACT)
    assert 0 < np.sum(~trial.stances["follows"]) < 10
    near = trial.stances["time_s"].diff()[trial.stances["follows"]]
    assert near.max() < 0.8


@pytest.mark.parametrize(
    ("swings", "found"),
    [
        ([], r"\[\]"),
        (0.3, "0.3"),
        (["far"], "far"),
        ([0.1, np.nan], "nan"),
        ([[0.1]], "0.1"),
    ],
)
def test_swings_that_are_no_numbers_are_refused(swings, found):
    with pytest.raises(
        ConfigError, match=rf"swings_rad: expected a list of .*found .*{found}"
    ):
        record_trial(ROBOT, swings, seed=1)


def test_the_same_seed_gives_the_same_recording():
    a, b = (
        record_trial(ROBOT, [0.1, -0.2], seed=6).recording.positions for _ in range(2)
    )
    assert a.tobytes() == b.tobytes()


def test_the_true_map_is_what_a_still_hopper_does():
    true = true_frame_changes(ROBOT, boom_angles=2, swings=3)
    assert true.change.shape == (2, 3, 3, 3)
    apex = released(STILL, np.zeros(3), np.pi + true.swing_rad[2])
    settled = fly(STILL, apex, np.zeros(10))[-1].end
    first, second = fly(STILL, settled, [true.previous_swing_rad[0], true.swing_rad[2]])
    change = relative(first.stance.pose, second.stance.pose)
    np.testing.assert_allclose(true.change[1, 2, 0], change, atol=1e-6)


def test_preloads_must_fit_the_legs():
    with pytest.raises(ConfigError, match="expected one for each of 3 legs, found 2"):
        replace(ROBOT, preload_shares=(1.0, 1.0))


@pytest.mark.parametrize("height_m", [0.2, 0.3])
def test_a_recorded_robot_is_let_go_at_its_own_height(height_m):
    trial = record_trial(
        replace(STILL, release_height_m=height_m), [0.0], seed=1, camera=EXACT
    )
    apex = released(replace(STILL, release_height_m=height_m), np.zeros(3))
    hop = steer_hop(STILL, apex, 0.0, rng=rng(), rate_hz=100.0)
    found = trial.recording.body[0, :, 2].mean()
    np.testing.assert_allclose(found, hop.markers[0, :3, 2].mean(), atol=1e-9)
