"""Trials in closed loop: what is returned fits together, and nothing stops the loop."""

import numpy as np
import pytest
from steering_setting import PoseNoise, closed_loop

from hopdata.steering.control.objectives import (
    Plan,
    PlanningError,
    ToPoint,
    checked_state,
    errors_left,
)
from hopdata.steering.robot import Board, SteeredHopper

ROBOT = SteeredHopper()


class Given:
    """Swings from a list; remembers what it was told."""

    def __init__(self, swings):
        self.swings, self.told = list(swings), []

    def plan(self, pose, boom_angle_rad, previous_swing_rad=None, /):
        here, boom = checked_state(pose, boom_angle_rad)
        self.told.append((here, boom, previous_swing_rad))
        swing = self.swings[len(self.told) - 1]
        return Plan(np.array([swing]), np.array([here, here]), 0.0)


def test_a_trial_fits_together():
    controller = Given([0.3, -0.5, 9.0])
    trial = closed_loop(ROBOT, controller, [0.2, -0.1, 1.0], hops=3, seed=1, boom_angle_rad=2.0)
    assert trial.poses.shape == trial.measured_poses.shape == (4, 3)
    np.testing.assert_allclose(trial.swings_rad, [0.3, -0.5, ROBOT.swing_limit_rad])
    assert trial.boom_angles_rad[0] == pytest.approx(2.0)
    np.testing.assert_allclose(np.diff(trial.boom_angles_rad), trial.swings_rad)
    np.testing.assert_array_equal(trial.measured_poses, trial.poses)
    assert np.all(np.diff(trial.time_s) > 0.4)
    assert trial.held == 0
    assert not trial.fell
    assert np.isnan(trial.board_m).all()
    assert not trial.pushed.any()


def test_the_controller_is_told_what_is_measured_and_what_was_done():
    controller = Given([0.3, 9.0, 0.0])
    trial = closed_loop(ROBOT, controller, np.zeros(3), hops=3, seed=2, observe=PoseNoise())
    told = np.array([pose for pose, _, _ in controller.told])
    np.testing.assert_array_equal(told, trial.measured_poses[:3])
    assert [previous for _, _, previous in controller.told] == [0.0, 0.3, ROBOT.swing_limit_rad]
    off = trial.measured_poses - trial.poses
    assert np.all(off != 0)
    assert np.abs(off[:, :2]).max() < 5 * PoseNoise().position_m
    assert np.abs(off[:, 2]).max() < 5 * PoseNoise().heading_rad


def test_the_same_seed_gives_the_same_trial_and_noise_does_not_move_the_kicks():
    runs = [
        closed_loop(ROBOT, Given([0.1, 0.2]), np.zeros(3), hops=2, seed=3, **options)
        for options in ({}, {}, {"observe": PoseNoise()})
    ]
    assert runs[0].poses.tobytes() == runs[1].poses.tobytes() == runs[2].poses.tobytes()
    other = closed_loop(ROBOT, Given([0.1, 0.2]), np.zeros(3), hops=2, seed=4)
    assert not np.array_equal(other.poses, runs[0].poses)


def test_the_boom_is_held_where_no_plan_can_be_made():
    def blind_at_first(stance, rng):
        if stance.time_s < 0.7:
            return np.full(3, np.nan), stance.boom_angle_rad
        return stance.pose, stance.boom_angle_rad

    trial = closed_loop(
        ROBOT, Given([0.4, 0.4, 0.4]), np.zeros(3), hops=3, seed=5, observe=blind_at_first
    )
    assert trial.held == 1
    assert trial.plans[0] is None
    np.testing.assert_allclose(trial.swings_rad, [0.0, 0.4, 0.4])


def test_mistakes_of_a_controller_are_not_hidden():
    class Broken:
        def plan(self, *_):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        closed_loop(ROBOT, Broken(), np.zeros(3), hops=1, seed=6)
    assert not issubclass(ZeroDivisionError, PlanningError)


def test_a_board_is_pushed_along_and_holds_back():
    start, swings = np.zeros(3), np.zeros(8)
    board = Board(direction=(1.0, 0.0), place_m=0.4)
    free, held = (
        closed_loop(ROBOT, Given(swings), start, hops=8, seed=7, boom_angle_rad=0.5, board=one)
        for one in (None, board)
    )
    assert held.pushed.any()
    assert np.all(np.diff(held.board_m) >= 0)
    assert held.board_m[-1] > held.board_m[0]
    goal = ToPoint(point_m=(2.0, 0.0))
    assert errors_left(goal, held.poses)[-1] > errors_left(goal, free.poses)[-1] + 0.03
