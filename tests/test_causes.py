"""What ended a job is told with what to do, and what is a mistake of hopdata is not."""

import errno
import os
import signal

import pytest

from hopdata import causes


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "memory ran out"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "memory ran out"),
        (
            ImportError("x.so: failed to map segment from shared object"),
            "memory ran out",
        ),
        (RuntimeError("can't start new thread"), "memory ran out"),
        (
            OSError(errno.ENOSPC, "No space left on device", "a.csv"),
            "a.csv: the disk is full",
        ),
        (
            OSError("Can't write data (errno = 28, error message = ...)"),
            "the disk is full",
        ),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), "quota"),
        (OSError(errno.EFBIG, "File too large"), "ulimit -f"),
        (
            OSError(errno.EROFS, "Read-only file system", "r"),
            "r: this place cannot be written",
        ),
        (
            FileNotFoundError(errno.ENOENT, "No such file", "in.csv"),
            "in.csv: it is missing",
        ),
        (PermissionError(errno.EACCES, "denied", "in.csv"), "in.csv: access is denied"),
        (OSError(errno.EIO, "Input/output error"), "shared folder failed"),
        (OSError(errno.EMFILE, "Too many open files"), "ulimit -n"),
    ],
)
def test_a_cause_is_told(error, words):
    told = causes.cause_of(error)
    assert words in told
    assert ";" in told, "what to do"
    assert "\n" not in told


@pytest.mark.parametrize(
    "error",
    [
        ValueError("3"),
        KeyError("x"),
        RuntimeError("the sections cross"),
        OSError(errno.EPIPE, "Broken pipe"),
        ZeroDivisionError(),
    ],
)
def test_what_is_no_lack_of_the_machine_has_no_cause(error):
    assert causes.cause_of(error) == ""


def test_texts_of_other_programs():
    said = "OpenBLAS error: Memory allocation still failed after 10 retries, giving up."
    assert causes.cause_in(said) == causes.MEMORY
    assert causes.cause_in("LLVM ERROR: out of memory") == causes.MEMORY
    assert causes.cause_in("OSError: can't allocate memory for chunk") == causes.MEMORY
    assert (
        causes.cause_in("OSError: [Errno 28] No space left on device") == causes.SPACE
    )
    assert causes.cause_in("ValueError: expected 3 feet") == ""


def test_signals(monkeypatch):
    monkeypatch.setattr(causes, "oom_kills", lambda: 4)
    killed = int(signal.SIGKILL) if hasattr(signal, "SIGKILL") else 9
    assert "the system killed it: memory ran out" in causes.signal_told(
        killed, oom_before=3
    )
    for before in (4, None):
        told = causes.signal_told(killed, oom_before=before)
        assert "killed (SIGKILL) by a person, by a limit of time" in told
    assert "ended from outside (SIGTERM)" in causes.signal_told(
        signal.SIGTERM, oom_before=4
    )
    assert "it crashed (SIGSEGV)" in causes.signal_told(signal.SIGSEGV, oom_before=4)
    assert "signal 200" in causes.signal_told(200, oom_before=4)


@pytest.mark.skipif(not os.path.exists("/proc/vmstat"), reason="only Linux counts them")
def test_the_system_counts_its_own_kills():
    assert causes.oom_kills() is None or causes.oom_kills() >= 0
