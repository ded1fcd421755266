"""``hopdata inspect`` of several files, or with ``--brief``: a line for each file.

A line says what a file holds, what is guessed of it, and what of that is unsure. A file
that cannot be read has a line with the reason, and the others are told all the same.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands import answers, terminal
from hopdata.commands.guesses import inspected
from hopdata.errors import HopdataError, counted, printable
from hopdata.inspecting import listing
from hopdata.landings.role_guesses import guessed_roles
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles

# Feet that a line names.
MOST_NAMED = 6


def inspect_briefly(files: Sequence[Path], options: argparse.Namespace) -> int:
    """Print a line for each file; exit code 1 if anything looks wrong in any."""
    code = terminal.OK
    for file in files:
        of_one = argparse.Namespace(**{**vars(options), "file": file})
        try:
            inspection = inspected(of_one)
            line = brief_line(inspection, f"{file}")
            is_sound = not inspection.n_problems
            answers.give_also("files", **listing.fields_of(inspection, file), line=line)
        except HopdataError as error:
            line = _refused(file, error)
            answers.give_also("files", file=file, error=answers.error_fields(error))
            is_sound = False
        print(printable(line), flush=True)
        if not is_sound:
            code = terminal.PROBLEM
    return code


def _refused(file: Path, error: HopdataError) -> str:
    """Return the reason why a file is not read, with its name once."""
    reason = " ".join(str(error).splitlines())
    if f"{file}" in reason:
        return reason
    return f"{file}: {reason}"


def brief_line(inspection: Inspection, file: str) -> str:
    """Return what a file holds, what is guessed, and what of that is unsure.

    Parameters
    ----------
    inspection : Inspection
    file : str
        How the line names the file.
    """
    duration = f"{inspection.duration_s:.1f} s"
    if inspection.duration_s < 1.0:
        duration = f"{inspection.duration_s:.2g} s"  # 0.0 s would be no recording
    facts = [
        f"{inspection.rate_hz:g} Hz",
        duration,
        counted(len(inspection.markers), "marker"),
        f"{inspection.up.value} up",
        inspection.unit.value,
    ]
    doubts = [
        f"{name} ({guess.value} or {guess.other})"
        for name, guess in (
            ("unit", inspection.unit),
            ("up", inspection.up),
            ("rate", inspection.rate),
        )
        if not guess.is_sure
    ]
    parts = [", ".join(facts)]
    try:
        roles = guessed_roles(inspection)
        parts += _landings(inspection, roles)
        doubts += roles.unsure
    except HopdataError:
        # Frames without an order in time: they are among the suspects.
        parts.append(str(Message("commands.brief_no_feet")))
    if doubts:
        parts.append(f"unsure: {', '.join(doubts)}")
    n_suspects = len(inspection.suspects())
    if n_suspects:
        parts.append(counted(n_suspects, "suspect"))
    return f"{file}: {'; '.join(parts)}"


def _landings(inspection: Inspection, roles: Roles) -> list[str]:
    """Name the feet as `hopdata contacts` guesses them, and count their landings."""
    from hopdata.contact_times import contacts
    from hopdata.recordings.quality.every_foot import every_foot

    feet, joined = every_foot(inspection, roles)
    if not feet:
        return [str(Message("commands.brief_no_feet"))]
    body = [name for name in roles.body if name not in feet]
    of_one = {marker for own in joined.values() for marker in own}
    names = [name for name in feet if name not in of_one] + list(joined)
    shown = " ".join(names[:MOST_NAMED])
    if len(names) > MOST_NAMED:
        shown += f" and {len(names) - MOST_NAMED} more"
    told = [f"feet {shown}"]
    recording = inspection.recording(feet, body)
    groups = tuple((name, tuple(own)) for name, own in joined.items())
    try:
        found = contacts(replace(recording, joined=groups))
    except HopdataError:
        return [*told, str(Message("commands.brief_no_landings"))]
    return [*told, counted(len(found.orders), "landing")]
