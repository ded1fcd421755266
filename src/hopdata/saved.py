"""Studies that were saved: their verdict, tables and figures without computing."""

from __future__ import annotations

import keyword
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdata import __version__
from hopdata.arrays import pd
from hopdata.errors import AnalysisError, ArgumentError, told_call
from hopdata.jobs import read_json
from hopdata.line import RECORDING, Result
from hopdata.stages import LINE
from hopdata.walk import Contents, Study

#: The file that is written last.
PROVENANCE = "provenance.json"
#: Files that are missing, by name, in a message.
MOST_NAMED = 4


@dataclass(frozen=True, repr=False)
class SavedStudy(Study):
    """A study whose results are read from a folder; nothing is computed.

    It has the attributes of `hopdata.Study`. What the folder lacks, such as the
    recordings where `hopdata.Study.save` wrote it, is refused by the name of its file.

    Attributes
    ----------
    folder
        The folder.
    """

    folder: Path = Path()

    def _result(self, name: str) -> Any:
        if name not in self._results:
            self._results[name] = self._read(LINE.results[name])
        return self._results[name]

    def _read(self, result: Result) -> Any:
        method = self.config["touchdowns"]["method"]
        if RECORDING not in result.wildcards:
            return self._read_file(result, result.path.format(method=method))
        return {
            name: self._read_file(result, result.path.format(recording=name))
            for name in self._names()
        }

    def _read_file(self, result: Result, path: str) -> Any:
        file = self.folder / path
        if not file.is_file():
            found = "none; the study's own hd.study(...), or its workflow, makes it"
            raise AnalysisError.at(file, f"a saved study with {path}", found)
        found = result.read(file)
        if isinstance(found, pd.DataFrame):
            _require_new_names(file, found)
        return found

    def _run(self, name: str) -> Any:
        wanted = "a study that computes: hd.study(loaded.config)"
        raise AnalysisError.at(name, wanted, f"one loaded from {self.folder}")

    def _provenance(self) -> Contents:
        """Return the versions and files that the results were made with."""
        found: Contents = read_json(self.folder / PROVENANCE)
        return found

    def report(self, file: str | Path, *, drawn: str | Path | None = None) -> Path:
        """Write the study's page, if the folder holds it or the recordings for it."""
        page = self.folder / "report.html"
        if not page.is_file():
            return super().report(file, drawn=drawn)
        target = Path(file)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(page.read_bytes())
        return target


@told_call
def load(folder: str | Path) -> SavedStudy:
    """Load a study from the folder that `hopdata.Study.save` or the workflow wrote.

    Parameters
    ----------
    folder : path
        Such as ``"results/hopper"``.

    Returns
    -------
    SavedStudy
        With the verdict, touchdowns, tables, pairs and figures of the study, which are
        read, not computed. The numbers are those of the study; `Study.figures` draws
        the figures again.

    Raises
    ------
    ArgumentError
        If this is no folder.
    AnalysisError
        If it is not that of a study, if files are missing, or if another version of
        hopdata wrote it.
    """
    if not isinstance(folder, str | Path) or not Path(folder).is_dir():
        found = f"{folder!r}" if not isinstance(folder, Path) else f"'{folder}'"
        raise ArgumentError.at("folder", "the folder of a saved study", found)
    base = Path(folder)
    if not (base / PROVENANCE).is_file():
        raise _no_study(base)
    content = read_json(base / PROVENANCE)
    try:
        version = content["versions"]["hopdata"]
        config = content["config"]
        # Another program's file may lack what a study's configuration always has.
        _ = config["study"]
        _ = [entry["name"] for entry in config["recordings"]]
    except (KeyError, TypeError) as error:
        found = f"nothing of that ({type(error).__name__}: {error})"
        wanted = "the versions and the configuration of a study"
        raise AnalysisError.at(base / PROVENANCE, wanted, found) from None
    if version != __version__:
        wanted = f"a study of hopdata {__version__}"
        found = f"one of {version}; load it with that version, or run it again"
        raise AnalysisError.at(base, wanted, found)
    study = SavedStudy(config, folder=base)
    wanted_files = [one.path for one in study._results_of_the_whole().values()]
    missing = [path for path in wanted_files if not (base / path).is_file()]
    if missing:
        named = ", ".join(missing[:MOST_NAMED])
        if len(missing) > MOST_NAMED:
            named += f" and {len(missing) - MOST_NAMED} more"
        wanted = f"{len(wanted_files)} files of results"
        raise AnalysisError.at(base, wanted, f"none named {named}; run it again")
    _ = study.verdict
    return study


def _no_study(base: Path) -> AnalysisError:
    """Return the error for a folder that is not that of a finished study."""
    within = sorted(file.parent.name for file in base.glob(f"*/{PROVENANCE}"))
    found = f"no {PROVENANCE}"
    if within:
        found += f"; those within are of studies: {', '.join(within[:MOST_NAMED])}"
    elif (base / "verdict.json").is_file():
        found += ": its run has not ended, or an older hopdata saved it; run it again"
    return AnalysisError.at(base, "the folder of a finished study", found)


def _require_new_names(file: Path, table: pd.DataFrame) -> None:
    """Require a table of this hopdata, by the names of its columns.

    The version stayed the same when columns that hide an attribute of a DataFrame, as
    ``index`` does, or cannot be one, as ``class``, got other names, and when the
    touchdowns of a recording began to count from 1.

    Raises
    ------
    AnalysisError
        If it is older.
    """
    former = [
        name
        for name in table.columns
        if hasattr(pd.DataFrame, name) or keyword.iskeyword(name)
    ]
    if former:
        wanted = "columns as this hopdata names them"
        found = f"{', '.join(former)}, as before; run the study again"
        raise AnalysisError.at(file, wanted, found)
    if "touchdown" in table and (table["touchdown"] == 0).any():
        wanted = "touchdowns that count from 1"
        found = "one that is 0, as before; run the study again"
        raise AnalysisError.at(file, wanted, found)
