"""The watch and the sender: rests, drivers that block, heartbeats."""

import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from loopback import LONG_S, our_threads, wait_until
from loopback_server import UdpSwings
from test_actuator import DeafRobot

from hopdata.messages import Message
from hopdata.steering.live import sender
from hopdata.steering.live.actuator import NoBoom, UdpBoom
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.machine import DriveState, Machine
from hopdata.steering.live.packets import LiveError
from hopdata.steering.live.sender import Sender, rest_within
from hopdata.steering.live.watch import Watch


@pytest.fixture
def swings():
    receiver = UdpSwings()
    yield receiver
    receiver.close()


KEY = Message("steering.operators_key")


def guard(boom, ask=dict, **limits):
    """Return a watch of a drive that is armed, with these limits."""
    return Watch(boom, Machine(is_armed=True), ask, limits=Limits(**limits))


def test_a_rest_is_not_lifted_when_its_cause_is_gone_but_when_it_is_armed():
    boom, causes = Kept(), {"outside": KEY}
    watch = guard(boom, lambda: causes)
    watch.look()
    assert watch.send((0.1,)) == watch.cause == KEY
    assert watch.arm() == KEY
    causes["outside"] = None
    watch.look()
    assert watch.send((0.1,)) == KEY
    assert watch.arm() is None
    assert watch.send((0.1,)) is None
    assert boom.swings[-1] == 0.1
    assert set(boom.swings[:-1]) == {0.0}


def test_a_watch_whose_question_fails_rests():
    def ask():
        raise ValueError("no answer")

    watch = guard(NoBoom(), ask)
    watch.look()
    assert watch.cause.code == "steering.watch_failed"
    assert "no answer" in str(watch.cause)


class Kept:
    """Keeps what it is told."""

    def __init__(self):
        self.swings = []

    def swing(self, rad):
        self.swings.append(rad)


@contextmanager
def watched(boom):
    """Yield a watch whose cause is in a list, and the list."""
    causes = []
    patient = {"heard_s": LONG_S, "command_s": LONG_S}
    with guard(
        boom, lambda: {"outside": causes[0] if causes else None}, **patient
    ) as watch:
        yield watch, causes


def test_a_rest_is_sent_until_it_is_heard_and_no_longer():
    with (
        DeafRobot(deaf_to=5) as robot,
        UdpBoom(robot.port) as boom,
        watched(boom) as (watch, cause),
    ):
        assert watch.send((0.3,)) is None
        cause.append(KEY)
        wait_until(
            lambda: len(robot.take()) >= 6
        )  # the swing, four lost rests, and one heard
        wait_until(lambda: robot.take() and watch._sender._unheard_rest is None)
        heard = len(robot.take())
        time.sleep(0.1)  # ten looks
        assert len(robot.take()) == heard
    numbers, swings = zip(*robot.lines, strict=True)
    assert swings == (0.3, *[0.0] * (len(swings) - 1))
    assert list(numbers) == sorted(set(numbers))  # each is newer than the one before
    (rest,) = watch.rests
    assert rest.cause == KEY


def test_a_swing_is_not_repeated_though_it_is_not_heard():
    with (
        DeafRobot(deaf_to=100) as robot,
        UdpBoom(robot.port) as boom,
        watched(boom) as (watch, _),
    ):
        assert watch.send((0.3,)) is None
        time.sleep(0.1)
        assert [rad for _, rad in robot.take()] == [0.3]


def test_a_rest_that_is_never_heard_is_told_at_the_end(caplog):
    with DeafRobot(deaf_to=10**6) as robot, UdpBoom(robot.port) as boom:
        with watched(boom) as (watch, cause):
            cause.append(KEY)
            wait_until(lambda: watch.rests)
        assert len(robot.take()) > 10
    assert "the boom did not acknowledge the last rest" in caplog.text


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
    watch = guard(boom, command_s=1.0)
    with watch:
        assert watch.send((0.1,)) is None
        assert watch.send((0.2,)).code == "steering.boom_blocked"
        wait_until(lambda: watch.machine.state is DriveState.RESTING)
        assert watch.send((0.3,)) == watch.cause  # refused at once
        assert watch.arm() is not None  # it still blocks
        assert boom.swings == [0.1, 0.2]
        assert not watch.rests  # none has arrived
        boom.released.set()
        wait_until(lambda: watch.rests)
        assert boom.swings[:3] == [0.1, 0.2, 0.0]
        wait_until(lambda: not watch.machine.lasting)
        assert watch.send((0.4,)) is not None
        assert watch.arm() is None
        assert watch.send((0.5,)) is None
    assert 0.4 not in boom.swings
    assert boom.swings[-1] == 0.5


def test_a_driver_that_takes_its_time_but_returns_is_no_cause():
    boom = SimpleNamespace(swing=lambda _: time.sleep(0.05))
    with guard(boom, command_s=LONG_S) as watch:
        assert watch.send((0.1,)) is None
        assert watch.cause is None
    assert not watch.rests


def test_of_commands_that_wait_only_the_newest_is_sent():
    boom = BlockedBoom(0)
    sender = Sender(boom, time.monotonic)
    with sender:
        first = sender.put((0.1,))
        wait_until(lambda: boom.swings)
        second, third = sender.put((0.2,)), sender.put((0.3,))
        boom.released.set()
        assert third.done.wait(LONG_S)
    assert boom.swings == [0.1, 0.3]
    assert (first.replaced, second.replaced, third.replaced) == (False, True, False)


def test_a_driver_that_never_returns_is_an_error_at_the_end(monkeypatch):
    monkeypatch.setattr(sender, "LAST_REST_S", 0.1)
    boom = BlockedBoom(0)
    watch = guard(boom, command_s=0.05).start()
    watch.send((0.1,))
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


class Deaf:
    """A boom that cannot tell whether it has heard: its line is gone."""

    def __init__(self):
        self.swings = []

    def swing(self, rad):
        self.swings.append(rad)

    def acknowledged(self):
        raise OSError("no such port")


def test_a_boom_that_fails_to_tell_is_sent_its_rests_all_the_same():
    boom, cause = Deaf(), {"outside": None}
    watch = guard(boom, lambda: cause, command_s=LONG_S)
    watch.start()
    try:
        assert watch.send((0.0,)) is None
        wait_until(lambda: len(boom.swings) > 3)
        assert watch.send((0.3,)) is None
        cause["outside"] = KEY
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
    watch = guard(boom, command_s=0.05)
    # Without the watch's own looks, which would send a rest as well
    watch._sender.start()
    assert watch.send((0.4,)).code == "steering.boom_blocked"
    assert watch.send((0.2,)).code == "steering.boom_blocked"  # refused by now
    boom.go.set()
    wait_until(lambda: boom.swings[-1] == 0.0)
    time.sleep(0.05)
    assert boom.swings == [0.4, 0.0]
    watch._sender.close()


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


class Answering(Kept):
    """Answers heartbeats for a while, `late_s` after each."""

    def __init__(self, clock, late_s=0.0, until_s=np.inf):
        super().__init__()
        self.sent, self._clock, self._late_s = [], clock, late_s
        self._until_s = until_s

    def alive(self, number):
        self.sent.append((self._clock(), number))

    def heard(self):
        heard = [
            number
            for at_s, number in self.sent
            if at_s < self._until_s and at_s + self._late_s <= self._clock()
        ]
        return max(heard, default=0)


def beaten(boom_of, *, seconds=1.0, looks=True, **limits):
    """Let a watch look every 10 ms of a simulated clock."""
    clock = Clock()
    boom = boom_of(clock)
    watch = Watch(boom, Machine(is_armed=True), clock=clock, limits=Limits(**limits))
    for k in range(round(seconds / 0.01)):
        clock.now_s = 0.01 * k
        if looks or k < 10:
            watch.look()
        else:
            watch._sender.again()
    return boom, watch


def test_heartbeats_are_numbered_and_come_every_so_often():
    boom, watch = beaten(Answering)
    at_s, numbers = zip(*boom.sent, strict=True)
    assert list(numbers) == list(range(1, len(numbers) + 1))
    assert np.diff(at_s) == pytest.approx(0.025, abs=0.0051)  # two looks, or three
    assert watch.is_acknowledging
    assert watch.machine.state is DriveState.ARMED


@pytest.mark.parametrize("late_s", [0.0, 0.05, 0.15])
def test_answers_that_come_within_their_time_are_no_fault(late_s):
    _, watch = beaten(lambda clock: Answering(clock, late_s))
    assert not watch.rests


def test_answers_that_come_too_late_are_a_fault_though_they_come():
    _, watch = beaten(lambda clock: Answering(clock, 0.3))
    assert watch.cause.code == "steering.unacknowledged"


def test_silence_of_the_boom_brings_it_to_rest_within_50_ms_of_the_limit():
    boom, watch = beaten(lambda clock: Answering(clock, until_s=0.5), heard_s=0.1)
    (rest,) = watch.rests
    assert rest.cause.code == "steering.unacknowledged"
    first_unheard_s = min(at_s for at_s, _ in boom.sent if at_s >= 0.5)
    assert 0 < rest.sent_s - (first_unheard_s + 0.1) <= 0.05
    assert rest.cause.values["limit_s"] == 0.1
    assert watch.arm() == watch.machine.lasting["acknowledgement"]


def test_a_loop_that_no_longer_looks_sends_no_more_heartbeats():
    boom, _ = beaten(Answering, looks=False)
    assert boom.sent[-1][0] < 0.1 + sender.PERMITTED_S + 0.02


def test_a_boom_that_answers_nothing_is_told_about_and_runs():
    _, watch = beaten(lambda _: Kept())
    assert not watch.is_acknowledging
    assert watch.says_of_boom().code == "steering.acknowledging_nothing"
    assert watch.send((0.3,)) is None


def test_heartbeats_over_udp_are_answered_until_the_robot_is_silent(swings):
    with UdpBoom(swings.port) as boom:
        assert boom.heard() == 0
        boom.alive(1)
        wait_until(lambda: boom.heard() == 1)
        swings.answers = False
        boom.alive(2)
        wait_until(lambda: swings.beats == 2)
        assert boom.heard() == 1
        assert not boom.acknowledged() or boom._wanted == 0
