"""Entry points for a notebook or a program: study, analyse, synthesize, plan."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.arrays import pd
from hopdata.bundled import SNAKEFILE
from hopdata.config.loading import (
    check_keys,
    load_config,
    read_yaml,
    scene_said,
    section_names,
)
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    require,
    told_call,
    told_options,
)
from hopdata.given import marker_names, numbers
from hopdata.messages import Message
from hopdata.reading import (
    ROLES,
    Feet,
    given_roles,
    guess_of_file,
    guess_of_recording,
    landing_apart,
    not_guessed,
)
from hopdata.recording import Recording, place_of
from hopdata.stages import LINE
from hopdata.truth import Truth
from hopdata.walk import Contents, Progress, Study

if TYPE_CHECKING:
    from hopdata.maps.verdict.judge import Verdict


__all__ = [
    "SNAKEFILE",
    "Study",
    "analyse",
    "plan",
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


@told_options(section_names)
def study(
    source: str | Path | Mapping[str, Any] | Recording | Sequence[Recording],
    *,
    feet: Feet = (),
    body: Iterable[str] = (),
    progress: Progress = lambda _stage: None,
    **keys: Any,
) -> Study:
    """Prepare a study for use step by step; see `analyse` for arguments and errors.

    Examples
    --------
    >>> feet, body = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]
    >>> study("data/sample/hopper.h5", feet=feet, body=body)
    <Study 'hopper': no verdict yet>
    """
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
    given, joined = given_roles(feet, body)
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
        found = guess_of_recording(recording)
        if found.problems:
            raise not_guessed(recording, found.questions)
        if found.questions:
            questions = "; ".join(str(one) for one in found.questions)
            values = {"place": place_of(recording), "questions": questions}
            raise RecordingError(Message("landings.roles_not_sure", values))
        recording = found.recording
        for role in ("foot", "body"):
            progress(f"{role}: {', '.join(recording.names(role))}, guessed")
    for role, key in (("foot", "feet"), ("body", "body")):
        if not recording.indices(role):
            values = {"place": place_of(recording), "role": key}
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
        other_feet += landing_apart(one, feet, one.names("body"))
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
    guessed = guess_of_file(file, roles, options)
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
    scene: object = "hopper",
    *,
    name: str = "simulated",
    seed: int = 0,
    **keys: Any,
) -> tuple[Recording, Truth]:
    """Simulate a motion-capture recording of a scene, and return it with its truth.

    Parameters
    ----------
    scene : str or Scene
        A scene of `hopdata.scenes`, such as ``"hopper"`` or ``"quadruped"``; or one of
        your own: an object, or ``"MODULE:CLASS"`` in a file of the working folder,
        whose code is then run.
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
        scene_name, parameters = scene_said(scene)
        block = {scene_name: parameters} if parameters else {}
        options = {"scene": scene_name, **block, **options}
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


def planned(allowed: float, margin: float) -> list[float]:
    """Return the differences to plan for, beyond what smooth terms may leave.

    The margin is one of them if it is beyond that.
    """
    differences = {round(allowed + more, 2) for more in BEYOND}
    if margin > allowed:
        differences.add(margin)
    return sorted(differences)


def plan_notes(
    conclusion: str, estimate: float, feet: int, *, jumps: bool
) -> list[Message]:
    """Return what limits a plan from a pilot with this answer, size and feet."""
    from hopdata.maps.verdict.words import DIFFERENT, percent

    notes = []
    if jumps:
        notes.append(Message("maps.plan_jumps"))
    elif conclusion == DIFFERENT:
        notes.append(Message("maps.plan_differs", {"size": percent(estimate)}))
    if feet == 2:
        notes.append(Message("maps.little_power"))
    return notes


def fewest_note(
    needed: Iterable[int], feet: int, *, told: Callable[[int], str] = str
) -> Message | None:
    """Return a note on the least number of landings, if it is among those needed.

    Parameters
    ----------
    needed : iterable of int
        Numbers of landings.
    feet : int
        Number of feet.
    told : callable, optional
        Writes a number of landings as the table does, in which the note finds it.
    """
    from hopdata.maps.verdict.inputs import least_landings

    fewest = least_landings(feet)
    if fewest not in needed:
        return None
    return Message("maps.plan_fewest", {"fewest": told(fewest), "feet": feet})


def require_lasting(conclusion: str, *, saturates: bool, jumps: bool) -> None:
    """Raise an error if a pilot has found a difference that saturates.

    Where no difference was found, saturation is said of what may be hidden, and the
    plan is for differences over the landings. Beside a jump of the outcome kinks that
    are not there seem to saturate.

    Raises
    ------
    AnalysisError
        If it has: no number of landings is known for the simultaneous contact.
    """
    if saturates and conclusion == "different" and not jumps:
        raise AnalysisError(Message("maps.plan_saturates"))


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
        terms may leave (0.1 or more); by default they exceed it by 0.03 to 0.4, and
        the margin is one of them if it exceeds it, too.

    Returns
    -------
    DataFrame
        ``difference`` (share of the map) and ``landings`` that show it with the
        verdict's power. What limits the plan, if the pilot differs or has two feet, is
        a warning, and stands in ``attrs["notes"]``. The notes also say which number is
        the least of which there is a size.

    Raises
    ------
    AnalysisError
        If the pilot has no answer, if it has found a difference that saturates, or if
        no number of landings shows one of the differences.
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
    jumps = verdict.jump is not None and verdict.jump.low > 0.0
    require_lasting(verdict.conclusion, saturates=verdict.saturates, jumps=jumps)
    effect = verdict.effect
    if differences is None:
        differences = planned(effect.least_allowed, verdict.margin)
    sizes = numbers("differences", differences).ravel()
    needed = [
        effect.landings_needed(verdict.n_landings, size, verdict.n_feet)
        for size in sizes
    ]
    table = pd.DataFrame({"difference": sizes, "landings": needed})
    size = verdict.effect.estimate
    notes = plan_notes(verdict.conclusion, size, verdict.n_feet, jumps=jumps)
    table.attrs["notes"] = [str(note) for note in notes]
    for note in table.attrs["notes"]:
        warnings.warn(note, stacklevel=3)
    fewest = fewest_note(needed, verdict.n_feet)
    if fewest is not None:
        table.attrs["notes"].append(str(fewest))
    return table
