"""3-D keypoints from video: of DeepLabCut, Anipose, JARVIS and SLEAP.

They come as CSV and HDF5. They state no unit and rarely a clock, but the confidence of
each point. In HDF5 they are pandas tables: either rows with pickled column names beside
them, or arrays of blocks with their names. SLEAP has arrays of its own.
"""

from __future__ import annotations

import pickletools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, h5py
from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import hdf5, qtm, sleap
from hopdata.recordings.readers.hdf5_checks import checked_attribute, whole_array

AXES = ("x", "y", "z")
SCORES = ("likelihood", "score", "confidence", "visibility")

# The name of a column that seems to be a time in an unknown unit, such as `t_ms`.
_OTHER_CLOCK = re.compile(r"(t|time|timestamp)([ _.(\[]|$)", re.IGNORECASE)

Columns = list[tuple[str, ...]]


def keypoints(
    path: Path,
    columns: Columns,
    values: FloatArray,
    rate_hz: float | None,
    least_score: float,
    unit: str = "",
) -> raw.RawRecording:
    """Make a recording from named columns.

    Parameters
    ----------
    path : path
        The file, for messages.
    columns : list of tuple of str
        The K names. For DeepLabCut: scorer, possibly individual, body part and
        coordinate. For Anipose: one name such as ``toe_x``.
    values : (N, K) array
        NaN where missing.
    rate_hz : float or None
        ``input.rate_hz``, since the file states no rate.
    least_score : float
        Points with a lower likelihood or score count as unseen.
    unit : str
        Unit of the values; mm is assumed if it is empty.

    Raises
    ------
    RecordingError
        If there is no rate, a name occurs twice, or no point has three coordinates.
    """
    points = [_point_and_coordinate(column) for column in columns]
    place_of: dict[tuple[str, str], int] = {}
    for place, point in enumerate(points):
        place_of.setdefault(point, place)
    names = _complete_points(path, points, place_of)
    places = [[place_of[name, axis] for axis in AXES] for name in names]
    positions = values[:, places]
    remarks: tuple[str, ...] = ()
    scored = []
    for marker, name in enumerate(names):
        for score in SCORES:
            if (name, score) in place_of:
                scored.append((marker, place_of[name, score]))
    if scored:
        markers = [marker for marker, _ in scored]
        scores = values[:, [place for _, place in scored]]
        n_unsure = _blank_unsure(positions, markers, scores, least_score)
        if n_unsure:
            count = f"{n_unsure} of {scores.size} places"
            below = f"have a score below {least_score:g} (input.least_score)"
            remarks = (f"{path}: {count} {below} and count as unseen",)
    clock, frame = _counters(columns, points)
    if clock is None and rate_hz is None:
        _refuse_other_clocks(path, columns)
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), names, may_lack=True),
        positions,
        number=_frame_numbers(values, frame),
        stamps=None if clock is None else values[:, clock],
        unit=(str(path), unit),
        rates_hz=(None, rate_hz),
        remarks=remarks,
    )


def _point_and_coordinate(column: tuple[str, ...]) -> tuple[str, str]:
    """Split the name of a column: levels without the scorer, or one name."""
    if len(column) == 1:
        name, _, coordinate = column[0].rpartition("_")
        return name, coordinate
    return " ".join(column[1:-1]), column[-1]


def _complete_points(
    path: Path, points: list[tuple[str, str]], place_of: dict[tuple[str, str], int]
) -> list[str]:
    """Return the names of the points with three coordinates."""
    names = []
    for name, coordinate in points:
        is_whole = all((name, axis) in place_of for axis in AXES)
        if coordinate == "x" and is_whole:
            names.append(name)
    if not names:
        is_plane = any(coordinate == "x" for _, coordinate in points)
        found = "one camera's plane" if is_plane else "none"
        how = "triangulate the cameras first (Anipose, or DeepLabCut's 3-D project)"
        wanted = "keypoints with coordinates x, y and z"
        raise RecordingError.at(path, wanted, f"{found}; {how}")
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        wanted = "distinct names of columns"
        raise RecordingError.at(path, wanted, f"'{min(twice)}' twice")
    return names


def _blank_unsure(
    positions: FloatArray, markers: list[int], scores: FloatArray, least_score: float
) -> int:
    """Set positions with a low score to NaN, in place; return how many had one."""
    is_sure = scores >= least_score
    of_markers = positions[:, markers]
    is_unsure = ~is_sure & np.isfinite(of_markers[:, :, 0])
    positions[:, markers] = np.where(is_sure[..., None], of_markers, np.nan)
    return int(is_unsure.sum())


def _counters(
    columns: Columns, points: list[tuple[str, str]]
) -> tuple[int | None, int | None]:
    """Return the columns of time and of frame numbers, if there are any."""
    counters: dict[str, int] = {}
    for place, (name, coordinate) in enumerate(points):
        counters.setdefault(qtm.counter(name + coordinate), place)
    frame = counters.get("Frame")
    if frame is None and columns[0] == ("",):
        frame = 0  # pandas' index has no name
    return counters.get("Time"), frame


def _refuse_other_clocks(path: Path, columns: Columns) -> None:
    """Raise an error that names a column which seems to be a time, but is not read.

    Its unit is not known, so it is not taken for the seconds that a rate follows from.
    """
    for column in columns:
        name = column[-1]
        if len(column) == 1 and _OTHER_CLOCK.match(name):
            raise raw.RateUnknownError.at(
                f"{path}: frame rate",
                "a column Time (in s), or a number in input.rate_hz",
                f"'{name}', which is not read; hopdata.read takes the rate as rate_hz",
            )


def _frame_numbers(values: FloatArray, frame: int | None) -> FloatArray:
    """Return the number of each row, from 1; rows may be missing."""
    number = np.arange(1.0, len(values) + 1)
    steps = np.diff(number if frame is None else values[:, frame])
    if steps.min(initial=1.0) > 0 and not (steps % 1).any():
        number[1:] += np.cumsum(steps / steps.min(initial=np.inf) - 1)
    return number


# Keypoints in HDF5.


def read_hdf5(
    path: Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float,
    least_score: float,
) -> raw.RawRecording:
    """Read a hopdata recording, a table of keypoints or SLEAP's tracks."""
    tracks = sleap.sleap_tracks(path, most_unpacked_mb)
    if tracks is not None:
        return keypoints(path, *tracks, rate_hz, least_score)
    table = pandas_table(path, most_unpacked_mb)
    if table is not None:
        return keypoints(path, *table, rate_hz, least_score)
    own = hdf5.read_recording(path, most_unpacked_mb=most_unpacked_mb)
    if own.filled is not None:  # filled positions were not seen
        own.positions[own.filled] = np.nan
    raw.blank_unseen(own.positions)
    names, renamed = raw.distinct_names(str(path), own.markers)
    return raw.RawRecording(
        names,
        own.time,
        own.positions,
        raw.resolve_rate(str(path), stated=own.rate_hz, given=rate_hz),
        unit="m",
        vertical_axis=own.vertical_axis,
        roles=own.roles,
        events=own.events,
        stated_up="z",
        remarks=own.remarks + renamed,
    )


def pandas_table(
    path: Path, most_unpacked_mb: float
) -> tuple[Columns, FloatArray] | None:
    """Read the first pandas table of an HDF5 file; None if there is none.

    Returns
    -------
    columns : list of tuple of str
    values : (N, K) array

    Raises
    ------
    RecordingError
        If the file cannot be read, or its table does not hold numbers.
    """
    with hdf5.opened(path, "not a table of keypoints", most_unpacked_mb) as file:
        groups = (item for item in map(file.get, file) if hasattr(item, "attrs"))
        group = next((g for g in groups if "pandas_type" in g.attrs), None)
        if group is None:
            return None
        if "table" in group:
            blocks = _rows_of(group["table"])
        else:
            blocks = _blocks_of(group)
        columns = [column for names, _ in blocks for column in names]
        values = np.concatenate([block for _, block in blocks], axis=1)
        if values.shape[1] != len(columns):
            found = f"found {values.shape[1]}"
            raise ValueError(f"expected {len(columns)} columns, {found}")
        return columns, values


def _rows_of(table: h5py.Dataset) -> list[tuple[Columns, FloatArray]]:
    """Return blocks of a row dataset with an index and fields ``values_block_<k>``."""
    rows = whole_array(table)
    blocks = []
    for name in rows.dtype.names or ():
        if name.startswith("values_block_"):
            names = _plain_pickle(checked_attribute(table, f"{name}_kind"))
            blocks.append((_named(names), _numbers(rows[name])))
    return blocks


def _blocks_of(group: h5py.Group) -> list[tuple[Columns, FloatArray]]:
    """Return blocks of ``block<k>_values``, each with the names of its columns."""
    blocks = []
    for k in range(int(hdf5.attribute(group, "nblocks", "a number"))):
        items = f"block{k}_items"
        values = _numbers(whole_array(group[f"block{k}_values"]))
        if items in group:
            columns = _named(whole_array(group[items]).tolist())
        else:
            columns = _names_of_levels(group, items)
        blocks.append((columns, values))
    return blocks


def _names_of_levels(group: h5py.Group, items: str) -> Columns:
    """Return names of several levels, each stored as its names and a code a column."""
    n_levels = int(hdf5.attribute(group, f"{items}_nlevels", "a number"))
    levels = []
    for i in range(n_levels):
        names = whole_array(group[f"{items}_level{i}"]).tolist()
        levels.append([name[0] for name in _named(names)])
    of_columns = []
    for i, level in enumerate(levels):
        codes = whole_array(group[f"{items}_label{i}"])
        of_columns.append([level[code] for code in codes])
    return list(zip(*of_columns, strict=True))


def _numbers(array: Any) -> FloatArray:
    if array.dtype.kind not in "iuf" or array.ndim != 2:
        found = f"found {array.dtype} of {array.shape}"
        raise ValueError(f"expected a table of numbers, {found}")
    return np.asarray(array, np.float64)


def _named(names: Any) -> Columns:
    """Require column names to be texts or tuples of texts."""
    if not isinstance(names, Sequence) or isinstance(names, str | bytes):
        raise ValueError(f"expected names of columns, found {type(names).__name__}")
    columns = [name if isinstance(name, tuple) else (name,) for name in names]
    return [tuple(map(_text, column)) for column in columns]


def _text(name: Any) -> str:
    """Return a name as text; a container is none, and could be longer as text."""
    if isinstance(name, bytes):
        return name.decode("utf-8", "replace")
    if not isinstance(name, str | int | float | type(None)):
        raise ValueError(f"expected names of columns, found {type(name).__name__}")
    return str(name)


# Operations of pickles that make texts, numbers, lists and tuples: all that names of
# columns need. Others look up or call something, or ask for memory by a number that
# stands in the file.
_VALUES = frozenset[str]().union(
    ("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4"),
    ("FLOAT", "BINFLOAT", "STRING", "BINSTRING", "SHORT_BINSTRING"),
    ("BINBYTES", "SHORT_BINBYTES", "BINBYTES8"),
    ("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
)
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_KEEP = ("PUT", "BINPUT", "LONG_BINPUT")
_TAKE = ("GET", "BINGET", "LONG_BINGET")


def _plain_pickle(data: Any) -> Any:
    """Return the texts, numbers, lists and tuples of a pickle, which is never loaded.

    Its operations are listed, and those that make these values are followed here.
    """
    if not isinstance(data, bytes):
        raise ValueError(f"expected names of columns, found {type(data).__name__}")
    follower = _Follower(len(data))
    for operation, argument, _ in pickletools.genops(data):
        try:
            follower.follow(operation.name, argument)
        except (IndexError, KeyError, AttributeError):
            found = f"a damaged pickle ({operation.name})"
            raise ValueError(f"expected names of columns, found {found}") from None
    return follower.stack.pop()


class _Follower:
    """Follows the operations of a pickle of `n_bytes` bytes."""

    def __init__(self, n_bytes: int) -> None:
        self.stack: list[Any] = []
        self._below: list[list[Any]] = []  # the stacks below each mark
        self._memo: dict[int, Any] = {}
        self._n_bytes = n_bytes

    def follow(self, name: str, argument: Any) -> None:
        """Do what an operation says.

        Raises
        ------
        ValueError
            If it makes anything but plain values.
        IndexError, KeyError, AttributeError
            If it needs what is not there.
        """
        if name in _VALUES:
            if name.endswith("STRING"):  # of Python 2, where it is ASCII
                argument = argument.encode("latin-1").decode("ascii")
            self.stack.append(argument)
        elif name in _CONSTANTS:
            self.stack.append(_CONSTANTS[name])
        elif name in _TUPLES:
            n_values = _TUPLES[name]
            values = [self.stack.pop() for _ in range(n_values)]
            self.stack.append(tuple(reversed(values)))
        elif name in _KEEP:
            self._keep(int(argument))
        elif name == "MEMOIZE":
            self._keep(len(self._memo))
        elif name in _TAKE:
            self.stack.append(self._memo[int(argument)])
        else:
            self._arrange(name)

    def _keep(self, entry: int) -> None:
        """Remember the value at the top.

        An entry beyond the bytes of the pickle shows that it is not one of names.
        """
        if entry > self._n_bytes:
            found = f"a pickle of {self._n_bytes} bytes with an entry {entry}"
            raise ValueError(f"expected names of columns, found {found}")
        self._memo[entry] = self.stack[-1]

    def _arrange(self, name: str) -> None:
        """Do what an operation says about values that are there."""
        if name == "MARK":
            self._below.append(self.stack)
            self.stack = []
        elif name in ("LIST", "TUPLE", "APPENDS", "POP_MARK"):
            values = self.stack
            self.stack = self._below.pop()
            if name == "LIST":
                self.stack.append(values)
            elif name == "TUPLE":
                self.stack.append(tuple(values))
            elif name == "APPENDS":
                self.stack[-1].extend(values)
        elif name == "EMPTY_LIST":
            self.stack.append([])
        elif name == "APPEND":
            value = self.stack.pop()
            self.stack[-1].append(value)
        elif name == "DUP":
            self.stack.append(self.stack[-1])
        elif name == "POP":
            self.stack.pop()
        elif name not in ("PROTO", "FRAME", "STOP"):
            found = f"a pickle of more ({name})"
            raise ValueError(f"expected names of columns, found {found}")
