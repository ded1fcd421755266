"""The stages of a study from a file to the verdict: the one place that tells them.

Each is a function that a notebook calls, a rule of the workflow, and a step of
`hopdata.Study`; `hopdata.line` says how its definition is read. Libraries are imported
inside the functions: a job pays for its own stage only, and runs again only if the
function, its settings, or the modules that it imports change.
"""

# ruff: noqa: B008 - `key` as a default marks a setting; `hopdata.line` reads it.
from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hopdata.config import consistency
from hopdata.line import Kind, Line, key, results, saved, source_files

if TYPE_CHECKING:
    import pandas as pd

    from hopdata.landings.floor_surface import FloorModel
    from hopdata.landings.sections.poincare import Sections
    from hopdata.landings.states.pairs import Pairs
    from hopdata.maps.verdict.judge import Verdict
    from hopdata.recording import Recording
    from hopdata.recordings.stored import WithTruth

Options = dict[str, Any]
LINE = Line()

TABLE = Kind(
    write="hopdata.jobs:write_table",
    read="hopdata.jobs:read_table",
    stored="hopdata.jobs:as_stored",
)
JSON = Kind(write="hopdata.jobs:write_json", read="hopdata.jobs:read_json")
RECORDING = Kind(
    write="hopdata.recordings.readers.hdf5:write_recording",
    read="hopdata.recordings.readers.hdf5:read_recording",
)
#: A recording in a file that also holds its truth, which later stages do not see.
RECORDING_WITH_TRUTH = Kind(
    write="hopdata.recordings.stored:write_with_truth",
    read="hopdata.recordings.readers.hdf5:read_recording",
    stored="hopdata.recordings.stored:without_truth",
)
FLOOR = Kind(
    write="hopdata.jobs:write_fields",
    read="hopdata.jobs:read_json",
    restore="hopdata.landings.floor_surface:FloorModel.from_dict",
)
SECTIONS = Kind(
    write="hopdata.jobs:write_fields",
    read="hopdata.jobs:read_json",
    restore="hopdata.landings.sections.poincare:Sections.from_dict",
)
PAIRS = Kind(
    write="hopdata.landings.states.pairs:write_pairs",
    read="hopdata.landings.states.pairs:read_pairs",
)
VERDICT = Kind(
    write="hopdata.jobs:write_fields",
    read="hopdata.jobs:read_json",
    restore="hopdata.maps.verdict.judge:Verdict.from_dict",
)


def number_of(config: Options, recording: str) -> int:
    """Return the number of a recording, by which its random draws differ."""
    names = [entry["name"] for entry in config["recordings"]]
    return names.index(recording)


@results
class Simulated:
    """A simulated recording, with its truth, which later stages do not see."""

    simulated: Recording | WithTruth = saved(
        "simulated/{recording}.h5", RECORDING_WITH_TRUTH
    )


@LINE.stage(per=("recording",), minutes=20, mb_a_mb=0)
def simulate(
    recording: str,
    *,
    simulation: Options = key(consistency.simulation_of),
    motion_capture: Options = key("motion_capture"),
    seed: int = key("seed"),
    number: int = key(number_of),
) -> Simulated:
    """Simulate a scene as motion capture would see it, and keep its truth."""
    from hopdata.synthesis import simulate_recording

    found = simulate_recording(
        simulation, motion_capture, seed=(seed, number), name=recording
    )
    return Simulated(found)


@results
class Imported:
    """A recording in m, z up, with the truth, which later stages do not see."""

    imported: Recording | WithTruth = saved(
        "recordings/{recording}.h5", RECORDING_WITH_TRUTH
    )


@LINE.stage(per=("recording",), minutes=50, mb_a_mb=10)
def import_recording(
    recording: str,
    files: list[str] = source_files(otherwise="simulated"),
    *,
    markers: Options = key("markers"),
    exclude: list[Options] = key("recordings.exclude"),
    options: Options = key("input"),
    quality: Options = key("quality"),
) -> Imported:
    """Read the files of a recording, and refuse what cannot be motion capture."""
    from hopdata.jobs import logger
    from hopdata.recordings import importing
    from hopdata.recordings.plausibility import check_plausible, notes

    found, truth = importing.import_recording(
        files, name=recording, markers=markers, exclude=exclude, **options
    )
    check_plausible(found, **quality)
    for note in notes(found):
        logger.info("%s", note)
    return Imported((found, truth))


@results
class FloorCompensation:
    """A recording on a level floor, with short gaps filled, and the floor's model."""

    level: Recording = saved("level/{recording}.h5", RECORDING)
    floor_model: FloorModel = saved("level/{recording}.json", FLOOR)


@LINE.stage(per=("recording",), minutes=30, mb_a_mb=15)
def floor_compensation(
    imported: Recording,
    *,
    floor: Options = key("floor"),
    feet: list[Options] = key("feet"),
    fills: bool = key(consistency.fills),
    longest_s: float | None = key("filling.longest_s"),
) -> FloorCompensation:
    """Subtract the floor on which the feet rest (Sec. 2.2.1), and fill short gaps."""
    from hopdata.landings.contacts.joined import join_feet
    from hopdata.landings.filling import fill_gaps
    from hopdata.landings.floor import fit_floor, level
    from hopdata.landings.held_frames import without_held_frames

    measured = without_held_frames(imported)
    model = fit_floor(measured, **floor)
    ready = level(measured, model)
    ready = join_feet(ready, feet)
    if fills:
        # `ready` is this function's own copy, unlike `imported`.
        ready = fill_gaps(ready, longest_s=longest_s, overwrite=True)
    return FloorCompensation(ready, model)


@results
class FootContacts:
    """Descents of the body, and the contact instants of each foot."""

    contacts: dict[str, pd.DataFrame] = saved("contacts/{recording}.csv", TABLE)


@LINE.stage(minutes=50, mb_a_mb=10)
def foot_contacts(
    level: dict[str, Recording],
    *,
    options: Options = key(consistency.contact_options),
) -> FootContacts:
    """Find the descents of the body, and when each foot touched (Sec. 2.2.3)."""
    from hopdata.landings.contacts.find import find_study_landings

    tables = find_study_landings([*level.values()], **options)
    return FootContacts(dict(zip(level, tables, strict=True)))


@results
class PoincareSections:
    """The two sections."""

    sections: Sections = saved("sections.json", SECTIONS)


@LINE.stage(minutes=30, mb_a_mb=10, priority=2)
def poincare_sections(
    level: dict[str, Recording],
    contacts: dict[str, pd.DataFrame],
    *,
    options: Options = key("sections", without=("grid_nodes",)),
    states: Options = key("states"),
) -> PoincareSections:
    """Choose the two Poincare sections by the heights of body and feet (Sec. 2.2.2)."""
    from hopdata.landings.sections.select import select_sections
    from hopdata.recording import require_distinct

    recordings = [*level.values()]
    require_distinct(recordings)
    found = select_sections(
        recordings, landings=contacts, states=states, compare=True, **options
    )
    return PoincareSections(found)


@results
class SectionDensities:
    """Densities of heights around the sections, and the frames on each side."""

    section_densities: pd.DataFrame = saved("tables/section_densities.csv", TABLE)
    section_frames: pd.DataFrame = saved("tables/section_frames.csv", TABLE)


@LINE.stage(minutes=30, mb_a_mb=10)
def section_densities(
    level: dict[str, Recording],
    contacts: dict[str, pd.DataFrame],
    sections: Sections,
    *,
    nodes: int = key("sections.grid_nodes"),
) -> SectionDensities:
    """Tabulate the densities of heights that show where the sections lie (Fig. 2.2)."""
    from hopdata.landings.sections import tables

    recordings = [*level.values()]
    densities = tables.section_densities(recordings, sections, contacts, nodes=nodes)
    frames = tables.section_frames(recordings, sections)
    return SectionDensities(densities, frames)


@results
class ModeSchedules:
    """Touchdowns of all recordings with their contact orders, by one method."""

    schedules: pd.DataFrame = saved("schedules/{method}.csv", TABLE)


@LINE.stage(per=("method",), minutes=30, mb_a_mb=10, priority=2)
def mode_schedules(
    method: str,
    level: dict[str, Recording],
    contacts: dict[str, pd.DataFrame],
    sections: Sections,
    *,
    options: Options = key("touchdowns", without=("method",)),
    largest_share: float = key("filling.largest_share"),
    exclude: dict[str, list[Options]] = key("recordings.exclude"),
) -> ModeSchedules:
    """Label each touchdown with the order of its contacts (Sec. 2.2.3, Fig. 2.3)."""
    from hopdata.jobs import stacked
    from hopdata.landings.touchdowns import touchdown_tables

    left_out = [exclude.get(name, []) for name in level]
    tables = touchdown_tables(
        level.values(),
        contacts,
        left_out,
        method=method,
        pre_height_m=sections.pre_height_m,
        post_height_m=sections.post_height_m,
        largest_share=largest_share,
        **options,
    )
    return ModeSchedules(stacked([*tables]))


@results
class HomeFrame:
    """States at both sections; touchdowns, with the reason if one has no state.

    `lags` has the lags of each two feet in the touchdowns used.
    """

    pairs: Pairs = saved("pairs.h5", PAIRS)
    touchdowns: pd.DataFrame = saved("tables/touchdowns.csv", TABLE)
    lags: pd.DataFrame = saved("tables/lags.csv", TABLE)
    example_touchdown: pd.DataFrame = saved("tables/example_touchdown.csv", TABLE)


@LINE.stage(minutes=30, mb_a_mb=10, priority=2)
def home_frame(
    level: dict[str, Recording],
    sections: Sections,
    schedules: pd.DataFrame,
    *,
    home_marker: str | Sequence[str] | None = key("home.marker"),
    ambiguous: str = key("touchdowns.ambiguous"),
    states: Options = key("states"),
    begins_s: dict[str, float | None] = key("recordings.begins_s"),
) -> HomeFrame:
    """Put the states at both sections in their home frames (Sec. 2.2.4)."""
    from hopdata.landings.contact_lags import lags_of_touchdowns
    from hopdata.landings.contacts.velocity_minimum import example_touchdown
    from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless

    recordings = [*level.values()]
    pairs = assemble_pairs(
        recordings,
        schedules,
        pre_height_m=sections.pre_height_m,
        post_height_m=sections.post_height_m,
        home_marker=home_marker,
        ambiguous=ambiguous,
        begins_s=begins_s,
        **states,
    )
    touchdowns = exclude_stateless(schedules, pairs)
    example = example_touchdown(recordings, touchdowns)
    return HomeFrame(pairs, touchdowns, lags_of_touchdowns(touchdowns), example)


@results
class Normalisation:
    """The units of length and time by which the states are divided."""

    units: Options = saved("units.json", JSON)


@LINE.stage(minutes=10, mb_a_mb=40, priority=1)
def normalisation(
    pairs: Pairs,
    *,
    units: Options = key("units"),
) -> Normalisation:
    """Choose units in which positions and velocities weigh the same (Sec. 2.2.4)."""
    from hopdata.maps.units import choose_units

    chosen = choose_units(pairs.x, pairs.y, **units)
    return Normalisation(chosen.to_dict())


@results
class Prediction:
    """Errors of the bootstrapped least-squares and mean predictors."""

    prediction_errors: pd.DataFrame = saved("tables/prediction_errors.csv", TABLE)
    prediction_summary: pd.DataFrame = saved("tables/prediction_summary.csv", TABLE)
    prediction_notes: list[Any] = saved("maps/prediction_notes.json", JSON)


@LINE.stage(minutes=30, mb_a_mb=60, priority=1)
def prediction(
    pairs: Pairs,
    units: Options,
    *,
    options: Options = key("prediction"),
    seed: int = key("seed"),
) -> Prediction:
    """Predict the state after from the state before (Sec. 2.2.4, Fig. 2.4)."""
    from hopdata.maps.prediction import bootstrap_prediction

    length_m = units["length_unit_m"]
    time_s = units["time_unit_s"]
    x, y = pairs.with_units(length_m, time_s).normalised()
    study = bootstrap_prediction(
        x,
        y,
        pairs.schedule,
        pairs.spread_s,
        length_unit_m=length_m,
        time_unit_s=time_s,
        seed=seed,
        **options,
    )
    return Prediction(study.errors, study.summary, study.notes)


@results
class ConstraintSubspaces:
    """Distances between the constraint subspaces of the contact orders."""

    distances: pd.DataFrame = saved("tables/distances.csv", TABLE)
    distance_summary: pd.DataFrame = saved("tables/distance_summary.csv", TABLE)
    distances_notes: list[Any] = saved("maps/distances_notes.json", JSON)


@LINE.stage(minutes=50, mb_a_mb=60, priority=1)
def constraint_subspaces(
    pairs: Pairs,
    units: Options,
    *,
    subspaces: Options = key("subspaces"),
    distances: Options = key("distances", without=("enabled",)),
    seed: int = key("seed"),
) -> ConstraintSubspaces:
    """Compare the constraint subspaces of the contact orders (Sec. 2.3, Fig. 2.5)."""
    from hopdata.maps.subspaces import bootstrap_subspaces, measure_distances

    x, y = pairs.with_units(units["length_unit_m"], units["time_unit_s"]).normalised()
    found = bootstrap_subspaces(x, y, pairs.schedule, seed=seed, **subspaces)
    apart = measure_distances(
        found.bases, found.shape, seed=seed, streams=found.streams, **distances
    )
    notes = [*found.notes, *apart.notes]
    return ConstraintSubspaces(apart.distances, apart.summary, notes)


@results
class LandingMaps:
    """Linear maps of each contact order, without the effects of noise and curvature."""

    map_estimates: pd.DataFrame = saved("tables/map_estimates.csv", TABLE)
    maps: Options = saved("maps/map_estimates.json", JSON)
    map_notes: list[Any] = saved("maps/map_estimates_notes.json", JSON)
    one_or_own: pd.DataFrame = saved("tables/one_or_own.csv", TABLE)


@LINE.stage(minutes=30, mb_a_mb=60)
def landing_maps(pairs: Pairs, units: Options) -> LandingMaps:
    """Fit the maps through the landing, rid of noise and curvature."""
    from hopdata.maps.corrected.estimates import estimate_maps
    from hopdata.maps.one_or_own import one_or_own

    instants: Any = pairs.instants  # measured pairs have them
    found = estimate_maps(pairs.x, pairs.y, instants, time_unit_s=units["time_unit_s"])
    foretold = one_or_own(
        pairs.x,
        pairs.y,
        pairs.schedule,
        recording=pairs.recording,
        touchdown=pairs.touchdown,
    )
    return LandingMaps(found.table(), found.to_dict(), found.notes, foretold)


@results
class Judgement:
    """Whether one smooth map serves all contact orders."""

    verdict: Verdict = saved("verdict.json", VERDICT)
    verdict_orders: pd.DataFrame = saved("tables/verdict_orders.csv", TABLE)


@LINE.stage(minutes=60, mb_a_mb=200, priority=2)
def verdict(
    pairs: Pairs,
    touchdowns: pd.DataFrame,
    *,
    options: Options = key("verdict"),
    blocks: dict[str, str | None] = key("recordings.block"),
    seed: int = key("seed"),
) -> Judgement:
    """Judge whether the map is C1: effect size, interval and bound."""
    from hopdata.feet import foot_names
    from hopdata.landings.checks import blurred
    from hopdata.maps.verdict import far_off, judge
    from hopdata.maps.verdict.orders import orders_table

    instants: Any = pairs.instants  # measured pairs have them
    found = judge(
        pairs.x,
        pairs.y,
        instants,
        instants_se=pairs.instants_se,
        feet=pairs.feet,
        feet_se=pairs.feet_se,
        time=pairs.time_s,
        blocks=pairs.blocks(blocks),
        blurred=blurred(touchdowns),
        foot_names=foot_names(touchdowns.columns),
        seed=seed,
        **options,
    )
    by_name = touchdowns.set_index(["recording", "touchdown"])
    names = [*zip(pairs.recording, pairs.touchdown, strict=True)]
    t_pre_s = by_name["t_pre_s"].reindex(names).to_numpy(float)
    found = far_off.with_names(found, pairs.recording, pairs.touchdown, t_pre_s)
    return Judgement(found, orders_table(found.orders))


@results
class Inspection:
    """Faults of the recordings as they were read."""

    markers: pd.DataFrame = saved("tables/markers.csv", TABLE)
    gap_times: pd.DataFrame = saved("tables/gap_times.csv", TABLE)
    faults: pd.DataFrame = saved("tables/faults.csv", TABLE)
    remarks: pd.DataFrame = saved("tables/remarks.csv", TABLE)


@LINE.stage(minutes=20, mb_a_mb=10)
def inspection(
    imported: dict[str, Recording],
    *,
    methods: Options = key(consistency.effect_methods),
) -> Inspection:
    """Look for faults in the recordings, beside the search for contacts."""
    import pandas as pd

    from hopdata.landings.effects import Methods, study_effects
    from hopdata.recordings.quality.inspection import recording_tables

    tables = recording_tables(imported.values())
    told = study_effects([*imported.values()], Methods(**methods))
    in_numbers = [
        {"recording": name, "remark": str(effect)}
        for name, effects in zip(imported, told, strict=True)
        for effect in effects
    ]
    if in_numbers:
        both = [tables["remarks"], pd.DataFrame(in_numbers)]
        tables["remarks"] = pd.concat(both, ignore_index=True)
    return Inspection(
        markers=tables["markers"],
        gap_times=tables["gaps"],
        faults=tables["faults"],
        remarks=tables["remarks"],
    )


@results
class Quality:
    """Checks of recordings and landings, and the tables behind them."""

    quality: list[Options] = saved("quality.json", JSON)
    section_stability: pd.DataFrame = saved("tables/section_stability.csv", TABLE)
    drift: pd.DataFrame = saved("tables/drift.csv", TABLE)
    filled: pd.DataFrame = saved("tables/filled.csv", TABLE)


@LINE.stage(minutes=20, mb_a_mb=10)
def quality(  # noqa: PLR0913 - all that is checked, each by its name
    level: dict[str, Recording],
    floor_model: dict[str, FloorModel],
    contacts: dict[str, pd.DataFrame],
    sections: Sections,
    touchdowns: pd.DataFrame,
    markers: pd.DataFrame,
    faults: pd.DataFrame,
    *,
    section_options: Options = key("sections", without=("grid_nodes",)),
    expected_noise_m: float = key(consistency.expected_noise_m),
) -> Quality:
    """Check whether the recordings and their landings can be trusted."""
    from hopdata.landings.checks import check_study
    from hopdata.landings.contacts.remarks import contact_remarks
    from hopdata.landings.filling import filled_table
    from hopdata.landings.stability import drift_table, section_stability

    recordings = [*level.values()]
    stability = section_stability(recordings, sections, section_options, contacts)
    drift = drift_table(recordings, touchdowns)
    checks = check_study(
        touchdowns=touchdowns,
        markers=markers,
        faults=faults,
        stability=stability,
        drift=drift,
        floors={name: model.to_dict() for name, model in floor_model.items()},
        expected_noise_m=expected_noise_m,
        other_feet=section_options["frames"] == "landings",
        contact_remarks=contact_remarks(recordings, [contacts[name] for name in level]),
        starts_s={name: float(one.time[0]) for name, one in level.items()},
    )
    passed_or_not = [check.to_dict() for check in checks]
    return Quality(passed_or_not, stability, drift, filled_table(recordings))
