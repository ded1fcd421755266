"""How far a run of Snakemake is: from its events to a line for each stage.

The events come from hopdata's logger plugin (`snakemake_logger_plugin_hopdata`), as
mappings with the key ``event``:

- ``resources``: ``cores``, the number of jobs that run at once;
- ``planned``: ``jobs``, the number of jobs that will run of each stage;
- ``begun``: ``job``, its number; ``stage``, the name of its rule; ``makes_files``,
  whether it has outputs; ``at_s``, s since 1970;
- ``ended``: ``job`` and ``at_s``.

Between Snakemake and `hopdata run` they are lines of JSON among what Snakemake and its
jobs write on stderr, each behind the record separator of RFC 7464.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from statistics import fmean
from typing import Any, Protocol

from hopdata.errors import counted

Event = Mapping[str, Any]
SEPARATOR = "\x1e"
#: The rule that asks for all files of a run, and makes none.
TARGET = "all"


def line_of(event: Event) -> str:
    """Return an event as a line that `events_in` finds."""
    return f"{SEPARATOR}{json.dumps(event)}\n"


def parted(line: str) -> tuple[str, Event | None]:
    """Part a line of stderr into text and an event, which may follow unfinished text.

    What looks like an event and is none stays text.
    """
    text, separator, record = line.partition(SEPARATOR)
    if not separator:
        return line, None
    try:
        event = json.loads(record)
    except ValueError:
        return line, None
    if not isinstance(event, dict) or "event" not in event:
        return line, None
    if text:
        text += "\n"
    return text, event


class Show(Protocol):
    """Shows how far a run is."""

    def __call__(self, done: int, of: int, remark: str, stage: str = "") -> None:
        """Show how many jobs are done, what is left, and the stage that has ended."""


class Progress:
    """What is known of a run.

    Parameters
    ----------
    show : callable
        Is called after each job.
    first : str
        Remark that is shown before the first job; without it nothing is.
    ended : callable
        Is called with the name of a stage after each of its jobs.

    Attributes
    ----------
    planned : dict
        Number of jobs that will run of each stage.
    """

    def __init__(
        self, show: Show, first: str = "", ended: Callable[[str], None] | None = None
    ) -> None:
        self.planned: dict[str, int] = {}
        self._tell_ended = ended
        self._show = show
        self._first = first
        self._cores = 1
        self._n_jobs = 0
        self._n_done = 0
        #: When the first job began, s since 1970.
        self._start_s: float | None = None
        #: Stage and begin of each job, by its number.
        self._begun: dict[int, tuple[str, float]] = {}
        #: When the first job of each stage began.
        self._stage_begun: dict[str, float] = {}
        self._ended: Counter[str] = Counter()
        #: When the first job of each stage ended.
        self._stage_ended: dict[str, float] = {}
        #: How long the jobs of a stage took that began after that, s. Those before it
        #: may have waited until code was compiled.
        self._took: dict[str, list[float]] = {}
        self._without_files: set[str] = set()
        self._takers: dict[str, Callable[[Event], None]] = {
            "resources": self._take_resources,
            "planned": self._take_planned,
            "begun": self._take_begun,
            "ended": self._take_ended,
        }

    def take(self, event: Event) -> None:
        """Take an event; show how far the run is if a job has ended."""
        taker = self._takers.get(event["event"])
        if taker is not None:
            taker(event)

    def _take_resources(self, event: Event) -> None:
        self._cores = max(1, int(event["cores"]))

    def _take_planned(self, event: Event) -> None:
        self.planned = dict(event["jobs"])
        self._n_jobs = sum(self.planned.values())
        if self._first and self._n_jobs:
            self._show(0, self._n_jobs, self._first)
            self._first = ""  # Snakemake may tell its plan again

    def _take_begun(self, event: Event) -> None:
        stage = event["stage"]
        at_s = float(event["at_s"])
        if self._start_s is None:
            self._start_s = at_s
        self._begun[event["job"]] = (stage, at_s)
        self._stage_begun.setdefault(stage, at_s)
        if not event["makes_files"]:
            self._without_files.add(stage)

    def _take_ended(self, event: Event) -> None:
        stage, begun_s = self._begun.pop(event["job"], ("", None))
        if begun_s is None:
            return
        at_s = float(event["at_s"])
        self._n_done += 1
        self._ended[stage] += 1
        if begun_s >= self._stage_ended.setdefault(stage, at_s):
            self._took.setdefault(stage, []).append(at_s - begun_s)
        of = max(self._n_jobs, self._n_done)
        self._show(self._n_done, of, self._left(at_s), self._stage_told(stage, at_s))
        if self._tell_ended is not None:
            self._tell_ended(stage)

    def _stage_told(self, stage: str, at_s: float) -> str:
        """Name a stage whose last job has ended, and how long it took; else nothing."""
        number = self._ended[stage]
        if number < self.planned.get(stage, 1) or stage in self._without_files:
            return ""
        took = in_words(at_s - self._stage_begun[stage])
        jobs = f" ({counted(number, 'job')})" if number > 1 else ""
        return f"{stage}{jobs} {took}"

    def _left(self, at_s: float) -> str:
        """Say how long the rest will take, if that is known; else how long it took."""
        left_s = None
        if self._n_done < self._n_jobs:
            left_s = self._left_s(at_s)
        if left_s is not None:
            return f"about {in_words(left_s)} left"
        assert self._start_s is not None  # a job has ended
        return f"after {in_words(at_s - self._start_s)}"

    def _left_s(self, at_s: float) -> float | None:
        """Return how long the jobs that are left will take, s; None if that is unknown.

        It is known from jobs of the same stage, as in a group of studies. One job of
        another stage may be left, the last one; in a study there are many.
        """
        left = {
            stage: number - self._ended[stage]
            for stage, number in self.planned.items()
            if stage != TARGET and number > self._ended[stage]
        }
        unknown = sum(
            number for stage, number in left.items() if stage not in self._took
        )
        if unknown > 1 or unknown == sum(left.values()):
            return None
        work_s = 0.0
        for stage, took in self._took.items():
            work_s += left.get(stage, 0) * fmean(took)
        for stage, begun_s in self._begun.values():
            if stage in self._took:
                work_s -= min(at_s - begun_s, fmean(self._took[stage]))
        return work_s / self._cores


def plan_told(title: str, jobs: Mapping[str, int]) -> str:
    """List what would run, a line for each stage."""
    lines = [
        f"  {stage:20} {counted(number, 'job')}"
        for stage, number in jobs.items()
        if stage != TARGET
    ]
    first = "would run" if lines else "nothing to do"
    return "\n".join([f"{title}: {first}", *lines])


def in_words(seconds: float) -> str:
    """Write a time as a reader would say it."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"
