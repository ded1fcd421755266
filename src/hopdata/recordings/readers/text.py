"""Tab-separated rows of numbers below a header, as motion-capture programs export them."""

from __future__ import annotations

import codecs
import csv
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from csv import QUOTE_NONE
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.raw import largest

if TYPE_CHECKING:
    import pandas as pd

BLOCK = 1 << 20  # bytes
ROWS = 20_000  # read at a time
# Programs print what is missing as nothing, in words, or as their C library prints a NaN.
_NAN = ["".join(letters) for letters in product("nN", "aA", "nN")]
TEXT_TABLE_MISSING = (
    *("", "NULL", "Null", "null", "n/a", "N/A", *_NAN, *(f"-{nan}" for nan in _NAN)),
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
        """Read the rows, (N, width), NaN where a field is missing; decimals as in the first row.

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

        with self.path.open("rb") as file:
            file.seek(self.offset)
            decimal = "," if b"," in file.readline() else "."
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)  # text is refused anyway
            try:
                yield from pd.read_csv(
                    self.path, sep="\t", header=None, skiprows=self.n_lines, quoting=QUOTE_NONE,
                    na_values=list(TEXT_TABLE_MISSING), keep_default_na=False,
                    skipinitialspace=True, chunksize=ROWS, decimal=decimal,
                )  # fmt: skip
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


@contextmanager
def readable(path: Path) -> Iterator[BinaryIO]:
    """Open a file to read its bytes.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise RecordingError(
            f"{path}: expected a readable file, found: {error.strerror or error}"
        ) from None


def require_file(path: Path) -> None:
    """Require that there is a file; say which of the folder's files has a similar name.

    Raises
    ------
    RecordingError
        If there is none.
    """
    if path.is_file():
        return
    near = f"; there is no folder {path.parent}"
    if path.parent.is_dir():
        near = did_you_mean(path.name, [p.name for p in path.parent.iterdir()])
    raise RecordingError(f"{path}: expected a file, found none{near}")


def decoded(data: bytes) -> str:
    """Text of a file, which may be older than UTF-8 or in UTF-16."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def only_place(place: str, name: str, names: Sequence[str]) -> int:
    """Find the number, from 0, of a column or channel.

    Raises
    ------
    RecordingError
        If none has this name, or several have; it begins with `place`.
    """
    n_found = names.count(name)
    if n_found == 1:
        return names.index(name)
    found = f"found {n_found} of that name" if n_found else f"found no '{name}'"
    raise RecordingError(
        f"{place}: expected '{name}' once among {listed(names)}, "
        f"{found}{'' if n_found else did_you_mean(name, names)}"
    )


def split_line(path: Path, line: bytes) -> list[str]:
    """Fields of one line; older exports are not in UTF-8.

    Raises
    ------
    RecordingError
        If the line holds binary data.
    """
    if b"\0" in line:
        raise RecordingError(f"{path}: expected tab-separated text, found binary data or UTF-16")
    return [field.strip() for field in decoded(line).split("\t")]


def trimmed(fields: list[str]) -> list[str]:
    """Without the empty fields that some exports leave at a line's end."""
    return fields[: max((i for i, field in enumerate(fields, 1) if field), default=0)]


def is_number(text: str) -> bool:
    """Tell whether a field is a number, with a point."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def pointed(text: str) -> str:
    """Write a number of a header with a point, if its only mark is a comma."""
    return text.replace(",", ".") if text.count(",") == 1 and "." not in text else text


def one_line(text: str) -> str:
    """Without the line ends that other libraries put into their messages."""
    return " ".join(text.split())


def _fault(fields: list[str], width: int) -> str:
    """Say what is wrong with a row, as the end of a message; empty if nothing is."""
    if len(fields) != width:
        return f": expected {width} columns, found {len(fields)}"
    for k, text in enumerate(fields):
        if text.strip(" ") not in TEXT_TABLE_MISSING and (fault := no_number(text)):
            return f", column {k + 1}: {fault}"
    return ""


def no_number(text: str) -> str:
    """Say that a field is no finite number; empty if it is one."""
    if is_number(text) and np.isfinite(float(text)):
        return ""
    comma = "; write decimals with a point" if "," in text else ""
    return f"expected a number, found '{text[:40]}'{comma}"


# Named columns of a text table, as other devices and programs export them.

DELIMITERS = "\t;,"
STORAGE = (".mot", ".sto")  # OpenSim's files, whose columns may be separated by blanks
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
        What stands between the cells: a tab, a semicolon, a comma or, in OpenSim's files, blanks.
    n_lines : int
        Lines up to the names, with theirs.
    decimal : str
        A point or a comma.
    clock : str, optional
        The column that is time, in s, if the format says so.
    """

    path: Path
    names: tuple[str, ...]
    delimiter: str
    n_lines: int = 1
    decimal: str = "."
    clock: str | None = None

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
                self.path, sep=r"\s+" if self.delimiter == " " else self.delimiter, header=None,
                skiprows=self.n_lines, usecols=[place], dtype=np.float64, na_values=list(MISSING),
                keep_default_na=False, skip_blank_lines=False, encoding="utf-8-sig",
                decimal=self.decimal,
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
        rows = [_cells(line, self.delimiter) for line in _lines(self.path)[self.n_lines :]]
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
        return only_place(f"{self.path}, line {self.n_lines}: column", name, self.names)

    def _numbers_one_by_one(self, name: str) -> FloatArray:
        """Slowly, with the place of what is no number, and with blanks and quotes about it."""
        cells = [cell.replace(self.decimal, ".") for cell in self.texts(name)]
        for row, cell in enumerate(cells):
            if cell not in MISSING and (fault := no_number(cell)):
                place = f"{self.path}, line {self.n_lines + row + 1}, column '{name}'"
                raise RecordingError(f"{place}: {fault}")
        return np.array([np.nan if cell in MISSING else float(cell) for cell in cells])


def open_table(path: str | Path) -> ColumnTable:
    """Read the row of column names, in OpenSim's files that below the line ``endheader``.

    Raises
    ------
    RecordingError
        If there is no such file, it is not text, or its first row holds no name.
    """
    path = Path(path)
    require_file(path)
    lines, n_above = _lines(path), 0
    is_storage = path.suffix.lower() in STORAGE
    if is_storage:
        header = [line.strip().lower() for line in lines]
        if "endheader" not in header:
            raise RecordingError(f"{path}: expected a line endheader, found none")
        n_above = header.index("endheader") + 1
    first, second = [*lines[n_above : n_above + 2], "", ""][:2]
    marks = DELIMITERS + " " * is_storage
    delimiter = next((mark for mark in marks if mark in first.strip()), "\t")
    decimal = "," if delimiter != "," and "," in second else "."
    names = tuple(_plain(cell) for cell in _cells(first, delimiter))
    if not any(name and not is_number(name) for name in names):
        raise RecordingError(
            f"{path}, line {n_above + 1}: expected names of columns, found '{first[:40]}'; "
            "write a row of names above the numbers"
        )
    clock = next((name for name in names if is_storage and name.lower() == "time"), None)
    return ColumnTable(path, names, delimiter, n_above + 1, decimal, clock)


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
    if delimiter == " ":
        return line.split() or [""]
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), None) or [""]


def _empty_lines_at_the_end(path: Path) -> int:
    content = path.read_bytes()
    return max(len(content[len(content.rstrip(b"\r\n")) :].splitlines()) - 1, 0)


def _plain(cell: str) -> str:
    return cell.strip().strip('"').strip()
