"""Files on which the HDF5 library hangs, ends the process or asks for memory are refused."""

import io
import os
import struct
import subprocess
import sys

import h5py
import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recordings import budget
from hopdata.recordings.readers import hdf5_checks, trial
from hopdata.recordings.readers.hdf5 import read_recording


@pytest.fixture
def sound(tmp_path):
    """Return a recording as another program writes it, without a seal."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(20) / 100
        file["positions"] = np.random.default_rng(3).normal(size=(20, 2, 3))
        file.attrs["markers"], file.attrs["roles"] = ["a", "b"], ["body", "foot"]
        file.attrs["rate_hz"] = 100.0
        file.attrs.update(name="a", source="", source_sha256="", vertical_axis="z")
    return path


@pytest.fixture
def endless(sound):
    """Return a file whose heap of texts ends in free space of size 0: the library stays there."""
    content = bytearray(sound.read_bytes())
    heap = content.index(b"GCOL")
    at = heap + 16
    number, size = struct.unpack("<H6xQ", content[at : at + 16])
    while number:
        at += 16 + (size + 7) // 8 * 8
        number, size = struct.unpack("<H6xQ", content[at : at + 16])
    content[at + 8 : at + 16] = bytes(8)
    sound.write_bytes(content)
    return sound


# A child that is ready, but then does something else than to read a file.
READY = f"print({trial.READY!r}, end='', flush=True)\n"


@pytest.fixture
def another_child(monkeypatch):
    """Return a function that makes another program the child that tries the files."""

    def use(program=None, **limits):
        child = trial.Child(program, **limits)
        monkeypatch.setattr(trial, "child", child)
        children.append(child)
        return child

    children = []
    yield use
    for child in children:
        child.end()


def test_a_file_without_a_seal_is_read(sound):
    assert read_recording(sound).markers == ("a", "b")


def test_a_file_without_end_is_refused_in_the_time_that_its_size_allows(
    endless, another_child, monkeypatch
):
    """A limit on the CPU time ends the child, so that a busy machine makes no difference."""
    another_child(wall_per_cpu=1000.0)
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.5)
    with pytest.raises(
        RecordingError, match=r"a\.h5: .*goes on and on; it is damaged, copy it"
    ):
        read_recording(endless)


def test_a_child_that_waits_for_ever_is_ended_too(sound, another_child, monkeypatch):
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.02)
    another_child(READY + "import time; input(); time.sleep(100)")
    with pytest.raises(RecordingError, match="goes on and on"):
        read_recording(sound)


def test_the_next_file_after_one_without_end_is_read(
    endless, sound, monkeypatch, tmp_path
):
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.5)
    with pytest.raises(RecordingError):
        read_recording(endless)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["time"] = np.arange(3.0)
    with pytest.raises(RecordingError, match="not a recording"):
        read_recording(tmp_path / "b.h5")


def test_a_library_that_crashes_is_told_and_not_shared(sound, another_child):
    crash = "os.kill(os.getpid(), signal.SIGSEGV)"
    another_child(READY + f"import os, signal; input(); {crash}")
    with pytest.raises(
        RecordingError, match=r"one that ends the HDF5 library \(exit code -11\)"
    ):
        read_recording(sound)


def test_where_no_process_can_be_started_files_are_read_without_a_trial(
    sound, another_child, monkeypatch
):
    child = another_child(trial.serving_program())
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    assert read_recording(sound).markers == ("a", "b")
    assert not child.is_alive


def test_a_child_that_cannot_import_hopdata_says_nothing_about_a_file(
    sound, another_child
):
    child = another_child("import no_such_module")
    assert read_recording(sound).markers == ("a", "b")
    assert not child.is_alive


def test_a_child_that_hangs_at_its_start_says_nothing_about_a_file(
    sound, another_child
):
    another_child("import time; time.sleep(100)", start_s=0.2)
    assert read_recording(sound).markers == ("a", "b")


def test_the_child_imports_a_hopdata_that_is_not_installed(sound, another_child):
    """The child starts without the folder in which this installation has hopdata."""
    folder = os.path.dirname(os.path.dirname(trial.hopdata.__file__))
    alone = f"import sys\nsys.path[:] = [place for place in sys.path if place != {folder!r}]\n"
    child = another_child(alone + trial.serving_program())
    assert read_recording(sound).markers == ("a", "b")
    assert child.is_alive


def test_what_an_installation_prints_at_its_start_is_no_answer(sound, another_child):
    child = another_child("print('welcome')\n" + trial.serving_program())
    assert read_recording(sound).markers == ("a", "b")
    assert child.is_alive


def test_a_child_that_says_something_else_and_lives_is_ended(sound, another_child):
    says = "print('warning', flush=True); time.sleep(100)"
    child = another_child(READY + f"import time; input(); {says}")
    with pytest.raises(
        RecordingError, match="the trial says 'warning' instead of an answer"
    ):
        read_recording(sound)
    assert not child.is_alive


def test_a_child_that_says_nothing_more_and_lives_is_ended(sound, another_child):
    closes = "os.close(1); time.sleep(100)"
    another_child(READY + f"import os, time; input(); {closes}", end_s=0.2)
    with pytest.raises(RecordingError, match="the trial says '' instead of an answer"):
        read_recording(sound)


def test_a_child_that_is_killed_may_have_lacked_memory(sound, another_child):
    killed = "os.kill(os.getpid(), signal.SIGKILL)"
    another_child(READY + f"import os, signal; input(); {killed}")
    with pytest.raises(
        RecordingError, match=r"goes on and on, or .* too little free memory; try"
    ):
        read_recording(sound)


def test_a_failed_child_leaves_no_pipe_open(sound, another_child, monkeypatch):
    another_child(READY + "import os; input(); os._exit(3)")
    started = []

    class Remembered(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Remembered)
    with pytest.raises(RecordingError, match="exit code 3"):
        read_recording(sound)
    (process,) = started
    assert process.stdin.closed
    assert process.stdout.closed
    assert process.returncode == 3


LIMITS = """
import resource, sys
from pathlib import Path
from hopdata.recordings.readers import trial
path = Path(sys.argv[1])
hard = int(sys.argv[2])
soft = hard if hard < 0 else hard - 4096
resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
trial.limit(path, 5.0, 10.0)
print(*resource.getrlimit(resource.RLIMIT_AS))
trial.limit(path, 5.0, float("inf"))
print(*resource.getrlimit(resource.RLIMIT_AS))
print(*resource.getrlimit(resource.RLIMIT_CPU))
"""


@pytest.mark.parametrize("hard", [-1, 1 << 42, 1 << 30])
def test_limits_stay_within_those_of_the_user_and_are_lifted_again(sound, hard):
    command = [sys.executable, "-c", LIMITS, str(sound), str(hard)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    memory, lifted, cpu = [
        tuple(int(word) for word in line.split()) for line in result.stdout.splitlines()
    ]
    assert memory[1] == hard
    if hard == 1 << 30:  # less than a file is granted
        assert memory[0] == hard
    else:
        assert 1 << 30 < memory[0] < 1 << 42
    assert lifted == (hard, hard)
    assert 5 < cpu[0] < 60


def test_a_file_is_tried_once_and_again_when_it_has_changed(
    sound, another_child, monkeypatch
):
    tried = []
    child = another_child()
    monkeypatch.setattr(child, "fault_of", lambda place, *_: tried.append(place) or "")
    read_recording(sound)
    read_recording(sound)
    assert len(tried) == 1
    with h5py.File(sound, "r+") as file:
        file.attrs["name"] = "another"
    os.utime(sound, ns=(1, 1))
    read_recording(sound)
    assert len(tried) == 2


def served(monkeypatch, path):
    """Return what the child answers about a file, in this process and without its limits."""
    answer = io.StringIO()
    monkeypatch.setattr(trial, "limit", lambda *_: None)
    monkeypatch.setattr(
        sys, "stdin", io.StringIO(f"1.0 10.0 {os.fsencode(path).hex()}\n")
    )
    monkeypatch.setattr(sys, "stdout", answer)
    trial.serve()
    return answer.getvalue()


@pytest.mark.parametrize(
    ("error", "answer"),
    [
        (MemoryError(), trial.NO_MEMORY),
        (OSError("can't allocate a buffer"), trial.NO_MEMORY),
        (OSError("wrong checksum"), trial.ANSWERED),  # the parent tells it
    ],
)
def test_a_wish_for_memory_is_told_from_other_errors(sound, monkeypatch, error, answer):
    def fail(*_):
        raise error

    monkeypatch.setattr(hdf5_checks, "whole_array", fail)
    assert served(monkeypatch, sound) == answer


def test_all_of_a_file_is_tried(sound, monkeypatch):
    seen = []
    monkeypatch.setattr(hdf5_checks, "whole_array", lambda item: seen.append(item.name))
    monkeypatch.setattr(
        hdf5_checks, "checked_attribute", lambda _, name: seen.append(name)
    )
    assert served(monkeypatch, sound) == trial.ANSWERED
    assert {"/time", "/positions", "markers", "rate_hz"} <= set(seen)


def test_the_wish_for_memory_refuses_the_file(sound, another_child):
    another_child(READY + "input(); print('memory')")
    with pytest.raises(RecordingError, match="wants far more memory"):
        read_recording(sound)


def test_the_time_grows_with_the_file(tmp_path):
    (tmp_path / "small").write_bytes(b"")
    (tmp_path / "large").write_bytes(bytes(20_000_000))
    small, large = (
        budget.seconds_to_read(tmp_path / name) for name in ("small", "large")
    )
    assert small == 2.0
    assert large == 2.0 + 40.0 + 1.0  # as many objects as there may be, and the bytes
