"""What is foreign is read apart: each way to fail is one line, and nothing gets out."""

import dataclasses
import importlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from hopdata.errors import ConfigError, RecordingError
from hopdata.foreign import apart, budget, door, watch
from hopdata.recording import Event

HERE = str(Path(__file__).parent)
IS_LINUX = sys.platform.startswith("linux")


@pytest.fixture(autouse=True)
def calls(monkeypatch):
    """Return the functions to call, which are on the search path of both processes."""
    monkeypatch.syspath_prepend(HERE)
    return importlib.import_module("calls")


@pytest.fixture(params=["fork", "server"])
def way(request, monkeypatch, calls):
    """Call in a fork of this process, and in a server."""
    if request.param == "fork" and not IS_LINUX:
        pytest.skip("only Linux can fork soundly")
    monkeypatch.setattr(apart, "may_fork", lambda: request.param == "fork")
    server = apart.Server()
    monkeypatch.setattr(apart, "server", server)
    yield request.param
    server.end()


@pytest.fixture
def soon(monkeypatch):
    """Let a process take less time than it may."""
    monkeypatch.setattr(budget, "LEAST_S", 0.5)
    monkeypatch.setattr(watch, "LONGEST_SLEEP_S", 0.5)


def call(name, *arguments, n_bytes=1000, **options):
    options.setdefault("place", "a.h5")
    return door.read(f"calls:{name}", *arguments, n_bytes=n_bytes, **options)


def failure(name, *arguments, **options):
    """Return the code and the one line of the failure of a call."""
    with pytest.raises(RecordingError) as caught:
        call(name, *arguments, reader="the reader of theirs", **options)
    said = str(caught.value)
    assert said.startswith("a.h5: expected ")
    assert ", found " in said
    assert "the reader of theirs" in said
    assert "\n" not in said
    return caught.value.code, said


def test_plain_values_go_and_come_back(way):
    value = (1, "toe", [2.5, None], {"x": (True,)}, b"raw")
    assert call("echo", *value) == value
    positions = np.random.default_rng(2).normal(size=(50, 4, 3)).transpose(1, 0, 2)
    (found,) = call("echo", positions)
    np.testing.assert_array_equal(found, positions)


def test_only_dataclasses_that_are_named_are_made(way):
    events, message = call("event", kinds=(Event,))
    assert events == [Event("touch", 1.5)]
    assert str(message) == "3 frames"
    assert failure("event")[0] == "foreign.reply"


def test_it_is_another_process_in_the_same_folder(way, tmp_path, monkeypatch):
    for folder in (tmp_path, tmp_path.parent):
        monkeypatch.chdir(folder)
        where, own, parent = call("environment")
        assert where == str(folder)
        assert own != os.getpid()
        assert parent == os.getpid()


def test_the_working_folder_is_not_on_the_search_path(way, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), *sys.path])
    found = call("search_path")
    assert HERE in found
    assert not {"", ".", str(tmp_path)} & set(found)


def test_what_it_prints_is_no_answer(way, capfd):
    assert call("noisy") == "said"
    assert capfd.readouterr() == ("", "")


def test_mistakes_arrive_as_they_were_raised(way):
    with pytest.raises(ConfigError, match=r"^here: expected a, found b$") as caught:
        call("mistaken")
    assert caught.value.key == "markers.body"
    with pytest.raises(ConfigError, match=r"^3 frames$") as caught:
        call("mistaken_with_code")
    assert caught.value.code == "recordings.frames"


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("ask_for_50_gb", "memory", "at most 1000 MB of memory for 1 kB"),
        ("ask_for_more_and_more", "memory", "at most 1000 MB"),
        ("ask_in_words", "memory", "at most 1000 MB"),
        ("crash", "ended", "SIGSEGV"),
        ("ended", "ended", "exit code 0"),
        ("left", "failed", "SystemExit: 4 (calls.py, line"),
        ("wrong", "failed", "KeyError: 'x' (calls.py, line"),
        ("connect", "failed", "socket"),
        ("run_program", "failed", "subprocess.Popen"),
        ("load_pickle", "failed", "pickle.find_class"),
        ("no_plain_value", "reply", "found object"),
        ("too_deep", "reply", "at most 32 levels"),
    ],
)
def test_each_failure_has_its_code_and_one_line(way, name, code, said):
    found, words = failure(name)
    assert found == f"foreign.{code}"
    assert said in words
    assert call("echo", 1) == (1,)  # the next file is read


def test_nothing_is_written(way, tmp_path):
    place = tmp_path / "x"
    assert failure("write", str(place))[0] == "foreign.failed"
    assert not place.exists()
    if IS_LINUX:
        assert call("write_beneath_python", str(place)) < 0
        assert place.stat().st_size == 0


def test_an_endless_loop_is_ended_in_the_time_that_the_size_allows(way, soon):
    began_s = time.monotonic()
    code, said = failure("endless")
    assert code == "foreign.time"
    assert "to come to an end with 1 kB in 1 s" in said or "in 0 s" in said
    assert time.monotonic() - began_s < 60  # of a busy machine


def test_one_that_only_waits_is_ended(way, soon):
    assert failure("asleep")[0] == "foreign.waits"


def test_time_and_memory_are_watched_where_the_system_limits_nothing(
    monkeypatch, calls
):
    """A server without limits of its own, as on Windows."""
    monkeypatch.setattr(apart, "may_fork", lambda: False)
    program = (
        "from hopdata.foreign import limits\nlimits._limit = lambda *_, **__: None\n"
    )
    server = apart.Server(
        apart.serving_program().replace("serve()", program + "serve()")
    )
    monkeypatch.setattr(apart, "server", server)
    try:
        assert call("limits")["RLIMIT_FSIZE"][0] != 0
        assert failure("ask_for_more_and_more")[0] == "foreign.memory"
        monkeypatch.setattr(budget, "LEAST_S", 0.2)
        assert failure("endless")[0] == "foreign.time"
    finally:
        server.end()


def test_more_than_fits_the_budget_is_not_received(way, monkeypatch):
    assert len(call("many_bytes", 2_000_000)) == 2_000_000
    monkeypatch.setattr(budget, "LEAST_UNPACKED", 1_000_000)
    assert len(call("many_bytes", 1_000_000)) == 1_000_000
    code, said = failure("many_bytes", 2_000_000)
    assert code == "foreign.reply"
    assert "arrays of 2000000 bytes" in said


def test_a_process_that_was_killed_may_have_lacked_memory(way):
    assert failure("killed")[0] == "foreign.memory"


def test_little_free_memory_is_told(way, monkeypatch):
    monkeypatch.setattr(budget, "free_memory", lambda: 300_000_000)
    code, said = failure("ask_for_50_gb")
    assert code == "foreign.free_memory"
    assert "at most 180 MB" in said


@pytest.mark.skipif(not IS_LINUX, reason="limits of Linux")
def test_the_limits_are_hard_in_a_fork(monkeypatch, calls):
    monkeypatch.setattr(apart, "may_fork", lambda: True)
    found = call("limits")
    for name in ("RLIMIT_CORE", "RLIMIT_FSIZE"):
        assert found[name] == (0, 0)
    for name in ("RLIMIT_DATA", "RLIMIT_AS"):
        soft, hard = found[name]
        assert soft == hard
        assert 1e9 < soft < 1e13
    assert found["RLIMIT_CPU"][0] <= 6
    if os.geteuid():  # the superuser may raise them
        assert failure("raise_own_limit")[0] == "foreign.failed"


@pytest.mark.skipif(not IS_LINUX, reason="a network of its own is Linux's")
def test_no_socket_leads_anywhere_beneath_python(way):
    assert call("connect_beneath_python") != 0


def test_a_call_within_a_call_stays_in_its_process(way):
    inner, outer = call("nested")
    assert inner == outer != os.getpid()
    assert not apart.is_inside()


def test_who_measures_the_readers_may_read_here(way):
    with door.open_here():
        assert call("environment")[1] == os.getpid()
    assert call("environment")[1] != os.getpid()


def test_where_no_process_can_be_started_nothing_is_read(way, monkeypatch):
    def fail(*_, **__):
        raise OSError("no more processes")

    monkeypatch.setattr(os, "fork", fail)
    monkeypatch.setattr(subprocess, "Popen", fail)
    with pytest.raises(RecordingError, match=r"^a\.h5: .*no more processes") as caught:
        call("echo", 1)
    assert caught.value.code == "foreign.start"


def test_a_current_folder_that_is_gone_is_told(way, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    assert call("echo", 1) == (1,)
    gone.rmdir()
    with pytest.raises(RecordingError, match=r"has been removed.*\(cd\)$") as caught:
        call("echo", 1)
    assert caught.value.code == "foreign.folder"
    monkeypatch.chdir(tmp_path)
    assert call("echo", 1) == (1,)


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import no_such_module", "none can be started"),
        ("print('welcome ' * 10)", "something else than an answer"),
        ("import time; time.sleep(100)", "none can be started"),
    ],
)
def test_a_server_that_does_not_start_says_so(monkeypatch, program, said):
    monkeypatch.setattr(apart, "may_fork", lambda: False)
    monkeypatch.setattr(apart, "server", apart.Server(program, start_s=0.5))
    with pytest.raises(RecordingError, match=said) as caught:
        call("echo", 1)
    assert caught.value.code == "foreign.start"
    assert not apart.server.is_alive


def test_no_process_and_no_pipe_is_left(way):
    def pipes_and_children():
        me = psutil.Process()
        return me.num_fds() if hasattr(me, "num_fds") else 0, len(me.children())

    call("echo", 1)
    before = pipes_and_children()
    for name in ("ended", "wrong", "crash"):
        failure(name)
        call("echo", 1)
    n_pipes, n_children = pipes_and_children()
    assert n_pipes <= before[0]
    assert n_children <= before[1]


@pytest.mark.usefixtures("interruptible")
def test_an_interrupted_call_ends_its_process(way):
    call("echo", 1)
    children = len(psutil.Process().children())
    interrupt = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))

    def interrupted():
        interrupt.start()
        call("asleep")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    interrupt.join()
    assert len(psutil.Process().children()) <= children
    assert call("echo", 2) == (2,)


def test_one_fork_of_a_process_with_threads_is_not_made():
    is_over = threading.Event()
    thread = threading.Thread(target=is_over.wait)
    thread.start()
    try:
        assert not apart.may_fork()
    finally:
        is_over.set()
        thread.join()


@pytest.mark.skipif(not IS_LINUX, reason="forks are made on Linux alone")
@pytest.mark.parametrize("name", ["echo", "killed"])
def test_a_fork_keeps_its_number_until_the_last_signal_to_it(monkeypatch, calls, name):
    """A number that is given back may be that of a process of somebody else."""
    signalled = []
    kill = apart._kill

    def kill_and_look(pid):
        signalled.append(Path(f"/proc/{pid}").exists())
        kill(pid)

    monkeypatch.setattr(apart, "_kill", kill_and_look)
    monkeypatch.setattr(apart, "may_fork", lambda: True)
    answer = apart.call(apart.Request(f"calls:{name}", (), budget.budget_for(0)))
    assert (answer.failure is None) == (name == "echo")
    assert signalled
    assert all(signalled)


LIMITED = """
import os, resource
from hopdata.foreign import budget, limits
resource.setrlimit(resource.RLIMIT_CPU, (1000, 1000))
limits.spend_at_most(budget.budget_for({n_bytes}, 10**15), for_good=True)
print(*resource.getrlimit(resource.RLIMIT_CPU))
"""


@pytest.mark.skipif(not IS_LINUX, reason="limits of Linux")
@pytest.mark.parametrize(("n_bytes", "most"), [(10**9, 999), (0, 4)])
def test_the_time_of_a_batch_job_is_not_exceeded_and_told_as_time(n_bytes, most):
    """The soft limit stays below the hard one, whose signal says nothing of time."""
    program = LIMITED.format(n_bytes=n_bytes)
    ask = [sys.executable, "-c", program]
    ran = subprocess.run(ask, capture_output=True, text=True, check=True)
    soft, hard = map(int, ran.stdout.split())
    assert most <= soft <= most + 2
    assert hard == soft + 1


@pytest.mark.skipif(not IS_LINUX, reason="only Linux ends a process with its parent")
@pytest.mark.parametrize(("parent", "code"), [("os.getppid()", 0), ("1 << 30", -9)])
def test_a_process_whose_parent_has_already_ended_ends(parent, code):
    program = (
        f"import os; from hopdata.foreign import limits; limits.end_with({parent})"
    )
    assert (
        subprocess.run([sys.executable, "-c", program], check=False).returncode == code
    )


@pytest.mark.parametrize(
    ("steps_s", "found"), [([0.1, 0.1, 1e6] + [0.1] * 20, ""), ([4.0] * 20, "time")]
)
def test_while_all_is_halted_no_time_is_counted(monkeypatch, steps_s, found):
    """The clock takes these steps from look to look, again and again."""
    clock = itertools.accumulate(steps_s)
    monkeypatch.setattr(watch, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    spent = dataclasses.replace(budget.budget_for(0, 10**15), wall_s=10.0)
    program = "import time; time.sleep(20)"
    with subprocess.Popen([sys.executable, "-c", program]) as process:
        with watch.Watch(process.pid, process.kill, spent) as watching:
            time.sleep(2.5)
        process.kill()
    assert watching.found == found
