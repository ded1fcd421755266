import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from test_loop import LENIENT, Boom, Controller, Detector, Tracker

from hopdata.errors import ConfigError, RecordingError
from hopdata.messages import Message
from hopdata.steering.live.buffer import Frame, FrameBuffer, LoopCounts, Status
from hopdata.steering.live.log import DriveLog, _reserve
from hopdata.steering.live.log_reading import RENAMED, read_log
from hopdata.steering.live.loop import ControlLoop
from hopdata.steering.live.machine import Machine
from hopdata.steering.live.replay import replay

LONG_FAULT = Message("steering.log_failed", {"failure": "ä" * 300})


def logged(path, controller, groups=12):
    """Log a loop without threads, on a simulated clock, that takes a few frames at a time."""
    log = DriveLog(path, 3, setup={"to": [0, 0]}, files={"a.txt": b"content"})
    buffer, now, fault = FrameBuffer(8), [0.0], [None]
    boom = Boom()
    loop = ControlLoop(
        buffer, lambda: (Tracker(), Detector()), controller, boom, limits=LENIENT,
        on_decision=log.decision, on_frames=log.frames, clock=lambda: now[0],
        fault=lambda: fault[0], machine=Machine(is_armed=True),
    )  # fmt: skip
    log.start(lambda: None)
    rng, number = np.random.default_rng(3), 0
    for k in range(groups):
        frames, fault[0] = [], LONG_FAULT if k == 5 else None
        if k == 7:  # the fault is gone, and the operator arms it again
            loop.watch.look()
            assert loop.arm() is None
        for stance in rng.random(1 + k % 3) < 0.7:
            number += 1
            x, noise = rng.standard_normal(2) * [1.0, 0.005]
            angle = sum(boom.swings) + noise  # it follows
            markers = np.array(
                [[x, 2.0, 0.0 if stance else 0.3], [angle, 0, 0], [0, 0, 0]]
            )
            at_s = 0.01 * number
            frames.append(Frame(0, number, at_s, 100 + at_s, 100 + at_s, markers))
        for frame in frames:
            buffer.write(frame)
        now[0] = 100 + 0.01 * number + 1e-3 * rng.random()
        loop.take(frames)
    states = [Status("streaming", 100.0), Status("lost", 101.0, "hung up")]
    log.events(states, loop.watch)
    log.close(102.0, {"loop": LoopCounts(frames=7)})
    return loop.decisions()


class Learner(Controller):
    """A controller whose plan depends on all previous requests."""

    def plan(self, pose, boom_angle_rad, previous_swing_rad, /):
        super().plan(pose, boom_angle_rad, previous_swing_rad)
        return SimpleNamespace(
            swing_rad=0.1 * math.sin(sum(boom for _, boom in self.asked))
        )


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
        reason = "" if decision.reason is None else str(decision.reason)[:100]
        assert (row.outcome, row.reason) == (decision.outcome, reason)
        assert row.code == ("" if decision.reason is None else decision.reason.code)
        np.testing.assert_equal(row.command_swing_rad, decision.command_rad)
    assert {"planned", "held", "overtaken"} == set(log.decisions.outcome)
    events = log.events.set_index("kind")
    assert list(log.events.kind) == [
        "streaming", "lost", "boom", "running", "resting", "armed", "running", "rest",
    ]  # fmt: skip
    assert events.text["lost"] == "hung up"
    assert set(events.text["rest"]) == {"ä"}
    assert events.code["resting"] == "steering.log_failed"
    assert events.code["boom"] == "steering.acknowledging_nothing"
    assert log.counts.set_index("count").value["loop.frames"] == 7


def test_a_log_played_again_gives_the_same_plans_to_the_bit(tmp_path):
    decisions = logged(tmp_path / "drive.h5", Learner())
    plans = replay(
        read_log(tmp_path / "drive.h5"), observers, Learner(), limits=LENIENT
    )
    asked = [d.planned_rad for d in decisions if math.isfinite(d.planning_s)]
    assert 3 < len(asked) < len(decisions)
    assert plans.same.all()
    assert [now for (now,) in plans.now] == [then for (then,) in plans.then] == asked


def test_another_controller_plans_otherwise(tmp_path):
    logged(tmp_path / "drive.h5", Learner())
    plans = replay(
        read_log(tmp_path / "drive.h5"), observers, Controller(), limits=LENIENT
    )
    assert not plans.same.any()
    assert set(plans.now) == {(0.25,)}


def test_a_log_without_a_frame_is_played_too(tmp_path):
    logged(tmp_path / "drive.h5", Learner(), groups=0)
    assert not len(replay(read_log(tmp_path / "drive.h5"), observers, Learner()))


def test_a_log_that_cannot_be_written_holds_up_nobody(tmp_path, caplog):
    log = DriveLog(tmp_path / "drive.h5", 3, setup={}, files={})
    log._file["frames"].resize = None
    log._waiting["frames"].append(("not", "a", "frame"))
    log._write()
    assert "the log could not be written" in caplog.text


@pytest.mark.parametrize(
    ("content", "found"), [(None, "no file"), (b"text", "another file")]
)
def test_what_is_no_log_is_refused(tmp_path, content, found):
    path = tmp_path / "drive.h5"
    if content is not None:
        path.write_bytes(content)
    message = f"drive.h5: expected the log of a drive.*, found {found}"
    with pytest.raises(RecordingError, match=message):
        read_log(path)


def test_a_log_of_an_earlier_version_is_refused_in_one_line(tmp_path):
    path = tmp_path / "drive.h5"
    logged(path, Learner())
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "hopdata drive 1"
    with pytest.raises(RecordingError, match="found one of an earlier version") as told:
        read_log(path)
    assert len(str(told.value).splitlines()) == 1


def test_a_log_of_the_hopper_alone_is_read_and_played(tmp_path):
    path = tmp_path / "drive.h5"
    logged(path, Learner())
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "hopdata drive 2"
        del file.attrs["axes"]
        rows = file["decisions"][:]
        new = {new: old for old, new in RENAMED.items()}
        kinds = []
        for name in rows.dtype.names:
            is_vector = rows.dtype[name].shape == (1,)
            kinds.append((new.get(name, name), "f8" if is_vector else rows.dtype[name]))
        earlier = np.zeros(len(rows), kinds)
        for name in rows.dtype.names:
            earlier[new.get(name, name)] = np.reshape(
                rows[name], earlier[new.get(name, name)].shape
            )
        del file["decisions"]
        file["decisions"] = earlier
    log = read_log(path)
    assert log.decisions.planned_swing_rad.notna().sum() > 3
    assert replay(log, observers, Learner(), limits=LENIENT).same.all()


def test_a_log_never_replaces_a_file(tmp_path):
    path = tmp_path / "drive.h5"
    path.write_bytes(b"precious")
    with pytest.raises(
        ConfigError, match=r"drive.h5: expected a new file, found .* exists already"
    ):
        DriveLog(path, 3, setup={}, files={})
    assert path.read_bytes() == b"precious"


# A disk that is full: HDF5 would end the process, so it never meets one.

LIMITED = """
import logging, resource, signal, sys
sys.path[:0] = [{here!r}, {benchmarks!r}]
logging.basicConfig(format="%(message)s")
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit fails as on a full disk
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
import numpy as np
from hopdata.steering.live import log
from hopdata.steering.live.buffer import Frame, LoopCounts, Status
written = log.DriveLog({path!r}, 4, setup={{}}, files={{"a.txt": b"content"}})
states = [Status("streaming", 0.0)]
written._look = lambda: written.events(states)
for k in range(4000):
    written.frames([Frame(0, k, 0.01 * k, 0.01 * k, 0.01 * k, np.full((4, 3), k))])
    if k % 100 == 0:
        written._write()  # as its thread does
    if k % 400 == 0:
        states.append(Status("stale", 0.01 * k, "pause"))
written.close(40.0, {{"loop": LoopCounts(frames=7)}})
print(repr(written.failure), sum(map(len, written._waiting.values())))
"""


def limited(path, limit):
    here = Path(__file__).parent
    code = LIMITED.format(
        here=str(here),
        benchmarks=str(here.parents[2] / "benchmarks/steering"),
        limit=limit,
        path=str(path),
    )
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.skipif(
    sys.platform == "win32", reason="limits of a process are those of POSIX"
)
@pytest.mark.parametrize("limit", [80_000, 333_333])
def test_a_log_whose_disk_is_full_keeps_what_it_has_and_says_so_once(tmp_path, limit):
    path = tmp_path / "drive.h5"
    done = limited(path, limit)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("'the log could not be written any more: ")
    assert "File too large" in done.stdout
    assert done.stdout.endswith(" 0\n")  # nothing is kept for a disk that is full
    assert done.stderr.count("the log could not be written any more") == 1
    assert "drive.h5 keeps what it has" in done.stderr
    assert path.stat().st_size <= limit
    log = read_log(path)
    assert log.files == {"a.txt": b"content"}
    number = log.frames["number"]
    assert 0 < len(number) < 4000
    assert list(number) == list(range(len(number)))
    assert (log.frames["markers"][:, 0, 0] == number).all()
    assert log.events.kind[0] == "streaming"


def test_a_log_with_room_keeps_everything(tmp_path):
    done = limited(tmp_path / "drive.h5", 5_000_000)
    assert done.stdout == "'' 0\n"
    assert done.stderr == ""
    log = read_log(tmp_path / "drive.h5")
    assert list(log.frames["number"]) == list(range(4000))
    assert log.counts.set_index("count").value["loop.frames"] == 7


def test_room_is_asked_of_the_disk_where_it_cannot_be_reserved(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    (tmp_path / "drive.h5").write_bytes(b"12345678")
    _reserve(tmp_path / "drive.h5", 1000)
    assert (tmp_path / "drive.h5").read_bytes() == b"12345678"
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=999))
    with pytest.raises(OSError, match="1000 bytes are needed, 999 are free"):
        _reserve(tmp_path / "drive.h5", 1000)


def test_reserving_room_leaves_the_file_as_it_is(tmp_path):
    path = tmp_path / "drive.h5"
    path.write_bytes(b"12345678")
    _reserve(path, 100_000)
    assert path.read_bytes() == b"12345678"


def _of_other_rows(file):
    rows = np.zeros(3, [("at_s", "f8"), ("kind", "S16")])
    del file["events"]
    file["events"] = rows


@pytest.mark.parametrize(
    "change",
    [
        lambda file: file.attrs.pop("setup"),
        lambda file: file.attrs.update(setup="[1"),
        lambda file: file.attrs.update(setup="[1]"),
        lambda file: file.pop("decisions"),
        lambda file: file.pop("counts") and file.create_group("counts"),
        _of_other_rows,
    ],
)
def test_a_log_that_others_changed_is_refused(tmp_path, change):
    path = tmp_path / "drive.h5"
    logged(path, Learner())
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(RecordingError, match="another file, or a damaged one"):
        read_log(path)
