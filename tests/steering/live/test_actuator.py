"""The boom's lines over UDP: what is sent, heard and answered."""

import socket
import time
from contextlib import suppress

import pytest
from loopback import wait_until
from loopback_server import UdpSwings

from hopdata.steering.live import actuator
from hopdata.steering.live.actuator import UdpBoom
from hopdata.steering.live.packets import PortError


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
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        UdpBoom(swings.port) as boom,
    ):
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
    with pytest.raises(
        PortError, match="port: expected a whole number from 1 to 65535, found"
    ):
        UdpBoom(port)


def test_a_host_without_an_address_is_refused_at_once():
    with pytest.raises(PortError, match=r"host: expected an IPv4 address .* '::1'"):
        UdpBoom(5000, host="::1")


def test_a_port_in_use_is_a_clear_error(swings):
    with pytest.raises(PortError, match=f"127.0.0.1, port {swings.port}"):
        UdpSwings(swings.port)


class DeafRobot:
    """Receives lines on a port of its own, and answers none of the first ones."""

    def __init__(self, deaf_to=0, answer=b"heard %d\n"):
        self.lines, self._deaf_to, self._answer = [], deaf_to, answer
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]

    def take(self):
        """Read what has come, and answer it."""
        with suppress(BlockingIOError):
            while True:
                line, sender = self._socket.recvfrom(100)
                word, number, *rad = line.split()
                if word == b"alive":
                    self._socket.sendto(line, sender)
                    continue
                self.lines.append((int(number), float(rad[0])))
                if len(self.lines) > self._deaf_to:
                    answer = self._answer
                    self._socket.sendto(
                        answer % int(number) if b"%" in answer else answer, sender
                    )
        return self.lines

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"heard",
        b"heard x",
        b"heard -1",
        b"heard 7",
        b"swing %d 0.0",
        b"\xff" * 200,
    ],
)
def test_what_is_no_answer_to_the_last_swing_acknowledges_nothing(answer):
    with DeafRobot(answer=answer) as robot, UdpBoom(robot.port) as boom:
        boom.swing(0.0)
        wait_until(robot.take)
        time.sleep(0.02)
        assert not boom.acknowledged()


def test_the_answer_to_an_earlier_swing_is_not_that_to_a_rest_but_to_any_of_the_rests(
    swings,
):
    with DeafRobot() as robot, UdpBoom(robot.port) as boom:
        boom.swing(0.2)
        robot._answer = b"heard %d" % boom._number
        boom.swing(0.0)
        wait_until(lambda: len(robot.take()) == 2)
        time.sleep(0.02)
        assert not boom.acknowledged()
        robot._answer = b"heard %d" % boom._number
        boom.swing(0.0)
        boom.swing(0.0)
        wait_until(lambda: len(robot.take()) == 4 and boom.acknowledged())
    with UdpBoom(swings.port) as boom:
        boom.swing(0.1)
        wait_until(lambda: swings.newest() == 0.1)
        wait_until(boom.acknowledged)


def test_an_answer_counts_only_from_the_robot_and_for_a_line_that_was_sent(swings):
    with UdpBoom(swings.port) as boom:
        boom.swing(0.0)
        answers = (
            f"heard {boom._number + 1}",
            "heard 999999999999999999",
            "heard x",
            "heard",
        )
        numbers = [number_heard(boom, answer) for answer in answers]
        assert numbers == [0, 0, 0, 0]
        assert number_heard(boom, f"heard {boom._number}") == boom._number


def number_heard(boom, answer):
    return actuator._number_in(answer.encode(), b"heard", boom._number)


def test_a_robot_that_hears_nothing_rests_by_itself():
    robot = UdpSwings(silence_s=0.05)
    try:
        with UdpBoom(robot.port) as boom:
            boom.swing(0.3)
            wait_until(lambda: robot._swing == 0.3)
            time.sleep(0.1)
            assert robot.newest() == 0.0  # too old to be executed
            assert robot.silences == 1
            boom.swing(0.4)
            wait_until(lambda: robot._swing == 0.4)
            assert robot.newest() == 0.4
    finally:
        robot.close()


def test_a_heartbeat_of_old_keeps_no_swing_alive(swings):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in (b"alive 7", b"alive 6", b"alive 7"):
            sender.sendto(line, ("127.0.0.1", swings.port))
        wait_until(lambda: swings.outdated == 2)
    assert swings.beats == 1
