"""Studies and groups that were saved: their results without computing."""

from __future__ import annotations

import keyword
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata import __version__
from hopdata.arrays import Shown, figure_function, pd
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    counted,
    require_choice,
    told_call,
)
from hopdata.jobs import read_json
from hopdata.line import RECORDING, Result
from hopdata.stages import LINE
from hopdata.walk import Contents, Study

if TYPE_CHECKING:
    from hopdata.maps.verdict.group import GroupVerdict
    from hopdata.report.methods import Methods

#: The file that is written last.
PROVENANCE = "provenance.json"
#: The file of a group's answer.
ANSWER = "group.json"
#: Files that are missing, by name, in a message.
MOST_NAMED = 4


@dataclass(frozen=True, repr=False)
class SavedStudy(Study):
    """A study whose results are read from a folder; nothing is computed.

    It has the attributes and methods of `hopdata.Study`. What the folder lacks is
    refused by the name of its file.

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
        try:
            found = result.read(file)
        except (KeyError, TypeError) as error:
            wanted = "results as this hopdata writes them"
            former = f"others ({error}), as before; run the study again"
            raise AnalysisError.at(file, wanted, former) from None
        if isinstance(found, pd.DataFrame):
            _require_new_names(file, found)
        return found

    def _run(self, name: str) -> Any:
        """Return what a stage has found, as if it had just run."""
        stage = LINE.stages[name]
        found = {one: self._result(one) for one in stage.results}
        if RECORDING not in stage.per:
            return stage.returned(**found)
        return {
            recording: stage.returned(**{one: found[one][recording] for one in found})
            for recording in self._names()
        }

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


@dataclass(frozen=True, repr=False)
class SavedGroup(Shown):
    """A group of studies whose results are read from a folder; nothing is computed.

    ``group["anna"]`` is the study of a member, as `hopdata.load` returns it. A member
    may have none, as when a file is missing: `members` says why.

    Attributes
    ----------
    folder
        The folder.
    """

    folder: Path

    @cached_property
    def _content(self) -> dict[str, Any]:
        found: dict[str, Any] = read_json(self.folder / ANSWER)
        return found

    def _told(self) -> str:
        """Return the name, the size and the answer."""
        number = counted(len(self._content["members"]), "member")
        return f"'{self._content['study']}', {number}: {self.sentence}"

    def _rows(self) -> dict[str, Any]:
        """Return the members, their answers and their sizes."""
        table = self.members
        shown = ["name", "conclusion", "landings", "estimate", "low", "high", "reason"]
        return {name: table[name] for name in shown if name in table}

    @cached_property
    def _folders(self) -> dict[str, Path]:
        """Return the folders of the members that have a study, by their names."""
        names = [row["name"] for row in self._content["members"]]
        folders = {name: self.folder / "members" / name for name in names}
        return {
            name: own for name, own in folders.items() if (own / PROVENANCE).is_file()
        }

    def __getitem__(self, member: str) -> SavedStudy:
        reasons = {row["name"]: row["reason"] for row in self._content["members"]}
        require_choice("member", member, reasons)
        if member not in self._folders:
            wanted = "a member with a study"
            raise AnalysisError.at(member, wanted, reasons[member] or "no folder of it")
        return loaded_study(self._folders[member])

    def __iter__(self) -> Iterator[str]:
        return iter(self._folders)

    def __len__(self) -> int:
        return len(self._folders)

    def _ipython_key_completions_(self) -> list[str]:
        return [*self]

    @property
    def studies(self) -> dict[str, SavedStudy]:
        """The study of each member that has one."""
        return {member: self[member] for member in self}

    @property
    def conclusion(self) -> str:
        """The answer in a word or two, as for a study."""
        return str(self._content["conclusion"])

    @property
    def sentence(self) -> str:
        """The answer."""
        return str(self._content["sentence"])

    @property
    def verdict(self) -> GroupVerdict | None:
        """The model behind the answer.

        None if too few members have one, and for a group with conditions: each has its
        own, see `by_condition`.
        """
        return _group_verdict(self._content["effect"])

    @property
    def by_condition(self) -> dict[str, GroupVerdict | None]:
        """The model behind the answer of each condition; empty without conditions."""
        return {
            one["condition"]: _group_verdict(one["effect"])
            for one in self._content.get("by_condition", [])
        }

    @property
    def members(self) -> pd.DataFrame:
        """One row per member: its answer and size, or the ``reason`` of having none."""
        rows = [{**row, **row["further"]} for row in self._content["members"]]
        table = pd.DataFrame(rows)
        return table.drop(columns=["further", "quality"], errors="ignore")

    @property
    def conditions(self) -> pd.DataFrame:
        """Each two conditions that were compared within subjects; empty without."""
        return pd.DataFrame(self._content["conditions"])

    @told_call
    def plot(self, *, ax: Any = None, style: str | None = None) -> Any:
        """Draw the sizes of all members, and that of the group.

        Parameters
        ----------
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        from hopdata.group import one_by_one

        place = "sizes:sizes_figure"
        if one_by_one(self._content["members"]):
            place = "verdict:group_figure"
        return figure_function(place)(self._content, ax=ax, style=style)

    @told_call
    def methods(self) -> Methods:
        """Return the methods paragraph for a paper on the group.

        What was done in each study is in the member's own ``methods()``.

        Returns
        -------
        hopdata.report.methods.Methods
            ``text``, and ``bibtex`` of what it cites; ``print`` shows both.
        """
        from hopdata.report.group_methods import group_methods

        return group_methods(self._content)


@told_call
def load(folder: str | Path) -> SavedStudy | SavedGroup:
    """Load a study, or a group of studies, from its folder.

    Parameters
    ----------
    folder : path
        Such as ``"results/hopper"``; `hopdata.Study.save` or the workflow wrote it.

    Returns
    -------
    SavedStudy or SavedGroup
        With the verdict, touchdowns, tables, pairs and figures of the study, which are
        read, not computed. The numbers are those of the study; `Study.figures` draws
        the figures again. A group has its answer, a table of its ``members``, and the
        study of each by its name: ``group["anna"]``.

    Raises
    ------
    ArgumentError
        If this is no folder.
    AnalysisError
        If it is that of no study and no group, if files are missing, or if another
        version of hopdata wrote it.
    """
    if not isinstance(folder, str | Path) or not Path(folder).is_dir():
        found = f"{folder!r}" if not isinstance(folder, Path) else f"'{folder}'"
        raise ArgumentError.at("folder", "the folder of a saved study", found)
    if (Path(folder) / ANSWER).is_file():
        return loaded_group(Path(folder))
    return loaded_study(Path(folder))


def loaded_study(base: Path) -> SavedStudy:
    """Return the study in a folder.

    Raises
    ------
    AnalysisError
        If it is not that of a study, if files are missing, or if another version of
        hopdata wrote it.
    """
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
    wanted_files = [*study._files()]
    missing = [path for path in wanted_files if not (base / path).is_file()]
    if missing:
        named = ", ".join(missing[:MOST_NAMED])
        if len(missing) > MOST_NAMED:
            named += f" and {len(missing) - MOST_NAMED} more"
        wanted = f"{len(wanted_files)} files of results"
        raise AnalysisError.at(base, wanted, f"none named {named}; run it again")
    # They are read, so that a folder of an older hopdata is refused here.
    _ = study.verdict, study.sections, study.touchdowns
    return study


def loaded_group(folder: Path) -> SavedGroup:
    """Return the group in a folder.

    Raises
    ------
    AnalysisError
        If another version of hopdata wrote it.
    """
    group = SavedGroup(folder)
    version = group._content.get("version", "no version, as before")
    if version != __version__:
        wanted = f"a group of hopdata {__version__}"
        found = f"one of {version}; load it with that version, or run it again"
        raise AnalysisError.at(folder / ANSWER, wanted, found)
    return group


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


def _group_verdict(effect: Mapping[str, Any] | None) -> GroupVerdict | None:
    """Return the model of a group from its file; None if there is none."""
    from hopdata.maps.verdict.group import Combined, GroupVerdict

    if effect is None:
        return None
    return GroupVerdict(**{**effect, "combined": Combined(**effect["combined"])})
