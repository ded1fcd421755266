"""Numbers as readers expect them: few digits, true minus signs, units beside them."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from hopdata.arrays import pd
from hopdata.messages import Message

MISSING = "—"
MINUS = "−"
NARROW_SPACE = "\u202f"
NO_BREAK_SPACE = "\u00a0"
# The largest p-value that is told as it is.
MOST_P = 0.99
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

#: Texts that readers see in place of names.
WORDS: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("words.toml").read_text("utf-8")
)

#: Captions of pictures that commands make.
NOTES = {"seen": str(Message("report.seen"))}


def is_missing(value: Any) -> bool:
    """Return whether a value is absent: None, NaN or infinite."""
    if value is None:
        return True
    try:
        return not math.isfinite(value)
    except TypeError:
        return False


def significant(value: Any, digits: int = 3) -> str:
    """Format a number to `digits` significant digits; a dash if it is missing."""
    if is_missing(value):
        return MISSING
    number = float(value)
    is_whole = number == int(number) and abs(number) < 10**15
    if is_whole or abs(number) >= 10**digits:
        return count(number)
    if abs(number) >= 1e-4:
        return f"{number:.{digits}g}".replace("-", MINUS)
    mantissa, exponent = f"{number:.{digits - 1}e}".split("e")
    power = str(int(exponent)).translate(RAISED)
    return f"{mantissa.replace('-', MINUS)} × 10{power}"


def p_value(value: Any) -> str:
    """Format a p-value to two digits; one that would be rounded to 1 as above 0.99."""
    if not is_missing(value) and float(value) > MOST_P:
        return f">{MOST_P:g}"
    return significant(value, 2)


def told_p_value(value: Any) -> str:
    """Format a p-value as in a sentence: ``p = 0.03``, or ``p >0.99``."""
    text = p_value(value)
    if text.startswith(">"):
        return f"p {text}"
    return f"p = {text}"


def fixed(value: Any, decimals: int) -> str:
    """Format with this many decimals, digits grouped from 10 000 on, or a dash."""
    if is_missing(value):
        return MISSING
    text = f"{float(value):,.{decimals}f}".replace("-", MINUS)
    if abs(value) >= 10_000:
        return text.replace(",", NARROW_SPACE)
    return text.replace(",", "")


def count(value: Any) -> str:
    """Format a whole number."""
    return fixed(value, 0)


def with_unit(text: str, unit: str) -> str:
    """Join a formatted number and its unit without a line break between them."""
    if text == MISSING or not unit:
        return text
    return f"{text}{NO_BREAK_SPACE}{unit}"


def percent(number: float) -> str:
    """Format the heading of a quantile."""
    return with_unit(f"{number:g}", "%")


def plain(value: Any) -> str:
    """Format any plain value: yes or no for booleans, JSON for lists and mappings."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if is_missing(value):
        return MISSING
    if isinstance(value, float):
        return significant(value, 4)
    if isinstance(value, int):
        return str(value)  # a seed or a version is not a quantity: no digit grouping
    if isinstance(value, str):
        return value
    return json.dumps(value, ensure_ascii=False)


def labelled(key: str, value: Any) -> tuple[str, str, str]:
    """Return words, value and displayed unit of a key in SI: ``pre_height_m`` in mm."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    for suffix, unit, factor in WORDS["units"]:
        if is_number and key.endswith(suffix):
            name = key.removesuffix(suffix).replace("_", " ")
            return name, significant(value * factor), unit
    if _is_numbers(value):
        return _labelled_numbers(key, value)
    last_level = key.rpartition(" ")[2]
    text = plain(value)
    if last_level.startswith("n_") and isinstance(value, int):
        text = count(value)
    return key.replace("_", " "), text, ""


def _is_numbers(value: Any) -> bool:
    """Return whether a value is a list of numbers."""
    if not isinstance(value, list | tuple) or not value:
        return False
    return all(isinstance(one, int | float) for one in value)


def _labelled_numbers(key: str, values: Sequence[float]) -> tuple[str, str, str]:
    """Return words, values and displayed unit of a key with several numbers in SI."""
    for suffix, unit, factor in WORDS["units"]:
        if key.endswith(suffix):
            name = key.removesuffix(suffix).replace("_", " ")
            return name, _several(values, factor), unit
    return key.replace("_", " "), _several(values), ""


def _several(values: Sequence[float], factor: float = 1.0) -> str:
    return ", ".join(significant(value * factor) for value in values)


def common_scale(values: Sequence[float | None]) -> tuple[float, str]:
    """Return the power of 1000 that brings all values to 1 or more, and its text.

    >>> common_scale([0.00195, 0.03])
    (0.001, '10⁻³ ')
    """
    sizes = [abs(value) for value in values if value and not is_missing(value)]
    if not sizes or min(sizes) >= 1:
        return 1.0, ""
    power = 3 * math.floor(math.log10(min(sizes)) / 3)
    return 10.0**power, f"10{str(power).translate(RAISED)} "


def words(items: Sequence[str]) -> str:
    """Join words as in a sentence: ``a``, ``a and b``, ``a, b and c``."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


# A table of the report: cells of text under a title.

# Length in characters above which a text needs a wide column.
PROSE = 40


@dataclass(frozen=True)
class Table:
    """Cells under a title; all but the first `text_columns` columns are numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: int = 1
    note: Message | str = ""

    def kind(self, column: int) -> str:
        """Return a column's class: text, prose (long texts), number or unit."""
        if self.head[column] == "unit":
            return "unit"
        if column >= self.text_columns:
            return "number"
        longest = max((len(row[column]) for row in self.rows), default=0)
        return "prose" if longest > PROSE else "text"


def mapping_table(
    title: str, head: tuple[str, str], entries: Mapping[str, Any]
) -> Table | None:
    """Return a table with two columns of text: names and plain values."""
    rows = tuple((key, plain(value)) for key, value in flat(entries))
    if not rows:
        return None
    return Table(title, head, rows, text_columns=2)


def flat(entries: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values of nested mappings; spaces join the names of levels."""
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key} ")
        else:
            yield f"{prefix}{key}", value


def scaled(value: Any, factor: float) -> float | None:
    """Multiply a value by a factor; None if the value is missing."""
    if is_missing(value):
        return None
    return float(value) * factor


# Tables built column by column: a function makes the cell of each row under a heading.

Row: TypeAlias = Mapping[Any, Any]
Cell: TypeAlias = Callable[[Row], str]
Columns: TypeAlias = Mapping[str, Cell]


def text(key: str) -> Cell:
    """Return a function that shows a text, or a dash if there is none."""

    def cell(row: Row) -> str:
        value = row.get(key)
        if value == "" or is_missing(value):
            return MISSING
        return str(value)

    return cell


def counted(key: str) -> Cell:
    """Return a function that shows a whole number."""
    return lambda row: count(row.get(key))


def decimals(key: str, digits: int, factor: float = 1.0) -> Cell:
    """Return a function that shows a number times a factor, to `digits` decimals."""
    return lambda row: fixed(scaled(row.get(key), factor), digits)


def table_of(
    title: str,
    rows: Iterable[Row],
    columns: Columns,
    *,
    text_columns: int = 1,
    note: Message | str = "",
) -> Table | None:
    """Return a table with a line for each row, or None if there are no rows."""
    lines = []
    for row in rows:
        lines.append(tuple(cell(row) for cell in columns.values()))
    if not lines:
        return None
    return Table(title, tuple(columns), tuple(lines), text_columns, note)


def records(frame: pd.DataFrame | None) -> list[dict[Any, Any]]:
    """Return the rows of a table; none if it is missing."""
    if frame is None:
        return []
    return frame.to_dict("records")


def first_rows(
    title: str,
    frame: pd.DataFrame | None,
    columns: Columns,
    most: int,
    name: str,
    texts: int,
) -> Table | None:
    """Return a table of the first rows; a note counts the rest and names the file."""
    rows = records(frame)
    note: Message | str = ""
    if len(rows) > most:
        rest = count(len(rows) - most)
        note = Message("report.more_rows", {"count": rest, "file": name})
    return table_of(title, rows[:most], columns, text_columns=texts, note=note)
