"""Entry points for a notebook or a program: read, study, analyse, synthesize, plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.arrays import pd
from hopdata.bundled import SNAKEFILE
from hopdata.config.loading import check_keys, load_config, read_yaml, section_names
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    require,
    told_call,
    told_options,
)
from hopdata.messages import Message
from hopdata.recording import Recording, feet_and_joined, marker_names, numbers
from hopdata.stages import LINE
from hopdata.truth import Truth
from hopdata.walk import Contents, Progress, Study

if TYPE_CHECKING:
    from hopdata.maps.verdict.judge import Verdict
    from hopdata.recordings.quality.guess import Guess
    from hopdata.recordings.raw import RawRecording

#: Markers of the feet, or the markers of each foot by its name.
Feet = Iterable[str] | Mapping[str, Iterable[str]]
#: Feet with several markers: name, and those markers.
Joined = tuple[tuple[str, tuple[str, ...]], ...]

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
# Roles that a study needs, by their keys.
ROLES = ("feet", "body")
# Source of all recordings that were simulated.
SIMULATED = "simulation"


@told_options(lambda: section_names("input"))
def read(
    file: str | Path | Sequence[str | Path],
    *,
    feet: Feet = (),
    body: Iterable[str] = (),
    name: str | None = None,
    **options: Any,
) -> Recording:
    """Read a recording of any known format.

    Parameters
    ----------
    file : path or sequence of path
        A file, or several in chronological order.
    feet : iterable of str, or mapping
        A marker for each foot; or the markers of each foot by its name, as in
        ``{"left": ["LHEE", "LTOE"]}``.
    body : iterable of str
        Three markers or more on one rigid part. If feet and body are given, only their
        markers are kept, body first; ``other_feet`` of the recording then names those
        left out that land at other times. Otherwise all markers of the file are kept,
        with the roles that it states, if any; `Recording.with_roles` gives roles later,
        and `guess` guesses them.
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

    files = _files_of(file)
    check_keys("read", {"input": options})
    markers, joined = _given_roles(feet, body)
    found = _axis_and_other_feet(files, markers, options)
    options.setdefault("vertical_axis", found.axis)
    has_both = len(markers) == 2
    recording, _ = import_recording(
        file,
        name=name or files[0].stem,
        markers=markers if has_both else None,
        **options,
    )
    if has_both:
        recording = replace(recording, joined=joined, other_feet=found.other_feet)
    elif markers:
        recording = replace(recording.with_roles(**markers), joined=joined)
    if found.question is None:
        return recording
    remark = f"{files[0]}: {found.question}"
    return replace(recording, remarks=(*recording.remarks, remark))


def _files_of(file: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the files of a recording.

    Raises
    ------
    ArgumentError
        If it is neither a path nor a list of paths.
    """
    files: Sequence[Any] = [file] if isinstance(file, str | Path) else file
    is_list = isinstance(files, list | tuple)
    if not file or not is_list or not all(isinstance(f, str | Path) for f in files):
        raise ArgumentError.at("file", "a path or a list of paths", f"{file!r}")
    return [Path(one) for one in files]


def _given_roles(feet: Feet, body: Iterable[str]) -> tuple[Contents, Joined]:
    """Return the markers of each role that is given, and the feet of several."""
    names, joined = feet_and_joined(feet)
    markers = {"feet": [*names], "body": [*marker_names("body", body)]}
    return {role: own for role, own in markers.items() if own}, joined


@dataclass(frozen=True)
class _SeenInFile:
    """What a file tells of its axis and of feet that are not analysed.

    Parameters
    ----------
    axis : str
        The axis that points up.
    question : Message, optional
        What it might be else, if it was guessed and is not sure.
    other_feet : tuple of str
        Markers that land at other times than the feet.
    """

    axis: str
    question: Message | None
    other_feet: tuple[str, ...]


def _axis_and_other_feet(
    files: Sequence[Path], markers: Contents, options: Contents
) -> _SeenInFile:
    """Look for the axis in the first of the files, and for other feet in all of them.

    Feet are looked for only where both roles are given, since all markers stay
    otherwise. A file is not read here if nothing is to be found.
    """
    from hopdata.landings.role_guesses import roles_in_file
    from hopdata.recordings.readers.formats import read_raw

    has_both = len(markers) == 2
    axis = options.get("vertical_axis")
    question = None
    other_feet: list[str] = []
    for file in files:
        if axis is not None and not has_both:
            break
        raw = read_raw(file, rate_hz=options.get("rate_hz"))
        known = {**options, "vertical_axis": axis or "auto"}
        unit, up = _unit_and_up(raw, markers or roles_in_file(raw), known)
        if axis is None:
            axis = up.value
            question = _question(up)
        if has_both:
            other_feet += _other_feet_in(raw, markers, unit, up)
    return _SeenInFile(f"{axis}", question, (*dict.fromkeys(other_feet),))


def _unit_and_up(
    raw: RawRecording, markers: Contents, options: Contents
) -> tuple[Guess, Guess]:
    """Return unit and vertical axis of a file, as given or guessed."""
    from hopdata.recordings.quality.orientation import guess_unit_and_up

    return guess_unit_and_up(
        raw,
        unit=_known(options, "unit"),
        up=_known(options, "vertical_axis"),
        markers=markers,
    )


def _question(up: Guess) -> Message | None:
    """Return what the vertical axis might be else, if it is not sure."""
    from hopdata.landings.role_guesses import which_axis

    return None if up.is_sure else which_axis(up)


def _other_feet_in(
    raw: RawRecording, markers: Contents, unit: Guess, up: Guess
) -> list[str]:
    """Return the markers of a file that land at other times than its feet."""
    from hopdata.recordings.axes import rotate_up
    from hopdata.recordings.raw import METRES_PER_UNIT, without_subject

    names = raw.markers
    if not any(":" in name for own in markers.values() for name in own):
        names = without_subject(names)
    metres_per_unit = METRES_PER_UNIT.get(unit.value, 1.0)
    upright = rotate_up(raw.positions * metres_per_unit, up.value)
    seen = replace(raw, markers=names, positions=upright)
    return _landing_apart(seen, markers["feet"], markers["body"])


def _landing_apart(
    seen: RawRecording | Recording, feet: Sequence[str], body: Sequence[str]
) -> list[str]:
    """Return markers that land at other times than the feet; positions in m, z up."""
    from hopdata.recordings.quality.landing_markers import feet_between

    known = [name for name in feet if name in seen.markers]
    if not known or {*seen.markers} <= {*feet, *body}:
        return []
    between = feet_between(seen.markers, seen.positions, seen.rate_hz, known)
    return [name for name in between if name not in body]


# Roles that are guessed of a recording.


@dataclass(frozen=True)
class _RecordingGuess:
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
    found = _guess_of_recording(recording)
    if found.problems:
        raise _not_guessed(recording, found.problems)
    return found.recording


def _not_guessed(recording: Recording, why: Sequence[Message]) -> RecordingError:
    """Return the error for roles that are not known, with the call that gives them."""
    reasons = "; ".join(str(one) for one in why)
    values = {"place": recording.place, "why": reasons}
    return RecordingError(Message("landings.roles_not_guessed", values))


def _guess_of_recording(recording: Recording) -> _RecordingGuess:
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
        values["names"] = names or "none"
        if reason:
            values["reason"] = reason
            remarks.append(str(Message("landings.role_guessed", values)))
        else:
            remarks.append(str(Message("landings.role_guessed_only", values)))
        if role in roles.unsure:
            values["other"] = roles.unsure[role]
            remarks.append(str(Message("landings.role_not_sure", values)))
    questions = open_questions(inspection, roles)
    found = replace(with_roles, remarks=tuple(remarks), joined=joined)
    return _RecordingGuess(found, list(roles.problems), questions)


@dataclass(frozen=True)
class _FileGuess:
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


def _guess_of_file(file: Path, markers: Contents, options: Contents) -> _FileGuess:
    """Guess the vertical axis of a file, its other feet, and roles if none is given.

    Raises
    ------
    RecordingError
        If a guessed role is not sure; the message names the candidates.
    """
    from hopdata.recordings.readers.formats import read_raw

    raw = read_raw(file, rate_hz=options.get("rate_hz"))
    joined: Mapping[str, list[str]] = {}
    if not markers:
        markers, joined = _stated_or_guessed(file, raw, options)
    if len(markers) < 2:
        given = " and ".join(f"{role}={markers.get(role, [])}" for role in ROLES)
        raise _roles_wanted(file, raw, given)
    unit, up = _unit_and_up(raw, markers, options)
    other_feet = _other_feet_in(raw, markers, unit, up)
    return _FileGuess(markers, up.value, other_feet, joined, _question(up))


def _roles_wanted(file: Path, raw: RawRecording, found: str) -> RecordingError:
    wanted = f"names of markers of {file} ({', '.join(raw.markers)})"
    return RecordingError.at("feet, body", wanted, found)


def _known(options: Contents, key: str) -> str | None:
    """Return an option, or None if it is to be guessed."""
    value = options.get(key, "auto")
    return None if value == "auto" else value


def _stated_or_guessed(
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
        raise _roles_wanted(file, raw, "; ".join(map(str, questions)))
    return {"feet": [*roles.feet], "body": [*roles.body]}, roles.joined


@told_options(section_names)
def study(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Feet = (),
    body: Iterable[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Prepare a study for use step by step; see `analyse` for arguments and errors."""
    if not callable(progress):
        raise ArgumentError.at("progress", "a function such as print", f"{progress!r}")
    keys = _with_roles(keys, feet, body)
    recordings = _recordings_of(source)
    if recordings:
        return _study_of_recordings(recordings, keys, progress)
    if isinstance(source, Mapping):
        return Study(load_config(_joined(source, keys)), (), progress)
    if not isinstance(source, str | Path):
        how = "by hd.read or hd.Recording.from_arrays"
        wanted = f"a file, a configuration or recordings ({how})"
        raise RecordingError.at("source", wanted, type(source).__name__)
    if Path(source).suffix.lower() in YAML:
        content = _joined(read_yaml(source), keys)
        return Study(load_config(content, files=[source]), (), progress)
    entry = {"name": Path(source).stem, "file": str(source)}
    content = {"study": entry["name"], "recordings": [entry]}
    keys = _with_guesses(Path(source), keys, progress)
    return Study(load_config(_joined(content, keys)), (), progress)


def _with_roles(keys: Contents, feet: Feet, body: Iterable[str]) -> Contents:
    """Return the keys with the roles that are given beside them.

    Raises
    ------
    HopdataError
        If the key ``markers`` is none of the schema, or gives a role as well.
    """
    given, joined = _given_roles(feet, body)
    markers = keys.get("markers", {})
    if not isinstance(markers, Mapping):
        check_keys("configuration", {"markers": markers})
    twice = [role for role in given if markers.get(role)]
    if twice:
        found = f"{twice[0]}= and markers={{'{twice[0]}': ...}}"
        raise ArgumentError.at("feet, body", "each role once", found)
    keys = dict(keys)
    if given:
        keys["markers"] = {**markers, **given}
    if joined:
        keys["feet"] = [{"name": name, "markers": [*own]} for name, own in joined]
    return keys


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

    if {*ROLES} & {*keys.get("markers", {})}:
        wanted = "none beside a recording, which has its roles"
        found = "some; give them by recording.with_roles(feet=[...], body=[...])"
        raise RecordingError.at("feet, body", wanted, found)
    whole = [_with_own_roles(one, progress) for one in recordings]
    keys = _with_other_feet(keys, whole, progress)
    recordings = tuple(_of_roles(one) for one in whole)
    markers_of_each = [
        {"feet": [*one.names("foot")], "body": [*one.names("body")]}
        for one in recordings
    ]
    markers = markers_of_each[0]
    if any(other != markers for other in markers_of_each):
        wanted = "the same markers in the same order"
        raise RecordingError.at("source", wanted, markers_of_each)
    joined = recordings[0].joined
    if any(one.joined != joined for one in recordings):
        all_feet = [dict(one.joined) for one in recordings]
        raise RecordingError.at("source", "the same markers on each foot", all_feet)
    if joined:
        keys["feet"] = [{"name": name, "markers": [*own]} for name, own in joined]
    given_entries = _entries_by_name(keys.pop("recordings", []))
    names = [one.name for one in recordings]
    unknown = [name for name in given_entries if name not in names]
    require(not unknown, "recordings", ", ".join(names), ", ".join(unknown))
    entries = [
        {"name": one.name, "file": _file_of(one), **given_entries.get(one.name, {})}
        for one in recordings
    ]
    content = {
        "study": recordings[0].name,
        "recordings": entries,
        "markers": markers,
    }
    config = load_config(_joined(content, keys), check_files=False)
    for recording in recordings:
        check_plausible(recording, **config["quality"])
    return Study(config, recordings, progress)


def _entries_by_name(entries: Any) -> dict[str, Contents]:
    """Return what is given of each recording beside it.

    Raises
    ------
    ConfigError
        If it is no list of entries with a name.
    """
    if not entries:
        return {}
    check_keys("configuration", {"recordings": entries})
    return {entry["name"]: entry for entry in entries}


def _has_roles(recording: Recording) -> bool:
    """Tell whether any marker is a foot or on the body."""
    return bool(recording.indices("foot") or recording.indices("body"))


def _with_own_roles(recording: Recording, progress: Progress) -> Recording:
    """Return a recording with feet and body; they are guessed if it has no roles.

    Raises
    ------
    RecordingError
        If a guessed role is not sure, or if only feet or only a body are given.
    """
    if not _has_roles(recording):
        found = _guess_of_recording(recording)
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
    return recording


def _of_roles(recording: Recording) -> Recording:
    """Return the markers of a recording that have a role."""
    roles = zip(recording.markers, recording.roles, strict=True)
    kept: Recording = recording[[name for name, role in roles if role != "other"]]
    return kept


def _with_other_feet(
    keys: Contents, recordings: Sequence[Recording], progress: Progress
) -> Contents:
    """Return the keys; where markers land that are no feet, frames are of landings."""
    if _has_frames(keys):
        return keys
    other_feet: list[str] = []
    for one in recordings:
        feet = [*one.names("foot"), *one.names("part")]
        other_feet += one.other_feet
        other_feet += _landing_apart(one, feet, one.names("body"))
    return _with_frames(keys, other_feet, progress)


def _has_frames(keys: Contents) -> bool:
    """Tell whether the keys say which frames count, or are none of the schema."""
    sections = keys.get("sections") or {}
    return not isinstance(sections, Mapping) or "frames" in sections


def _with_frames(
    keys: Contents, other_feet: Sequence[str], progress: Progress
) -> Contents:
    """Return the keys; with other feet, the frames are those of the landings."""
    if not other_feet or _has_frames(keys):
        return keys
    named = ", ".join(dict.fromkeys(other_feet))
    progress(f"sections.frames: landings, since other feet land too ({named})")
    sections = keys.get("sections") or {}
    return {**keys, "sections": {**sections, "frames": "landings"}}


def _file_of(recording: Recording) -> str:
    """Return the file of a recording; its name if it was not read from one."""
    if recording.source in ("", SIMULATED):
        return recording.name
    return recording.source


def _with_guesses(file: Path, keys: Contents, progress: Progress) -> Contents:
    """Return the keys for a motion-capture file, with what is guessed of it."""
    others = {name: value for name, value in keys.items() if name != "markers"}
    check_keys("configuration", others)
    options = keys.get("input") or {}
    markers = keys.get("markers", {})
    roles = {
        role: [*marker_names(f"markers.{role}", markers[role])]
        for role in ROLES
        if markers.get(role)
    }
    if len(roles) == len(ROLES):
        check_keys("configuration", {"markers": markers})
    guessed = _guess_of_file(file, roles, options)
    progress(f"reading {file} with {guessed.axis} up")
    if guessed.question is not None:
        progress(f"input.{guessed.question}")
    for role, names in guessed.markers.items():
        if role not in roles:
            progress(f"markers.{role}: {', '.join(names)}, of the file or guessed")
    found = {
        **keys,
        "input": {**options, "vertical_axis": guessed.axis},
        "markers": {**markers, **guessed.markers},
    }
    if guessed.joined:
        found["feet"] = [
            {"name": name, "markers": own} for name, own in guessed.joined.items()
        ]
    return _with_frames(found, guessed.other_feet, progress)


def _joined(content: Mapping[str, Any], keys: Mapping[str, Any]) -> Contents:
    """Return a configuration with keys given beside it.

    Other keys in the same section of the configuration stay.
    """
    found = dict(content)
    for name, value in keys.items():
        stated = content.get(name)
        if isinstance(value, Mapping) and isinstance(stated, Mapping):
            found[name] = {**stated, **value}
        else:
            found[name] = value
    return found


@told_options(section_names)
def analyse(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Feet = (),
    body: Iterable[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Analyse recordings, or the study of a configuration, as the workflow does.

    Parameters
    ----------
    source : path, mapping, Recording or list of Recording
        A configuration (YAML file or its content), a motion-capture file, or
        recordings.
    feet : iterable of str, or mapping
        For a motion-capture file or a configuration: a marker for each foot; or the
        markers of each foot by its name, as in ``{"left": ["LHEE", "LTOE"]}``, which
        makes the configuration's section ``feet``. Of a role that is not given, what
        `source` says of it stays.
    body : iterable of str
        Three markers or more on one rigid part.
    progress : callable
        A function such as `print`, called with the name of each stage as it begins.
    keys
        Sections of the configuration, such as ``touchdowns={"method": "kink"}``. Other
        keys in the same section of `source` stay as they are. For recordings,
        ``recordings=[{"name": "walk2", "block": "sand"}]`` adds to what is known of
        them, and ``markers={"feet": [...], "body": [...]}`` is the same as `feet` and
        `body`. For a motion-capture file the vertical axis is guessed from free fall
        unless ``input["vertical_axis"]`` is given. Where markers land at other times
        than the feet, ``sections={"frames": "landings"}`` is set unless it is given;
        `progress` says so.

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


@told_options(section_names)
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
