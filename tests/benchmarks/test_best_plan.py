"""The gradient of the objective, and where searches with it begin."""

from dataclasses import replace

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm, random_states
from steering_setting import GradientController, objective_and_gradient

from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint, objective_value
from hopdata.steering.control.printed import predicted_poses

MODEL = ClosedForm()
OBJECTIVES = [ToPoint(point_m=(0.3, -0.2)), ToHeading(heading_rad=2.0)]


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


def test_the_search_begins_where_it_is_told():
    """With no step of the search allowed to help, the start is what comes out."""
    flat = Flat()
    again = GradientController(model=flat, start="previous swing")
    np.testing.assert_array_equal(again.plan(np.ones(3), 2.0, 0.7).swings_rad, np.full(3, 0.7))
    rest = GradientController(model=flat, start="rest")
    np.testing.assert_array_equal(rest.plan(np.ones(3), 2.0, 0.7).swings_rad, np.zeros(3))
    for none in (None, 0.0, np.nan):
        first = again.plan(np.ones(3), 2.0, none)
        np.testing.assert_array_equal(first.swings_rad, np.full(3, Horizon().swing_limit_rad / 2))


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_several_starts_find_no_worse_a_plan_than_any_one_of_them(objective):
    controller = GradientController(model=MODEL, objective=objective)
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


class Flat:
    """A hopper that never moves, whatever the boom does."""

    def change(self, boom_angle, _swing):
        return np.zeros((len(boom_angle), 3))

    def change_and_gradient(self, boom_angle, _swing):
        return np.zeros((len(boom_angle), 3)), np.zeros((len(boom_angle), 3, 2))
