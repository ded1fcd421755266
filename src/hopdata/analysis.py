"""Entry points for a notebook or a program: read, study, analyse, synthesize, plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.arrays import pd
from hopdata.bundled import SNAKEFILE
from hopdata.config.loading import check_keys, load_config, read_yaml
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    require,
    told_call,
)
from hopdata.messages import Message
from hopdata.recording import Recording, Truth, marker_names, numbers
from hopdata.stages import LINE
from hopdata.walk import Contents, Progress, Study

if TYPE_CHECKING:
    from hopdata.maps.verdict.judge import Verdict
    from hopdata.recordings.raw import RawRecording

__all__ = [
    "SNAKEFILE",
    "Study",
    "analyse",
    "guess",
    "plan",
    "read",
    "study",
    "synthesize",
]
#: Differences that `plan` lists, beyond what smooth terms may leave, as shares of the
#: map.
BEYOND = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
#: Suffixes of configurations.
YAML = (".yaml", ".yml")
# Source of all recordings that were simulated.
SIMULATED = "simulation"


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
        Names of markers by role. If both are given, only these markers are kept, body
        first. Otherwise all markers of the file are kept, with the roles that it
        states, if any; `Recording.with_roles` gives roles later, and `guess` guesses
        them.
    name : str, optional
        Name of the recording; by default the name of the file.
    options
        ``unit``, ``vertical_axis``, ``rate_hz``: see
        `hopdata.recordings.importing.import_recording`. The axis is guessed if it is
        not given; if it is not sure, a remark of the recording says so.

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
    >>> recording = read("data/sample/hopper.h5")
    >>> recording
    <Recording 'hopper': 7 markers, 106,334 frames at 100 Hz, 100 % seen>

    This file states the roles of its markers:

    >>> recording.names("foot")
    ('foot1', 'foot2', 'foot3')
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
    question = None
    if "vertical_axis" not in options:
        options["vertical_axis"], question = _up_of(first, markers, options)
    has_both = all(markers.values())
    recording, _ = import_recording(
        file, name=name or first.stem, markers=markers if has_both else None, **options
    )
    if not has_both and any(markers.values()):
        given = {role: names for role, names in markers.items() if names}
        recording = recording.with_roles(**given)
    if question is None:
        return recording
    remark = f"{first}: {question}"
    return replace(recording, remarks=(*recording.remarks, remark))


def _up_of(
    file: Path, markers: Contents, options: Contents
) -> tuple[str, Message | None]:
    """Return the file's axis that points up, and the question if that is not sure."""
    from hopdata.landings.role_guesses import roles_in_file, which_axis
    from hopdata.recordings.quality.orientation import guess_unit_and_up
    from hopdata.recordings.readers.formats import read_raw

    raw = read_raw(file, rate_hz=options.get("rate_hz"))
    known = {role: names for role, names in markers.items() if names}
    _, up = guess_unit_and_up(
        raw, unit=_known(options, "unit"), markers=known or roles_in_file(raw)
    )
    return up.value, None if up.is_sure else which_axis(up)


# Roles that are guessed of a recording.


@dataclass(frozen=True)
class _RolesOf:
    """A recording with guessed roles.

    Parameters
    ----------
    recording : Recording
        With the roles that could be guessed, and what was guessed in its remarks.
    problems : list of Message
        Roles that could not be guessed.
    questions : list of Message
        Those, and roles that are not sure.
    """

    recording: Recording
    problems: list[Message]
    questions: list[Message]


@told_call
def guess(source: str | Path | Sequence[str | Path] | Recording) -> Recording:
    """Guess which markers are feet and body, as ``hopdata init`` does.

    Parameters
    ----------
    source : Recording, path or sequence of path
        A recording, or the files of one; roles that it has are not looked at.

    Returns
    -------
    Recording
        With the roles; its ``remarks`` say what was guessed and why, and what of it is
        not sure. `Recording.with_roles` puts a wrong guess right.

    Raises
    ------
    RecordingError
        If no feet or no body can be found.
    """
    recording = source if isinstance(source, Recording) else read(source)
    found = _roles_of(recording)
    if found.problems:
        raise _not_guessed(recording, found.problems)
    return found.recording


def _not_guessed(recording: Recording, why: Sequence[Message]) -> RecordingError:
    """Return the error for roles that are not known, with the call that gives them."""
    reasons = "; ".join(str(one) for one in why)
    values = {"place": recording.place, "why": reasons}
    return RecordingError(Message("landings.roles_not_guessed", values))


def _roles_of(recording: Recording) -> _RolesOf:
    from hopdata.landings.role_guesses import guessed_roles, open_questions
    from hopdata.recordings.quality.inspection import inspect

    inspection = replace(inspect(recording), place=recording.place)
    roles = guessed_roles(inspection)
    with_roles = recording.with_roles(feet=roles.feet, body=roles.body, boom=roles.boom)
    # The markers stay in the order of the file, as for the commands.
    joined = tuple((foot, tuple(own)) for foot, own in roles.joined.items())
    remarks = [*recording.remarks]
    for role in ("feet", "body"):
        names = ", ".join(getattr(roles, role))
        reason = roles.reasons.get(role)
        values: Contents = {"place": recording.place, "role": role}
        values |= {"names": names or "none", "reason": reason or ""}
        remark = Message("landings.role_guessed", values)
        remarks.append(str(remark).removesuffix("; "))
        if role in roles.unsure:
            values["other"] = roles.unsure[role]
            remarks.append(str(Message("landings.role_not_sure", values)))
    questions = open_questions(inspection, roles)
    found = replace(with_roles, remarks=tuple(remarks), joined=joined)
    return _RolesOf(found, list(roles.problems), questions)


@dataclass(frozen=True)
class _Guessed:
    """What is guessed of a file like by ``hopdata init``.

    Parameters
    ----------
    markers : mapping
        Names of the markers of the ``"feet"`` and the ``"body"``, if not given.
    axis : str
        The vertical axis.
    other_feet : list of str
        Feet that land at other times.
    joined : mapping
        Feet with several of the markers, and those markers.
    question : Message, optional
        What the vertical axis might be else, if it is not sure.
    """

    markers: Contents
    axis: str
    other_feet: list[str]
    joined: Mapping[str, list[str]]
    question: Message | None = None


def _guessed(file: Path, markers: Contents, options: Contents) -> _Guessed:
    """Guess the vertical axis of a file, its other feet, and roles if none is given.

    Raises
    ------
    RecordingError
        If a guessed role is not sure; the message names the candidates.
    """
    from hopdata.landings.role_guesses import which_axis
    from hopdata.recordings.axes import rotate_up
    from hopdata.recordings.quality.landing_markers import feet_between
    from hopdata.recordings.quality.orientation import guess_unit_and_up
    from hopdata.recordings.raw import METRES_PER_UNIT
    from hopdata.recordings.readers.formats import read_raw

    raw = read_raw(file, rate_hz=options.get("rate_hz"))
    joined: Mapping[str, list[str]] = {}
    if not any(markers.values()):
        markers, joined = _roles(file, raw, options)
    if not all(markers.values()):
        given = " and ".join(f"{role}={names}" for role, names in markers.items())
        wanted = f"names of markers of {file} ({', '.join(raw.markers)})"
        raise RecordingError.at("feet, body", wanted, given)
    found_unit, found_axis = guess_unit_and_up(
        raw,
        unit=_known(options, "unit"),
        up=_known(options, "vertical_axis"),
        markers=markers,
    )
    metres_per_unit = METRES_PER_UNIT.get(found_unit.value, 1.0)
    upright = rotate_up(raw.positions * metres_per_unit, found_axis.value)
    feet = [name for name in markers["feet"] if name in raw.markers]
    other_feet = feet_between(raw.markers, upright, raw.rate_hz, feet)
    question = None if found_axis.is_sure else which_axis(found_axis)
    return _Guessed(markers, found_axis.value, other_feet, joined, question)


def _known(options: Contents, key: str) -> str | None:
    """Return an option, or None if it is to be guessed."""
    value = options.get(key, "auto")
    return None if value == "auto" else value


def _roles(
    file: Path, raw: RawRecording, options: Contents
) -> tuple[Contents, Mapping[str, list[str]]]:
    """Return the roles that a file states, or guess them, with the feet to be joined.

    Raises
    ------
    RecordingError
        If a role or the vertical axis is not sure.
    """
    from hopdata.landings import role_guesses
    from hopdata.recordings.quality.inspection import inspect_recording

    stated = role_guesses.roles_in_file(raw)
    if stated:
        return stated, {}
    inspection = inspect_recording(
        raw,
        unit=_known(options, "unit"),
        up=_known(options, "vertical_axis"),
        rate_hz=options.get("rate_hz"),
    )
    inspection = replace(inspection, place=f"{file}")
    roles = role_guesses.guessed_roles(inspection)
    questions = role_guesses.open_questions(inspection, roles)
    if questions:
        wanted = f"names of markers of {file} ({', '.join(raw.markers)})"
        raise RecordingError.at("feet, body", wanted, "; ".join(map(str, questions)))
    return {"feet": [*roles.feet], "body": [*roles.body]}, roles.joined


@told_call
def study(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Sequence[str] = (),
    body: Sequence[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Prepare a study for use step by step; see `analyse` for arguments and errors."""
    if not callable(progress):
        raise ArgumentError.at("progress", "a function such as print", f"{progress!r}")
    roles = {
        "feet": [*marker_names("feet", feet)],
        "body": [*marker_names("body", body)],
    }
    recordings = _recordings_of(source)
    if recordings:
        if feet or body:
            raise RecordingError(
                "feet, body: expected none, since the recording has its roles"
            )
        return _study_of_recordings(recordings, keys, progress)
    if isinstance(source, Mapping):
        return Study(load_config(_joined(source, keys, roles)), (), progress)
    if not isinstance(source, str | Path):
        how = "by hd.read or hd.Recording.from_arrays"
        wanted = f"a file, a configuration or recordings ({how})"
        raise RecordingError.at("source", wanted, type(source).__name__)
    if Path(source).suffix.lower() in YAML:
        content = _joined(read_yaml(source), keys, roles)
        return Study(load_config(content, files=[source]), (), progress)
    entry = {"name": Path(source).stem, "file": str(source)}
    content = {"study": entry["name"], "recordings": [entry]}
    guessed, roles = _with_guesses(Path(source), roles, keys, progress)
    return Study(load_config(_joined(content, guessed, roles)), (), progress)


def _recordings_of(source: object) -> tuple[Recording, ...]:
    """Return the recordings that a source is or lists; none if it is something else."""
    if isinstance(source, Recording):
        return (source,)
    if not isinstance(source, list | tuple):
        return ()
    if not all(type(one) is Recording for one in source):
        return ()
    return tuple(source)


def _study_of_recordings(
    recordings: tuple[Recording, ...], keys: Contents, progress: Progress
) -> Study:
    from hopdata.recordings.plausibility import check_plausible

    given = recordings
    recordings = tuple(_of_study(one, progress) for one in given)
    every = [
        {"feet": [*one.names("foot")], "body": [*one.names("body")]}
        for one in recordings
    ]
    if any(roles != every[0] for roles in every):
        raise RecordingError.at("source", "the same markers in the same order", every)
    keys = dict(keys)
    if any(not _has_roles(one) for one in given):
        pairs = zip(given, every, strict=True)
        other_feet = [foot for one, roles in pairs for foot in _other_feet(one, roles)]
        keys = _with_other_feet(keys, other_feet, progress)
    joined = recordings[0].joined
    if any(one.joined != joined for one in recordings):
        all_feet = [dict(one.joined) for one in recordings]
        raise RecordingError.at("source", "the same markers on each foot", all_feet)
    if joined:
        keys["feet"] = [{"name": name, "markers": [*own]} for name, own in joined]
    beside = {entry["name"]: entry for entry in keys.pop("recordings", [])}
    names = [one.name for one in recordings]
    unknown = [name for name in beside if name not in names]
    require(not unknown, "recordings", ", ".join(names), ", ".join(unknown))
    entries = [
        {"name": one.name, "file": _file_of(one), **beside.get(one.name, {})}
        for one in recordings
    ]
    content = {"study": recordings[0].name, "recordings": entries}
    config = load_config(_joined(content, keys, every[0]), check_files=False)
    for recording in recordings:
        check_plausible(recording, **config["quality"])
    return Study(config, recordings, progress)


def _has_roles(recording: Recording) -> bool:
    """Tell whether any marker is a foot or on the body."""
    return bool(recording.indices("foot") or recording.indices("body"))


def _of_study(recording: Recording, progress: Progress) -> Recording:
    """Return the markers with a role of a recording; roles are guessed without any.

    Raises
    ------
    RecordingError
        If a guessed role is not sure, or if only feet or only a body are given.
    """
    if not _has_roles(recording):
        found = _roles_of(recording)
        if found.problems:
            raise _not_guessed(recording, found.questions)
        if found.questions:
            questions = "; ".join(str(one) for one in found.questions)
            values = {"place": recording.place, "questions": questions}
            raise RecordingError(Message("landings.roles_not_sure", values))
        recording = found.recording
        for role in ("foot", "body"):
            progress(f"{role}: {', '.join(recording.names(role))}, guessed")
    for role, key in (("foot", "feet"), ("body", "body")):
        if not recording.indices(role):
            values = {"place": recording.place, "role": key}
            raise RecordingError(Message("landings.role_missing", values))
    roles = zip(recording.markers, recording.roles, strict=True)
    kept: Recording = recording[[name for name, role in roles if role != "other"]]
    return kept


def _other_feet(recording: Recording, roles: Contents) -> list[str]:
    """Return the markers of a recording that land at other times than its feet."""
    from hopdata.recordings.quality.landing_markers import feet_between

    of_feet = roles["feet"]
    return feet_between(
        recording.markers, recording.positions, recording.rate_hz, of_feet
    )


def _with_other_feet(
    keys: Contents, other_feet: Sequence[str], progress: Progress
) -> Contents:
    """Return the keys; where other feet land too, frames are those of the landings."""
    sections = keys.get("sections") or {}
    if not other_feet or "frames" in sections:
        return keys
    named = ", ".join(dict.fromkeys(other_feet))
    progress(f"sections.frames: landings, since other feet land too ({named})")
    return {**keys, "sections": {**sections, "frames": "landings"}}


def _file_of(recording: Recording) -> str:
    """Return the file of a recording; its name if it was not read from one."""
    if recording.source in ("", SIMULATED):
        return recording.name
    return recording.source


def _with_guesses(
    file: Path, roles: Contents, keys: Contents, progress: Progress
) -> tuple[Contents, Contents]:
    """Return the keys and roles of a motion-capture file, with what is guessed."""
    options = keys.get("input") or {}
    check_keys("configuration", keys)
    guessed = _guessed(file, roles, options)
    axis = guessed.axis
    progress(f"reading {file} with {axis} up")
    if guessed.question is not None:
        progress(f"input.{guessed.question}")
    for role, names in guessed.markers.items():
        if not roles[role]:
            progress(f"markers.{role}: {', '.join(names)}, of the file or guessed")
    found = {**keys, "input": {**options, "vertical_axis": axis}}
    if guessed.joined and "feet" not in keys:
        found["feet"] = [
            {"name": name, "markers": own} for name, own in guessed.joined.items()
        ]
    found = _with_other_feet(found, guessed.other_feet, progress)
    return found, guessed.markers


def _joined(
    content: Mapping[str, Any], keys: Mapping[str, Any], roles: Mapping[str, Any]
) -> Contents:
    """Return a configuration with keys and roles given beside it.

    Other keys in the same section of the configuration stay.
    """
    found = dict(content)
    if any(roles.values()):
        keys = {"markers": roles, **keys}
    for name, value in keys.items():
        beside = content.get(name)
        if isinstance(value, Mapping) and isinstance(beside, Mapping):
            found[name] = {**beside, **value}
        else:
            found[name] = value
    return found


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
        keys in the same section of `source` stay as they are. For recordings,
        ``recordings=[{"name": "walk2", "block": "sand"}]`` adds to what is known of
        them. For a motion-capture file
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
    if isinstance(options, Mapping):
        options = {"scene": scene, **options}
    keys["simulation"] = options
    # The simulation makes all markers, whatever names are given here.
    markers = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
    content = {
        "study": name,
        "recordings": [{"name": name}],
        "markers": markers,
        "seed": seed,
    }
    config = load_config({**content, **keys})
    stage = LINE.stages["simulate"]
    made = stage.function(name, **stage.settings(config, name))
    recording, truth = made.simulated
    return recording, truth


def planned(allowed: float) -> list[float]:
    """Return the differences to plan for, beyond what smooth terms may leave."""
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
    from hopdata.maps.verdict.judge import Verdict

    verdict = getattr(pilot, "verdict", pilot)
    if not isinstance(verdict, Verdict):
        found = f"{pilot!r}; a verdict.json goes through the command hopdata plan"
        raise ArgumentError.at("pilot", "a study or its verdict", found)
    if verdict.effect is None:
        raise AnalysisError(
            f"pilot: expected an answer to plan from: {verdict.sentence}"
        )
    effect = verdict.effect
    if differences is None:
        differences = planned(effect.least_allowed)
    sizes = numbers("differences", differences).ravel()
    needed = [
        effect.landings_needed(verdict.n_landings, size, verdict.n_feet)
        for size in sizes
    ]
    return pd.DataFrame({"difference": sizes, "landings": needed})
