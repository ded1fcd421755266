from functools import cache

import numpy as np
import pytest
from steered_hops import chained_hops

from hopdata.config.loading import load_config
from hopdata.steering.control.objectives import ToHeading, ToPoint, goal_errors
from hopdata.steering.experiments.study import board_for
from hopdata.steering.experiments.tasks import (
    ARRIVED,
    FELL,
    LATE,
    UNTOUCHED,
    Task,
    decided,
    draw_starts,
    goal_of,
    judged,
    policies,
    progress_of,
    task_of,
)
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.stride_table import StrideTable
from hopdata.steering.models.training import trained_process

TOUCH = Task(manoeuvre="origin", near=0.2, hops=4)


def test_the_first_arrival_counts():
    outcome = judged(TOUCH, [1, 0.5, 0.2, 0.1])
    assert (outcome.success, outcome.hops, outcome.reason) == (True, 2, ARRIVED)


def test_the_last_hop_counts_and_the_next_does_not():
    assert judged(TOUCH, [1, 1, 1, 1, 0.2]).hops == 4
    assert judged(TOUCH, [1, 1, 1, 1, 1, 0.1]).reason == LATE


def test_a_fall_is_told():
    assert judged(TOUCH, [1, 0.5], fell=True).reason == FELL


def test_who_never_touched_the_board_was_not_impeded_and_does_not_count():
    outcome = judged(TOUCH, [1, 0.1], touched=False)
    assert (outcome.success, outcome.hops, outcome.reason) == (False, 1, UNTOUCHED)


def test_a_run_is_over_when_nothing_can_change_its_outcome():
    rng = np.random.default_rng(np.random.SeedSequence(3))
    for _ in range(200):
        errors = rng.uniform(0, 0.6, TOUCH.hops + 3).tolist()
        ends = next(n for n in range(1, len(errors) + 1) if decided(TOUCH, errors[:n]))
        assert ends <= TOUCH.hops + 1
        assert judged(TOUCH, errors[:ends]) == judged(TOUCH, errors)


def test_errors_are_distances_or_what_is_left_of_half_a_turn():
    start = np.array([0.0, 0.0, 2.0])
    poses = np.array(
        [[3.0, 4.0, 2.0], [0.0, 0.0, 2.0 + np.pi], [0.0, 0.0, 1.9 - np.pi]]
    )
    np.testing.assert_allclose(goal_errors(goal_of("origin", start), poses), [5, 0, 0])
    np.testing.assert_allclose(
        goal_errors(goal_of("turn", start), poses), [np.pi, 0, 0.1], atol=1e-12
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
    options = load_config("config/config.yaml", check_files=False)["steering"][
        "experiments"
    ]
    origin, turn = task_of(options, "origin"), task_of(options, "turn")
    assert (origin.near, origin.hops) == (0.11, 50)
    assert (turn.hops, turn.near) == (25, pytest.approx(np.radians(15)))


def starts(experiment="origin", number=30, seed=7):
    return draw_starts(
        experiment, number, distance_m=1.0, seed=np.random.SeedSequence(seed)
    )


def test_starts_lie_at_the_distance_in_all_directions():
    poses = np.array([start.pose for start in starts()])
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 1.0)
    assert (
        len(np.unique(np.floor(np.arctan2(poses[:, 1], poses[:, 0]) / (np.pi / 2))))
        == 4
    )
    assert len(np.unique(np.floor(poses[:, 2] / (np.pi / 2)))) == 4


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
    assert len(set(first)) == 5


LIMIT = 1.0
TRUTH = np.full((8, 5, 3), 0.05)


@cache
def chained_process():
    return trained_process(chained_hops(20, noise=np.full(3, 1e-2)))


def test_way_points_are_a_task_with_hops_for_each_and_progress_along_them():
    options = load_config("config/config.yaml", check_files=False)["steering"]
    given = options["experiments"] | {"waypoints_m": [[0.5, 0.0], [0.5, 1.0]]}
    task = task_of(given, "waypoints")
    assert task.hops == 2 * given["hops"]
    assert task.way_points.arrival_m == given["arrived_m"]
    error_at = progress_of(task, np.zeros(3))
    assert error_at((0.0, 0.0, 0.0)) == pytest.approx(1.5)
    last = error_at((0.5, 1.0, 0.0))
    assert last == pytest.approx(2.0), "the second before the first is no arrival"
    assert not decided(task, [last])
    assert error_at((0.5, 0.05, 0.0)) == pytest.approx(0.95)
    assert decided(task, [error_at((0.45, 1.0, 0.0))])
    assert draw_starts("waypoints", 1, distance_m=1.0, seed=np.random.SeedSequence(1))[
        0
    ].pose[:2].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", ["printed", "planner"])
def test_every_controller_that_plans_follows_way_points(name):
    options = {"horizon": 1, "planner_horizon": 1}
    task = Task(
        manoeuvre="waypoints", near=0.1, hops=9, points_m=((0.5, 0.0), (0.5, 1.0))
    )
    policy = policies(
        [name],
        options,
        task,
        model=chained_process(),
        truth=TRUTH,
        swing_limit_rad=LIMIT,
    )[name]
    start = starts("waypoints", 1)[0]
    follower, another = policy(start), policy(start)
    follower.plan((0.5, 0.05, 0.0), 1.0)
    assert (follower.visited, another.visited) == (1, 0)


def test_random_swings_and_none_heed_nothing_and_are_the_same_again():
    names = ["random", "none"]
    options = {"horizon": 3, "planner_horizon": 2}
    model = StrideTable.evenly_spaced(hopper_axes(LIMIT), TRUTH)
    task = Task(manoeuvre="turn", near=0.3, hops=25)
    made = policies(
        names, options, task, model=model, truth=TRUTH, swing_limit_rad=LIMIT
    )
    start = starts("turn", 1)[0]
    random, again = (made["random"](start) for _ in range(2))
    swings = [random.plan(start.pose, 3.0).swing_rad for _ in range(50)]
    assert swings == [again.plan(start.pose, 1.0).swing_rad for _ in range(50)]
    assert 0.8 < np.ptp(swings) / (2 * LIMIT) <= 1.0
    assert made["none"](start).plan(start.pose, 3.0).swing_rad == 0.0
