"""The globalised solve against a dense grid and scipy's polish, and its parts."""

import numpy as np
import pytest
from control_models import LIMIT, ClosedForm, random_states, table

from hopdata.errors import ConfigError
from hopdata.steering.control.coarse_kernel import coarse_table, lowest_dips
from hopdata.steering.control.globalised import GlobalisedController, Search
from hopdata.steering.control.objectives import (
    Horizon,
    PlanningError,
    ToHeading,
    ToPoint,
    objective_value,
)
from hopdata.steering.control.printed import objective_and_gradient, predicted_poses
from hopdata.steering.control.reference import reference_objective
from hopdata.steering.control.rollout_kernel import rollout, target_of

TABLE = table()
OBJECTIVES = [
    ToPoint(),
    ToPoint(point_m=(0.2, 0.1), stances="last"),
    ToPoint(penalty="square"),
    ToHeading(heading_rad=1.0),
    ToHeading(heading_rad=-2.0, stances="last"),
    ToHeading(penalty="square"),
]


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_compiled_rollout_is_the_plain_one(objective):
    poses, booms = random_states(5, 3)
    swings, slopes = np.array([0.3, -0.8, 1.0]), np.empty(3)
    path, changes, gradients = np.empty((4, 3)), np.empty((3, 3)), np.empty((3, 3, 2))
    for pose, boom in zip(poses, booms, strict=True):
        value = rollout(
            TABLE.coefficients, LIMIT, pose, boom, swings, target_of(objective), 0.0, path,
            changes, gradients, slopes,
        )  # fmt: skip
        plain, gradient = objective_and_gradient(TABLE, objective, pose, boom, swings)
        assert value == pytest.approx(plain, abs=1e-12)
        np.testing.assert_allclose(slopes, gradient, atol=1e-10)


@pytest.mark.parametrize("hops", [1, 2, 3, 4])
def test_the_table_holds_the_objective_of_each_sequence(hops):
    pose, boom, objective = np.array([0.4, -0.1, 2.0]), 5.0, ToPoint(point_m=(0.1, 0.0))
    values = np.empty(5**hops)
    coarse_table(TABLE.coefficients, LIMIT, pose, boom, 5, hops, target_of(objective), values)
    grid = np.linspace(-LIMIT, LIMIT, 5)
    rng = np.random.default_rng(np.random.SeedSequence(4))
    for place in rng.integers(5**hops, size=20):
        swings = grid[list(np.unravel_index(place, (5,) * hops))]
        poses = predicted_poses(TABLE, pose, boom, swings)
        assert values[place] == pytest.approx(objective_value(objective, poses[1:]), abs=1e-12)


def test_dips_are_found_in_order():
    values = np.array([[3.0, 1.0, 2.0], [4.0, 5.0, 0.5], [0.7, 6.0, 7.0]])
    starts = np.zeros(5, dtype=np.int64)
    assert lowest_dips(values.ravel(), 3, 2, starts) == 3
    np.testing.assert_array_equal(starts[:3], [5, 6, 1])
    starts = np.zeros(2, dtype=np.int64)
    assert lowest_dips(values.ravel(), 3, 2, starts) == 2
    np.testing.assert_array_equal(starts, [5, 6])


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_no_plan_is_worse_than_the_reference(objective):
    controller = GlobalisedController(model=TABLE, objective=objective)
    for reach in (1.0, 0.1):
        for pose, boom in zip(*random_states(10, 5, reach_m=reach), strict=True):
            plan = controller.plan(pose, boom)
            reference = reference_objective(TABLE, objective, Horizon(), pose, boom, swings=31)
            assert plan.objective <= reference + 1e-3
            poses = predicted_poses(TABLE, pose, boom, plan.swings_rad)
            np.testing.assert_allclose(plan.poses, poses, atol=1e-12)
            assert plan.objective == pytest.approx(objective_value(objective, poses[1:]))
            assert np.all(np.abs(plan.swings_rad) <= LIMIT)


@pytest.mark.parametrize("hops", [1, 2, 4, 5, 6])
def test_other_horizons_are_solved_too(hops):
    horizon = Horizon(hops=hops)
    controller = GlobalisedController(model=TABLE, horizon=horizon)
    pose, boom = np.array([-0.3, 0.2, 0.1]), 4.0
    plan = controller.plan(pose, boom)
    assert plan.swings_rad.shape == (hops,)
    rng = np.random.default_rng(np.random.SeedSequence(6))
    tried = [
        objective_value(ToPoint(), predicted_poses(TABLE, pose, boom, swings)[1:])
        for swings in rng.uniform(-LIMIT, LIMIT, (300, hops))
    ]
    assert plan.objective <= min(tried)


def test_any_model_is_tabulated():
    plan = GlobalisedController(model=ClosedForm()).plan([0.5, 0.0, 0.0], 0.0)
    exact = predicted_poses(ClosedForm(), np.array([0.5, 0.0, 0.0]), 0.0, plan.swings_rad)
    np.testing.assert_allclose(plan.poses, exact, atol=1e-5)


def test_turns_and_whole_turns_of_the_boom_do_not_matter():
    controller = GlobalisedController(model=TABLE)
    here = controller.plan([0.5, 0.1, 0.3], 1.0)
    same = controller.plan([0.5, 0.1, 0.3 + 2 * np.pi], 1.0 - 4 * np.pi)
    np.testing.assert_allclose(here.swings_rad, same.swings_rad, atol=1e-6)


def test_a_state_that_is_none_is_refused():
    with pytest.raises(PlanningError, match="pose of three finite numbers"):
        GlobalisedController(model=TABLE).plan([0.0, np.nan, 0.0], 0.0)


def test_a_search_needs_a_middle():
    with pytest.raises(ConfigError, match="swings: expected an odd number"):
        Search(swings=4)
