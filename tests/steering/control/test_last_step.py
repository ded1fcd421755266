"""A robot whose speed carries over is predicted and steered by its last step."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.grids import PointGrid
from hopdata.steering.control.last_step import LastStepPlanner
from hopdata.steering.control.planner import planner
from hopdata.steering.models.last_step import SettledModel, with_last_step
from hopdata.steering.models.training import RECOMMENDED, trained_process
from hopdata.steering.robots.interface import Simulation, Stance, excited
from hopdata.steering.strides import NO_POSE, Input, StrideAxes

AXES = StrideAxes(inputs=(Input(name="turn", lower=-0.5, upper=0.5),))
GRID = PointGrid(distances=16, bearings=24, inputs=9)
OPTIONS = replace(RECOMMENDED, restarts=0)


@dataclass(frozen=True)
class Slider:
    """Turns, and slides on: of each step 0.7 is left in the next."""

    kept: float = 0.7
    axes = AXES
    seen_sd = (1e-4, 1e-4, 1e-3)

    def release(self, pose):
        return Stance(0.0, np.asarray(pose, float), np.empty(0), inner=np.zeros(2))

    def stride(self, stance, inputs, rng):
        turn = inputs[0]
        cos, sin = np.cos(turn), np.sin(turn)
        slid = self.kept * stance.inner + [0.03, 0.0]
        slid += 0.002 * rng.standard_normal(2)
        pose = composed(stance.pose, [*slid, turn])
        after = np.array([cos * slid[0] + sin * slid[1], cos * slid[1] - sin * slid[0]])
        return Stance(stance.time_s + 0.5, pose, stance.state, inner=after)


def made(n, *, kept=0.7, seed=1):
    """Return strides, and the inputs that made them."""
    inputs = np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 1))
    return excited(Simulation(Slider(kept), seed=seed), inputs).strides()


@pytest.fixture(scope="module")
def models():
    """Return models with the last step and without."""
    strides = made(100)
    return (
        trained_process(with_last_step(strides).used(), OPTIONS),
        trained_process(strides.used(), OPTIONS),
    )


def test_the_last_step_is_that_before_and_none_after_the_robot_was_put_down():
    strides = made(12)
    found = with_last_step(strides)
    np.testing.assert_array_equal(found.state, strides.change[:-1])
    np.testing.assert_array_equal(found.next_state, found.change)
    time = strides.time_s.copy()
    time[5:] += 2.0
    change = strides.change.copy()
    change[8] = np.nan
    reason = strides.reason.copy()
    reason[8] = NO_POSE
    again = with_last_step(replace(strides, time_s=time, change=change, reason=reason))
    known = np.setdiff1d(np.arange(12), [0, 5, 9])
    np.testing.assert_array_equal(again.time_s, time[known])
    assert len(again.used()) == len(known) - 1


def test_it_explains_what_carries_over(models):
    fresh = with_last_step(made(150, seed=2)).used()
    with_it, without = models
    spread = fresh.change[:, :2].std(axis=0)
    error = with_it.change(fresh.state, fresh.inputs) - fresh.change
    assert (error[:, :2].std(axis=0) < 0.5 * spread).all()
    error = without.change(np.empty((len(fresh), 0)), fresh.inputs) - fresh.change
    assert (error[:, :2].std(axis=0) > 0.7 * spread).any()


def test_a_robot_on_its_way_goes_as_fast_as_it_will(models):
    """Without an input the step goes to 0.03 / (1 - 0.7) m; with many it is shorter."""
    settled = SettledModel(models[0])
    assert settled.axes == AXES
    strides = made(400, seed=3)
    np.testing.assert_allclose(
        settled.last_step[0], strides.change[20:, 0].mean(), rtol=0.1
    )
    # A robot of which nothing carries over has no other steps on its way.
    at_once = made(60, kept=0.0)
    process = trained_process(with_last_step(at_once).used(), OPTIONS)
    found = SettledModel(process).change(np.empty((3, 0)), [[-0.4], [0.0], [0.4]])
    np.testing.assert_allclose(found[:, 0], 0.03, atol=0.004)


def test_the_planner_that_knows_it_predicts_where_it_slides(models):
    with_it, without = models
    robot = Slider()
    missed = {}
    for name in ("knows", "does not"):
        controller = planner(without, grid=GRID)
        if name == "knows":
            controller = planner(SettledModel(with_it), grid=GRID)
            controller = LastStepPlanner(controller, with_it)
        rng = np.random.default_rng(4)
        stance = robot.release([1.0, 0.3, 0.5])
        before = None
        missed[name] = []
        for _ in range(40):
            plan = controller.plan(stance.pose, (), before)
            before = plan.inputs[0]
            stance = robot.stride(stance, before, rng)
            missed[name].append(np.hypot(*(stance.pose - plan.poses[1])[:2]))
    assert np.median(missed["knows"]) < 0.01
    assert np.median(missed["knows"]) < 0.7 * np.median(missed["does not"])


def test_a_missed_stance_keeps_the_last_step_that_was_seen(models):
    known = planner(SettledModel(models[0]), grid=GRID)
    controller = LastStepPlanner(known, models[0])
    controller.plan([0.0, 0.0, 0.0], ())
    first = controller.plan([0.1, 0.0, 0.0], (), [0.0])
    after = controller.plan([0.4, 0.0, 0.0], (), None)
    # It goes on as fast as before, though it was 0.3 m farther than at the last stance.
    steps = [plan.poses[1, 0] - plan.poses[0, 0] for plan in (first, after)]
    assert steps[0] == pytest.approx(steps[1], abs=0.02)


def test_a_model_without_the_last_step_is_refused(models):
    known = planner(models[1], grid=GRID)
    with pytest.raises(ConfigError, match="a model with the last step among its"):
        LastStepPlanner(known, models[1])
