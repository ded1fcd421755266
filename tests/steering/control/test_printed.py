"""The printed controller: its rollout, its gradient, its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm, random_states

from hopdata.errors import ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.objectives import (
    Horizon,
    PlanningError,
    ToHeading,
    ToPoint,
    objective_value,
)
from hopdata.steering.control.printed import (
    PrintedController,
    objective_and_gradient,
    predicted_poses,
)

MODEL = ClosedForm()
OBJECTIVES = [
    ToPoint(point_m=(0.3, -0.2)),
    ToPoint(penalty="square", stances="last"),
    ToHeading(heading_rad=2.0),
    ToHeading(heading_rad=2.0, penalty="square"),
]


def test_a_rollout_composes_the_frame_changes():
    poses = predicted_poses(MODEL, np.array([0.1, 0.2, 3.0]), 1.0, np.array([0.5, -0.2]))
    first = composed([0.1, 0.2, 3.0], MODEL.change(1.0, 0.5))
    np.testing.assert_allclose(poses[1], first)
    np.testing.assert_allclose(poses[2], composed(first, MODEL.change(1.5, -0.2)))


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_gradient_is_that_of_the_value(objective):
    poses, booms = random_states(5, 1)
    for pose, boom in zip(poses, booms, strict=True):
        swings = np.array([0.3, -0.4, 0.2])
        value, gradient = objective_and_gradient(MODEL, objective, pose, boom, swings)
        assert value == objective_value(objective, predicted_poses(MODEL, pose, boom, swings)[1:])
        for k, step in enumerate(1e-6 * np.eye(3)):
            up, down = (
                objective_and_gradient(MODEL, objective, pose, boom, swings + side * step)[0]
                for side in (1, -1)
            )
            assert gradient[k] == pytest.approx((up - down) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("gradient", ["numerical", "closed form"])
def test_the_plan_is_a_minimum_within_the_bounds(gradient):
    controller = PrintedController(model=MODEL, gradient=gradient)
    plan = controller.plan([0.5, 0.3, 0.2], 1.0)
    assert plan.status == "solved"
    assert np.all(np.abs(plan.swings_rad) <= LIMIT)
    assert plan.objective == pytest.approx(objective_value(ToPoint(), plan.poses[1:]))
    rng = np.random.default_rng(np.random.SeedSequence(2))
    for beside in plan.swings_rad + 0.05 * rng.standard_normal((50, 3)):
        swings = np.clip(beside, -LIMIT, LIMIT)
        poses = predicted_poses(MODEL, np.array([0.5, 0.3, 0.2]), 1.0, swings)
        assert objective_value(ToPoint(), poses[1:]) >= plan.objective - 1e-5


def test_horizon_and_limit_are_kept():
    horizon = Horizon(hops=5, swing_limit_rad=0.3)
    plan = PrintedController(model=MODEL, horizon=horizon).plan([0.5, 0.3, 0.2], 1.0)
    assert plan.poses.shape == (6, 3)
    assert np.abs(plan.swings_rad).max() == pytest.approx(0.3)


@pytest.mark.parametrize("pose", [[np.nan, 0, 0], [0, np.inf, 0], [0, 0], None, "here"])
def test_a_pose_that_is_none_is_refused(pose):
    with pytest.raises(PlanningError, match="plan: expected a pose of three"):
        PrintedController(model=MODEL).plan(pose, 0.0)


def test_a_boom_angle_that_is_none_is_refused():
    with pytest.raises(PlanningError, match="expected a finite boom angle, found nan"):
        PrintedController(model=MODEL).plan([0, 0, 0], np.nan)


def test_an_unknown_gradient_is_refused():
    with pytest.raises(ConfigError, match="gradient: expected one of"):
        PrintedController(model=MODEL, gradient="exact")


def test_an_unknown_start_is_refused():
    with pytest.raises(ConfigError, match="start: expected one of several, previous swing"):
        PrintedController(model=MODEL, start="home")


def test_the_search_begins_where_it_is_told():
    """With no step of the search allowed to help, the start is what comes out."""
    flat = Flat()
    again = PrintedController(model=flat, gradient="closed form", start="previous swing")
    np.testing.assert_array_equal(again.plan(np.ones(3), 2.0, 0.7).swings_rad, np.full(3, 0.7))
    rest = PrintedController(model=flat, gradient="closed form", start="rest")
    np.testing.assert_array_equal(rest.plan(np.ones(3), 2.0, 0.7).swings_rad, np.zeros(3))
    for none in (None, 0.0, np.nan):
        first = again.plan(np.ones(3), 2.0, none)
        np.testing.assert_array_equal(first.swings_rad, np.full(3, Horizon().swing_limit_rad / 2))


def test_a_search_from_several_starts_finds_the_better_of_two_dips():
    """The goal lies to the left or to the right, and the search cannot cross the ridge between."""
    for side in (1.0, -1.0):
        controller = PrintedController(model=Ridge(side), horizon=Horizon(hops=1))
        assert np.sign(controller.plan([-1.0, 0.0, 0.0], 0.0).swing_rad) == side
    once = replace(controller, start="previous swing")
    assert once.plan([-1.0, 0.0, 0.0], 0.0, 0.5).swing_rad > 0


def test_the_last_swing_is_a_start_beside_the_three_that_are_fixed():
    """Both kinds of starts are searched; one that is there already is not searched twice."""
    asked = Asked()
    controller = PrintedController(model=asked, gradient="closed form", horizon=Horizon(hops=1))
    limit = controller.horizon.swing_limit_rad
    controller.plan(np.ones(3), 2.0, 0.3)
    np.testing.assert_array_equal(asked.swings, [limit / 2, 0.0, -limit / 2, 0.3])
    asked.swings.clear()
    controller.plan(np.ones(3), 2.0)
    np.testing.assert_array_equal(asked.swings, [limit / 2, 0.0, -limit / 2])


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_several_starts_find_no_worse_a_plan_than_any_one_of_them(objective):
    controller = PrintedController(model=MODEL, objective=objective, gradient="closed form")
    poses, booms = random_states(10, 4)
    for pose, boom, swing in zip(poses, booms, np.linspace(-LIMIT, LIMIT, 10), strict=True):
        several = controller.plan(pose, boom, swing).objective
        rest = replace(controller, start="rest").plan(pose, boom, swing)
        # With half the limit as the last swing, the single start is one of the fixed three.
        singles = [
            replace(controller, start="previous swing").plan(pose, boom, again)
            for again in (swing, *np.array([0.5, -0.5]) * controller.horizon.swing_limit_rad)
        ]
        assert several == min(one.objective for one in (rest, *singles))


class Ridge:
    """A hopper that goes ahead if the boom swings to either side, farther if to `side`."""

    def __init__(self, side):
        self.side = side

    def change(self, _boom_angle, swing):
        ahead = 0.1 * swing**2 + 0.02 * self.side * swing
        return np.column_stack([ahead, 0 * ahead, 0 * ahead])


class Asked:
    """A hopper that never moves, and remembers the swings that it was asked for a slope at."""

    def __init__(self):
        self.swings = []

    def change(self, boom_angle, _swing):
        return np.zeros((len(boom_angle), 3))

    def change_and_gradient(self, boom_angle, swing):
        self.swings.append(float(swing[0]))
        return np.zeros((len(boom_angle), 3)), np.zeros((len(boom_angle), 3, 2))


class Flat:
    """A hopper that never moves, whatever the boom does."""

    def change(self, boom_angle, _swing):
        return np.zeros((len(boom_angle), 3))

    def change_and_gradient(self, boom_angle, _swing):
        return np.zeros((len(boom_angle), 3)), np.zeros((len(boom_angle), 3, 2))


def test_a_previous_swing_that_is_not_known_is_none_at_all():
    controller = PrintedController(model=MODEL, horizon=Horizon(swing_limit_rad=LIMIT))
    plans = [controller.plan([0.3, 0.1, 1.0], 2.0, swing).swings_rad for swing in (None, np.nan)]
    assert np.isfinite(plans[0]).all()
    np.testing.assert_array_equal(plans[0], plans[1])
