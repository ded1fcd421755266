"""A run through motion capture: what the controller receives, and what is recorded."""

from dataclasses import replace

import numpy as np
import pytest
from seen_hopper import ROBOT, Swings, gaps, sight, start

from hopdata.rigid import wrapped
from hopdata.steering.control.objectives import PlanningError
from hopdata.steering.experiments.run import (
    MEASURED,
    PREDICTED,
    WatchedHopper,
    run_task,
)
from hopdata.steering.experiments.study import board_for, simulated
from hopdata.steering.experiments.tasks import FELL, Task
from hopdata.steering.trial import POSE

TASK = Task(manoeuvre="origin", near=0.01, hops=8)


def run(controller, seen=None, task=TASK, **options):
    return run_task(
        WatchedHopper(ROBOT, seen or sight(), task, start(), **options), controller
    )


def poses(made, columns):
    return made.stances[columns].to_numpy()


@pytest.fixture(scope="module")
def swinging():
    controller = Swings(0.4, -0.7, 0.2)
    return controller, run(controller)


def test_one_plan_a_stance_and_one_stance_a_hop(swinging):
    controller, made = swinging
    assert len(made.stances["time_s"]) == TASK.hops + 1 == len(controller.told)
    assert made.blind == 0
    waits = np.diff(made.stances["time_s"])
    assert 0.5 < waits.min() < waits.max() < 0.75


def test_the_pose_that_is_seen_is_the_true_one_but_for_noise(swinging):
    _, made = swinging
    measured, true = poses(made, MEASURED), poses(made, POSE)
    assert 0 < np.abs(measured - true)[:, :2].max() < 3e-3
    assert 0 < np.abs(wrapped(measured[:, 2] - true[:, 2])).max() < 0.02


def test_the_boom_goes_by_the_swings_that_were_planned(swinging):
    controller, made = swinging
    turned = wrapped(
        np.diff(made.stances["boom_angle_rad"]) - made.stances["swing_rad"][:-1]
    )
    assert np.abs(turned).max() < 0.03
    assert [told[2] for told in controller.told[:3]] == [None, 0.4, -0.7]


def test_a_prediction_stands_with_the_stance_that_it_foretells(swinging):
    _, made = swinging
    measured, predicted = poses(made, MEASURED), poses(made, PREDICTED)
    assert np.isnan(predicted[0]).all()
    np.testing.assert_allclose(
        predicted[1:] - measured[:-1], [[0.05, 0, 0]] * 8, atol=1e-12
    )


def test_the_same_start_meets_the_same_chance(swinging):
    _, made = swinging
    again = run(Swings(0.4, -0.7, 0.2))
    np.testing.assert_array_equal(made.stances, again.stances)


def test_hidden_markers_blind_the_controller_for_a_while_and_it_holds_the_boom():
    made = run(Swings(0.5), sight(gaps=gaps(60.0, 0.4)))
    unseen = made.stances["measured_x_m"].isna()
    assert len(made.stances["time_s"]) == TASK.hops + 1
    assert made.blind == unseen.sum() > 0
    assert (made.stances["swing_rad"][unseen] == 0).all()
    assert (made.stances["swing_rad"][~unseen] == 0.5).all()
    assert np.isfinite(poses(made, POSE)).all()


def test_a_controller_without_a_plan_holds_the_boom():
    class Helpless:
        def plan(self, *_):
            raise PlanningError("plan: none")

    made = run(Helpless())
    assert made.blind == TASK.hops + 1
    assert (made.stances["swing_rad"] == 0).all()


def test_a_board_is_pushed_and_its_place_is_kept():
    board = board_for("origin", [1.0, 0.0, np.pi], drag_n=4.0, ahead_m=0.0)
    made = run(Swings(0.0), board=board)
    assert made.stances["board_m"].iloc[-1] > board.place_m
    assert made.stances["touched"].any()
    assert (np.diff(made.stances["board_m"]) >= 0).all()


def test_a_fall_ends_the_run_and_is_told():
    unsteady = replace(
        ROBOT, hop_limit_s=0.5
    )  # no apex within this time, which counts as a fall
    made = run_task(WatchedHopper(unsteady, sight(), TASK, start()), Swings(0.0))
    assert made.outcome.reason == FELL
    assert len(made.stances["time_s"]) == 0


def test_frames_are_kept():
    made = run(Swings(0.3))
    times = np.array([time for time, _ in made.frames])
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)
    assert times[-1] > made.stances["time_s"].iloc[-1]
    assert made.frames[0][1].shape == (4, 3)


def test_the_pure_simulation_follows_the_controller_s_own_predictions(swinging):
    _, made = swinging
    table = simulated(Swings(0.1), TASK, [1.0, 0.0, np.pi], made)
    assert (table["curve"] == "pure").all()
    np.testing.assert_allclose(np.diff(table["x_m"]), 0.05)
    np.testing.assert_allclose(
        table[["x_m", "y_m"]].iloc[0], poses(made, MEASURED)[0, :2]
    )
    assert len(table) == TASK.hops + 1
