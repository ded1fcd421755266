"""A study in one process: each stage runs when one of its results is asked for.

A stage gets what its files would hold, rounded to the same digits, so the results equal
the workflow's byte for byte.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from hopdata import stages
from hopdata.arrays import Shown, pd
from hopdata.bundled import SNAKEFILE
from hopdata.config import consistency
from hopdata.errors import ArgumentError, absent, require_choice, told_call
from hopdata.figures.catalogue import (
    FIGURES,
    OF_DISTANCES,
    drawn_by_package,
    function_of,
    of_packages,
    tables_of,
)
from hopdata.jobs import whole_file, write_json
from hopdata.line import RECORDING, Stage
from hopdata.recording import Recording, place_of
from hopdata.recordings.readers import hdf5
from hopdata.stages import LINE

if TYPE_CHECKING:
    from hopdata.landings.floor_surface import FloorModel
    from hopdata.landings.sections.poincare import Sections
    from hopdata.landings.states.pairs import Pairs
    from hopdata.maps.verdict.judge import Verdict
    from hopdata.truth import Truth

Contents = dict[str, Any]
Progress = Callable[[str], object]


@dataclass(frozen=True, repr=False)
class Study(Shown):
    """A study whose stages are computed once, when they are first used.

    Attributes
    ----------
    config
        The whole configuration, as `hopdata.config.load_config` returns it.
    _given
        Plausible recordings to use instead of the configuration's files.
    progress
        Function that is called with the name of each stage as it begins.
    """

    config: Contents
    _given: tuple[Recording, ...] = ()
    progress: Progress = field(default=lambda _stage: None)
    #: What each stage that has run returned; by recording if it ran for each of them.
    _returned: dict[str, Any] = field(default_factory=dict, init=False)
    #: Each result that is known, by name; by recording if each has one.
    _results: dict[str, Any] = field(default_factory=dict, init=False)
    #: The truth of each recording that has one: for its file alone, no stage sees it.
    _truths: dict[str, Truth] = field(default_factory=dict, init=False)

    def _told(self) -> str:
        """Return the name and the answer."""
        answer = "no verdict yet"
        if "verdict" in self._results:
            answer = self.verdict.sentence
        return f"'{self.config['study']}': {answer}"

    def _repr_html_(self) -> str:
        """Return the answer and its figure as HTML, for a notebook."""
        if "verdict" not in self._results or self.verdict.effect is None:
            return f"<p>{escape(repr(self))}</p>"
        label = escape(self.verdict.sentence)
        return f'<div aria-label="{label}">{self.figures.verdict()._repr_svg_()}</div>'

    # The stages, by the names of the workflow's rules. Two of them, `verdict` and
    # `quality`, are properties below.

    def import_recording(self) -> dict[str, stages.Imported]:
        """Read the recordings and check that they are plausible; see `imported`."""
        found: dict[str, stages.Imported] = self._run("import_recording")
        return found

    def floor_compensation(self) -> dict[str, stages.FloorCompensation]:
        """Subtract the floor and fill short gaps; see `recordings` and `floors`."""
        found: dict[str, stages.FloorCompensation] = self._run("floor_compensation")
        return found

    def foot_contacts(self) -> stages.FootContacts:
        """Find the descents of the body, and when each foot touched; see `contacts`."""
        found: stages.FootContacts = self._run("foot_contacts")
        return found

    def poincare_sections(self) -> stages.PoincareSections:
        """Choose the two Poincare sections; see `sections`."""
        found: stages.PoincareSections = self._run("poincare_sections")
        return found

    def section_densities(self) -> stages.SectionDensities:
        """Tabulate the densities of heights around the sections."""
        found: stages.SectionDensities = self._run("section_densities")
        return found

    def mode_schedules(self) -> stages.ModeSchedules:
        """Label each touchdown with the order of its contacts."""
        found: stages.ModeSchedules = self._run("mode_schedules")
        return found

    def home_frame(self) -> stages.HomeFrame:
        """Put the states in the home frame; see `pairs` and `touchdowns`."""
        found: stages.HomeFrame = self._run("home_frame")
        return found

    def normalisation(self) -> stages.Normalisation:
        """Choose the units of length and time; see `units`."""
        found: stages.Normalisation = self._run("normalisation")
        return found

    def prediction(self) -> stages.Prediction:
        """Measure the errors of the bootstrapped least-squares and mean predictors."""
        found: stages.Prediction = self._run("prediction")
        return found

    def constraint_subspaces(self) -> stages.ConstraintSubspaces:
        """Measure the distances between the orders' constraint subspaces."""
        found: stages.ConstraintSubspaces = self._run("constraint_subspaces")
        return found

    def landing_maps(self) -> stages.LandingMaps:
        """Fit the maps through the landing, rid of noise and curvature."""
        found: stages.LandingMaps = self._run("landing_maps")
        return found

    def inspection(self) -> stages.Inspection:
        """Look for faults in the recordings as they were read."""
        found: stages.Inspection = self._run("inspection")
        return found

    def _run(self, name: str) -> Any:
        """Run a stage and those before it, unless they have run; return its results."""
        if name not in self._returned:
            stage = LINE.stages[name]
            if RECORDING in stage.per:
                self._run_for_each_recording(stage)
            else:
                self._run_once(stage)
        return self._returned[name]

    def _run_once(self, stage: Stage) -> None:
        inputs = {name: self._result(name) for name in stage.inputs}
        made = self._call(stage, inputs)
        self._returned[stage.name] = made
        for name in stage.results:
            self._results[name] = getattr(made, name)

    def _run_for_each_recording(self, stage: Stage) -> None:
        # First all that it takes, so that stages are told in their order.
        inputs = {name: self._result(name) for name in stage.inputs}
        every = {}
        for recording in self._names():
            if stage.name == "import_recording":
                every[recording] = self._imported(recording)
            else:
                own = {name: inputs[name][recording] for name in inputs}
                every[recording] = self._call(stage, own, recording)
        self._returned[stage.name] = every
        for name in stage.results:
            self._results[name] = {
                recording: getattr(made, name) for recording, made in every.items()
            }

    def _names(self) -> list[str]:
        return [entry["name"] for entry in self.config["recordings"]]

    def _call(
        self, stage: Stage, inputs: Mapping[str, Any], recording: str = ""
    ) -> Any:
        """Call a stage's function; return its results as its files would hold them."""
        given = {**inputs, **stage.settings(self.config, recording)}
        if "recording" in stage.takes:
            given["recording"] = recording
        if "method" in stage.takes:
            given["method"] = self.config["touchdowns"]["method"]
        self.progress(f"{stage.name} {recording}".rstrip())
        made = stage.function(**given)
        stored = {}
        for name, result in stage.results.items():
            value = getattr(made, name)
            if result.kind is stages.RECORDING_WITH_TRUTH and value[1] is not None:
                self._truths[recording] = value[1]
            if stage.makes_all(result):
                stored[name] = {
                    one: result.kind.as_stored(own) for one, own in value.items()
                }
            else:
                stored[name] = result.kind.as_stored(value)
        return replace(made, **stored)

    def _imported(self, name: str) -> stages.Imported:
        """Import a recording, unless it was given; simulate it if it has no file."""
        for recording in self._given:
            if recording.name == name:
                self.progress(f"import_recording {name}")
                return stages.Imported(recording)
        stage = LINE.stages["import_recording"]
        entry = next(one for one in self.config["recordings"] if one["name"] == name)
        files = consistency.files_of(entry)
        if files:
            return self._call(stage, {"files": files}, name)
        simulated = self._call(LINE.stages["simulate"], {}, name).simulated
        with TemporaryDirectory() as folder:
            file = f"{folder}/{name}.h5"
            hdf5.write_recording(file, simulated, truth=self._truths[name])
            made = self._call(stage, {"files": [file]}, name)
        # The folder is gone; the workflow would have kept the file here.
        kept = replace(made.imported, source=f"simulated/{name}.h5")
        return stages.Imported(kept)

    def _result(self, name: str) -> Any:
        """Return a result of any stage, by recording if each has one."""
        if name not in self._results:
            self._run(LINE.maker_of(name).name)
        return self._results[name]

    # What the stages found.

    @property
    def imported(self) -> list[Recording]:
        """Recordings as read: m, z up, with roles."""
        return [*self._result("imported").values()]

    @property
    def floors(self) -> dict[str, FloorModel]:
        """Floor model of each recording."""
        found: dict[str, FloorModel] = self._result("floor_model")
        return found

    @property
    def recordings(self) -> list[Recording]:
        """Recordings on a level floor, with short gaps filled where possible."""
        return [*self._result("level").values()]

    @property
    def contacts(self) -> dict[str, pd.DataFrame]:
        """Table per recording of the body's descents, and when each foot touched.

        They are found by ``touchdowns.method``, each in the whole descent of the body.
        The printed methods search again between the sections, once these are known
        (`touchdowns`).
        """
        found: dict[str, pd.DataFrame] = self._result("contacts")
        return found

    @property
    def sections(self) -> Sections:
        """The two Poincare sections."""
        found: Sections = self._result("sections")
        return found

    @property
    def touchdowns(self) -> pd.DataFrame:
        """Table with one row per touchdown; excluded ones have a reason."""
        found: pd.DataFrame = self._result("touchdowns")
        return found

    @property
    def pairs(self) -> Pairs:
        """States at the two sections in the home frame, with the contact instants."""
        found: Pairs = self._result("pairs")
        length_m = self.units["length_unit_m"]
        return found.with_units(length_m, self.units["time_unit_s"])

    @property
    def units(self) -> Contents:
        """Units of length and time by which the states are divided."""
        found: Contents = self._result("units")
        return found

    @property
    def verdict(self) -> Verdict:
        """Whether one smooth map serves all contact orders."""
        found: Verdict = self._result("verdict")
        return found

    @property
    def quality(self) -> pd.DataFrame:
        """Checks of recordings and landings: value, unit, limits, and status."""
        return pd.DataFrame(self._result("quality"))

    @property
    def _asks_for_distances(self) -> bool:
        """Whether constraint subspaces are made and their distances measured."""
        return bool(self.config["distances"]["enabled"])

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables, by their names in the folder ``tables`` of the results."""
        found = {}
        for stage in LINE.stages.values():
            if stage.name == "constraint_subspaces" and not self._asks_for_distances:
                continue
            for name, result in stage.results.items():
                if result.path.startswith("tables/"):
                    found[name] = self._result(name)
        return found

    @property
    def figures(self) -> Figures:
        """Functions that draw: ``study.figures.verdict(style="nature")``."""
        return Figures(self)

    @told_call
    def plot(
        self, figure: str = "verdict", *, ax: Any = None, style: str | None = None
    ) -> Any:
        """Draw a figure of the study; `figures` has each as a function.

        Parameters
        ----------
        figure : str
            One of ``study.figures.names``, such as ``"verdict"`` or ``"schedule"``.
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        names = [*self.figures.names, *self.figures._of_packages]
        require_choice("figure", figure, names)
        return getattr(self.figures, figure)(ax=ax, style=style)

    def _content(self, file: str) -> Any:
        """Return the content that the workflow's file of this path would have.

        Parameters
        ----------
        file
            Path in the folder of the study's results, such as ``"verdict.json"``.
        """
        paths = {result.path: name for name, result in LINE.results.items()}
        if file not in paths:
            raise absent("the study's results", file, paths)
        found = self._result(paths[file])
        if hasattr(found, "to_dict") and file.endswith(".json"):
            return found.to_dict()
        return found

    @told_call
    def report(self, file: str | Path, *, drawn: str | Path | None = None) -> Path:
        """Write the study's page, a single self-contained file.

        Parameters
        ----------
        file : path
            Path of the page.
        drawn : path, optional
            Folder with the figures as SVG from `save`; by default they are drawn again.

        Returns
        -------
        Path
            The page.
        """
        from hopdata.report.page import build_report

        place = _place("file", file)
        _ = self.tables  # all that the page takes, before it is begun
        self.progress("page")
        if drawn is None:
            with TemporaryDirectory() as folder:
                self._draw(Path(folder), formats=("svg",))
                inputs = self._report_inputs(Path(folder))
        else:
            inputs = self._report_inputs(Path(drawn))
        page = build_report(inputs)
        with whole_file(place) as draft:
            draft.write_text(page, encoding="utf-8")
        return place

    @told_call
    def methods(self) -> Any:
        """Return the methods paragraph for a paper, with this study's numbers.

        Returns
        -------
        hopdata.report.methods.Methods
            ``text``, and ``bibtex`` of what it cites; ``print`` shows both.
        """
        from hopdata.report.methods import methods
        from hopdata.report.page import study_facts

        inputs = self._report_inputs(None)
        return methods(inputs, study_facts(inputs))

    def _report_inputs(self, drawn: Path | None) -> Any:
        """Return what the page shows, with the figures of a folder if it has any."""
        from hopdata.config.loading import what_is_set
        from hopdata.report.inputs import ReportInputs, describe_recording, read_figures

        captions = (SNAKEFILE.parent / "workflow" / "captions").glob("*.md")
        files: list[Path] = []
        if drawn is not None:
            files = [drawn / f"{name}.svg" for name in self.figures.names.values()]
        distances = None
        notes = []
        # Only a study by the printed methods shows what these are about.
        is_printed = self.config["printed"]
        if is_printed:
            notes += self._result("prediction_notes")
        if self._asks_for_distances:
            distances = self._result("distance_summary")
        if self._asks_for_distances and is_printed:
            notes += self._result("distances_notes")
        notes += self._result("map_notes")
        return ReportInputs(
            study=self.config["study"],
            language=self.config["report"]["language"],
            figures=read_figures(files, captions),
            recordings=[describe_recording(one) for one in self.imported],
            levelled=self.recordings,
            filled=self._result("filled"),
            sections=self.sections.to_dict(),
            units=self.units,
            provenance=self._provenance(),
            floors={name: floor.to_dict() for name, floor in self.floors.items()},
            verdict=self.verdict.to_dict(),
            quality=self._result("quality"),
            touchdowns=self.touchdowns,
            lags=self._result("lags"),
            prediction=self._result("prediction_summary"),
            distances=distances,
            distances_asked=self._asks_for_distances,
            faults=self._result("faults"),
            remarks=self._result("remarks"),
            one_or_own=self._result("one_or_own"),
            simulated=self._is_simulated(),
            settings=what_is_set(self.config),
            notes=notes,
        )

    def _is_simulated(self) -> bool:
        """Return whether recordings have no file, or one that holds their truth."""
        from hopdata.config.consistency import files_of, knows_truth

        files = [file for one in self.config["recordings"] for file in files_of(one)]
        if not files:
            made_here = Path(LINE.results["simulated"].path).parent.name
            sources = [Path(one.source) for one in self.imported]
            return all(source.parent.name == made_here for source in sources)
        if not all(Path(file).exists() for file in files):
            return False
        return knows_truth(self.config)

    def _draw(self, folder: Path, **options: Any) -> None:
        """Draw all figures into a folder."""
        from hopdata.figures.style import save_figure

        for name, full in self.figures.names.items():
            figure = getattr(self.figures, name)()
            save_figure(figure, folder / full, **options)

    @told_call
    def save(self, folder: str | Path) -> Path:
        """Write the results and the figures, as the workflow does: see `hopdata.load`.

        These are ``verdict.json``, ``quality.json``, ``sections.json``, ``units.json``,
        ``pairs.h5``, ``maps``, ``tables``, ``figures``; the recordings, as read in
        ``recordings`` and on a level floor in ``level``; and ``provenance.json`` with
        the configuration and the versions.

        Parameters
        ----------
        folder : path
            Folder to write to; it is made if it does not exist.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        ArgumentError
            If this is the name of a file.
        """
        base = _place("folder", folder)
        is_file = base.is_file() or base.suffix.lower() in SUFFIXES_OF_FILES
        if is_file and not base.is_dir():
            how = f"such as '{base.with_suffix('')}', or write one page with report()"
            raise ArgumentError.at(
                "folder", "the name of a folder", f"'{base}'; name one {how}"
            )
        for path, (name, recording) in self._files().items():
            found = self._result(name)
            if recording:
                found = found[recording]
            if name == "imported":
                truth = self._truths.get(recording)
                hdf5.write_recording(base / path, found, truth=truth)
            else:
                LINE.results[name].write(base / path, found)
        self._draw(base / "figures", **self.config["figures"])
        # Last, so that a folder that has it is complete.
        write_json(base / "provenance.json", self._provenance())
        return base

    def _files(self) -> dict[str, tuple[str, str]]:
        """Return the results by their files: name, and the recording if of each one.

        A simulated recording is kept as it was read.
        """
        method = self.config["touchdowns"]["method"]
        found = {}
        for stage in LINE.stages.values():
            if stage.name == "constraint_subspaces" and not self._asks_for_distances:
                continue
            if stage.name == "simulate":
                continue
            for name, result in stage.results.items():
                if RECORDING not in result.wildcards:
                    found[result.path.format(method=method)] = (name, "")
                    continue
                for one in self._names():
                    found[result.path.format(recording=one)] = (name, one)
        return found

    def _provenance(self) -> Contents:
        from hopdata.provenance import provenance

        digests = {place_of(one): one.source_sha256 for one in self.imported}
        return provenance(self.config, digests, [])


#: Names that end so are meant as files.
SUFFIXES_OF_FILES = frozenset(
    (
        *(".h5", ".hdf5", ".nc", ".mat", ".npz", ".pkl", ".pickle", ".parquet"),
        *(".csv", ".tsv", ".txt", ".json", ".yaml", ".yml", ".xlsx"),
        *(".html", ".md", ".pdf", ".svg", ".png", ".jpg", ".zip"),
    )
)


def _place(key: str, path: str | Path) -> Path:
    if not isinstance(path, str | Path):
        raise ArgumentError.at(key, "a path to write to", f"{path!r}")
    return Path(path)


@dataclass(frozen=True)
class Figures:
    """Functions that draw the figures of a study.

    They accept ``ax=`` (an axes that the figure replaces) and ``style=``. They return
    the figure or, if `ax` is given, the part of a figure that they drew into: see
    `hopdata.figures.style.styled`.
    """

    _study: Study

    @property
    def names(self) -> dict[str, str]:
        """Names of the functions -> names of the figures in the workflow's results."""
        drawings = [*FIGURES["landings"], *FIGURES["maps"]]
        if not self._study._asks_for_distances:
            drawings.remove(OF_DISTANCES)
        return {re.sub(r"^fig\d_\d_", "", name): name for name in drawings}

    @property
    def _of_packages(self) -> list[str]:
        """Names of the figures that installed packages bring (docs/plugins.md)."""
        return sorted(of_packages())

    def __dir__(self) -> list[str]:
        return sorted({*self.names, *self._of_packages, "names"})

    def __repr__(self) -> str:
        names = ", ".join([*self.names, *self._of_packages])
        return f"<figures of study '{self._study.config['study']}': {names}>"

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name in of_packages():
            return self._of_package(name)
        if name.startswith("_") or name not in self.names:
            raise absent("study.figures", name, [*self.names, *self._of_packages])
        full = self.names[name]
        draw = function_of(full)

        # What it shows is computed when it is drawn: looking at a name, as programs do
        # that complete them, must not run a study.
        @wraps(draw.func)
        def drawn(*, ax: Any = None, style: str | None = None) -> Any:
            contents = [self._study._content(file) for file in tables_of(full)]
            return draw(*contents, ax=ax, style=style)

        del drawn.__wrapped__  # its signature is that of `drawn`
        drawn.__name__ = name
        return told_call(drawn)

    def _of_package(self, name: str) -> Callable[..., Any]:
        entry = of_packages()[name]

        from hopdata.figures.style import styled

        @styled
        def drawn() -> Any:
            return drawn_by_package(entry, self._study._content)

        drawn.__name__ = name
        return drawn

    def _repr_html_(self) -> str:
        rows = ""
        for name, full in self.names.items():
            summary = str(function_of(full).func.__doc__).splitlines()[0]
            rows += f"<tr><td><code>{name}</code></td><td>{escape(summary)}</td></tr>"
        return f"<table>{rows}</table>"
