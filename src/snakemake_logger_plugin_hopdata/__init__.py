"""hopdata's messages on a run of Snakemake: ``snakemake --cores 2 --logger hopdata``.

A line tells each stage that has ended, with its time. What Snakemake itself says goes
to its log alone; a mistake is told in hopdata's one message. Snakemake finds its logger
plugins by the names of their packages, so that this one stands beside `hopdata`.
"""

# Snakemake reads the types of the settings, so that annotations are evaluated here.
import logging
import sys
from dataclasses import dataclass, field
from typing import Any

from snakemake.common import NOTHING_TO_BE_DONE_MSG
from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.settings import LogHandlerSettingsBase

# Snakemake imports all its plugins before it knows what is asked, and before a checkout
# has put its own code first: `hopdata` is imported when a run begins.

__all__ = ["LogHandler", "LogHandlerSettings", "event_of", "is_telling"]

#: What its lines begin with.
TITLE = "hopdata"
#: The handlers of this process that speak in Snakemake's place.
_TELLING: list["LogHandler"] = []


def is_telling() -> bool:
    """Tell whether this plugin speaks in Snakemake's place, in this process."""
    return bool(_TELLING)


@dataclass
class LogHandlerSettings(LogHandlerSettingsBase):
    """Options of Snakemake's command line."""

    records: bool = field(
        default=False,
        metadata={
            "help": "Beside Snakemake's own messages, write events as JSON text "
            "sequences (RFC 7464) to stderr, as `hopdata run` reads them.",
            "env_var": False,
            "required": False,
        },
    )


class LogHandler(LogHandlerBase):
    """Tell of each stage, or pass events on to `hopdata run`."""

    def __post_init__(self) -> None:
        """Begin to tell."""
        from hopdata.causes import oom_kills
        from hopdata.commands.progress import Progress
        from hopdata.commands.terminal import stage_lines

        self._progress = Progress(stage_lines(TITLE))
        self._is_planned = False
        self._is_local = True
        #: What Snakemake has said of mistakes.
        self._mistakes: list[str] = []
        self._oom_before = oom_kills()
        self._passes_on = bool(getattr(self.settings, "records", False))
        if not self._passes_on:
            _TELLING.append(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Take a record of Snakemake."""
        from hopdata.commands.progress import line_of

        try:
            event = event_of(record)
            if not self._passes_on:
                self._tell(record, event)
            elif event is not None:
                sys.stderr.write(line_of(event))
                sys.stderr.flush()
        except BrokenPipeError:
            raise
        except Exception:
            self.handleError(record)

    def _tell(self, record: logging.LogRecord, event: dict[str, Any] | None) -> None:
        from hopdata.commands.progress import plan_told

        if event is not None:
            self._progress.take(event)
        if record.levelno >= logging.ERROR:
            self._mistakes.append(DefaultFormatter().format(record) + "\n")
        kind = getattr(record, "event", None)
        if kind == LogEvent.RESOURCES_INFO and getattr(record, "nodes", None):
            self._is_local = False
        if record.msg == NOTHING_TO_BE_DONE_MSG:
            print(plan_told(TITLE, {}))
        elif self.common_settings.dryrun and kind == LogEvent.RUN_INFO:
            # Snakemake says this before and after the list of jobs.
            if not self._is_planned:
                print(plan_told(TITLE, self._progress.planned))
            self._is_planned = True

    def close(self) -> None:
        """Say in one message why the run failed, if it did."""
        from hopdata.commands import deaths

        mistakes = self._mistakes
        self._mistakes = []
        super().close()
        if not mistakes:
            return
        if self._is_local and deaths.own_words(mistakes):
            return  # the job has written them to the same terminal
        reason = deaths.why(mistakes, oom_before=self._oom_before)
        if not reason and self._is_local:
            # A rule without a log has printed why.
            jobs = deaths.failed_jobs(mistakes)
            reason = f"{', '.join(jobs)}: failed, as told above" if jobs else ""
        told = f"hopdata: error: {reason}\n" if reason else "".join(mistakes)
        print(told, end="", file=sys.stderr, flush=True)

    @property
    def writes_to_stream(self) -> bool:
        """Whether Snakemake's own messages are kept from the terminal."""
        return not getattr(self.settings, "records", False)

    @property
    def writes_to_file(self) -> bool:
        """Whether there is a log file; there is Snakemake's own."""
        return False

    @property
    def has_filter(self) -> bool:
        """Whether `emit` chooses the records: also with ``--quiet``."""
        return True

    @property
    def has_formatter(self) -> bool:
        """Whether `emit` puts records into words."""
        return True

    @property
    def needs_rulegraph(self) -> bool:
        """Whether the graph of all rules is asked for."""
        return False


def event_of(record: logging.LogRecord) -> dict[str, Any] | None:
    """Return a record of Snakemake as an event of `hopdata.commands.progress`."""
    kind = getattr(record, "event", None)
    told = record.__dict__
    if kind == LogEvent.RESOURCES_INFO and told.get("cores"):
        return {"event": "resources", "cores": int(told["cores"])}
    if kind == LogEvent.RUN_INFO:
        jobs = {name: n for name, n in told["stats"].items() if name != "total"}
        return {"event": "planned", "jobs": jobs}
    if kind == LogEvent.JOB_INFO:
        return {
            "event": "begun",
            "job": told["jobid"],
            "stage": told["rule_name"],
            "makes_files": bool(told["output"]),
            "at_s": record.created,
        }
    if kind == LogEvent.JOB_FINISHED:
        return {"event": "ended", "job": told["job_id"], "at_s": record.created}
    return None
