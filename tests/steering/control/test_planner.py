"""The planner: its cost-to-go satisfies Bellman's equation, and it gets there from any heading."""

from dataclasses import replace

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm, random_states, table

from hopdata.errors import ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.objectives import (
    Horizon,
    PlanningError,
    ToHeading,
    ToPoint,
    errors_left,
)
from hopdata.steering.control.planner import (
    DISCOUNT,
    TOLERANCE,
    AdaptivePlanner,
    HeadingGrid,
    PointGrid,
    planner,
)
from hopdata.steering.control.printed import predicted_poses
from hopdata.steering.models.tabulated import Correction

TABLE = table()
COARSE = PointGrid(distances=24, bearings=24, boom_angles=16, swings=9)
COARSE_TURN = HeadingGrid(heading_errors=72, boom_angles=24, swings=9)
START = np.array([-0.9, 0.4, 2.6])


@pytest.fixture(scope="module")
def to_point():
    return planner(TABLE, ToPoint(), grid=COARSE)


@pytest.fixture(scope="module")
def to_heading():
    return planner(TABLE, ToHeading(heading_rad=3.0), grid=COARSE_TURN)


def flown(controller, pose, boom, hops):
    """Poses of the model itself under a controller."""
    poses = [np.asarray(pose, dtype=float)]
    for _ in range(hops):
        swing = controller.plan(poses[-1], boom).swing_rad
        assert abs(swing) <= LIMIT + 1e-12
        poses.append(predicted_poses(ClosedForm(), poses[-1], boom, [swing])[-1])
        boom += swing
    return np.array(poses)


def test_the_cost_to_go_satisfies_bellman_s_equation(to_point):
    """At nodes, against poses composed in the world."""
    cost, grid = to_point.cost_to_go, COARSE
    distances = grid.distances_m
    swings = np.linspace(-LIMIT, LIMIT, grid.swings)
    rng = np.random.default_rng(np.random.SeedSequence(1))
    for _ in range(20):
        i, j, k = (int(rng.integers(n)) for n in cost.values.shape)
        bearing, boom = -np.pi + 2 * np.pi * j / grid.bearings, 2 * np.pi * k / grid.boom_angles
        goal = distances[i] * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        after = []
        for swing in swings:
            x, y, turn = TABLE.change(boom, swing)[0]
            turned = np.exp(-1j * turn) * complex(goal[0] - x, goal[1] - y)
            left = np.array([[turned.real, turned.imag, 0.0]])
            ahead = cost.ahead(left, [boom + swing])[0]
            now = abs(turned) ** 2 / (abs(turned) ** 2 + grid.width**2)
            after.append(now + DISCOUNT * ahead)
        assert cost.values[i, j, k] == pytest.approx(min(after), abs=3 * TOLERANCE)


def test_the_cost_rises_with_the_distance_of_a_goal_ahead(to_point):
    """From half a metre on; nearer by, the hopper is best off with the goal still ahead of it."""
    grid = COARSE
    ahead = to_point.cost_to_go.values[:, grid.bearings // 2].min(axis=-1)
    far = grid.distances_m > 0.5
    assert far.sum() > 5
    assert np.all(np.diff(ahead[far]) > 0)


def test_the_goal_is_reached_from_any_heading(to_point):
    for turn in np.linspace(-np.pi, np.pi, 7):
        poses = flown(to_point, [1.0, 0.0, np.pi + turn], np.pi, 60)
        left = errors_left(ToPoint(), poses)
        assert left.min() < 0.15
        first = int(np.argmax(left < 0.15))
        assert np.all(left[first : first + 6] < 0.3)


def test_the_goal_may_be_anywhere_and_far(to_point):
    """Beyond the grid, too, and the plan moves with the frame it is told in."""
    move = np.array([5.0, -3.0, 0.7])
    goal = composed(move, np.zeros(3))
    moved = to_point.towards(ToPoint(point_m=(float(goal[0]), float(goal[1]))))
    here, there = to_point.plan(START, 1.0), moved.plan(composed(move, START), 1.0)
    np.testing.assert_allclose(here.swings_rad, there.swings_rad, atol=1e-9)
    assert here.objective == pytest.approx(there.objective)
    far = flown(to_point, [4.5, 0.0, 0.5], np.pi, 90)
    assert errors_left(ToPoint(), far)[-1] < 1.0


def test_a_heading_is_reached_and_kept(to_heading):
    for heading in (0.0, 1.5, -2.0):
        left = errors_left(to_heading.objective, flown(to_heading, [0, 0, heading], np.pi, 45))
        assert np.all(left[-5:] < 0.15)


def test_more_hops_ahead_do_not_cost_more(to_point):
    """What a plan costs with the cost-to-go behind it is near to what the model then pays."""
    two = [to_point.plan(*state).objective for state in zip(*random_states(10, 2), strict=True)]
    three = replace(to_point, horizon=Horizon(hops=3))
    more = [three.plan(*state).objective for state in zip(*random_states(10, 2), strict=True)]
    np.testing.assert_allclose(two, more, rtol=0.01)


def test_the_plan_predicts_where_it_leads(to_point):
    plan = to_point.plan(START, 1.0)
    np.testing.assert_allclose(plan.poses, predicted_poses(TABLE, START, 1.0, plan.swings_rad))
    assert plan.swing_rad == plan.swings_rad[0]


def test_an_objective_of_the_other_kind_gets_a_cost_to_go_of_its_own(to_heading):
    other = to_heading.towards(ToPoint())
    assert other.cost_to_go.values.shape == (40, 48, 32)


def test_a_state_that_is_none_is_refused(to_point):
    with pytest.raises(PlanningError, match="pose of three finite numbers"):
        to_point.plan([np.nan, 0.0, 0.0], 0.0)
    with pytest.raises(PlanningError, match="pose within 10000 m"):
        to_point.plan([1e300, 0.0, 0.0], 0.0)


def test_a_horizon_that_cannot_be_searched_is_refused():
    with pytest.raises(ConfigError, match="hops: expected one of"):
        planner(TABLE, horizon=Horizon(hops=4))


# A planner that goes on learning, on a plant that turns by itself since it was learned.

NOISE, BIAS = np.array([2e-3, 2e-3, 1e-2]), np.array([0.0, 0.01, -0.09])


def flown_changed(controller, hops, bias=BIAS, seed=0):
    """Errors at the stances of the changed plant, and by how much each stance was not foretold."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    pose, boom, swung, errors, missed = START, 3.0, None, [], []
    for _ in range(hops):
        plan = controller.plan(pose, boom, swung)
        swung = plan.swing_rad
        chance = bias + NOISE * rng.standard_normal(3)
        pose = composed(pose, ClosedForm().change(boom, swung) + chance)
        boom += swung
        errors.append(float(errors_left(ToPoint(), pose)))
        missed.append(abs(pose[2] - plan.poses[1][2]))
    return errors, missed


def test_it_learns_what_has_changed_and_the_planner_as_it_was_does_not(to_point):
    _, missed = flown_changed(to_point, 40)
    assert np.median(missed[20:]) > 0.07
    errors, missed = flown_changed(AdaptivePlanner(to_point, NOISE), 40)
    assert np.median(missed[20:]) < 0.02
    assert min(errors) < 0.11


def test_where_nothing_has_changed_little_is_learned(to_point):
    adaptive = AdaptivePlanner(to_point, NOISE)
    errors, missed = flown_changed(adaptive, 60, bias=np.zeros(3))
    assert np.median(missed) < 0.015
    assert min(errors) < 0.11


def learned(hops, bias, correction=None):
    """What swings at any boom angle teach of a plant that misses its map by `bias`."""
    rng = np.random.default_rng(np.random.SeedSequence(hops))
    correction = correction or Correction(LIMIT, NOISE)
    for boom, swing in rng.uniform([0.0, -LIMIT], [2 * np.pi, LIMIT], (hops, 2)):
        correction.learn(boom, swing, bias + NOISE * rng.standard_normal(3))
    return correction


def test_what_it_remembers_is_bounded():
    found = learned(300, BIAS)
    assert found.coefficients.shape == (15, 3)
    assert np.linalg.eigvalsh(found.covariance).min() > 0
    assert np.all(np.diag(found.covariance) <= np.diag(found._first) + 1e-9)


def test_what_is_not_seen_again_is_forgotten():
    found = learned(40, BIAS)
    before = np.abs(found.coefficients).max()
    assert np.abs(learned(300, np.zeros(3), found).coefficients).max() < 0.3 * before


def test_a_single_disturbed_hop_counts_for_little():
    correction = Correction(LIMIT, NOISE)
    for _ in range(40):
        correction.learn(1.0, 0.2, np.zeros(3))
    correction.learn(1.0, 0.2, np.array([0.5, 0.5, 1.5]))
    assert abs(correction.added(correction.functions(1.0, 0.2))[2]) < 1.5 / 20


def test_a_first_stance_teaches_nothing(to_point):
    adaptive = AdaptivePlanner(to_point, NOISE)
    adaptive.plan(START, 3.0, None)
    adaptive.plan(START + 1.0, 3.0, None)
    assert not adaptive.correction.coefficients.any()
