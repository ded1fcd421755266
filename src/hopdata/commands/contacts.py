"""``hopdata contacts``: contact instants of any file, as table, page and events."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.commands import answers, terminal
from hopdata.errors import (
    ConfigError,
    HopdataError,
    RecordingError,
    counted,
    did_you_mean,
)
from hopdata.inspecting import listing
from hopdata.messages import Message, in_shell

if TYPE_CHECKING:
    from hopdata.arrays import pd
    from hopdata.contact_times import ContactTimes
    from hopdata.recording import Recording
    from hopdata.recordings.quality.every_foot import GuessedFeet
    from hopdata.recordings.quality.inspection import Inspection

# Suffixes of configurations.
YAML = (".yaml", ".yml")

# Landings that are listed on a terminal.
MOST_LISTED = 30
# Values that make a question about a file the same as that about another.
ASKED = ("key", "value", "other")

# Columns of the list, and those where a single foot landed each time, so that nothing
# has an order, and no contact is later than the first.
SEVERAL_FEET: dict[str, terminal.Side] = {
    "landing": "right",
    "first contact (s)": "right",
    "contacts (ms after it, ± standard error)": "left",
    "order": "left",
    "probability": "right",
}
ONE_FOOT: dict[str, terminal.Side] = {
    "landing": "right",
    "contact (s)": "right",
    "foot (± standard error, ms)": "left",
}

# Formats of events, with the ending of the file.
FORMATS = {
    "c3d": "_contacts.c3d",
    "csv": "_contacts.csv",
    "bids": "",  # named as BIDS asks: see `writers.bids`
    "opensim": "_contacts.sto",
}

# Tables of landings of two feet or more, in files beside that of the contacts.
BESIDE = ("orders", "lags")

# Joins the name of a foot and its markers in --feet.
NAME_IS = "="

# Notes of a kind, and the one that names all that they are on.
MARKERS_UNSEEN = "commands.markers_unseen"
KINDS = {
    "recordings.unseen": MARKERS_UNSEEN,
    "recordings.feet_at_one_distance": "commands.feet_in_pairs",
    "recordings.feet_the_same": "commands.feet_in_pairs",
}
# What each of them is on.
SHORT = {
    "recordings.unseen": "{marker} ({percent:.0f} %)",
    "recordings.feet_at_one_distance": "'{one}' and '{other}' ({apart_mm:.1f} mm)",
    "recordings.feet_the_same": "'{one}' and '{other}' (0 mm)",
}

# Markers or pairs that a note of several names.
MOST_OF_A_KIND = 12

# Notes on what only maps depend on: how well the body's state is known.
OF_MAPS = ("recordings.soft", "recordings.soft_where_lowest")

# Why no foot is guessed.
NO_FEET = ("recordings.no_feet", "recordings.one_foot")


@dataclass(frozen=True)
class Trial:
    """A recording whose contacts are asked for.

    Parameters
    ----------
    recording : Recording
        In m, z up, with the roles of its markers.
    files : tuple of path
        The files that it was read from.
    feet : sequence of mapping
        Feet with several markers: ``name`` and ``markers``.
    options : mapping
        Keys of ``floor`` and ``touchdowns`` of a configuration: ``floor`` and those of
        `hopdata.contact_times.contacts`.
    notes : sequence of str
        What to know about it.
    asked : sequence of Message
        Which keys are unsure: see `listing.questions`.
    """

    recording: Recording
    files: tuple[Path, ...]
    feet: Sequence[Mapping[str, Any]] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    asked: Sequence[Message] = ()


def contacts(options: argparse.Namespace) -> int:
    """Time the contacts of some files; exit code 1 if none is found."""
    _require_apart(options)
    trials: list[Trial] = []
    files = [options.file, *options.more]
    of_files = iter(
        _of_files([file for file in files if not _is_config(file)], options)
    )
    for file in files:
        trials += _of_config(file) if _is_config(file) else [next(of_files)]
    name_apart(trials)
    _require_events(options, trials)
    with terminal.progress_line("timing contacts"):
        found = timed(trials, exclude=_spans(options.exclude, options.reason))
    notes = _notes_of(trials)
    # Written before anything is printed: what reads it, as `head`, may end early.
    written = _write(options, trials, found)
    show(found, notes, places=_only_place(trials))
    answers.give(notes=[*notes, *found.remarks])
    for line in written:
        print(line)
    return terminal.OK if len(found.found) else terminal.PROBLEM


def _notes_of(trials: Sequence[Trial]) -> list[str]:
    """Return the notes of all trials; what is true of several files is told once."""
    places: dict[str, list[str]] = {}
    for trial in trials:
        for note in trial.notes:
            own = [str(file) for file in trial.files if note.startswith(f"{file}: ")]
            place = own[0] if own else ""
            places.setdefault(note.removeprefix(f"{place}: "), []).append(place)
    told = _asked_once(trials)
    for text, files in places.items():
        told += _of_files_alike(text, files)
    return told


def _asked_once(trials: Sequence[Trial]) -> list[str]:
    """Return what is unsure; files that raise the same question are asked about once.

    What speaks for it, in numbers of each file, is told of the first.
    """
    first: dict[tuple[str, ...], str] = {}
    places: dict[tuple[str, ...], list[str]] = {}
    for trial in trials:
        for one in trial.asked:
            of_question = tuple(str(one.values[name]) for name in ASKED)
            first.setdefault(of_question, str(one))
            places.setdefault(of_question, []).append(f"{trial.files[0]}")
    told = []
    for of_question, files in places.items():
        told += _of_files_alike(first[of_question], files)
    return told


def _of_files_alike(text: str, files: Sequence[str]) -> list[str]:
    """Return a note with the file that it is on, or with the first of several."""
    named = [file for file in files if file]
    if len(named) > 1:
        values = {"first": named[0], "files": counted(len(named) - 1, "other file")}
        return [f"{Message('commands.files_alike', values)}: {text}"]
    return [f"{file}: {text}" if file else text for file in files]


def _only_place(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Return the names of the only recording, which notes need not repeat."""
    if len(trials) != 1:
        return ()
    recording = trials[0].recording
    from hopdata.recording import place_of

    return (*map(str, trials[0].files), place_of(recording), recording.name)


def _spans(
    given: Sequence[float] | None, given_reasons: Sequence[str] | None
) -> list[tuple[float, float, str]]:
    """Return the spans of ``--exclude``, s, with the reasons of ``--reason``."""
    numbers = list(given or ())
    if len(numbers) % 2:
        wanted = "begin and end of each span, s"
        raise ConfigError.at("--exclude", wanted, counted(len(numbers), "number"))
    n_spans = len(numbers) // 2
    reasons = list(given_reasons or [""])
    if given_reasons and not n_spans:
        raise ConfigError.at("--reason", "spans of --exclude with it", "none")
    if len(reasons) == 1:
        reasons *= n_spans
    if len(reasons) != n_spans:
        wanted = f"one reason for all, or one for each of {n_spans} spans (in quotes)"
        raise ConfigError.at("--reason", wanted, f"{len(reasons)}")
    return list(zip(numbers[::2], numbers[1::2], reasons, strict=True))


def timed(
    trials: Sequence[Trial], *, exclude: Sequence[tuple[float, float, str]] = ()
) -> ContactTimes:
    """Return the contacts of some trials; those with the same feet are timed as one.

    Frames in the spans of `exclude`, s, count as unseen.
    """
    from hopdata.contact_times import contacts as times_of
    from hopdata.contact_times import joined_times

    alike: dict[str, list[Trial]] = {}
    for trial in trials:
        key = repr((trial.recording.names("foot"), trial.feet, trial.options))
        alike.setdefault(key, []).append(trial)
    parts = []
    for group in alike.values():
        first = group[0]
        joined = tuple((str(one["name"]), (*one["markers"],)) for one in first.feet)
        # Feet without a name of their own are those of the recording.
        recordings = [replace(trial.recording, joined=joined) for trial in group]
        files = [trial.files for trial in group]
        found = times_of(recordings, files=files, exclude=exclude, **first.options)
        parts.append(found)
    return joined_times(parts, [trial.recording.name for trial in trials])


# The trials, from files or a configuration.


def _is_config(file: Path) -> bool:
    """Return whether a file is a configuration."""
    return file.suffix.lower() in YAML


@dataclass(frozen=True)
class _Looked:
    """What was read off a file before its recording is imported."""

    file: Path
    unit: str
    up: str
    feet: GuessedFeet
    body: list[str]
    notes: list[str]
    asked: list[Message]
    is_guessed: bool


def _of_files(files: Sequence[Path], options: argparse.Namespace) -> list[Trial]:
    """Read files with the roles that the user gave; the others are guessed.

    Guessed feet are alike in files with the same markers.
    """
    from hopdata.recordings.quality.every_foot import shared_feet

    looked = [_look_at(file, options) for file in files]
    guessed = [one for one in looked if one.is_guessed]
    shared = iter(shared_feet([one.feet for one in guessed]))
    return [
        _read(one, next(shared) if one.is_guessed else one.feet, options.rate)
        for one in looked
    ]


def _look_at(file: Path, options: argparse.Namespace) -> _Looked:
    """Find unit, axes, feet and body of a file, and what to know of it."""
    from hopdata.commands.guesses import inspected
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.plausibility import check_order
    from hopdata.recordings.quality.every_foot import GuessedFeet, every_foot

    of_one = argparse.Namespace(**{**vars(options), "file": file})
    inspection = inspected(of_one)
    check_order(str(file), inspection.time)
    roles = guessed_roles(inspection)
    # The recording's own notes name the unseen ones of the markers that are used.
    told_later = [*inspection.remarks, *listing.unseen_for_long(inspection)]
    asked = listing.questions(inspection)
    told_later += [str(one) for one in asked]
    others = [note for note in listing.notes(inspection) if note not in told_later]
    unit = inspection.unit
    if unit.overrules:
        values = {"stated": unit.overrules, "unit": unit.value, "reason": unit.why}
        others.append(str(Message("commands.unit_overruled", values)))
    if inspection.suspects():
        # Frames of exchanged or frozen markers are not timed: landings may be lost.
        suspects = {"answer": listing.answer(inspection)}
        others.append(str(Message("commands.see_inspect", suspects)))
    feet, joined = _given_feet(options.feet, file, inspection)
    is_guessed = not feet
    if is_guessed:
        feet, joined = every_foot(inspection, roles)
        if not feet:
            # No body is needed, so that its lack is no reason.
            of_feet = [one for one in roles.problems if one.code in NO_FEET]
            why = "; ".join(str(problem) for problem in of_feet or roles.problems)
            raise RecordingError(f"{file}: {why}; here by --feet NAME ...")
        if roles.left_by_name:
            left = {"markers": ", ".join(roles.left_by_name)}
            others.append(str(Message("commands.left_by_name_in_contacts", left)))
    body = list(options.body or roles.body)
    _require_markers("--body", file, body, inspection)
    return _Looked(
        file,
        unit.value,
        inspection.up.value,
        GuessedFeet.of(inspection.markers, feet, joined),
        body,
        [f"{file}: {note}" for note in others],
        asked,
        is_guessed,
    )


def _read(looked: _Looked, feet: GuessedFeet, rate_hz: float | None) -> Trial:
    """Read the recording of a file with its feet."""
    from hopdata.recordings.importing import import_recording

    file = looked.file
    notes = [*looked.notes]
    if looked.is_guessed:
        notes.append(_feet_guessed(file, feet))
    body = [name for name in looked.body if name not in feet.feet]
    of_feet = list(feet.feet)
    recording, _ = import_recording(
        file,
        name=file.stem,
        markers={"body": body or of_feet, "feet": of_feet if body else []},
        unit=looked.unit,
        vertical_axis=looked.up,
        rate_hz=rate_hz,
    )
    if not body:
        recording = _all_feet(recording)
        notes.append(str(Message("commands.no_body_for_contacts", {"file": file})))
    notes += _notes_on(recording)
    joined_feet = [{"name": name, "markers": list(own)} for name, own in feet.joined]
    told = tuple(dict.fromkeys(notes))
    return Trial(recording, (file,), joined_feet, notes=told, asked=looked.asked)


def _given_feet(
    given: Sequence[str] | None, file: Path, inspection: Inspection
) -> tuple[list[str], dict[str, list[str]]]:
    """Return the markers of ``--feet``, and those of feet with a name (NAME=A,B)."""
    feet: list[str] = []
    joined = {}
    for text in given or ():
        name, is_joined, own = text.partition(NAME_IS)
        markers = own.split(",") if is_joined else [text]
        if text in inspection.markers:  # a name with the sign in it
            markers = [text]
        elif is_joined:
            joined[name] = markers
        feet += markers
    _require_markers("--feet", file, feet, inspection)
    return feet, {name: own for name, own in joined.items() if own != [name]}


def _require_markers(
    option: str, file: Path, names: Sequence[str], inspection: Inspection
) -> None:
    """Require markers of the file, each once."""
    for name in names:
        if name not in inspection.markers:
            near = did_you_mean(name, list(inspection.markers))
            wanted = f"markers of {file} ({', '.join(inspection.markers)})"
            raise RecordingError.at(option, wanted, f"'{name}'{near}")
    if len(set(names)) < len(names):
        raise RecordingError.at(option, "each marker once", " ".join(names))


def _all_feet(recording: Recording) -> Recording:
    """Return a recording that was read without a body as one of feet only."""
    return replace(recording, roles=("foot",) * len(recording.markers))


def _feet_guessed(file: Path, feet: GuessedFeet) -> str:
    """Say which markers are taken for feet."""
    of_one = {marker for _, own in feet.joined for marker in own}
    told = [name for name in feet.feet if name not in of_one]
    told += [f"{name}{NAME_IS}{','.join(own)}" for name, own in feet.joined]
    values = {"file": file, "feet": " ".join(told)}
    return str(Message("commands.feet_guessed", values))


def _notes_on(recording: Recording) -> list[str]:
    """Return what should be known of a recording that was read."""
    from hopdata.recordings.plausibility import (
        check_fall,
        check_positions,
        check_upright,
        notes,
    )

    check_positions(recording)
    if not recording.indices("body"):
        return [str(remark) for remark in recording.remarks]
    check_fall(recording)
    check_upright(recording)
    of_contacts = [note for note in notes(recording) if not _is_of_maps(note)]
    return [str(note) for note in one_of_a_kind(recording, of_contacts)]


def _is_of_maps(note: Message) -> bool:
    """Tell whether a note of a recording concerns maps, and no contact."""
    remark = note.values.get("remark")
    return isinstance(remark, Message) and remark.code in OF_MAPS


def one_of_a_kind(recording: Recording, notes: Sequence[Message]) -> list[Message]:
    """Return notes, with one note for all of a kind."""
    from hopdata.recording import place_of

    told = []
    several: dict[str, list[str]] = {}
    alone: dict[str, Message] = {}
    for note in notes:
        remark = note.values.get("remark")
        if not isinstance(remark, Message) or remark.code not in KINDS:
            told.append(note)
            continue
        kind = KINDS[remark.code]
        short = SHORT[remark.code].format_map(remark.values)
        several.setdefault(kind, []).append(short)
        alone[kind] = note
    for kind, shorts in several.items():
        if len(shorts) == 1 and kind != MARKERS_UNSEEN:
            told.append(alone[kind])
            continue
        listed = ", ".join(shorts[:MOST_OF_A_KIND])
        if len(shorts) > MOST_OF_A_KIND:
            listed += f", ... {len(shorts) - MOST_OF_A_KIND} more"
        values = {"place": place_of(recording), "listed": listed}
        told.append(Message(kind, values))
    return told


def _of_config(file: Path) -> list[Trial]:
    """Read the recordings of a configuration, with its roles and options."""
    from hopdata.config.consistency import files_of
    from hopdata.config.loading import load_config
    from hopdata.recordings.importing import import_recording

    config = load_config(file)
    trials = []
    for entry in config["recordings"]:
        files = files_of(entry)
        if not files:
            wanted = "recordings of files"
            raise ConfigError.at(file, wanted, f"'{entry['name']}', simulated")
        recording, _ = import_recording(
            files,
            name=entry["name"],
            markers=config["markers"],
            exclude=entry["exclude"],
            **config["input"],
        )
        trial = trial_of(config, entry, recording)
        trials.append(replace(trial, notes=tuple(_notes_on(recording))))
    return trials


def trial_of(
    config: Mapping[str, Any], entry: Mapping[str, Any], recording: Recording
) -> Trial:
    """Return a recording of a configuration with the options that it gives."""
    from hopdata.config.consistency import contact_options, files_of

    options = contact_options(config)
    # Only the kink has errors by which orders can be sure.
    options.pop("method", None)
    options["sure"] = config["touchdowns"]["ambiguous_below"]
    options["floor"] = config["floor"]
    files = tuple(Path(one) for one in files_of(entry))
    return Trial(recording, files, config["feet"], options)


def name_apart(trials: list[Trial]) -> None:
    """Give files of the same name in different folders names that differ."""
    taken = {trial.recording.name for trial in trials}
    seen: set[str] = set()
    for place, trial in enumerate(trials):
        name = trial.recording.name
        if name in seen:
            number = 2
            while f"{name}_{number}" in taken:
                number += 1
            name = f"{name}_{number}"
            renamed = replace(trial.recording, name=name)
            trials[place] = replace(trial, recording=renamed)
        seen.add(name)
        taken.add(name)


# What is shown and written.


def show(
    found: ContactTimes, notes: Sequence[str], *, places: Sequence[str] = ()
) -> None:
    """Print the contacts of each landing, and what to know about them.

    Parameters
    ----------
    found : ContactTimes
    notes : sequence of str
        What to know of the recordings; what concerns the contacts is told first.
    places : sequence of str
        Names of the only recording, with which no note begins.
    """
    from hopdata.commands.contacts_page import without_places
    from hopdata.landings.contacts.remarks import one_for_all_feet

    print(found)
    answers.give(
        contacts=found.table.to_dict("records"),
        orders=found.orders.astype({"sure": object}).to_dict("records"),
        lags=found.lags().to_dict("records"),
    )
    several = found.orders["recording"].nunique() > 1
    has_orders = bool((found.orders["feet"] > 1).any())
    by_landing = dict(list(found.table.groupby(["recording", "landing"], sort=False)))
    rows: list[tuple[str, ...]] = []
    for order in found.orders.head(MOST_LISTED).to_dict("records"):
        own = by_landing[order["recording"], order["landing"]]
        name = f"{order['landing']}"
        if several:
            name = f"{order['recording']} {name}"
        if has_orders:
            rows.append((name, *_cells(order, own)))
        else:
            rows.append((name, *_cells_of_one(own)))
    if rows:
        columns = SEVERAL_FEET if has_orders else ONE_FOOT
        terminal.print_table(columns, rows, plain=_plain([tuple(columns), *rows]))
    n_more = len(found.orders) - len(rows)
    if n_more > 0:
        print(str(Message("commands.more_landings", {"more": n_more})))
    _show_lags(found)
    of_contacts = [in_shell(one) for one in one_for_all_feet(found.messages)]
    told = [*map(str, of_contacts), *notes]
    for note in without_places(told, places):
        terminal.note(note)


def _show_lags(found: ContactTimes) -> None:
    """Print how long each foot touches before each other; nothing without two feet."""
    from hopdata.commands.contacts_page import lags_of
    from hopdata.report.formatting import MINUS

    lags = lags_of(found)
    if lags is None:
        return
    # Programs read a hyphen as a sign, and every stream can encode it.
    rows = [
        tuple(cell.replace(MINUS, "-") for cell in row)
        for row in lags.rows[:MOST_LISTED]
    ]
    columns: dict[str, terminal.Side] = dict.fromkeys(lags.head, "right")
    columns[lags.head[0]] = "left"
    terminal.print_table(columns, rows, plain=_plain([lags.head, *rows]))
    n_more = len(lags.rows) - len(rows)
    if n_more:
        print(str(Message("commands.more_lags", {"more": n_more})))


def _cells(order: Any, own: pd.DataFrame) -> tuple[str, str, str, str]:
    """Return first contact, contacts, order and probability of a landing."""
    timed = own.dropna(subset=["contact_s"])
    first_s = timed["contact_s"].min()
    told = []
    for contact in own.to_dict("records"):
        if not np.isfinite(contact["contact_s"]):
            told.append(f"{contact['foot']} ? ({contact['remark']})")
            continue
        after_ms = 1e3 * (contact["contact_s"] - first_s)
        text = f"{_touching(contact)} {after_ms:.1f} ± {1e3 * contact['se_s']:.1f}"
        if contact["remark"]:
            text += f" ({contact['remark']})"
        told.append(text)
    probability = ""
    if np.isfinite(order["probability"]):
        probability = f"{order['probability']:.3f}"
        if not order["sure"]:
            probability += " unsure"
    return f"{first_s:.4f}", ", ".join(told), order["order"], probability


def _cells_of_one(own: pd.DataFrame) -> tuple[str, str]:
    """Return contact and foot of a landing in which at most one foot is timed."""
    first_s = own["contact_s"].min()
    shown = f"{first_s:.4f}" if np.isfinite(first_s) else ""
    told = []
    for contact in own.to_dict("records"):
        text = f"{contact['foot']} ?"
        if np.isfinite(contact["contact_s"]):
            text = f"{_touching(contact)} ± {1e3 * contact['se_s']:.1f}"
        if contact["remark"]:
            text += f" ({contact['remark']})"
        told.append(text)
    return shown, ", ".join(told)


def _touching(contact: Mapping[Any, Any]) -> str:
    """Return a foot and its first marker, as ``left (LHEE first 0.98)``.

    The number is the probability that it is the first.
    """
    foot = str(contact["foot"])
    marker = contact["marker"]
    if marker in ("", foot):
        return foot
    if not np.isfinite(contact["marker_probability"]):
        return f"{foot} ({marker})"
    return f"{foot} ({marker} first {contact['marker_probability']:.2f})"


def _plain(rows: Sequence[Sequence[str]]) -> str:
    """Return a table as plain text, in columns."""
    widths = []
    for column in zip(*rows, strict=True):
        widths.append(max(len(cell) for cell in column))
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        lines.append("  " + "  ".join(cells).rstrip())
    return "\n".join(lines)


def _require_apart(options: argparse.Namespace) -> None:
    """Refuse to write over a recording before anything is read."""
    from hopdata.recordings.writers.contact_events import require_new

    sources = [options.file, *options.more]
    written = [options.html]
    if options.out is not None:
        written.append(options.out)
        written += [_beside(options.out, kind) for kind in BESIDE]
    for path in written:
        if path is not None:
            require_new(path, sources, replace=options.force)


def _require_events(options: argparse.Namespace, trials: Sequence[Trial]) -> None:
    """Refuse events that cannot be written before contacts are timed."""
    from hopdata.recordings.writers.contact_events import require_new

    sources = [file for trial in trials for file in trial.files]
    taken: dict[Path, Trial] = {}
    for kind in options.events or ():
        for trial in trials:
            told = ", ".join(map(str, trial.files))
            is_c3d = trial.files[0].suffix.lower() == ".c3d" and len(trial.files) == 1
            if kind == "c3d" and not is_c3d:
                raise RecordingError.at("--events c3d", "a single C3D file", told)
            for path in _event_files(kind, trial, options):
                require_new(path, sources, replace=options.force)
                if path in taken:
                    other = ", ".join(map(str, taken[path].files))
                    wanted = "events of one recording; time them in calls of their own"
                    raise HopdataError.at(path, wanted, f"those of {other} and {told}")
                taken[path] = trial


def _event_files(kind: str, trial: Trial, options: argparse.Namespace) -> list[Path]:
    """Return the files of the events of a trial: the table, and what explains it."""
    from hopdata.recordings.writers import bids

    folder = options.to or Path()
    stem = trial.files[0].stem
    if kind == "bids":
        table = folder / bids.events_name(stem)
        return [table, table.with_suffix(".json")]
    return [folder / f"{stem}{FORMATS[kind]}"]


def _beside(out: Path, kind: str) -> Path:
    """Return the file of the orders or lags beside that of the contacts."""
    return out.with_name(f"{out.stem}_{kind}{out.suffix}")


def _write(
    options: argparse.Namespace, trials: Sequence[Trial], found: ContactTimes
) -> list[str]:
    """Write what was asked for; return lines that say where it is."""
    answers.give(table=options.out, page=options.html)
    lines = []
    if options.out is not None:
        lines += _write_tables(options.out, found)
    if options.html is not None:
        _write_page(options.html, trials, found)
        lines.append(f"page: {options.html}")
    for kind in options.events or ():
        for trial in trials:
            for path in write_events(kind, trial, found, options):
                answers.give_also("events", format=kind, file=path)
                lines.append(f"events: {path}")
    return lines


def _write_tables(file: Path, found: ContactTimes) -> list[str]:
    """Write the contacts, and orders and lags beside them; say where they are.

    Where no two feet land together, as in a run, there are neither orders nor lags, and
    no files. Those of an earlier call, which may be replaced, are deleted.
    """
    tables = {"table": (file, found.table)}
    has_orders = bool((found.orders["feet"] > 1).any())
    if has_orders:
        tables["orders"] = (_beside(file, "orders"), found.orders)
        tables["lags"] = (_beside(file, "lags"), found.lags())
    lines = []
    for kind, (path, table) in tables.items():
        text = table.to_csv(index=False, float_format="%.7g")
        terminal.write_text(path, text)
        lines.append(f"{kind}: {path}")
    if not has_orders:
        for kind in BESIDE:
            _beside(file, kind).unlink(missing_ok=True)
            lines.append(f"{kind}: none, since each landing is of one foot")
    return lines


def _write_page(file: Path, trials: Sequence[Trial], found: ContactTimes) -> None:
    """Write the page, titled by the recordings' names, with all notes."""
    from hopdata.commands.contacts_page import contacts_html

    names = dict.fromkeys(trial.recording.name for trial in trials)
    title = ", ".join(names)
    notes = _notes_of(trials)
    places = _only_place(trials)
    with terminal.progress_line("drawing the page"):
        page = contacts_html(found, title=title, notes=notes, places=places)
    terminal.write_text(file, page)


def write_events(
    kind: str, trial: Trial, found: ContactTimes, options: argparse.Namespace
) -> list[Path]:
    """Write the contacts of a trial as events of a format; return the files."""
    from hopdata import __version__
    from hopdata.recordings.writers import bids, c3d, csv, opensim

    written = _event_files(kind, trial, options)
    path = written[0]
    events = found.events(trial.recording.name)
    if kind == "c3d":
        c3d.write_c3d_events(trial.files[0], path, events)
    elif kind == "csv":
        csv.write_csv_events(path, events)
    elif kind == "bids":
        begin_s = float(trial.recording.time[0])
        bids.write_bids_events(path, events, begin_s=begin_s, version=__version__)
    else:
        opensim.write_opensim_events(path, events)
    return written
