"""Why a run of Snakemake failed, in one line, from the page of text that it leaves."""

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from signal import valid_signals

from hopdata.causes import (
    MISSING,
    NO_PROCESS,
    OPEN_FILES,
    READ_ONLY,
    NoForkError,
    OomKills,
    ServerEndedError,
    cause_in,
    killed_told,
    signal_told,
)

_FAILED = re.compile(r"Error in rule (\w+):")
_EXCEPTION = "RuleException"
_LOG = re.compile(r"^ +log: ([^\n]*?)(?: \(check log file)", re.MULTILINE)
_SIGNAL = re.compile(r"died with <Signals\.\w+: (\d+)>")
_STATUS = re.compile(r"returned non-zero exit status (\d+)")
_ERROR = "ERROR hopdata: "
# What a shell adds to the number of the signal that ended its program.
_OF_SHELL = 128


@dataclass(frozen=True)
class _Failure:
    """What Snakemake says of a job that failed."""

    rule: str
    text: str

    @property
    def name(self) -> str:
        """The job's name: that of its log, which tells its recording too."""
        if self._log is None:
            return self.rule
        return self._log.stem

    @property
    def _log(self) -> Path | None:
        """Its log, which comes before that of a cluster."""
        found = _LOG.search(self.text)
        if not found:
            return None
        return Path(found[1].split(", ")[0])

    @property
    def has_log(self) -> bool:
        """Whether its rule keeps a log."""
        return self._log is not None

    @property
    def _kept(self) -> str:
        """What its log holds; nothing if there is none."""
        if self._log is not None:
            with suppress(OSError):
                return self._log.read_text(encoding="utf-8", errors="replace")
        return ""

    @property
    def said(self) -> str:
        """The error that the job itself has kept in its log."""
        for line in self._kept.splitlines():
            if line.startswith(_ERROR) and "unexpected error" not in line:
                return line.removeprefix(_ERROR)
        return ""

    @property
    def unexpected(self) -> str:
        """The error of a traceback in its log, which is a mistake of hopdata."""
        lines = self._kept.partition(f"{_ERROR}unexpected error")[2].split("\n")
        # Of a traceback only its head and the error are not indented. Where an error
        # led to others, the first of them tells most.
        heads_and_errors = [line for line in lines[1:] if line[:1].isalpha()]
        if len(heads_and_errors) < 2:
            return ""
        return f"unexpected {heads_and_errors[1]}; please report it with {self._log}"

    @property
    def signal(self) -> int:
        """The signal that ended it; 0 if none did."""
        found = _SIGNAL.search(self.text)
        if found:
            return int(found[1])
        found = _STATUS.search(self.text)
        if not found:
            return 0
        # Other codes above that of the shell, such as 255 of ssh, are no signals.
        number = int(found[1]) - _OF_SHELL
        return number if number in valid_signals() else 0


def _failures(text: str) -> Iterator[_Failure]:
    """Yield the jobs that failed, in the order in which they did.

    Snakemake tells the exception first, and then the job.
    """
    last = 0
    for place in _FAILED.finditer(text):
        before = text[last : place.start()]
        start = before.rfind(_EXCEPTION)
        exception = before[start:] if start >= 0 else ""
        job = text[place.end() :]
        following = _FAILED.search(job)
        if following:
            job = job[: following.start()]
        if exception:
            job = job.partition(_EXCEPTION)[0]
        yield _Failure(place[1], job + exception)
        last = place.end()


def why(said: Sequence[str], *, oom_before: OomKills | None) -> str:
    """Say in one line why a run failed, and what to change; empty if not known.

    Parameters
    ----------
    said
        What Snakemake said.
    oom_before
        `hopdata.causes.oom_kills` before the run.
    """
    text = "".join(said)
    failures = [*_failures(text)]
    told = _of_jobs(failures, oom_before)
    if told:
        return told
    if "MissingInputException" in text:
        return f"{_affected(text)}: {MISSING}"
    if "ProtectedOutputException" in text:
        return f"{_affected(text)}: {READ_ONLY}"
    cause = cause_in(text)
    if cause:
        return f"Snakemake: {cause}"
    for failure in failures:
        if failure.unexpected:
            return f"{failure.name}: {failure.unexpected}"
    for failure in failures:
        # A rule without a log has printed why.
        if failure.has_log:
            return f"{failure.name}: it failed, and its log tells no more"
    return ""


def own_words(said: Sequence[str]) -> str:
    """Return the error that a failed job has told itself; empty if none has."""
    for failure in _failures("".join(said)):
        if failure.said:
            return failure.said
    return ""


def failed_jobs(said: Sequence[str]) -> list[str]:
    """Return the names of the jobs that failed."""
    return [failure.name for failure in _failures("".join(said))]


def tell(logs: Iterable[str | Path], *, oom_before: OomKills | None) -> None:
    """Print the line that says why a run failed, from what Snakemake has logged.

    Nothing is printed if the reason is not known. `oom_before` is that of `why`.
    """
    said = []
    for log in logs:
        said.append(Path(log).read_text(encoding="utf-8", errors="replace"))
    reason = why(said, oom_before=oom_before)
    if reason:
        print(f"hopdata: error: {reason}", file=sys.stderr)


def _of_jobs(failures: Sequence[_Failure], oom_before: OomKills | None) -> str:
    """Say why jobs failed: by their own words, by a signal, or by what was printed."""
    for failure in failures:
        if failure.said:
            return failure.said
    for failure in failures:
        if failure.signal:
            told = signal_told(failure.signal, oom_before=oom_before)
            return f"{failure.name}: {told}"
    for failure in failures:
        cause = _of_server(failure, oom_before) or cause_in(failure.text)
        if cause:
            return f"{failure.name}: {cause}"
    return ""


def _of_server(failure: _Failure, oom_before: OomKills | None) -> str:
    """Say why a job could not begin as a fork; empty if it could."""
    if NoForkError.__name__ in failure.text:
        # The system says the same for want of memory and of processes.
        cause = cause_in(failure.text)
        return OPEN_FILES if cause == OPEN_FILES else NO_PROCESS
    if ServerEndedError.__name__ in failure.text:
        told = killed_told(oom_before)
        return f"the process that starts the jobs has ended; probably {told}"
    return ""


def _affected(text: str) -> str:
    """Return the first file that an exception of Snakemake names."""
    after = text.partition("affected files:")[2].split()
    return after[0] if after else "a file"
