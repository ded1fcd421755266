"""Support for jobs: a log file, errors in one line, outputs whole or absent."""

from __future__ import annotations

import glob
import json
import logging
import os
import re
import sys
import traceback
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

from hopdata.arrays import pd
from hopdata.causes import cause_of, error_number
from hopdata.digests import keep, keep_further, require_unchanged, states_in
from hopdata.errors import (
    NO_BREAK_SPACES,
    DamagedError,
    HopdataError,
    StorageError,
    printable,
)

TEXT_COLUMNS = (
    *("recording", "method", "schedule", "schedule_a", "schedule_b", "reason"),
    *("foot", "first_foot", "feet", "marker", "column", "name"),
)
# A spreadsheet may run texts that begin with these as formulas.
RUN = "[=+\\-@\t\r\n＝＋－＠]"
_RUN = re.compile(f"'*{RUN}")
_GUARDED = re.compile(f"'+{RUN}")
#: Digits of the numbers in a table.
#: Unit: 1. Origin: chosen.
DIGITS = 9
#: Digits of late instants.
#: Unit: 1. Origin: derived: with 16, a float64 is read again but for its last bit.
MOST_DIGITS = 16
#: Digits of instants and other times, in columns whose names end in "_s".
#: Unit: 1. Origin: derived: 1 ns in 1,000 s. With 9 digits their rounding shifts a foot
#: by 1 um, which changes an estimate by one part in 10,000.
TIME_DIGITS = 12
#: Instants from which on a column of times gets `MOST_DIGITS`.
#: Unit: s. Origin: derived: the last of `TIME_DIGITS` is 1 ns up to here.
LATE_S = 1e3
# Ends of the names of columns that hold rates: their "s" is that of "per second".
RATES = ("_m_s", "_mm_s", "_rad_s")
# Most characters in the name of a study, which is that of a folder.
LONGEST_NAME = 100

logger = logging.getLogger("hopdata")


def study_name(text: str) -> str:
    """Turn any text into a name of a study: letters, digits, ``_`` and ``-``.

    Accents are removed: ``müde`` becomes ``mude``.
    """
    decomposed = unicodedata.normalize("NFKD", text)
    plain = "".join(c for c in decomposed if not unicodedata.combining(c))
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_")
    return name[:LONGEST_NAME] or "study"


@contextmanager
def reported(
    log: str | Path,
    inputs: Iterable[str | Path] = (),
    outputs: Iterable[str | Path] = (),
    folder: str | Path | None = None,
) -> Iterator[None]:
    """Do the work of a job: with a log, on inputs that are whole, errors in one line.

    Parameters
    ----------
    log : path
        Log file, overwritten. Any unexpected exception is logged with its traceback and
        raised again.
    inputs, outputs : iterable of path
        Files of the job. Inputs that an earlier job has written are compared with their
        digests (`hopdata.digests`), and the digests of the outputs are kept.
    folder : path, optional
        Folder of the first output, if the job writes more there than its outputs. The
        digests of these files are kept with that of the first output.

    Raises
    ------
    SystemExit
        With code 1 after a `HopdataError`, and if memory, disk or a file is missing;
        the message goes to stderr and to the log, in the latter case with the job.
    """
    Path(log).parent.mkdir(parents=True, exist_ok=True)
    handler = logging.FileHandler(
        log, mode="w", encoding="utf-8", errors="backslashreplace"
    )
    handler.setFormatter(_Plain("%(levelname)s %(name)s: %(message)s"))
    # On a full disk the log fails too; the original error is the one to report.
    logging.raiseExceptions = False
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        require_unchanged(inputs)
        before = states_in(folder) if folder else {}
        yield
        outputs = [Path(one) for one in outputs]
        keep(outputs)
        if folder:
            after = states_in(folder)
            written = [one for one in after if after[one] != before.get(one)]
            keep_further(outputs[0], {*written} - {*outputs})
    except HopdataError as error:
        cause = cause_of(error.__cause__) if error.__cause__ else ""
        if isinstance(error, StorageError) and cause:
            _end_with(f"{Path(log).stem}: {error}; {_what_to_do(cause)}")
        _end_with(str(error))
    except Exception as error:
        logger.error("unexpected error\n%s", traceback.format_exc())
        cause = cause_of(error)
        if cause:
            _end_with(f"{Path(log).stem}: {cause}")
        raise
    finally:
        logger.removeHandler(handler)
        handler.close()


class _Plain(logging.Formatter):
    """Lines of a log, without what a terminal that shows it would obey."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), keep=f"\n\t{NO_BREAK_SPACES}")


def _end_with(message: str) -> None:
    """End the job with a message on stderr and in the log."""
    logger.error("%s", message)
    shown = printable(message, keep="\n")
    print(f"hopdata: error: {shown}", file=sys.stderr)
    raise SystemExit(1) from None


def _what_to_do(cause: str) -> str:
    """Return the end of a cause, which says what to do."""
    return cause.rpartition("; ")[2]


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path, which replaces `path` only if the block succeeds.

    Temporary files that killed processes left for the same path are removed first.

    Raises
    ------
    StorageError
        If the file cannot be written, for instance because the disk is full.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        for left in target.parent.glob(f".{glob.escape(target.name)}.*.part"):
            if not _is_at_work(left):
                left.unlink(missing_ok=True)
        yield temporary
        os.replace(temporary, target)
    except (OSError, RuntimeError) as error:
        code = error_number(error)
        if code is None:
            raise
        wrong = f"{path}: expected a writable file, found: {os.strerror(code)}"
        raise StorageError(f"{wrong}; nothing was written") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _is_at_work(draft: Path) -> bool:
    """Tell whether a process with the number in the name of a draft is alive here."""
    number = draft.name.split(".")[-2]
    if not number.isdigit() or int(number) == os.getpid() or os.name == "nt":
        return False  # on Windows, looking for a process may end it
    try:
        os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it is alive, and another user's
        return True
    return True


def write_json(path: str | Path, content: Mapping[str, Any] | list[Any]) -> None:
    """Write `content` as indented JSON, whole or not at all; NaN is not allowed."""
    with whole_file(path) as temporary:
        text = json.dumps(content, indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def write_fields(path: str | Path, result: Any) -> None:
    """Write a result as JSON, as its method ``to_dict`` returns it."""
    write_json(path, result.to_dict())


def read_json(path: str | Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    DamagedTextError
        If it is none.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise _damaged(path, "JSON", error) from error


class DamagedTextError(DamagedError, ValueError):
    """A file of results is no JSON or no table; a ValueError, as of their parsers."""


def _damaged(path: object, kind: str, error: Exception) -> DamagedTextError:
    """Return the error for a file of results that is not as it was written."""
    words = " ".join(str(error).split())[:100]
    found = f"{words}; if hopdata wrote it, remove it and run again"
    return DamagedTextError.at(path, f"whole {kind}", found)


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table as CSV, whole or not at all; times have more digits.

    Texts that a spreadsheet would run get a leading apostrophe, which `read_table`
    removes.
    """
    with whole_file(path) as temporary:
        temporary.write_text(_csv(table), encoding="utf-8", newline="\n")


def as_stored(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table as it would be read again: rounded as in its file."""
    return read_table(StringIO(_csv(table)))


def _csv(table: pd.DataFrame) -> str:
    # Numbers are formatted here because pandas takes three times as long.
    numbers = {
        str(guarded(name)): _printed(table[name])
        for name in table
        if table[name].dtype.kind == "f"
    }
    printed = _changed(table, guarded).assign(**numbers)
    return str(printed.to_csv(index=False, lineterminator="\n"))


def guarded(cell: object) -> object:
    """Put an apostrophe before a text that a spreadsheet would run.

    What a reader of the table could not see is replaced (`printable`).
    """
    if not isinstance(cell, str):
        return cell
    shown = printable(cell, keep=NO_BREAK_SPACES)
    return f"'{shown}" if _RUN.match(shown) else shown


def _unguarded(cell: object) -> object:
    if isinstance(cell, str) and _GUARDED.match(cell):
        return cell[1:]
    return cell


def _changed(table: pd.DataFrame, change: Callable[[object], object]) -> pd.DataFrame:
    """Apply `change` to the texts of a table and to the names of its columns."""
    once = lru_cache(None, typed=True)(change)  # columns have few distinct texts
    changed = {}
    for name in table:
        if len(table) and table[name].dtype.kind == "O":
            changed[str(name)] = table[name].map(once)
    return table.assign(**changed).rename(columns=change)


def _printed(column: pd.Series) -> list[str]:
    """Return numbers as text; times get more digits (see `TIME_DIGITS`, `LATE_S`)."""
    digits = DIGITS
    name = str(column.name)
    is_time = name.endswith("_s") and not name.endswith(RATES)
    if is_time:
        digits = TIME_DIGITS
        if column.abs().max() >= LATE_S:
            digits = MOST_DIGITS
    texts = []
    for value in column.tolist():
        is_missing = value != value  # NaN
        texts.append("" if is_missing else f"{value:.{digits}g}")
    return texts


#: Columns of a table of results. pandas takes up to 0.2 ms for each.
#: Unit: 1. Origin: chosen. A row has a few columns for each foot or body marker.
MOST_COLUMNS = 5000


def _require_few_columns(path: str | Path) -> None:
    """Require rows that hopdata could have written.

    Raises
    ------
    ValueError
        If one has more columns than any table.
    """
    with Path(path).open("rb") as file:
        n_columns = 1 + max((line.count(b",") for line in file), default=0)
    if n_columns > MOST_COLUMNS:
        raise ValueError(f"a row of {n_columns} columns")


def read_table(path: str | Path | StringIO) -> pd.DataFrame:
    """Read a CSV table; `TEXT_COLUMNS` stay text, also if they are empty.

    Raises
    ------
    DamagedTextError
        If it is no table.
    """
    # A recording may be called NA, so only an empty cell is a missing value.
    missing: Any = {"keep_default_na": False, "na_values": [""]}
    try:
        if not isinstance(path, StringIO):
            _require_few_columns(path)
        table = pd.read_csv(path, dtype=dict.fromkeys(TEXT_COLUMNS, str), **missing)
    except (ValueError, OverflowError) as error:  # errors of its parser are of these
        raise _damaged(path, "CSV", error) from error
    texts = table.columns.intersection(TEXT_COLUMNS)
    return _changed(table.fillna(dict.fromkeys(texts, "")), _unguarded)


def read_tables(paths: Iterable[str | Path]) -> pd.DataFrame:
    """Read CSV tables with the same columns into one table."""
    return stacked([read_table(path) for path in paths])


def stacked(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate tables with the same columns; empty ones do not count."""
    filled = [table for table in tables if len(table)]
    return pd.concat(filled or tables[:1], ignore_index=True)
