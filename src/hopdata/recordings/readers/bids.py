"""Motion-BIDS: numbers in ``_motion.tsv``, described by ``_channels.tsv`` and JSON files.

In the brain imaging data structure, a JSON file may also stand in a parent folder. It
then applies to all files whose names contain the parts of its own name.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import text

ENDS = "_motion.tsv"
_FOLDERS = 4  # levels of a dataset: motion, session, subject, dataset
_UP = {"S": "", "U": "", "I": "-", "D": "-"}  # superior, up, inferior, down
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
    channels = path.with_name(path.name.removesuffix(ENDS) + "_channels.tsv")
    table = text.open_table(channels)
    columns = {
        key: table.texts(key) for key in ("component", "type", "tracked_point", "units")
    }
    kinds = [kind.upper() for kind in columns["type"]]
    places: dict[str, dict[str, int]] = {}
    for k, (kind, point) in enumerate(
        zip(kinds, columns["tracked_point"], strict=True)
    ):
        if kind == "POS":
            axis = columns["component"][k].lower()
            if axis in places.setdefault(point, {}):
                wanted = f"{axis} of '{point}' once"
                raise RecordingError.at(f"{channels}, line {k + 2}", wanted, "it twice")
            places[point][axis] = k
    points = {name: at for name, at in places.items() if {*"xyz"} <= at.keys()}
    if not points:
        found = ", ".join(sorted(set(kinds))) or "none"
        wanted = "channels of the type POS with components x, y and z"
        raise RecordingError.at(channels, wanted, found)
    at = np.array([[found[axis] for axis in "xyz"] for found in points.values()])
    units = {columns["units"][k] for k in at.ravel()}
    if len(units) > 1:
        wanted = "one unit of all positions"
        raise RecordingError.at(f"{channels}: units", wanted, ", ".join(sorted(units)))
    stated = units.pop()
    told = _told(path, "motion")
    stamped = [kinds.index("LATENCY")] if "LATENCY" in kinds else []
    with text.readable(path) as file:
        first = file.readline()
    named = not any(
        map(text.is_number, text.split_line(path, first))
    )  # the standard forbids names
    rows = text.Rows(path, int(named), len(first) * named, len(kinds))
    _, numbers, stamps = rows.numbers([], at.ravel().tolist(), stamped)
    missing = told.get("MissingValues")
    if missing is not None and text.is_number(str(missing)):
        numbers[numbers == float(missing)] = np.nan
    positions = numbers.reshape(len(numbers), -1, 3)
    if np.isnan(stamps).any():
        row = int(np.argmax(np.isnan(stamps)))
        raise RecordingError.at(f"{path}, line {row + 1}: LATENCY", "a time", "none")
    rate = told.get("SamplingFrequency")
    if not isinstance(rate, int | float | None):
        raise RecordingError.at(f"{path}: SamplingFrequency", "a number", f"'{rate}'")
    lacking = len(places) - len(points)
    flat = f"{channels}: {lacking} points without three coordinates are left out"
    return raw.assembled(
        str(path),
        raw.distinct_names(str(channels), list(points), may_lack=True),
        positions,
        number=np.arange(1.0, len(numbers) + 1),
        stamps=stamps[:, 0].copy() if stamped else None,
        unit=(f"{channels}: units", "" if stated in _MISSING else stated),
        rates_hz=(rate, rate_hz),
        rate_place=f"{path}: SamplingFrequency",
        remarks=(flat,) * bool(lacking),
        stated_up=_stated_up(path),
    )


def _stated_up(path: Path) -> str:
    """Return the up axis if exactly one reference frame is described; else empty."""
    frames = _told(path, "channels").get("reference_frame")
    levels = frames.get("Levels") if isinstance(frames, dict) else None
    levels = list(levels.values()) if isinstance(levels, dict) else []
    axes = {
        str(level.get("SpatialAxes")) for level in levels if isinstance(level, dict)
    }
    letters = axes.pop().upper() if len(axes) == 1 else ""
    ups = [_UP[a] + axis for a, axis in zip(letters, "xyz", strict=False) if a in _UP]
    return ups[0] if len(letters) == 3 and len(ups) == 1 else ""


def _told(path: Path, suffix: str) -> dict[str, Any]:
    """Merge the JSON files that apply to a file; nearer ones override those further away."""
    parts, found = set(path.name.removesuffix(ENDS).split("_")), {}
    for folder in reversed(path.absolute().parents[:_FOLDERS]):
        for file in sorted(folder.glob(f"*_{suffix}.json")):
            if set(file.stem.split("_")[:-1]) <= parts:
                found.update(_json(file))
    return found


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise RecordingError(f"{file}: expected json, found: {error}") from None
    if not isinstance(content, dict):
        raise RecordingError.at(file, "keys and values", type(content).__name__)
    return content
