"""Make one part of the page: what it measured, or why it could not be measured.

A part that fails does not stop the others. What it left stands in its folder: the
record ``rows.json``, the tables as CSV and the figures.
"""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.dissertation.rows import Made, Row
from hopdata.errors import AnalysisError, HopdataError, printable
from hopdata.jobs import read_json, read_table, write_json, write_table

if TYPE_CHECKING:
    from hopdata.arrays import pd
from hopdata.bundled import SNAKEFILE

logger = logging.getLogger(__name__)

RECORD = "rows.json"
TABLES = "tables"
FIGURES = "figures"

# The folder of the bundled configurations and recordings, in which parts run: the
# checkout, or the folder of the workflow in an installed wheel.
BUNDLED = SNAKEFILE.parent

# Libraries that an installation may lack, and how to get them.
EXTRAS = {"mujoco": "make dissertation, or pip install 'hopdata[dissertation]'"}

# A user ends a run by these, which says nothing about the part.
ENDED_BY_USER = {signal.SIGINT, signal.SIGTERM}


@dataclass(frozen=True)
class Failure:
    """Why something could not be made, and what to do about it.

    Attributes
    ----------
    why
        What happened, in a line.
    what_to_do
        What helps, in a line; empty if `why` says it.
    """

    why: str
    what_to_do: str = ""

    def __str__(self) -> str:
        if self.what_to_do:
            return f"{self.why}; {self.what_to_do}"
        return self.why


@dataclass(frozen=True)
class Record:
    """What a part left in its folder.

    Attributes
    ----------
    part
        Its name.
    seeds
        The seeds with which it measured.
    rows
        Its rows; none if it failed.
    figures
        The names of its figures.
    failure
        Why there are no rows; None if there are.
    failed_rows
        Why a row could not be kept, by the number of its item.
    failed_figures
        Why figures could not be drawn, by name; an empty name stands for all others.
    """

    part: str
    seeds: Sequence[int] = ()
    rows: Sequence[Row] = ()
    figures: Sequence[str] = ()
    failure: Failure | None = None
    failed_rows: Mapping[int, Failure] = field(default_factory=dict)
    failed_figures: Mapping[str, Failure] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the record for JSON."""
        content: dict[str, Any] = {
            "part": self.part,
            "seeds": list(self.seeds),
            "failure": None,
            "rows": [row.to_dict() for row in self.rows],
            "figures": list(self.figures),
            "failed_rows": {},
            "failed_figures": {},
        }
        if self.failure is not None:
            content["failure"] = asdict(self.failure)
        for item, failure in self.failed_rows.items():
            content["failed_rows"][str(item)] = asdict(failure)
        for name, failure in self.failed_figures.items():
            content["failed_figures"][name] = asdict(failure)
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Record:
        """Return the record of which `to_dict` made `content`."""
        failure = None
        if content["failure"] is not None:
            failure = Failure(**content["failure"])
        failed_rows = {}
        for item, told in content["failed_rows"].items():
            failed_rows[int(item)] = Failure(**told)
        failed_figures = {}
        for name, told in content["failed_figures"].items():
            failed_figures[name] = Failure(**told)
        return cls(
            part=content["part"],
            seeds=content["seeds"],
            rows=[Row.from_dict(row) for row in content["rows"]],
            figures=content["figures"],
            failure=failure,
            failed_rows=failed_rows,
            failed_figures=failed_figures,
        )


def read_record(folder: str | Path) -> Record:
    """Read what a part left in its folder."""
    return Record.from_dict(read_json(Path(folder, RECORD)))


def seeds_of(seed: int, number: int) -> list[int]:
    """Return the seeds of the repetitions, drawn from the study's seed.

    More repetitions keep those that were there.
    """
    return np.random.SeedSequence(seed).generate_state(number).tolist()


def make_part(
    name: str,
    folder: str | Path,
    seeds: Sequence[int],
    *,
    formats: Sequence[str] = ("svg", "png"),
    dpi: float = 200.0,
) -> Record:
    """Make a part, and keep in its folder what it found, or why it found nothing.

    Parameters
    ----------
    name
        Name of a module of `hopdata.dissertation.parts`.
    folder
        Where its record, tables and figures go; what an earlier run left is removed.
    seeds
        The seeds of the repetitions.
    formats, dpi
        Of the figures, as in `hopdata.figures.style.save_figure`.

    Returns
    -------
    Record
        What is in the folder. No error of the part is raised.
    """
    folder = Path(folder)
    _clear(folder)
    record = _made(name, folder, seeds, formats=formats, dpi=dpi)
    write_json(folder / RECORD, record.to_dict())
    return read_record(folder)


def _made(
    name: str,
    folder: Path,
    seeds: Sequence[int],
    *,
    formats: Sequence[str],
    dpi: float,
) -> Record:
    """Return what a part has made; its tables and figures are in the folder."""
    try:
        module = import_module(f"{__package__}.parts.{name}")
        made = module.make(list(seeds))
        tables = _kept_tables(made, folder / TABLES)
    except Exception as error:
        return Record(name, seeds, failure=_told(error, name))
    rows, failed_rows = _kept_rows(made, name)
    figures, failed_figures = _kept_figures(
        module, tables, folder / FIGURES, formats=formats, dpi=dpi
    )
    return Record(
        part=name,
        seeds=seeds,
        rows=rows,
        figures=figures,
        failed_rows=failed_rows,
        failed_figures=failed_figures,
    )


def make_part_apart(
    name: str,
    folder: str | Path,
    *,
    seed: int,
    repetitions: int,
    log: str | Path,
    formats: Sequence[str] = ("svg", "png"),
    dpi: float = 200.0,
) -> Record:
    """Make a part in another process, whose crash is a failure like any other.

    Parameters
    ----------
    name, folder, formats, dpi
        As in `make_part`.
    seed, repetitions
        As in `seeds_of`.
    log
        File to which the process writes what it says.

    Raises
    ------
    SystemExit
        If a user ended the process.
    """
    folder = Path(folder).resolve()
    _clear(folder)
    command = [sys.executable, "-m", __package__, name, "--quiet"]
    command += ["--out", str(folder)]
    command += ["--seed", str(seed), "--seeds", str(repetitions)]
    command += ["--dpi", str(dpi), "--formats", *formats]
    # Parts run side by side, each in one thread.
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    settings = {f"{library}_NUM_THREADS": "1" for library in libraries}
    # Nothing in the working folder is imported.
    settings["PYTHONSAFEPATH"] = "1"
    with Path(log).open("a", encoding="utf-8") as said:
        done = subprocess.run(
            command,
            env=os.environ | settings,
            stdout=said,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if not Path(folder, RECORD).exists():
        # A process that a signal ended has its negative number as the exit code.
        if -done.returncode in ENDED_BY_USER:
            raise SystemExit(f"hopdata: {name}: interrupted")
        _write_crash(name, folder, done.returncode)
    return read_record(folder)


def _write_crash(name: str, folder: Path, code: int) -> None:
    """Keep that the process of a part ended without a record."""
    ended = f"with the exit code {code}"
    if code < 0:
        ended = f"by the signal {signal.Signals(-code).name}"
    failure = Failure(f"its process ended {ended}", _repeat(name))
    write_json(folder / RECORD, Record(name, failure=failure).to_dict())


def _clear(folder: Path) -> None:
    """Remove what an earlier run left."""
    for place in (TABLES, FIGURES):
        shutil.rmtree(folder / place, ignore_errors=True)
        (folder / place).mkdir(parents=True)
    with suppress(FileNotFoundError):
        (folder / RECORD).unlink()


def _repeat(name: str) -> str:
    """Return what to do about an error that was not foreseen."""
    return f"python -m {__package__} {name} shows more"


def _told(error: Exception, name: str) -> Failure:
    """Return why a part failed; the log gets the traceback of what is not foreseen."""
    notes = getattr(error, "__notes__", [])
    why = " ".join([str(error) or type(error).__name__, *notes])
    if isinstance(error, HopdataError):
        logger.error("%s: %s", name, why)
        return Failure(printable(why))
    if isinstance(error, ImportError):
        library = (error.name or "").partition(".")[0]
        if library in EXTRAS:
            logger.error("%s: %s", name, why)
            return Failure(f"{library} is not installed", EXTRAS[library])
    logger.error("%s", name, exc_info=error)
    return Failure(printable(f"{type(error).__name__}: {why}"), _repeat(name))


def _kept_tables(made: Made, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the tables, and return them as they are read again."""
    tables = {}
    for name, table in made.tables.items():
        file = folder / f"{name}.csv"
        write_table(file, table)
        tables[name] = read_table(file)
    return tables


def _kept_rows(made: Made, name: str) -> tuple[list[Row], dict[int, Failure]]:
    """Return the rows that can be stored, as they are read again, and the others."""
    rows = []
    failed = {}
    for row in sorted(made.rows, key=lambda one: one.item):
        try:
            rows.append(Row.from_dict(row.to_dict()))
        except HopdataError as error:
            failed[row.item] = _told(error, name)
    return rows, failed


def _kept_figures(
    module: ModuleType,
    tables: Mapping[str, pd.DataFrame],
    folder: Path,
    *,
    formats: Sequence[str],
    dpi: float,
) -> tuple[list[str], dict[str, Failure]]:
    """Draw and save the figures of a part; return those saved, and why others fail."""
    from hopdata.figures.style import save_figure

    name = module.__name__.rpartition(".")[2]
    saved: list[str] = []
    failed: dict[str, Failure] = {}
    if not hasattr(module, "draw"):
        return saved, failed
    try:
        drawn = module.draw(tables)
    except Exception as error:
        return saved, {"": _told(error, name)}
    for figure_name, figure in drawn.items():
        try:
            if figure is None:
                raise AnalysisError.at(figure_name, "a figure", "none")
            save_figure(figure, folder / figure_name, formats=formats, dpi=dpi)
            saved.append(figure_name)
        except Exception as error:
            failed[figure_name] = _told(error, name)
    return saved, failed
