"""``hopdata init``: a first configuration for a recording."""

from __future__ import annotations

import argparse
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands.exit_codes import OK, PROBLEM
from hopdata.commands.inspect import inspected
from hopdata.commands.suspects import suspects
from hopdata.commands.writing import write_text
from hopdata.errors import HopdataError

if TYPE_CHECKING:
    from hopdata.config.draft import Draft
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles

READABLE_UNITS = ("mm", "m")


def init(options: argparse.Namespace) -> int:
    """Write a configuration with guessed roles; exit code 1 if something must be filled in."""
    from hopdata.config.draft import draft_config, study_name
    from hopdata.recordings.quality.roles import guess_roles

    name = study_name(options.file.stem)
    out = options.out or Path("config", f"{name}.yaml")
    if out.exists() and not options.force:
        raise HopdataError(f"{out}: expected no such file yet, found one; --force replaces it")
    inspection = inspected(options)
    roles = guess_roles(inspection)
    remarks = [*roles.problems, *_remarks(inspection)]
    draft = _draft(options, name, study_name(out.stem), inspection, roles, remarks)
    write_text(out, draft_config(draft, path=str(out)))
    print(f"{out}: written")
    guessed = {key: ", ".join(getattr(roles, key)) for key in ("body", "feet", "boom")}
    for key, found in (guessed | {"home": roles.home}).items():
        names = found or "not guessed" * (key in ("body", "feet"))
        if names:
            reason = roles.reasons.get(key)
            print(f"  {key:5} {names}" + (f" ({reason})" if reason else ""))
    for remark in remarks:
        print(f"note: {remark}")
    quoted = shlex.quote(str(out))
    if roles.problems:
        print(f"next: fill in what is missing in {out} (TO DO), then hopdata check {quoted}")
        return PROBLEM
    print("These are guesses: correct in the file what is not so.")
    print(f"next: hopdata check {quoted}\n      snakemake --cores 2 --configfile {quoted}")
    return OK


def _draft(
    options: argparse.Namespace,
    name: str,
    study: str,
    inspection: Inspection,
    roles: Roles,
    remarks: list[str],
) -> Draft:
    from hopdata.config.draft import Draft

    reasons = {
        f"markers.{key}": f"{what} {roles.reasons[key]}."
        for key, what in _WHAT.items()
        if roles.reasons.get(key)
    }
    if roles.reasons["home"]:
        reasons["home.marker"] = f"{roles.reasons['home']}."
    settings: dict[str, dict[str, object]] = {"input": {}}
    if inspection.unit.is_sure and inspection.unit.value in READABLE_UNITS:
        settings["input"]["unit"] = inspection.unit.value
        reasons["input.unit"] = f"{inspection.unit.reason}."
    if inspection.up.value != "z":
        settings["input"]["vertical_axis"] = inspection.up.value
        reasons["input.vertical_axis"] = f"{inspection.up.reason}."
    if options.rate is not None:
        settings["input"]["rate_hz"] = options.rate
        reasons["input.rate_hz"] = "As given; the file does not state it."
    if roles.other_feet:
        settings["sections"] = {"frames": "landings"}
        others = "; ".join(", ".join(group) for group in roles.other_feet)
        reasons["sections.frames"] = (
            f"Other feet land in between ({others}), so only the landings of those named above "
            "tell where the sections should be."
        )
    return Draft(
        study=study,
        recording=name,
        file=_relative(options.file),
        markers={"body": roles.body, "feet": roles.feet, "boom": roles.boom},
        reasons=reasons,
        settings={section: values for section, values in settings.items() if values},
        remarks=remarks,
        all_markers=inspection.markers,
        home=roles.home,
    )


_WHAT = {"body": "The body:", "feet": "The feet, numbered in this order:", "boom": "The boom:"}


def _relative(file: Path) -> str:
    """Path from the working directory, if the file is below it; else as it was given."""
    path = Path(os.path.abspath(file))
    return path.relative_to(Path.cwd()).as_posix() if path.is_relative_to(Path.cwd()) else str(file)


def _remarks(inspection: Inspection) -> list[str]:
    """Say what of the file needs a hand before the study can be trusted."""
    remarks = []
    unit, up = inspection.unit, inspection.up
    if unit.value not in READABLE_UNITS:
        remarks.append(f"the numbers look like {unit.value} ({unit.reason}): export in mm or m")
    elif not unit.is_sure:
        remarks.append(f"input.unit: {unit.value} is not sure ({unit.reason})")
    if not up.is_sure:
        remarks.append(f"input.vertical_axis: {up.value} is not sure ({up.reason})")
    found = suspects(inspection)
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        remarks.append(f"frame {found[0].frame}: {found[0].text}{more}; hopdata inspect shows all")
    return remarks
