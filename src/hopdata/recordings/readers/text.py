"""Text tables: lines of fields, rows of numbers below a header, and columns by name."""

import codecs
import csv
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice, product, takewhile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.budget import LONGEST_LINE, MOST_CELLS, MOST_COLUMNS

BLOCK = 1 << 20  # bytes
ROWS = 20_000  # rows read at a time
_WINDOW, _APART = 1 << 15, 1 << 19  # bytes; together less than `LONGEST_LINE`
MARKS = "\t;,"  # field separators, the most likely first
# Programs write missing values as nothing, in words, or as their C library's NaN.
_NAN = ["".join(letters) for letters in product("nN", "aA", "nN")]
TEXT_TABLE_MISSING = (
    *(
        "",
        "NULL",
        "Null",
        "null",
        "n/a",
        "N/A",
        "NA",
        "<NA>",
        *_NAN,
        *(f"-{nan}" for nan in _NAN),
    ),
    *("nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND"),
)
CUT = "; the file ends here, was it cut short? export it again, or delete the last line"
HELD = "\x1f"  # placeholder for a separator within a field


@contextmanager
def readable(path: Path, *, is_text: bool = True) -> Iterator[BinaryIO]:
    """Open a file to read its bytes; convert a text in UTF-16 to UTF-8, and CR line ends to LF.

    Raises
    ------
    RecordingError
        If it cannot be read, or has a line longer than any of a sound file.
    """
    try:
        with path.open("rb") as file:
            if not is_text:
                yield file
                return
            begin = file.read(BLOCK)
            is_wide = begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
            if is_wide or (b"\r" in begin and not {*b"\n\0"} & {*begin}):
                wide = decoded(begin + file.read())
                narrow = io.BytesIO(
                    wide.replace("\r\n", "\n").replace("\r", "\n").encode()
                )
                del wide
                _require_lines(path, narrow)
                yield narrow
                return
            _require_lines(path, file)
            yield file
    except OSError as error:
        told = error.strerror or error
        raise RecordingError(
            f"{path}: expected a readable file, found: {told}"
        ) from None


def _require_lines(path: Path, file: BinaryIO) -> None:
    """Refuse a file with a line that is longer than any of a sound file.

    A longer line holds a whole window between two of the places looked at. So a look at
    a part of the file suffices, unless a window has no line end.
    """
    n_bytes = file.seek(0, os.SEEK_END)
    for at in range(0, n_bytes - _WINDOW, _APART):
        file.seek(at)
        if b"\n" not in file.read(_WINDOW):
            break
    else:
        file.seek(0)
        return
    begun = read = 0  # begun: where the line begins in which the last block ended
    file.seek(0)
    while block := file.read(BLOCK):
        first = block.find(b"\n")
        known = read + (len(block) if first < 0 else first)
        if known - begun > LONGEST_LINE:
            wanted = f"lines of at most {LONGEST_LINE:,} bytes"
            raise RecordingError.at(
                path, wanted, "a longer one; is this one recording's table?"
            )
        if first >= 0:
            begun = read + block.rfind(b"\n") + 1
        read += len(block)
    file.seek(0)


def first_lines(file: BinaryIO, most: int) -> list[bytes]:
    """Return the first lines of a file; fewer than `most` if they are very long."""
    lines: list[bytes] = []
    n_bytes = 0
    for line in islice(file, most):
        lines.append(line)
        n_bytes += len(line)
        if n_bytes > 4 * LONGEST_LINE:
            break
    return lines


def require_file(path: Path) -> None:
    """Require a file to exist; otherwise suggest one in the folder with a similar name.

    Raises
    ------
    RecordingError
        If it does not exist.
    """
    if path.is_file():
        return
    near = f"; there is no folder {path.parent}"
    if path.parent.is_dir():
        near = did_you_mean(path.name, [p.name for p in path.parent.iterdir()])
    raise RecordingError.at(path, "a file", f"none{near}")


def decoded(data: bytes) -> str:
    """Decode the text of a file, which may be in UTF-16 or an encoding older than UTF-8."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def mark_between(lines: Sequence[str]) -> str:
    """Return the field separator: a tab if half of the first lines have one."""
    if 2 * sum("\t" in line for line in lines) >= sum(
        bool(line.strip()) for line in lines
    ):
        return "\t"
    return max(";,", key="".join(lines).count)


def fields_of(line: str, mark: str = "\t") -> list[str]:
    """Split a line into fields, stripped; a separator in quotes belongs to its field.

    If the separator is a blank, it stands for any number of blanks.
    """
    if mark == " ":
        return line.split() or [""]
    fields = line.rstrip("\r\n").split(mark)
    if '"' in line:
        with suppress(csv.Error):  # a field of more than 131,072 characters
            fields = next(
                csv.reader([line], delimiter=mark, skipinitialspace=True), [""]
            )
    return [field.strip() for field in fields] or [""]


def split_line(path: Path, line: bytes, mark: str = "\t") -> list[str]:
    """Split a line of bytes into fields; with tabs, a quote is an ordinary character.

    Raises
    ------
    RecordingError
        If the line contains binary data.
    """
    if b"\0" in line:
        raise RecordingError.at(path, "text", "binary data")
    if mark == "\t":
        return [field.strip() for field in decoded(line).split(mark)]
    return fields_of(decoded(line), mark)


def trimmed(fields: list[str]) -> list[str]:
    """Remove the empty fields that some exports leave at the end of a line."""
    return fields[: max((i for i, field in enumerate(fields, 1) if field), default=0)]


def is_number(text: str) -> bool:
    """Tell whether a field is a number with a decimal point."""
    with suppress(ValueError):
        float(text)
        return True
    return False


def pointed(text: str) -> str:
    """Replace the comma in a header's number by a point, if it is the only mark."""
    return text.replace(",", ".") if text.count(",") == 1 and "." not in text else text


def no_number(text: str) -> str:
    """Describe a field that is not a finite number; empty if it is one."""
    if is_number(text) and np.isfinite(float(text)):
        return ""
    comma = "; write decimals with a point" if "," in text else ""
    return f"expected a number, found {text[:40]!r}{comma}"


def stated_number(place: str, key: str, field: str) -> float | None:
    """Return the number stated under a key of a header; None if there is none.

    Raises
    ------
    RecordingError
        If the value is not a number.
    """
    stated = pointed(field)
    if stated and (fault := no_number(stated)):
        raise RecordingError(f"{place}: {key}: {fault}")
    return float(stated) if stated else None


def one_line(text: str) -> str:
    """Remove the line ends that other libraries put into their messages."""
    return " ".join(text.split())


# Rows of numbers in a file that may be too large to hold twice in memory.


@dataclass(frozen=True)
class Rows:
    """Location of rows of fields: after `offset` bytes and `n_lines` lines of a text.

    Parameters
    ----------
    path : Path
        The file.
    n_lines, offset : int
        Lines and bytes before the first row.
    width : int
        Number of fields in each row.
    mark : str
        Field separator: one of `MARKS`, or blanks.
    may_be_short : bool
        Whether fields lacking at the end of a row are missing values rather than a
        fault.
    is_section : bool
        Whether an empty line ends the rows.
    needed : int, optional
        Number of fields that are read, if rows may be shorter or longer than `width`
        beyond them. Fields beyond `width` must be empty.
    """

    path: Path
    n_lines: int
    offset: int
    width: int
    mark: str = "\t"
    may_be_short: bool = False
    is_section: bool = False
    needed: int | None = None

    def line(self, row: int) -> str:
        """Return file and line of a row, for messages; rows count from 0."""
        return f"{self.path}, line {self.n_lines + 1 + row}"

    def numbers(self, *columns: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read an array (N, C) for each list of columns, NaN where a field is missing.

        The decimal mark is that of the first row. Rows at the end in which all columns
        of the first list are missing are dropped.

        Raises
        ------
        RecordingError
            Naming line and column of the first field that is not a finite number, or
            the first row that is too short or too long.
        """
        if self.width > MOST_COLUMNS:
            wanted = f"at most {MOST_COLUMNS:,} columns"
            raise RecordingError.at(self.line(0), wanted, f"{self.width:,}")
        if (most := 1 + max(map(max, filter(len, columns)))) > self.width:
            raise RecordingError.at(self.line(0), f"{most} columns", self.width)
        with readable(self.path) as file:
            n_lines = self._count(file)
            tables = tuple(np.empty((n_lines, len(of))) for of in columns)
            n, has_commas = 0, False
            for number, rows, is_last in self._blocks(file):
                has_commas = (
                    b"," in rows[0] and self.mark != "," if n == 0 else has_commas
                )
                if has_commas:
                    rows = [row.replace(b",", b".") for row in rows]
                values = self._values(number, rows, columns, is_last)
                for table, part in zip(tables, values, strict=True):
                    table[n : n + len(rows)] = part
                n += len(rows)
        while n and len(columns[0]) and np.isnan(tables[0][n - 1]).all():
            n -= 1
        if not n and not self.may_be_short:
            raise RecordingError.at(
                self.path, "rows of numbers after the header", "none"
            )
        return tuple(table[:n] for table in tables)

    def markers(
        self, counters: Sequence[str], coordinates: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Read the counters (N, C) in the first columns and positions (N, M, 3), NaN where missing.

        Raises
        ------
        RecordingError
            As `numbers`, or if a counter is missing.
        """
        counted, flat = self.numbers(range(len(counters)), coordinates)
        bad = np.argwhere(np.isnan(counted))
        if len(bad):
            row, column = bad[0]
            found = "a missing value"
            raise RecordingError.at(
                f"{self.line(row)}: {counters[column]}", "a number", found
            )
        return counted, flat.reshape(len(flat), -1, 3)

    def texts(self, column: int) -> list[str]:
        """Read a column as text, unchanged."""
        with readable(self.path) as file:
            rows = [row for _, block, _ in self._blocks(file) for row in block]
        fields = (self._fields(row)[column] for row in rows)
        return [field.replace(HELD, self.mark) for field in fields]

    def _fields(self, row: bytes) -> list[str]:
        """Split a row into `width` fields; missing ones are empty.

        Only where blanks separate the fields can any be missing here: a row ends in
        none.
        """
        fields = fields_of(decoded(row), self.mark)
        return fields + [""] * (self.width - len(fields))

    def _count(self, file: BinaryIO) -> int:
        """Return the most rows possible, given the lines and the fewest bytes that fields take."""
        file.seek(self.offset)
        n_lines = n_bytes = 0
        while block := file.read(BLOCK):
            n_lines, n_bytes = n_lines + block.count(b"\n"), n_bytes + len(block)
        fewest = self.width if self.needed is None else self.needed
        return min(n_lines, n_bytes // (1 if self.may_be_short else fewest)) + 1

    def _blocks(self, file: BinaryIO) -> Iterator[tuple[int, list[bytes], bool]]:
        """Yield the first line's number, rows of `width` fields, and whether the file ends here.

        Empty lines are skipped. If rows may be short, empty lines before another row
        count as rows.
        """
        file.seek(self.offset)
        mark, number, idle = self.mark.encode(), self.n_lines + 1, 0
        in_section = takewhile(lambda line: line.strip(b" ,;\t\r\n"), file)
        most = max(1, min(ROWS, MOST_CELLS // self.width))
        while lines := list(islice(in_section if self.is_section else file, most)):
            n_lines, is_last = len(lines), len(lines) < most
            if idle and (lines := [b"\n"] * idle + lines):
                number, idle = number - idle, 0
            while lines and self.may_be_short and not lines[-1].strip():
                lines.pop()
                idle += 1
            if any(
                line.count(mark) != self.width - 1 or b'"' in line for line in lines
            ):
                last = len(lines) - 1 if is_last else -1
                fitted = (
                    self._fitted(one, number + k, k == last)
                    for k, one in enumerate(lines)
                )
                lines = list(filter(None, fitted))
            if lines:
                yield number, lines, is_last
            number += n_lines

    def _fitted(self, line: bytes, number: int, is_last: bool) -> bytes:
        """Return a row with the right number of separators; nothing for an empty line."""
        mark = self.mark.encode()
        is_row = line.count(mark) == self.width - 1 or self.may_be_short
        if not (is_row or line.strip(mark + b" \t\r\n")):
            return b""
        fields = [
            f.replace(self.mark, HELD)
            for f in fields_of(line.decode("latin-1"), self.mark)
        ]
        fewest = self.width
        if self.needed is not None:
            fewest = self.needed
            if not any(fields[self.width :]):
                fields = fields[: self.width]
        if len(fields) > self.width or (len(fields) < fewest and not self.may_be_short):
            place, cut = f"{self.path}, line {number}", CUT * is_last
            raise RecordingError.at(
                place, f"{self.width} columns", f"{len(fields)}{cut}"
            )
        fields += [""] * (self.width - len(fields))
        return (self.mark.join(fields) + "\n").encode("latin-1")

    def _values(
        self,
        number: int,
        rows: list[bytes],
        columns: Sequence[Sequence[int]],
        is_last: bool,
    ) -> list[FloatArray]:
        """Read with pandas, which infers a column's type faster than it applies a given one."""
        block, wanted = b"".join(rows), sorted({c for of in columns for c in of})
        cause = "other text"
        try:
            frame = pd.read_csv(
                io.BytesIO(block), sep=self.mark, header=None, usecols=wanted,
                quoting=csv.QUOTE_NONE, na_values=list(TEXT_TABLE_MISSING), keep_default_na=False,
                skipinitialspace=True, skip_blank_lines=False, low_memory=False, encoding="latin-1",
            )  # fmt: skip
            is_text = min(block) >= ord("\t") and len(frame) == len(rows)
            if is_text and all(kind.kind in "iuf" for kind in frame.dtypes):
                found = [frame[list(of)].to_numpy(np.float64) for of in columns]
                if not any(np.isinf(part).any() for part in found):
                    return found
        except (
            ValueError,
            OverflowError,
        ) as error:  # pandas' own errors are ValueErrors
            cause = one_line(str(error))
        for k, row in enumerate(rows):
            fields = self._fields(row)
            for c in wanted:
                if fields[c] not in TEXT_TABLE_MISSING and (
                    fault := no_number(fields[c])
                ):
                    cut = CUT * (is_last and row is rows[-1])
                    place = f"{self.path}, line {number + k}, column {c + 1}"
                    raise RecordingError(f"{place}: {fault}{cut}")
        raise RecordingError.at(self.path, f"rows of {self.width} numbers", cause)


# Named columns of text tables, as exported by other devices and programs.

STORAGE = (".mot", ".sto")  # OpenSim's files, whose columns may be separated by blanks
MOST_LISTED = 12
_LONGEST_HEADER = (
    1 << 17
)  # bytes of the lines above the names in OpenSim's files, usually 200


@dataclass(frozen=True)
class ColumnTable:
    """A text table whose first row names its columns.

    Parameters
    ----------
    names : tuple of str
        Column names, in the file's order.
    rows : Rows
        Rows below the names.
    clock : str, optional
        Column of times in s, if the format defines one.
    """

    names: tuple[str, ...]
    rows: Rows
    clock: str | None = None

    def numbers(self, name: str) -> FloatArray:
        """Read a column of numbers, (N,), NaN where a cell is empty.

        Raises
        ------
        RecordingError
            If there is no such column, or a cell is neither empty nor a finite number.
        """
        return self.rows.numbers([], [self.place_of(name)])[1][:, 0]

    def texts(self, name: str) -> list[str]:
        """Read a column as text; missing cells of short rows are empty.

        Raises
        ------
        RecordingError
            If there is no such column.
        """
        return self.rows.texts(self.place_of(name))

    def place_of(self, name: str) -> int:
        """Return the index of a column, from 0.

        Raises
        ------
        RecordingError
            If no column or several columns have this name.
        """
        return only_place(f"{self.rows.line(-1)}: column", name, self.names)


def open_table(path: str | Path) -> ColumnTable:
    """Open a table by its row of column names, in OpenSim's files below ``endheader``.

    Raises
    ------
    RecordingError
        If the file does not exist, is not text, or its first row holds no name.
    """
    path = Path(path)
    require_file(path)
    is_storage, above = path.suffix.lower() in STORAGE, b""
    has_ended = not is_storage
    with readable(path) as file:
        while not has_ended:
            line = file.readline()
            if not line or len(above) > _LONGEST_HEADER:
                raise RecordingError.at(path, "a line endheader", "none")
            above += line
            has_ended = line.lower().rstrip().endswith(b"endheader")
        first, second = file.readline(), file.readline()
    marks = MARKS + " " * is_storage
    names = decoded(first)
    mark = next((mark for mark in marks if mark in names.strip()), "\t")
    fields = fields_of(names, mark)
    n_lines = above.count(b"\n") + 1
    if not any(name and not is_number(name) for name in fields):
        found = f"'{names.strip()[:40]}'; write a row of names above the numbers"
        raise RecordingError.at(f"{path}, line {n_lines}", "names of columns", found)
    width = max(len(fields), len(fields_of(decoded(second), mark)))
    rows = Rows(path, n_lines, len(above) + len(first), width, mark, may_be_short=True)
    clock = next(
        (name for name in fields if is_storage and name.lower() == "time"), None
    )
    return ColumnTable(tuple(fields), rows, clock)


def only_place(place: str, name: str, names: Sequence[str]) -> int:
    """Return the index, from 0, of a column or channel.

    Raises
    ------
    RecordingError
        If none or several have this name; the message begins with `place`.
    """
    n_found = names.count(name)
    if n_found == 1:
        return names.index(name)
    found = (
        f"{n_found} of that name"
        if n_found
        else f"no '{name}'{did_you_mean(name, names)}"
    )
    raise RecordingError.at(place, f"'{name}' once among {listed(names)}", found)


def listed(names: Sequence[str]) -> str:
    """List names for a message; only the first dozen if there are many."""
    more = f", ... {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more
