"""Recordings read from files, and their roles: as given, as stated, or guessed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.config.loading import check_keys, section_names
from hopdata.errors import ArgumentError, RecordingError, told_call, told_options
from hopdata.given import feet_and_joined, marker_names
from hopdata.messages import Message
from hopdata.recording import Recording, place_of

if TYPE_CHECKING:
    from hopdata.recordings.quality.guess import Guess
    from hopdata.recordings.raw import RawRecording

Contents = dict[str, Any]
#: Markers of the feet, or the markers of each foot by its name.
Feet = Iterable[str] | Mapping[str, Iterable[str]]
#: Feet with several markers: name, and those markers.
Joined = tuple[tuple[str, tuple[str, ...]], ...]
# Roles that a study needs, by their keys.
ROLES = ("feet", "body")


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
    markers, joined = given_roles(feet, body)
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


def given_roles(feet: Feet, body: Iterable[str]) -> tuple[Contents, Joined]:
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
    return landing_apart(seen, markers["feet"], markers["body"])


def landing_apart(
    seen: RawRecording | Recording, feet: Sequence[str], body: Sequence[str]
) -> list[str]:
    """Return markers that land at other times than the feet; positions in m, z up."""
    from hopdata.recordings.quality.landing_markers import feet_between

    known = [name for name in feet if name in seen.markers]
    if not known or {*seen.markers} <= {*feet, *body}:
        return []
    between = feet_between(seen.markers, seen.positions, seen.rate_hz, known)
    return [name for name in between if name not in body]


@dataclass(frozen=True)
class RecordingGuess:
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

    Examples
    --------
    >>> recording = guess(read("data/sample/hopper.h5").between(0, 20))
    >>> recording.names("body")
    ('body1', 'body2', 'body3')
    >>> recording.remarks[0].partition(": ")[2]
    'feet guessed: foot1, foot2, foot3; rest near the floor 32 times, 35 % of the time'
    """
    recording = source if isinstance(source, Recording) else read(source)
    found = guess_of_recording(recording)
    if found.problems:
        raise not_guessed(recording, found.problems)
    return found.recording


def not_guessed(recording: Recording, why: Sequence[Message]) -> RecordingError:
    """Return the error for roles that are not known, with the call that gives them."""
    reasons = "; ".join(str(one) for one in why)
    values = {"place": place_of(recording), "why": reasons}
    return RecordingError(Message("landings.roles_not_guessed", values))


def guess_of_recording(recording: Recording) -> RecordingGuess:
    """Return a recording with the roles that can be guessed, and what is unsure."""
    from hopdata.landings.role_guesses import guessed_roles, open_questions
    from hopdata.recordings.quality.inspection import inspect

    inspection = replace(inspect(recording), place=place_of(recording))
    roles = guessed_roles(inspection)
    with_roles = recording.with_roles(feet=roles.feet, body=roles.body, boom=roles.boom)
    # The markers stay in the order of the file, as for the commands.
    joined = tuple((foot, tuple(own)) for foot, own in roles.joined.items())
    remarks = [*recording.remarks]
    for role in ("feet", "body"):
        names = ", ".join(getattr(roles, role))
        reason = roles.reasons.get(role)
        values: Contents = {"place": place_of(recording), "role": role}
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
    return RecordingGuess(found, list(roles.problems), questions)


@dataclass(frozen=True)
class FileGuess:
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


def guess_of_file(file: Path, markers: Contents, options: Contents) -> FileGuess:
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
    return FileGuess(markers, up.value, other_feet, joined, _question(up))


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
