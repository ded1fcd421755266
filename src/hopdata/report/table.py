"""A table of the report: cells of text under a title."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from hopdata.report.formatting import is_missing, plain

#: Characters from which a text needs a column wide enough to read.
PROSE = 40


@dataclass(frozen=True)
class Table:
    """Cells of text under a title; all but the first `text_columns` columns are numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: int = 1
    note: str = ""

    def kind(self, column: int) -> str:
        """Class of a column's cells: ``text``, ``prose`` (long texts), ``number`` or ``unit``."""
        if self.head[column] == "unit":
            return "unit"
        if column >= self.text_columns:
            return "number"
        return "prose" if any(len(row[column]) > PROSE for row in self.rows) else "text"


def mapping_table(title: str, head: tuple[str, str], entries: Mapping[str, Any]) -> Table | None:
    """Two columns of text: names and plain values."""
    rows = tuple((key, plain(value)) for key, value in flat(entries))
    return Table(title, head, rows, text_columns=2) if rows else None


def flat(entries: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of nested mappings, the names of the levels joined by spaces."""
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key} ")
        else:
            yield f"{prefix}{key}", value


def scaled(value: Any, factor: float) -> float | None:
    """Product of a value and a factor; None if the value is missing."""
    return None if is_missing(value) else float(value) * factor
