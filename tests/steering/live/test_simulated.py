import threading
from itertools import islice

import numpy as np
import pytest
from loopback import our_threads
from test_drive import LENIENT, Controller, geometry

from hopdata.steering.live.drive import drive
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, SimulatedStream
from hopdata.steering.robot import SteeredHopper, released, steer_hop


def frames(hopper, n):
    times, markers = zip(*islice(iter(hopper), n), strict=True)
    return np.array(times), np.array(markers)


def test_frames_are_those_of_the_plant_with_noise():
    robot = SteeredHopper().still()
    time, markers = frames(LiveHopper(robot, lambda: None, noise_m=1e-3), 50)
    np.testing.assert_allclose(time, np.arange(50) / 100, atol=1e-12)
    apex, rng = released(robot, np.zeros(3)), np.random.default_rng(0)
    hop = steer_hop(robot, apex, 0.0, rng=rng, rate_hz=100.0)
    noise = markers - hop.markers[:50]
    assert 0.9e-3 < noise.std() < 1.1e-3
    assert LiveHopper(robot, lambda: None).labels == ("body1", "body2", "body3", "boom")


def test_a_swing_is_executed_in_the_flight_after_it_was_commanded():
    commands = iter([None, 0.4, None, -0.3])
    hopper = LiveHopper(SteeredHopper(), lambda: next(commands))
    frames(hopper, 200)
    assert [hop.swing_rad for hop in hopper.hops[:4]] == [0.0, 0.4, 0.0, -0.3]
    angles = np.diff([hop.stance.boom_angle_rad for hop in hopper.hops[:4]])
    np.testing.assert_allclose(angles, [0.4, 0.0, -0.3], atol=1e-9)


def test_hops_follow_each_other_without_a_gap():
    hopper = LiveHopper(SteeredHopper(), lambda: 0.2, noise_m=0.0)
    time, markers = frames(hopper, 400)
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-9)
    assert np.abs(np.diff(markers[:, :3], axis=0)).max() < 0.05
    assert len(hopper.hops) >= 6
    assert all(np.isfinite(hop.stance.time_s) for hop in hopper.hops)


def test_the_same_seed_hops_the_same():
    one, two, other = (
        frames(LiveHopper(SteeredHopper(), lambda: 0.1, seed=seed), 150)[1]
        for seed in (1, 1, 2)
    )
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


def test_a_hopper_that_falls_is_let_go_again():
    swings = iter([None, 1.0, 1.0, 1.0, 1.0] * 40)
    robot = SteeredHopper(hop_limit_s=0.2)  # no hop ends in time
    hopper = LiveHopper(robot, lambda: next(swings))
    time, markers = frames(hopper, 60)
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-9)
    assert all(np.isnan(hop.stance.time_s) for hop in hopper.hops)
    assert np.isfinite(markers).all()
    assert len(hopper.hops) == pytest.approx(3, abs=1)


def test_the_simulated_hopper_is_driven_without_a_server():
    boom, stop, told = SimulatedBoom(), threading.Event(), []
    hopper = LiveHopper(SteeredHopper(), boom.newest)
    done = drive(
        geometry(), Controller(), boom, stream=SimulatedStream(hopper, speed=2.0), stop=stop,
        limits=LENIENT, armed=True, on_decision=lambda d: told.append(d) or len(told) < 5 or stop.set(),
    )  # fmt: skip
    assert our_threads() == []
    true = np.array([h.stance.time_s for h in hopper.hops])
    assert all(np.nanmin(np.abs(true - d.stance_s)) < 0.02 for d in done.decisions)
    assert {h.swing_rad for h in hopper.hops} - {0.0} <= {
        d.command_rad for d in done.decisions
    }


def test_a_swing_is_used_once_and_the_newest_counts():
    boom = SimulatedBoom()
    boom.swing(0.1)
    boom.swing(0.2)
    assert boom.newest() == 0.2
    assert boom.newest() is None


def test_a_simulation_that_fails_is_a_lost_stream():
    boom, stop = SimulatedBoom(), threading.Event()
    hopper = LiveHopper(SteeredHopper(), boom.newest)
    hopper._next_hop = None
    done = drive(
        geometry(),
        Controller(),
        boom,
        stream=SimulatedStream(hopper),
        stop=stop,
        seconds=0.1,
    )
    assert "the simulation failed" in done.states[1].message
