"""The page: what the dissertation prints beside what is found here, item by item."""

from __future__ import annotations

import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdata.dissertation.items import Item
from hopdata.dissertation.making import FIGURES, Record
from hopdata.dissertation.report.entries import (
    MISSING,
    WORDS,
    Entry,
    answer,
    counts_of,
    entries_of,
    repetitions,
)
from hopdata.provenance import version_of
from hopdata.report.formatting import NO_BREAK_SPACE
from hopdata.report.inputs import PERCENT, Picture, picture_of, read_figures, rendered

FOLDER = Path(__file__).parent
# Packages whose versions the page states.
VERSIONS = ("hopdata", "numpy", "scipy", "numba", "mujoco")
_CODE = re.compile("`([^`]+)`")

# Standings whose rows the summary names one by one, the gravest first.
NAMED = ("differs", "partly", MISSING)


@dataclass(frozen=True)
class Shown:
    """A row with its picture.

    Attributes
    ----------
    entry
        The row.
    picture
        Its figure; None if it has none, or an earlier row shows it.
    shown_by
        The row that shows the same figure, if that is another one.
    """

    entry: Entry
    picture: Picture | None = None
    shown_by: Entry | None = None


@dataclass(frozen=True)
class Chapter:
    """A chapter of the dissertation with its rows."""

    number: str
    title: str
    rows: Sequence[Shown]


def build_page(
    items: Sequence[Item], records: Sequence[Record], folders: Mapping[str, Path]
) -> str:
    """Build the page: an HTML document that loads nothing.

    Parameters
    ----------
    items
        What the dissertation states, in the order of the text.
    records
        What the parts found.
    folders
        The folder of each part, which holds its figures.

    Returns
    -------
    str
        The page. What could not be made says so, in its place and in the summary.
    """
    entries = entries_of(items, records)
    counts = counts_of(entries)
    return rendered(
        "dissertation.html.j2",
        own=FOLDER / "templates",
        answer=answer(counts),
        coded=coded,
        chapters=_chapters(entries, folders),
        counts=counts,
        standings=WORDS["standing"],
        named={name: _of(entries, name) for name in NAMED if counts[name]},
        undrawn=[entry for entry in entries if entry.figure_failure is not None],
        repetitions=repetitions(records),
        versions=_versions(),
    )


def coded(text: str) -> Any:
    """Return a sentence for the page: code in backticks, no break before per cent."""
    from markupsafe import Markup, escape

    whole = PERCENT.sub(f"{NO_BREAK_SPACE}%", text)
    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(whole))))


def _versions() -> str:
    """Return the versions with which the page was made."""
    packages = ", ".join(f"{name} {version_of(name)}" for name in VERSIONS)
    return f"{packages}, Python {platform.python_version()}"


def _of(entries: Sequence[Entry], standing: str) -> list[Entry]:
    return [entry for entry in entries if entry.standing == standing]


def _chapters(entries: Sequence[Entry], folders: Mapping[str, Path]) -> list[Chapter]:
    """Return the rows in the order of the text; each figure stands at its first row."""
    chapters = []
    first: dict[tuple[str, str], Entry] = {}
    for number, title in WORDS["chapters"].items():
        rows = []
        for entry in entries:
            if entry.item.chapter == number:
                rows.append(_shown(entry, folders, first))
        if rows:
            chapters.append(Chapter(WORDS["roman"][number], title, rows))
    return chapters


def _shown(
    entry: Entry, folders: Mapping[str, Path], first: dict[tuple[str, str], Entry]
) -> Shown:
    """Return a row with its picture, if no row before it has shown the same one."""
    item = entry.item
    if not item.figure or entry.figure_failure is not None:
        return Shown(entry)
    key = (item.part, item.figure)
    if key in first:
        return Shown(entry, shown_by=first[key])
    first[key] = entry
    if item.part not in folders:
        return Shown(entry)
    files = sorted((folders[item.part] / FIGURES).glob(f"{item.figure}.*"))
    return Shown(entry, picture=_picture(files))


def _picture(files: Sequence[Path]) -> Picture | None:
    """Return a figure for the page, from its files in one or several formats."""
    for figure in read_figures(files, []):
        if figure.image:
            return picture_of(figure, {})
    return None
