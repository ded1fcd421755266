"""The page's table as a document in Markdown, for `docs/dissertation.md`."""

from __future__ import annotations

from collections.abc import Sequence

from hopdata.dissertation.items import Item
from hopdata.dissertation.making import Record
from hopdata.dissertation.report.entries import (
    WORDS,
    Entry,
    answer,
    counts_of,
    entries_of,
    repetitions,
)

HEAD = (
    "no.",
    "item",
    "the dissertation prints",
    "the printed method here",
    "hopdata's method",
    "agreement",
    "why",
)
INTRODUCTION = """\
After this page you know what each result of the dissertation *C1-Smooth Multi-Contact
Dynamics for Robotics* prints, and what the printed method and hopdata's own give here.

`snakemake --cores 2 dissertation` measures every number, and makes the same table with
figures in `results/dissertation/index.html`. A study with `printed: true` uses all
printed methods."""


def build_document(items: Sequence[Item], records: Sequence[Record]) -> str:
    """Build the document.

    Parameters
    ----------
    items
        What the dissertation states, in the order of the text.
    records
        What the parts found.

    Returns
    -------
    str
        Markdown: a table for each section of the text.
    """
    entries = entries_of(items, records)
    lines = ["# The dissertation beside hopdata", "", INTRODUCTION, ""]
    lines += [f"**{answer(counts_of(entries))}**", ""]
    lines += [*_meanings(), ""]
    number = repetitions(records)
    if number > 1:
        told = f"Random numbers are medians over {number} seeds, with their range."
        lines += [told, ""]
    chapter = ""
    section = ""
    for entry in entries:
        if entry.item.chapter != chapter:
            chapter = entry.item.chapter
            title = WORDS["chapters"][chapter]
            lines += ["", f"## Chapter {WORDS['roman'][chapter]}: {title}"]
        if section_of(entry.item) != section:
            section = section_of(entry.item)
            rule = ["---"] * len(HEAD)
            lines += ["", f"### Section {section}", "", _line(HEAD), _line(rule)]
        lines.append(_line(_cells(entry)))
    return "\n".join(_without_doubled(lines)) + "\n"


def _meanings() -> list[str]:
    """Return a line for each sign: its word, and what it means."""
    lines = []
    for standing in WORDS["standing"].values():
        lines.append(f"- {standing['sign']} {standing['word']}: {standing['meaning']}")
    return lines


def section_of(item: Item) -> str:
    """Return the section under which an item stands: the first two numbers."""
    return ".".join(str(number) for number in item.place[:2])


def stated(item: Item) -> tuple[str, str, str]:
    """Return the cells of an item that hold no result: number, item, printed."""
    where = item.where
    if "`" not in where:
        where = f"`{where}`"
    title = f"{item.title} (Sec. {item.section}; {where})"
    return str(item.number), _cell(title), _cell(item.printed)


def _cells(entry: Entry) -> tuple[str, ...]:
    if entry.failure is not None:
        found = (_cell(str(entry.failure)), "")
    else:
        found = (_cell(entry.printed_method), _cell(entry.ours))
    return (*stated(entry.item), *found, f"{entry.sign} {entry.word}", _cell(entry.why))


def _cell(text: str) -> str:
    """Return a text that stays within its cell."""
    return " ".join(text.split()).replace("|", "\\|")


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _without_doubled(lines: Sequence[str]) -> list[str]:
    """Drop an empty line after an empty line."""
    kept: list[str] = []
    for line in lines:
        if line or not kept or kept[-1]:
            kept.append(line)
    return kept
