"""Why a run of Snakemake failed, in one line, from the page of text that it leaves."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hopdata.causes import cause_in, signal_told

_LOG = re.compile(r"^ +log: ([^\n]*?)(?: \(check log file)", re.MULTILINE)
_SIGNAL = re.compile(r"died with <Signals\.\w+: (\d+)>")
_STATUS = re.compile(r"returned non-zero exit status (\d+)")
_ERROR = "ERROR hopdata: "
#: What a shell adds to the number of the signal that ended its program.
_OF_SHELL = 128


@dataclass(frozen=True)
class _Failure:
    """What Snakemake says of a job that failed."""

    rule: str
    text: str

    @property
    def name(self) -> str:
        """The job's name: that of its log, which tells its recording too."""
        found = _LOG.search(self.text)
        if not found:
            return self.rule
        return Path(found[1]).stem

    @property
    def said(self) -> str:
        """The error that the job itself has kept in its log."""
        found = _LOG.search(self.text)
        if not found:
            return ""
        with suppress(OSError):
            text = Path(found[1]).read_text(encoding="utf-8", errors="replace")
            for line in text.splitlines():
                if line.startswith(_ERROR) and "unexpected error" not in line:
                    return line.removeprefix(_ERROR)
        return ""

    @property
    def signal(self) -> int:
        """The signal that ended it; 0 if none did."""
        found = _SIGNAL.search(self.text)
        if found:
            return int(found[1])
        found = _STATUS.search(self.text)
        if found and int(found[1]) > _OF_SHELL:
            return int(found[1]) - _OF_SHELL
        return 0


def _failures(text: str) -> Iterator[_Failure]:
    """Yield the jobs that failed, in the order in which they did."""
    places = [*re.finditer(r"Error in rule (\w+):", text)]
    ends = [place.start() for place in places[1:]]
    ends.append(len(text))
    for place, end in zip(places, ends, strict=False):
        yield _Failure(place[1], text[place.start() : end])


def why(said: Sequence[str], *, oom_before: int | None) -> str:
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
    for failure in failures:
        if failure.said:
            return failure.said
    for failure in failures:
        if failure.signal:
            told = signal_told(failure.signal, oom_before=oom_before)
            return f"{failure.name}: {told}"
    for failure in failures:
        cause = cause_in(failure.text)
        if cause:
            return f"{failure.name}: {cause}"
    if "MissingInputException" in text:
        return _missing(text)
    cause = cause_in(text)
    if cause:
        return f"Snakemake: {cause}"
    if failures:
        one = failures[0]
        return f"{one.name}: it failed, and its log tells no more"
    return ""


def _missing(text: str) -> str:
    after = text.partition("affected files:")[2].split()
    file = after[0] if after else "a file"
    return f"{file}: it is missing; bring it back, then run the same command again"
