"""``hopdata init`` of a folder: one configuration, and a table if there are subjects.

Every file that stays is read as the study will read it, so that `hopdata check` finds
nothing that `init` did not see.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.arrays import one_blas_thread
from hopdata.commands import init as of_files
from hopdata.commands import terminal
from hopdata.commands.check import few_subjects
from hopdata.errors import AnalysisError, HopdataError, RecordingError, counted
from hopdata.inspecting.guesses import with_effects
from hopdata.jobs import study_name
from hopdata.landings.role_guesses import guessed_roles
from hopdata.messages import Message
from hopdata.recordings.quality.guess import Guess

if TYPE_CHECKING:
    from hopdata.recording import Recording
    from hopdata.recordings.lab import Lab, LeftOut, Trial
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles
    from hopdata.recordings.subjects import Subjects

# Files that are tried, the longest first, until the roles of one can be guessed.
MOST_TRIED = 3

# Files that are listed on the terminal; the configuration lists all.
MOST_LISTED = 20

# The reason to leave a file out that --keep-copies overrides.
PROCESSED = "recordings.lab_processed"

# The reason for which a file takes what is up from the others.
AXIS_UNSURE = "recordings.lab_axis_unsure"

# Columns of the table of samples.
COLUMNS = ("subject", "session", "recording", "file")


@dataclass(frozen=True)
class Reference:
    """The trial from which roles are guessed, without markers that others lack."""

    trial: Trial
    inspection: Inspection
    roles: Roles


@dataclass(frozen=True)
class Choice:
    """Which trials the study has, which files it has not, and why.

    Parameters
    ----------
    trials : list of Trial
        The study's.
    ups : set of str
        Directions of the trials' files that point up.
    n_axis_unsure : int
        Number of the trials that do not show their direction; it is that of the others.
    left_out : list of LeftOut
        The others.
    refused : Message, optional
        Why none of the trials can be used with the markers that were guessed.
    """

    trials: list[Trial]
    left_out: list[LeftOut]
    ups: frozenset[str] = frozenset()
    refused: Message | None = None
    n_axis_unsure: int = 0


def init(options: argparse.Namespace) -> int:
    """Write a configuration for a file or several, or for all files of a folder."""
    if options.file.is_dir():
        return _init_folder(options)
    return of_files.init(options)


@one_blas_thread()  # more threads cost more than they gain on small matrices
def _init_folder(options: argparse.Namespace) -> int:
    """Write configuration and table for the trials in a folder.

    Exit code 1 if anything must be filled in.
    """
    folder = options.file
    if options.more:
        found = f"{folder} and {len(options.more)} more"
        raise HopdataError(f"FILE: expected one folder, or files, found {found}")
    name = study_name(folder.resolve().name)
    out = options.out or Path("config", f"{name}.yaml")
    table = out.with_suffix(".tsv")
    for file in (out, table):
        if file.exists() and not options.force:
            wanted = "expected no such file yet, found one; --force replaces it"
            raise HopdataError(f"{file}: {wanted}")
    with terminal.progress_line(f"reading {folder}") as progress:
        from hopdata.recordings.lab import survey

        lab = survey(
            folder,
            rate_hz=options.rate,
            keeps_copies=options.keep_copies,
            progress=progress,
        )
        if not lab.trials:
            raise HopdataError(f"{folder}: {_none(lab.left_out)}")
        reference = _reference(lab.trials, options, progress)
        choice = _sorted_out(lab, reference, options, progress)
    return _write(options, out, reference, choice, lab.ignored)


def _none(left_out: Sequence[LeftOut]) -> Message:
    """Say why a folder has no trial at all."""
    files = "; ".join(str(one.message()) for one in left_out[:MOST_LISTED])
    return Message("commands.folder_none", {"files": files or "nothing"})


def _reference(
    trials: Sequence[Trial], options: argparse.Namespace, progress: Any
) -> Reference:
    """Guess the roles from one of the longest trials with the most usual markers."""
    from hopdata.recordings.lab import main_marker_set

    alike, common = main_marker_set(trials)
    longest = sorted(alike, key=lambda trial: -trial.n_frames)
    found: Reference | None = None
    for trial in longest[:MOST_TRIED]:
        progress(f"guessing the roles in {trial.place.as_posix()}")
        inspection = _inspected(trial, common, options)
        roles = guessed_roles(inspection)
        if found is None or len(roles.problems) < len(found.roles.problems):
            found = Reference(trial, inspection, roles)
        if not roles.problems and not roles.unsure and inspection.up.is_sure:
            return Reference(trial, inspection, roles)
    assert found is not None  # there is at least one trial
    return found


def _inspected(
    trial: Trial, common: Sequence[str], options: argparse.Namespace
) -> Inspection:
    """Inspect a trial's markers that all trials of its kind have."""
    from hopdata.recordings.quality.inspection import inspect_recording
    from hopdata.recordings.readers.formats import read_raw

    raw = read_raw(trial.file, rate_hz=options.rate)
    order = [trial.markers.index(name) for name in common]
    raw = replace(raw, markers=tuple(common), positions=raw.positions[:, order])
    if raw.roles:
        raw = replace(raw, roles=tuple(raw.roles[m] for m in order))
    inspection = inspect_recording(
        raw, unit=options.unit, up=options.vertical_axis, rate_hz=options.rate
    )
    return replace(inspection, place=f"{trial.file}")


def _sorted_out(
    lab: Lab, reference: Reference, options: argparse.Namespace, progress: Any
) -> Choice:
    """Read each trial as the study will; leave out those that it cannot use.

    If no trial can be used the markers are wrong, and not the trials: all stay, with
    the reason for the first.
    """
    from hopdata.recordings.lab import LeftOut, lacking

    roles = reference.roles
    needed = [*roles.body, *roles.feet, *roles.boom]
    left_out = list(lab.left_out)
    alike = []
    for trial in lab.trials:
        lacks = lacking(trial, needed)
        if lacks is None:
            alike.append(trial)
        else:
            left_out.append(LeftOut(trial.place, lacks))
    if roles.problems:
        return Choice(alike, _in_order(left_out))
    usable, ups, refused = _usable(alike, roles, options, progress)
    unsure = [trial for trial in alike if _axis_is_unsure(trial, refused)]
    n_axis_unsure = 0
    if unsure and len(ups) == 1:
        # The files of one folder are of one laboratory.
        as_others = argparse.Namespace(**{**vars(options), "vertical_axis": min(ups)})
        as_well, _, still_refused = _usable(unsure, roles, as_others, progress)
        n_axis_unsure = len(as_well)
        usable = [trial for trial in alike if trial in usable or trial in as_well]
        settled = {trial.place for trial in unsure}
        refused = [one for one in refused if one.place not in settled]
        refused += still_refused
    if not usable:
        values = {"reason": refused[0].message()}
        all_refused = Message("commands.folder_all_refused", values)
        return Choice(alike, _in_order(left_out), refused=all_refused)
    left_out = _in_order([*left_out, *refused])
    return Choice(usable, left_out, frozenset(ups), n_axis_unsure=n_axis_unsure)


def _usable(
    trials: Sequence[Trial], roles: Roles, options: argparse.Namespace, progress: Any
) -> tuple[list[Trial], set[str], list[LeftOut]]:
    """Return the trials that the study can use, what is up in them, and the others."""
    from hopdata.recordings.lab import LeftOut

    usable = []
    ups = set()
    refused = []
    for trial in trials:
        progress(f"looking for landings in {trial.place.as_posix()}")
        found = _as_recording(trial, roles, options)
        if isinstance(found, Message):
            refused.append(LeftOut(trial.place, found))
        else:
            usable.append(trial)
            ups.add(found.vertical_axis)
    return usable, ups, refused


def _axis_is_unsure(trial: Trial, refused: Sequence[LeftOut]) -> bool:
    """Tell whether a trial was refused since it does not show what is up."""
    return any(
        one.place == trial.place and one.reason.code == AXIS_UNSURE for one in refused
    )


def _in_order(left_out: Sequence[LeftOut]) -> list[LeftOut]:
    return sorted(left_out, key=lambda one: one.place)


def _as_recording(
    trial: Trial, roles: Roles, options: argparse.Namespace
) -> Recording | Message:
    """Return a trial as the study reads it, or why the study cannot use it."""
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.lab import unreadable
    from hopdata.recordings.plausibility import check_plausible
    from hopdata.recordings.quality.orientation import KEY_OF_AXIS

    try:
        recording, _ = import_recording(
            trial.file,
            name=study_name(trial.file.stem),
            markers={"body": roles.body, "feet": roles.feet, "boom": roles.boom},
            unit=options.unit or "auto",
            vertical_axis=options.vertical_axis or "auto",
            rate_hz=options.rate,
        )
        check_plausible(recording)
    except RecordingError as error:
        reason = unreadable(error, trial.file)
        if error.key == KEY_OF_AXIS:
            return replace(reason, code=AXIS_UNSURE)
        return reason
    try:
        unfit = _unfit(recording)
    except AnalysisError as error:
        return Message("recordings.lab_unreadable", {"error": str(error)})
    return unfit or recording


def _unfit(recording: Recording) -> Message | None:
    """Return why a study finds no landing in a trial; None if a foot lands in one."""
    from hopdata.landings.contacts.descents import SMALLEST_SWING
    from hopdata.landings.floor import fit_floor, level

    standing = level(recording, fit_floor(recording))
    if _landing_feet(standing):
        return None
    landing = _landing_feet(standing, of_feet=True)
    if not landing:
        values = {"feet": ", ".join(recording.names("foot"))}
        return Message("recordings.lab_nothing_lands", values)
    return Message(
        "recordings.lab_lands_without_descent",
        {"feet": ", ".join(landing), "percent": 100 * SMALLEST_SWING},
    )


def _landing_feet(standing: Recording, *, of_feet: bool = False) -> list[str]:
    """Return the feet with a contact, in descents of the body or also of the feet."""
    from hopdata.landings.contacts.find import find_landings

    landings = find_landings(standing, of_feet=of_feet)
    feet = standing.names("foot")
    return [foot for foot in feet if landings[f"contact_{foot}_s"].notna().any()]


def _write(
    options: argparse.Namespace,
    out: Path,
    reference: Reference,
    choice: Choice,
    ignored: Mapping[str, int],
) -> int:
    """Write the configuration and the table of a group; print what was found."""
    trials = choice.trials
    refused = choice.refused
    table = out.with_suffix(".tsv")
    subjects = _subjects(trials)
    is_group = len(subjects.distinct) > 1
    roles = reference.roles
    problems = list(roles.problems)
    if refused is not None:
        problems.append(refused)
    if choice.n_axis_unsure:
        reference = _with_axis_of_others(reference, choice)
    inspection = with_effects(reference.inspection, roles)
    remarks = of_files.remarks_on(inspection, roles)
    if refused is not None:
        remarks.append(str(refused))
    as_read = argparse.Namespace(**vars(options))
    as_read.file = reference.trial.file
    as_read.more = []
    if not _are_alike(choice, reference):
        # Unit and axis are then settled for each file by itself.
        as_read.more = [trial.file for trial in trials]
    if choice.n_axis_unsure:
        as_read.vertical_axis = reference.inspection.up.value
    draft = of_files.draft_of(as_read, out, reference.inspection, roles, remarks)
    notes = _notes(subjects, table, choice, ignored)
    draft = replace(
        draft,
        file=_title(options.file),
        notes=[*draft.notes, *map(str, notes)],
        recordings=_recordings(trials, subjects),
    )
    if is_group:
        # Studies of a group are not compared with plates and events.
        draft = replace(draft, samples=of_files.relative(table), beside=())
        terminal.write_text(table, _table(trials, subjects))
        print(f"{table}: written")
    terminal.write_text(out, of_files.draft_config(draft, path=str(out)))
    print(f"{out}: written, roles guessed from {reference.trial.place.as_posix()}")
    of_files.print_guesses(draft, reference.inspection, roles)
    _print_notes(notes, choice.left_out, out)
    for remark in [*of_files.notes_on_feet(roles, out), *remarks]:
        terminal.note(remark)
    return of_files.print_next(out, draft.remarks, is_complete=not problems)


def _with_axis_of_others(reference: Reference, choice: Choice) -> Reference:
    """Return the reference with what is up in the files that show it."""
    n_files = len(choice.trials)
    values = {"sure": n_files - choice.n_axis_unsure, "files": n_files}
    why = Message("recordings.up_of_most_files", values)
    inspection = replace(reference.inspection, up=Guess(min(choice.ups), why))
    return replace(reference, inspection=inspection)


def _title(folder: Path) -> str:
    """Return the path of a folder, or the name of the working folder."""
    path = of_files.relative(folder)
    return folder.resolve().name if path == "." else path


def _are_alike(choice: Choice, reference: Reference) -> bool:
    """Tell whether unit and axis of the reference surely hold for all trials."""
    inspection = reference.inspection
    units = {trial.unit for trial in choice.trials}
    is_sure = inspection.unit.is_sure and inspection.up.is_sure
    return is_sure and len(units) == 1 and choice.ups == {inspection.up.value}


def _subjects(trials: Sequence[Trial]) -> Subjects:
    from hopdata.recordings.subjects import tell_subjects

    places = [trial.place for trial in trials]
    return tell_subjects(places, [trial.subject for trial in trials])


def _recordings(trials: Sequence[Trial], subjects: Subjects) -> list[tuple[str, str]]:
    """Name the recordings of one subject after session and file."""
    names = [
        study_name("_".join(filter(None, (session, trial.place.stem))))
        for trial, session in zip(trials, subjects.sessions, strict=True)
    ]
    recordings = []
    for number, (name, trial) in enumerate(zip(names, trials, strict=True), start=1):
        is_shared = names.count(name) > 1
        own = f"{name}-{number}" if is_shared else name
        recordings.append((own, of_files.relative(trial.file)))
    return recordings


def _table(trials: Sequence[Trial], subjects: Subjects) -> str:
    """Write the table of samples: a row for each trial, subject by subject."""
    has_sessions = any(subjects.sessions)
    columns = list(COLUMNS)
    if not has_sessions:
        columns.remove("session")
    rows = []
    for name in subjects.distinct:
        own = [k for k, other in enumerate(subjects.names) if other == name]
        stems = [trials[k].place.stem for k in own]
        for k, stem in zip(own, stems, strict=True):
            recording = stem
            if stems.count(stem) > 1:
                recording = "_".join(trials[k].place.with_suffix("").parts)
            file = of_files.relative(trials[k].file)
            session = [subjects.sessions[k]] if has_sessions else []
            rows.append([name, *session, recording, file])
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def _notes(
    subjects: Subjects,
    table: Path,
    choice: Choice,
    ignored: Mapping[str, int],
) -> list[Message]:
    """Tell what was kept, whose it is, and what was left out and why."""
    n_kept = len(choice.trials)
    counts = {"kept": n_kept, "files": n_kept + len(choice.left_out)}
    notes = [Message("commands.folder_trials", counts)]
    values: dict[str, object] = {"reason": subjects.reason}
    if subjects.doubt is not None and len(subjects.distinct) > 1:
        values |= {"other": subjects.doubt, "table": str(table)}
        notes.append(Message("commands.folder_subjects_doubt", values))
    elif len(subjects.distinct) > 1:
        notes.append(Message("commands.folder_subjects", values))
    else:
        notes.append(Message("commands.folder_one_subject", values))
    if len(subjects.distinct) > 1:
        notes += few_subjects(len(subjects.distinct))
    name, n_files = Counter(subjects.names).most_common(1)[0]
    if len(subjects.distinct) > 1 and n_files > 1:
        pooled = {"files": counted(n_files, "file"), "subject": name, "table": table}
        notes.append(Message("commands.folder_pooled", pooled))
    if choice.n_axis_unsure:
        axis = {
            "up": min(choice.ups),
            "unsure": counted(choice.n_axis_unsure, "file"),
            "sure": n_kept - choice.n_axis_unsure,
        }
        notes.append(Message("commands.folder_axis", axis))
    before_names = [trial.before_names for trial in choice.trials if trial.before_names]
    if before_names:
        first = {"subject": before_names[0]}
        notes.append(Message("commands.folder_without_subject", first))
    if ignored:
        kinds = [f"{number} {suffix}" for suffix, number in ignored.items()]
        notes.append(Message("commands.folder_ignored", {"files": ", ".join(kinds)}))
    if any(one.reason.code == PROCESSED for one in choice.left_out):
        notes.append(Message("commands.folder_copies"))
    for one in choice.left_out:
        notes.append(Message("commands.folder_left_out", {"file": one.message()}))
    return notes


def _print_notes(
    notes: Sequence[Message], left_out: Sequence[LeftOut], out: Path
) -> None:
    """Print the notes, but only the first of many files that are left out."""
    n_others = len(notes) - len(left_out)
    for note in notes[: n_others + MOST_LISTED]:
        print(f"  {note}")
    n_more = len(left_out) - MOST_LISTED
    if n_more > 0:
        values = {"number": n_more, "config": str(out)}
        print(f"  {Message('commands.folder_more_left_out', values)}")
