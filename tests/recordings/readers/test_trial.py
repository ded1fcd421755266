"""Files on which the HDF5 library hangs, ends the process or asks for memory are refused."""

import io
import os
import signal
import struct
import sys

import h5py
import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recordings import budget
from hopdata.recordings.readers import hdf5, trial
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


@pytest.fixture
def another_child(monkeypatch):
    """Return a function that makes another program the child that tries the files."""
    monkeypatch.setattr(trial, "_child", None)

    def use(program):
        monkeypatch.setattr(trial, "serve", None)
        command = [sys.executable, "-c", program]
        pipes = {"stdin": trial.subprocess.PIPE, "stdout": trial.subprocess.PIPE}
        start = trial.subprocess.Popen
        monkeypatch.setattr(trial, "_started", lambda: start(command, **pipes, encoding="ascii"))

    yield use
    if trial._child is not None:
        trial._ended(trial._child)


def test_a_file_without_a_seal_is_read(sound):
    assert read_recording(sound).markers == ("a", "b")


def test_a_file_without_end_is_refused_in_the_time_that_its_size_allows(endless, monkeypatch):
    """A limit on the CPU time ends the child, so that a busy machine makes no difference."""
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.5)
    monkeypatch.setattr(trial, "_signals", lambda *_: {signal.SIGXCPU})
    with pytest.raises(RecordingError, match=r"a\.h5: .*goes on and on; it is damaged, copy it"):
        read_recording(endless)


def test_a_child_that_waits_for_ever_is_ended_too(sound, another_child, monkeypatch):
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.02)
    another_child("import time; input(); time.sleep(100)")
    with pytest.raises(RecordingError, match="goes on and on"):
        read_recording(sound)


def test_the_next_file_after_one_without_end_is_read(endless, sound, monkeypatch, tmp_path):
    monkeypatch.setattr(trial, "seconds_to_read", lambda _: 0.5)
    with pytest.raises(RecordingError):
        read_recording(endless)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["time"] = np.arange(3.0)
    with pytest.raises(RecordingError, match="not a recording"):
        read_recording(tmp_path / "b.h5")


def test_a_library_that_crashes_is_told_and_not_shared(sound, another_child):
    another_child("import os, signal; input(); os.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(RecordingError, match=r"one that ends the HDF5 library \(exit code -11\)"):
        read_recording(sound)


def test_where_no_process_can_be_started_files_are_read_without_a_trial(sound, monkeypatch):
    monkeypatch.setattr(trial, "_child", None)
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    assert read_recording(sound).markers == ("a", "b")


def test_a_file_is_tried_once_and_again_when_it_has_changed(sound, monkeypatch):
    tried = []
    monkeypatch.setattr(trial, "_tried", lambda place, *_: tried.append(place) or "")
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
    monkeypatch.setattr(trial, "_limit", lambda *_: None)
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"1.0 10.0 {os.fsencode(path).hex()}\n"))
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

    monkeypatch.setattr(hdf5, "whole_array", fail)
    assert served(monkeypatch, sound) == answer


def test_all_of_a_file_is_tried(sound, monkeypatch):
    seen = []
    monkeypatch.setattr(hdf5, "whole_array", lambda item: seen.append(item.name))
    monkeypatch.setattr(hdf5, "checked_attribute", lambda _, name: seen.append(name))
    assert served(monkeypatch, sound) == trial.ANSWERED
    assert {"/time", "/positions", "markers", "rate_hz"} <= set(seen)


def test_the_wish_for_memory_refuses_the_file(sound, another_child):
    another_child("input(); print('memory')")
    with pytest.raises(RecordingError, match="wants far more memory"):
        read_recording(sound)


def test_the_time_grows_with_the_file(tmp_path):
    (tmp_path / "small").write_bytes(b"")
    (tmp_path / "large").write_bytes(bytes(20_000_000))
    small, large = (budget.seconds_to_read(tmp_path / name) for name in ("small", "large"))
    assert small == 2.0
    assert large == 2.0 + 40.0 + 1.0  # as many objects as there may be, and the bytes
