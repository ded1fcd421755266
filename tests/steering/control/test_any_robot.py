"""Controllers of robots that are not the hopper: no state, a linear one, two inputs."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from control_models import LIMIT, table

from hopdata.errors import AnalysisError, ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.adaptive import AdaptivePlanner
from hopdata.steering.control.correction import Correction
from hopdata.steering.control.cost_to_go import DISCOUNT, TOLERANCE
from hopdata.steering.control.grids import (
    SHARPNESS,
    HeadingGrid,
    PointGrid,
    coarse,
    state_nodes,
)
from hopdata.steering.control.interface import PlanningError
from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint, goal_errors
from hopdata.steering.control.planner import _warn_of_time, planner
from hopdata.steering.control.prediction import poses_ahead
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.models.stride_table import StrideTable, tabulated
from hopdata.steering.strides import Input, State, StrideAxes

TURN = Input(name="turn", lower=-0.5, upper=0.7)
COARSE = PointGrid(distances=24, bearings=24, states=12, inputs=9, scatter=(0, 0, 0))


class Unicycle:
    """Rolls ahead and turns; it has no state."""

    axes = StrideAxes(inputs=(TURN,))

    def change(self, _state, inputs):
        turn = inputs[:, 0]
        return np.column_stack([0.1 + 0 * turn, 0.02 * turn, turn])

    def next_state(self, state, inputs):
        return self.axes.next_state(state, inputs)


class Pacing(Unicycle):
    """Rolls as far as it is told, too: two inputs."""

    axes = StrideAxes(inputs=(Input(name="pace", unit="m", lower=0.0, upper=0.1), TURN))

    def change(self, _state, inputs):
        return (
            super().change(None, inputs[:, 1:]) * [0, 1, 1] + [1, 0, 0] * inputs[:, :1]
        )


@dataclass(frozen=True)
class Glider:
    """Glides along its line with a speed that must be learned; an input pushes it."""

    axes = StrideAxes(
        linear=(State(name="speed", unit="m_s"),),
        inputs=(Input(name="push", unit="", lower=-0.2, upper=0.2),),
    )

    def change(self, state, inputs):
        speed, push = (np.reshape(one, -1) for one in (state, inputs))
        return np.column_stack([0.5 * speed + 0.25 * push, 0 * speed, 0 * speed])

    def next_state(self, state, inputs):
        return 0.6 * np.reshape(state, (-1, 1)) + np.reshape(inputs, (-1, 1))


def steps(model, controller, pose, state, strides):
    """Return the poses of the model itself under a controller."""
    poses = [np.asarray(pose, dtype=float)]
    for _ in range(strides):
        plan = controller.plan(poses[-1], state)
        inputs = plan.inputs[:1]
        lower, upper = model.axes.lower, model.axes.upper
        assert np.all((inputs >= lower - 1e-12) & (inputs <= upper + 1e-12))
        change = model.change(np.reshape(state, (1, -1)), inputs)[0]
        np.testing.assert_allclose(
            plan.poses[1], composed(poses[-1], change), atol=1e-6
        )
        if len(state):
            state = model.next_state(state, inputs)[0]
        poses.append(composed(poses[-1], change))
    return np.array(poses)


# The planner.


def test_the_hopper_is_one_robot_of_many():
    """Its plans as of any robot with one angle and one input are those of the hopper."""
    hopper = table(32, 17)
    renamed = StrideAxes(
        periodic=(State(name="arm", moved_by="turn"),),
        inputs=(Input(name="turn", lower=-LIMIT, upper=LIMIT),),
    )
    other = StrideTable(renamed, hopper.nodes, hopper.values)
    grid = PointGrid(distances=12, bearings=12, states=12, inputs=9)
    own, same = (planner(one, ToPoint(), grid=grid) for one in (hopper, other))
    np.testing.assert_allclose(
        own.cost_to_go.values, same.cost_to_go.values, rtol=0, atol=1e-9
    )
    for boom in (0.3, 4.0, 7.0):
        plans = [one.plan((0.7, -0.2, 1.0), boom) for one in (own, same)]
        np.testing.assert_allclose(plans[0].inputs, plans[1].inputs, atol=1e-9)
        assert plans[0].objective == pytest.approx(plans[1].objective, abs=1e-9)


@pytest.mark.parametrize("model", [Unicycle(), Pacing()])
def test_a_robot_without_a_state_reaches_a_point_and_a_heading(model):
    to_point = planner(model, ToPoint(), grid=COARSE)
    assert to_point.cost_to_go.values.shape == (24, 24, 1)
    poses = steps(model, to_point, (0.8, 0.0, 0.4), (), 25)
    assert goal_errors(ToPoint(), poses).min() < COARSE.width
    grid = HeadingGrid(heading_errors=72, inputs=9, scatter=(0, 0, 0.01))
    to_heading = planner(model, ToHeading(heading_rad=2.0), grid=grid)
    poses = steps(model, to_heading, (0.0, 0.0, -1.0), (), 10)
    assert goal_errors(to_heading.objective, poses)[-1] < grid.width


def test_a_learned_linear_state_is_planned_with():
    """It arrives whatever its speed, and knows better than as if it stood still."""
    model = Glider()
    controller = planner(model, ToPoint(), grid=COARSE, state_limits=(-0.5, 0.5))
    for speed in (-0.4, 0.0, 0.4):
        poses = steps(model, controller, (0.8, 0.0, 0.0), (speed,), 20)
        assert goal_errors(ToPoint(), poses).min() < COARSE.width
    toward, away = (
        controller.plan((0.8, 0.0, 0.0), (v,)).objective for v in (-0.4, 0.4)
    )
    assert toward < away - 2


def test_the_cost_to_go_of_a_linear_state_satisfies_bellman_s_equation():
    model = Glider()
    cost = planner(model, ToPoint(), grid=COARSE, state_limits=(-0.5, 0.5)).cost_to_go
    goal = COARSE.nodes()[:, 0]  # straight behind it
    speeds = cost.states.nodes()[:, 0]
    np.testing.assert_array_equal(speeds, np.linspace(-0.5, 0.5, 12))
    for k in (0, 4, 11):
        after = []
        for push in np.linspace(-0.2, 0.2, COARSE.inputs):
            ahead = 0.5 * speeds[k] + 0.25 * push
            left = goal - [ahead, 0.0, 0.0]
            state = np.full((len(goal), 1), 0.6 * speeds[k] + push)
            after.append(cost.at(left, state))
        ratio = (COARSE.distances_m / COARSE.width) ** SHARPNESS
        expected = ratio / (1 + ratio) * (1 + DISCOUNT * np.min(after, axis=0))
        np.testing.assert_allclose(cost.values[:, 0, k], expected, atol=3 * TOLERANCE)


def test_scatter_and_tail_cost_are_those_of_the_robot():
    class Known(Unicycle):
        noise_sd = np.array([0.01, 0.02, 0.03])

    small = PointGrid(distances=8, bearings=8, inputs=5)
    own = planner(tabulated(Known()), ToHeading()).cost_to_go.grid
    assert own.scatter == (0.01, 0.02, 0.03)
    assert planner(Known(), grid=small).cost_to_go.grid == small


def test_few_nodes_beside_a_grid_are_refused():
    with pytest.raises(ConfigError, match="planner: expected no few_nodes beside a"):
        planner(Unicycle(), grid=COARSE, few_nodes=True)
    own = planner(Unicycle(), few_nodes=True).cost_to_go.grid
    assert own.nodes().size < PointGrid().nodes().size


class Double(Glider):
    """Has two states."""

    axes = replace(
        Glider.axes, linear=(*Glider.axes.linear, State(name="sway", unit="m_s"))
    )


class Many(Unicycle):
    """Has three inputs."""

    axes = StrideAxes(inputs=tuple(replace(TURN, name=name) for name in "abc"))


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (
            Double(),
            "planner: expected a robot with at most one state, found speed, sway",
        ),
        (Many(), "planner: expected at most 2 inputs, found a, b, c"),
        (Glider(), "planner: expected the limits of the state speed, as state_limits"),
    ],
)
def test_what_is_not_supported_is_refused_before_the_work(model, message):
    def untouched(*_):
        raise AssertionError

    object.__setattr__(model, "change", untouched)
    with pytest.raises(ConfigError, match=message):
        planner(model)


def test_the_limits_of_a_state_that_an_input_sets_are_the_input_s():
    axes = StrideAxes(linear=(State(name="last", set_by="turn"),), inputs=(TURN,))

    class Lagging(Unicycle):
        def change(self, state, inputs):
            return super().change(None, 0.5 * (state + inputs))

    Lagging.axes = axes
    found = state_nodes(planner(Lagging(), grid=COARSE).model, 5)
    assert (found.lower, found.upper) == (-0.5, 0.7)


@dataclass(frozen=True)
class Slipping(Unicycle):
    """Turns less than it did, and goes aside."""

    def change(self, state, inputs):
        return super().change(state, inputs) * [1, 1, 0.5] + [0, 0.03, 0.15]


def test_an_adaptive_planner_learns_of_any_robot_what_has_changed():
    known = planner(Unicycle(), grid=COARSE)
    changed = Slipping()
    noise = np.array([0.005, 0.005, 0.02])
    missed = {}
    for name in ("as it was", "adaptive"):
        controller = known
        if name == "adaptive":
            controller = AdaptivePlanner(known, noise)
        pose = np.array([0.9, 0.0, 0.3])
        before = None
        missed[name] = []
        for _ in range(30):
            plan = controller.plan(pose, (), before)
            before = plan.inputs[0]
            pose = composed(pose, changed.change(None, plan.inputs[:1])[0])
            missed[name].append(abs(pose[2] - plan.poses[1, 2]))
    assert np.median(missed["as it was"][15:]) > 0.1
    assert np.median(missed["adaptive"][15:]) < 0.02


def test_a_correction_has_functions_of_each_state_and_input():
    axes = StrideAxes(
        periodic=(State(name="arm", moved_by="turn"),),
        linear=Glider.axes.linear,
        inputs=(TURN,),
    )
    correction = Correction(axes, np.full(3, 0.02), [(-0.5, 0.5)])
    rng = np.random.default_rng(1)
    points = rng.uniform([0, -0.5, -0.5], [6, 0.5, 0.7], (400, 3))
    bias = np.column_stack([np.cos(points[:, 0]), points[:, 1], points[:, 2]])
    for point, missed in zip(points, bias, strict=True):
        correction.learn(point, missed)
    found = correction.added(correction.functions(points))
    assert found.shape == (400, 3)
    assert (np.std(found - bias, axis=0) < 0.3 * np.std(bias, axis=0)).all()


# The printed controller, and what all controllers are told.


def test_the_printed_controller_plans_for_any_robot():
    start = (1.5, 0.2, np.pi)
    for model, state in ((Unicycle(), ()), (Glider(), (0.2,))):
        plan = PrintedController(model=model).plan(start, state)
        assert plan.inputs.shape == (3, 1)
        rng = np.random.default_rng(1)
        lower, upper = model.axes.lower, model.axes.upper
        for beside in plan.inputs + 0.02 * rng.standard_normal((30, 3, 1)):
            inputs = np.clip(beside, lower, upper)
            poses = poses_ahead(model, start, state, inputs)
            assert goal_errors(ToPoint(), poses[1:]).sum() >= plan.objective - 1e-5
    plan = PrintedController(model=Pacing()).plan((0.5, 0.1, np.pi), ())
    assert plan.inputs.shape == (3, 2)
    # It goes as fast as it may.
    np.testing.assert_allclose(plan.inputs[:, 0], 0.1)


def test_a_prediction_carries_a_learned_state_from_stride_to_stride():
    model = Glider()
    inputs = np.array([[0.1], [-0.2], [0.05]])
    poses = poses_ahead(model, (0.0, 0.0, 0.0), (0.3,), inputs)
    place, speed = 0.0, 0.3
    for k, (push,) in enumerate(inputs):
        place, speed = place + 0.5 * speed + 0.25 * push, 0.6 * speed + push
        assert poses[k + 1, 0] == pytest.approx(place)
    both = poses_ahead(model, (0.0, 0.0, 0.0), (0.3,), np.stack([inputs, -inputs]))
    np.testing.assert_allclose(both[:, 0], poses)


def test_limits_are_the_axes_own_and_the_hopper_s_from_the_horizon():
    narrow = Horizon(swing_limit_rad=0.3)
    assert narrow.limits(Unicycle.axes) == (-0.5, 0.7)
    assert narrow.limits(table(8, 5).axes) == (-0.3, 0.3)


@pytest.mark.parametrize("state", [np.nan, (), (0.1, 0.2), None, "fast"])
def test_states_that_are_none_are_refused(state):
    controller = PrintedController(model=Glider())
    with pytest.raises(PlanningError, match="expected a finite speed, found"):
        controller.plan((0.0, 0.0, 0.0), state)
    with pytest.raises(PlanningError, match=r"expected finite \[\], found"):
        PrintedController(model=Unicycle()).plan((0.0, 0.0, 0.0), (1.0,))


# The table.


def test_a_table_is_as_the_model_between_its_nodes():
    model = Glider()
    found = tabulated(model, state_limits=[(-0.5, 0.5)])
    rng = np.random.default_rng(1)
    state, inputs = rng.uniform([-0.5, -0.2], [0.5, 0.2], (50, 2)).T[..., None]
    np.testing.assert_allclose(
        found.change(state, inputs), model.change(state, inputs), atol=1e-12
    )
    np.testing.assert_allclose(
        found.next_state(state, inputs), model.next_state(state, inputs), atol=1e-12
    )
    # Beyond the outermost nodes of the state these count.
    np.testing.assert_allclose(
        found.change([0.9], [0.1]), model.change([0.5], [0.1]), atol=1e-12
    )
    with pytest.raises(AnalysisError, match="table: expected inputs within"):
        found.change([0.1], [0.25])


def test_a_learned_angle_is_tabulated_around_the_turn():
    class Spinning:
        axes = StrideAxes(periodic=(State(name="arm"),), inputs=(TURN,))

        def change(self, state, _inputs):
            arm = np.reshape(state, -1)
            return np.column_stack([np.cos(arm), np.sin(arm), 0 * arm])

        def next_state(self, state, inputs):
            arm = np.reshape(state, (-1, 1))
            return (arm + 0.3 * np.sin(arm) + np.reshape(inputs, (-1, 1))) % (2 * np.pi)

    found = tabulated(Spinning())
    arms = np.linspace(-1.0, 7.0, 40)
    turns = np.linspace(-0.5, 0.7, 40)
    after = found.next_state(arms, turns)
    apart = np.angle(np.exp(1j * (after - Spinning().next_state(arms, turns))))
    np.testing.assert_allclose(apart, 0.0, atol=1e-6)
    assert np.all((after >= 0) & (after < 2 * np.pi))


def test_a_cost_to_go_that_takes_minutes_is_told_beforehand(caplog):
    two = StrideAxes(
        linear=Glider.axes.linear, inputs=(*Pacing.axes.inputs, *Glider.axes.inputs)
    )
    for quiet in (table(32, 17).axes, Pacing.axes, Glider.axes):
        _warn_of_time(quiet, PointGrid())
    _warn_of_time(replace(two, inputs=two.inputs[:2]), coarse(PointGrid()))
    assert not caplog.records
    _warn_of_time(replace(two, inputs=two.inputs[:2]), PointGrid())
    assert "625 combinations of pace and turn from each of 61440 nodes" in caplog.text
    assert "some 3072 MB. planner(..., few_nodes=True) tries 81" in caplog.text
    assert "from each of 7680, with 50 MB" in caplog.text
