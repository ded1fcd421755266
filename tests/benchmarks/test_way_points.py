import numpy as np
import pytest
from control_models import table
from live_loop import WayPointFollower, WayPoints

from hopdata.steering.control.objectives import PlanningError, ToPoint, goal_errors
from hopdata.steering.control.planner import PointGrid, planner
from hopdata.steering.control.printed import predicted_poses

MODEL = table()


@pytest.fixture(scope="module")
def to_point():
    grid = PointGrid(distances=24, bearings=24, boom_angles=16, swings=9)
    return planner(MODEL, ToPoint(), grid=grid)


def test_way_points_are_visited_in_order(to_point):
    points = ((0.6, 0.0), (0.6, 0.7), (0.0, 0.3))
    follower = WayPointFollower(to_point, WayPoints(points_m=points))
    poses, boom = [np.zeros(3)], np.pi
    for _ in range(120):
        swing = follower.plan(poses[-1], boom).swing_rad
        poses.append(predicted_poses(MODEL, poses[-1], boom, [swing])[-1])
        boom += swing
    assert follower.visited == 3
    left = [goal_errors(ToPoint(point_m=point), poses) for point in points[:2]]
    first = [int(np.argmax(one <= 0.15)) for one in left]
    assert 0 < first[0] < first[1]


def test_a_state_that_is_none_is_no_visit(to_point):
    follower = WayPointFollower(to_point, WayPoints(points_m=((0.0, 0.0),)))
    with pytest.raises(PlanningError):
        follower.plan([np.nan, 0.0, 0.0], 0.0)
    assert follower.visited == 0
