import numpy as np
import pytest

from hopdata.config import load_config
from hopdata.steering.control.objectives import ToHeading, ToPoint, errors_left
from hopdata.steering.experiments.tasks import (
    ARRIVED,
    FELL,
    LATE,
    LEFT,
    Task,
    board_for,
    decided,
    draw_starts,
    goal_of,
    judged,
    tasks_of,
)

STAY = Task(manoeuvre="origin", near=0.15, hops=10, stay=0.25, stay_hops=3)
TOUCH = Task(manoeuvre="origin", near=0.2, hops=4)


def way(*errors):
    return np.array(errors, dtype=float)


def test_to_arrive_and_to_stay_is_a_success():
    outcome = judged(STAY, way(1, 0.5, 0.15, 0.2, 0.25, 0.1, 9))
    assert (outcome.success, outcome.hops, outcome.reason) == (True, 2, ARRIVED)


def test_to_leave_after_the_first_arrival_is_none_even_if_it_comes_back():
    outcome = judged(STAY, way(1, 0.1, 0.1, 0.26, 0.1, 0.1, 0.1, 0.1))
    assert (outcome.success, outcome.hops, outcome.reason) == (False, 1, LEFT)


def test_the_last_hop_counts_and_the_next_does_not():
    assert judged(TOUCH, way(1, 1, 1, 1, 0.2)).hops == 4
    assert judged(TOUCH, way(1, 1, 1, 1, 1, 0.1)).reason == LATE


def test_a_fall_is_told_before_and_after_the_arrival():
    assert judged(STAY, way(1, 0.5), fell=True).reason == FELL
    assert judged(STAY, way(1, 0.1, 0.1), fell=True).reason == FELL
    assert not judged(STAY, way(1, 0.1, 0.1), fell=True).success


@pytest.mark.parametrize("task", [STAY, TOUCH])
def test_a_run_is_over_when_nothing_can_change_its_outcome(task):
    rng = np.random.default_rng(np.random.SeedSequence(3))
    for _ in range(200):
        errors = rng.uniform(0, 0.6, task.most_hops + 3)
        ends = next(n for n in range(1, len(errors) + 1) if decided(task, errors[:n]))
        assert ends <= task.most_hops + 1
        assert judged(task, errors[:ends]) == judged(task, errors)


def test_errors_are_distances_or_what_is_left_of_half_a_turn():
    start = np.array([0.0, 0.0, 2.0])
    poses = np.array([[3.0, 4.0, 2.0], [0.0, 0.0, 2.0 + np.pi], [0.0, 0.0, 1.9 - np.pi]])
    np.testing.assert_allclose(errors_left(goal_of("origin", start), poses), [5, 0, 0])
    np.testing.assert_allclose(
        errors_left(goal_of("turn", start), poses), [np.pi, 0, 0.1], atol=1e-12
    )


def test_goals_are_what_errors_are_measured_to():
    start = np.array([0.0, 0.0, 2.0])
    assert goal_of("origin", start) == ToPoint(point_m=(0.0, 0.0))
    goal = goal_of("turn", start)
    assert isinstance(goal, ToHeading)
    assert goal.heading_rad == pytest.approx(2.0 - np.pi)


def test_the_board_stands_across_the_way_and_is_met_after_the_distance_asked_for():
    board = board_for("origin", [0.0, 1.0, 0.3], drag_n=4.0, ahead_m=0.25)
    np.testing.assert_allclose(board.direction, [0, -1], atol=1e-12)
    touching = np.array([0.0, 0.75])
    assert touching @ board.direction + board.reach_m == pytest.approx(board.place_m)
    turn = board_for("turn", [0.0, 0.0, 0.3], drag_n=4.0, ahead_m=0.25)
    np.testing.assert_allclose(turn.direction, [np.cos(0.3), np.sin(0.3)])
    assert turn.place_m == pytest.approx(0.25 + turn.reach_m)


def test_the_default_tasks_are_those_of_the_experiments():
    config = load_config("config/config.yaml", check_files=False)
    tasks = tasks_of(config["steering"]["experiments"])
    facing, origin, turn = (
        tasks[key] for key in (("origin", "facing"), ("origin", "any"), ("turn", "any"))
    )
    assert (facing.near, facing.hops, facing.stay_hops) == (0.2, 16, 0)
    assert (origin.near, origin.stay, origin.stay_hops) == (0.15, 0.25, 10)
    assert (turn.hops, turn.near) == (25, pytest.approx(np.radians(15)))


def starts(experiment="origin", heading="any", number=30, seed=7):
    return draw_starts(experiment, heading, number, distance_m=1.0, seed=seed)


def test_starts_lie_at_the_distance_in_all_directions():
    poses = np.array([start.pose for start in starts()])
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 1.0)
    assert len(np.unique(np.floor(np.arctan2(poses[:, 1], poses[:, 0]) / (np.pi / 2)))) == 4
    assert len(np.unique(np.floor(poses[:, 2] / (np.pi / 2)))) == 4


def test_to_face_the_origin_is_to_look_at_it():
    for start in starts(heading="facing"):
        x, y, heading = start.pose
        np.testing.assert_allclose([x + np.cos(heading), y + np.sin(heading)], 0, atol=1e-12)


def test_turns_begin_at_the_origin():
    assert all(tuple(start.pose[:2]) == (0.0, 0.0) for start in starts("turn"))


def test_more_starts_leave_the_first_ones_as_they_were():
    for few, many in zip(starts(number=5), starts(number=9), strict=False):
        np.testing.assert_array_equal(few.pose, many.pose)


def test_experiments_and_seeds_have_starts_of_their_own():
    drawn = [starts(seed=7), starts(seed=8), starts("origin_board")]
    assert len({start[0].pose.tobytes() for start in drawn}) == 3


def test_the_chance_of_a_start_is_the_same_every_time_and_apart_by_stream():
    start = starts(number=1)[0]
    first = [stream.random() for stream in start.streams()]
    assert first == [stream.random() for stream in start.streams()]
    assert len(set(first)) == 3
