"""The lock of a killed run is removed; that of a run that lives, or may live, is not."""

import json
import os
import platform
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from hopdata.__main__ import main
from hopdata.commands import owner as owning
from hopdata.commands import workflow
from hopdata.commands.owner import LOCKS, RECORDS, Owner, owners, recorded, release_dead
from hopdata.commands.workflow import run_workflow

HERE = platform.node()
HOUR_S = 3600.0


def began(pid):
    return psutil.Process(pid).create_time()


@pytest.fixture
def locked(tmp_path, monkeypatch):
    """Go to a folder whose files are locked; return a function that adds records of runs."""
    monkeypatch.chdir(tmp_path)
    LOCKS.mkdir(parents=True)
    (LOCKS / "0.output.lock").write_text("results/trial/report.html\n")

    def add(*runs):
        RECORDS.mkdir(parents=True, exist_ok=True)
        for number, run in enumerate(runs):
            (RECORDS / f"{number}.json").write_text(json.dumps(asdict(run)))

    return add


@pytest.fixture
def ended():
    """Return the number and the start of a process that has ended."""
    with subprocess.Popen([sys.executable, "-c", "pass"]) as process:
        start = began(process.pid)
    return process.pid, start


def test_a_dead_process_and_one_with_its_number_are_told_from_it(ended):
    me = os.getpid()
    assert Owner("a", HERE, *ended).is_dead
    assert not Owner("a", HERE, me, began(me)).is_dead
    assert Owner(
        "a", HERE, me, began(me) - 48 * HOUR_S
    ).is_dead  # an older one had this number
    assert not Owner("a", "another", *ended).is_dead


def test_a_change_of_the_clock_makes_no_run_dead_and_ticks_tell_numbers_apart(
    monkeypatch,
):
    monkeypatch.setattr(owning, "ticks_of", lambda _: "boot 100")
    me = os.getpid()
    assert not Owner("a", HERE, me, began(me) - 48 * HOUR_S, "boot 100").is_dead
    assert Owner("a", HERE, me, began(me), "boot 99").is_dead
    assert Owner("a", HERE, me, began(me), "another 100").is_dead


def test_the_ticks_of_a_process_whose_name_holds_parentheses(tmp_path, monkeypatch):
    monkeypatch.setattr(owning, "PROC", tmp_path)
    (tmp_path / "sys/kernel/random").mkdir(parents=True)
    (tmp_path / "sys/kernel/random/boot_id").write_text("b00t\n")
    (tmp_path / "7").mkdir()
    fields = " ".join(str(number) for number in range(4, 53))
    (tmp_path / "7/stat").write_text(f"7 (a) b) S {fields}\n")
    assert owning.ticks_of(7) == "b00t 22"
    assert owning.ticks_of(8) == ""


def test_without_ticks_a_change_of_the_clock_by_hours_makes_no_run_dead(monkeypatch):
    monkeypatch.setattr(owning, "ticks_of", lambda _: "")
    me = os.getpid()
    assert not Owner("a", HERE, me, began(me) - HOUR_S, "boot 1").is_dead
    assert Owner("a", HERE, me, began(me) - 48 * HOUR_S, "boot 1").is_dead


def test_a_process_that_may_not_be_seen_counts_as_alive(monkeypatch):
    def denied(*_):
        raise psutil.AccessDenied

    monkeypatch.setattr(owning, "ticks_of", lambda _: "")
    monkeypatch.setattr(psutil.Process, "create_time", denied)
    assert not Owner("a", HERE, os.getpid(), 0.0).is_dead
    monkeypatch.setattr(psutil.Process, "status", denied)
    assert not Owner("a", HERE, os.getpid(), 0.0).is_dead


def test_two_runs_at_work_are_told_as_two(locked):
    me, parent = os.getpid(), os.getppid()
    locked(Owner("a", HERE, me, began(me)), Owner("b", HERE, parent, began(parent)))
    assert ") are at work here; wait for its end" in owning.who_is_at_work()
    (RECORDS / "1.json").unlink()
    assert ") is at work here; wait for its end" in owning.who_is_at_work()


def test_the_lock_of_a_dead_run_is_removed_and_told(locked, ended):
    locked(Owner("trial", HERE, *ended))
    told = release_dead()
    assert f"the run of 'trial' (process {ended[0]} on {HERE}, since 20" in told
    assert "was killed; its lock is removed" in told
    assert not LOCKS.exists()
    assert owners() == {}
    assert release_dead() == ""


def test_a_lock_stays_beside_a_run_that_lives_or_may_live(locked, ended):
    me = os.getpid()
    for other in (Owner("b", HERE, me, began(me)), Owner("b", "another", 1, 0.0)):
        locked(Owner("trial", HERE, *ended), other)
        assert release_dead() == ""
        assert LOCKS.exists()
        assert list(owners().values()) == [other]


@pytest.fixture
def snakemake():
    """Return a function that starts a process of a folder whose command is Snakemake's."""
    started = []

    def start(folder):
        folder.mkdir(exist_ok=True)
        script = folder / "snakemake"
        script.write_text("print(flush=True)\nimport sys\nsys.stdin.read()\n")
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        process = subprocess.Popen([sys.executable, script], cwd=folder, **pipes)
        started.append(process)
        process.stdout.readline()
        return process

    yield start
    for process in started:
        process.stdin.close()
        process.wait()
        process.stdout.close()


def test_a_stale_record_does_not_free_the_lock_of_a_plain_snakemake(
    locked, ended, snakemake
):
    locked(Owner("trial", HERE, *ended))
    plain = snakemake(Path.cwd())
    assert release_dead() == ""
    assert LOCKS.exists()
    assert f"Snakemake (process {plain.pid}) is at work here" in owning.who_is_at_work()
    plain.stdin.close()
    plain.wait()
    assert "was killed; its lock is removed" in release_dead()


def test_a_snakemake_of_another_folder_keeps_no_lock(
    locked, ended, snakemake, tmp_path
):
    locked(Owner("trial", HERE, *ended))
    snakemake(tmp_path / "another")
    assert "was killed; its lock is removed" in release_dead()


def test_a_snakemake_whose_folder_may_not_be_seen(
    locked, ended, snakemake, monkeypatch, tmp_path
):
    """It keeps the lock if its user owns one here, and not otherwise."""

    def denied(*_):
        raise psutil.AccessDenied

    locked(Owner("trial", HERE, *ended))
    plain = snakemake(tmp_path / "another")
    monkeypatch.setattr(psutil.Process, "cwd", denied)
    assert release_dead() == ""
    told = owning.who_is_at_work()
    assert str(plain.pid) in told
    assert (
        "may be a Snakemake that is at work here; if none is at work: hopdata run"
        in told
    )
    other = SimpleNamespace(effective=os.getuid() + 1)
    monkeypatch.setattr(psutil.Process, "uids", lambda _: other)
    assert "was killed; its lock is removed" in release_dead()


def test_a_lock_without_a_record_stays(locked):
    assert release_dead() == ""
    assert LOCKS.exists()
    assert "that hopdata did not start, or one was killed" in owning.who_is_at_work()


def test_a_damaged_record_without_a_name_is_no_record(locked, ended):
    locked(Owner("trial", HERE, *ended))
    (RECORDS / "9.json").write_text('{"study": ')
    (RECORDS / "8.json").write_text("[1]")
    assert [one.study for one in owners().values()] == ["trial"]


def test_a_record_lasts_as_long_as_its_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with recorded("trial", os.getpid()):
        (known,) = owners().values()
        assert (known.study, known.host, known.pid) == ("trial", HERE, os.getpid())
        assert known.ticks == owning.ticks_of(os.getpid())
        assert known.ticks or not Path("/proc/self/stat").exists()
        assert not known.is_dead
    assert owners() == {}


def test_clean_and_doctor_name_the_owner(locked, ended, capsys):
    Path("config.yaml").write_text("study: trial\n")
    me = os.getpid()
    locked(Owner("other", HERE, me, began(me)))
    assert main(["clean", "config.yaml"]) == 1
    assert f"the run of 'other' (process {me} on {HERE}" in capsys.readouterr().err
    locked(Owner("other", HERE, *ended))
    main(["doctor"])
    assert (
        "was killed; the next 'hopdata run' here removes its lock"
        in capsys.readouterr().out
    )
    assert LOCKS.exists()
    assert main(["clean", "config.yaml"]) == 0
    assert not LOCKS.exists()


@pytest.mark.parametrize("content", ["", "{", '{"study": 3}', "\0\0"])
def test_the_name_of_a_damaged_record_tells_whose_it_is(locked, ended, content):
    """A full disk leaves a file without content, and the lock must not stand for ever."""
    RECORDS.mkdir(parents=True)
    (RECORDS / f"{HERE}-{ended[0]}.json").write_text(content)
    (known,) = owners().values()
    assert (known.host, known.pid) == (HERE, ended[0])
    assert "was killed; its lock is removed" in release_dead()
    (RECORDS / f"{HERE}-{os.getpid()}.json").write_text(content)
    (known,) = owners().values()
    assert not known.is_dead


def test_jobs_that_outlive_their_run_are_ended_and_drafts_removed(locked, ended):
    """They write the same files as those of the next run."""
    locked(Owner("trial", HERE, *ended))
    scripts = Path(".snakemake/scripts")
    scripts.mkdir()
    draft = Path("results/trial/.report.html.123.part")
    other = Path("results/other/.report.html.123.part")
    for file in (draft, other):
        file.parent.mkdir(parents=True)
        file.touch()
    text = "print(flush=True)\nimport time\ntime.sleep(60)\n"
    jobs = []
    for folder in (scripts, Path("elsewhere")):
        folder.mkdir(exist_ok=True)
        script = folder.resolve() / "tmp1.stage.py"
        script.write_text(text)
        job = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE)
        job.stdout.readline()
        jobs.append(job)
    try:
        assert "its lock is removed, a job that it left is ended, and" in release_dead()
        assert jobs[0].wait(timeout=10) is not None
        assert jobs[1].poll() is None
        assert not draft.exists()
        assert other.exists()
    finally:
        for job in jobs:
            job.kill()
            job.wait()
            job.stdout.close()


def test_the_lock_of_another_machine_is_taken_only_at_the_users_word(locked):
    elsewhere = Owner("trial", "another", 1, 0.0)
    locked(elsewhere)
    assert release_dead() == ""
    assert "hopdata run --if-locked take" in owning.who_is_at_work()
    told = owning.take_over()
    assert "as asked, the run of 'trial' (process 1 on another, since" in told
    assert "counts as dead; its lock is removed" in told
    assert not LOCKS.exists()
    assert owners() == {}
    assert owning.take_over() == ""


def test_nobody_takes_the_lock_of_a_run_that_lives_here(locked):
    me = os.getpid()
    locked(Owner("trial", HERE, me, began(me)))
    assert owning.take_over() == ""
    assert LOCKS.exists()


def test_a_run_waits_for_others_as_told_and_takes_over_if_they_die(
    locked, ended, capsys
):
    me = os.getpid()
    locked(Owner("trial", HERE, me, began(me)))
    start = time.monotonic()
    owning.wait_for_others(0.2)
    assert time.monotonic() - start >= 0.2
    assert LOCKS.exists()
    locked(Owner("trial", HERE, *ended))
    owning.wait_for_others(30)
    assert "was killed; its lock is removed" in capsys.readouterr().err
    assert not LOCKS.exists()


@pytest.mark.parametrize(
    ("word", "is_dry"),
    [
        *(
            ("-n", True),
            ("-np", True),
            ("-pn", True),
            ("-Fkn", True),
            ("--dryrun", True),
        ),
        # The last letters are the value of the first, or the word is no option.
        *(
            ("-p", False),
            ("-cn", False),
            ("-qn", False),
            ("n", False),
            ("--non", False),
        ),
    ],
)
def test_short_options_may_stand_in_one_word(word, is_dry):
    words = ["snakemake", "--cores", "1", word]
    assert bool(owning.DRY & owning.options_of(words)) == is_dry
    assert workflow.is_dry(words) == is_dry


@pytest.mark.parametrize(
    ("word", "is_dry", "has_no_jobs"),
    [
        ("--dry", True, True),
        ("--unl", False, True),
        ("--list-i", False, True),
        ("--cleanup-m=a", False, True),
        # The first begins none; what follows the others are targets, or no option.
        ("--until", False, False),
        ("--dry-runs", False, False),
        ("--", False, False),
        ("dry", False, False),
    ],
)
def test_abbreviated_options_are_known(word, is_dry, has_no_jobs, monkeypatch):
    """Snakemake takes the beginning of an option for it, if it begins no other."""
    assert workflow.is_dry(["snakemake", word]) == is_dry
    begun = []
    monkeypatch.setattr(owning, "_begun", begun)
    monkeypatch.setattr(owning, "_hold_beginning", lambda: None)
    monkeypatch.setattr(owning, "_write_record", lambda *_: Path("no record"))
    monkeypatch.setattr(owning, "release_dead", lambda **_: "nothing")
    owning.begin("trial", ["snakemake", word])
    assert bool(begun) != has_no_jobs


def test_a_plain_snakemake_beside_a_run_is_told_to_wait_and_not_to_unlock(
    locked, capsys, monkeypatch
):
    me = os.getpid()
    parent = os.getppid()
    monkeypatch.setattr(owning, "_begun", [])
    locked(Owner("other", HERE, parent, began(parent)))
    try:
        assert not owning.begin("trial", ["snakemake", "--cores", "1"])
        told = capsys.readouterr().err
        assert f"the run of 'other' (process {parent} on {HERE}" in told
        assert "wait for its end" in told
        assert "--unlock" not in told
        assert f"process {me}" not in told
    finally:
        owning.begun()
    assert owning.begin("trial", ["snakemake", "--dry-run"]) is False


BEGINS = """
import sys, time
from pathlib import Path
from hopdata.commands import owner
owner.begin("trial", ["snakemake"])
begun = time.monotonic()
Path(".snakemake/locks").mkdir(parents=True, exist_ok=True)
time.sleep(0.3)
owner.begun()
print(begun, time.monotonic(), flush=True)
sys.stdin.read()
"""


def test_of_two_runs_that_begin_at_once_one_waits_for_the_other(tmp_path, monkeypatch):
    """Otherwise both would find no lock, or take over the same one."""
    monkeypatch.chdir(tmp_path)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", BEGINS]
    both = [subprocess.Popen(command, **pipes) for _ in range(2)]
    times = sorted([float(x) for x in one.stdout.readline().split()] for one in both)
    assert len(owners()) == 2
    for one in both:
        one.communicate("")
    assert times[1][0] >= times[0][1] - 0.1
    assert owners() == {}


BEGINNING = """
import sys
from hopdata.commands import owner
owner.begin("plain", sys.argv)
owner.begin("plain", sys.argv)  # as a workflow that includes another twice

onstart:
    owner.begun()
"""


def test_a_plain_snakemake_takes_over_too_however_often_it_is_killed(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("Snakefile").write_text(BEGINNING + RULES)
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--rerun-incomplete"]
    for _ in range(2):
        killed = subprocess.Popen(
            command, stderr=subprocess.DEVNULL, start_new_session=True
        )
        # A take-over removes the lock of the run before.
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            locks = [*LOCKS.glob("*.output.lock")]
            alive = [one for one in owners().values() if not one.is_dead]
            begun = [*Path(".snakemake/incomplete").glob("*")]
            if locks and alive and begun:
                break
            time.sleep(0.05)
        os.killpg(killed.pid, signal.SIGKILL)
        killed.wait()
    assert any(LOCKS.glob("*.output.lock"))
    Path("go").touch()
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    told = [line for line in run.stderr.splitlines() if line.startswith("hopdata:")]
    assert len(told) == 1
    assert "the run of 'plain'" in told[0]
    assert Path("a").read_text() == "whole\n"
    assert owners() == {}


RULES = """
rule a:
    output: "a"
    shell: "while [ ! -e go ]; do sleep 0.05; done; echo whole > a"
"""
RUN = """
from pathlib import Path
from hopdata.commands.workflow import run_workflow
run_workflow(Path("config.yaml"), "trial", "--cores", "1", snakefile=Path("Snakefile"))
"""


@pytest.fixture
def at_work(tmp_path, monkeypatch):
    """Start a run that waits for a file; return its process and Snakemake's."""
    monkeypatch.chdir(tmp_path)
    Path("config.yaml").write_text("study: trial\n")
    Path("Snakefile").write_text(RULES)
    command = [sys.executable, "-c", RUN]
    process = subprocess.Popen(
        command, stderr=subprocess.DEVNULL, start_new_session=True
    )
    deadline = time.monotonic() + 60
    while not any(LOCKS.glob("*.output.lock")) and time.monotonic() < deadline:
        time.sleep(0.05)
    yield process
    Path("go").touch()
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def test_a_killed_run_starts_again_with_the_same_command(at_work, capfd):
    os.killpg(at_work.pid, signal.SIGKILL)
    at_work.wait()
    (snakemake,) = owners().values()
    deadline = time.monotonic() + 30
    while not snakemake.is_dead and time.monotonic() < deadline:
        time.sleep(0.05)
    assert any(LOCKS.glob("*.output.lock"))
    Path("go").touch()
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=Path("Snakefile")) == 0
    assert "the run of 'trial'" in capfd.readouterr().err
    assert Path("a").read_text() == "whole\n"
    assert not any(LOCKS.glob("*"))


def test_a_run_beside_one_that_lives_names_it(at_work, capfd):
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=Path("Snakefile")) == 1
    told = capfd.readouterr().err
    assert (
        "expected files that are not locked, found: the run of 'trial' (process" in told
    )
    assert "is at work here; wait for its end" in told
    assert any(LOCKS.glob("*.output.lock"))


def test_a_request_to_end_is_passed_on_and_leaves_no_lock(at_work):
    at_work.terminate()
    time.sleep(0.2)
    Path("go").touch()
    at_work.wait(timeout=60)
    assert not any(LOCKS.glob("*"))
    assert owners() == {}


# Asks itself to end, or not, in the moment in which it starts Snakemake.
_ASKED_EARLY = """
import os, signal, subprocess, sys
from pathlib import Path
from hopdata.commands.workflow import run_workflow
popen = subprocess.Popen
def asked_before(command, **options):
    if sys.argv[1] == "asked":
        os.kill(os.getpid(), signal.SIGTERM)
    return popen([sys.executable, "-c", "import time; time.sleep(1)"], **options)
subprocess.Popen = asked_before
options = (Path("config.yaml"), "trial", "--cores", "1")
sys.exit(abs(run_workflow(*options, snakefile=Path("Snakefile"))))
"""


@pytest.mark.parametrize(
    ("asked", "code", "said"),
    [("asked", int(signal.SIGTERM), "ended from outside (SIGTERM)"), ("not", 0, "")],
)
def test_a_request_to_end_reaches_a_snakemake_that_is_being_started(
    tmp_path, asked, code, said
):
    (tmp_path / "Snakefile").write_text(RULES)
    command = [sys.executable, "-c", _ASKED_EARLY, asked]
    run = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == code, run.stderr
    assert said in run.stderr
    assert bool(said) == bool(run.stderr)


def locks_of(persistence, folder):
    """Return what two runs in a folder keep; each has locked a file of its own."""
    runs = [persistence(path=folder) for _ in range(2)]
    for run, file in zip(runs, "ab", strict=True):
        run._write_locks("output", [file])
    return runs


def test_a_run_that_ends_leaves_the_locks_of_others(tmp_path):
    """What is known of Snakemake here holds for the version that is installed."""
    plain = pytest.importorskip("snakemake.persistence.file").FilePersistence

    class Kept(plain):
        pass

    class Plain(plain):
        pass

    owning.keep_locks_of_others(Kept)
    owning.keep_locks_of_others(Kept)  # as a workflow that includes another twice
    first, second = locks_of(Kept, tmp_path / "kept")
    first.unlock()
    assert [*second._read_locks()] == [("output", "b")]
    second.unlock()
    assert [*second._read_locks()] == []
    # Without this, the end of the first frees the files of the second, and a run that
    # begins then cannot lock its own.
    first, second = locks_of(Plain, tmp_path / "plain")
    first.unlock()
    assert [*second._read_locks()] == []
    with pytest.raises(FileNotFoundError):
        second._write_locks("output", ["b"])


def test_locks_that_others_remove_meanwhile_stop_no_run(tmp_path):
    plain = pytest.importorskip("snakemake.persistence.file").FilePersistence
    removed = []

    class Kept(plain):
        def _read_locks(self):
            for lock in super()._read_locks():
                if not removed:  # that of the other run, which ends now
                    removed.append(lock)
                    for file in Path(self._lockdir).glob("1.*"):
                        file.unlink()
                yield lock

    owning.keep_locks_of_others(Kept)
    first, second = locks_of(Kept, tmp_path)
    assert [*first._read_locks()] == [("output", "a")]
    assert removed
    for file in (tmp_path / "locks").iterdir():
        file.unlink()
    (tmp_path / "locks").rmdir()
    second._write_locks("input", iter(["c"]))
    assert [*first._read_locks()] == [("input", "c")]
    # At a person's word all are removed.
    first.cleanup_locks()
    assert not (tmp_path / "locks").exists()


# Starts a Snakemake, says its number, and lives on.
_STARTS = """
import os, subprocess, sys, time
child = "from hopdata.commands import owner; owner._end_with_hopdata(); print(1, flush=True); "
child += "import time; time.sleep(60)"
names = {"itself": str(os.getpid()), "another": "1", "nobody": ""}
environment = os.environ | {"HOPDATA_RUN": names[sys.argv[1]]}
command = [sys.executable, "-c", child]
started = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)
started.stdout.readline()
print(started.pid, flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells")
@pytest.mark.parametrize("by", ["itself", "another", "nobody"])
def test_a_snakemake_ends_with_the_hopdata_that_started_it(by):
    command = [sys.executable, "-c", _STARTS, by]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hopdata_run:
        snakemake = psutil.Process(int(hopdata_run.stdout.readline()))
        hopdata_run.kill()
    gone, alive = psutil.wait_procs([snakemake], timeout=1 if by != "itself" else 20)
    for process in alive:
        process.kill()
    assert bool(gone) == (by == "itself")
