"""Tab-separated rows of numbers below a header, as motion-capture programs export them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from csv import QUOTE_NONE
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hopdata.errors import RecordingError
from hopdata.recordings.raw import FloatArray, largest

if TYPE_CHECKING:
    import pandas as pd

BLOCK = 1 << 20  # bytes
ROWS = 20_000  # read at a time
# Programs print what is missing as nothing, in words, or as their C library prints a NaN.
_NAN = ["".join(letters) for letters in product("nN", "aA", "nN")]
MISSING = (
    *("", "NULL", "Null", "null", *_NAN, *(f"-{nan}" for nan in _NAN)),
    *("nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND"),
)


@dataclass(frozen=True)
class Rows:
    """Where the rows of numbers stand: from byte `offset` of a file, after `n_lines` lines.

    Each has `width` fields.
    """

    path: Path
    n_lines: int
    offset: int
    width: int

    def numbers(self) -> FloatArray:
        """Read the rows, (N, width), NaN where a field is missing.

        pandas pads short rows in silence but refuses long ones. So if no row is too long and the
        number of tabs is right in total, every row is right.

        Raises
        ------
        RecordingError
            Naming the line and column of the first field that is no finite number, or the first
            row that is too short or too long.
        """
        n_tabs, is_text = self._survey()
        n_empty, n_idle = self._empty_lines_at_the_end()
        n_tabs -= n_idle
        table = np.empty((n_tabs // max(self.width - 1, 1) + n_empty, self.width))
        n = 0
        for frame in self._frames():
            if any(kind.kind not in "iuf" for kind in frame.dtypes):
                raise self._bad_row("text between the numbers")
            if frame.shape[1] != self.width or n + len(frame) > len(table):
                raise self._bad_row(f"rows of {frame.shape[1]} fields")
            table[n : n + len(frame)] = frame
            n += len(frame)
        n -= n_empty
        if not is_text or n_tabs != n * (self.width - 1) or np.isinf(largest(table[:n])):
            raise self._bad_row(f"{n} rows with {n_tabs} tabs")
        return table[:n]

    def _frames(self) -> Iterator[pd.DataFrame]:
        """Read by pandas, which finds the kind of each column faster than it obeys a given one."""
        import pandas as pd

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)  # text is refused anyway
            try:
                yield from pd.read_csv(
                    self.path,
                    sep="\t",
                    header=None,
                    skiprows=self.n_lines,
                    na_values=list(MISSING),
                    keep_default_na=False,
                    quoting=QUOTE_NONE,
                    skipinitialspace=True,
                    chunksize=ROWS,
                )
            except (ValueError, OverflowError) as error:  # pandas' own errors are ValueErrors
                raise self._bad_row(str(error)) from None

    def _empty_lines_at_the_end(self) -> tuple[int, int]:
        """Count the last lines that hold tabs and nothing else, and are no row, and their tabs."""
        with self.path.open("rb") as file:
            file.seek(max(self.offset, self.path.stat().st_size - BLOCK))
            lines = file.read().splitlines()
        empty = []
        while lines and not lines[-1].strip() and lines[-1].count(b"\t") != self.width - 1:
            empty.append(lines.pop().count(b"\t"))
        return sum(map(bool, empty)), sum(empty)

    def line(self, row: int) -> str:
        """File and line of a row, for messages; rows count from 0."""
        return f"{self.path}, line {self.n_lines + 1 + row}"

    def _survey(self) -> tuple[int, bool]:
        """Count the tabs, and tell whether there are no control characters."""
        n_tabs, is_text = 0, True
        with self.path.open("rb") as file:
            file.seek(self.offset)
            while block := file.read(BLOCK):
                codes = np.frombuffer(block, dtype=np.uint8)
                n_tabs += int(np.count_nonzero(codes == ord("\t")))
                is_text &= bool(codes.min() >= ord("\t"))
        return n_tabs, is_text

    def _bad_row(self, cause: str) -> RecordingError:
        """Find the first row that is not `width` numbers, and say so."""
        with self.path.open("rb") as file:
            file.seek(self.offset)
            number = self.n_lines
            for line in file:
                number += 1
                fields = line.decode("latin-1").rstrip("\r\n").split("\t")
                if fields != [""] and (fault := _fault(fields, self.width)):
                    cut = "" if file.read(1) else "; the file ends here, was it cut short?"
                    return RecordingError(f"{self.path}, line {number}{fault}{cut}")
        return RecordingError(
            f"{self.path}: expected rows of {self.width} numbers, found {one_line(cause)}"
        )


def require_counters(rows: Rows, values: FloatArray, names: list[str]) -> None:
    """Require that the columns (N, C) before the coordinates have a number in each row.

    Raises
    ------
    RecordingError
        Naming line and column.
    """
    bad = np.argwhere(np.isnan(values))
    if len(bad):
        row, column = bad[0]
        raise RecordingError(
            f"{rows.line(row)}: {names[column]}: expected a number, found a missing value"
        )


def blank_unseen(positions: FloatArray) -> None:
    """Set markers (in place) to NaN in the frames in which the file says they were not seen.

    Those are frames in which a coordinate is missing, or all three are 0.
    """
    x, y, z = (positions[:, :, axis] for axis in range(3))
    unseen = (x == 0) & (y == 0) & (z == 0)
    unseen |= np.isnan(x + y + z)
    positions[unseen] = np.nan


def split_line(path: Path, line: bytes) -> list[str]:
    """Fields of one line; older exports are not in UTF-8.

    Raises
    ------
    RecordingError
        If the line holds binary data.
    """
    if b"\0" in line:
        raise RecordingError(f"{path}: expected tab-separated text, found binary data or UTF-16")
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = line.decode("latin-1")
    return [f.strip() for f in text.split("\t")]


def trimmed(fields: list[str]) -> list[str]:
    """Without the empty fields that some exports leave at a line's end."""
    n = len(fields)
    while n and not fields[n - 1]:
        n -= 1
    return fields[:n]


def is_number(text: str) -> bool:
    """Tell whether a field is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def one_line(text: str) -> str:
    """Without the line ends that other libraries put into their messages."""
    return " ".join(text.split())


def _fault(fields: list[str], width: int) -> str:
    """Say what is wrong with a row, as the end of a message; empty if nothing is."""
    if len(fields) != width:
        return f": expected {width} columns, found {len(fields)}"
    for k, text in enumerate(fields):
        if text.strip(" ") not in MISSING and not (is_number(text) and np.isfinite(float(text))):
            comma = "; write decimals with a point" if "," in text else ""
            return f", column {k + 1}: expected a number, found '{text[:40]}'{comma}"
    return ""
