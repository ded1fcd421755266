"""Reader of tables that D-Flow of Motek records: `TimeStamp`, `<marker>.PosX` ...

Positions are in m with y up, as that program defines its axes. It records at its own
pace, so two rows may hold the same frame of the cameras, and repeats the last place of
a marker that the cameras do not see. Columns of force plates and other channels stand
in the same table.
"""

import re
from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.readers import text

_POSITION = re.compile(r"(.+)\.Pos([XYZ])")
_TIME = "timestamp"
_FRAME = "framenumber"

#: Decimal places of a table in m that tell a place that is repeated from a marker that
#: rests: it must have more.
#: Unit: 1. Origin: chosen. The noise of cameras is about 0.1 mm.
COARSE_DECIMALS = 4


def is_dflow(names: Sequence[str]) -> bool:
    """Tell whether the columns are those of D-Flow."""
    has_time = any(name.lower() == _TIME for name in names)
    return has_time and any(_POSITION.fullmatch(name) for name in names)


def read_dflow(
    rows: text.Rows, names: Sequence[str], rate_hz: float | None
) -> raw.RawRecording:
    """Read the markers of a table of D-Flow.

    Parameters
    ----------
    rows : Rows
        Rows below the names.
    names : sequence of str
        Names of the columns.
    rate_hz : float or None
        ``input.rate_hz``.

    Raises
    ------
    RecordingError
        If a marker lacks a coordinate or the table holds other text than numbers.
    """
    path = str(rows.path)
    markers = _markers(rows, names)
    kept = {place for places in markers.values() for place in places}
    counters = {name.lower(): place for place, name in enumerate(names)}
    of_counters = [counters[key] for key in (_TIME, _FRAME) if key in counters]
    coordinates = [place for places in markers.values() for place in places]
    counted, flat = rows.numbers(of_counters, coordinates)
    missing = np.argwhere(np.isnan(counted))
    if len(missing):
        row, column = missing[0]
        place = f"{rows.line(row)}: {names[of_counters[column]]}"
        raise RecordingError.at(place, "a number", "a missing value")
    remarks: list[raw.Remark] = []
    left_out = [
        name
        for place, name in enumerate(names)
        if name and place not in kept and place not in of_counters
    ]
    if left_out:
        of_columns = {"place": path, "columns": text.listed(left_out)}
        remarks.append(Message("recordings.columns_left_out", of_columns))
    number = np.arange(1.0, len(counted) + 1)
    if counted.shape[1] == 2:
        number = counted[:, 1].copy()
        is_new = np.concatenate([[True], np.diff(number) != 0])
        n_repeated = int((~is_new).sum())
        if n_repeated:
            of_rows = {"place": path, "n_rows": n_repeated}
            remarks.append(Message("recordings.rows_of_one_frame", of_rows))
            number, counted, flat = number[is_new], counted[is_new], flat[is_new]
        if (np.diff(number) < 0).any():
            row = int(np.argmax(np.diff(number) < 0)) + 1
            place = f"{path}: FrameNumber, row {row + 1}"
            found = f"{number[row]:g} after {number[row - 1]:g}"
            raise RecordingError.at(place, "numbers that increase", found)
        number += 1 - number[:1]
    positions = flat.reshape(len(flat), -1, 3)
    n_held = _blank_held(positions)
    if n_held:
        n_all = positions.shape[0] * positions.shape[1]
        of_held = {"place": path, "n_held": n_held, "n_all": n_all}
        remarks.append(Message("recordings.held_positions", of_held))
    return raw.assembled(
        path,
        raw.distinct_names(path, list(markers)),
        positions,
        number=number,
        stamps=counted[:, 0].copy(),
        unit=(path, "m"),
        rates_hz=(None, rate_hz),
        remarks=tuple(remarks),
        stated_up="y",
    )


def _markers(rows: text.Rows, names: Sequence[str]) -> dict[str, list[int]]:
    """Return the columns of x, y and z of each marker, by its name."""
    found: dict[str, dict[str, int]] = {}
    for place, name in enumerate(names):
        match = _POSITION.fullmatch(name)
        if match is None:
            continue
        marker, axis = match.groups()
        of_marker = found.setdefault(marker.strip(), {})
        if axis in of_marker:
            wanted = "distinct names of columns"
            raise RecordingError.at(rows.line(-1), wanted, f"'{name}' twice")
        of_marker[axis] = place
    for marker, of_marker in found.items():
        lacking = [axis for axis in "XYZ" if axis not in of_marker]
        if lacking:
            wanted = f"a column {marker}.Pos{lacking[0]}"
            raise RecordingError.at(rows.line(-1), wanted, "none")
    return {
        marker: [of_marker[axis] for axis in "XYZ"]
        for marker, of_marker in found.items()
    }


def _blank_held(positions: FloatArray) -> int:
    """Set places that repeat those of the frame before to NaN; return how many.

    A frame in which all markers repeat is a repeated frame and left as it is. So are
    all if the numbers are too coarse to tell a marker that rests.
    """
    if len(positions) < 2:
        return 0
    with np.errstate(over="ignore"):  # of places that no camera sees
        rounded = np.round(positions, COARSE_DECIMALS)
    if np.allclose(positions, rounded, rtol=0, atol=1e-9, equal_nan=True):
        return 0
    is_held = (positions[1:] == positions[:-1]).all(axis=2)
    is_held[is_held.all(axis=1)] = False
    positions[1:][is_held] = np.nan
    return int(is_held.sum())
