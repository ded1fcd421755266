"""Snakemake as a process: its options, its progress, its errors."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import fmean
from typing import Any

from hopdata.bundled import SNAKEFILE
from hopdata.causes import OomKills, oom_kills, signal_told
from hopdata.commands import deaths
from hopdata.commands.owner import (
    DRY,
    LOCKS,
    STARTED_BY_HOPDATA,
    is_locked,
    may_be_taken,
    options_of,
    recorded,
    release_dead,
    take_over,
    wait_for_others,
    who_is_at_work,
)
from hopdata.commands.terminal import progress_bar
from hopdata.errors import counted, require

#: Snakemake's messages on jobs: start, end and count.
_SAID = re.compile(
    r" +jobid: (\d+)|Finished jobid: (\d+) \(Rule: (\w+)\)|(\d+) of (\d+) steps \("
)
#: The last row of Snakemake's table of the jobs that it will run.
_PLANNED = re.compile(r"total +(\d+)$")
#: Lines of Snakemake that are shown if it fails and nothing of hopdata says why.
_LAST_LINES = 12


def is_dry(options: Iterable[str]) -> bool:
    """Tell whether Snakemake only says what it would do."""
    return bool(DRY & options_of(options))


def run_workflow(
    config: Path,
    study: str,
    *options: str,
    snakefile: Path = SNAKEFILE,
    if_locked: str = "ask",
) -> int:
    """Run Snakemake on a configuration, show progress, and return its exit code.

    Its stderr goes to ``results/<study>/logs/run.log``, which is named if it fails.

    Parameters
    ----------
    if_locked
        What to do if another run may be at work here: ``ask`` on a terminal, and else
        leave it to Snakemake, which refuses files that are locked; ``wait`` for its
        end; or ``take`` its files over.
    """
    wanted = "the workflow"
    require(snakefile.exists(), str(snakefile), wanted, "no file; install hopdata anew")
    if not is_dry(options):
        _settle_lock(if_locked)
    if not os.access(os.path.expanduser("~"), os.W_OK):
        # Snakemake caches downloads there.
        os.environ.setdefault("XDG_CACHE_HOME", os.path.abspath(".snakemake"))
    oom_before = oom_kills()
    # The table of a dry run is read below; that of a run goes to the user's terminal.
    listed = "--dry-run" in options
    given_cores = options[options.index("--cores") + 1]
    cores = int(given_cores) if given_cores.isdigit() else os.cpu_count() or 1
    command = _command(config, snakefile, options, listed=listed)
    with (
        _passed_on() as requests,
        _started(command, listed=listed) as snakemake,
        recorded(study, snakemake.pid),
        progress_bar(study) as show,
    ):
        requests.pass_to(snakemake)
        progress = Progress(show, cores)
        try:
            for line in snakemake.stderr or ():
                progress.take(line)
            table = "".join(snakemake.stdout or ())
            code = snakemake.wait()
        except KeyboardInterrupt:
            # Snakemake receives it too, ends its jobs and unlocks the folder.
            snakemake.wait()
            raise
    log = Path("results", study, "logs", "run.log")
    if not is_dry(options):
        # Snakemake itself complains if a folder is not writable.
        with suppress(OSError):
            # The log of a run that is refused would take the place of the living run's.
            if not _is_refused(progress.said):
                log.parent.mkdir(parents=True, exist_ok=True)
                log.write_text("".join(progress.said), encoding="utf-8")
    if code < 0:
        told = signal_told(-code, oom_before=oom_before)
        print(f"hopdata: error: Snakemake: {told}", file=sys.stderr)
    elif code:
        _report_failure(progress.said, log, oom_before)
    elif listed:
        print(_planned(study, table))
    return code


def _started(command: Sequence[str], *, listed: bool) -> subprocess.Popen[str]:
    """Start Snakemake; its table is kept from the terminal if it is to be read."""
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE if listed else None,
        stderr=subprocess.PIPE,
        # Python would look for modules in the working folder first, for Snakemake and
        # for its jobs. That is a study's folder, into which anyone may have put files.
        env=os.environ | {"PYTHONSAFEPATH": "1", STARTED_BY_HOPDATA: str(os.getpid())},
        encoding="utf-8",
        errors="replace",
    )


class _Requests:
    """Requests to end, which go to Snakemake as soon as it has been started."""

    def __init__(self) -> None:
        self._early: list[int] = []
        self._snakemake: subprocess.Popen[str] | None = None

    def take(self, number: int, _: object) -> None:
        """Pass a signal on, or keep it until there is somebody to pass it to."""
        if self._snakemake is None:
            self._early.append(number)
        else:
            self._snakemake.send_signal(number)

    def pass_to(self, snakemake: subprocess.Popen[str]) -> None:
        """Pass on what has come, and what will come."""
        self._snakemake = snakemake
        for number in self._early:
            snakemake.send_signal(number)


@contextmanager
def _passed_on() -> Iterator[_Requests]:
    """Pass a request to end on to Snakemake, which ends its jobs and its lock.

    It begins before Snakemake is started: else one that came in between would end
    hopdata alone.
    """
    requests = _Requests()
    try:
        before = signal.signal(signal.SIGTERM, requests.take)
    except ValueError:  # only the main thread gets signals
        yield requests
        return
    try:
        yield requests
    finally:
        signal.signal(signal.SIGTERM, before)


def _settle_lock(if_locked: str) -> None:
    """Take over the lock of a dead run; of another, do as told."""
    told = release_dead()
    if not told and is_locked():
        if if_locked == "wait":
            print(f"hopdata: {who_is_at_work()}", file=sys.stderr, flush=True)
            wait_for_others()
        elif if_locked == "take" or _is_to_be_taken():
            told = take_over()
    if told:
        print(f"hopdata: {told}", file=sys.stderr, flush=True)


def _is_to_be_taken() -> bool:
    """Ask whether a lock is taken over, if it may be that of a dead run."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()) or not may_be_taken():
        return False
    print(f"hopdata: {who_is_at_work()}", file=sys.stderr)
    print("hopdata: take its files over? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in {"y", "yes"}


def _command(
    config: Path, snakefile: Path, options: Sequence[str], *, listed: bool
) -> list[str]:
    # The order matters: --configfile takes any number of files, so a target would be
    # one.
    profile = SNAKEFILE.parent / "profiles" / "default"  # also that of a group
    command: list[Any] = [sys.executable, "-m", "snakemake"]
    command += ["--configfile", config, "--snakefile", snakefile]
    command += ["--workflow-profile", profile, "--nocolor", *options]
    if listed:
        command += ["--quiet", "rules", "host", "reason"]
    return [str(word) for word in command]


class Progress:
    """What Snakemake has said, and how far it is.

    Parameters
    ----------
    show
        Takes the number of jobs that are done, that of all jobs, and a remark.
    cores
        Number of jobs that run at once.

    Attributes
    ----------
    said
        All its lines.
    """

    def __init__(self, show: Callable[[int, int, str], None], cores: int) -> None:
        self.said: list[str] = []
        self._show = show
        self._cores = cores
        self._start = time.monotonic()
        #: When each job began, by its number.
        self._begun: dict[str, float] = {}
        #: How long each finished job took, s.
        self._took: list[float] = []
        self._last_job = ""
        #: How many jobs will run; None before Snakemake has said so.
        self._planned: int | None = None

    def take(self, line: str) -> None:
        """Take a line; show it if it is one of hopdata, or tell how far the run is."""
        is_new = line not in self.said
        self.said.append(line)
        if line.startswith("hopdata:") and is_new:
            print(line, end="", file=sys.stderr, flush=True)
        planned = _PLANNED.match(line)
        if planned:
            self._planned = int(planned[1])
        found = _SAID.match(line)
        if not found:
            return
        begins, ends, rule, done, number = found.groups()
        if begins:
            self._begun[begins] = time.monotonic()
        elif ends:
            seconds = time.monotonic() - self._begun.get(ends, self._start)
            self._took.append(seconds)
            self._last_job = f"{rule} {seconds:.0f} s"
        else:
            # With --until, the count of steps holds jobs that will not run.
            number_that_runs = self._planned or int(number)
            self._show_step(int(done), number_that_runs)

    def _show_step(self, done: int, number: int) -> None:
        mean_s = fmean(self._took or [0.0])
        left_s = (number - done) * mean_s / self._cores
        if left_s:
            when = f"{self._last_job}, about {_in_words(left_s)} left"
        else:
            when = f"after {_in_words(time.monotonic() - self._start)}"
        self._show(done, number, when)


def _in_words(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"


def _report_failure(said: Sequence[str], log: Path, oom_before: OomKills) -> None:
    """Say why Snakemake failed, and where all that it said is kept."""
    if _is_refused(said):
        found = f"expected files that are not locked, found: {who_is_at_work()}"
        print(f"hopdata: error: {LOCKS}: {found}", file=sys.stderr)
        return
    if not any(line.startswith("hopdata: error:") for line in said):
        reason = deaths.why(said, oom_before=oom_before)
        if reason:
            print(f"hopdata: error: {reason}", file=sys.stderr)
        else:
            print("".join(said[-_LAST_LINES:]), end="", file=sys.stderr)
    if log.exists():
        print(f"hopdata: {log}: all that Snakemake said", file=sys.stderr)


def _is_refused(said: Sequence[str]) -> bool:
    """Tell whether Snakemake found its files locked by another run."""
    return any("cannot be locked" in line for line in said)


def _planned(study: str, table: str) -> str:
    """List what would run, a line per stage, from Snakemake's table of a dry run."""
    rows = re.findall(r"^(\w+) +(\d+)$", table.partition("\ntotal ")[0], re.MULTILINE)
    lines = [
        f"  {rule:20} {counted(int(number), 'job')}"
        for rule, number in rows
        if rule != "all"
    ]
    first = "would run" if lines else "nothing to do"
    return "\n".join([f"{study}: {first}", *lines])
