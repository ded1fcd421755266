import socket
import threading
import time

import numpy as np
import pytest
from loopback import wait_until
from loopback_server import UdpSwings

from hopdata.errors import ConfigError
from hopdata.steering.live.packets import PortError
from hopdata.steering.live.safety import Limits, NoBoom, UdpBoom, Watch


@pytest.fixture
def swings():
    receiver = UdpSwings()
    yield receiver
    receiver.close()


def test_the_newest_swing_is_received_once(swings):
    with UdpBoom(swings.port) as boom:
        assert swings.newest() is None
        boom.swing(0.1)
        boom.swing(-1 / 3)
        got = []
        wait_until(lambda: got.append(swings.newest()) or got[-1] == -1 / 3)
        assert swings.newest() is None


@pytest.mark.parametrize(
    "line", [b"", b"swing 1", b"swing x 1", b"swing 1 nan", b"go 1 2", b"\xff"]
)
def test_what_is_not_a_swing_is_left_out_and_counted(swings, line):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, UdpBoom(swings.port) as boom:
        sender.sendto(line, ("127.0.0.1", swings.port))
        boom.swing(0.5)
        got = []
        wait_until(lambda: got.append(swings.newest()) or 0.5 in got)
    assert swings.garbled == 1


def test_swings_that_are_old_or_come_twice_are_left_out_and_counted(swings):
    got = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in (b"swing 7 0.1", b"swing 9 0.3", b"swing 8 0.2", b"swing 9 0.3"):
            sender.sendto(line, ("127.0.0.1", swings.port))
        wait_until(lambda: got.append(swings.newest()) or swings.outdated == 2)
        sender.sendto(b"swing 9 0.3", ("127.0.0.1", swings.port))
        wait_until(lambda: got.append(swings.newest()) or swings.outdated == 3)
    assert [g for g in got if g is not None][-1] == 0.3
    assert got[-1] is None
    assert swings.garbled == 0


def test_a_later_drive_is_not_taken_for_old(swings):
    got = []
    for rad in (0.1, 0.2):
        with UdpBoom(swings.port) as boom:
            boom.swing(rad)
            wait_until(lambda rad=rad: got.append(swings.newest()) or got[-1] == rad)
        time.sleep(0.005)
    assert swings.outdated == 0


@pytest.mark.parametrize("port", ["x", 0, 65536, -1, 5000.0, None])
def test_what_is_no_port_is_refused_at_once(port):
    with pytest.raises(PortError, match="port: expected a whole number from 1 to 65535, found"):
        UdpBoom(port)


def test_a_host_without_an_address_is_refused_at_once():
    with pytest.raises(PortError, match=r"host: expected an IPv4 address .* '::1'"):
        UdpBoom(5000, host="::1")


def test_a_port_in_use_is_a_clear_error(swings):
    with pytest.raises(PortError, match=f"127.0.0.1, port {swings.port}"):
        UdpSwings(swings.port)


def test_an_answer_that_is_late_does_not_lift_a_rest():
    asked, answer = threading.Event(), threading.Event()

    def ask():
        if not asked.is_set():
            asked.set()
            answer.wait()
            return ""
        return "the end"

    watch = Watch(NoBoom(), ask)
    looks = [threading.Thread(target=watch.look) for _ in range(2)]
    looks[0].start()
    asked.wait()
    looks[1].start()
    looks[1].join(0.05)
    answer.set()
    for look in looks:
        look.join()
    assert watch.cause == "the end"


def test_no_swing_at_all_and_half_a_turn_are_limits():
    assert Limits(swing_rad=0.0).swing_rad == 0.0
    assert Limits(swing_rad=np.pi).swing_rad == np.pi


@pytest.mark.parametrize("name", ["swing_rad", "tilt_rad"])
@pytest.mark.parametrize("angle", [-1.0, np.nan, np.inf, 67.5])
def test_an_angle_that_would_not_hold_is_refused(name, angle):
    with pytest.raises(ConfigError, match=f"{name}: expected 0 to pi, found"):
        Limits(**{name: angle})


@pytest.mark.parametrize("name", ["pose_age_s", "command_s", "hop_s"])
@pytest.mark.parametrize("time", [-0.1, 0.0, np.nan])
def test_a_time_that_would_not_hold_is_refused(name, time):
    with pytest.raises(ConfigError, match=f"{name}: expected more than 0"):
        Limits(**{name: time})
