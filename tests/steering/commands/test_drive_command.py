"""A drive of the simulated hopper from the command line, and the replay of its log."""

import errno
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hopdata.__main__ import main
from hopdata.messages import Message
from hopdata.steering.commands import drive
from hopdata.steering.commands import screen as screens
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.live import log, rehearsal, rehearsed_acts
from hopdata.steering.live.actuator import NoBoom
from hopdata.steering.live.buffer import Status, StreamCounts
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.live.machine import Machine
from hopdata.steering.live.watch import Watch
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.process_file import save_process
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry
from hopdata.steering.robot import SteeredHopper


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Write what would have been learned from a recording: the marker positions and a few hops."""
    folder, hopper = tmp_path_factory.mktemp("model"), SteeredHopper()
    body = np.array(hopper.markers.body_m)
    centre = np.array([hopper.hopper.boom_offset_m, 0, hopper.hopper.boom_height_m])
    circle = BoomCircle(centre - body.mean(axis=0), np.array([0.0, 0.0, 1.0]), 0.25)
    names = ("body1", "body2", "body3")
    HopperGeometry(
        names, body - body.mean(axis=0), 0.0006, 0.3, 0.4, "boom", circle
    ).save(folder / "geometry.json")  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(1))
    inputs = np.column_stack(
        [rng.uniform(0, 2 * np.pi, 30), rng.uniform(-1.1, 1.1, 30)]
    )
    outputs = np.column_stack(
        [0.05 + 0 * inputs[:, 0], 0.02 * np.sin(inputs[:, 0]), inputs[:, 1]]
    )
    process = FrameChangeProcess(
        axes=HOPPER, smoothness=1.5, periodic=True, points=inputs, outputs=outputs, offset=np.zeros(3),
        unit=np.array([0.02, 0.02, 0.5]), variance=np.ones(3), noise=np.full(3, 0.05),
        length_scales=np.ones((3, 2)),
    )  # fmt: skip
    save_process(folder / "model.npz", process)
    return folder


def test_a_simulated_drive_says_so_and_its_log_gives_the_same_plans(
    model, tmp_path, capsys
):
    path = tmp_path / "drive.h5"
    options = [
        "--model",
        str(model),
        "--seconds",
        "3",
        "--to=-0.5,0",
        "--adaptive",
        "--fence",
        "9",
        "--armed",
    ]
    assert main(["drive", *options, "--log", str(path)]) == 0
    out = capsys.readouterr().out
    assert "the boom acknowledges no heartbeats" in out
    assert "SIMULATED hopper; there is no robot" in out
    assert "hop 1 x" in out
    assert "\n  the end\n" in out  # one of the reasons for rest
    assert read_log(path).setup["to"] == [-0.5, 0]
    assert main(["replay", str(path)]) == 0
    out = capsys.readouterr().out
    assert "the same to the bit" in out
    assert "simulated hopper" in out


def test_a_model_that_will_probably_not_reach_a_point_is_named_before_the_start(
    tmp_path, capsys
):
    head = "expected_arrivals,error_over_width,step_over_width,covered,unresolved"
    for arrivals, words in ((0.98, ""), (0.4, "no effect of the inputs on dx and dy")):
        rows = f"{head}\n{arrivals},0.3,0.5,0.6,dx dy\n"
        (tmp_path / drive.SCORES).write_text(rows)
        drive._warn_of(tmp_path)
        said = capsys.readouterr().out
        assert said.startswith("warning: This model" if words else "")
        assert words in said
        assert bool(said) == bool(words)
    drive._warn_of(tmp_path / "no scores")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--host", "h"], "--model: expected the folder"),
        (
            ["--host", "h", "--model", "."],
            "--host: expected either --boom HOST:PORT or --dry-run",
        ),
        (["--boom", "h:5"], "--boom: expected --host with it"),
        (
            ["--host", "h", "--model", ".", "--boom", "h"],
            "--boom: expected HOST:PORT, found 'h'",
        ),
        ([], "--armed: expected it, or a terminal, on which an operator arms"),
        (
            ["--host", "h", "--model", ".", "--boom", "h:5", "--armed"],
            "--armed: expected no --boom with it",
        ),
        (
            ["--armed", "--model", "nowhere"],
            "nowhere/geometry.json: expected a hopper geometry",
        ),
    ],
)
def test_what_cannot_work_is_refused_before_anything_moves(
    options, message, tmp_path, capsys
):
    assert main(["drive", *options, "--log", str(tmp_path / "drive.h5")]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "drive.h5").exists()


def test_what_is_no_log_is_refused(tmp_path, capsys):
    assert main(["replay", str(tmp_path / "none.h5")]) == 1
    assert "expected the log of a drive" in capsys.readouterr().err


def test_a_log_that_exists_is_refused_before_anything_is_learnt_and_kept(
    tmp_path, capsys
):
    notes = tmp_path / "notes.txt"
    notes.write_text("precious\n")
    nowhere = str(tmp_path / "nowhere")
    options = ["--armed", "--model", nowhere, "--log", str(notes)]
    assert main(["drive", *options]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "--log" in err
    assert "expected a new file, found a file that exists already" in err
    assert len(err.strip().splitlines()) == 1
    assert notes.read_text() == "precious\n"


def test_a_log_that_is_not_named_is_the_next_free_one(
    model, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert drive.log_path(None) == Path("drive.h5")
    for name in ("drive.h5", "drive-2.h5"):
        (tmp_path / name).write_text("an earlier one")
    assert main(["drive", "--model", str(model), "--seconds", "0.1", "--armed"]) == 0
    assert capsys.readouterr().out.startswith("log: drive-3.h5\n")
    assert read_log(tmp_path / "drive-3.h5").setup["simulated"]
    for name in ("drive.h5", "drive-2.h5"):
        assert (tmp_path / name).read_text() == "an earlier one"


@pytest.mark.parametrize("full", ["go-on", "rest"])
def test_a_disk_that_is_full_is_told_and_the_drive_goes_on_or_rests(
    full, model, tmp_path, capsys, caplog, monkeypatch
):
    def full_disk(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(log, "_reserve", full_disk)
    path = tmp_path / "drive.h5"
    options = [
        "--model",
        str(model),
        "--seconds",
        "2",
        "--fence",
        "9",
        "--armed",
        "--log",
        str(path),
    ]
    assert main(["drive", *options, "--log-full", full]) == 0
    out = capsys.readouterr().out
    why = "the log could not be written any more: [Errno 28] No space left on device"
    assert caplog.text.count("could not be written") == (
        1 if full == "go-on" else 2
    )  # and a rest
    assert f"log: {path} holds the drive up to when {why}\n" in out
    assert (f"the boom rests: {why}" in out) == (full == "rest")
    assert not len(read_log(path).frames)


def test_a_rehearsal_brings_the_boom_to_rest_at_each_act(capsys):
    assert main(["drive", "--rehearse"]) == 0
    out, err = capsys.readouterr()
    assert "the boom rests" not in err
    for act in (
        "body1 is covered",
        "SIGTERM comes",
        "wired backwards",
        "driver blocks",
        "coordinates freeze",
        "are mirrored",
        "acknowledges no heartbeats",
    ):
        assert act in out
    assert "!" not in out
    assert "each act has brought the boom to rest, until it was armed again" in out


def test_an_act_without_its_rest_is_marked_and_gives_exit_code_1(capsys, monkeypatch):
    def perform(geometry, limits, _robot):
        first, second, third, *_ = rehearsed_acts.acts(("a", "b", "c", "boom"), limits)
        told = Message("steering.no_frame", {"age_s": 0.11, "limit_s": 0.1})
        frozen = Message("steering.markers_frozen", {"frames": 3, "for_s": 0.03})
        yield rehearsed_acts.Performed(first, told, 0.11)
        yield rehearsed_acts.Performed(second, None)
        yield rehearsed_acts.Performed(third, frozen, 9.0)
        yield rehearsed_acts.Performed(third, frozen, 0.03, moved=True)
        yield rehearsed_acts.Performed(third, frozen, 0.03, resumed=True)
        yield rehearsed_acts.Performed(third, frozen, 0.03, obeyed=False)

    monkeypatch.setattr(rehearsal, "perform", perform)
    names = SimpleNamespace(body_names=("a", "b", "c"), boom_name="boom")
    monkeypatch.setattr(rehearsal, "simulated_geometry", lambda: names)
    assert main(["drive", "--rehearse"]) == 1
    out = capsys.readouterr().out.splitlines()
    n_acts = len(rehearsed_acts.acts(("a", "b", "c", "boom"), Limits()))
    assert out[1].startswith(f"{n_acts} acts, some ")
    rows = out[4:]
    assert [row[0] for row in rows[:6]] == [" ", "!", "!", "!", "!", "!"]
    assert rows[1].endswith("-  NO REST")
    assert "TOO LATE, beyond 50 ms" in rows[2]
    assert "MOVED after its rest" in rows[3]
    assert "WENT ON by itself" in rows[4]
    assert "COULD NOT be armed again" in rows[5]
    assert rows[-1] == "5 acts without the rest expected: do not drive"


def test_with_a_robot_a_rehearsal_is_a_list_of_what_to_do(model, capsys):
    assert main(["drive", "--rehearse", "--host", "h", "--model", str(model)]) == 0
    out = capsys.readouterr().out
    assert "pull the cable of the cameras" in out
    assert "cover marker body2  " in out
    assert main(["drive", "--rehearse", "--host", "h"]) == 1
    assert "--model: expected the folder" in capsys.readouterr().err


# The operator at the terminal.


def typing(monkeypatch, lines):
    """Pretend that an operator types these lines, one at each look."""
    typed = iter(lines)
    monkeypatch.setattr(drive, "is_on_terminal", lambda: True)
    monkeypatch.setattr(screens, "is_on_terminal", lambda: True)
    monkeypatch.setattr(screens, "_typed_line", lambda: next(typed, None))
    monkeypatch.setattr(screens.Screen, "_draw", lambda *_: None)


def test_a_drive_is_armed_by_its_operator(model, tmp_path, monkeypatch):
    typing(monkeypatch, [None] * 20 + ["a"])
    path = tmp_path / "drive.h5"
    options = ["--model", str(model), "--seconds", "3", "--fence", "9"]
    assert main(["drive", *options, "--log", str(path)]) == 0
    kinds = list(read_log(path).events.kind)
    assert kinds.index("armed") < kinds.index("running") < kinds.index("stopped")
    assert main(["replay", str(path)]) == 0


def test_any_other_line_is_the_operator_s_stop_key(model, tmp_path, monkeypatch):
    typing(monkeypatch, [None, ""])
    path = tmp_path / "drive.h5"
    assert main(["drive", "--model", str(model), "--log", str(path)]) == 0
    events = read_log(path).events
    assert "steering.operators_key" in set(events.code)
    assert "armed" not in set(events.kind)


def test_the_screen_says_the_state_and_what_the_operator_can_do(monkeypatch):
    machine = Machine()
    watch = Watch(NoBoom(), machine)
    loop = SimpleNamespace(state=machine.state, watch=watch)
    stream = SimpleNamespace(
        counts=StreamCounts(), states=SimpleNamespace(status=Status("streaming", 0.0))
    )
    screen = screens.Screen("title", None, 0.2, SimpleNamespace(failure=""), HOPPER)

    def lines():
        loop.state = machine.state
        return screen._picture(loop, stream, 1.0)

    assert lines()[1] == "WAITING  a and Enter to arm it"
    watch.arm()
    assert lines()[1].startswith("ARMED  the first swing is sent")
    fault = Message("steering.no_frame", {"age_s": 0.2, "limit_s": 0.1})
    watch.report("frames", fault)
    assert lines()[1] == f"RESTING  {fault}; a and Enter to arm it"
    assert str(fault) in lines()[-1]
    watch.report("frames", None)
    assert "faults   none now" in lines()[-1]
    watch.end(Message("steering.the_end"))
    assert lines()[1] == "STOPPED  the end"


def test_before_it_is_armed_the_screen_shows_no_number_that_is_none(capsys):
    screen = screens.Screen("title", None, 0.2, SimpleNamespace(failure=""), HOPPER)
    nan = float("nan")
    decision = SimpleNamespace(
        pose=(1.0, nan, nan),
        boom_angle_rad=3.0,
        command=(nan,),
        planning_s=nan,
        since_stance_s=0.02,
        outcome="waiting",
        reason=Message("steering.not_armed"),
    )
    screen.decided(decision)
    said = capsys.readouterr().out
    assert "nan" not in said.replace("title", "")
    assert "x +1.00 m, y not seen, heading not seen, boom 172 deg" in said
    assert "waiting: no swing is sent; the operator has not armed it" in said


@pytest.mark.parametrize(
    ("angle_deg", "said"), [(-0.02, "0"), (359.6, "0"), (359.4, "359"), (-90, "270")]
)
def test_a_heading_of_a_whole_turn_is_shown_as_none(angle_deg, said):
    assert screens._degrees("heading", np.radians(angle_deg)).split()[1] == said


@pytest.mark.parametrize(
    ("outcome", "code", "is_slow"),
    [
        ("planned", "steering.the_end", False),
        ("planned", "steering.no_frame", True),
        ("overtaken", "steering.the_end", True),
    ],
)
def test_a_computer_that_was_too_slow_is_told_by_rests_and_by_stances(
    outcome, code, is_slow
):
    rest = SimpleNamespace(cause=SimpleNamespace(code=code))
    done = SimpleNamespace(rests=[rest], decisions=[SimpleNamespace(outcome=outcome)])
    assert drive._was_too_slow(done) == is_slow


def test_a_client_that_is_missing_is_told_before_the_model_is_read(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, "qtm_rt", None)
    nowhere = str(tmp_path / "nowhere")
    options = ["--host", "127.0.0.1", "--dry-run", "--armed", "--model", nowhere]
    assert main(["drive", *options]) != 0
    err = capsys.readouterr().err
    assert "pip install 'hopdata[live]'" in err
    assert "nowhere" not in err
