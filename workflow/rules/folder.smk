import atexit
import os
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
from snakemake_logger_plugin_hopdata import is_telling

from hopdata.causes import oom_kills
from hopdata.commands import deaths, healing, owner
from hopdata.forks import Server, may_fork

OOM_BEFORE = oom_kills()

# Before this class was there, Snakemake removed its own locks alone.
with suppress(ImportError):
    from snakemake.persistence.file import FilePersistence

    owner.keep_locks_of_others(FilePersistence)

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


# If this file is included twice, or anybody else has changed how scripts run, that is left alone.
IS_OWN = PythonScript.execute_script.__module__ == PythonScript.__module__
if may_fork() and IS_OWN:
    PythonScript.execute_script = fork_script

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


def begin(study, files, folder):
    """Begin a run: take over the folder of one that was killed, and look at what is there."""
    if not workflow.is_main_process:
        return
    is_alone = owner.begin(study, sys.argv)
    check_times(files, folder, mend=is_alone)
    if is_alone:
        told = healing.heal(folder)
        if told:
            print(f"hopdata: {told}", file=sys.stderr)


def check_times(files, folder, *, mend):
    """Refuse inputs dated in the future, which Snakemake rejects; date such results anew.

    Whether a result is up to date does not hang on its date alone: names, sizes and dates of the
    user's files are parameters, and a result must have the bytes that were written.
    """
    told = "expected a time before now, found a later one: a clock is or was wrong"
    ahead = dated_ahead(files)
    if ahead:
        sys.exit(f"hopdata: error: {ahead[0]}: {told}; touch it and run again")
    made = []
    for place, _, names in os.walk(folder):
        made += [os.path.join(place, name) for name in names]
    results_ahead = dated_ahead(made)
    if results_ahead:
        anew = "; such results are dated anew" if mend else ", and a run will date it anew"
        print(f"hopdata: {results_ahead[0]}: {told}{anew}", file=sys.stderr)
    if mend:
        for file in results_ahead:
            with suppress(OSError):
                os.utime(file)


def dated_ahead(files):
    """Return the files that were last changed after now, but for a skew of clocks."""
    latest_ns = (time.time() + SKEW_S) * 1e9
    return [name for name, _, changed_ns in stamps(files) if changed_ns > latest_ns]


onstart:
    owner.begun()
    # Remove scripts that Snakemake wrote for the jobs of a killed run, unless another run is active
    # and may be using its own.
    if len(list(Path(".snakemake/locks").glob("*.output.lock"))) == 1:
        for left in Path(".snakemake/scripts").glob("tmp*"):
            left.unlink(missing_ok=True)
    # The rate limit for starting jobs is meant for clusters. Locally it delays each run by a second;
    # no option disables it.
    if getattr(workflow, "local_exec", False) and hasattr(workflow, "scheduler"):
        workflow.scheduler.job_rate_limiter = None


onerror:
    # Snakemake's page of text ends in one line that says why; `hopdata run` says it itself.
    # So does the logger plugin.
    if owner.STARTED_BY_HOPDATA not in os.environ and not is_telling():
        deaths.tell(log, oom_before=OOM_BEFORE)
