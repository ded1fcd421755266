import atexit
import os
import shlex
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

# Nothing in a study's folder is imported. Snakemake puts the Snakefile's folder first on Python's
# path, which in a clone is the study's, and Python does the same with the working folder of jobs.
os.environ.update(PYTHONSAFEPATH="1")
sys.path[:] = [place for place in sys.path if Path(place).resolve() != Path.cwd()]

from snakemake.benchmark import benchmarked
from snakemake.script import PythonScript

from hopdata.forks import Server

SERVER = Server()
atexit.register(SERVER.end)


def fork_script(script, file, edit=False, *, anew=PythonScript.execute_script):
    """Run a script as a fork of a process that has imported the libraries: see `hopdata.forks`.

    Scripts with several threads, or with an environment of their own, get a new Python.
    """
    others = (script.container_img, script.conda_env, script.env_modules)
    shell = script.resources.get("shell_exec")
    if edit or any(others) or shell or script.threads > 1:
        anew(script, file, edit)
        return
    environment = {}
    if script.resources.get("tmpdir"):
        names = ("TMPDIR", "TMP", "TEMPDIR", "TEMP")
        environment = dict.fromkeys(names, script.resources["tmpdir"])
    job = SERVER.start(script.rulename, str(file), environment)
    with ExitStack() as measured:
        if script.bench_record is not None:
            measured.enter_context(benchmarked(job.pid, script.bench_record))
        code = job.wait()
    if code:
        # As for a process of its own: the message names a signal that ended it.
        raise subprocess.CalledProcessError(code, f"{sys.executable} {file}")


# Only Linux has all that this takes. A file that is included twice, or anybody else who has changed
# how scripts run, is left alone.
IS_OWN = PythonScript.execute_script.__module__ == PythonScript.__module__
if sys.platform.startswith("linux") and IS_OWN:
    PythonScript.execute_script = fork_script

# Snakemake refuses a locked folder without saying which command unlocks it.
if (
    workflow.is_main_process
    and "--unlock" not in sys.argv
    and any(Path(".snakemake/locks").glob("*.output.lock"))
):
    is_module = sys.argv[0].endswith("__main__.py")
    program = [sys.executable, "-m", "snakemake"] if is_module else sys.argv[:1]
    print(
        "hopdata: .snakemake/locks: another run is active in this folder, or one was killed; if "
        "Snakemake refuses to start and no other run is active, unlock the folder: "
        f"{shlex.join([*program, *sys.argv[1:]])} --unlock",
        file=sys.stderr,
    )
SKEW_S = 60  # allowed difference between the clocks of two machines, s


def stamps(files):
    """Return names, sizes and modification times of the files that exist.

    Snakemake only checks whether an input is newer than an output. It would not notice a file that
    was replaced by an older one, or written while the clock was wrong.
    """
    found = []
    for file in files:
        with suppress(OSError):
            status = os.stat(file)
            found.append((str(file), status.st_size, status.st_mtime_ns))
    return found


def check_times(files, folder):
    """Refuse inputs dated in the future, which Snakemake rejects, and warn of such results."""
    if not workflow.is_main_process:
        return
    made = (os.path.join(place, name) for place, _, names in os.walk(folder) for name in names)
    latest = (time.time() + SKEW_S) * 1e9
    read, kept = ([one[0] for one in stamps(x) if one[2] > latest] for x in (files, made))
    told = "expected a time before now, found a later one: a clock is or was wrong"
    if read:
        sys.exit(f"hopdata: error: {read[0]}: {told}; touch it and run again")
    if kept:
        print(
            f"hopdata: {kept[0]}: {told}, and Snakemake decides by file times what to run; run "
            "once with --force, or --forceall",
            file=sys.stderr,
        )


onstart:
    # Remove scripts that Snakemake wrote for the jobs of a killed run, unless another run is active
    # and may be using its own.
    if len(list(Path(".snakemake/locks").glob("*.output.lock"))) == 1:
        for left in Path(".snakemake/scripts").glob("tmp*"):
            left.unlink(missing_ok=True)
    # The rate limit for starting jobs is meant for clusters. Locally it delays each run by a second;
    # no option disables it.
    if getattr(workflow, "local_exec", False) and hasattr(workflow, "scheduler"):
        workflow.scheduler.job_rate_limiter = None
