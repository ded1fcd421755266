"""``hopdata check``: check a configuration and all its recordings."""

from __future__ import annotations

import argparse
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, one_blas_thread
from hopdata.commands import answers, terminal
from hopdata.commands.remarks import Remark, told_together
from hopdata.errors import AnalysisError, RecordingError, counted
from hopdata.inspecting import listing
from hopdata.messages import Message, without_exponent
from hopdata.recordings.external import (
    ForceSignal,
    read_contact_times,
    read_force_signals,
)

if TYPE_CHECKING:
    from hopdata.commands.forecast import Forecast
    from hopdata.recording import Recording
    from hopdata.recordings.quality.inspection import Inspection

# Recordings of a study that are summarised in full; of more, only the first.
MOST_IN_FULL = 5

# Stands in the name of a scene of one's own, between its module and its class.
MODULE_IS = ":"


@one_blas_thread()  # more threads cost more than they gain on small matrices
def check(options: argparse.Namespace) -> int:
    """Check a configuration, read all its recordings, forecast its longest study."""
    from hopdata.commands.run import bring_bundled
    from hopdata.recording import require_distinct

    bring_bundled(Path(options.config))
    configs = _configs(options.config)
    first = configs[0]
    longest: tuple[dict[str, Any], list[Recording]] = (first, [])
    group = ""
    if len(configs) > 1:
        group = f", the first of {len(configs)} of a group"
    print(f"study {first['study']}{group}")
    answers.give(study=first["study"], studies=len(configs), recordings=[])
    mistakes: list[str] = []
    found: list[Remark] = []
    of_first_study: list[Recording] = []
    for config in configs:
        of_study, wrong = _read_study(options.config, config, is_first=config is first)
        mistakes += wrong
        found += _remarks(of_study, config)
        if config is first:
            of_first_study = of_study
            found += _left_by_config(of_study, config)
        if _n_frames(of_study) > _n_frames(longest[1]):
            longest = (config, of_study)
    remarks = [*told_together(found), *_few_subjects(options.config)]
    answers.give(notes=remarks)
    for remark in remarks:
        terminal.note(remark)
    if mistakes:
        raise RecordingError(*mistakes)
    require_distinct(of_first_study)
    config, recordings = longest
    if len(configs) > 1:
        print(f"study {config['study']}, the longest of {len(configs)} of a group")
    answers.give(forecast_of=config["study"])
    print(_conclusion(options.config, config, recordings, remarks, len(configs)))
    return terminal.OK


def _read_study(
    file: str, config: dict[str, Any], *, is_first: bool
) -> tuple[list[Recording], list[str]]:
    """Read and print the recordings of a study; return them, and what is wrong."""
    from hopdata.config.consistency import files_of

    recordings: list[Recording] = []
    mistakes = []
    for entry in config["recordings"]:
        if not files_of(entry):
            print("\n".join(_simulated(file, config, entry)))
            if not simulated_file(config, entry).is_file():
                continue
        try:
            recording, lines = _read(config, entry)
        except RecordingError as error:
            mistakes.append(_with_line(error, file))
            continue
        if is_first:
            is_long = not recordings or _are_few(config)
            summary = _summary(recording, config) if is_long else f"{recording}"
            print("\n".join([summary, *lines]))
        else:
            print(f"study {config['study']}: {recording}")
        answers.give_also("recordings", **_fields_of(recording, config))
        recordings.append(recording)
    return recordings, mistakes


def _are_few(config: Mapping[str, Any]) -> bool:
    return len(config["recordings"]) <= MOST_IN_FULL


def _n_frames(recordings: Sequence[Recording]) -> int:
    return sum(len(recording.time) for recording in recordings)


def _configs(file: str) -> list[dict[str, Any]]:
    """Return the configuration of a study, or of each study of a group."""
    from hopdata.config.loading import load_config, read_yaml
    from hopdata.samples import read_group

    content = read_yaml(file)
    studies: list[Any] = [file]
    if isinstance(content, Mapping) and "samples" in content:
        studies = [member["config"] for member in read_group(file)["members"].values()]
    return [load_config(study, files=[file]) for study in studies]


def simulated_file(config: Mapping[str, Any], entry: Mapping[str, Any]) -> Path:
    """Return where a run keeps the simulated recording of an entry."""
    return Path("results", config["study"], "simulated", f"{entry['name']}.h5")


def _simulated(
    file: str, config: dict[str, Any], entry: Mapping[str, Any]
) -> list[str]:
    """Tell what is simulated, and whether it is there to be looked at."""
    from hopdata.config.consistency import simulation_of

    simulation = simulation_of(config, entry["name"])
    duration_s = simulation.get("duration_s")
    cut = "" if duration_s is None else f", cut at {duration_s:g} s"
    command = f"hopdata run {shlex.quote(file)}"
    if MODULE_IS in simulation["scene"]:
        # Code of one's own is run only if the command names it.
        command += f" --scene {shlex.quote(simulation['scene'])}"
    kept = simulated_file(config, entry)
    values = {
        "name": entry["name"],
        "hops": f"{simulation.get('hops')} hops{cut}",
        "file": kept,
        "config": file,
        "command": f"{command} --until simulate",
    }
    if not kept.is_file():
        return [str(Message("commands.not_simulated", values))]
    lines = [str(Message("commands.simulated", values))]
    if kept.stat().st_mtime < Path(file).stat().st_mtime:
        lines.append(f"  {Message('commands.simulated_before', values)}")
    return lines


def _read(
    config: dict[str, Any], entry: Mapping[str, Any]
) -> tuple[Recording, list[str]]:
    """Import one recording and check it; describe its external contacts and forces."""
    from hopdata.config.consistency import feet_of, files_of
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible
    from hopdata.scale import extent

    files = files_of(entry) or [str(simulated_file(config, entry))]
    names = ", ".join(files)
    with terminal.progress_line(f"reading {names}") as progress:
        recording, _ = import_recording(
            files,
            markers=config["markers"],
            name=entry["name"],
            exclude=entry["exclude"],
            **config["input"],
        )
        progress(f"checking {names}")
        check_plausible(recording, **config["quality"])
    first_s, last_s = recording.time[[0, -1]].tolist()
    lines = describe_external(
        entry,
        feet=feet_of(config),
        span_s=(first_s, last_s),
        rate_hz=config["input"]["rate_hz"],
        extent_m=extent(recording.positions),
    )
    if len(files) == 1:
        lines += describe_own(recording, Path(files[0]), config["input"]["unit"])
    return recording, lines


def _with_line(error: RecordingError, config: str) -> str:
    """Return the error with the line of the key that it names, if any."""
    from hopdata.config.loading import key_lines

    line = key_lines(config).get(error.key)
    if line is None:
        return str(error)
    return f"{config}, line {line}: {error}"


def _few_subjects(file: str) -> list[str]:
    """Tell which conditions of a group have too few subjects for an answer."""
    from hopdata.config.loading import read_yaml
    from hopdata.samples import read_group

    content = read_yaml(file)
    if not isinstance(content, Mapping) or "samples" not in content:
        return []
    members = read_group(file)["members"].values()
    counts = Counter(member["condition"] for member in members)
    told = []
    for condition, n_subjects in counts.items():
        told += [str(one) for one in few_subjects(n_subjects, condition)]
    return told


def few_subjects(n_subjects: int, condition: str = "") -> list[Message]:
    """Tell, of too few subjects for an answer over them, what a group gives instead."""
    from hopdata.maps.verdict.group import LEAST_SUBJECTS

    if n_subjects >= LEAST_SUBJECTS:
        return []
    of_condition: Message | str = ""
    if condition:
        of_condition = Message("commands.of_condition", {"condition": condition})
    values = {
        "subjects": counted(n_subjects, "subject"),
        "of_condition": of_condition,
        "least": LEAST_SUBJECTS,
    }
    return [Message("commands.few_subjects", values)]


def _left_by_config(
    recordings: list[Recording], config: Mapping[str, Any]
) -> list[Remark]:
    """Tell of markers that land as the feet do and have no role, in the first file."""
    from hopdata.config.consistency import files_of
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.quality.roles import rest_as_feet

    files = [file for entry in config["recordings"] for file in files_of(entry)]
    if not recordings or not files:
        return []
    known = recordings[0]
    with terminal.progress_line(f"looking for other feet in {files[0]}"):
        whole, _ = import_recording(
            files[0],
            name=known.name,
            markers=None,
            **{**config["input"], "vertical_axis": known.vertical_axis},
        )
        markers = config["markers"]
        left = rest_as_feet(
            whole.positions,
            whole.markers,
            rate_hz=whole.rate_hz,
            feet=markers["feet"],
            used=[name for names in markers.values() for name in names or ()],
        )
    if not left:
        return []
    values = {"markers": ", ".join(left)}
    return [Remark(files[0], Message("commands.left_by_config", values))]


def _remarks(recordings: list[Recording], config: Mapping[str, Any]) -> list[Remark]:
    """Return what should be known of a study's recordings: faults, what is unsure."""
    from hopdata.commands.contacts import one_of_a_kind
    from hopdata.config.consistency import effect_methods
    from hopdata.landings.effects import Methods, study_effects
    from hopdata.landings.floor import moving_messages
    from hopdata.recording import place_of
    from hopdata.recordings.plausibility import notes

    effects = study_effects(recordings, Methods(**effect_methods(config)))
    remarks = []
    for recording, of_recording in zip(recordings, effects, strict=True):
        told = one_of_a_kind(recording, notes(recording))
        told += of_recording
        told += _suspects(recording, config["input"]["rate_hz"])
        told += moving_messages(recording)
        place = place_of(recording)
        remarks += [Remark(place, text) for text in told]
    return remarks


def _suspects(recording: Recording, rate_hz: float | None) -> list[Message]:
    """Return messages on suspect data of the markers; ask for a missing rate."""
    from hopdata.recording import place_of
    from hopdata.recordings.quality.inspection import inspect

    place = place_of(recording)
    with terminal.progress_line(f"looking for faults in {place}"):
        found = inspect(recording)
    told: list[Message] = []
    if not rate_hz:
        told += listing.question("input.rate_hz", found.rate)
    told += found.lost
    if found.faults.count or len(found.timing.irregular) or found.lost:
        told.append(_answer_and_places(recording, found))
    return told


def _answer_and_places(recording: Recording, found: Inspection) -> Message:
    """Return what looks wrong, and whether it lies at contacts or between them."""
    from hopdata.landings.contacts.find import find_landings
    from hopdata.landings.fault_places import fault_places
    from hopdata.landings.floor import fit_floor, level
    from hopdata.recordings.quality.inspection import fault_table

    values: dict[str, object] = {"answer": listing.answer(found)}
    faults = fault_table(recording, found)
    if not (faults["marker"].fillna("") != "").any():
        return Message("commands.see_inspect", values)
    places = None
    try:
        landings = find_landings(level(recording, fit_floor(recording)))
        landings = landings.assign(recording=recording.name)
        starts_s = {recording.name: float(recording.time[0])}
        places = fault_places(faults, landings, starts_s)
    except AnalysisError:
        # The forecast tells what is wrong with the landings.
        pass
    if places is None:
        return Message("commands.see_inspect", values)
    return Message("commands.see_inspect_places", {**values, "places": places})


def _conclusion(
    file: str,
    config: dict[str, Any],
    recordings: list[Recording],
    remarks: list[str],
    n_studies: int,
) -> str:
    """Forecast the study if it has all its recordings; tell whether it can be run."""
    why_not = ""
    n_missing = len(config["recordings"]) - len(recordings)
    if not n_missing:
        why_not = _foretell(config, recordings)
    elif recordings:
        missing = {"missing": n_missing, "recordings": len(config["recordings"])}
        why_not = str(Message("commands.some_not_simulated", missing))
    answers.give(but=why_not or None)
    if why_not and n_studies > 1:
        values = {"study": config["study"], "studies": n_studies, "but": why_not}
        why_not = str(Message("commands.longest_but", values))
    if not why_not and remarks:
        why_not = str(Message("commands.see_notes"))
    if why_not:
        return str(Message("commands.can_run_but", {"file": file, "but": why_not}))
    return str(Message("commands.is_sound", {"file": file}))


def _foretell(config: dict[str, Any], recordings: list[Recording]) -> str:
    """Print a forecast of the study; return why it is hardly worth running, if so.

    Raises
    ------
    AnalysisError
        If the study will stop.
    """
    from hopdata.commands.forecast import describe, foretell

    try:
        with terminal.progress_line("looking for landings"):
            forecast = foretell(config, recordings)
    except AnalysisError as error:
        return _contacts_instead(config, recordings, error)
    print("\n".join(describe(forecast, config, recordings)))
    _give_forecast(forecast)
    if forecast.stops:
        will_stop = AnalysisError(forecast.reason)
        return _contacts_instead(config, recordings, will_stop)
    return forecast.vain


def _fields_of(recording: Recording, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a recording as a field of ``--json``."""
    from hopdata.recording import fraction_seen

    seen = fraction_seen(recording)
    return {
        "study": config["study"],
        "name": recording.name,
        "frames": len(recording.time),
        "rate_hz": recording.rate_hz,
        "duration_s": recording.time[-1] - recording.time[0],
        "seen_share": dict(zip(recording.markers, seen.tolist(), strict=True)),
    }


def _give_forecast(forecast: Forecast) -> None:
    """Give what the study will probably find, for ``--json``."""
    excluded = forecast.touchdowns["excluded"].astype(bool)
    answers.give(
        forecast={
            "examined_share": forecast.frames_share,
            "landings": forecast.landings,
            "touchdowns_examined": len(excluded),
            "touchdowns_used": int((~excluded).sum()),
            "detectable": forecast.detectable,
            "allowed": forecast.allowed,
            "reason": {"code": forecast.code, "text": forecast.reason}
            if forecast.reason
            else None,
            "stops": forecast.stops,
        }
    )


def _contacts_instead(
    config: dict[str, Any], recordings: list[Recording], error: AnalysisError
) -> str:
    """Print the contacts of a study that will stop; return what the run will lack.

    Raises
    ------
    AnalysisError
        If it is not for want of landings that the study will stop.
    """
    from hopdata.commands.contacts_instead import few_contacts, show_few

    found = few_contacts(config, recordings)
    if found is None:
        raise error
    show_few(found, str(error))
    return str(Message("commands.gives_contacts_only"))


def _summary(recording: Recording, config: dict[str, Any]) -> str:
    """Summarise the contents of a recording in a few lines."""
    from hopdata.recording import body_over_feet, fraction_seen, place_of

    n_frames = len(recording.time)
    duration_s = recording.time[-1] - recording.time[0]
    height_m = body_over_feet(recording)[2]
    seen = fraction_seen(recording)
    worst = int(seen.argmin())
    least = f"least {recording.markers[worst]}, {_percent(seen[worst])}"
    lines = [
        f"{recording.name}: {place_of(recording)}",
        f"  frames  {n_frames} at {recording.rate_hz:g} Hz, {duration_s:.1f} s",
    ]
    for role, names in config["markers"].items():
        if names:
            lines.append(f"  {role:6}  {', '.join(names)}")
    lines += [
        f"  height  body {height_m:.3f} m above the feet (median)",
        f"  seen    {_percent(seen.mean())} of all markers and frames; {least}",
    ]
    return "\n".join(lines)


def _percent(share: float) -> str:
    """Write a share in per cent, rounded down so that 100 means all."""
    return f"{np.floor(1e4 * share) / 100:g} %"


# Contents of a recording's external files, in a few lines.

#: Least and most mass over the cube of the markers' span that a body weight may mean.
#: Unit: kg/m³. Origin: measured. About 40 for a runner, 20 for the hopper, 5000 for a
#: runner of whom only a shoe is seen. A wrong unit changes it by a factor of 1000.
PLAUSIBLE_MASS = (1.0, 5000.0)

#: Least and most mean force over body weight, including a plate under one foot.
#: Unit: 1. Origin: chosen.
PLAUSIBLE_SHARE = (0.02, 3.0)

#: Share of the recording, and of the signal, below which their clocks are doubtful.
#: Unit: 1. Origin: chosen.
LEAST_OVERLAP = 0.75


def describe_external(
    recording: Mapping[str, Any],
    *,
    feet: Sequence[str],
    span_s: tuple[float, float],
    rate_hz: float | None = None,
    extent_m: float | None = None,
) -> list[str]:
    """Read the contacts and forces named by a recording, and describe them.

    Parameters
    ----------
    recording : mapping
        Entry of ``recordings`` in the configuration.
    feet : sequence of str
        ``markers.feet``.
    span_s : tuple of float
        First and last time of the recording's frames, s.
    rate_hz : float, optional
        ``input.rate_hz``.
    extent_m : float, optional
        Span of the markers, m, from which a plausible body weight follows.

    Returns
    -------
    list of str
        One line per column; none without external files.

    Raises
    ------
    RecordingError
        If a file cannot be read.
    """
    lines = []
    contacts = recording["contacts"]
    if contacts["file"] is not None:
        for known in read_contact_times(contacts, feet=feet, rate_hz=rate_hz):
            first_s, last_s = known.span_s
            span = f"{first_s:.3f} to {last_s:.3f} s"
            of = f"of {', '.join(known.column.feet)}"
            count = len(known.instant)
            lines.append(f"  contacts  {known.column.name}: {count}, {span}, {of}")
    forces = recording["forces"]
    if forces["file"] is not None:
        for signal in read_force_signals(forces, feet=feet):
            lines.append(_describe_force(signal, span_s, extent_m))
    return lines


def describe_own(recording: Recording, file: Path, unit: str) -> list[str]:
    """Describe the force plates in a recording's own file, which the report compares.

    Parameters
    ----------
    recording : Recording
        Imported from the file alone.
    file : path
        Its file.
    unit : {"auto", "m", "mm"}
        ``input.unit``.

    Returns
    -------
    list of str
        One line per plate; none for a file without plates.
    """
    from hopdata.inspecting.devices import devices_of, plate_line

    found = devices_of(
        file, up=recording.vertical_axis, unit=unit, rate_hz=recording.rate_hz
    )
    lines = [f"  plate     {plate_line(*one)}" for one in found.plates]
    return lines + [f"  plate     {message}" for message in found.refused]


def _describe_force(
    signal: ForceSignal, recording_s: tuple[float, float], extent_m: float | None
) -> str:
    first_s, last_s = signal.time[[0, -1]].tolist()
    samples = f"{len(signal.time)} samples, {first_s:.3f} to {last_s:.3f} s"
    largest = without_exponent(np.nanmax(signal.force), 4)
    most = f"up to {largest} {signal.unit}"
    of = f"of {', '.join(signal.column.feet)}"
    line = f"  force     {signal.column.name}: {samples}, {most}, {of}"
    line += _misplaced((first_s, last_s), recording_s)
    line += _misjudged(signal, extent_m)
    return line


def _misplaced(span_s: tuple[float, float], recording_s: tuple[float, float]) -> str:
    """Report a signal that misses much of the recording, or lies outside: its clock."""
    begin_s = max(span_s[0], recording_s[0])
    end_s = min(span_s[1], recording_s[1])
    overlap_s = max(0.0, end_s - begin_s)
    # The least duration avoids a division by zero, of a single sample.
    covered = overlap_s / max(recording_s[1] - recording_s[0], 1e-9)
    inside = overlap_s / max(span_s[1] - span_s[0], 1e-9)
    if min(covered, inside) >= LEAST_OVERLAP:
        return ""
    values = {"covered": 100 * covered, "outside": 100 * (1 - inside)}
    return str(Message("commands.force_misplaced", values))


def _misjudged(signal: ForceSignal, extent_m: float | None) -> str:
    """Report a mean force that cannot be a body weight: a wrong unit."""
    mean = float(np.nanmean(signal.force))
    weight_n = signal.options["body_weight_n"]
    if signal.unit == "body_weight":
        return _odd_share(mean)
    if weight_n is not None:
        return _odd_share(mean / weight_n)
    if extent_m is None or not extent_m > 0:
        return ""
    low, high = (GRAVITY_M_S2 * mass * extent_m**3 for mass in PLAUSIBLE_MASS)
    if low <= mean <= high:
        return ""
    values = {"mean": mean, "extent_m": extent_m, "low": low, "high": high}
    return str(Message("commands.force_no_weight", values))


def _odd_share(share: float) -> str:
    least, most = PLAUSIBLE_SHARE
    if least <= share <= most:
        return ""
    return str(Message("commands.force_share", {"share": share}))
