import socket
import threading
import time
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import numpy as np
import pytest
from loopback import LONG_S, our_threads, wait_until
from loopback_server import UdpSwings

from hopdata.errors import ConfigError
from hopdata.steering.live import safety
from hopdata.steering.live.packets import LiveError, PortError
from hopdata.steering.live.safety import (
    Limits,
    NoBoom,
    Sender,
    UdpBoom,
    Watch,
    rest_within,
)


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


# A rest is sent until it is heard.


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
                _, number, rad = line.split()
                self.lines.append((int(number), float(rad)))
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


@contextmanager
def watched(boom):
    """Yield a watch whose cause is in a list, and the list."""
    causes = []
    with Watch(boom, lambda: causes[0] if causes else "") as watch:
        yield watch, causes


def test_a_rest_is_sent_until_it_is_heard_and_no_longer():
    with (
        DeafRobot(deaf_to=5) as robot,
        UdpBoom(robot.port) as boom,
        watched(boom) as (watch, cause),
    ):
        assert watch.swing(0.3) == ""
        cause.append("the operator's key")
        wait_until(
            lambda: len(robot.take()) >= 6
        )  # the swing, four lost rests, and one heard
        wait_until(lambda: robot.take() and watch._sender._rest is None)
        heard = len(robot.take())
        time.sleep(0.1)  # ten looks
        assert len(robot.take()) == heard
    numbers, swings = zip(*robot.lines, strict=True)
    assert swings == (0.3, *[0.0] * (len(swings) - 1))
    assert list(numbers) == sorted(set(numbers))  # each is newer than the one before
    (rest,) = watch.rests
    assert rest.cause == "the operator's key"


def test_a_swing_is_not_repeated_though_it_is_not_heard():
    with (
        DeafRobot(deaf_to=100) as robot,
        UdpBoom(robot.port) as boom,
        watched(boom) as (watch, _),
    ):
        assert watch.swing(0.3) == ""
        time.sleep(0.1)
        assert [rad for _, rad in robot.take()] == [0.3]


def test_a_rest_that_is_never_heard_is_told_at_the_end(caplog):
    with DeafRobot(deaf_to=10**6) as robot, UdpBoom(robot.port) as boom:
        with watched(boom) as (watch, cause):
            cause.append("the end")
            wait_until(lambda: watch.rests)
        assert len(robot.take()) > 10
    assert "the boom did not acknowledge the last rest" in caplog.text


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


# A driver that blocks.


class BlockedBoom:
    """Blocks at the swing with this number, from 0, until it is released."""

    def __init__(self, at):
        self.swings, self.released, self._at = [], threading.Event(), at

    def swing(self, rad):
        self.swings.append(rad)
        if len(self.swings) == self._at + 1:
            assert self.released.wait(LONG_S)


def test_a_driver_that_blocks_is_a_cause_and_holds_up_nobody():
    boom = BlockedBoom(1)
    watch = Watch(boom, lambda: "", patience_s=1.0)
    with watch:
        assert watch.swing(0.1) == ""
        assert "driver has not returned within 1 s" in watch.swing(0.2)
        wait_until(
            lambda: watch.cause.startswith("the boom's driver has not returned for")
        )
        assert watch.swing(0.3) == watch.cause  # refused at once
        assert boom.swings == [0.1, 0.2]
        assert not watch.rests  # none has arrived
        boom.released.set()
        wait_until(lambda: watch.rests)
        assert boom.swings[:3] == [0.1, 0.2, 0.0]
        wait_until(lambda: not watch.cause)
        assert watch.swing(0.4) == ""
    assert boom.swings[-1] == 0.4


def test_a_driver_that_takes_its_time_but_returns_is_no_cause():
    boom = SimpleNamespace(swing=lambda _: time.sleep(0.05))
    with Watch(boom, lambda: "", patience_s=LONG_S) as watch:
        assert watch.swing(0.1) == ""
        assert watch.cause == ""
    assert not watch.rests


def test_of_commands_that_wait_only_the_newest_is_sent():
    boom = BlockedBoom(0)
    sender = Sender(boom, time.monotonic)
    with sender:
        first = sender.put(0.1)
        wait_until(lambda: boom.swings)
        second, third = sender.put(0.2), sender.put(0.3)
        boom.released.set()
        assert third.done.wait(LONG_S)
    assert boom.swings == [0.1, 0.3]
    assert (first.replaced, second.replaced, third.replaced) == (False, True, False)


def test_a_driver_that_never_returns_is_an_error_at_the_end(monkeypatch):
    monkeypatch.setattr(safety, "LAST_REST_S", 0.1)
    boom = BlockedBoom(0)
    watch = Watch(boom, lambda: "", patience_s=0.05).start()
    watch.swing(0.1)
    with pytest.raises(
        LiveError, match=r"the boom's driver has not returned for 0\.\d s"
    ):
        watch.close()
    boom.released.set()
    wait_until(lambda: our_threads() == [])


def test_the_last_rest_does_not_wait_for_a_driver_that_blocks():
    boom = BlockedBoom(0)
    assert not rest_within(boom, 0.05)
    boom.released.set()
    assert rest_within(boom, LONG_S)
    assert boom.swings == [0.0, 0.0]

    def broken(_):
        raise OSError("cable")

    assert rest_within(SimpleNamespace(swing=broken), LONG_S)  # it has returned


@pytest.mark.parametrize("wrong", [0, -1, np.nan])
def test_a_number_of_wrong_swings_that_would_end_no_drive_is_refused(wrong):
    with pytest.raises(ConfigError, match="wrong_swings: expected 1 or more, found"):
        Limits(wrong_swings=wrong)


class Deaf:
    """A boom that cannot tell whether it has heard: its line is gone."""

    def __init__(self):
        self.swings = []

    def swing(self, rad):
        self.swings.append(rad)

    def acknowledged(self):
        raise OSError("no such port")


def test_a_boom_that_fails_to_tell_is_sent_its_rests_all_the_same():
    boom, cause = Deaf(), [""]
    watch = Watch(boom, lambda: cause[0])
    watch.start()
    try:
        assert watch.swing(0.0) == ""
        wait_until(lambda: len(boom.swings) > 3)
        assert watch.swing(0.3) == ""
        cause[0] = "the end"
        wait_until(lambda: watch.rests)
        assert boom.swings[-1] == 0.0
    finally:
        watch.close()


class Slow:
    """A driver that returns late once."""

    def __init__(self):
        self.swings, self.go = [], threading.Event()

    def swing(self, rad):
        self.swings.append(rad)
        if rad == 0.4:
            self.go.wait(5.0)


def test_a_swing_that_was_given_up_is_followed_by_a_rest_and_never_sent_later():
    boom = Slow()
    watch = Watch(boom, lambda: "", patience_s=0.05)
    # Without the watch's own looks, which would send a rest as well
    watch._sender.start()
    assert "has not returned within 0.05 s" in watch.swing(0.4)
    assert "has not returned within 0.05 s" in watch.swing(
        0.2
    )  # waits behind the first
    boom.go.set()
    wait_until(lambda: boom.swings[-1] == 0.0)
    time.sleep(0.05)
    assert boom.swings == [0.4, 0.0]
    watch._sender.close()


def test_an_answer_counts_only_from_the_robot_and_for_a_line_that_was_sent(swings):
    with UdpBoom(swings.port) as boom:
        boom.swing(0.0)
        answers = (
            f"heard {boom._number + 1}",
            "heard 999999999999999999",
            "heard x",
            "heard",
        )
        numbers = [boom._number_heard(answer.encode()) for answer in answers]
        assert numbers == [0, 0, 0, 0]
        assert boom._number_heard(f"heard {boom._number}".encode()) == boom._number
