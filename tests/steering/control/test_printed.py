"""The printed controller: its rollout, its starts, its bounds."""

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm

from hopdata.errors import AnalysisError
from hopdata.rigid import composed
from hopdata.steering.control.interface import PlanningError
from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint, goal_errors
from hopdata.steering.control.prediction import predicted_poses
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.models.stride_table import tabulated

MODEL = ClosedForm()


def test_a_rollout_composes_the_frame_changes():
    poses = predicted_poses(
        MODEL, np.array([0.1, 0.2, 3.0]), 1.0, np.array([0.5, -0.2])
    )
    first = composed([0.1, 0.2, 3.0], MODEL.change(1.0, 0.5)[0])
    np.testing.assert_allclose(poses[1], first)
    np.testing.assert_allclose(poses[2], composed(first, MODEL.change(1.5, -0.2)[0]))


def test_the_plan_is_a_minimum_within_the_bounds():
    controller = PrintedController(model=MODEL)
    plan = controller.plan([0.5, 0.3, 0.2], 1.0)
    assert np.all(np.abs(plan.swings_rad) <= LIMIT)
    assert plan.objective == pytest.approx(goal_errors(ToPoint(), plan.poses[1:]).sum())
    rng = np.random.default_rng(np.random.SeedSequence(2))
    for beside in plan.swings_rad + 0.05 * rng.standard_normal((50, 3)):
        swings = np.clip(beside, -LIMIT, LIMIT)
        poses = predicted_poses(MODEL, np.array([0.5, 0.3, 0.2]), 1.0, swings)
        assert goal_errors(ToPoint(), poses[1:]).sum() >= plan.objective - 1e-5


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


def test_a_search_from_several_starts_finds_the_better_of_two_dips():
    """The goal lies to the left or right, and the search cannot cross the ridge between the two."""
    for side in (1.0, -1.0):
        controller = PrintedController(model=Ridge(side), horizon=Horizon(hops=1))
        assert np.sign(controller.plan([-1.0, 0.0, 0.0], 0.0).swing_rad) == side


class Ridge:
    """A hopper that goes ahead if the boom swings to either side, and farther if to `side`."""

    axes = MODEL.axes
    next_state = axes.next_state

    def __init__(self, side):
        self.side = side

    def change(self, _state, inputs):
        swing = inputs[:, 0]
        ahead = 0.1 * swing**2 + 0.02 * self.side * swing
        return np.column_stack([ahead, 0 * ahead, 0 * ahead])


def test_the_last_swing_is_a_start_beside_the_three_that_are_fixed():
    """Both kinds of starts are searched; a repeated start is searched only once."""
    controller = PrintedController(model=MODEL)
    limit = controller.horizon.swing_limit_rad
    for none in (None, 0.0, np.nan, limit / 2):
        found = controller.first_inputs(none)
        assert found == ((limit / 2,), (0.0,), (-limit / 2,))
    assert controller.first_inputs(0.3)[-1] == (0.3,)
    assert len(controller.first_inputs(0.3)) == 4
    assert controller.first_inputs(-2 * limit)[-1] == (-limit,)


def test_a_previous_swing_that_is_not_known_is_none_at_all():
    controller = PrintedController(model=MODEL, horizon=Horizon(swing_limit_rad=LIMIT))
    plans = [
        controller.plan([0.3, 0.1, 1.0], 2.0, swing).swings_rad
        for swing in (None, np.nan)
    ]
    assert np.isfinite(plans[0]).all()
    np.testing.assert_array_equal(plans[0], plans[1])


TABLE = tabulated(MODEL)


@pytest.mark.parametrize(
    "objective", [ToPoint(point_m=(0.1, -0.2)), ToHeading(heading_rad=2.0)]
)
def test_the_compiled_objective_is_that_of_the_arrays(objective):
    """With the table, values are compiled; with its rows alone, they come from arrays."""
    horizon = Horizon(hops=4, swing_limit_rad=LIMIT)
    rng = np.random.default_rng(np.random.SeedSequence(7))
    for _ in range(50):
        pose = rng.uniform(-6, 6, 3)
        state = rng.uniform(0, 2 * np.pi, 1)
        swings = rng.uniform(-LIMIT, LIMIT, 4)
        # Nodes and ends of the table, where the intervals of the spline meet.
        swings[0] = rng.choice(TABLE.nodes[1])
        steps = np.where(swings > 0, -1e-3, 1e-3)
        compiled, by_arrays = (
            PrintedController(
                model=model, objective=objective, horizon=horizon
            ).values_from(pose, state)(swings, steps)
            for model in (TABLE, Rows())
        )
        np.testing.assert_allclose(compiled, by_arrays, rtol=1e-12, atol=1e-12)
        assert len(set(compiled.tolist())) == 5, "each swing counts"


class Rows:
    """The table as a model of which nothing else is known."""

    axes = TABLE.axes
    next_state = axes.next_state

    def change(self, state, inputs):
        return TABLE.change(state, inputs)


def test_a_search_beyond_the_table_is_refused():
    horizon = Horizon(swing_limit_rad=LIMIT * 1.1)
    with pytest.raises(AnalysisError, match="inputs within"):
        PrintedController(model=TABLE, horizon=horizon).plan(
            [3.0, 0, 0], 0.0, LIMIT * 1.1
        )
