"""``hopdata init``: write a first configuration for a recording."""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.commands.inspect import inspected
from hopdata.errors import AnalysisError, HopdataError, printable
from hopdata.jobs import study_name
from hopdata.messages import Message
from hopdata.recordings.wording import chained

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

WIDTH = 96
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
    home : str
        Marker of the home frame; none by default.
    joined : mapping
        Feet with several markers, and those markers.
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
    home: str = ""
    joined: Mapping[str, Sequence[str]] = field(default_factory=dict)


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
        *_comment(f"Study of {draft.file}, drafted by hopdata init from what is in the file."),
        *_comment("Every value with a reason is a guess: check it. All other keys keep their "
                  "defaults; `hopdata config-docs` lists them."),
        *_comment(f"Check: hopdata check {shlex.quote(path)}"),
        *_comment(f"Run:   hopdata run {shlex.quote(path)}"),
        *(line for remark in draft.remarks for line in _comment(f"TO DO: {remark}")),
        *(line for note in draft.notes for line in _comment(f"Note: {note}")),
        "",
        f"study: {scalar(draft.study)}  # results go to results/{draft.study}",
        "",
        "recordings:  # files relative to the folder in which the workflow runs",
        *(f"  - {{name: {scalar(name)}, file: {scalar(file)}}}" for name, file in draft.recordings),
        "",
        *_markers(draft),
    ]  # fmt: skip
    if draft.joined:
        lines += [
            "",
            "feet:  # each of markers that keep their distance; the first to land counts",
        ]
    for name, names in draft.joined.items():
        lines.append(
            f"  - {{name: {scalar(name)}, markers: [{', '.join(map(scalar, names))}]}}"
        )
    for section, values in draft.settings.items():
        lines += ["", f"{section}:"]
        for key, value in values.items():
            lines += _comment(draft.reasons.get(f"{section}.{key}", ""), indent="  ")
            lines.append(f"  {key}: {scalar(value)}")
    if draft.home:
        lines += [
            "",
            "home:",
            *_comment(draft.reasons.get("home.marker", ""), indent="  "),
        ]
        lines.append(
            f"  marker: {scalar(draft.home)}  # the home frame's x-axis runs through it"
        )
    return "\n".join(lines) + "\n"


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


def _markers(draft: Draft) -> list[str]:
    """Write the section of the markers, with the unused names."""
    lines = ["markers:  # names as in the file"]
    for key in ("body", "feet", "boom"):
        names = list(draft.markers.get(key) or ())
        if names or key != "boom":
            lines += _comment(draft.reasons.get(f"markers.{key}", ""), indent="  ")
            lines += _list(key, names)
            lines[-1] += "" if names else "  # TO DO: fill in, see above"
    used = {name for names in draft.markers.values() for name in names}
    left = [name for name in draft.all_markers if name not in used]
    why = draft.reasons.get("markers.unused", "")
    return lines + (
        _comment("Not used: " + ", ".join(left) + why, indent="  ") if left else []
    )


def _list(key: str, names: Sequence[str]) -> list[str]:
    short = f"  {key}: [{', '.join(map(scalar, names))}]"
    long = [f"  {key}:", *(f"    - {scalar(name)}" for name in names)]
    return [short] if len(short) <= WIDTH else long


def _comment(text: str, *, indent: str = "") -> list[str]:
    text = printable(text[:1].upper() + text[1:])
    return [
        f"{indent}# {line}" for line in textwrap.wrap(text, WIDTH - len(indent) - 2)
    ]


READABLE_UNITS = ("mm", "m")
# Of the scale: largest error, at its rim, of a sloping floor used to find feet
ROUGH = 0.005


def init(options: argparse.Namespace) -> int:
    """Write a configuration with guessed roles; exit code 1 if anything must be filled in."""
    from hopdata.landings.floor import moving
    from hopdata.recordings.plausibility import check_order

    out = options.out or Path("config", f"{study_name(options.file.stem)}.yaml")
    if out.exists() and not options.force:
        raise HopdataError(
            f"{out}: expected no such file yet, found one; --force replaces it"
        )
    inspection = inspected(options)
    check_order(str(options.file), inspection.time)
    roles = guessed_roles(inspection)
    guessed = {key: ", ".join(getattr(roles, key)) for key in ("body", "feet", "boom")}
    asked = [
        f"markers.{key}: {guessed[key]}, or {other}?"
        for key, other in roles.unsure.items()
    ]
    moves = moving(inspection.recording(roles.feet, roles.body))
    remarks = [
        *map(str, roles.problems),
        *asked,
        *_remarks(inspection),
        *[moves] * bool(moves),
    ]
    draft = _draft(options, out, inspection, roles, remarks)
    terminal.write_text(out, draft_config(draft, path=str(out)))
    print(f"{out}: written")
    guessed |= {
        "home": draft.home,
        "unit": str(draft.settings.get("input", {}).get("unit", "")),
    }
    for key, found in guessed.items():
        if names := found or "not guessed" * (key in ("body", "feet")):
            reason = (roles.reasons | {"unit": inspection.unit.reason}).get(key)
            print(f"  {key:5} {names}" + (f" ({reason})" if reason else ""))
    for remark in remarks:
        print(f"note: {remark}")
    quoted = shlex.quote(str(out))
    if roles.problems:
        print(
            f"next: fill in what is missing in {out} (TO DO), then hopdata check {quoted}"
        )
        return terminal.PROBLEM
    print("These are guesses: correct any that are wrong in the file.")
    print(f"next: hopdata check {quoted}\n      hopdata run {quoted}")
    return terminal.OK


def guessed_roles(inspection: Inspection) -> Roles:
    """Guess the roles; if feet may be missing on a sloping floor, guess again on it levelled."""
    from hopdata.landings.floor import fit_floor, level
    from hopdata.recordings.quality.part_names import part_by_name
    from hopdata.recordings.quality.roles import guess_roles

    found, names = guess_roles(inspection), inspection.markers
    named = [name for name in names if part_by_name(name) == "foot"]
    feet = named if len(named) > 1 else [*found.feet]
    while (
        feet
        and len(feet) < len(names)
        and ({*feet} - {*found.feet} or found.reasons["unused"])
    ):
        recording = inspection.recording(
            feet, [name for name in names if name not in feet]
        )
        try:
            floor = fit_floor(
                recording, degree=1, largest_error_m=ROUGH * recording.scale
            )
        except AnalysisError:
            break
        plane = replace(floor, rim_m=1e3 * floor.rim_m)  # extends beyond the known feet
        roles = guess_roles(
            replace(inspection, positions=level(recording, plane).positions)
        )
        if (
            "slopes" not in floor.note
            or roles.problems
            or not {*found.feet} < {*roles.feet}
        ):
            break
        told = [roles.reasons["feet"], Message("recordings.feet_on_a_slope")]
        roles.reasons["feet"] = chained([one for one in told if one])
        found, feet = roles, [*roles.feet]
    return found


def _draft(
    options: argparse.Namespace,
    out: Path,
    inspection: Inspection,
    roles: Roles,
    remarks: list[str],
) -> Draft:
    told = {key: what for key, what in _WHAT.items() if roles.reasons.get(key)}
    reasons = {
        f"markers.{key}": f"{what} {roles.reasons[key]}." for key, what in told.items()
    }
    if roles.reasons["unused"]:
        reasons["markers.unused"] = f" ({roles.reasons['unused']})"
    home = ""
    if roles.reasons[
        "home"
    ]:  # otherwise the default, which no order of markers decides
        home = roles.home
        reasons["home.marker"] = f"{roles.reasons['home']}."
    settings: dict[str, dict[str, object]] = {"input": {}}
    unit, up = inspection.unit, inspection.up
    if (
        unit.is_sure
        and unit.value in READABLE_UNITS
        and (options.unit or not options.more)
    ):
        settings["input"]["unit"] = unit.value
        reasons["input.unit"] = f"{unit.reason}."
    if options.more and not options.vertical_axis:
        up = replace(up, value="auto", why=Message("recordings.up_of_each_file"))
    if up.value != "z":
        settings["input"]["vertical_axis"] = up.value
        reasons["input.vertical_axis"] = f"{up.reason}."
    if options.rate is not None:
        settings["input"]["rate_hz"] = options.rate
        reasons["input.rate_hz"] = "As given."
    if roles.other_feet:
        settings["sections"] = {"frames": "landings"}
        others = "; ".join(", ".join(group) for group in roles.other_feet)
        only = "Fig. 2.2 shows only the landings of those named above"
        reasons["sections.frames"] = (
            f"Other feet land in between ({others}), so {only}."
        )
    return Draft(
        study_name(out.stem),
        _relative(options.file),
        _recordings([options.file, *options.more]),
        {"body": roles.body, "feet": roles.feet, "boom": roles.boom},
        reasons,
        {section: values for section, values in settings.items() if values},
        [remark for remark in remarks if remark not in inspection.remarks],
        inspection.remarks, inspection.markers, home, roles.joined,
    )  # fmt: skip


_WHAT = {
    "body": "The body:",
    "feet": "The feet, numbered in this order:",
    "boom": "The boom:",
}


def _recordings(files: Sequence[Path]) -> list[tuple[str, str]]:
    """Name the recordings after their files, with a number if two share a name."""
    names = [study_name(file.stem) for file in files]
    numbers = [
        f"-{k}" * (names.count(name) > 1) for k, name in enumerate(names, start=1)
    ]
    return [
        (n + k, _relative(file))
        for n, k, file in zip(names, numbers, files, strict=True)
    ]


def _relative(file: Path) -> str:
    """Return the path relative to the working directory if below it; else as it was given."""
    path = Path(os.path.abspath(file))
    return (
        path.relative_to(Path.cwd()).as_posix()
        if path.is_relative_to(Path.cwd())
        else str(file)
    )


def _remarks(inspection: Inspection) -> list[str]:
    """List what in the file needs manual attention before the study can be trusted."""
    remarks, unit = terminal.notes(inspection), inspection.unit
    if unit.value not in READABLE_UNITS:
        remarks.append(
            f"the numbers look like {unit.value} ({unit.reason}): export in mm or m"
        )
    if found := inspection.suspects():
        more = (
            f", and {len(found) - 1} more: hopdata inspect --html lists all"
            if found[1:]
            else ""
        )
        first = f"frame {found[0].start + 1}: {found[0].text}"
        remarks.append(first + more)
    return remarks
