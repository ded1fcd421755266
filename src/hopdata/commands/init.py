"""``hopdata init`` and ``config-docs``: a first configuration, and all of its keys."""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.commands.guesses import inspected
from hopdata.errors import HopdataError, counted, printable
from hopdata.inspecting import devices, listing
from hopdata.inspecting.guesses import with_effects
from hopdata.jobs import study_name
from hopdata.landings.role_guesses import guessed_roles
from hopdata.messages import Message
from hopdata.recording import Event
from hopdata.recordings.quality.feet import of_one_side

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles


def config_docs(options: argparse.Namespace) -> int:
    """Write the page that documents the configuration's keys."""
    from hopdata.config.schema import configuration_page

    page = configuration_page()
    if options.out is not None:
        terminal.write_text(options.out, page)
    else:
        print(page, end="")
    return terminal.OK


# A first configuration of a study, with a comment on every choice made.

# Characters of a line of the configuration.
WIDTH = 96

# Texts that YAML reads as text without quotes, unless they are words of its own.
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null"}


@dataclass(frozen=True)
class Draft:
    """Contents of a first configuration.

    Parameters
    ----------
    study, file : str
        Name of the study, and path of the file it was drafted from.
    recordings : sequence of (str, str)
        Name and file of each.
    markers : mapping
        Names for ``body``, ``feet`` and ``boom``.
    reasons : mapping
        Reason for each key, such as ``"markers.body"`` or ``"input.vertical_axis"``.
    settings : mapping
        Values of other sections that differ from the defaults, such as ``{"input":
        {"vertical_axis": "y"}}``.
    remarks : sequence of str
        What the user should do first; written at the top.
    notes : sequence of str
        Remarks of the reader on the file that need no action.
    all_markers : sequence of str
        All names in the file.
    home : tuple of str
        Markers of the home frame; none by default.
    joined : mapping
        Feet with several markers, and those markers.
    may_be_joined : mapping
        Feet with several markers by name whose distances do not tell that they are on
        one foot, and those markers; written as a comment.
    beside : sequence of str
        What the file holds beside markers: force plates and events.
    samples : str
        Table of a group, which then stands in place of the recordings; none by default.
    """

    study: str
    file: str
    recordings: Sequence[tuple[str, str]]
    markers: Mapping[str, Sequence[str]]
    reasons: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    notes: Sequence[str] = ()
    all_markers: Sequence[str] = ()
    home: tuple[str, ...] = ()
    joined: Mapping[str, Sequence[str]] = field(default_factory=dict)
    may_be_joined: Mapping[str, Sequence[str]] = field(default_factory=dict)
    beside: Sequence[str] = ()
    samples: str = ""


def draft_config(draft: Draft, *, path: str) -> str:
    """Write the draft as YAML with comments.

    Parameters
    ----------
    draft : Draft
        Contents of the configuration.
    path : str
        Path of the new file, for the comment on how to run it.
    """
    lines = [
        *_head(draft, path),
        "",
        f"study: {scalar(draft.study)}  # results go to results/{draft.study}",
        "",
        *_files(draft),
    ]
    for text in draft.beside:
        lines += _comment(text, indent="    ")
    lines += ["", *_markers(draft)]
    if draft.joined:
        joined = "each of markers that keep their distance; the first to land counts"
        lines += ["", f"feet:  # {joined}", *_feet(draft.joined)]
    elif draft.may_be_joined:
        lines += ["", *_comment(str(Message("commands.feet_may_be_joined")))]
        block = ["feet:", *_feet(draft.may_be_joined)]
        lines += [f"# {line}" for line in block]
    for section, values in draft.settings.items():
        lines += ["", f"{section}:"]
        for key, value in values.items():
            lines += _reason(draft, f"{section}.{key}")
            lines.append(f"  {key}: {scalar(value)}")
    if draft.home:
        lines += ["", "home:", *_reason(draft, "home.marker")]
        marker = scalar(draft.home[0])
        if len(draft.home) > 1:
            marker = f"[{', '.join(scalar(one) for one in draft.home)}]"
        through = "the home frame's x-axis, forward, runs through it"
        lines.append(f"  marker: {marker}  # {through}")
    return "\n".join(lines) + "\n"


def _feet(joined: Mapping[str, Sequence[str]]) -> list[str]:
    """Write feet with several markers."""
    return [
        f"  - {{name: {scalar(name)}, markers: {_flow(markers)}}}"
        for name, markers in joined.items()
    ]


def _files(draft: Draft) -> list[str]:
    """Write the recordings, or the table of a group's."""
    if draft.samples:
        whose = "a row for each file, with its subject"
        return [f"samples: {scalar(draft.samples)}  # {whose}"]
    lines = ["recordings:  # files relative to the folder in which the workflow runs"]
    for name, file in draft.recordings:
        lines.append(f"  - {{name: {scalar(name)}, file: {scalar(file)}}}")
    return lines


def _head(draft: Draft, path: str) -> list[str]:
    """Write the comments at the top: what to do, and what the reader remarked."""
    lines = _comment(
        f"Study of {draft.file}, drafted by hopdata init from what is in the file."
    )
    lines += _comment(
        "Every value with a reason is a guess. All other keys keep their "
        "defaults; `hopdata config-docs` lists them."
    )
    steps = [f"hopdata {name} {shlex.quote(path)}" for name in ("check", "run")]
    first = Message("commands.step_look_here")
    if draft.remarks:
        count = counted(len(draft.remarks), "remark")
        first = Message("commands.step_to_do_here", {"remarks": count})
    steps.insert(0, str(first))
    for number, step in enumerate(steps, start=1):
        lines += _comment(f"Step {number}: {step}")
    for remark in draft.remarks:
        lines += _comment(f"TO DO: {remark}")
    for note in draft.notes:
        lines += _comment(f"Note: {note}")
    return lines


def _markers(draft: Draft) -> list[str]:
    """Write the section of the markers, with the unused names."""
    lines = ["markers:  # names as in the file"]
    for role in ("body", "feet", "boom"):
        names = list(draft.markers.get(role) or ())
        if role == "boom" and not names:
            continue
        lines += _reason(draft, f"markers.{role}")
        lines += _list(role, names)
        if not names:
            lines[-1] += "  # TO DO: fill in, see above"
    used = {name for names in draft.markers.values() for name in names}
    unused = [name for name in draft.all_markers if name not in used]
    if unused:
        why = draft.reasons.get("markers.unused", "")
        lines += _comment("Not used: " + ", ".join(unused) + why, indent="  ")
    return lines


def _list(key: str, names: Sequence[str]) -> list[str]:
    in_one_line = f"  {key}: {_flow(names)}"
    if len(in_one_line) <= WIDTH:
        return [in_one_line]
    return [f"  {key}:", *(f"    - {scalar(name)}" for name in names)]


def _flow(names: Sequence[str]) -> str:
    return f"[{', '.join(map(scalar, names))}]"


def scalar(value: object) -> str:
    """Write a value as YAML, quoted only if necessary."""
    import yaml

    if not isinstance(value, str):
        return json.dumps(value)
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    quoted: str = yaml.safe_dump(
        value, default_style='"', allow_unicode=True, width=float("inf")
    )
    return quoted.rstrip("\n")


def _reason(draft: Draft, key: str) -> list[str]:
    """Write the reason for a key above it."""
    return _comment(draft.reasons.get(key, ""), indent="  ")


def _comment(text: str, *, indent: str = "") -> list[str]:
    text = printable(text[:1].upper() + text[1:])
    wrapped = textwrap.wrap(text, WIDTH - len(indent) - len("# "))
    return [f"{indent}# {line}" for line in wrapped]


# The command.

READABLE_UNITS = ("mm", "m")

# Beginning of the reason for each role.
_WHAT = {
    "body": "The body:",
    "feet": "The feet, numbered in this order:",
    "boom": "The boom:",
}


def init(options: argparse.Namespace) -> int:
    """Write a configuration with guessed roles.

    Exit code 1 if anything must be filled in.
    """
    from hopdata.recordings.plausibility import check_order

    out = options.out or Path("config", f"{study_name(options.file.stem)}.yaml")
    if out.exists() and not options.force:
        wanted = "expected no such file yet, found one; --force replaces it"
        raise HopdataError(f"{out}: {wanted}")
    inspection = inspected(options)
    check_order(str(options.file), inspection.time)
    roles = guessed_roles(inspection)
    remarks = remarks_on(with_effects(inspection, roles), roles)
    draft = draft_of(options, out, inspection, roles, remarks)
    terminal.write_text(out, draft_config(draft, path=str(out)))
    print(f"{out}: written")
    print_guesses(draft, inspection, roles)
    notes = notes_on_feet(roles, out)
    if not options.more:
        notes += too_few_landings(inspection, roles)
    for remark in [*notes, *remarks]:
        terminal.note(remark)
    if roles.other_feet:
        values = {
            "feet": "; ".join(", ".join(group) for group in roles.other_feet),
            "command": f"hopdata contacts {shlex.quote(str(options.file))}",
        }
        terminal.note(str(Message("commands.contacts_of_all_feet", values)))
    return print_next(out, draft.remarks, is_complete=not roles.problems)


def notes_on_feet(roles: Roles, out: Path) -> list[str]:
    """Return what to know of the feet: markers that are joined, or left by name."""
    notes = []
    if roles.joined:
        feet = []
        for name, markers in roles.joined.items():
            of_foot = {"name": name, "markers": ", ".join(markers)}
            feet.append(str(Message("commands.foot_of_markers", of_foot)))
        values = {"feet": "; ".join(feet), "config": str(out)}
        notes.append(str(Message("commands.feet_joined", values)))
    if roles.left_by_name:
        left = {"markers": ", ".join(roles.left_by_name)}
        notes.append(str(Message("commands.left_by_name", left)))
    return notes


def too_few_landings(inspection: Inspection, roles: Roles) -> list[str]:
    """Return a note if the body sinks in fewer landings than a verdict needs."""
    from hopdata.landings.contacts.descents import descents
    from hopdata.landings.contacts.where import body_height
    from hopdata.maps.verdict.inputs import least_landings

    if roles.problems:
        return []
    recording = inspection.recording(roles.feet, roles.body)
    n_landings = len(descents(body_height(recording)))
    n_joined = sum(len(markers) for markers in roles.joined.values())
    n_feet = len(roles.feet) - n_joined + len(roles.joined)
    least = least_landings(n_feet)
    if n_landings >= least:
        return []
    values = {"landings": n_landings, "feet": n_feet, "least": least}
    return [str(Message("commands.too_few_for_a_verdict", values))]


def print_next(out: Path, remarks: Sequence[str], *, is_complete: bool) -> int:
    """Print the steps that follow a new configuration; return the exit code.

    Parameters
    ----------
    out : Path
        The configuration.
    remarks : sequence of str
        What stands in it as ``TO DO``.
    is_complete : bool
        Whether it can be checked and run as it is.
    """
    quoted = shlex.quote(str(out))
    values = {"config": str(out), "remarks": counted(len(remarks), "remark")}
    if not is_complete:
        first = Message("commands.step_fill_in", values)
    elif remarks:
        first = Message("commands.step_to_do", values)
    else:
        first = Message("commands.step_look", values)
    steps = [str(first), f"hopdata check {quoted}", f"hopdata run {quoted}"]
    print("next, in this order:")
    for number, step in enumerate(steps, start=1):
        print(f"  {number}. {step}")
    return terminal.OK if is_complete else terminal.PROBLEM


def print_guesses(draft: Draft, inspection: Inspection, roles: Roles) -> None:
    """Print each guess with its reason."""
    guessed = {
        "body": ", ".join(roles.body) or "not guessed",
        "feet": ", ".join(roles.feet) or "not guessed",
        "boom": ", ".join(roles.boom),
        "home": ", ".join(draft.home),
        "unit": str(draft.settings.get("input", {}).get("unit", "")),
    }
    reasons = {**roles.reasons, "unit": inspection.unit.why}
    for key, value in guessed.items():
        if not value:
            continue
        line = f"  {key:5} {value}"
        if reasons.get(key):
            line += f" ({reasons[key]})"
        print(line)


def remarks_on(inspection: Inspection, roles: Roles) -> list[str]:
    """List what needs manual attention before the study can be trusted."""
    from hopdata.landings.floor import moving

    remarks = [str(problem) for problem in roles.problems]
    for role, other in roles.unsure.items():
        guessed = ", ".join(getattr(roles, role))
        values = {"role": role, "guessed": guessed, "other": other}
        remarks.append(str(Message("commands.which_markers", values)))
    remarks += listing.notes(inspection)
    unit = inspection.unit
    if unit.value not in READABLE_UNITS:
        values = {"unit": unit.value, "reason": unit.why}
        remarks.append(str(Message("commands.unit_not_read", values)))
    suspects = inspection.suspects()
    if suspects:
        first = {"frame": suspects[0].start + 1, "text": suspects[0].text}
        if len(suspects) == 1:
            remark = Message("commands.one_suspect", first)
        else:
            more = len(suspects) - 1
            remark = Message("commands.first_suspect", {**first, "more": more})
        remarks.append(str(remark))
    floor_moves = moving(inspection.recording(roles.feet, roles.body))
    if floor_moves:
        remarks.append(floor_moves)
    return remarks


def draft_of(
    options: argparse.Namespace,
    out: Path,
    inspection: Inspection,
    roles: Roles,
    remarks: list[str],
) -> Draft:
    """Return the draft of the options' files, of which the first was inspected."""
    reasons = {}
    for role, what in _WHAT.items():
        if roles.reasons.get(role):
            reasons[f"markers.{role}"] = f"{what} {roles.reasons[role]}."
    if roles.reasons.get("unused"):
        reasons["markers.unused"] = f" ({roles.reasons['unused']})"
    home: tuple[str, ...] = ()
    # Without a reason no home marker is written. The default then applies: unlike the
    # guess, it does not depend on the order of the markers.
    if roles.reasons.get("home"):
        home = roles.home
        reasons["home.marker"] = f"{roles.reasons['home']}."
    settings: dict[str, Mapping[str, object]] = {}
    of_input = _input_settings(options, inspection)
    if of_input:
        settings["input"] = {key: value for key, (value, _) in of_input.items()}
    for key, (_, reason) in of_input.items():
        reasons[f"input.{key}"] = reason
    if roles.other_feet:
        settings["sections"] = {"frames": "landings"}
        groups = "; ".join(", ".join(group) for group in roles.other_feet)
        only_those = Message("commands.other_feet", {"groups": groups})
        reasons["sections.frames"] = str(only_those)
    return Draft(
        study=study_name(out.stem),
        file=relative(options.file),
        recordings=_recordings([options.file, *options.more]),
        markers={"body": roles.body, "feet": roles.feet, "boom": roles.boom},
        reasons=reasons,
        settings=settings,
        remarks=[remark for remark in remarks if remark not in inspection.remarks],
        notes=inspection.remarks,
        all_markers=inspection.markers,
        home=home,
        joined=roles.joined,
        may_be_joined=of_one_side(roles.feet, inspection.markers),
        beside=_beside(options, inspection, roles),
    )


def _beside(
    options: argparse.Namespace, inspection: Inspection, roles: Roles
) -> list[str]:
    """Propose what to do with force plates and events of the file."""
    from hopdata.landings.marked_events import side_of_contact

    found = devices.devices_of(
        options.file,
        up=inspection.up.value,
        unit=inspection.unit.value,
        rate_hz=options.rate,
        events=inspection.events,
    )
    # Of several recordings, only the first was inspected.
    named = options.file.name if options.more else "the file"
    lines = []
    for plate, onsets in found.plates:
        along_x, along_y = plate.sides_m
        values = {
            "number": plate.number,
            "file": named,
            "size": f"{along_x:.2f} x {along_y:.2f} m",
            "onsets": devices.onsets_text(onsets),
        }
        lines.append(str(Message("commands.plate_compared", values)))
    lines += [str(message) for message in found.refused]
    labels = list(dict.fromkeys(event.label for event in found.events))
    of_sides = [
        label for label in labels if side_of_contact(Event(label=label, time_s=0.0))
    ]
    shown = ", ".join(labels[: devices.MOST_LISTED])
    if of_sides and options.file.suffix.lower() == ".c3d":
        values = {"file": named, "labels": shown}
        lines.append(str(Message("commands.events_compared", values)))
    elif labels and roles.feet:
        in_joined = {name for names in roles.joined.values() for name in names}
        alone = [foot for foot in roles.feet if foot not in in_joined]
        feet = _flow([*roles.joined, *alone])
        column = f"{{name: {scalar(labels[0])}, feet: {feet}}}"
        file = scalar(relative(options.file))
        block = f"contacts: {{file: {file}, columns: [{column}]}}"
        values = {"file": named, "labels": shown, "block": block}
        lines.append(str(Message("commands.events_to_compare", values)))
    return lines


def _input_settings(
    options: argparse.Namespace, inspection: Inspection
) -> dict[str, tuple[object, str]]:
    """Return the keys of ``input`` that are no defaults, with their reasons."""
    settings: dict[str, tuple[object, str]] = {}
    unit = inspection.unit
    # Of several files, only the first was inspected.
    holds_for_all = bool(options.unit or not options.more)
    if unit.is_sure and unit.value in READABLE_UNITS and holds_for_all:
        settings["unit"] = (unit.value, f"{unit.reason}.")
    up = inspection.up.value
    why_up = inspection.up.why
    if options.more and not options.vertical_axis:
        up = "auto"
        why_up = Message("recordings.up_of_each_file")
    if up != "z":
        settings["vertical_axis"] = (up, f"{why_up}.")
    if options.rate is not None:
        settings["rate_hz"] = (options.rate, "As given.")
    return settings


def _recordings(files: Sequence[Path]) -> list[tuple[str, str]]:
    """Name the recordings after their files, with a number if two share a name."""
    names = [study_name(file.stem) for file in files]
    recordings = []
    for number, (name, file) in enumerate(zip(names, files, strict=True), start=1):
        is_shared = names.count(name) > 1
        recordings.append((f"{name}-{number}" if is_shared else name, relative(file)))
    return recordings


def relative(file: Path) -> str:
    """Return the path from the working folder if it is in there; else as given."""
    path = Path(os.path.abspath(file))
    if path.is_relative_to(Path.cwd()):
        return path.relative_to(Path.cwd()).as_posix()
    return str(file)
