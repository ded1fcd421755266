"""A robot that is not the hopper, driven by the live loop on a simulated clock."""

import json
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.steering.live.buffer import Frame
from hopdata.steering.live.clocked import ClockedDrive, Transport
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.live.loop import checks_of
from hopdata.steering.live.replay import replay
from hopdata.steering.live.seen_robots import (
    BODY_M,
    DECIDED_S,
    LABELS,
    HeldInputs,
    SeenRobot,
)
from hopdata.steering.observation.bodies import SpeedShown, apex_observers, body_of
from hopdata.steering.robots.planar_hopper import PlanarHopper

ROBOT = PlanarHopper()
GEOMETRY = body_of(LABELS, BODY_M, noise_m=6e-4)
LIMITS = Limits(command_s=DECIDED_S, fence_m=6.0)


class Towards:
    """Leans the leg so that the hopper comes to the origin; `gain` may ask too much."""

    def __init__(self, gain=0.04):
        self.gain = gain
        self.asked = []

    def plan(self, pose, state, previous, /):
        self.asked.append((pose, state, previous))
        ahead = np.tanh(2.0 * (pose[0] + 0.6 * state[0]))
        return SimpleNamespace(inputs=np.array([[self.gain * ahead]]))


def observers():
    return apex_observers(GEOMETRY, 100.0, lambda: SpeedShown(100.0))()


def drive_of(controller, *, log=None, x_m=1.0, **options):
    actuator = HeldInputs(np.zeros(1))
    seen = SeenRobot(ROBOT, actuator, pose=(x_m, 0.0, 0.0), seed=5)
    decisions = []

    def note(decision):
        decisions.append(decision)
        if log is not None:
            log.decision(decision)

    drive = ClockedDrive(
        seen,
        observers,
        controller,
        actuator,
        axes=ROBOT.axes,
        limits=LIMITS,
        checks=checks_of(GEOMETRY, 100.0, LIMITS),
        on_decision=note,
        on_frames=None if log is None else log.frames,
        **options,
    )
    return drive, seen, actuator, decisions


def turned(end, states):
    return end, states.T


def none_of_it(end, states):
    return end, states[:0]


def alone(end, states):
    return states


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            turned,
            r"path: expected states \(K, N\), with a row for each of the \d+ times",
        ),
        (none_of_it, r"found the shape \(0, \d+\)"),
        (alone, "path: expected"),
    ],
)
def test_a_path_of_another_shape_is_one_error(change, message):
    robot = SimpleNamespace(
        axes=ROBOT.axes,
        release=ROBOT.release,
        path=lambda *given: change(*ROBOT.path(*given)),
    )
    seen = SeenRobot(robot, HeldInputs(np.zeros(1)), seed=5)
    with pytest.raises(AnalysisError, match=message):
        seen.next_frames()


def test_each_apex_is_seen_with_pose_and_speed_and_planned_for():
    controller = Towards()
    drive, seen, actuator, decisions = drive_of(controller)
    drive.run(8.0)
    true = [one for one in seen.stances if one.time_s < 7.9]
    assert len(decisions) == len(true) > 10
    for decision, stance, sent in zip(decisions, true, actuator.sent, strict=True):
        assert decision.stance_s == pytest.approx(stance.time_s, abs=0.005)
        np.testing.assert_allclose(decision.pose[0], stance.pose[0], atol=0.02)
        np.testing.assert_allclose(decision.state, stance.state, atol=0.05)
        assert decision.outcome == "planned"
        assert decision.command == tuple(sent.tolist())
    assert abs(true[-1].pose[0]) < 0.11
    assert abs(true[0].pose[0]) == 1.0


def test_inputs_beyond_their_limits_never_reach_the_actuator():
    drive, _, actuator, decisions = drive_of(Towards(gain=3.0))
    drive.run(4.0)
    upper = ROBOT.axes.upper[0]
    assert max(abs(sent[0]) for sent in actuator.sent) == upper
    cut = [one for one in decisions if one.outcome == "cut"]
    assert cut
    assert cut[0].reason.code == "steering.cut_input"
    assert "leg_angle_rad" in str(cut[0].reason)
    assert abs(cut[0].planned[0]) > upper == abs(cut[0].command[0])


@pytest.mark.parametrize(
    ("broken", "code"),
    [
        (lambda *_: 1 / 0, "steering.controller_failed"),
        (lambda *_: SimpleNamespace(inputs=[[np.nan]]), "steering.no_number"),
        (lambda *_: SimpleNamespace(inputs=[[0.0, 0.0]]), "steering.controller_failed"),
    ],
)
def test_a_controller_that_fails_leaves_the_robot_at_rest_until_it_is_armed(
    broken, code
):
    controller = Towards()
    drive, _, actuator, _ = drive_of(controller)
    drive.run(2.0)
    good = controller.plan
    controller.plan = broken
    drive.run(4.0)
    assert [rest.cause.code for rest in drive.loop.watch.rests] == [code]
    assert actuator.inputs == 0.0
    controller.plan = good
    drive.run(6.0)
    assert actuator.inputs == 0.0
    assert drive.loop.arm() is None
    drive.run(7.0)
    assert actuator.inputs != 0.0


def test_an_actuator_that_raises_leaves_the_robot_at_rest_and_the_log_whole(tmp_path):
    log = DriveLog(tmp_path / "drive.h5", 4, setup={}, files={}, axes=ROBOT.axes)
    drive, _, actuator, decisions = drive_of(Towards(), log=log)
    drive.run(2.0)
    good = actuator.command

    def raises(inputs):
        if inputs[0] != 0.0:
            raise OSError("no answer from the motor")
        good(inputs)

    actuator.command = raises
    drive.run(4.0)
    log.close(4.0, {})
    assert actuator.inputs == 0.0
    (rest,) = drive.loop.watch.rests
    assert "no answer from the motor" in str(rest.cause)
    assert len(str(rest.cause).splitlines()) == 1
    assert len(read_log(tmp_path / "drive.h5").decisions) == len(decisions)


@pytest.mark.parametrize("fault", ["frozen", "lost", "silent"])
def test_a_fault_brings_it_to_rest_until_it_is_armed(fault):
    drive, _, actuator, _ = drive_of(Towards(), x_m=3.0)
    drive.run(2.0)
    if fault == "silent":
        actuator.silence()
    else:
        shown = []
        drive.cameras = lambda markers: (
            shown.append(markers) or (shown[0] if fault == "frozen" else None)
        )
    drive.run(2.5)
    codes = {
        "frozen": "steering.markers_frozen",
        "lost": "steering.no_frame",
        "silent": "steering.unacknowledged",
    }
    assert drive.loop.watch.rests[0].cause.code == codes[fault]
    drive.cameras = None
    actuator.is_silent = False
    drive.run(4.0)
    assert actuator.inputs == 0.0
    assert drive.loop.arm() is None
    drive.run(5.0)
    assert actuator.inputs != 0.0


def test_a_log_by_the_names_of_its_axes_is_played_again_to_the_bit(tmp_path):
    path = tmp_path / "drive.h5"
    log = DriveLog(path, 4, setup={}, files={}, axes=ROBOT.axes)
    drive, *_ = drive_of(
        Towards(),
        log=log,
        transport=Transport(lost_share=0.2),
        lost=np.random.default_rng(3),
    )
    drive.run(3.0)
    drive.cameras = lambda _: None
    drive.run(3.4)
    drive.cameras = None
    drive.run(3.8)
    drive.loop.arm()
    drive.run(8.0)
    log.close(8.0, {})
    logged = read_log(path)
    assert logged.axes == ROBOT.axes
    names = ["speed_m_s", "planned_leg_angle_rad", "command_leg_angle_rad"]
    assert set(names) <= set(logged.decisions)
    options = {"limits": LIMITS, "checks": checks_of(GEOMETRY, 100.0, LIMITS)}
    plans = replay(logged, observers, Towards(), **options)
    assert len(plans) > 8
    assert plans.same.all()
    assert not replay(logged, observers, Towards(0.03), **options).same.any()
    with h5py.File(path) as file:
        assert json.loads(file.attrs["axes"])["inputs"][0]["name"] == "leg_angle"


@pytest.mark.parametrize(("noise_m", "usable"), [(6e-4, False), (0.0, True)])
def test_coordinates_that_repeat_to_the_bit_are_no_measurement(noise_m, usable):
    checks = checks_of(body_of(LABELS, BODY_M, noise_m=noise_m), 100.0, LIMITS)()
    tracker, _ = observers()
    found = []
    for number in range(3):
        lifted = np.array([0.0, 0.0, 0.5 - 0.01 * min(number, 1)])
        markers = GEOMETRY.body_m + lifted
        frame = Frame(0, number, 0.01 * number, 0.0, 0.01 * number, markers)
        found.append(checks.feed(frame, tracker.feed(frame.time_s, markers)).is_usable)
    assert found == [True, True, usable]
