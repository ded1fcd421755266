"""Motion-BIDS: numbers in ``_motion.tsv``, described by a table and by JSON files.

The table of channels is ``_channels.tsv``. In the brain imaging data structure, a JSON
file may also stand in a parent folder. It then applies to all files whose names contain
the parts of its own name.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import text

ENDS = "_motion.tsv"

# Levels of a dataset: motion, session, subject, dataset.
_FOLDERS = 4

# Letters of axes that are vertical: superior, up, inferior, down.
_UP = {"S": "", "U": "", "I": "-", "D": "-"}

_MISSING = ("", "n/a")


def read_bids(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the tracked points of a Motion-BIDS file that have positions in three axes.

    Parameters
    ----------
    path : path
        The ``_motion.tsv`` file; ``_channels.tsv`` must stand beside it.
    rate_hz : float, optional
        Frame rate, for a file that states none.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the place, what was expected and
        found.
    """
    channels = _read_channels(path)
    stated = _stated(path, "motion")
    coordinates = [place for places in channels.places for place in places]
    clock = [] if channels.clock is None else [channels.clock]
    with text.readable(path) as file:
        first = file.readline()
    # The standard forbids names of columns, but some files have them.
    has_names = not any(map(text.is_number, text.split_line(path, first)))
    rows = text.Rows(
        path,
        n_lines=1 if has_names else 0,
        offset=len(first) if has_names else 0,
        width=channels.number,
    )
    _, numbers, stamps = rows.numbers([], coordinates, clock)
    missing = stated.get("MissingValues")
    if missing is not None and text.is_number(str(missing)):
        numbers[numbers == float(missing)] = np.nan
    if np.isnan(stamps).any():
        row = int(np.argmax(np.isnan(stamps)))
        raise RecordingError.at(f"{path}, line {row + 1}: LATENCY", "a time", "none")
    rate = stated.get("SamplingFrequency")
    if not isinstance(rate, int | float | None):
        raise RecordingError.at(f"{path}: SamplingFrequency", "a number", f"'{rate}'")
    return raw.assembled(
        str(path),
        raw.distinct_names(str(channels.path), channels.points, may_lack=True),
        numbers.reshape(len(numbers), -1, 3),
        number=np.arange(1.0, len(numbers) + 1),
        stamps=stamps[:, 0].copy() if clock else None,
        unit=(f"{channels.path}: units", channels.unit),
        rates_hz=(rate, rate_hz),
        rate_place=f"{path}: SamplingFrequency",
        remarks=channels.remarks,
        stated_up=_stated_up(path),
    )


@dataclass(frozen=True)
class _Channels:
    """Meaning of the columns of a Motion-BIDS file.

    Parameters
    ----------
    path : Path
        The file that describes them.
    number : int
        How many there are.
    points : list of str
        The tracked points.
    places : list of list of int
        Columns of their three coordinates.
    unit : str
        Unit of the positions; empty if it is not stated.
    clock : int or None
        Column of the times.
    remarks : tuple of str
        What is left out.
    """

    path: Path
    number: int
    points: list[str]
    places: list[list[int]]
    unit: str
    clock: int | None
    remarks: tuple[str, ...]


def _read_channels(path: Path) -> _Channels:
    """Read the description of the columns, which stands beside the file."""
    file = path.with_name(path.name.removesuffix(ENDS) + "_channels.tsv")
    table = text.open_table(file)
    components = table.texts("component")
    kinds = [kind.upper() for kind in table.texts("type")]
    tracked = table.texts("tracked_point")
    units = table.texts("units")
    places: dict[str, dict[str, int]] = {}
    for k, (kind, point) in enumerate(zip(kinds, tracked, strict=True)):
        if kind != "POS":
            continue
        axis = components[k].lower()
        of_point = places.setdefault(point, {})
        if axis in of_point:
            wanted = f"{axis} of '{point}' once"
            raise RecordingError.at(f"{file}, line {k + 2}", wanted, "it twice")
        of_point[axis] = k
    points = {name: at for name, at in places.items() if {*"xyz"} <= at.keys()}
    if not points:
        found = ", ".join(sorted(set(kinds))) or "none"
        wanted = "channels of the type POS with components x, y and z"
        raise RecordingError.at(file, wanted, found)
    remarks: tuple[str, ...] = ()
    lacking = len(places) - len(points)
    if lacking:
        left_out = f"{lacking} points without three coordinates are left out"
        remarks = (f"{file}: {left_out}",)
    coordinates = [[at[axis] for axis in "xyz"] for at in points.values()]
    return _Channels(
        file,
        number=len(kinds),
        points=list(points),
        places=coordinates,
        unit=_one_unit(file, {units[k] for at in coordinates for k in at}),
        clock=kinds.index("LATENCY") if "LATENCY" in kinds else None,
        remarks=remarks,
    )


def _one_unit(file: Path, units: set[str]) -> str:
    """Return the unit of all positions; empty if it is not stated."""
    if len(units) > 1:
        found = ", ".join(sorted(units))
        raise RecordingError.at(f"{file}: units", "one unit of all positions", found)
    (unit,) = units
    return "" if unit in _MISSING else unit


def _stated_up(path: Path) -> str:
    """Return the up axis if exactly one reference frame is described; else empty."""
    frames = _stated(path, "channels").get("reference_frame")
    levels = frames.get("Levels") if isinstance(frames, dict) else None
    if not isinstance(levels, dict):
        return ""
    axes = {
        str(level.get("SpatialAxes"))
        for level in levels.values()
        if isinstance(level, dict)
    }
    if len(axes) != 1:
        return ""
    letters = axes.pop().upper()
    if len(letters) != 3:
        return ""
    vertical = [
        _UP[letter] + axis
        for letter, axis in zip(letters, "xyz", strict=True)
        if letter in _UP
    ]
    return vertical[0] if len(vertical) == 1 else ""


def _stated(path: Path, suffix: str) -> dict[str, Any]:
    """Merge the JSON files that apply to a file; nearer ones override those above."""
    parts = set(path.name.removesuffix(ENDS).split("_"))
    stated: dict[str, Any] = {}
    for folder in reversed(path.absolute().parents[:_FOLDERS]):
        for file in sorted(folder.glob(f"*_{suffix}.json")):
            if set(file.stem.split("_")[:-1]) <= parts:
                stated.update(_json(file))
    return stated


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"{file}: expected json, found: {error}") from None
    if not isinstance(content, dict):
        raise RecordingError.at(file, "keys and values", type(content).__name__)
    return content
