"""Snakemake as a process: its options, its progress, its errors."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hopdata.bundled import SNAKEFILE
from hopdata.causes import OomKills, oom_kills, signal_told
from hopdata.commands import answers, deaths
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
from hopdata.commands.progress import Progress, parted, plan_told
from hopdata.commands.terminal import progress_bar
from hopdata.errors import require

# What is told before the first job, which may take minutes.
_FIRST = "a first run compiles code, once, for a minute or more"

# What a job's error begins with.
ERROR = "hopdata: error:"

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
    ended: Callable[[str], None] | None = None,
    held: list[str] | None = None,
) -> int:
    """Run Snakemake on a configuration, show progress, and return its exit code.

    Its stderr goes to ``results/<study>/logs/run.log``, which is named if it fails.

    Parameters
    ----------
    if_locked
        What to do if another run may be at work here: ``ask`` on a terminal, and else
        leave it to Snakemake, which refuses files that are locked; ``wait`` for its
        end; or ``take`` its files over.
    ended
        Is called with the name of a stage after each of its jobs.
    held
        Errors of jobs, and the log's name, are put there in place of the terminal.
    """
    wanted = "the workflow"
    require(snakefile.exists(), str(snakefile), wanted, "no file; install hopdata anew")
    if not is_dry(options):
        _settle_lock(if_locked)
    if not os.access(os.path.expanduser("~"), os.W_OK):
        # Snakemake caches downloads there.
        os.environ.setdefault("XDG_CACHE_HOME", os.path.abspath(".snakemake"))
    oom_before = oom_kills()
    # What a dry run would do is told below; the table of Snakemake is kept back.
    listed = "--dry-run" in options
    command = _command(config, snakefile, options, listed=listed)
    with (
        _passed_on() as requests,
        _started(command, listed=listed) as snakemake,
        recorded(study, snakemake.pid),
        progress_bar(study) as show,
    ):
        requests.pass_to(snakemake)
        progress = Progress(show, "" if is_dry(options) else _FIRST, ended)
        said: list[str] = []
        try:
            for line in snakemake.stderr or ():
                text, event = parted(line)
                if event is not None:
                    progress.take(event)
                _take_text(text, said, held)
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
            if not _is_refused(said):
                log.parent.mkdir(parents=True, exist_ok=True)
                log.write_text("".join(said), encoding="utf-8")
    if code < 0:
        told = signal_told(-code, oom_before=oom_before)
        print(f"hopdata: error: Snakemake: {told}", file=sys.stderr)
    elif code:
        _report_failure(said, log, oom_before, held)
    elif listed:
        answers.give(planned=progress.planned)
        print(plan_told(study, progress.planned))
    return code


def _started(command: Sequence[str], *, listed: bool) -> subprocess.Popen[str]:
    """Start Snakemake; its table is kept from the terminal if it is to be read."""
    out: int | None = None
    if listed:
        out = subprocess.DEVNULL
    elif answers.is_asked():
        out = 2  # stdout holds the answer alone
    return subprocess.Popen(
        command,
        stdout=out,
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
    command += ["--logger", "hopdata", "--logger-hopdata-records"]
    command += ["--workflow-profile", profile, "--nocolor", *options]
    if listed:
        command += ["--quiet", "rules", "host", "reason"]
    return [str(word) for word in command]


def _take_text(text: str, said: list[str], held: list[str] | None) -> None:
    """Keep what Snakemake or a job has said; show it at once if hopdata says it.

    Unless it is an error that is held back.
    """
    if not text:
        return
    is_new = text not in said
    said.append(text)
    if not text.startswith("hopdata:") or not is_new:
        return
    if held is not None and text.startswith(ERROR):
        held.append(text)
    else:
        print(text, end="", file=sys.stderr, flush=True)


def _report_failure(
    said: Sequence[str], log: Path, oom_before: OomKills, held: list[str] | None
) -> None:
    """Say why Snakemake failed, and where all that it said is kept."""
    if _is_refused(said):
        found = f"expected files that are not locked, found: {who_is_at_work()}"
        print(f"hopdata: error: {LOCKS}: {found}", file=sys.stderr)
        return
    if not any(line.startswith(ERROR) for line in said):
        reason = deaths.why(said, oom_before=oom_before)
        if reason:
            print(f"hopdata: error: {reason}", file=sys.stderr)
        else:
            print("".join(said[-_LAST_LINES:]), end="", file=sys.stderr)
    if log.exists():
        told = f"hopdata: {log}: all that Snakemake said"
        if held:
            held.append(f"{told}\n")
        else:
            print(told, file=sys.stderr)


def _is_refused(said: Sequence[str]) -> bool:
    """Tell whether Snakemake found its files locked by another run."""
    return any("cannot be locked" in line for line in said)
