"""Reader of Excel's workbooks: the first sheet of markers, read as the same text.

A workbook is a packed collection of XML, so the size to which it claims to unpack is
compared with the limit first. The sheet then becomes a CSV in memory, which the reader
of text exports reads, so it may have any layout that a CSV may have.
"""

import os
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.budget import MOST_COLUMNS, require_memory
from hopdata.recordings.readers.csv_exports import read_export
from hopdata.recordings.readers.text import held, listed, one_line

#: Memory for a cell of a workbook over the length of its XML.
#: Unit: 1. Origin: chosen. XML of 30 bytes becomes a number of Python and its text.
_MEMORY_PER_BYTE = 5

# Where the text of a sheet stands: at a path that no file can have.
_COPY = Path(os.devnull) / "sheet.csv"

_TIDY = (
    "; leave one table on the first sheet, a row of names (<name>_x, <name>_y, "
    "<name>_z of each marker) above one row for each frame, without empty columns or "
    "notes beside it, or save the sheet as CSV"
)


def read_xlsx(
    path: Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float,
    least_score: float,
) -> raw.RawRecording:
    """Read the markers of a workbook of Excel.

    Parameters
    ----------
    path : path
        The ``.xlsx`` file.
    rate_hz : float, optional
        Frame rate, for a table that states none.
    most_unpacked_mb : float
        Most memory that the file may use, MB.
    least_score : float
        Keypoints with a lower likelihood or score count as unseen.

    Raises
    ------
    RecordingError
        If openpyxl is not installed, or the file cannot be read; names the file and the
        sheet, what was expected and found.
    """
    if find_spec("openpyxl") is None:
        wanted = "the package openpyxl, which reads workbooks"
        found = "none; install it (pip install openpyxl), or save the sheet as CSV"
        raise RecordingError.at(path, wanted, found)
    _require_size(path, most_unpacked_mb)
    tables = [one for one in _sheets(path) if not _is_of_others(one[0])]
    if not tables:
        raise RecordingError.at(path, "a sheet with numbers", f"none{_TIDY}")
    errors = []
    for sheet, table in sorted(tables, key=lambda one: not _is_of_places(one[0])):
        try:
            recording = _read_sheet(path, sheet, table, rate_hz, least_score)
        except RecordingError as error:
            errors.append(error)
            continue
        others = [name for name, _ in tables if name != sheet]
        if not others:
            return recording
        values = {"place": str(path), "sheet": sheet, "others": listed(others)}
        told = Message("recordings.sheet_read", values)
        return replace(recording, remarks=(told, *recording.remarks))
    raise errors[0]


# Words in the names of sheets that hold positions, and of those that do not: workbooks
# of Xsens have sheets of angles and velocities whose columns are named like positions.
_PLACES = ("position", "marker", "trajector")
_OTHERS = ("orientation", "angle", "euler", "quat", "velocity", "acceler", "magnetic")


def _is_of_places(sheet: str) -> bool:
    return any(word in sheet.lower() for word in _PLACES)


def _is_of_others(sheet: str) -> bool:
    return any(word in sheet.lower() for word in _OTHERS)


def _read_sheet(
    path: Path, sheet: str, table: Any, rate_hz: float | None, least_score: float
) -> raw.RawRecording:
    """Read a sheet as the CSV that it would be saved to."""
    content = table.to_csv(None, header=False, index=False).encode()
    here = f"{path}, sheet '{sheet}'"
    with held(_COPY, content):
        try:
            found = read_export(_COPY, rate_hz=rate_hz, least_score=least_score)
        except RecordingError as error:
            message = str(error).replace(str(_COPY), here)
            if not isinstance(error, raw.RateUnknownError):
                message += _TIDY
            raise type(error)(message) from None
    return replace(found, remarks=_renamed(found.remarks, str(_COPY), here))


def _renamed(
    remarks: Sequence[raw.Remark], copy: str, here: str
) -> tuple[raw.Remark, ...]:
    """Name the sheet in remarks, in place of its copy."""
    renamed: list[raw.Remark] = []
    for remark in remarks:
        if isinstance(remark, str):
            renamed.append(remark.replace(copy, here))
            continue
        values = {
            name: value.replace(copy, here) if isinstance(value, str) else value
            for name, value in remark.values.items()
        }
        renamed.append(Message(remark.code, values))
    return tuple(renamed)


def _require_size(path: Path, most_unpacked_mb: float) -> None:
    """Require a packed file that unpacks to a size that is allowed."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            n_bytes = sum(member.file_size for member in archive.infolist())
        require_memory(_MEMORY_PER_BYTE * n_bytes, most_unpacked_mb)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        words = one_line(str(error))
        if "expected" not in words:
            words = f"expected a workbook of Excel (.xlsx), found: {words}"
        raise RecordingError(f"{path}: {words}") from None


def _sheets(path: Path) -> list[tuple[str, Any]]:
    """Return name and cells of each sheet that has numbers, in order."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on styles and links, which are not read
            sheets = pd.read_excel(
                path, sheet_name=None, header=None, dtype=object, engine="openpyxl"
            )
    except Exception as error:  # a damaged file makes openpyxl raise almost anything
        kind = type(error).__name__
        found = (
            f"{kind}: {one_line(str(error))[:200]}; open it in Excel and save it anew"
        )
        raise RecordingError.at(path, "a workbook of Excel (.xlsx)", found) from error
    tables = []
    for name, table in sheets.items():
        if table.shape[1] > MOST_COLUMNS:
            wanted = f"at most {MOST_COLUMNS:,} columns"
            found = f"{table.shape[1]:,}"
            raise RecordingError.at(f"{path}, sheet '{name}'", wanted, found)
        if _has_numbers(table):
            tables.append((str(name), table))
    return tables


def _has_numbers(table: Any) -> bool:
    """Tell whether two rows of a sheet hold three numbers or more."""
    if table.shape[1] < 3:
        return False
    is_number = table.map(lambda cell: isinstance(cell, int | float)) & table.notna()
    return int((is_number.sum(axis=1) >= 3).sum()) >= 2
