"""3-D keypoints from video: of DeepLabCut, Anipose and JARVIS as CSV or HDF5, of SLEAP as HDF5.

They state no unit and rarely a clock, but the confidence of each point. In HDF5 they
are pandas tables: either rows with pickled column names beside them, or arrays of
blocks with their names. SLEAP's triangulated points are an array ``tracks`` of frames,
animals, nodes and coordinates.
"""

from __future__ import annotations

import pickle
import pickletools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, h5py
from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import hdf5, qtm

AXES = ("x", "y", "z")
SCORES = ("likelihood", "score", "confidence", "visibility")

Columns = list[tuple[str, ...]]


def keypoints(
    path: Path, columns: Columns, values: FloatArray, rate_hz: float | None, least_score: float,
    unit: str = "",
) -> raw.RawRecording:  # fmt: skip
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
    split = [
        c[0].rpartition("_")[::2] if len(c) == 1 else (" ".join(c[1:-1]), c[-1])
        for c in columns
    ]
    at = {part: k for k, part in reversed(list(enumerate(split)))}
    counters = {
        qtm.counter(n + end): k for k, (n, end) in reversed(list(enumerate(split)))
    }
    clock, frame = (
        counters.get("Time"),
        counters.get("Frame", 0 if columns[0] == ("",) else None),
    )
    names = [
        n
        for n, axis in split
        if axis == "x" and all((n, other) in at for other in AXES)
    ]
    if not names:
        found = "one camera's plane" if ("x" in {axis for _, axis in split}) else "none"
        found += (
            "; triangulate the cameras first (Anipose, or DeepLabCut's 3-D project)"
        )
        raise RecordingError.at(path, "keypoints with coordinates x, y and z", found)
    if twice := {n for n in names if names.count(n) > 1}:
        raise RecordingError.at(
            path, "distinct names of columns", f"'{min(twice)}' twice"
        )
    positions = values[:, [[at[n, axis] for axis in AXES] for n in names]]
    scored = [
        (m, at[n, s]) for m, n in enumerate(names) for s in SCORES if (n, s) in at
    ]
    remarks = []
    if scored:
        places, scores = (list(column) for column in zip(*scored, strict=True))
        sure = values[:, scores] >= least_score
        unsure = ~sure & np.isfinite(positions[:, places, 0])
        positions[:, places] = np.where(sure[..., None], positions[:, places], np.nan)
        told = (
            f"{unsure.sum()} of {unsure.size} places have a score below {least_score:g}"
        )
        remarks = [f"{path}: {told} (input.least_score) and count as unseen"] * bool(
            unsure.any()
        )
    number = np.arange(1.0, len(values) + 1)
    steps = np.diff(number if frame is None else values[:, frame])
    if steps.min(initial=1.0) > 0 and not (steps % 1).any():  # rows may be missing
        number[1:] += np.cumsum(steps / steps.min(initial=np.inf) - 1)
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), names, may_lack=True),
        positions,
        number=number,
        stamps=None if clock is None else values[:, clock],
        unit=(str(path), unit),
        rates_hz=(None, rate_hz),
        remarks=tuple(remarks),
    )


def read_hdf5(
    path: Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float,
    least_score: float,
) -> raw.RawRecording:
    """Read an HDF5 file that holds a hopdata recording, a table of keypoints or SLEAP's tracks."""
    if (tracks := sleap_tracks(path, most_unpacked_mb)) is not None:
        return keypoints(path, *tracks, rate_hz, least_score)
    if (table := pandas_table(path, most_unpacked_mb)) is not None:
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


def sleap_tracks(
    path: Path, most_unpacked_mb: float
) -> tuple[Columns, FloatArray] | None:
    """Read the points that SLEAP's cameras triangulated; None if the file has no such array.

    Returns
    -------
    columns : list of tuple of str
        Name of each node, with its animal if there are several, and coordinate.
    values : (N, K) array
        NaN where a node was not seen.

    Raises
    ------
    RecordingError
        If the file cannot be read, or its tracks are those of one camera.
    """
    with hdf5.opened(path, "not a file of SLEAP", most_unpacked_mb) as file:
        tracks = file.get("tracks")
        if not hasattr(tracks, "dtype"):
            return None
        if len(tracks.shape) != 4 or tracks.shape[3] != len(AXES):
            how = "triangulate the cameras first (SLEAP's points3d.h5)"
            found = f"an array of shape {tracks.shape}; {how}"
            wanted = "frames x animals x nodes x 3"
            raise ValueError(f"dataset 'tracks': expected {wanted}, found {found}")
        values = np.asarray(hdf5.whole_array(tracks, float), np.float64)
        n_frames, n_animals, n_nodes, _ = values.shape
        names = [f"node {k + 1}" for k in range(n_nodes)]
        if "node_names" in file:
            names = list(hdf5.stored_texts(file, "node_names"))
        if len(names) != n_nodes:
            raise ValueError(
                f"dataset 'node_names': expected {n_nodes} names, found {len(names)}"
            )
        animals: list[tuple[str, ...]] = [()]
        if n_animals > 1:
            animals = [(f"animal {k + 1}",) for k in range(n_animals)]
        columns: Columns = [
            ("SLEAP", *animal, name, axis)
            for animal in animals
            for name in names
            for axis in AXES
        ]
        return columns, values.reshape(n_frames, -1)


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
        blocks = _rows_of(group["table"]) if "table" in group else _blocks_of(group)
        columns = [column for names, _ in blocks for column in names]
        values = np.concatenate([block for _, block in blocks], axis=1)
        if values.shape[1] != len(columns):
            raise ValueError(
                f"expected {len(columns)} columns, found {values.shape[1]}"
            )
        return columns, values


def _rows_of(table: h5py.Dataset) -> list[tuple[Columns, FloatArray]]:
    """Return blocks of a row dataset with an index and fields ``values_block_<k>``."""
    rows = hdf5.whole_array(table)
    fields = [f for f in rows.dtype.names or () if f.startswith("values_block_")]
    return [
        (
            _named(_plain_pickle(hdf5.checked_attribute(table, f"{f}_kind"))),
            _numbers(rows[f]),
        )
        for f in fields
    ]


def _blocks_of(group: h5py.Group) -> list[tuple[Columns, FloatArray]]:
    """Return blocks of ``block<k>_values``, with the levels of their names or the names."""
    blocks = []
    for k in range(int(hdf5.attribute(group, "nblocks", "a number"))):
        at = f"block{k}_items"
        values = _numbers(hdf5.whole_array(group[f"block{k}_values"]))
        if at in group:
            named = _named(hdf5.whole_array(group[at]).tolist())
        else:
            levels = [
                [
                    name[0]
                    for name in _named(
                        hdf5.whole_array(group[f"{at}_level{i}"]).tolist()
                    )
                ]
                for i in range(int(hdf5.attribute(group, f"{at}_nlevels", "a number")))
            ]
            codes = [
                hdf5.whole_array(group[f"{at}_label{i}"]) for i in range(len(levels))
            ]
            parts = (
                [level[c] for c in of] for level, of in zip(levels, codes, strict=True)
            )
            named = list(zip(*parts, strict=True))
        blocks.append((named, values))
    return blocks


def _numbers(array: Any) -> FloatArray:
    if array.dtype.kind not in "iuf" or array.ndim != 2:
        raise ValueError(
            f"expected a table of numbers, found {array.dtype} of {array.shape}"
        )
    return np.asarray(array, np.float64)


def _named(names: Any) -> Columns:
    """Require column names to be texts or tuples of texts."""
    if not isinstance(names, Sequence) or isinstance(names, str | bytes):
        raise ValueError(f"expected names of columns, found {type(names).__name__}")
    columns = [name if isinstance(name, tuple) else (name,) for name in names]
    return [tuple(map(_text, column)) for column in columns]


def _text(name: Any) -> str:
    """Return a name as text; a container is none, and could be far longer as text than it is."""
    if isinstance(name, bytes):
        return name.decode("utf-8", "replace")
    if not isinstance(name, str | int | float | type(None)):
        raise ValueError(f"expected names of columns, found {type(name).__name__}")
    return str(name)


# Operations of pickles that make texts, numbers, lists and tuples: all that names of
# columns need. Others look up or call something, or ask for memory by a number that
# stands in the file.
_PLAIN_OPERATIONS = frozenset(
    [
        *("PROTO", "FRAME", "STOP", "MARK", "POP", "POP_MARK", "DUP"),
        *(
            "INT",
            "BININT",
            "BININT1",
            "BININT2",
            "LONG",
            "LONG1",
            "LONG4",
            "FLOAT",
            "BINFLOAT",
        ),
        *("NONE", "NEWTRUE", "NEWFALSE"),
        *(
            "STRING",
            "BINSTRING",
            "SHORT_BINSTRING",
            "BINBYTES",
            "SHORT_BINBYTES",
            "BINBYTES8",
        ),
        *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
        *("LIST", "EMPTY_LIST", "APPEND", "APPENDS"),
        *("TUPLE", "EMPTY_TUPLE", "TUPLE1", "TUPLE2", "TUPLE3"),
        *("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE", "GET", "BINGET", "LONG_BINGET"),
    ]
)


def _plain_pickle(data: Any) -> Any:
    """Unpickle texts, numbers, lists and tuples; refuse any other pickle before it is run.

    The memo of a pickle is a list as long as its largest entry, so an entry that is
    larger than the pickle has bytes is refused too.
    """
    if not isinstance(data, bytes):
        raise ValueError(f"expected names of columns, found {type(data).__name__}")
    for operation, argument, _ in pickletools.genops(data):
        if operation.name not in _PLAIN_OPERATIONS:
            found = f"a pickle of more ({operation.name})"
            raise ValueError(f"expected names of columns, found {found}")
        is_entry = operation.name in ("PUT", "BINPUT", "LONG_BINPUT")
        if is_entry and int(argument or 0) > len(data):
            found = f"a pickle of {len(data)} bytes with an entry {argument}"
            raise ValueError(f"expected names of columns, found {found}")
    return pickle.loads(data)
