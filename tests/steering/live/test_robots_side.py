"""The robot's side as docs/live.md tells it, against the packets that are sent."""

import math
import socket
import time
from pathlib import Path

import pytest
from loopback import wait_until

from hopdata.steering.live.actuator import SILENCE_S, UdpBoom

PAGE = Path(__file__).parents[3] / "docs/live.md"


class Robot:
    """The pseudo code of the page, line by line."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.highest = {"swing": 0, "alive": 0}
        self.last_heard_s = 0.0
        self.waiting = None
        self.longest = 0

    def step(self, now_s):
        try:
            line, sender = self.socket.recvfrom(1024)
        except BlockingIOError:
            line = b""
        self.longest = max(self.longest, len(line))
        word, *rest = line.decode("ascii").split(" ") if line else ("",)
        if word == "swing" and len(rest) == 2 and math.isfinite(float(rest[1])):
            self.socket.sendto(f"heard {rest[0]}\n".encode(), sender)
            if self.is_new(word, int(rest[0]), now_s):
                self.waiting = float(rest[1])
        if word == "alive" and len(rest) == 1:
            self.socket.sendto(f"alive {int(rest[0])}\n".encode(), sender)
            self.is_new(word, int(rest[0]), now_s)
        if now_s - self.last_heard_s > SILENCE_S:
            self.waiting = None
        return bool(line)

    def is_new(self, word, number, now_s):
        if number <= self.highest[word]:
            return False
        self.highest[word] = number
        self.last_heard_s = now_s
        return True


@pytest.fixture
def robot():
    made = Robot()
    yield made
    made.socket.close()


def test_the_pages_robot_hears_and_answers_what_is_sent(robot):
    with UdpBoom(robot.socket.getsockname()[1]) as boom:
        boom.swing(0.25)
        assert not boom.acknowledged()
        wait_until(lambda: robot.step(0.0))
        assert robot.waiting == 0.25
        wait_until(boom.acknowledged)
        for number in (1, 2):
            boom.alive(number)
            wait_until(lambda: robot.step(0.15))
        wait_until(lambda: boom.heard() == 2)
        boom.swing(-1.0 / 3.0)
        wait_until(lambda: robot.step(0.3))
        assert robot.waiting == -1.0 / 3.0  # to the bit
        boom.swing(-1.178097245096172)
        wait_until(lambda: robot.step(0.4))
        assert robot.longest <= 64


def test_the_pages_robot_keeps_no_swing_when_it_hears_nothing(robot):
    with UdpBoom(robot.socket.getsockname()[1]) as boom:
        boom.swing(0.25)
        wait_until(lambda: robot.step(0.0))
        robot.step(0.19)
        assert robot.waiting == 0.25
        robot.step(0.21)
        assert robot.waiting is None


def test_the_page_tells_the_time_of_silence_and_the_lines():
    page = PAGE.read_text(encoding="utf-8")
    (code,) = [block for block in page.split("```")[1::2] if "last_heard" in block]
    assert f"now() - last_heard > {SILENCE_S:g}:" in code
    for line in ('send "heard <number>\\n"', 'send "alive <number>\\n"'):
        assert line in code
    assert time.time_ns() // 1_000_000 < 2**63
