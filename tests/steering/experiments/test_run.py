"""A run through motion capture: what the controller receives, and what is recorded."""

from dataclasses import replace

import numpy as np
import pytest
from seen_hopper import ROBOT, Swings, gaps, sight, start

from hopdata.rigid import wrapped
from hopdata.steering.control.interface import PlanningError
from hopdata.steering.experiments.run import (
    MEASURED,
    PREDICTED,
    RUN_RTOL,
    WatchedHopper,
    run_task,
)
from hopdata.steering.experiments.study import board_for, simulated
from hopdata.steering.experiments.tasks import FELL, Task
from hopdata.steering.live.clocked import Transport
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
    first, *swung = [told[2] for told in controller.told[:3]]
    assert first is None
    assert swung == pytest.approx([0.4, -0.7], abs=0.02), "measured swings"


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
    assert made.blind >= unseen.sum() > 0, "or the boom was not seen"
    assert made.rests > 0
    swings = made.stances["swing_rad"]
    assert (swings[unseen] == 0).all()
    assert ((swings == 0) | (swings == 0.5)).all()
    assert (swings == 0).sum() >= made.blind, "some rests come after the command"
    is_known = ~np.isnan(poses(made, PREDICTED)[1:, 0])
    np.testing.assert_array_equal(is_known, swings[:-1] != 0)
    assert np.isfinite(poses(made, POSE)).all()


@pytest.mark.parametrize(
    "transport", [Transport(delay_s=0.15), Transport(lost_share=0.2)]
)
def test_delays_and_losses_that_leave_time_change_no_swing(transport, swinging):
    made = run(Swings(0.4, -0.7, 0.2), replace(sight(), transport=transport))
    assert made.blind == made.late_commands == 0
    usual = swinging[1].stances["swing_rad"]
    np.testing.assert_array_equal(made.stances["swing_rad"], usual)
    off = np.abs(poses(made, MEASURED) - poses(made, POSE))[:, :2]
    assert off.max() < 1e-2


def test_a_command_that_comes_in_flight_moves_nothing_in_it():
    late = replace(sight(), transport=Transport(delay_s=0.4))
    controller = Swings(0.4, -0.7, 0.2)
    made = run(controller, late)
    assert len(controller.told) == made.late_commands > 0
    assert made.stances["swing_rad"].iloc[0] == 0
    assert np.isnan(poses(made, PREDICTED)).all()
    assert len(made.stances) == TASK.hops + 1


def test_what_is_wrong_in_a_controller_ends_the_run():
    class Wrong:
        def plan(self, *_):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(Wrong())


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


@pytest.mark.parametrize("is_impeded", [False, True])
def test_the_integrator_errs_far_less_than_the_cameras(monkeypatch, is_impeded):
    def true_poses(rtol):
        monkeypatch.setattr("hopdata.steering.experiments.run.RUN_RTOL", rtol)
        board = None
        if is_impeded:
            board = board_for("origin", start().pose, drag_n=4.0, ahead_m=-0.3)
        made = run(Swings(0.4, -0.7, 0.2), board=board)
        assert bool(made.stances["touched"].any()) == is_impeded
        return poses(made, POSE)

    exact = true_poses(1e-12)
    assert np.abs(true_poses(RUN_RTOL) - exact).max() < 1e-4 * sight().camera.noise_m
    assert np.abs(true_poses(1e-3) - exact).max() > 1e-4 * sight().camera.noise_m
