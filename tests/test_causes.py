"""What ended a job is told with what to do, and what is a mistake of hopdata is not."""

import errno
import os
import signal
from pathlib import Path

import pytest

from hopdata import causes
from hopdata.causes import OomKills


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


KILLED = int(signal.SIGKILL) if hasattr(signal, "SIGKILL") else 9
BY_SOMEBODY = "it was killed (SIGKILL) by a person, by a limit of time"
A, B = Path("a"), Path("b")


def test_signals():
    assert BY_SOMEBODY in causes.signal_told(KILLED, oom_before=None)
    told = causes.signal_told(signal.SIGTERM, oom_before=None)
    assert "ended from outside (SIGTERM)" in told
    assert "it crashed (SIGSEGV)" in causes.signal_told(signal.SIGSEGV, oom_before=None)
    assert "signal 200" in causes.signal_told(200, oom_before=None)


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        # The control group of the run tells, whatever others do.
        (OomKills(3, 0, A), OomKills(4, 1, A), "the system killed it: memory ran out"),
        (OomKills(None, 0, A), OomKills(None, 1, A), "the system killed it: memory"),
        (OomKills(3, 0, A), OomKills(9, 0, A), BY_SOMEBODY),
        # The count of the whole machine may be that of somebody else's process.
        (OomKills(3), OomKills(4), "the system has killed a process, perhaps this one"),
        (OomKills(3, 0, A), OomKills(4, 0, B), "killed a process, perhaps this one"),
        (OomKills(3), OomKills(3), BY_SOMEBODY),
        (OomKills(3, 0, A), OomKills(3, 5, B), BY_SOMEBODY),
        (OomKills(None), OomKills(None), BY_SOMEBODY),
        (None, OomKills(4, 1, A), BY_SOMEBODY),
    ],
)
def test_a_lack_of_memory_is_told_for_sure_or_as_what_may_be(
    monkeypatch, before, now, said
):
    monkeypatch.setattr(causes, "oom_kills", lambda: now)
    assert said in causes.signal_told(KILLED, oom_before=before)


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Return a function that writes a file of a system of its own."""
    monkeypatch.setattr(causes, "PROC", tmp_path / "proc")
    monkeypatch.setattr(causes, "GROUPS", tmp_path / "groups")

    def write(name, text):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    return write


@pytest.mark.parametrize(
    ("lines", "name"),
    [
        ("0::/user/session\n", "groups/user/session/memory.events"),
        ("0::/\n", "groups/memory.events"),
        ("4:cpu,memory:/jobs/7\n0::/\n", "groups/memory/jobs/7/memory.oom_control"),
        ("4:memory:/a:b\n0::/x\n", "groups/memory/a:b/memory.oom_control"),
    ],
)
def test_kills_in_the_control_group_are_counted(system, lines, name):
    system("proc/vmstat", "nr_free_pages 9\noom_kill 12\n")
    system("proc/self/cgroup", lines)
    assert causes.oom_kills() == OomKills(12)
    file = system(name, "low 0\noom 4\noom_kill 3\noom_group_kill 0\n")
    assert causes.oom_kills() == OomKills(12, 3, file)


def test_the_outermost_group_and_other_systems_count_nothing(system):
    assert causes.oom_kills() == OomKills(None)
    system("proc/self/cgroup", "4:memory:/\nodd\n")
    system("groups/memory/memory.oom_control", "oom_kill 3\n")
    assert causes.oom_kills() == OomKills(None)
    system("proc/vmstat", "oom_kill many\n")
    assert causes.oom_kills() == OomKills(None)


@pytest.mark.skipif(not os.path.exists("/proc/vmstat"), reason="only Linux counts them")
def test_the_system_counts_its_own_kills():
    count = causes.oom_kills().on_machine
    assert count is None or count >= 0
