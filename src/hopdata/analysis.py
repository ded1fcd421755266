"""A study in one process: the stages of the workflow for a notebook or a program.

Stages exchange their data as the workflow's files would hold them, rounded to the same
digits, so the results equal the workflow's byte for byte.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from hopdata.arrays import Shown, one_blas_thread, pd
from hopdata.config import consistency
from hopdata.config.loading import check_keys, load_config, read_yaml
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    absent,
    told_call,
)
from hopdata.figures.catalogue import FIGURES, OF_DISTANCES, function_of, tables_of
from hopdata.jobs import as_stored, stacked, whole_file, write_json, write_table
from hopdata.recording import Recording, Truth, marker_names, numbers, require_distinct
from hopdata.recordings.readers import hdf5

if TYPE_CHECKING:
    from hopdata.landings.sections.select import Sections
    from hopdata.landings.states.pairs import Pairs
    from hopdata.maps.verdict.judge import Verdict

Contents = dict[str, Any]
#: The workflow: in a checkout this path is a link to the Snakefile, in a wheel it is
#: the file.
SNAKEFILE = Path(__file__).with_name("_workflow").joinpath("Snakefile").resolve()
#: Differences that `plan` lists, beyond what smooth terms may leave, as shares of the
#: map.
BEYOND = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
Progress = Callable[[str], object]


@told_call
def read(
    file: str | Path | Sequence[str | Path],
    *,
    feet: Sequence[str] = (),
    body: Sequence[str] = (),
    name: str | None = None,
    **options: Any,
) -> Recording:
    """Read a recording of any known format.

    Parameters
    ----------
    file : path or sequence of path
        A file, or several in chronological order.
    feet, body : sequence of str
        Names of the markers to keep, by role.
    name : str, optional
        Name of the recording; by default the name of the file.
    options
        ``unit``, ``vertical_axis``, ``rate_hz``: see
        `hopdata.recordings.importing.import_recording`. The axis is guessed if it is
        not given.

    Returns
    -------
    Recording
        Positions in m, z up.

    Raises
    ------
    RecordingError
        If the file cannot be read or lacks a marker.

    Examples
    --------
    >>> feet, body = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]
    >>> read("data/sample/hopper.h5", feet=feet, body=body)
    <Recording 'hopper': 6 markers, 106,334 frames at 100 Hz, 100 % seen>
    """
    from hopdata.recordings.importing import import_recording

    if not file or not isinstance(file, str | Path | Sequence):
        raise ArgumentError.at("file", "a path or a list of paths", f"{file!r}")
    check_keys("read", {"input": options})
    first = Path(file if isinstance(file, str | Path) else file[0])
    markers = {
        "feet": [*marker_names("feet", feet)],
        "body": [*marker_names("body", body)],
    }
    options = {"vertical_axis": _guessed(first, markers, options)[0], **options}
    return import_recording(file, name=name or first.stem, markers=markers, **options)[
        0
    ]


def _guessed(file: Path, markers: Contents, options: Contents) -> tuple[str, list[str]]:
    """Return the guesses of ``hopdata init``: the vertical axis of a file, and its other feet."""
    from hopdata.recordings.quality.orientation import guess_unit_and_up
    from hopdata.recordings.quality.roles import feet_between
    from hopdata.recordings.raw import METRES_PER_UNIT, rotate_up
    from hopdata.recordings.readers.formats import read_raw

    limits = {k: v for k, v in options.items() if k in ("rate_hz", "most_unpacked_mb")}
    raw = read_raw(file, **limits)
    if not all(markers.values()):
        given = " and ".join(f"{key}={names}" for key, names in markers.items())
        wanted = f"names of markers of {file} ({', '.join(raw.markers)})"
        raise RecordingError.at("feet, body", wanted, given)
    unit, up = options.get("unit", "auto"), options.get("vertical_axis")
    known = None if unit == "auto" else unit
    found, axis = guess_unit_and_up(raw, unit=known, up=up, markers=markers)
    feet = [name for name in markers["feet"] if name in raw.markers]
    positions = rotate_up(
        raw.positions * METRES_PER_UNIT.get(found.value, 1.0), axis.value
    )
    return axis.value, feet_between(raw.markers, positions, raw.rate_hz, feet)


@told_call
def study(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Sequence[str] = (),
    body: Sequence[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Prepare a study for use step by step; arguments and errors are those of `analyse`."""
    from hopdata.recordings.plausibility import check_plausible

    if not callable(progress):
        raise ArgumentError.at("progress", "a function such as print", f"{progress!r}")
    given: tuple[Recording, ...] = ()
    files: list[str | Path] = []
    content: Mapping[str, Any]
    roles = {
        "feet": [*marker_names("feet", feet)],
        "body": [*marker_names("body", body)],
    }
    several = [source] if isinstance(source, Recording) else source
    if isinstance(several, list | tuple) and {*map(type, several)} == {Recording}:
        if feet or body:
            raise RecordingError(
                "feet, body: expected none, since the recording has its roles"
            )
        given = tuple(several)
        roles, *rest = (
            {"feet": [*r.names("foot")], "body": [*r.names("body")]} for r in given
        )
        if rest != [roles] * len(rest):
            raise RecordingError.at(
                "source", "the same markers in the same order", [roles, *rest]
            )
        entries = [{"name": one.name, "file": one.source or one.name} for one in given]
        content = {"study": given[0].name, "recordings": entries}
    elif isinstance(source, Mapping):
        content = source
    elif not isinstance(source, str | Path):
        wanted = "a file, a configuration or recordings (by hd.read or hd.Recording.from_arrays)"
        raise RecordingError.at("source", wanted, type(source).__name__)
    elif Path(source).suffix.lower() in {".yaml", ".yml"}:
        content, files = read_yaml(source), [source]
    else:
        entry = {"name": Path(source).stem, "file": str(source)}
        content = {"study": entry["name"], "recordings": [entry]}
        options, sections = (keys.get(key) or {} for key in ("input", "sections"))
        check_keys("configuration", keys)
        up, others = _guessed(Path(source), roles, options)
        keys["input"] = {**options, "vertical_axis": up}
        progress(f"reading {source} with {up} up")
        if others and "frames" not in sections:
            keys["sections"] = {**sections, "frames": "landings"}
            progress(
                f"sections.frames: landings, since other feet land too ({', '.join(others)})"
            )
    keys = {"markers": roles, **keys} if any(roles.values()) else keys
    for key, one in keys.items():  # other keys in the same section of the source stay
        if isinstance(one, Mapping) and isinstance(beside := content.get(key), Mapping):
            keys[key] = {**beside, **one}
    config = load_config({**content, **keys}, files=files, check_files=not given)
    for recording in given:
        check_plausible(recording, **config["quality"])
    return Study(config, given, progress)


@told_call
def analyse(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Sequence[str] = (),
    body: Sequence[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Analyse recordings, or the study of a configuration, as the workflow does.

    Parameters
    ----------
    source : path, mapping, Recording or list of Recording
        A configuration (YAML file or its content), a motion-capture file, or
        recordings.
    feet, body : sequence of str
        Marker names by role, for a motion-capture file.
    progress : callable
        A function such as `print`, called with the name of each stage as it begins.
    keys
        Sections of the configuration, such as ``touchdowns={"method": "kink"}``. Other
        keys in the same section of `source` stay as they are. For a motion-capture file
        the vertical axis is guessed from free fall unless ``input["vertical_axis"]`` is
        given.

    Returns
    -------
    Study
        The study, whose verdict is computed; other stages are computed on request.

    Raises
    ------
    ConfigError
        If the configuration is wrong; the message has one line per mistake.
    RecordingError, AnalysisError
        If a recording cannot be read or analysed.
    """
    found = study(source, feet=feet, body=body, progress=progress, **keys)
    _ = found.verdict
    return found


@told_call
def synthesize(
    scene: str = "hopper", *, name: str = "simulated", seed: int = 0, **keys: Any
) -> tuple[Recording, Truth]:
    """Simulate a motion-capture recording of a scene, and return it with its truth.

    Parameters
    ----------
    scene : str
        A scene of `hopdata.scenes`, such as ``"hopper"`` or ``"quadruped"``.
    name : str
        Name of the recording.
    seed : int
        Seed of kicks and noise.
    keys
        Sections of the configuration, such as ``simulation={"hops": 200}`` and
        ``motion_capture={"rate_hz": 250}``.

    Raises
    ------
    ConfigError
        If the scene does not exist or a value is out of range.

    Examples
    --------
    >>> recording, truth = synthesize("quadruped", simulation={"hops": 5}, seed=1)
    >>> truth.contact_times.shape  # landings, feet
    (5, 4)
    """
    options = keys.get("simulation") or {}
    keys["simulation"] = (
        {"scene": scene, **options} if isinstance(options, Mapping) else options
    )
    # The simulation makes all markers, whatever names are given here.
    markers = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
    content = {
        "study": name,
        "recordings": [{"name": name}],
        "markers": markers,
        "seed": seed,
    }
    return _simulated(load_config({**content, **keys}), 0)


def _simulated(config: Contents, number: int) -> tuple[Recording, Truth]:
    from hopdata.synthesis import simulate_recording

    name, seed = config["recordings"][number]["name"], (config["seed"], number)
    scene, cameras = consistency.simulation_of(config, name), config["motion_capture"]
    return simulate_recording(scene, cameras, seed=seed, name=name)


def planned(allowed: float) -> list[float]:
    """Return the differences to plan for, all larger than the `allowed` effect of smooth terms."""
    return [round(allowed + more, 2) for more in BEYOND]


@told_call
def plan(
    pilot: Study | Verdict, differences: Sequence[float] | None = None
) -> pd.DataFrame:
    """Return how many landings a study needs to show a difference between the maps.

    Parameters
    ----------
    pilot : Study or Verdict
        A study of a short or a simulated recording.
    differences : sequence of float, optional
        Sizes of the difference, as shares of the map. They must exceed what smooth
        terms may leave (0.1 or more); by default they exceed it by 0.03 to 0.4.

    Returns
    -------
    DataFrame
        ``difference`` (share of the map) and ``landings`` that show it with the
        verdict's power.

    Raises
    ------
    AnalysisError
        If the pilot has no answer, or if no number of landings shows one of the
        differences.
    """
    from hopdata.maps.verdict.effect import landings_needed
    from hopdata.maps.verdict.judge import Verdict

    verdict = getattr(pilot, "verdict", pilot)
    if not isinstance(verdict, Verdict):
        found = f"{pilot!r}; a verdict.json goes through the command hopdata plan"
        raise ArgumentError.at("pilot", "a study or its verdict", found)
    if verdict.effect is None:
        raise AnalysisError(
            f"pilot: expected an answer to plan from: {verdict.sentence}"
        )
    known = (
        verdict.n_landings,
        verdict.effect.detectable,
        allowed := verdict.effect.allowed,
    )
    asked = planned(allowed) if differences is None else differences
    sizes = numbers("differences", asked).ravel()
    needed = [landings_needed(*known, size, verdict.n_feet) for size in sizes]
    return pd.DataFrame({"difference": sizes, "landings": needed})


@dataclass(frozen=True, repr=False)
class Study(Shown):
    """A study whose stages are computed once, when they are first used.

    Attributes
    ----------
    config
        The whole configuration, as `hopdata.config.load_config` returns it.
    given
        Plausible recordings to use instead of the configuration's files.
    progress
        Function that is called with the name of each stage as it begins.
    """

    config: Contents
    given: tuple[Recording, ...] = ()
    progress: Progress = field(default=lambda _stage: None)

    def told(self) -> str:
        """Return the name and the answer."""
        known = self.__dict__.get("verdict")
        return (
            f"'{self.config['study']}': {known.sentence if known else 'no verdict yet'}"
        )

    def _repr_html_(self) -> str:
        """Return the answer and its figure as HTML, for the output of a notebook's cell."""
        if "verdict" not in self.__dict__ or self.verdict.effect is None:
            return f"<p>{escape(repr(self))}</p>"
        told = escape(self.verdict.sentence)
        return f'<div aria-label="{told}">{self.figures.verdict()._repr_svg_()}</div>'

    # The stages as methods, for use step by step; the study keeps the result of each.

    def read(self) -> list[Recording]:
        """Read the recordings and check that they are plausible; return `imported`."""
        return self.imported

    def level(self) -> list[Recording]:
        """Subtract the floor and fill short gaps; return `recordings`."""
        return self.recordings

    def find_contacts(self) -> dict[str, pd.DataFrame]:
        """Find when each foot touched; return `contacts`."""
        return self.contacts

    def choose_sections(self) -> Sections:
        """Choose the two Poincare sections; return `sections`."""
        return self.sections

    def find_touchdowns(self) -> pd.DataFrame:
        """Tabulate the touchdowns with their contact orders; return `touchdowns`."""
        return self.touchdowns

    @told_call
    def judge(self) -> Verdict:
        """Compare the maps of the orders; return `verdict`."""
        return self.verdict

    @cached_property
    def imported(self) -> list[Recording]:
        """Recordings as read: m, z up, with roles."""
        from hopdata.recordings.plausibility import check_plausible

        self.progress("reading")
        if self.given:
            return [*self.given]
        entries = enumerate(self.config["recordings"])
        found = [self._import(number, entry) for number, entry in entries]
        for recording in found:
            check_plausible(recording, **self.config["quality"])
        return found

    def _import(self, number: int, entry: Contents) -> Recording:
        from hopdata.recordings.importing import import_recording

        config, name = self.config, entry["name"]
        with TemporaryDirectory() as folder:
            files: list[str] = consistency.files_of(entry)
            if simulated := not files:
                files = [f"{folder}/{name}.h5"]
                hdf5.write_recording(files[0], *_simulated(config, number))
            options = {"exclude": entry["exclude"], **config["input"]}
            recording, _ = import_recording(
                files, name=name, markers=config["markers"], **options
            )
        return (
            replace(recording, source=f"simulated/{name}.h5")
            if simulated
            else recording
        )

    @cached_property
    def floors(self) -> dict[str, Any]:
        """Floor model of each recording."""
        from hopdata.landings.floor import fit_floor

        return {
            one.name: fit_floor(one, **self.config["floor"]) for one in self.imported
        }

    @cached_property
    def recordings(self) -> list[Recording]:
        """Recordings on a level floor, with short gaps filled where possible."""
        from hopdata.landings.contacts.joined import join_feet
        from hopdata.landings.filling import fill_gaps
        from hopdata.landings.floor import level

        found = []
        for recording in self.imported:
            self.progress(f"levelling {recording.name}")
            ready = level(recording, self.floors[recording.name])
            ready = join_feet(ready, self.config["feet"])
            if consistency.fills(self.config):
                ready = fill_gaps(ready, longest_s=self.config["filling"]["longest_s"])
            found.append(ready)
        require_distinct(found)
        return found

    @cached_property
    def contacts(self) -> dict[str, pd.DataFrame]:
        """Table per recording of the body's descents and the contact instants of each foot.

        They are found by ``touchdowns.method``, each in the whole descent of the body.
        The printed methods search again between the sections, once these are known
        (`touchdowns`).
        """
        from hopdata.landings.contacts.find import find_landings

        options, found = consistency.contact_options(self.config), {}
        for recording in self.recordings:
            self.progress(f"contacts of {recording.name}")
            found[recording.name] = as_stored(find_landings(recording, **options))
        return found

    @cached_property
    def sections(self) -> Sections:
        """The two Poincare sections."""
        from hopdata.landings.sections.select import select_sections

        contacts = self.contacts
        self.progress("sections")
        options = self._section_options
        return select_sections(
            self.recordings, landings=contacts, compare=True, **options
        )

    @property
    def _section_options(self) -> Contents:
        return {k: v for k, v in self.config["sections"].items() if k != "grid_nodes"}

    @property
    def _heights(self) -> Contents:
        return {
            name: getattr(self.sections, name)
            for name in ("pre_height_m", "post_height_m")
        }

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """Touchdowns, including those that lack a state at one of the sections."""
        from hopdata.landings.touchdowns import touchdown_tables

        config, heights = self.config, self._heights
        self.progress("touchdowns")
        exclude = [entry["exclude"] for entry in config["recordings"]]
        share = {"largest_share": config["filling"]["largest_share"]}
        how = {**heights, **config["touchdowns"], **share}
        found = touchdown_tables(self.recordings, self.contacts, exclude, **how)
        return stacked([as_stored(one) for one in found])

    @cached_property
    def _landings(self) -> tuple[pd.DataFrame, Pairs, Contents]:
        """Touchdowns, pairs and units; touchdowns without a state are marked as excluded."""
        from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
        from hopdata.maps.units import choose_units

        config, table = self.config, self.candidates
        self.progress("states at the sections")
        options = {"ambiguous": config["touchdowns"]["ambiguous"], **config["states"]}
        options |= {"home_marker": config["home"]["marker"], **self._heights}
        pairs = assemble_pairs(self.recordings, table, **options)
        units = choose_units(pairs.x, pairs.y, **config["units"])
        pairs = pairs.with_units(units.length_unit_m, units.time_unit_s)
        return as_stored(exclude_stateless(table, pairs)), pairs, units.to_dict()

    @property
    def touchdowns(self) -> pd.DataFrame:
        """Table with one row per touchdown; excluded ones have a reason."""
        return self._landings[0]

    @property
    def pairs(self) -> Pairs:
        """Pairs of states at the two sections in the home frame, with the contact instants."""
        return self._landings[1]

    @property
    def units(self) -> Contents:
        """Units of length and time by which the states are divided."""
        return self._landings[2]

    @cached_property
    def verdict(self) -> Verdict:
        """Whether one smooth map serves all contact orders."""
        from hopdata.landings.checks import blurred
        from hopdata.maps.verdict import judge

        pairs, asked = (
            self.pairs,
            {"seed": self.config["seed"], **self.config["verdict"]},
        )
        self.progress("verdict")
        states: Any = pairs.x, pairs.y, pairs.instants
        asked["instants_se"] = pairs.instants_se
        return judge(*states, blurred=blurred(self.touchdowns), **asked)

    @cached_property
    @one_blas_thread()
    def _of_maps(self) -> tuple[Contents, list[Any]]:
        from hopdata.maps.corrected.estimates import estimate_maps
        from hopdata.maps.prediction import bootstrap_prediction
        from hopdata.maps.subspaces import bootstrap_subspaces, measure_distances

        config, pairs = self.config, self.pairs
        seed: Contents = {"seed": config["seed"]}
        units: Contents = {"time_unit_s": pairs.time_unit_s}
        x, y = pairs.normalised()
        instants: Any = pairs.instants
        how: Any = {
            "length_unit_m": pairs.length_unit_m,
            **units,
            **seed,
            **config["prediction"],
        }
        self.progress("linear maps")
        errors = bootstrap_prediction(x, y, pairs.schedule, pairs.spread_s, **how)
        estimates = estimate_maps(pairs.x, pairs.y, instants, **units)
        tables = {
            "prediction_errors": errors.errors,
            "prediction_summary": errors.summary,
            "map_estimates": estimates.table(),
        }
        if not self.asks_for_distances:
            return tables, [*errors.notes, *estimates.notes]
        self.progress("constraint subspaces")
        options = {
            key: value for key, value in config["distances"].items() if key != "enabled"
        }
        spaces = bootstrap_subspaces(
            x, y, pairs.schedule, **seed, **config["subspaces"]
        )
        options |= {"streams": spaces.streams, **seed}
        apart = measure_distances(spaces.bases, spaces.shape, **options)
        tables |= {"distances": apart.distances, "distance_summary": apart.summary}
        return tables, [*errors.notes, *spaces.notes, *apart.notes, *estimates.notes]

    @property
    def asks_for_distances(self) -> bool:
        """Whether constraint subspaces are made and their distances measured."""
        return bool(self.config["distances"]["enabled"])

    @cached_property
    def _of_landings(self) -> Contents:
        from hopdata.landings import stability
        from hopdata.landings.contacts.velocity_minimum import example_touchdown
        from hopdata.landings.sections.select import section_densities, section_frames
        from hopdata.recordings.quality.inspection import recording_tables

        recordings, sections, touchdowns = (
            self.recordings,
            self.sections,
            self.touchdowns,
        )
        self.progress("quality")
        inspected = recording_tables(self.imported)
        return {
            "gap_times": inspected.pop("gaps"),
            **inspected,
            "section_densities": section_densities(
                recordings,
                sections,
                self.contacts,
                nodes=self.config["sections"]["grid_nodes"],
            ),
            "section_frames": section_frames(recordings, sections),
            "example_touchdown": example_touchdown(recordings, touchdowns),
            "section_stability": stability.section_stability(
                recordings, sections, self._section_options, self.contacts
            ),
            "drift": stability.drift_table(recordings, touchdowns),
        }

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables, by their names in the folder ``tables`` of the workflow's results."""
        found = ("touchdowns", *self._of_landings, *self._of_maps[0])
        return {name: self._content(name) for name in found}

    @property
    def quality(self) -> pd.DataFrame:
        """Checks of recordings and landings: value, unit, limits of good and poor, and status."""
        return pd.DataFrame(self._checks)

    @cached_property
    def _checks(self) -> list[Contents]:
        from hopdata.landings.checks import check_study

        config, found = self.config, self._of_landings
        checks = check_study(
            **{
                name: self._content(name)
                for name in ("touchdowns", "markers", "faults")
            },
            stability=found["section_stability"],
            drift=found["drift"],
            floors={name: floor.to_dict() for name, floor in self.floors.items()},
            expected_noise_m=consistency.expected_noise_m(config),
            other_feet=config["sections"]["frames"] == "landings",
        )
        return [check.to_dict() for check in checks]

    @property
    def figures(self) -> Figures:
        """Functions that draw the figures, such as ``study.figures.verdict(style="nature")``."""
        return Figures(self)

    def _content(self, file: str) -> Any:
        """Return the content that the workflow's file of this path would have."""
        name = Path(file).stem
        if name in ("touchdowns", "units"):  # these need no later stage
            return getattr(self, name)
        if name in ("verdict", "sections"):
            return getattr(self, name).to_dict()
        if name not in self._stored:
            found = (
                self._of_landings
            )  # looked up first, so that models are fitted only if needed
            self._stored[name] = as_stored(
                found[name] if name in found else self._of_maps[0][name]
            )
        return self._stored[name]

    @cached_property
    def _stored(self) -> dict[str, pd.DataFrame]:
        """Tables that have been used so far, rounded as in their files."""
        return {}

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
        from hopdata.figures.style import save_figure
        from hopdata.landings.filling import filled_table
        from hopdata.provenance import provenance
        from hopdata.report.inputs import ReportInputs, describe_recording, read_figures
        from hopdata.report.page import build_report

        place = _place("file", file)
        tables, names = self.tables, self.figures.names
        self.progress("page")
        captions = (SNAKEFILE.parent / "workflow" / "captions").glob("*.md")
        with TemporaryDirectory() as folder:
            for name, full in () if drawn else names.items():
                save_figure(
                    getattr(self.figures, name)(), Path(folder, full), formats=("svg",)
                )
            files = [Path(drawn or folder, f"{full}.svg") for full in names.values()]
            figures = read_figures(files, captions)
        digests = {one.place: one.source_sha256 for one in self.imported}
        page = build_report(
            ReportInputs(
                study=self.config["study"],
                language=self.config["report"]["language"],
                figures=figures,
                recordings=[describe_recording(one) for one in self.imported],
                levelled=self.recordings,
                filled=filled_table(self.recordings),
                sections=self.sections.to_dict(),
                units=self.units,
                provenance=provenance(self.config, digests, []),
                floors={name: floor.to_dict() for name, floor in self.floors.items()},
                verdict=self.verdict.to_dict(),
                quality=self._checks,
                touchdowns=self.touchdowns,
                prediction=tables["prediction_summary"],
                distances=tables.get("distance_summary"),
                distances_asked=self.asks_for_distances,
                faults=tables["faults"],
                remarks=tables["remarks"],
                notes=self._of_maps[1],
            )
        )
        with whole_file(place) as draft:
            draft.write_text(page, encoding="utf-8")
        return place

    @told_call
    def save(self, folder: str | Path) -> Path:
        """Write ``verdict.json``, ``quality.json`` and the folders ``tables`` and ``figures``.

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
        from hopdata.figures.style import save_figure

        base = _place("folder", folder)
        is_file = base.is_file() or base.suffix.lower() in SUFFIXES_OF_FILES
        if is_file and not base.is_dir():
            how = f"such as '{base.with_suffix('')}', or write one page with report()"
            raise ArgumentError.at(
                "folder", "the name of a folder", f"'{base}'; name one {how}"
            )
        write_json(base / "verdict.json", self.verdict.to_dict())
        write_json(base / "quality.json", self._checks)
        for name, table in self.tables.items():
            write_table(base / "tables" / f"{name}.csv", table)
        for name, full in self.figures.names.items():
            place = base / "figures" / full
            save_figure(getattr(self.figures, name)(), place, **self.config["figures"])
        return base


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

    of: Study

    @property
    def names(self) -> dict[str, str]:
        """Names of the functions -> names of the figures in the workflow's results."""
        drawings = [*FIGURES["landings"], *FIGURES["maps"]]
        if not self.of.asks_for_distances:
            drawings.remove(OF_DISTANCES)
        return {re.sub(r"^fig\d_\d_", "", name): name for name in drawings}

    def __dir__(self) -> list[str]:
        return sorted(self.names)

    def __repr__(self) -> str:
        return (
            f"<figures of study '{self.of.config['study']}': {', '.join(self.names)}>"
        )

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_") or name not in self.names:
            raise absent("study.figures", name, self.names)
        full = self.names[name]
        return partial(function_of(full), *map(self.of._content, tables_of(full)))
