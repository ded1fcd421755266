"""What the dissertation states, item by item: the words, without any result."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from hopdata.errors import ConfigError

FOLDER = Path(__file__).parent

# The dissertation has this many items.
NUMBER_OF_ITEMS = 100

# The number of a section, with which the place of an item begins.
_SECTION = re.compile(r"\d+(\.\d+)+")


@dataclass(frozen=True)
class Item:
    """One item of the dissertation.

    Attributes
    ----------
    number
        1 to 100; its name, by which code and pages refer to it.
    part
        The part that measures it.
    section
        Where it stands, such as ``"4.4.2"`` or ``"4.4.2, Fig. 4.2"``.
    title
        What it is.
    printed
        What the dissertation states, with its numbers.
    where
        The module, rule or key of hopdata in which it lives.
    printed_method
        What the printed method gives here; numbers in braces are the row's values.
    ours
        What hopdata's own method gives.
    figure
        One of the part's figures; empty if the item has none.
    figure_printed
        What the printed figure shows: axes, categories, order.
    figure_read
        How to read the figure, where a reader may take it for more than it says.
    reasons
        Sentences that say why print and result do not agree, by name.
    """

    number: int
    part: str
    section: str
    title: str
    printed: str
    where: str
    printed_method: str = ""
    ours: str = ""
    figure: str = ""
    figure_printed: str = ""
    figure_read: str = ""
    reasons: Mapping[str, str] = field(default_factory=dict)

    @property
    def place(self) -> tuple[int, ...]:
        """The numbers of chapter, section and subsection."""
        found = _SECTION.match(self.section)
        return tuple(int(number) for number in found[0].split(".")) if found else ()

    @property
    def chapter(self) -> str:
        """The number of its chapter."""
        return str(self.place[0])


def part_names(folder: Path = FOLDER) -> list[str]:
    """Return the parts that have items."""
    return sorted(file.stem for file in folder.glob("*.toml"))


def read_items(folder: Path = FOLDER) -> list[Item]:
    """Return the items of all parts, in the order of the text.

    Raises
    ------
    ConfigError
        If an entry lacks a field or has an unknown one, or two have the same number.
    """
    items: dict[int, Item] = {}
    for name in part_names(folder):
        for item in read_part(name, folder):
            if item.number in items:
                other = items[item.number].part
                place = f"items/{name}.toml: item {item.number}"
                raise ConfigError.at(place, "one entry", f"another in {other}.toml")
            items[item.number] = item
    return sorted(items.values(), key=lambda item: (item.place, item.number))


def read_part(name: str, folder: Path = FOLDER) -> list[Item]:
    """Return the items of one part, in the order of its file; none without a file."""
    file = folder / f"{name}.toml"
    if not file.is_file():
        return []
    content = tomllib.loads(file.read_text("utf-8"))
    return [_item(name, entry) for entry in content.get("item", [])]


def _item(part: str, entry: Mapping[str, Any]) -> Item:
    place = f"items/{part}.toml: item {entry.get('number', '?')}"
    known = {one.name for one in fields(Item)} - {"part"}
    unknown = sorted(set(entry) - known)
    if unknown:
        raise ConfigError.at(place, f"fields among {', '.join(known)}", unknown)
    for name in ("number", "section", "title", "printed", "where"):
        if not entry.get(name):
            raise ConfigError.at(f"{place}: {name}", "a value", "none")
    if not _SECTION.match(str(entry["section"])):
        wanted = "a text that begins with a section's number, such as 4.4.2"
        raise ConfigError.at(f"{place}: section", wanted, repr(entry["section"]))
    if entry.get("figure") and not entry.get("figure_printed"):
        wanted = "what the printed figure shows"
        raise ConfigError.at(f"{place}: figure_printed", wanted, "none")
    return Item(part=part, **entry)
