"""What every batch job needs: a log file, one clear line on failure, whole or no outputs."""

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
from hopdata.errors import HopdataError, StorageError

TEXT_COLUMNS = (
    *("recording", "schedule", "schedule_a", "schedule_b", "reason"),
    *("foot", "first_foot", "feet", "marker", "column", "name"),
)
RUN = "[=+\\-@\t\r\n＝＋－＠]"  # beginnings of a text that a spreadsheet may run as a formula
_RUN, _GUARDED = re.compile(f"'*{RUN}"), re.compile(f"'+{RUN}")
DIGITS, MOST_DIGITS = 9, 16
LATE_S = 1e3  # instants (columns in "_s") after it need more digits than 9

logger = logging.getLogger("hopdata")


def study_name(text: str) -> str:
    """Turn any text into the name of a study or a recording: letters, digits, ``_`` and ``-``.

    Accents go, so that ``müde`` becomes ``mude``.
    """
    plain = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_")[:100] or "study"


@contextmanager
def reported(log: str | Path) -> Iterator[None]:
    """Send the package's log to `log`; end a user's mistake in one line and exit code 1.

    Parameters
    ----------
    log : path
        Log file, written anew. Any other exception goes there with its traceback, and on.

    Raises
    ------
    SystemExit
        With code 1 after a `HopdataError`, whose message is on stderr and in the log.
    """
    Path(log).parent.mkdir(parents=True, exist_ok=True)
    handler = logging.FileHandler(log, mode="w", encoding="utf-8", errors="backslashreplace")
    handler.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
    logging.raiseExceptions = False  # a full disk takes no log, and the error itself is told
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    except HopdataError as error:
        logger.error("%s", error)
        print(f"hopdata: error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except Exception:
        logger.error("unexpected error\n%s", traceback.format_exc())
        raise
    finally:
        logger.removeHandler(handler)
        handler.close()


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which takes its place only if the block succeeds.

    What processes that were killed have left of the same file is removed first.

    Raises
    ------
    StorageError
        If it cannot be written, for instance since the disk is full.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        for left in target.parent.glob(f".{glob.escape(target.name)}.*.part"):
            left.unlink(missing_ok=True)
        yield temporary
        os.replace(temporary, target)
    except (OSError, RuntimeError) as error:  # h5py's has the number in its words alone
        told = re.search(r"errno = (\d+)", str(error))
        code = int(told[1]) if told else getattr(error, "errno", None)
        if code is None:
            raise
        raise StorageError(
            f"{path}: expected a place to write it, found: {os.strerror(code)}; nothing is kept"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_json(path: str | Path, content: Mapping[str, Any] | list[Any]) -> None:
    """Write `content` as indented JSON, whole or not at all; NaN is not allowed in it."""
    with whole_file(path) as temporary:
        text = json.dumps(content, indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def read_json(path: str | Path) -> Any:
    """Read a JSON file."""
    return json.loads(Path(path).read_text(encoding="utf-8"))


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table as CSV, whole or not at all, with 9 digits, late instants with 16.

    What a spreadsheet would run has an apostrophe before it, which `read_table` takes off.
    """
    with whole_file(path) as temporary:
        temporary.write_text(_csv(table), encoding="utf-8", newline="\n")


def as_stored(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table as `read_table` gives it back after `write_table`: in the digits of a file."""
    return _read(lambda: StringIO(_csv(table)))


def _csv(table: pd.DataFrame) -> str:
    # Numbers as text: pandas takes three times as long for them.
    texts = {name: _printed(table[name]) for name in table if table[name].dtype.kind == "f"}
    printed = _changed(table, guarded).assign(**{str(guarded(k)): v for k, v in texts.items()})
    return str(printed.to_csv(index=False, lineterminator="\n"))


def guarded(cell: object) -> object:
    """Put an apostrophe before a text that a spreadsheet would run; others stay as they are."""
    return f"'{cell}" if isinstance(cell, str) and _RUN.match(cell) else cell


def _unguarded(cell: object) -> object:
    return cell[1:] if isinstance(cell, str) and _GUARDED.match(cell) else cell


def _changed(table: pd.DataFrame, change: Callable[[object], object]) -> pd.DataFrame:
    """Change the texts of a table, the names of its columns too."""
    texts = [name for name in table if len(table) and table[name].dtype.kind == "O"]
    once = lru_cache(None, typed=True)(change)  # of many cells few differ
    changed = {str(name): table[name].map(once) for name in texts}
    return table.assign(**changed).rename(columns=change)


def _printed(column: pd.Series) -> list[str]:
    """Return numbers as text: instants long after the zero of their clock with more digits."""
    late = str(column.name).endswith("_s") and column.abs().max() >= LATE_S
    digits = MOST_DIGITS if late else DIGITS
    return ["" if value != value else f"{value:.{digits}g}" for value in column.tolist()]


def read_table(path: str | Path) -> pd.DataFrame:
    """Read a CSV table; `TEXT_COLUMNS` stay text, their empty cells empty text."""
    return _read(lambda: path)


def _read(source: Callable[[], Any]) -> pd.DataFrame:
    text = [name for name in pd.read_csv(source(), nrows=0).columns if name in TEXT_COLUMNS]
    # A recording may be called NA; an empty cell alone is a missing value.
    missing: Any = {"keep_default_na": False, "na_values": [""]}
    table = pd.read_csv(source(), dtype=dict.fromkeys(text, str), **missing)
    return _changed(table.assign(**{name: table[name].fillna("") for name in text}), _unguarded)


def read_tables(paths: Iterable[str | Path]) -> pd.DataFrame:
    """Read CSV tables of the same columns into one."""
    return stacked([read_table(path) for path in paths])


def stacked(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Put tables of the same columns into one; those without rows leave its types alone."""
    return pd.concat([t for t in tables if len(t)] or tables[:1], ignore_index=True)
