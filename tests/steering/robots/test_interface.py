"""What any robot does behind the interface: excited, seen, commanded, logged, replayed."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.errors import AnalysisError, ConfigError
from hopdata.rigid import composed
from hopdata.steering.control.interface import Plan, PlanningError
from hopdata.steering.robots.interface import (
    Simulation,
    Stance,
    at_rest,
    excited,
    replayed,
    steered,
)
from hopdata.steering.strides import Input, State, StrideAxes


class Walker:
    """Moves ahead by its input and tells the last one; falls if it is above 0.9."""

    axes = StrideAxes(
        linear=(State(name="last", unit="m", set_by="step"),),
        inputs=(Input(name="step", unit="m", lower=-0.5, upper=1.0),),
    )
    seen_sd = (0.0, 0.0, 0.0, 0.0)

    def release(self, pose):
        return Stance(0.0, np.asarray(pose, dtype=float), np.zeros(1), inner="secret")

    def stride(self, stance, inputs, rng):
        step = float(inputs[0]) + 0.01 * rng.standard_normal()
        pose = composed(stance.pose, [step, 0.0, 0.0])
        fell = bool(inputs[0] > 0.9)
        return Stance(stance.time_s + 1, pose, inputs.copy(), fell=fell, inner="secret")


class Noisy(Walker):
    """The same, seen with noise."""

    seen_sd = (0.1, 0.0, 0.0, 0.2)


class Back:
    """Goes back by half of what it sees."""

    def plan(self, pose, state, previous=None, /):
        self.told = (pose, state, previous)
        return Plan(np.array([-0.5 * pose[0]]), np.zeros((2, 3)), 0.0)


class Blind:
    """Cannot plan."""

    def plan(self, *_):
        raise PlanningError("plan: expected a pose, found none")


def test_an_excitation_makes_one_stride_for_each_input():
    strides = excited(Simulation(Walker(), seed=3), [0.2, -0.1, 0.4]).strides()
    np.testing.assert_allclose(strides.inputs[:, 0], [0.2, -0.1, 0.4])
    np.testing.assert_allclose(strides.change[:, 0], [0.2, -0.1, 0.4], atol=0.05)
    np.testing.assert_array_equal(strides.next_state, strides.inputs)
    np.testing.assert_array_equal(strides.state[1:], strides.inputs[:-1])
    assert len(strides.used()) == 3


def test_a_fall_is_no_stride_and_the_next_begins_where_it_was():
    log = excited(Simulation(Walker(), seed=3), [0.2, 0.95, 0.3, 0.4])
    assert log.fell
    # The input in the stance of the fall goes to the robot that was put down again.
    strides = log.strides()
    np.testing.assert_allclose(strides.inputs[:, 0], [0.2, 0.4])
    np.testing.assert_allclose(strides.change[:, 0], [0.2, 0.4], atol=0.05)


class Real:
    """A robot that is no simulation: it keeps all that is commanded, and may fail."""

    axes = Walker.axes

    def __init__(self, fails_at=None):
        self.commands = []
        self._simulation = Simulation(Walker(), (5.0, 0, 0), seed=3)
        self._fails_at = fails_at

    def stances(self):
        return self._simulation.stances()

    def command(self, inputs, /):
        if len(self.commands) == self._fails_at:
            self._fails_at = None
            raise OSError("no answer from the motor")
        self.commands.append(inputs.tolist())
        self._simulation.command(inputs)


@pytest.mark.parametrize("number", [-3.0, np.nan])
def test_an_excitation_beyond_the_limits_is_refused_before_anything_moves(number):
    robot = Real()
    with pytest.raises(
        ConfigError, match=r"inputs of stride 1: expected from \[-0.5\]"
    ):
        excited(robot, [0.1, number, 0.2])
    assert robot.commands == []


def test_inputs_beyond_the_limits_never_reach_a_robot_and_it_is_said(caplog):
    robot = Real()
    log = steered(robot, Back(), strides=6)  # it plans -2.5 from 5 m away
    assert min(min(robot.commands)) == -0.5
    assert log.cut[:2].all()
    assert not steered(Real(), Blind(), strides=3).cut.any()
    assert "inputs [-2.5] cut to their limits: [-0.5]" in caplog.text
    again = replayed(log, Back())
    np.testing.assert_array_equal(again, log.inputs)


def test_a_robot_or_controller_that_fails_leaves_the_log_whole_and_the_robot_at_rest(
    caplog,
):
    robot = Real(fails_at=3)
    log = steered(robot, Back(), strides=9)
    assert log.failure == "stride 4: OSError('no answer from the motor')"
    assert len(log.stances) == len(log.inputs) == 4
    assert robot.commands[-1] == [0.0]
    assert len(log.strides()) == 3
    assert caplog.text.count("the robot rests, and its log ends") == 1

    class Broken(Back):
        def plan(self, pose, *others):
            if pose[0] < 4.2:
                raise ZeroDivisionError
            return super().plan(pose, *others)

    robot = Real()
    log = steered(robot, Broken(), strides=9)
    assert "ZeroDivisionError" in log.failure
    assert robot.commands[-1] == [0.0]
    assert len(log.stances) > 2


def test_the_truth_is_not_told():
    simulation = Simulation(Noisy(), (1.0, 2.0, 0.5), seed=4)
    stance = next(iter(simulation.stances()))
    assert stance.inner is None
    assert stance.pose[0] != simulation.true_pose[0]
    assert stance.pose[2] == 0.5
    assert stance.state[0] != 0.0


def test_a_controller_is_told_pose_state_and_the_inputs_before():
    controller = Back()
    log = steered(Simulation(Walker(), (0.8, 0, 0), seed=5), controller, strides=3)
    pose, state, previous = controller.told
    np.testing.assert_array_equal(pose, log.stances[-2].pose)
    np.testing.assert_array_equal(state, previous)
    np.testing.assert_array_equal(previous, log.inputs[-3])
    assert len(log.strides()) == 3


def test_it_ends_with_the_arrival():
    log = steered(
        Simulation(Walker(), (0.8, 0, 0), seed=5),
        Back(),
        strides=30,
        arrived=lambda pose: abs(pose[0]) < 0.1,
    )
    assert abs(log.poses[-1, 0]) < 0.1
    assert np.all(np.abs(log.poses[:-1, 0]) >= 0.1)


def test_where_nothing_can_be_planned_the_robot_rests():
    log = steered(Simulation(Walker(), seed=5), Blind(), strides=2)
    np.testing.assert_array_equal(log.inputs[:2], 0.0)
    one = Input(name="pace", lower=0.1, upper=0.3)
    np.testing.assert_array_equal(at_rest(StrideAxes(inputs=(one,))), [0.1])


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_what_is_no_number_is_not_commanded(number):
    class Broken:
        def plan(self, *_):
            return Plan(np.array([number]), np.zeros((2, 3)), 0.0)

    log = steered(Simulation(Walker(), seed=1), Broken(), strides=2)
    np.testing.assert_array_equal(log.inputs[:-1], np.zeros((2, 1)))


def test_a_log_is_replayed_to_the_bit_by_its_own_controller_only():
    log = steered(Simulation(Noisy(), (0.8, 0, 0), seed=5), Back(), strides=6)
    np.testing.assert_array_equal(replayed(log, Back()), log.inputs)
    first = replace(log.stances[0], pose=log.stances[0].pose + 1e-9)
    changed = replace(log, stances=(first, *log.stances[1:]))
    assert (replayed(changed, Back())[0] != log.inputs[0]).all()
    np.testing.assert_array_equal(replayed(log, Blind())[:6], 0.0)


def test_a_seed_gives_the_same_log_again():
    one, again, other = (
        excited(Simulation(Noisy(), seed=s), [0.1, 0.2]).poses for s in (7, 7, 8)
    )
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_deviations_for_too_few_numbers_are_refused():
    class Short(Walker):
        seen_sd = (0.0, 0.0)

    with pytest.raises(ConfigError, match=r"seen_sd: expected .* numbers.*found 2"):
        Simulation(Short())


def test_a_stride_to_nowhere_is_an_error_and_a_fall_is_none():
    class Lost(Walker):
        def stride(self, stance, inputs, rng):
            after = super().stride(stance, inputs, rng)
            return replace(after, pose=np.full(3, np.nan), fell=self.fell)

    lost = Lost()
    lost.fell = False
    with pytest.raises(AnalysisError, match="stride: expected a pose and a state"):
        excited(Simulation(lost), [0.1, 0.1])
    lost.fell = True
    assert excited(Simulation(lost), [0.1, 0.1]).fell


def test_a_robot_that_returns_something_else_is_told_what_is_expected():
    class Pose(Walker):
        def release(self, pose):
            return np.asarray(pose, dtype=float)

    class Forgetful(Walker):
        def stride(self, stance, inputs, rng):
            return replace(super().stride(stance, inputs, rng), state=np.empty(0))

    with pytest.raises(
        AnalysisError, match="release: expected a Stance, found ndarray"
    ):
        excited(Simulation(Pose()), [0.1])
    with pytest.raises(
        AnalysisError, match=r"stride: .*a state of 1, .*\(3,\), \(0,\)"
    ):
        excited(Simulation(Forgetful()), [0.1])


def test_an_excitation_has_a_number_for_each_input():
    robot = Real()
    with pytest.raises(ConfigError, match=r"inputs: expected the shape \(strides, 1\)"):
        excited(robot, np.zeros((3, 2)))
    assert robot.commands == []
