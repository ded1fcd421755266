import math
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from loopback import LONG_S, our_threads, wait_until

from hopdata.messages import Message
from hopdata.steering.live.buffer import Frame, FrameBuffer
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import ControlLoop
from hopdata.steering.live.machine import DriveState, Machine
from hopdata.steering.observation.tracking import MISFIT, SEEN

PERIOD_S = 0.01
ANY = 10**6  # wrong swings: the boom's angle is whatever the test shows
# A loaded machine may pause.
LENIENT = Limits(pose_age_s=LONG_S, command_s=LONG_S, fence_m=1e3, wrong_swings=ANY)


class Tracker:
    """Takes pose and height from the first marker, and the boom angle from x of the second."""

    def feed(self, _, markers):
        if markers[2, 0] > 0:
            raise ValueError("mixed up")
        pose = np.array([markers[0, 0], markers[0, 1], 0.5])
        if np.isnan(markers[0, 0]):
            pose[:] = np.nan
        return SimpleNamespace(
            pose=pose, height_m=markers[0, 2], boom_angle_rad=markers[1, 0],
            state=(markers[1, 0],), lacking=(),
            status=MISFIT if markers[2, 1] > 0 else SEEN,
            rotation=np.diag([1.0, 1.0, np.cos(markers[2, 2])]), residual_m=0.0,
        )  # fmt: skip


class Detector:
    """Reports a stance for each frame at height 0, dated 20 ms before it."""

    def feed(self, time_s, height_m):
        return SimpleNamespace(time_s=time_s - 0.02) if height_m == 0 else None


class Controller:
    def __init__(self, plan=lambda *_: 0.25):
        self.asked, self.swung, self._plan = [], [], plan

    def plan(self, pose, boom_angle_rad, previous_swing_rad, /):
        self.asked.append((pose.tolist(), boom_angle_rad))
        self.swung.append(previous_swing_rad)
        return SimpleNamespace(swing_rad=self._plan(pose, boom_angle_rad))


class Boom:
    def __init__(self):
        self.swings = []

    def swing(self, rad):
        self.swings.append(rad)


class Bench:
    """A loop with a buffer that the test fills, and with times that the test chooses."""

    def __init__(self, controller=None, boom=None, **options):
        self.buffer, self.controller = FrameBuffer(64), controller or Controller()
        self.boom, self.observers = boom or Boom(), 0
        options = {"limits": LENIENT, "machine": Machine(is_armed=True)} | options
        self.loop = ControlLoop(
            self.buffer, self._fresh, self.controller, self.boom, **options
        )
        self.time_s = 0.0

    def _fresh(self):
        self.observers += 1
        return Tracker(), Detector()

    def frame(
        self, *, stance=False, x=1.0, boom=3.0, age_s=0.0, epoch=0, mixed_up=False, misfit=False,
        tilt=0.0,
    ):  # fmt: skip
        self.time_s += PERIOD_S
        now = time.monotonic()
        markers = np.array(
            [[x, 2.0, 0.0 if stance else 0.3], [boom, 0, 0], [mixed_up, misfit, tilt]]
        )
        number = round(self.time_s / PERIOD_S)
        self.buffer.write(Frame(epoch, number, self.time_s, now, now - age_s, markers))

    def decided(self, count=1):
        wait_until(lambda: len(self.loop.decisions()) >= count)
        return self.loop.decisions()

    def __enter__(self):
        self.loop.start()
        return self

    def __exit__(self, *_):
        self.loop.close()
        assert our_threads() == []


def test_a_stance_is_planned_with_its_pose_and_sent():
    with Bench() as bench:
        bench.frame(x=1.5)  # 20 ms before the frame that reveals the stance
        bench.frame(x=4.0)
        bench.frame(stance=True, x=7.0)
        (decision,) = bench.decided()
    assert bench.controller.asked == [([1.5, 2.0, 0.5], 3.0)]
    assert bench.boom.swings == [0.25]
    assert (decision.outcome, decision.command_rad, decision.reason) == (
        "planned",
        0.25,
        None,
    )
    assert (decision.pose, decision.boom_angle_rad) == ((1.5, 2.0, 0.5), 3.0)
    assert decision.stance_s == pytest.approx(0.01)
    assert decision.told_s == pytest.approx(0.03)
    assert decision.since_stance_s == pytest.approx(0.02 + decision.latency_s, abs=1e-4)
    assert 0 <= decision.planning_s <= decision.latency_s


def batch(**options):
    """Return a loop that receives a stance and a later frame at once, as after a delay."""
    bench = Bench(**options)
    bench.frame(stance=True, x=1.5, age_s=0.15)
    bench.frame(x=7.0, boom=1.0)
    bench.loop.take(bench.buffer.since(0))
    return bench, *bench.loop.decisions()


def test_a_stance_is_planned_with_its_own_pose_not_with_that_of_later_frames():
    bench, decision = batch()
    assert bench.controller.asked == [([1.5, 2.0, 0.5], 3.0)]
    assert bench.boom.swings == [0.25]
    assert decision.pose_age_s >= 0.15


def test_a_later_frame_does_not_make_the_pose_of_a_stance_fresh():
    bench, decision = batch(limits=replace(LENIENT, pose_age_s=0.1))
    assert bench.controller.asked == []
    assert bench.boom.swings == [0.0]
    assert decision.outcome == "held"
    assert str(decision.reason).startswith("stale pose: ")


def test_the_swing_of_the_hop_before_is_measured():
    with Bench(limits=replace(LENIENT, hop_s=3 * LONG_S)) as bench:
        for k, boom in enumerate((3.0, -3.0, 1.0)):
            bench.frame(stance=True, boom=boom)
            bench.decided(k + 1)
        bench.loop._last_stance = (time.monotonic() - 9 * LONG_S, 1.0)
        bench.frame(stance=True, boom=1.0)
        bench.decided(4)
    across = 2 * math.pi - 6
    assert bench.controller.swung == [
        None,
        pytest.approx(across),
        pytest.approx(4 - 2 * math.pi),
        None,
    ]


def test_after_a_stance_without_a_plan_a_controller_is_not_told_the_swing_before():
    """One that learns would take the two hops since its last plan for one."""
    with Bench(limits=replace(LENIENT, hop_s=3 * LONG_S)) as bench:
        bench.frame(stance=True, boom=3.0)
        bench.decided(1)
        bench.frame(stance=True, boom=2.0, age_s=2 * LONG_S)
        bench.decided(2)
        bench.frame(boom=2.0)
        wait_until(lambda: bench.loop.watch.arm() is None)
        bench.frame(stance=True, boom=1.0)
        bench.decided(3)
        bench.frame(stance=True, boom=0.5)
        decisions = bench.decided(4)
    assert [one.outcome for one in decisions] == [
        "planned",
        "held",
        "planned",
        "planned",
    ]
    assert bench.controller.swung == [None, None, pytest.approx(-0.5)]


def test_no_stance_no_command():
    with Bench() as bench:
        for _ in range(20):
            bench.frame()
        wait_until(lambda: bench.loop.counts.frames == 20)
    assert bench.boom.swings == []


def test_a_pose_that_is_not_seen_is_taken_from_the_frame_before():
    with Bench() as bench:
        bench.frame(x=7.0)
        bench.frame(stance=True, x=math.nan, boom=math.nan)
        (decision,) = bench.decided()
    assert decision.outcome == "planned"
    assert decision.pose[0] == 7.0


@pytest.mark.parametrize(
    ("stale", "name"), [({"x": math.nan}, "pose"), ({"boom": math.nan}, "boom angle")]
)
def test_nothing_is_planned_with_what_is_stale(stale, name):
    with Bench() as bench:
        bench.frame(x=7.0, age_s=2 * LONG_S)
        bench.frame(stance=True, **stale)
        (decision,) = bench.decided()
    assert bench.controller.asked == []
    assert set(bench.boom.swings) == {0.0}
    assert decision.outcome == "held"
    assert str(decision.reason).startswith(f"stale {name}: 6")
    assert math.isnan(decision.planning_s)


def test_nothing_is_planned_without_any_pose():
    with Bench() as bench:
        bench.frame(stance=True, x=math.nan)
        (decision,) = bench.decided()
    assert (decision.outcome, str(decision.reason)) == ("held", "no pose yet")
    assert all(map(math.isnan, decision.pose))


def test_a_stance_that_is_told_too_late_is_held():
    with Bench(limits=Limits(pose_age_s=9 * LONG_S, command_s=LONG_S)) as bench:
        bench.frame(stance=True, age_s=2 * LONG_S)
        (decision,) = bench.decided()
    assert bench.boom.swings == [0.0]
    assert decision.reason.code == "steering.stance_late"


def test_a_plan_that_comes_too_late_is_not_sent():
    slow = Controller(lambda *_: time.sleep(0.3) or 0.25)
    with Bench(slow, limits=Limits(LONG_S, command_s=0.25)) as bench:
        bench.frame(stance=True)
        (decision,) = bench.decided()
    assert set(bench.boom.swings) == {0.0}  # while the plan was still computed
    assert decision.reason.code == "steering.plan_came_late"
    assert bench.loop.watch.rests[0].cause.code == "steering.plan_late"


def test_a_controller_that_fails_brings_it_to_rest_until_it_is_armed_again():
    answers = iter([ZeroDivisionError("no way out"), 0.5])

    def plan(pose, boom):
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    with Bench(Controller(plan)) as bench:
        bench.frame(stance=True)
        bench.decided(1)
        bench.frame(stance=True)
        first, second = bench.decided(2)
        assert bench.loop.arm() is None
        bench.frame(stance=True)
        third = bench.decided(3)[-1]
    assert first.outcome == second.outcome == "held"
    assert "ZeroDivisionError('no way out')" in str(first.reason)
    assert second.reason == first.reason
    assert third.outcome == "planned"
    assert set(bench.boom.swings[:-1]) == {0.0}
    assert bench.boom.swings[-1] == 0.5


def test_a_drive_that_nobody_has_armed_sends_nothing():
    with Bench(machine=Machine()) as bench:
        bench.frame(stance=True)
        (waited,) = bench.decided(1)
        assert bench.boom.swings == []
        assert bench.controller.asked == []
        assert bench.loop.state is DriveState.WAITING
        assert bench.loop.arm() is None
        assert bench.loop.state is DriveState.ARMED
        bench.frame(stance=True)
        bench.decided(2)
        assert bench.loop.state is DriveState.RUNNING
    assert (waited.outcome, str(waited.reason)) == (
        "waiting", "the operator has not armed it",
    )  # fmt: skip
    assert math.isnan(waited.command_rad)
    assert bench.boom.swings == [0.25]


def test_a_drive_without_a_frame_cannot_be_armed():
    loop = Bench(machine=Machine()).loop
    assert loop.arm().code == "steering.no_frame_yet"
    assert loop.state is DriveState.WAITING


def test_a_plan_that_is_made_after_the_end_is_not_sent():
    bench = Bench()
    bench.controller = Controller(lambda *_: bench.loop._stop.set() or 0.25)
    bench.loop._controller = bench.controller
    with bench:
        bench.frame(stance=True)
        (decision,) = bench.decided()
    assert bench.boom.swings == [0.0]
    assert decision.reason.code == "steering.ended_meanwhile"


@pytest.mark.parametrize("swing", [math.nan, math.inf])
def test_a_swing_that_is_no_number_is_not_sent(swing):
    with Bench(Controller(lambda *_: swing)) as bench:
        bench.frame(stance=True)
        (decision,) = bench.decided()
    assert set(bench.boom.swings) == {0.0}
    assert decision.reason.code == "steering.no_number"


def test_a_swing_beyond_the_limit_is_cut():
    with Bench(
        Controller(lambda *_: -2.0), limits=replace(LENIENT, swing_rad=1.0)
    ) as bench:
        bench.frame(stance=True)
        (decision,) = bench.decided()
    assert bench.boom.swings == [-1.0]
    assert decision.outcome == "cut"


def test_a_boom_that_fails_is_noted_and_told_to_rest():
    class Broken(Boom):
        def swing(self, rad):
            super().swing(rad)
            raise OSError("cable")

    with Bench(boom=Broken()) as bench:
        bench.frame(stance=True)
        bench.decided(1)
        bench.frame(stance=True)
        decisions = bench.decided(2)
    assert {str(d.reason) for d in decisions} == {"the boom failed: OSError('cable')"}
    assert bench.boom.swings[0] == 0.25
    assert set(bench.boom.swings[1:]) == {0.0}


def test_of_stances_that_wait_only_the_newest_is_planned():
    free = threading.Event()
    with Bench(Controller(lambda *_: free.wait(LONG_S) and 0.25)) as bench:
        bench.frame(stance=True)
        wait_until(lambda: bench.controller.asked)
        for _ in range(3):
            bench.frame(stance=True)
        free.set()
        decisions = bench.decided(4)
    assert [d.outcome for d in decisions] == [
        "planned",
        "overtaken",
        "overtaken",
        "planned",
    ]
    assert bench.boom.swings == [0.25, 0.25]


def test_frames_that_cannot_be_understood_are_counted():
    with Bench() as bench:
        bench.frame(mixed_up=True)
        bench.frame(stance=True)
        (decision,) = bench.decided()
        assert bench.loop.counts.failed == 1
        assert "mixed up" in bench.loop.last_failure
    assert decision.outcome == "planned"


def test_another_camera_clock_is_observed_anew_but_the_same_one_is_not():
    with Bench() as bench:
        bench.frame(epoch=0)
        bench.frame(epoch=1)  # a new connection to the same clock
        bench.frame(stance=True, epoch=1)
        bench.decided(1)
        assert bench.observers == 1
        bench.time_s = -100.0
        bench.frame(stance=True, epoch=2)
        bench.decided(2)
        assert bench.observers == 2


def test_a_listener_that_fails_does_not_end_the_loop():
    heard = []

    def listen(decision):
        heard.append(decision)
        raise RuntimeError("disk full")

    with Bench(on_decision=listen) as bench:
        bench.frame(stance=True)
        bench.decided(1)
        bench.frame(stance=True)
        assert bench.decided(2) == tuple(heard)


def test_a_loop_that_is_overrun_says_so():
    free = threading.Event()
    with Bench(Controller(lambda *_: free.wait(LONG_S) and 0.25)) as bench:
        bench.frame(stance=True)
        wait_until(lambda: bench.controller.asked)
        with bench.loop._observing:  # nor does the watch observe them meanwhile
            for _ in range(100):
                bench.frame()
        free.set()
        wait_until(lambda: bench.loop.counts.frames + bench.loop.counts.overrun == 101)
    assert bench.loop.counts.overrun == 100 - 64


def test_closing_ends_the_thread_at_once():
    with Bench() as bench:
        start = time.monotonic()
    assert time.monotonic() - start < LONG_S
    bench.loop.close()
    Bench().loop.close()


# For each cause, the loop brings the boom to rest, logs it, and the time is printed.


def rested(bench, cause_s, words, *, over=False):
    """Wait for the rest, and return its time after the cause."""
    wait_until(lambda: bench.loop.watch.rests)
    rest = bench.loop.watch.rests[-1]
    print(f"{words}: at rest {1e3 * (rest.sent_s - cause_s):.1f} ms after its cause")
    assert words in str(rest.cause)
    assert bench.boom.swings[-1] == 0.0
    assert cause_s - 0.01 < rest.seen_s <= rest.sent_s
    wait_until(lambda: bench.stop.is_set() == over)


def hopping(**options):
    """Return a bench that has swung once, so that there is something to bring to rest."""
    stop = threading.Event()
    bench = Bench(stop=stop, **options)
    bench.stop = stop
    return bench


def swung(bench):
    bench.frame(stance=True)
    bench.decided()
    assert bench.boom.swings == [0.25]


ALERT = replace(LENIENT, pose_age_s=0.1)
KEY = Message("steering.operators_key")
FAULTS = {
    "left the arena": ({"x": 2e3}, 1, True),
    "tips over: leans by 60 degrees": ({"tilt": np.pi / 3}, 1, True),
    "do not fit together": ({"misfit": True}, 3, False),
    "could not be understood": ({"mixed_up": True}, 3, False),
}


@pytest.mark.parametrize("words", FAULTS)
def test_what_a_frame_shows_brings_the_boom_to_rest(words, caplog):
    what, frames, over = FAULTS[words]
    with hopping() as bench:
        swung(bench)
        cause_s = time.monotonic()
        for _ in range(frames):
            bench.frame(**what)
        rested(bench, cause_s, words, over=over)
        bench.frame(stance=True)
        assert bench.decided(2)[-1].outcome == "held"  # though this frame is sound
        assert (bench.loop.arm() is None) == (not over)
        bench.frame(stance=True)
        last = bench.decided(3)[-1]
    assert words in caplog.text
    assert last.outcome == ("held" if over else "planned")


def test_frames_that_no_longer_come_or_come_again_bring_it_to_rest():
    with hopping(limits=ALERT) as bench:
        swung(bench)
        rested(
            bench,
            bench.buffer.newest().captured_s + ALERT.pose_age_s,
            "no frame for 0.1",
        )
        assert bench.loop.arm().code == "steering.no_frame"
        bench.frame(stance=True)
        assert bench.decided(2)[-1].reason.code == "steering.no_frame"
        assert bench.loop.arm() is None
        bench.frame(stance=True)
        assert bench.decided(3)[-1].outcome == "planned"


def test_frames_that_are_held_up_on_their_way_bring_it_to_rest():
    with hopping(limits=ALERT) as bench:
        swung(bench)
        bench.frame(age_s=0.5)
        rested(bench, time.monotonic(), "no frame for 0.5")


def test_a_plan_that_never_comes_brings_it_to_rest():
    given_up = threading.Event()
    stuck = Controller(lambda *_: given_up.wait(LONG_S))
    with hopping(controller=stuck, limits=replace(LENIENT, command_s=0.1)) as bench:
        bench.frame(stance=True)
        rested(bench, bench.buffer.newest().captured_s - 0.02 + 0.1, "planned too late")
        given_up.set()
    assert set(bench.boom.swings) == {0.0}


def test_the_operator_s_key_brings_it_to_rest_for_good():
    with hopping() as bench:
        swung(bench)
        cause_s = time.monotonic()
        bench.loop.end(KEY)
        rested(bench, cause_s, "the operator's key", over=True)
        bench.frame(stance=True)
        assert bench.decided(2)[-1].reason == KEY
        assert bench.loop.arm() == KEY
    assert set(bench.boom.swings[1:]) == {0.0}


def test_an_exception_in_the_loop_s_thread_brings_it_to_rest_for_good(monkeypatch):
    with hopping() as bench:
        swung(bench)
        monkeypatch.setattr(bench.loop, "_decide", None)
        cause_s = time.monotonic()
        bench.frame(stance=True)
        rested(bench, cause_s, "the control loop failed", over=True)


def test_a_lost_stream_brings_it_to_rest():
    lost = []
    with hopping(fault=lambda: lost[0] if lost else None) as bench:
        swung(bench)
        cause_s = time.monotonic()
        values = {"state": "lost", "reason": "the server has hung up"}
        lost.append(Message("steering.stream_lost", values))
        rested(bench, cause_s, "the server has hung up")


def test_a_boom_that_fails_to_rest_is_told_again():
    class Deaf(Boom):
        def swing(self, rad):
            super().swing(rad)
            if self.swings.count(0.0) in (1, 2):
                raise OSError("not connected")

    with hopping(boom=Deaf()) as bench:
        swung(bench)
        bench.loop.end(KEY)
        rested(bench, 0.0, "the operator's key", over=True)
    assert bench.boom.swings == [0.25, 0.0, 0.0, 0.0]


# Frames are observed while a plan is made, too.


def test_what_a_frame_shows_while_a_plan_is_made_brings_it_to_rest_at_once():
    free = threading.Event()
    with hopping(controller=Controller(lambda *_: free.wait(LONG_S) and 0.25)) as bench:
        bench.frame(stance=True)
        wait_until(lambda: bench.controller.asked)
        cause_s = time.monotonic()
        for _ in range(3):
            bench.frame(misfit=True)
        rested(bench, cause_s, "do not fit together")
        free.set()
        (decision,) = bench.decided()
    assert decision.reason.code == "steering.markers_misfit"
    assert 0.25 not in bench.boom.swings


def test_a_stance_that_is_seen_while_a_plan_is_made_is_planned_afterwards():
    free = threading.Event()
    with Bench(Controller(lambda *_: free.wait(LONG_S) and 0.25)) as bench:
        bench.frame(stance=True, x=1.5)
        wait_until(lambda: bench.controller.asked)
        for _ in range(3):
            bench.frame(x=2.5)
        bench.frame(stance=True, x=3.5)
        wait_until(lambda: bench.loop.counts.frames == 5)
        free.set()
        first, second = bench.decided(2)
    assert (first.pose[0], second.pose[0]) == (1.5, 2.5)
    assert bench.boom.swings == [0.25, 0.25]
