"""A first configuration of a study, with a comment for every choice that was made."""

from __future__ import annotations

import json
import re
import shlex
import textwrap
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hopdata.errors import printable

WIDTH = 96
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null"}


@dataclass(frozen=True)
class Draft:
    """What a first configuration says.

    Parameters
    ----------
    study, recording, file : str
        Names of study and recording, and the file's path.
    markers : mapping
        Names for ``body``, ``feet`` and ``boom``.
    reasons : mapping
        Why, by key: ``"markers.body"``, ``"input.vertical_axis"`` and so on.
    settings : mapping
        Values of further sections that differ from the defaults, such as
        ``{"input": {"vertical_axis": "y"}}``.
    remarks : sequence of str
        What the user should know or do first; stands on top.
    all_markers : sequence of str
        All names in the file.
    home : str
        Marker of the home frame; none by default.
    """

    study: str
    recording: str
    file: str
    markers: Mapping[str, Sequence[str]]
    reasons: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    all_markers: Sequence[str] = ()
    home: str = ""


def draft_config(draft: Draft, *, path: str) -> str:
    """Write the draft as YAML with comments.

    Parameters
    ----------
    draft : Draft
        What it says.
    path : str
        Where it is going to be, for the comment on how to run it.
    """
    lines = [
        *_comment(f"Study of {draft.file}, drafted by hopdata init from what is in the file."),
        *_comment("Every value with a reason is a guess: check it. All other keys keep their "
                  "defaults; docs/configuration.md lists them."),
        *_comment(f"Check: hopdata check {shlex.quote(path)}"),
        *_comment(f"Run:   snakemake --cores 2 --configfile {shlex.quote(path)}"),
        *(line for remark in draft.remarks for line in _comment(f"TO DO: {remark}")),
        "",
        f"study: {scalar(draft.study)}  # results go to results/{draft.study}",
        "",
        "recordings:",
        f"  - name: {scalar(draft.recording)}",
        "    # Relative to the folder in which the workflow runs.",
        f"    file: {scalar(draft.file)}",
        "",
        *_markers(draft),
    ]  # fmt: skip
    for section, values in draft.settings.items():
        lines += ["", f"{section}:"]
        for key, value in values.items():
            lines += _comment(draft.reasons.get(f"{section}.{key}", ""), indent="  ")
            lines.append(f"  {key}: {scalar(value)}")
    if draft.home:
        lines += ["", "home:", *_comment(draft.reasons.get("home.marker", ""), indent="  ")]
        lines.append(f"  marker: {scalar(draft.home)}  # the home frame's x-axis runs through it")
    return "\n".join(lines) + "\n"


def study_name(text: str) -> str:
    """Turn any text into the name of a study or a recording: letters, digits, ``_`` and ``-``.

    Accents go, so that ``müde`` becomes ``mude``.
    """
    plain = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_")
    return name[:100] or "study"


def scalar(value: object) -> str:
    """Write a value as YAML, quoted only where it must be."""
    import yaml

    if not isinstance(value, str):
        return json.dumps(value)
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    quoted: str = yaml.safe_dump(value, default_style='"', allow_unicode=True, width=float("inf"))
    return quoted.rstrip("\n")


def _markers(draft: Draft) -> list[str]:
    """Write the section of the markers, and the names left over."""
    lines = ["markers:  # names as in the file"]
    for key in ("body", "feet", "boom"):
        names = list(draft.markers.get(key) or ())
        if names or key != "boom":
            lines += _comment(draft.reasons.get(f"markers.{key}", ""), indent="  ")
            lines += _list(key, names)
            lines[-1] += "" if names else "  # TO DO: fill in, see above"
    used = {name for names in draft.markers.values() for name in names}
    left = [name for name in draft.all_markers if name not in used]
    if left:
        lines += _comment("Not used: " + ", ".join(left), indent="  ")
    return lines


def _list(key: str, names: Sequence[str]) -> list[str]:
    short = f"  {key}: [{', '.join(map(scalar, names))}]"
    if len(short) <= WIDTH:
        return [short]
    return [f"  {key}:", *(f"    - {scalar(name)}" for name in names)]


def _comment(text: str, *, indent: str = "") -> list[str]:
    text = printable(text[:1].upper() + text[1:])
    return [f"{indent}# {line}" for line in textwrap.wrap(text, WIDTH - len(indent) - 2)]
