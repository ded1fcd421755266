import math
from types import SimpleNamespace

import numpy as np
import pytest
from test_loop import LENIENT, Boom, Controller, Detector, Tracker

from hopdata.errors import RecordingError
from hopdata.steering.live.buffer import Frame, FrameBuffer, LoopCounts, Status
from hopdata.steering.live.log import DriveLog, read_log, replay
from hopdata.steering.live.loop import ControlLoop
from hopdata.steering.live.safety import Rest


def logged(path, controller, groups=12):
    """Log a loop without threads, on a simulated clock, that takes a few frames at a time."""
    log = DriveLog(path, 3, setup={"to": [0, 0]}, files={"a.txt": b"content"})
    buffer, now, fault = FrameBuffer(8), [0.0], [""]
    boom = Boom()
    loop = ControlLoop(
        buffer, lambda: (Tracker(), Detector()), controller, boom, limits=LENIENT,
        on_decision=log.decision, on_frames=log.frames, clock=lambda: now[0],
        fault=lambda: fault[0],
    )  # fmt: skip
    log.start(lambda: None)
    rng, number = np.random.default_rng(3), 0
    for k in range(groups):
        frames, fault[0] = [], "the stream is lost" if k == 5 else ""
        for stance in rng.random(1 + k % 3) < 0.7:
            number += 1
            x, noise = rng.standard_normal(2) * [1.0, 0.005]
            angle = sum(boom.swings) + noise  # it follows
            markers = np.array([[x, 2.0, 0.0 if stance else 0.3], [angle, 0, 0], [0, 0, 0]])
            at_s = 0.01 * number
            frames.append(Frame(0, number, at_s, 100 + at_s, 100 + at_s, markers))
        for frame in frames:
            buffer.write(frame)
        now[0] = 100 + 0.01 * number + 1e-3 * rng.random()
        loop.take(frames)
    log.events([Status("streaming", 100.0), Status("lost", 101.0, "hung up")],
               [Rest(101.0, 101.01, "ä" * 300)])  # fmt: skip
    log.close(102.0, {"loop": LoopCounts(frames=7)})
    return loop.decisions()


class Learner(Controller):
    """A controller whose plan depends on all previous requests."""

    def plan(self, pose, boom_angle_rad, previous_swing_rad, /):
        super().plan(pose, boom_angle_rad, previous_swing_rad)
        return SimpleNamespace(swing_rad=0.1 * math.sin(sum(boom for _, boom in self.asked)))


def observers():
    return Tracker(), Detector()


def test_a_log_is_read_back(tmp_path):
    decisions = logged(tmp_path / "new" / "drive.h5", Learner())
    log = read_log(tmp_path / "new" / "drive.h5")
    assert log.setup == {"to": [0, 0]}
    assert log.files == {"a.txt": b"content"}
    assert len(log.decisions) == len(decisions) > 8
    for row, decision in zip(log.decisions.itertuples(), decisions, strict=True):
        assert tuple(row.pose) == decision.pose
        assert (row.outcome, row.reason) == (decision.outcome, decision.reason)
        np.testing.assert_equal(row.command_rad, decision.command_rad)
    assert {"planned", "held", "overtaken"} == set(log.decisions.outcome)
    assert list(log.events.kind) == ["streaming", "lost", "rest"]
    assert log.events.text[1] == "hung up"
    assert set(log.events.text[2]) == {"ä"}
    assert log.counts.set_index("count").value["loop.frames"] == 7


def test_a_log_played_again_gives_the_same_plans_to_the_bit(tmp_path):
    decisions = logged(tmp_path / "drive.h5", Learner())
    plans = replay(read_log(tmp_path / "drive.h5"), observers, Learner(), limits=LENIENT)
    asked = [d.planned_rad for d in decisions if math.isfinite(d.planning_s)]
    assert 3 < len(asked) < len(decisions)
    assert plans.same.all()
    assert list(plans.now_rad) == list(plans.then_rad) == asked


def test_another_controller_plans_otherwise(tmp_path):
    logged(tmp_path / "drive.h5", Learner())
    plans = replay(read_log(tmp_path / "drive.h5"), observers, Controller(), limits=LENIENT)
    assert not plans.same.any()
    assert set(plans.now_rad) == {0.25}


def test_a_log_without_a_frame_is_played_too(tmp_path):
    logged(tmp_path / "drive.h5", Learner(), groups=0)
    assert not len(replay(read_log(tmp_path / "drive.h5"), observers, Learner()))


def test_a_log_that_cannot_be_written_holds_up_nobody(tmp_path, caplog):
    log = DriveLog(tmp_path / "drive.h5", 3, setup={}, files={})
    log._file["frames"].resize = None
    log._waiting["frames"].append(("not", "a", "frame"))
    log._write()
    assert "the log could not be written" in caplog.text


@pytest.mark.parametrize(("content", "found"), [(None, "no file"), (b"text", "another file")])
def test_what_is_no_log_is_refused(tmp_path, content, found):
    path = tmp_path / "drive.h5"
    if content is not None:
        path.write_bytes(content)
    message = f"drive.h5: expected the log of a drive .*, found {found}"
    with pytest.raises(RecordingError, match=message):
        read_log(path)
