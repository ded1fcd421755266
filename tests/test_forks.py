"""Jobs as forks: each ends as a process of its own would, and none outlives its run."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hopdata import forks
from hopdata.causes import NoForkError
from hopdata.forks import Server

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="scripts are forks on Linux only"
)
CHECKOUT = Path(__file__).parents[1]


@pytest.fixture
def server():
    one = Server()
    yield one
    one.end()


@pytest.fixture
def script(tmp_path):
    """Return a function that writes a script, and returns its path."""

    def write(text, name="script.py"):
        file = tmp_path / name
        file.write_text(text)
        return str(file)

    return write


def lives(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]
    except FileNotFoundError:
        return False
    return state != "Z"


def ends(pid, within_s=20):
    until = time.monotonic() + within_s
    while lives(pid):
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("pass", 0),
        ("raise SystemExit", 0),
        ("raise SystemExit(3)", 3),
        ("raise SystemExit('a sentence')", 1),
        ("1 / 0", 1),
        ("import os; os.kill(os.getpid(), 9)", -9),
    ],
)
def test_ends_as_a_process_of_its_own(server, script, text, code):
    assert server.start("rule", script(text), {}).wait() == code


def test_script_has_folder_arguments_variables_and_ends_whole(server, script, tmp_path):
    text = """
        import atexit, json, os, sys, threading, time
        def late():
            time.sleep(0.2)
            open("late", "w").write("written")
        threading.Thread(target=late).start()
        atexit.register(lambda: open("last", "w").write("written"))
        found = [__name__, sys.argv, os.environ["TMPDIR"], os.environ["OMP_NUM_THREADS"]]
        json.dump(found, open("found.json", "w"))
    """
    file = script("\n".join(line[8:] for line in text.splitlines()))
    before = os.getcwd()
    os.chdir(tmp_path)
    try:
        assert server.start("rule", "script.py", {"TMPDIR": "/a place"}).wait() == 0
    finally:
        os.chdir(before)
    found = json.loads((tmp_path / "found.json").read_text())
    assert found == ["__main__", ["script.py"], "/a place", "1"]
    assert (tmp_path / "late").read_text() == "written"
    assert (tmp_path / "last").read_text() == "written"
    assert Path(file).exists()


def test_second_job_of_a_rule_finds_what_the_first_imported(server, script, tmp_path):
    found = tmp_path / "found"
    text = (
        f"import sys; open({str(found)!r}, 'a').write(str('wave' in sys.modules) + ' '); "
        "import wave"
    )
    for rule in ("one", "one", "other", "other"):
        assert server.start(rule, script(text), {}).wait() == 0
    # The server's imports serve all rules.
    assert found.read_text().split() == ["False", "True", "True", "True"]


def test_a_module_that_cannot_be_imported_again_is_left_to_its_jobs(server, script):
    text = "import sys, types; sys.modules['made_up'] = types.ModuleType('made_up')"
    for _ in range(3):
        assert server.start("rule", script(text), {}).wait() == 0


def test_begins_when_it_is_waited_for(server, script, tmp_path):
    """So a job that ends at once can be measured."""
    file = tmp_path / "begun"
    job = server.start("rule", script(f"open({str(file)!r}, 'w')"), {})
    time.sleep(0.3)
    assert lives(job.pid)
    assert not file.exists()
    assert job.wait() == 0
    assert file.exists()


def test_changed_code_is_read_by_another_server(script, tmp_path, monkeypatch):
    """No job mixes modules that were imported before an edit with others."""
    package = tmp_path / "hopdata"
    other = shutil.ignore_patterns("__pycache__", "_workflow")
    shutil.copytree(Path(forks.__file__).parent, package, ignore=other)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    server = Server()
    found = tmp_path / "found"
    uses = (
        "import hopdata.seal as one; "
        f"print(one.__dict__.get('EDITED'), file=open({str(found)!r}, 'a'))"
    )
    sleeper = server.start("sleeps", script("import time; time.sleep(60)"), {})
    for _ in range(2):
        assert server.start("rule", script(uses, "uses.py"), {}).wait() == 0
    first = server._process
    with open(package / "seal.py", "a") as file:
        file.write("\nEDITED = 'yes'\n")
    assert server.start("rule", script(uses, "uses.py"), {}).wait() == 0
    assert found.read_text().split() == ["None", "None", "yes"]
    assert server._process is not first
    assert lives(sleeper.pid)
    server.end()
    assert ends(sleeper.pid)
    first.wait()


def test_killed_job_takes_no_other_with_it(server, script):
    sleeper = script("import time; time.sleep(60)")
    first = server.start("rule", sleeper, {})
    other = server.start("rule", script("import time; time.sleep(0.5)", "other.py"), {})
    os.kill(first.pid, signal.SIGTERM)
    assert first.wait() == -signal.SIGTERM
    assert other.wait() == 0


def test_jobs_of_a_killed_server_die_and_the_next_job_gets_another(server, script):
    job = server.start("rule", script("import time; time.sleep(60)"), {})
    server._process.kill()
    assert job.wait() == -signal.SIGKILL
    assert ends(job.pid)
    assert server.start("rule", script("pass"), {}).wait() == 0


#: Python that runs before a server: no fork while there is a file of this name.
NO_FORK = """
import errno, os, sys
fork = os.fork
def refused():
    if os.path.exists({file!r}) and "hopdata.forks" in " ".join(sys.orig_argv):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")
    return fork()
os.fork = refused
"""


@pytest.fixture
def no_fork(tmp_path, monkeypatch):
    """Return a file; while it is there, servers that begin now can make no fork."""
    file = tmp_path / "no_fork"
    (tmp_path / "first").mkdir()
    text = NO_FORK.format(file=str(file))
    (tmp_path / "first" / "sitecustomize.py").write_text(text)
    before = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'first'}{os.pathsep}{before}")
    return file


def test_a_fork_that_the_system_refuses_fails_its_job_alone(no_fork, server, script):
    other = server.start("other", script("import time; time.sleep(1)", "other.py"), {})
    no_fork.touch()
    n_open = len(os.listdir("/proc/self/fd"))
    for _ in range(2):
        with pytest.raises(NoForkError, match="Resource temporarily unavailable"):
            server.start("rule", script("pass"), {})
    assert len(os.listdir("/proc/self/fd")) == n_open
    assert lives(server._process.pid)
    no_fork.unlink()
    assert server.start("rule", script("pass"), {}).wait() == 0
    assert other.wait() == 0


def test_a_server_that_cannot_be_started_fails_its_job_alone(
    server, script, monkeypatch
):
    def refused():
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    with monkeypatch.context() as without:
        without.setattr(forks, "new_server", refused)
        with pytest.raises(NoForkError):
            server.start("rule", script("pass"), {})
    assert server.start("rule", script("pass"), {}).wait() == 0


def test_a_snakemake_whose_jobs_cannot_be_forked_says_so(no_fork, workflow):
    no_fork.touch()
    done = snakemake(workflow, "a.txt")
    assert done.returncode == 1
    told = [line for line in done.stderr.splitlines() if line.startswith("hopdata:")]
    assert len(told) == 1
    assert told[0].startswith("hopdata: error: told: no process could be started")
    no_fork.unlink()
    assert snakemake(workflow, "a.txt").returncode == 0


def test_jobs_of_a_killed_run_die(script):
    sleeper = script("import time; time.sleep(60)", "sleeper.py")
    program = f"""
from hopdata import forks
from hopdata.forks import Server
server = Server()
jobs = [server.start("rule", {sleeper!r}, {{}}) for _ in range(2)]
print(*(job.pid for job in jobs), server._process.pid, flush=True)
jobs[0].wait()
"""
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        pids = [int(pid) for pid in run.stdout.readline().split()]
        assert all(lives(pid) for pid in pids)
        run.kill()
    assert all(ends(pid) for pid in pids)


def test_end_of_a_run_leaves_no_server(server, script):
    assert server.start("rule", script("pass"), {}).wait() == 0
    pid = server._process.pid
    server.end()
    assert not lives(pid)


@pytest.fixture
def workflow(tmp_path):
    """Return a folder with a workflow of jobs that say whose children they are."""
    told = (
        "import os, numpy; parent = open(f'/proc/{os.getppid()}/cmdline').read(); "
        "open(snakemake.output[0], 'w').write(f'{parent} {snakemake.params.given}')"
    )
    (tmp_path / "told.py").write_text(told)
    (tmp_path / "fails.py").write_text("import os; os.kill(os.getpid(), 9)")
    rules = f"""
include: "{CHECKOUT}/workflow/rules/folder.smk"

rule all:
    input: expand("{{name}}.txt", name=[*"abc"]), "threads.txt"

rule told:
    output: "{{name}}.txt"
    benchmark: "{{name}}.tsv"
    params: given=lambda wildcards: wildcards.name * 2
    script: "told.py"

rule threads:
    output: "threads.txt"
    threads: 2
    params: given="two"
    script: "told.py"

rule fails:
    output: "never"
    script: "fails.py"
"""
    (tmp_path / "Snakefile").write_text(rules)
    return tmp_path


def snakemake(folder, *options):
    command = [sys.executable, "-m", "snakemake", "--cores", "2", *options]
    return subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_snakemake_runs_its_scripts_as_forks(workflow):
    """What this package knows of Snakemake holds for the version that is installed."""
    done = snakemake(workflow)
    assert done.returncode == 0, done.stderr
    for name in "abc":
        text = (workflow / f"{name}.txt").read_text()
        assert "hopdata.forks" in text
        assert text.endswith(f" {name * 2}")
        header, row = (workflow / f"{name}.tsv").read_text().splitlines()
        times = dict(zip(header.split("\t"), row.split("\t"), strict=True))
        assert float(times["s"]) > 0.0
    # A script with several threads has a process of its own.
    assert "hopdata.forks" not in (workflow / "threads.txt").read_text()


def test_snakemake_tells_which_signal_ended_a_fork(workflow):
    done = snakemake(workflow, "never")
    assert done.returncode == 1
    assert "died with <Signals.SIGKILL: 9>" in done.stderr


def test_another_way_to_run_scripts_is_left_alone(workflow):
    file = workflow / "Snakefile"
    other = """
from snakemake.script import PythonScript

def other(script, file, edit=False):
    open(script.output[0], "w").write("by the other")

PythonScript.execute_script = other
"""
    file.write_text(other + file.read_text())
    assert snakemake(workflow, "never").returncode == 0
    assert (workflow / "never").read_text() == "by the other"
