"""Points are visited in order, by whoever steers."""

from dataclasses import replace

import numpy as np
import pytest
from control_models import table

from hopdata.errors import ConfigError
from hopdata.steering.control.adaptive import AdaptivePlanner
from hopdata.steering.control.grids import PointGrid
from hopdata.steering.control.interface import PlanningError
from hopdata.steering.control.objectives import Horizon, ToPoint, goal_errors
from hopdata.steering.control.planner import planner
from hopdata.steering.control.prediction import predicted_poses
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.control.waypoints import Progress, WayPointFollower, WayPoints

MODEL = table()
POINTS = ((0.6, 0.0), (0.6, 0.7), (0.0, 0.3))
ROUTE = WayPoints(points_m=POINTS)


@pytest.fixture(scope="module")
def to_point():
    grid = PointGrid(distances=24, bearings=24, states=16, inputs=9)
    return planner(MODEL, ToPoint(), grid=grid)


def followed(follower, hops):
    """Return the poses of a hopper that does as the model says."""
    poses, boom, swing = [np.zeros(3)], np.pi, None
    for _ in range(hops):
        swing = follower.plan(poses[-1], boom, swing).swing_rad
        poses.append(predicted_poses(MODEL, poses[-1], boom, [swing])[-1])
        boom += swing
    return poses


def test_way_points_are_visited_in_order(to_point):
    follower = WayPointFollower(to_point, ROUTE)
    poses = followed(follower, 120)
    assert follower.visited == 3
    left = [goal_errors(leg, poses) for leg in ROUTE.legs()[:2]]
    first = [int(np.argmax(one <= 0.15)) for one in left]
    assert 0 < first[0] < first[1]


def test_a_planner_that_learns_keeps_what_it_has_learned_from_point_to_point(to_point):
    adaptive = AdaptivePlanner(to_point, np.full(3, 0.02))
    follower = WayPointFollower(adaptive, ROUTE)
    followed(follower, 30)
    assert follower.visited > 0
    assert follower._controller is adaptive


def test_the_printed_controller_heads_for_the_point_that_is_next():
    printed = PrintedController(model=MODEL, horizon=Horizon())
    follower = WayPointFollower(printed, ROUTE)
    here = (*POINTS[0], 0.4)
    plan = follower.plan(here, 1.0)
    assert follower.visited == 1
    own = replace(printed, objective=ToPoint(point_m=POINTS[1])).plan(here, 1.0)
    np.testing.assert_array_equal(plan.swings_rad, own.swings_rad)


def test_a_state_that_is_none_is_no_visit(to_point):
    follower = WayPointFollower(to_point, WayPoints(points_m=((0.0, 0.0),)))
    with pytest.raises(PlanningError):
        follower.plan([np.nan, 0.0, 0.0], 0.0)
    assert follower.visited == 0


def test_progress_is_the_way_that_is_left():
    progress = Progress(ROUTE)
    rest = 0.7 + np.hypot(0.6, 0.4)
    assert progress((0.0, 0.0, 1.0)) == pytest.approx(0.6 + rest)
    # The last point does not count before the others.
    assert progress((*POINTS[2], 0.0)) > ROUTE.arrival_m
    assert progress((0.6, 0.1, 0.0)) == pytest.approx(0.6 + np.hypot(0.6, 0.4))
    assert progress((0.5, 0.7, 0.0)) == pytest.approx(np.hypot(0.5, 0.4))
    assert progress((0.0, 0.2, 0.0)) == pytest.approx(0.1)
    assert progress.visited == 3


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ((), "at least one point, found 0"),
        (((0.0, np.inf),), "two finite numbers"),
        (((0.0, 0.0), (0.3, 0.0)), "neighbours more than 0.3 m apart, found 0.3 m"),
    ],
)
def test_points_that_are_no_route_are_refused(points, message):
    with pytest.raises(ConfigError, match=message):
        WayPoints(points_m=points)
    assert WayPoints(points_m=((0.0, 0.0), (0.31, 0.0))).lengths_m() == [0.31]
