"""The planner: its cost-to-go satisfies Bellman's equation, and it arrives from any heading."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm, random_states, table
from scipy.interpolate import RegularGridInterpolator

from hopdata.errors import ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.adaptive import AdaptivePlanner
from hopdata.steering.control.correction import Correction
from hopdata.steering.control.cost_to_go import DISCOUNT, TOLERANCE
from hopdata.steering.control.grids import SHARPNESS, HeadingGrid, PointGrid
from hopdata.steering.control.interface import PlanningError
from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint, goal_errors
from hopdata.steering.control.planner import planner
from hopdata.steering.control.prediction import predicted_poses
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.stride_table import tabulated

TABLE = table()
COARSE = PointGrid(distances=24, bearings=24, states=16, inputs=9)
COARSE_TURN = HeadingGrid(heading_errors=72, states=24, inputs=9)
START = np.array([-0.9, 0.4, 2.6])


@pytest.fixture(scope="module")
def to_point():
    return planner(TABLE, ToPoint(), grid=COARSE)


@pytest.fixture(scope="module")
def to_heading():
    return planner(TABLE, ToHeading(heading_rad=3.0), grid=COARSE_TURN)


def flown(controller, pose, boom, hops):
    """Return poses of the model itself under a controller."""
    poses = [np.asarray(pose, dtype=float)]
    for _ in range(hops):
        swing = controller.plan(poses[-1], boom).swing_rad
        assert abs(swing) <= LIMIT + 1e-12
        poses.append(predicted_poses(ClosedForm(), poses[-1], boom, [swing])[-1])
        boom += swing
    return np.array(poses)


@pytest.fixture(scope="module")
def certain():
    """Return a planner for hops that end exactly where predicted."""
    return planner(TABLE, ToPoint(), grid=replace(COARSE, scatter=(0.0, 0.0, 0.0)))


def away(distance_m):
    ratio = (distance_m / COARSE.width) ** SHARPNESS
    return ratio / (1 + ratio)


def paid_after(cost, goal, boom):
    """Return the cost after stances with the goal at these places (complex), poses in the world."""
    after = []
    for swing in np.linspace(-LIMIT, LIMIT, COARSE.inputs):
        x, y, turn = TABLE.change(boom, swing)[0]
        turned = np.exp(-1j * turn) * (goal - complex(x, y))
        left = np.stack([turned.real, turned.imag, 0 * turned.real], axis=-1)
        after.append(cost.at(left, np.full((*goal.shape, 1), boom + swing)))
    return np.min(after, axis=0)


def nodes():
    turn = 2 * np.pi * np.arange(COARSE.bearings + 1) / COARSE.bearings - np.pi
    return turn, COARSE.distances_m[:, None] * np.exp(1j * turn)


def test_the_cost_to_go_satisfies_bellman_s_equation(certain):
    """Checked at nodes, for hops that end where predicted."""
    _, goal = nodes()
    for k in (0, 5, 11):
        after = paid_after(certain.cost_to_go, goal, 2 * np.pi * k / COARSE.states)
        expected = away(np.abs(goal)) * (1 + DISCOUNT * after)
        found = certain.cost_to_go.values[..., k]
        np.testing.assert_allclose(found, expected[:, :-1], atol=3 * TOLERANCE)


def test_the_cost_is_an_average_over_where_a_hop_may_end(to_point):
    """Compared with another interpolation: a third of the variance along each axis, both ways."""
    turn, goal = nodes()
    after = paid_after(to_point.cost_to_go, goal, 0.0)
    between = RegularGridInterpolator((np.arange(COARSE.distances), turn), after)
    for i, j in [(0, 3), (4, 0), (9, 17), (15, 22)]:
        paid = []
        for axis, sign in product(range(3), (1, -1)):
            x, y, heading = sign * np.sqrt(3) * np.eye(3)[axis] * COARSE.scatter
            left = (goal[i, j] - complex(x, y)) * np.exp(-1j * heading)
            place = np.interp(
                abs(left), COARSE.distances_m, np.arange(COARSE.distances)
            )
            paid.append(
                away(abs(left)) * (1 + DISCOUNT * between((place, np.angle(left))))
            )
        found = to_point.cost_to_go.values[i, j, 0]
        np.testing.assert_allclose(found, np.mean(paid), rtol=0.02)


def test_the_cost_rises_with_the_distance_of_a_goal_ahead(to_point):
    """This holds from half a metre on; nearer, the hopper does best with the goal still ahead."""
    grid = COARSE
    ahead = to_point.cost_to_go.values[:, grid.bearings // 2].min(axis=-1)
    far = grid.distances_m > 0.5
    assert far.sum() > 5
    assert np.all(np.diff(ahead[far]) > 0)


def test_the_goal_is_reached_from_any_heading(to_point):
    for turn in np.linspace(-np.pi, np.pi, 7):
        poses = flown(to_point, [1.0, 0.0, np.pi + turn], np.pi, 60)
        left = goal_errors(ToPoint(), poses)
        assert left.min() < COARSE.width


def test_the_goal_may_be_anywhere_and_far(to_point):
    """This includes places beyond the grid, and the plan moves with the frame of the pose."""
    move = np.array([5.0, -3.0, 0.7])
    goal = composed(move, np.zeros(3))
    moved = to_point.towards(ToPoint(point_m=(float(goal[0]), float(goal[1]))))
    here, there = to_point.plan(START, 1.0), moved.plan(composed(move, START), 1.0)
    np.testing.assert_allclose(here.swings_rad, there.swings_rad, atol=1e-9)
    assert here.objective == pytest.approx(there.objective)
    far = flown(to_point, [4.5, 0.0, 0.5], np.pi, 90)
    assert goal_errors(ToPoint(), far)[-1] < 1.0


SIZES = [
    [0.006, -0.016, -0.012, -0.073, 0.054, 0.034],
    [-0.01, 0.023, 0.008, -0.017, 0.029, -0.009],
    [-0.049, -0.119, 0.068, -0.015, 0.082, -0.091],
]


class Uneven:
    """A model that moves sideways, and turns with the boom in neutral."""

    axes = hopper_axes(LIMIT)
    next_state = axes.next_state

    def change(self, state, inputs):
        boom_angle = np.ravel(state)
        swing = np.ravel(inputs)
        c, s, one = np.cos(boom_angle), np.sin(boom_angle), np.ones_like(boom_angle)
        waves = np.stack([one, c, s, swing, swing * c, swing * s])
        return (np.array(SIZES) @ waves).T


def test_beyond_the_grid_it_does_not_dawdle():
    """Forty hops of about 7 cm, including the turn at the beginning, from twice as far."""
    uneven = planner(
        tabulated(Uneven(), periodic_nodes=32, linear_nodes=13), grid=COARSE
    )
    for heading in (0.0, 2.0, 4.0):
        pose, boom = np.array([6.0, 0.0, heading]), 1.0
        for _ in range(40):
            plan = uneven.plan(pose, boom)
            pose, boom = plan.poses[1], boom + plan.swing_rad
        assert np.hypot(*pose[:2]) < 4.0


def test_a_heading_is_reached_and_kept(to_heading):
    for heading in (0.0, 1.5, -2.0):
        left = goal_errors(
            to_heading.objective, flown(to_heading, [0, 0, heading], np.pi, 45)
        )
        assert np.all(left[-5:] < COARSE_TURN.width)


def test_more_hops_ahead_do_not_cost_more():
    """The cost of a plan, with the cost-to-go behind it, is close to the cost in the model."""
    grid = replace(
        COARSE, distances=32, bearings=36, states=24, scatter=(0.0, 0.0, 0.0)
    )
    certain = planner(TABLE, ToPoint(), grid=grid)
    two = [
        certain.plan(*state).objective
        for state in zip(*random_states(10, 2), strict=True)
    ]
    three = replace(certain, horizon=Horizon(hops=3))
    more = [
        three.plan(*state).objective
        for state in zip(*random_states(10, 2), strict=True)
    ]
    np.testing.assert_allclose(two, more, rtol=0.01)


def test_the_plan_predicts_where_it_leads(to_point):
    plan = to_point.plan(START, 1.0)
    np.testing.assert_allclose(
        plan.poses, predicted_poses(TABLE, START, 1.0, plan.swings_rad)
    )
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


# A planner that goes on learning, with a plant that has turned by itself since it was
# learned.

NOISE, BIAS = np.array([2e-3, 2e-3, 1e-2]), np.array([0.0, 0.01, -0.09])


def flown_changed(controller, hops, bias=BIAS, seed=0):
    """Return errors at the stances of the changed plant, and prediction errors of its heading."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    pose, boom, swung, errors, missed = START, 3.0, None, [], []
    for _ in range(hops):
        plan = controller.plan(pose, boom, swung)
        swung = plan.swing_rad
        chance = bias + NOISE * rng.standard_normal(3)
        pose = composed(pose, ClosedForm().change(boom, swung)[0] + chance)
        boom += swung
        errors.append(float(goal_errors(ToPoint(), pose)))
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
    """Return what random swings teach about a plant that deviates from its map by `bias`."""
    rng = np.random.default_rng(np.random.SeedSequence(hops))
    correction = correction or Correction(hopper_axes(LIMIT), NOISE)
    for point in rng.uniform([0.0, -LIMIT], [2 * np.pi, LIMIT], (hops, 2)):
        correction.learn(point, bias + NOISE * rng.standard_normal(3))
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
    correction = Correction(hopper_axes(LIMIT), NOISE)
    point = np.array([1.0, 0.2])
    for _ in range(40):
        correction.learn(point, np.zeros(3))
    correction.learn(point, np.array([0.5, 0.5, 1.5]))
    assert abs(correction.added(correction.functions(point))[2]) < 1.5 / 20


def test_a_first_stance_teaches_nothing(to_point):
    adaptive = AdaptivePlanner(to_point, NOISE)
    adaptive.plan(START, 3.0, None)
    adaptive.plan(START + 1.0, 3.0, None)
    assert not adaptive.correction.coefficients.any()
