"""Text tables: lines of fields, rows of numbers below a header, columns by name."""

from __future__ import annotations

import codecs
import csv
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import islice, product, takewhile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import RecordingError, did_you_mean
from hopdata.foreign.texts import kind_of
from hopdata.recordings.budget import LONGEST_LINE, MOST_CELLS, MOST_COLUMNS

BLOCK = 1 << 20  # bytes that are read at a time
ROWS = 20_000  # rows that are read at a time

# A look at samples of a file for lines that are too long. Window and distance together
# are less than `LONGEST_LINE`, so a longer line fills at least one window.
_WINDOW = 1 << 15  # bytes of a sample
_APART = 1 << 19  # bytes from the start of one sample to that of the next

# Field separators, the most likely first.
MARKS = "\t;,"

# Programs write missing values as nothing, in words, or as their C library's NaN.
_NAN = ["".join(letters) for letters in product("nN", "aA", "nN")]
TEXT_TABLE_MISSING = (
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
    "nan(ind)",
    "-nan(ind)",
    "1.#QNAN",
    "-1.#QNAN",
    "1.#IND",
    "-1.#IND",
)
CUT = "; the file ends here, was it cut short? export it again, or delete the last line"

# Placeholder for a separator within a field.
HELD = "\x1f"


# Bytes and lines of a file.


@contextmanager
def readable(path: Path, *, is_text: bool = True) -> Iterator[BinaryIO]:
    """Open a file to read its bytes; of a text in UTF-8, with lines that end in LF.

    Raises
    ------
    RecordingError
        If it cannot be read, or has a line longer than any of a sound file.
    """
    try:
        with _opened(path) as file:
            if not is_text:
                yield file
                return
            begin = file.read(BLOCK)
            is_wide = begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
            if is_wide or _ends_lines_in_cr(begin):
                converted = _converted(begin, file)
                _require_lines(path, converted)
                yield converted
                return
            _require_lines(path, file)
            yield file
    except OSError as error:
        found = error.strerror or error
        message = f"{path}: expected a readable file, found: {found}"
        raise RecordingError(message) from None


# Texts that stand in no file, by the path under which they are read.
_held: dict[Path, bytes] = {}


@contextmanager
def held(path: Path, content: bytes) -> Iterator[None]:
    """Let a text be read as if it were the file of a path, inside the block."""
    _held[path] = content
    try:
        yield
    finally:
        del _held[path]


def _opened(path: Path) -> BinaryIO:
    if path in _held:
        return io.BytesIO(_held[path])
    return path.open("rb")


def _ends_lines_in_cr(begin: bytes) -> bool:
    """Tell whether the lines of a text end in CR alone, as on old computers."""
    return b"\r" in begin and b"\n" not in begin and b"\0" not in begin


def _converted(begin: bytes, file: BinaryIO) -> BinaryIO:
    """Return a text in UTF-8 with lines that end in LF."""
    content = decoded(begin + file.read())
    return io.BytesIO(content.replace("\r\n", "\n").replace("\r", "\n").encode())


def _require_lines(path: Path, file: BinaryIO) -> None:
    """Refuse a file with a line that is longer than any of a sound file.

    A line that is too long fills a window of the samples. So a look at these suffices
    if each has a line end; otherwise all lines are measured.
    """
    if _has_line_ends_everywhere(file):
        file.seek(0)
        return
    line_start = 0  # of the line in which the last block ended
    n_read = 0
    file.seek(0)
    while block := file.read(BLOCK):
        first_end = block.find(b"\n")
        until = n_read + (len(block) if first_end < 0 else first_end)
        if until - line_start > LONGEST_LINE:
            wanted = f"lines of at most {LONGEST_LINE:,} bytes"
            found = "a longer one; is this one recording's table?"
            raise RecordingError.at(path, wanted, found)
        if first_end >= 0:
            line_start = n_read + block.rfind(b"\n") + 1
        n_read += len(block)
    file.seek(0)


def _has_line_ends_everywhere(file: BinaryIO) -> bool:
    """Tell whether each of the windows looked at has a line end."""
    n_bytes = file.seek(0, os.SEEK_END)
    for start in range(0, n_bytes - _WINDOW, _APART):
        file.seek(start)
        if b"\n" not in file.read(_WINDOW):
            return False
    return True


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
        If it does not exist, or is a folder, a pipe or a device.
    """
    if path.is_file():
        return
    if path.exists():
        kind = kind_of(path.stat().st_mode)
        raise RecordingError.at(path, "a file", kind)
    near = f"; there is no folder {path.parent}"
    if path.parent.is_dir():
        near = did_you_mean(path.name, [p.name for p in path.parent.iterdir()])
    raise RecordingError.at(path, "a file", f"none{near}")


def decoded(data: bytes) -> str:
    """Decode the text of a file: in UTF-16, UTF-8, or an older encoding.

    Hard blanks, which some spreadsheets put into names, become blanks.
    """
    return _decoded(data).replace("\xa0", " ")


def _decoded(data: bytes) -> str:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    for encoding in ("utf-8-sig", "cp1252"):
        with suppress(UnicodeDecodeError):
            return data.decode(encoding)
    return data.decode("latin-1")


def is_above_table(fields: Sequence[str]) -> bool:
    """Tell whether a line above a table is a comment, or Excel's ``sep=;``."""
    return fields[0].startswith("#") or fields[0].lower().startswith("sep=")


# Fields of a line.


def mark_between(lines: Sequence[str]) -> str:
    """Return the field separator: a tab if half of the first lines have one."""
    n_with_tab = sum("\t" in line for line in lines)
    n_not_empty = sum(bool(line.strip()) for line in lines)
    if 2 * n_with_tab >= n_not_empty:
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
            rows = csv.reader([line], delimiter=mark, skipinitialspace=True)
            fields = next(rows, [""])
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
    end = len(fields)
    while end and not fields[end - 1]:
        end -= 1
    return fields[:end]


# Numbers in a field.


def is_number(text: str) -> bool:
    """Tell whether a field is a number with a decimal point."""
    with suppress(ValueError):
        float(text)
        return True
    return False


def pointed(text: str) -> str:
    """Replace the comma in a header's number by a point, if it is the only mark."""
    if text.count(",") == 1 and "." not in text:
        return text.replace(",", ".")
    return text


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
    if not stated:
        return None
    fault = no_number(stated)
    if fault:
        raise RecordingError(f"{place}: {key}: {fault}")
    return float(stated)


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
    group : int
        Fields at the end of a row may lack in groups of so many, as where nothing is
        written for the last markers; 0 if none may.
    """

    path: Path
    n_lines: int
    offset: int
    width: int
    mark: str = "\t"
    may_be_short: bool = False
    is_section: bool = False
    needed: int | None = None
    group: int = 0

    def line(self, row: int) -> str:
        """Return file and line of a row, for messages; rows count from 0."""
        return f"{self.path}, line {self.n_lines + 1 + row}"

    def numbers(self, *columns: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read an array (N, C) for each list of columns, NaN where a field is missing.

        The decimal mark is that of the first row. Rows at the end in which all columns
        of the first list are missing are dropped; none are if that list is empty.

        Raises
        ------
        RecordingError
            Naming line and column of the first field that is not a finite number, or
            the first row that is too short or too long.
        """
        self._require_columns(columns)
        with readable(self.path) as file:
            most_rows = self._most_rows(file)
            tables = [np.empty((most_rows, len(of))) for of in columns]
            n_rows = 0
            has_commas = False
            for block in self._blocks(file):
                if n_rows == 0:
                    has_commas = b"," in block.rows[0] and self.mark != ","
                if has_commas:
                    block = block.with_points()
                values = self._values(block, columns)
                for table, part in zip(tables, values, strict=True):
                    table[n_rows : n_rows + len(block.rows)] = part
                n_rows += len(block.rows)
        if len(columns[0]):
            while n_rows and np.isnan(tables[0][n_rows - 1]).all():
                n_rows -= 1
        if not n_rows and not self.may_be_short:
            wanted = "rows of numbers after the header"
            raise RecordingError.at(self.path, wanted, "none")
        return tuple(table[:n_rows] for table in tables)

    def _require_columns(self, columns: Sequence[Sequence[int]]) -> None:
        if self.width > MOST_COLUMNS:
            wanted = f"at most {MOST_COLUMNS:,} columns"
            raise RecordingError.at(self.line(0), wanted, f"{self.width:,}")
        needed = 1 + max(max(of) for of in columns if len(of))
        if needed > self.width:
            raise RecordingError.at(self.line(0), f"{needed} columns", self.width)

    def markers(
        self, counters: Sequence[str], coordinates: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Read the counters in the first columns, and positions.

        Returns
        -------
        counted : (N, C) array
        positions : (N, M, 3) array
            NaN where a coordinate is missing.

        Raises
        ------
        RecordingError
            As `numbers`, or if a counter is missing.
        """
        counted, flat = self.numbers(range(len(counters)), coordinates)
        missing = np.argwhere(np.isnan(counted))
        if len(missing):
            row, column = missing[0]
            place = f"{self.line(row)}: {counters[column]}"
            raise RecordingError.at(place, "a number", "a missing value")
        return counted, flat.reshape(len(flat), -1, 3)

    def texts(self, column: int) -> list[str]:
        """Read a column as text, unchanged."""
        texts = []
        with readable(self.path) as file:
            for block in self._blocks(file):
                for row in block.rows:
                    field = self._fields(row)[column]
                    texts.append(field.replace(HELD, self.mark))
        return texts

    def _fields(self, row: bytes) -> list[str]:
        """Split a row into `width` fields; missing ones are empty.

        Any can be missing only where blanks separate the fields, since blanks at the
        end of a row separate nothing.
        """
        fields = fields_of(decoded(row), self.mark)
        return fields + [""] * (self.width - len(fields))

    def _most_rows(self, file: BinaryIO) -> int:
        """Return the most rows possible, by the lines and the bytes that rows take."""
        file.seek(self.offset)
        n_lines = 0
        n_bytes = 0
        while block := file.read(BLOCK):
            n_lines += block.count(b"\n")
            n_bytes += len(block)
        # A field takes a byte at least, its separator.
        least_bytes = self.width if self.needed is None else self.needed
        if self.may_be_short or self.group:
            least_bytes = 1
        return min(n_lines, n_bytes // least_bytes) + 1

    def _blocks(self, file: BinaryIO) -> Iterator[_Block]:
        """Yield rows of `width` fields.

        Empty lines are skipped. If rows may be short, empty lines before another row
        count as rows, so those at the end of a block wait for the next one.
        """
        file.seek(self.offset)
        next_line = self.n_lines + 1
        n_empty = 0  # empty lines that wait
        in_section: Iterator[bytes] = file
        if self.is_section:
            in_section = takewhile(lambda line: line.strip(b" ,;\t\r\n"), file)
        most = max(1, min(ROWS, MOST_CELLS // self.width))
        while lines := list(islice(in_section, most)):
            number = next_line - n_empty  # of the first line in this block
            next_line += len(lines)
            is_last = len(lines) < most
            lines = [b"\n"] * n_empty + lines
            n_empty = 0
            while lines and self.may_be_short and not lines[-1].strip():
                lines.pop()
                n_empty += 1
            rows = self._rows_of(lines, number, is_last)
            if rows:
                yield _Block(rows, number, is_last)

    def _rows_of(self, lines: list[bytes], number: int, is_last: bool) -> list[bytes]:
        """Return the rows in these lines; `number` is that of the first line."""
        n_marks = self.width - 1
        mark = self.mark.encode()
        if all(line.count(mark) == n_marks and b'"' not in line for line in lines):
            return lines
        rows = []
        for k, line in enumerate(lines):
            at_end = is_last and k == len(lines) - 1
            row = self._fitted(line, number + k, at_end)
            if row:
                rows.append(row)
        return rows

    def _fitted(self, line: bytes, number: int, at_end: bool) -> bytes:
        """Return a row with the right number of separators; nothing if it is empty."""
        mark = self.mark.encode()
        is_row = line.count(mark) == self.width - 1 or self.may_be_short
        if not is_row and not line.strip(mark + b" \t\r\n"):
            return b""
        fields = [
            field.replace(self.mark, HELD)
            for field in fields_of(line.decode("latin-1"), self.mark)
        ]
        least = self.width
        if self.needed is not None:
            least = self.needed
            if not any(fields[self.width :]):
                fields = fields[: self.width]
        is_too_short = len(fields) < least and not self.may_be_short
        is_cut = at_end and not line.endswith(b"\n")
        if self.group and not is_cut and (least - len(fields)) % self.group == 0:
            is_too_short = False
        if len(fields) > self.width or is_too_short:
            found = f"{len(fields)}{CUT if at_end else ''}"
            place = f"{self.path}, line {number}"
            raise RecordingError.at(place, f"{self.width} columns", found)
        fields += [""] * (self.width - len(fields))
        return (self.mark.join(fields) + "\n").encode("latin-1")

    def _values(
        self, block: _Block, columns: Sequence[Sequence[int]]
    ) -> list[FloatArray]:
        """Return the numbers of a block: an array for each list of columns.

        They are read with pandas, which infers the types of columns faster than it
        applies given ones. Anything but finite numbers and missing values is a fault.
        """
        wanted = sorted({column for of in columns for column in of})
        content = b"".join(block.rows)
        cause = "other text"  # if no field is at fault and pandas names no cause
        try:
            frame = pd.read_csv(
                io.BytesIO(content),
                sep=self.mark,
                header=None,
                usecols=wanted,
                quoting=csv.QUOTE_NONE,
                na_values=list(TEXT_TABLE_MISSING),
                keep_default_na=False,
                skipinitialspace=True,
                skip_blank_lines=False,
                low_memory=False,
                encoding="latin-1",
            )
            # No control characters, and no row lost.
            is_text = min(content) >= ord("\t") and len(frame) == len(block.rows)
            if is_text and all(kind.kind in "iuf" for kind in frame.dtypes):
                found = [frame[list(of)].to_numpy(np.float64) for of in columns]
                if not any(np.isinf(part).any() for part in found):
                    return found
        except (ValueError, OverflowError) as error:  # pandas' own are ValueErrors
            cause = one_line(str(error))
        self._require_numbers(block, wanted)
        raise RecordingError.at(self.path, f"rows of {self.width} numbers", cause)

    def _require_numbers(self, block: _Block, columns: list[int]) -> None:
        """Name the first field that is neither missing nor a number."""
        for k, row in enumerate(block.rows):
            fields = self._fields(row)
            for column in columns:
                if fields[column] in TEXT_TABLE_MISSING:
                    continue
                fault = no_number(fields[column])
                if fault:
                    if block.is_last and row is block.rows[-1]:
                        fault += CUT
                    line = f"line {block.number + k}"
                    place = f"{self.path}, {line}, column {column + 1}"
                    raise RecordingError(f"{place}: {fault}")


@dataclass(frozen=True)
class _Block:
    """Consecutive rows: the number of the first, and whether the file ends here."""

    rows: list[bytes]
    number: int
    is_last: bool

    def with_points(self) -> _Block:
        """Return the rows with points for commas."""
        return replace(self, rows=[row.replace(b",", b".") for row in self.rows])


# Named columns of text tables, as exported by other devices and programs.

# OpenSim's files, whose columns may be separated by blanks.
STORAGE = (".mot", ".sto")

# Bytes of the lines above the names in OpenSim's files; usually 200.
_LONGEST_HEADER = 1 << 17

# Names in a message.
MOST_LISTED = 12


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
        none_decide: list[int] = []  # which rows at the end are dropped
        _, column = self.rows.numbers(none_decide, [self.place_of(name)])
        return column[:, 0]

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
    is_storage = path.suffix.lower() in STORAGE
    with readable(path) as file:
        above = _opensim_header(path, file) if is_storage else b""
        first = file.readline()
        second = file.readline()
    names = decoded(first)
    marks = f"{MARKS} " if is_storage else MARKS
    mark = next((mark for mark in marks if mark in names.strip()), "\t")
    fields = fields_of(names, mark)
    n_lines = above.count(b"\n") + 1
    if not any(name and not is_number(name) for name in fields):
        found = f"'{names.strip()[:40]}'; write a row of names above the numbers"
        raise RecordingError.at(f"{path}, line {n_lines}", "names of columns", found)
    rows = Rows(
        path,
        n_lines=n_lines,
        offset=len(above) + len(first),
        width=max(len(fields), len(fields_of(decoded(second), mark))),
        mark=mark,
        may_be_short=True,
    )
    clock = None
    if is_storage:
        clock = next((name for name in fields if name.lower() == "time"), None)
    return ColumnTable(tuple(fields), rows, clock)


def _opensim_header(path: Path, file: BinaryIO) -> bytes:
    """Read the lines above the names, the last of which is ``endheader``."""
    above = b""
    while True:
        line = file.readline()
        if not line or len(above) > _LONGEST_HEADER:
            raise RecordingError.at(path, "a line endheader", "none")
        above += line
        if line.lower().rstrip().endswith(b"endheader"):
            return above


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
    found = f"{n_found} of that name"
    if not n_found:
        found = f"no '{name}'{did_you_mean(name, names)}"
    raise RecordingError.at(place, f"'{name}' once among {listed(names)}", found)


def listed(names: Sequence[str]) -> str:
    """List names for a message; only the first dozen if there are many."""
    some = ", ".join(names[:MOST_LISTED])
    if len(names) > MOST_LISTED:
        return f"{some}, ... {len(names) - MOST_LISTED} more"
    return some
