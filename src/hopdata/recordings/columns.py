"""Named columns of a text table, as other devices and programs export them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.text_table import is_number

FloatArray = NDArray[np.float64]

DELIMITERS = "\t;,"
MISSING = ("", "NaN", "nan", "NULL", "null")
MOST_LISTED = 12


@dataclass(frozen=True)
class ColumnTable:
    """A text table whose first row names its columns.

    Parameters
    ----------
    path : Path
        The file.
    names : tuple of str
        Column names, in the file's order.
    delimiter : str
        What stands between the cells: a tab, a semicolon or a comma.
    """

    path: Path
    names: tuple[str, ...]
    delimiter: str

    def numbers(self, name: str) -> FloatArray:
        """Read a column of numbers, (N,), NaN where a cell is empty.

        Raises
        ------
        RecordingError
            If there is no such column, or a cell is neither empty nor a finite number.
        """
        import pandas as pd

        place = self.place_of(name)
        try:
            values: FloatArray = pd.read_csv(
                self.path, sep=self.delimiter, header=None, skiprows=1, usecols=[place],
                dtype=np.float64, na_values=list(MISSING), keep_default_na=False,
                skip_blank_lines=False, encoding="utf-8-sig",
            ).to_numpy()[:, 0]  # fmt: skip
        except (ValueError, OverflowError):  # pandas' own errors are ValueErrors
            return self._numbers_one_by_one(name)
        if np.isinf(values).any():
            return self._numbers_one_by_one(name)
        return values[: len(values) - _empty_lines_at_the_end(self.path)]

    def texts(self, name: str) -> list[str]:
        """Read a column as text, without the blanks about its cells; short rows have empty ones.

        Raises
        ------
        RecordingError
            If there is no such column.
        """
        place = self.place_of(name)
        rows = [_cells(line, self.delimiter) for line in _lines(self.path)[1:]]
        while rows and rows[-1] == [""]:
            rows.pop()
        return [_plain(row[place]) if place < len(row) else "" for row in rows]

    def place_of(self, name: str) -> int:
        """Find the number of a column, from 0.

        Raises
        ------
        RecordingError
            If no column has this name, or several have.
        """
        n_found = self.names.count(name)
        if n_found == 1:
            return self.names.index(name)
        found = f"found {n_found} of that name" if n_found else f"found no '{name}'"
        raise RecordingError(
            f"{self.path}, line 1: column: expected '{name}' once among {listed(self.names)}, "
            f"{found}{'' if n_found else did_you_mean(name, self.names)}"
        )

    def _numbers_one_by_one(self, name: str) -> FloatArray:
        """Slowly, with the place of what is no number, and with blanks and quotes about it."""
        cells = self.texts(name)
        values = np.full(len(cells), np.nan)
        for row, cell in enumerate(cells):
            if cell not in MISSING:
                values[row] = self._number(name, row, cell)
        return values

    def _number(self, name: str, row: int, cell: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if np.isfinite(value):
            return value
        comma = "; write decimals with a point" if "," in cell else ""
        raise RecordingError(
            f"{self.path}, line {row + 2}, column '{name}': expected a number, "
            f"found '{cell[:40]}'{comma}"
        )


def open_table(path: str | Path) -> ColumnTable:
    """Read the row of column names.

    Raises
    ------
    RecordingError
        If there is no such file, it is not text, or its first row holds no name.
    """
    path = Path(path)
    if not path.is_file():
        near = did_you_mean(path.name, _names_in(path.parent))
        raise RecordingError(f"{path}: expected a file, found none{near}")
    first = next(iter(_lines(path)), "")
    delimiter = next((mark for mark in DELIMITERS if mark in first), "\t")
    names = tuple(_plain(cell) for cell in _cells(first, delimiter))
    if not any(name and not is_number(name) for name in names):
        raise RecordingError(
            f"{path}, line 1: expected names of columns, found '{first[:40]}'; "
            "write a row of names above the numbers"
        )
    return ColumnTable(path, names, delimiter)


def listed(names: Sequence[str]) -> str:
    """List names for a message, the first dozen of many."""
    more = f", ... {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: expected a text table in UTF-8, found other bytes") from None
    return text.splitlines()


def _cells(line: str, delimiter: str) -> list[str]:
    """Split a line; a delimiter between quotes belongs to its cell."""
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), None) or [""]


def _empty_lines_at_the_end(path: Path) -> int:
    content = path.read_bytes()
    return max(len(content[len(content.rstrip(b"\r\n")) :].splitlines()) - 1, 0)


def _plain(cell: str) -> str:
    return cell.strip().strip('"').strip()


def _names_in(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir()] if folder.is_dir() else []
