import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from loopback import LONG_S, our_threads, wait_until
from loopback_server import Faults, LoopbackServer, Outage, UdpSwings

from hopdata.errors import ConfigError
from hopdata.steering.live.actuator import UdpBoom
from hopdata.steering.live.drive import drive
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.live.machine import DriveState
from hopdata.steering.live.packets import ConnectionLostError, LabelError
from hopdata.steering.live.simulated import LiveHopper
from hopdata.steering.live.stream import Patience
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry
from hopdata.steering.robot import SteeredHopper

ENDLESS = Path(__file__).with_name("endless_drive.py")
BENCHMARKS = Path(__file__).parents[3] / "benchmarks/steering"  # contains the server
# A loaded machine may send swings too late for their flights, and some tests keep them
# themselves.
LENIENT = Limits(
    pose_age_s=LONG_S,
    command_s=LONG_S,
    hop_s=LONG_S,
    wrong_swings=10**6,
    heard_s=LONG_S,
)
SPEED = 4.0
FASTEST_M_S, FASTEST_RAD_S = 0.3, 1.0  # of the hopper when its boom hardly swings
# Pauses of the machine are not reported; a server that disconnects is reported at once.
PATIENT = Patience(
    stale_s=LONG_S, reconnect_s=LONG_S, retry_s=0.02, longest_retry_s=0.1
)


def geometry(boom_name="boom"):
    robot = SteeredHopper()
    body = np.array(robot.markers.body_m)
    centre = np.array([robot.hopper.boom_offset_m, 0, robot.hopper.boom_height_m])
    return HopperGeometry(
        body_names=("body1", "body2", "body3"),
        body_m=body - body.mean(axis=0),
        noise_m=0.0006,
        stance_below_m=0.3,
        flight_above_m=0.4,
        boom_name=boom_name,
        circle=BoomCircle(
            centre - body.mean(axis=0),
            np.array([0.0, 0.0, 1.0]),
            robot.hopper.boom_radius_m,
        ),
    )


class Controller:
    """A controller that swings to and fro, and records what it was told."""

    def __init__(self):
        self.asked = []

    def plan(self, pose, boom_angle_rad, previous_swing_rad, /):
        self.asked.append((pose, boom_angle_rad, previous_swing_rad))
        return SimpleNamespace(
            swing_rad=0.1 * (-1) ** len(self.asked) * len(self.asked)
        )


class Robot:
    """The simulated hopper behind a server, with its boom."""

    def __init__(self, **server):
        self.swings = UdpSwings()
        self.hopper = LiveHopper(SteeredHopper(), self.swings.newest)
        self.server = LoopbackServer(
            self.hopper, self.hopper.labels, speed=SPEED, **server
        )
        self.boom = UdpBoom(self.swings.port)

    def __enter__(self):
        self.server.start()
        return self

    def __exit__(self, *_):
        self.server.close()
        self.boom.close()
        self.swings.close()


def drive_until(robot, controller, n_stances, **options):
    stop, told = threading.Event(), []

    def listen(decision):
        told.append(decision)
        if len(told) >= n_stances:
            stop.set()

    options = {
        "limits": LENIENT, "patience": PATIENT, "seconds": LONG_S, "armed": True,
    } | options  # fmt: skip
    return drive(
        geometry(), controller, robot.boom, port=robot.server.port, stop=stop,
        on_decision=listen, **options,
    )  # fmt: skip


def test_the_simulated_hopper_is_driven_through_the_stream(tmp_path):
    controller = Controller()
    with Robot(faults=Faults(dropped=0.01, hidden=0.01), seed=2) as robot:
        log = DriveLog(tmp_path / "drive.h5", 4, setup={}, files={})
        done = drive_until(robot, controller, 7, log=log)
        hops = robot.hopper.hops
    assert our_threads() == []
    true = np.array([h.stance.time_s for h in hops])
    for decision in done.decisions:
        k = int(np.nanargmin(np.abs(true - decision.stance_s)))
        assert abs(true[k] - decision.stance_s) < 0.02
        # A loaded machine takes several frames at a time and plans with the newest of
        # them.
        later_s = SPEED * (decision.since_stance_s - decision.pose_age_s)
        moved_m, turned_rad = FASTEST_M_S * later_s, FASTEST_RAD_S * later_s
        np.testing.assert_allclose(
            decision.pose[:2], hops[k].stance.pose[:2], atol=0.02 + moved_m
        )
        assert decision.pose[2] == pytest.approx(
            hops[k].stance.pose[2], abs=0.05 + turned_rad
        )
        assert np.cos(decision.boom_angle_rad - hops[k].stance.boom_angle_rad) > np.cos(
            0.02
        )
    nearest = [int(np.nanargmin(np.abs(true - d.stance_s))) for d in done.decisions]
    assert nearest == list(
        range(nearest[0], nearest[0] + len(nearest))
    )  # none lost, none invented
    commanded = [d.command_rad for d in done.decisions]
    # On a loaded machine some come too late for their flight; test_simulated has no
    # such delays.
    assert {h.swing_rad for h in hops if h.swing_rad != 0} <= set(commanded)
    written = read_log(tmp_path / "drive.h5")
    np.testing.assert_array_equal(written.decisions.command_swing_rad, commanded)
    assert "streaming" in set(written.events.kind)


def test_the_swing_of_the_hop_before_is_passed_on():
    controller = Controller()
    with Robot() as robot:
        drive_until(robot, controller, 5)
        swings = {round(h.swing_rad, 6) for h in robot.hopper.hops}
    assert controller.asked[0][2] is None
    for _, _, swing in controller.asked[1:]:
        assert min(abs(swing - true) for true in swings) < 0.02


@pytest.mark.parametrize("kind", ["vanish", "garbage"])
def test_after_the_server_has_been_away_the_hopper_is_driven_on_by_its_operator(kind):
    arms = []

    def operate(loop, stream):
        is_back = stream.counts.connections == 2 and stream.counts.frames > 100
        if loop.state is DriveState.RESTING and is_back and loop.arm() is None:
            arms.append(len(loop.decisions()))

    with Robot(outages=[Outage(1.0, 0.2, kind)], seed=4) as robot:
        done = drive_until(robot, Controller(), 7, on_look=operate)
    assert done.stream.connections == 2
    assert "lost" in [s.state for s in done.states]
    assert done.loop.failed == 0
    assert len(arms) == 1
    assert done.rests[0].cause.code == "steering.stream_lost"
    changes = [str(s.transition.target) for s in done.steps if s.changes]
    assert changes.index("resting") < changes.index("armed")
    assert done.decisions[-1].outcome == "planned"


def test_a_drive_is_not_begun_before_its_operator_arms_it():
    with Robot() as robot:
        done = drive_until(robot, Controller(), 2, armed=False)
    assert [d.outcome for d in done.decisions[:2]] == ["waiting", "waiting"]
    assert {hop.swing_rad for hop in robot.hopper.hops} == {0.0}


def test_a_robot_that_answers_no_heartbeats_brings_the_drive_to_rest():
    with Robot() as robot:
        robot.swings.answers = False
        limits = replace(LENIENT, heard_s=0.2)
        done = drive_until(robot, Controller(), 3, limits=limits)
    assert "steering.unacknowledged" in {rest.cause.code for rest in done.rests}
    assert done.decisions[-1].outcome == "held"


def test_a_boom_with_half_of_the_heartbeat_is_refused():
    boom = SimpleNamespace(swing=print, alive=print)
    with pytest.raises(ConfigError, match="both of the methods alive and heard"):
        drive(geometry(), Controller(), boom, port=1, stop=threading.Event())


def test_at_the_end_the_boom_is_told_to_stay():
    told = []
    with Robot() as robot:
        robot.boom = SimpleNamespace(swing=told.append, close=robot.boom.close)
        drive_until(robot, Controller(), 2)
    assert told[-1] == 0.0


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize(("told", "code"), [("SIGTERM", 143), ("SIGINT", 130)])
def test_a_process_that_is_told_to_end_leaves_the_boom_at_rest_and_its_logs(
    tmp_path, told, code
):
    heard = []
    with Robot(faults=Faults(dropped=0.05), seed=3) as robot:
        robot.hopper._swings = lambda: (
            0.0
        )  # here the test reads the swings of the process
        ports = robot.server.port, robot.swings.port
        process = subprocess.Popen(
            [sys.executable, ENDLESS, *map(str, ports), tmp_path / "drive.h5"],
            env={**os.environ, "PYTHONPATH": str(BENCHMARKS)},
        )
        try:
            wait_until(
                lambda: heard.append(robot.swings.newest()) or len(set(heard)) > 2
            )
            told_s = time.monotonic()  # all processes share this clock
            process.send_signal(getattr(signal, told))
            process.send_signal(
                getattr(signal, told)
            )  # patience does not delay the end
            # If the second signal comes late, everything is written and the handlers
            # are restored.
            assert process.wait(LONG_S) in {code, -getattr(signal, told)}
        finally:
            process.kill()
            process.wait()
        heard.append(robot.swings.newest())
    assert heard[-1] == 0.0
    log = read_log(tmp_path / "drive.h5")
    assert {h for h in heard if h} <= set(log.decisions.command_swing_rad)
    assert f"the drive was ended by {told}" in set(log.events.text)
    ended = log.events[log.events.text == f"ended by {told}"]
    assert list(ended.kind) == ["stopped", "rest"], log.events.to_string()
    rest = ended.iloc[1]
    assert rest.sent_s > told_s
    print(f"{told}: at rest {1e3 * (rest.sent_s - told_s):.1f} ms after it")
    counts = log.counts.set_index("count").value
    assert counts["stream.frames"] >= counts["loop.frames"] == len(log.frames) > 0
    assert counts["stream.missing"] > 0


def test_a_process_that_is_killed_leaves_a_log_that_can_be_read(tmp_path):
    path = tmp_path / "drive.h5"
    with Robot() as robot:
        robot.hopper._swings = lambda: 0.0
        process = subprocess.Popen(
            [
                sys.executable,
                ENDLESS,
                str(robot.server.port),
                str(robot.swings.port),
                path,
            ],
            env={**os.environ, "PYTHONPATH": str(BENCHMARKS)},
        )
        heard = set()
        try:
            wait_until(lambda: heard.add(robot.swings.newest()) or len(heard) > 3)
            wait_until(lambda: len(read_log(path).decisions) > 2)  # while it is written
        finally:
            process.kill()
            process.wait()
    log = read_log(path)
    assert len(log.decisions) > 2
    assert len(log.frames) > 100
    assert set(log.decisions.told_s) <= set(log.frames["time_s"])
    assert not len(log.counts)  # they come at the end


@pytest.mark.usefixtures("interruptible")
def test_a_handler_of_the_callers_own_is_left_and_the_default_is_put_back():
    seen = []
    before = signal.signal(
        signal.SIGTERM, lambda *_: seen.append(signal.getsignal(signal.SIGINT))
    )
    try:
        with Robot() as robot:
            stop = threading.Event()

            def listen(_):
                signal.raise_signal(signal.SIGTERM)
                stop.set()

            drive(
                geometry(), Controller(), robot.boom, port=robot.server.port, stop=stop,
                limits=LENIENT, seconds=LONG_S, on_decision=listen, armed=True,
            )  # fmt: skip
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_marker_of_another_name_is_a_clear_error_and_the_boom_stays():
    told = []
    with (
        Robot() as robot,
        pytest.raises(LabelError, match=r"'bom' .* did you mean 'boom'"),
    ):
        drive(
            geometry("bom"),
            Controller(),
            SimpleNamespace(swing=told.append),
            port=robot.server.port,
            stop=threading.Event(),
        )
    assert set(told) == {0.0}
    assert our_threads() == []


def test_no_camera_system_is_a_clear_error():
    swings = UdpSwings()
    with (
        UdpBoom(swings.port) as boom,
        pytest.raises(ConnectionLostError, match="cannot connect"),
    ):
        drive(
            geometry(),
            Controller(),
            boom,
            port=swings.port,
            stop=threading.Event(),
            first_frame_s=0.3,
            patience=PATIENT,
        )
    swings.close()
    wait_until(lambda: our_threads() == [])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"geometry": replace(geometry(), boom_name=None, circle=None)},
            "geometry: expected a boom",
        ),
        ({"geometry": replace(geometry(), circle=None)}, "geometry: expected a boom"),
        (
            {"controller": lambda *_: 0.1},
            "controller: expected .* method plan, found function",
        ),
        ({"controller": Controller}, "method plan, found the class Controller"),
        ({"boom": [].append}, "boom: expected an object with the method swing"),
    ],
)
def test_parts_that_cannot_work_are_refused_before_anything_moves(wrong, message):
    told = []
    parts = {
        "geometry": geometry(),
        "controller": Controller(),
        "boom": SimpleNamespace(swing=told.append),
    } | wrong
    with pytest.raises(ConfigError, match=message):
        drive(**parts, port=1, stop=threading.Event())
    assert not told


BLOCKED = """
import sys, threading, time
from dataclasses import replace
sys.path[:0] = {paths!r}
from types import SimpleNamespace
from test_drive import LENIENT, Controller, geometry
from hopdata.steering.live.drive import drive
from hopdata.steering.live.simulated import LiveHopper, SimulatedStream
from hopdata.steering.robot import SteeredHopper

class Boom:
    commands = 0

    def swing(self, rad):
        self.commands += 1
        print(f"told {{rad}}", flush=True)
        if self.commands >= 2:
            print("blocks", flush=True)
            time.sleep(1000)

stream = SimulatedStream(LiveHopper(SteeredHopper(), lambda: None))
limits = replace(LENIENT, command_s=0.5)  # which is also the patience with a driver
drive(geometry(), Controller(), Boom(), stream=stream, stop=threading.Event(), limits=limits,
      armed=True)
"""


def test_a_driver_that_blocks_does_not_keep_a_signal_from_ending_the_drive():
    code = BLOCKED.format(paths=[str(ENDLESS.parent), str(BENCHMARKS)])
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    )
    try:
        for line in process.stdout:
            if line == "blocks\n":
                break
        process.terminate()
        assert process.wait(LONG_S) != 0  # the driver blocks for far longer
        assert (
            "told 0.0\nblocks\n" in process.stdout.read()
        )  # a last rest is tried all the same
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.parametrize("rests", [False, True])
def test_a_log_that_fails_brings_the_drive_to_rest_only_if_asked(rests, tmp_path):
    log = DriveLog(tmp_path / "drive.h5", 4, setup={}, files={})
    log.failure = "the log could not be written any more: full"
    with Robot() as robot:
        done = drive_until(robot, Controller(), 3, log=log, rest_without_log=rests)
    assert (log.failure in {str(rest.cause) for rest in done.rests}) == rests
    # On a loaded machine some stances are overtaken by the next.
    outcomes = {decision.outcome for decision in done.decisions[:3]} - {"overtaken"}
    assert outcomes == {"held" if rests else "planned"}
