"""Reader of SLEAP's points in three dimensions, in HDF5 and in CSV.

Cameras that were triangulated (SLEAP-Anipose) give an array ``tracks`` of frames,
animals, nodes and coordinates. SLEAP's analysis files have the axes in another order:
animals, coordinates, nodes and frames, or as their attribute ``dims`` says. An analysis
CSV has a row for each animal and frame. What one camera saw is refused, since a plane
has no landing.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, h5py
from hopdata.errors import RecordingError
from hopdata.recordings.readers import hdf5, text
from hopdata.recordings.readers.hdf5_checks import checked_attribute, whole_array

if TYPE_CHECKING:
    from hopdata.recordings.readers.keypoints import Columns

AXES = ("x", "y", "z")

# Axes of the array, as SLEAP's attribute `dims` names them.
_OURS = ("frame", "track", "node", "xy")
_ANALYSIS = ("track", "xy", "node", "frame")

_PLANE = "one camera's plane; triangulate the cameras first (SLEAP-Anipose)"


def sleap_tracks(
    path: Path, most_unpacked_mb: float
) -> tuple[Columns, FloatArray] | None:
    """Read the points of a file of HDF5; None if it is not one of SLEAP.

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
        order = _axes(file, tracks)
        stored = np.asarray(whole_array(tracks, float), np.float64)
        points = stored.transpose(order)
        scores = _scores(file, order, points.shape[:3])
        axes: tuple[str, ...] = AXES
        if scores is not None:
            points = np.concatenate([points, scores[..., None]], axis=3)
            axes = (*AXES, "score")
        n_frames, n_animals, n_nodes, _ = points.shape
        nodes = _names(file, "node_names", n_nodes, "node")
        animals = _names(file, "track_names", n_animals, "animal")
    return _columns(animals, nodes, axes), points.reshape(n_frames, -1)


def _columns(
    animals: Sequence[str], nodes: Sequence[str], axes: Sequence[str]
) -> Columns:
    """Return the names of columns; without that of the animal if there is only one."""
    of_animals = [(animal,) if len(animals) > 1 else () for animal in animals]
    return [
        ("SLEAP", *animal, node, axis)
        for animal in of_animals
        for node in nodes
        for axis in axes
    ]


def _axes(file: h5py.File, tracks: h5py.Dataset) -> tuple[int, ...]:
    """Return where the axes frames, animals, nodes, coordinates are in the array."""
    shape = tracks.shape
    if len(shape) != 4:
        wanted = "expected frames x animals x nodes x 3"
        raise ValueError(f"dataset 'tracks': {wanted}, found shape {shape}")
    stated = _dims(tracks)
    if stated is None:
        stated = _OURS
        if "track_occupancy" in file or (shape[3] > 3 and shape[1] in (2, 3)):
            stated = _ANALYSIS
    order = tuple(stated.index(axis) for axis in _OURS)
    n_coordinates = shape[order[3]]
    if n_coordinates != len(AXES):
        found = f"an array of shape {shape}"
        if n_coordinates == 2:
            found = f"{found}, {_PLANE}"
        wanted = "expected frames x animals x nodes x 3"
        raise ValueError(f"dataset 'tracks': {wanted}, found {found}")
    return order


def _dims(tracks: h5py.Dataset) -> tuple[str, ...] | None:
    """Return the names of the axes that the file states, if it does."""
    stated = checked_attribute(tracks, "dims")
    if isinstance(stated, bytes):
        stated = stated.decode("utf-8", "replace")
    if not isinstance(stated, str):
        return None
    try:
        dims = json.loads(stated)
    except (ValueError, RecursionError):
        return None
    is_known = isinstance(dims, list) and all(isinstance(one, str) for one in dims)
    if not is_known or sorted(dims) != sorted(_OURS):
        raise ValueError(
            f"attribute 'dims': expected {', '.join(_OURS)}, found {stated[:60]}"
        )
    return tuple(dims)


def _scores(
    file: h5py.File, order: tuple[int, ...], shape: tuple[int, ...]
) -> FloatArray | None:
    """Return the scores of points (frames, animals, nodes), if the file has them."""
    stored: Any = file.get("point_scores")
    if not hasattr(stored, "dtype") or len(stored.shape) != 3:
        return None
    # As the array of tracks, without the axis of coordinates.
    without = [place - (place > order[3]) for place in order[:3]]
    scores = np.asarray(whole_array(stored, float), np.float64).transpose(without)
    if scores.shape != shape:
        wanted = f"expected {shape} as in 'tracks'"
        raise ValueError(f"dataset 'point_scores': {wanted}, found {scores.shape}")
    return scores


def _names(file: h5py.File, key: str, number: int, word: str) -> list[str]:
    numbered = [f"{word} {k + 1}" for k in range(number)]
    if key not in file or not file[key].shape or not file[key].shape[0]:
        return numbered
    names = list(hdf5.stored_texts(file, key))
    if len(names) != number:
        raise ValueError(
            f"dataset '{key}': expected {number} names, found {len(names)}"
        )
    return names


# The analysis CSV: `track, frame_idx, instance.score, head.x, head.y, head.z, ...`.

_FRAME = "frame_idx"
_TRACK = "track"


def is_analysis(names: Sequence[str]) -> bool:
    """Tell whether the columns are those of SLEAP's analysis CSV."""
    return _FRAME in names and _TRACK in names


def analysis_table(rows: text.Rows, names: Sequence[str]) -> tuple[Columns, FloatArray]:
    """Read an analysis CSV, whose rows are animals in frames.

    Parameters
    ----------
    rows : Rows
        Rows below the names.
    names : sequence of str
        Names of the columns.

    Returns
    -------
    columns : list of tuple of str
        As `sleap_tracks`, and the number of the frame.
    values : (N, K) array
        A row for each frame in which any animal was seen, NaN where a node was not.

    Raises
    ------
    RecordingError
        If the points have no z, or an animal has two rows in a frame.
    """
    place_of = {name: place for place, name in enumerate(names)}
    nodes = [name[:-2] for name in names if name.endswith(".x")]
    solid = [node for node in nodes if f"{node}.z" in place_of]
    if not solid:
        found = _PLANE if nodes else "none"
        wanted = "points with columns <node>.x, .y and .z"
        raise RecordingError.at(rows.line(-1), wanted, found)
    axes: tuple[str, ...] = AXES
    if all(f"{node}.score" in place_of for node in solid):
        axes = (*AXES, "score")
    wanted_names = [f"{node}.{axis}" for node in solid for axis in axes]
    lacking = [name for name in wanted_names if name not in place_of]
    if lacking:
        raise RecordingError.at(rows.line(-1), f"a column {lacking[0]}", "none")
    columns = [place_of[name] for name in wanted_names]
    frames, flat = rows.numbers([place_of[_FRAME]], columns)
    if np.isnan(frames).any():
        row = int(np.argmax(np.isnan(frames)))
        place = f"{rows.line(row)}: {_FRAME}"
        raise RecordingError.at(place, "a number", "a missing value")
    tracks = rows.texts(place_of[_TRACK])[: len(frames)]
    animals = list(dict.fromkeys(tracks))
    numbers, of_row = np.unique(frames[:, 0], return_inverse=True)
    of_animal = [animals.index(track) for track in tracks]
    cells = len(numbers) * len(animals) * len(columns)
    if cells > 8 * flat.size + text.MOST_CELLS:
        found = f"{len(animals)} animals in {len(frames)} rows"
        wanted = "animals that were seen in more than a few frames"
        raise RecordingError.at(rows.path, wanted, found)
    values = np.full((len(numbers), len(animals), len(columns)), np.nan)
    seen = np.zeros((len(numbers), len(animals)), bool)
    for row, (frame, animal) in enumerate(zip(of_row, of_animal, strict=True)):
        if seen[frame, animal]:
            wanted = f"one row of '{animals[animal]}' in frame {numbers[frame]:g}"
            raise RecordingError.at(rows.line(row), wanted, "two")
        seen[frame, animal] = True
        values[frame, animal] = flat[row]
    heads = _columns(animals, solid, axes)
    table = values.reshape(len(numbers), -1)
    return [("frame",), *heads], np.column_stack([numbers, table])
