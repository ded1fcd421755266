"""Recordings, and the truth of synthetic ones, as HDF5 files.

The HDF5 library trusts a file: on a damaged one it may run for ever or end the process.
So only a file whose seal is whole (`hopdata.seal`) is read in this process. Any other
comes in through `hopdata.foreign.door`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata import __version__
from hopdata.arrays import h5py
from hopdata.errors import RecordingError
from hopdata.foreign import door
from hopdata.jobs import whole_file
from hopdata.recording import ROLES, Event, Recording
from hopdata.recordings.axes import FILE_AXES
from hopdata.recordings.raw import FASTEST_HZ
from hopdata.recordings.readers.hdf5_checks import (
    checked_attribute,
    require_sound,
    whole_array,
)
from hopdata.seal import Seal, seal_of, sealed
from hopdata.time_stamps import SLOWEST_S
from hopdata.truth import Truth, check_sizes

# Datasets and attributes of an HDF5 group are refused unless they are of the expected
# kind.

# Kinds of dtype; complex numbers, text and records are not numbers.
_NUMBERS = "biuf"

# Most datasets of another layout that a message names.
MOST_NAMED = 5


def numbers(group: h5py.Group, name: str) -> NDArray[Any]:
    """Read an array of numbers as float64, or of booleans unchanged.

    Raises
    ------
    ValueError
        If the dataset does not exist, or holds something else.
    """
    found = group.get(name)
    if not isinstance(found, h5py.Dataset):
        raise ValueError(f"dataset '{name}': expected numbers, found none")
    if found.dtype.kind not in _NUMBERS or not found.shape:
        kind = f"{found.dtype} of shape {found.shape}"
        wanted = "expected an array of numbers"
        raise ValueError(f"dataset '{name}': {wanted}, found {kind}")
    _require_all_parts(found)
    if found.dtype == np.bool_:
        return whole_array(found)
    return whole_array(found, float)


def _require_all_parts(dataset: h5py.Dataset) -> None:
    """Refuse an array of which parts were not stored.

    The library would fill them with zeros. Programs that write recordings store each
    part. A damaged index loses some.
    """
    if dataset.chunks is None or not dataset.size:
        return
    found: set[tuple[int, ...]] = set()
    # What is called here must not raise.
    dataset.id.chunk_iter(lambda stored: found.add(stored.chunk_offset))
    starts = [
        range(0, length, step)
        for length, step in zip(dataset.shape, dataset.chunks, strict=True)
    ]
    n_inside = 0
    for offset in found:
        of_axes = zip(offset, starts, strict=True)
        if all(start in possible for start, possible in of_axes):
            n_inside += 1
    n_wanted = prod(map(len, starts))
    if n_inside != n_wanted:
        parts = f"expected {n_wanted} parts, found {n_inside}"
        raise ValueError(f"dataset '{dataset.name}': {parts}")


_KINDS: dict[str, Any] = {"a number": int | float, "text": str, "a list of texts": list}


def attribute(group: h5py.Group, name: str, kind: str) -> Any:
    """Read an attribute: ``"a number"``, ``"text"`` or ``"a list of texts"``.

    Raises
    ------
    ValueError
        If the attribute does not exist, or is something else.
    """
    found = checked_attribute(group, name)
    value = found.tolist() if isinstance(found, np.ndarray | np.generic) else found
    if kind == "a number" and isinstance(value, list) and len(value) == 1:
        value = value[0]
    entries = value if isinstance(value, list) else []
    are_texts = all(isinstance(entry, str) for entry in entries)
    if not isinstance(value, _KINDS[kind]) or not are_texts:
        told = "none" if found is None else found
        raise ValueError(f"attribute '{name}': expected {kind}, found {told}")
    return value


def stored_texts(group: h5py.Group, name: str) -> tuple[str, ...]:
    """Read a dataset that is a list of texts.

    Raises
    ------
    ValueError
        If the dataset does not exist, or holds something else.
    """
    found = group.get(name)
    wanted = f"dataset '{name}': expected a list of texts"
    is_dataset = isinstance(found, h5py.Dataset)
    if not is_dataset or h5py.check_string_dtype(found.dtype) is None:
        raise ValueError(f"{wanted}, found {found}")
    entries = whole_array(found)
    if entries.ndim != 1:
        raise ValueError(f"{wanted}, found {entries.shape}")
    return tuple(entry.decode("utf-8", "replace") for entry in entries)


# Recordings and truths.

# Frames of a chunk, and level of compression of 9; 6 takes 1.5 times as long to save
# 3 % of the bytes.
CHUNK_FRAMES = 16384
COMPRESSION = 2

# Start of every HDF5 file.
SIGNATURE = b"\x89HDF\r\n\x1a\n"

_TRUTH_ATTRIBUTES = ("noise_m", "parameters_json", "true_effect")
_TRUTH_OPTIONAL = "longer_m"  # only where legs scatter
_TRUTH_DATASETS = tuple(
    one.name
    for one in fields(Truth)
    if one.name not in (*_TRUTH_ATTRIBUTES, _TRUTH_OPTIONAL)
)
_TEXT_ATTRIBUTES = ("name", "source", "source_sha256", "vertical_axis")


def write_recording(
    path: str | Path, recording: Recording, truth: Truth | None = None
) -> None:
    """Write a recording, and its truth if available, to an HDF5 file.

    The file appears under its name only when complete, and ends in the checksum of all
    its bytes (`hopdata.seal`). Positions are stored as float64, so that
    `read_recording` returns every digit. float32 about the origin of the laboratory
    would not do: its steps are 8 mm at 100 km. Coordinates of each marker are stored
    one after the other, shuffled and deflated. Equal content gives equal bytes.

    Parameters
    ----------
    path : path
        File to write; replaced if it exists.
    recording : Recording
    truth : Truth, optional
    """
    # If writing fails, a chunk left in memory crashes the process when it ends.
    chunks: Any = {"rdcc_nbytes": 0, "locking": False}
    with (
        whole_file(path) as partial,
        sealed(partial),
        h5py.File(partial, "w", **chunks) as file,
    ):
        _dataset(file, "time", recording.time)
        _dataset(file, "positions", recording.positions)
        if recording.filled is not None:
            _dataset(file, "filled", recording.filled)
        file.attrs["markers"] = list(recording.markers)
        file.attrs["roles"] = list(recording.roles)
        file.attrs["rate_hz"] = recording.rate_hz
        for key in _TEXT_ATTRIBUTES:
            file.attrs[key] = getattr(recording, key)
        file.attrs["hopdata_version"] = __version__
        if recording.events:
            times = np.asarray([event.time_s for event in recording.events])
            labels = [event.label for event in recording.events]
            _dataset(file, "events/time", times)
            _texts(file, "events/label", labels)
        if recording.remarks:
            _texts(file, "remarks", recording.remarks)
        if truth is not None:
            group = file.create_group("truth")
            for key in _TRUTH_DATASETS:
                _dataset(group, key, getattr(truth, key))
            if truth.longer_m is not None:
                _dataset(group, _TRUTH_OPTIONAL, truth.longer_m)
            for key in _TRUTH_ATTRIBUTES:
                group.attrs[key] = getattr(truth, key)


def read_recording(path: str | Path, *, most_unpacked_mb: float = np.inf) -> Recording:
    """Read a recording from an HDF5 file.

    Parameters
    ----------
    path : path
    most_unpacked_mb : float
        Most memory that the file may use, MB; by default unlimited, for files written
        by hopdata.

    Raises
    ------
    RecordingError
        If the file cannot be read, lacks a dataset or attribute, or their kinds or
        sizes do not form a recording.
    """
    try:
        return _recording(path, most_unpacked_mb)
    except UnsealedError:
        return _through_door("read_recording", path, Recording, Event)


def _through_door(function: str, path: str | Path, *kinds: type) -> Any:
    """Call a function of this module on a file that hopdata did not seal."""
    return door.read(
        f"{__name__}:{function}",
        str(path),
        place=path,
        n_bytes=door.size_of(path),
        reader="the HDF5 library",
        kinds=kinds,
        libraries=("h5py",),
    )


def _recording(path: str | Path, most_unpacked_mb: float) -> Recording:
    with opened(path, "not a recording", most_unpacked_mb) as file:
        _require_own_layout(file)
        recording = Recording(
            time=numbers(file, "time"),
            positions=numbers(file, "positions"),
            markers=tuple(attribute(file, "markers", "a list of texts")),
            roles=tuple(attribute(file, "roles", "a list of texts")),
            rate_hz=float(attribute(file, "rate_hz", "a number")),
            **{key: attribute(file, key, "text") for key in _TEXT_ATTRIBUTES},
            events=_read_events(file),
            remarks=stored_texts(file, "remarks") if "remarks" in file else (),
            filled=numbers(file, "filled").astype(bool) if "filled" in file else None,
        )
        _require_known("roles", set(recording.roles), ROLES)
        _require_known("vertical_axis", {recording.vertical_axis}, FILE_AXES)
        slowest_hz = 1 / SLOWEST_S
        if not slowest_hz <= recording.rate_hz <= FASTEST_HZ:
            wanted = f"expected at least {slowest_hz:g} and at most {FASTEST_HZ:g} Hz"
            raise ValueError(f"rate_hz: {wanted}, found {recording.rate_hz:g}")
        _require_possible(recording)
        return recording


def _require_own_layout(file: h5py.Group) -> None:
    """Refuse a file of another program with the way in for its arrays.

    Raises
    ------
    ValueError
        If the file has none of the datasets of a recording's positions.
    """
    if "positions" in file:
        return
    found = ", ".join(f"'{name}'" for name in sorted(file)[:MOST_NAMED]) or "none"
    raise ValueError(
        "expected hopdata's own layout, with the datasets 'time' and 'positions', "
        f"found {found}: read other arrays in Python, and write them with "
        "hopdata.Recording.from_arrays(...).save(FILE), or export CSV"
    )


def _require_possible(recording: Recording) -> None:
    """Refuse times that do not increase, and coordinates that are infinite."""
    steps_s = np.diff(recording.time)
    is_later = (steps_s > 0) & np.isfinite(steps_s)
    if not is_later.all():
        frame = int(np.argmin(is_later)) + 1
        before, here = recording.time[frame - 1 : frame + 1]
        wanted = "expected finite times that increase"
        raise ValueError(f"time: {wanted}, found {here:g} s after {before:g} s")
    if np.isinf(recording.positions).any():
        raise ValueError("positions: expected finite or missing ones, found infinity")


def _require_known(key: str, values: set[str], known: Iterable[str]) -> None:
    for value in values - set(known):
        wanted = f"expected any of {', '.join(known)}"
        raise ValueError(f"{key}: {wanted}, found '{value}'")


def read_truth(path: str | Path) -> Truth | None:
    """Read the truth of a synthetic recording; None if the file has none.

    Raises
    ------
    RecordingError
        If the file cannot be read or its truth is incomplete.
    """
    try:
        return _truth(path)
    except UnsealedError:
        found: Truth | None = _through_door("read_truth", path, Truth)
        return found


def _truth(path: str | Path) -> Truth | None:
    with opened(path, "truth is not whole") as file:
        if "truth" not in file:
            return None
        group = file["truth"]
        datasets = {key: numbers(group, key) for key in _TRUTH_DATASETS}
        if _TRUTH_OPTIONAL in group:
            datasets[_TRUTH_OPTIONAL] = numbers(group, _TRUTH_OPTIONAL)
        noise_m = float(attribute(group, "noise_m", "a number"))
        parameters_json = attribute(group, "parameters_json", "text")
        true_effect = np.nan
        if "true_effect" in group.attrs:  # few files have it
            true_effect = float(attribute(group, "true_effect", "a number"))
        truth = Truth(
            **datasets,
            noise_m=noise_m,
            parameters_json=parameters_json,
            true_effect=true_effect,
        )
        check_sizes(truth)
        return truth


def is_truth_of(
    roles: Mapping[str, str], *, body: Iterable[str], feet: Iterable[str]
) -> bool:
    """Tell whether a truth applies to a choice of markers.

    Parameters
    ----------
    roles : mapping
        Role of each marker in the file.
    body, feet : iterable of str
        The markers that a study takes for body and feet. The truth (contacts, body
        heights) is that of the file's own body and feet, so they must be the same ones.
    """
    body_of_file = {marker for marker, role in roles.items() if role == "body"}
    feet_of_file = {marker for marker, role in roles.items() if role == "foot"}
    return body_of_file == set(body) and feet_of_file == set(feet)


def holds_truth(path: str | Path, *, body: Iterable[str], feet: Iterable[str]) -> bool:
    """Tell whether a file holds a truth for these markers, without reading its data.

    A file that is missing or damaged holds none. Importing it says what is wrong with
    it.
    """
    try:
        try:
            roles = roles_of_truth(path)
        except UnsealedError:
            roles = _through_door("roles_of_truth", path)
    except RecordingError:
        return False
    if roles is None:
        return False
    return is_truth_of(roles, body=body, feet=feet)


def roles_of_truth(path: str | Path) -> dict[str, str] | None:
    """Return the role of each marker of a file with a truth; None if it has none.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    """
    with opened(path, "truth is not whole") as file:
        if "truth" not in file:
            return None
        names = attribute(file, "markers", "a list of texts")
        roles = attribute(file, "roles", "a list of texts")
    return dict(zip(names, roles, strict=False))


class UnsealedError(Exception):
    """Raised instead of opening a file that hopdata did not seal in this process."""


@contextmanager
def opened(
    path: str | Path, fault: str, most_unpacked_mb: float = np.inf
) -> Iterator[h5py.File]:
    """Open a file; turn any error in or with it to a RecordingError that names it.

    Raises
    ------
    UnsealedError
        If the file has no seal, and this is not the process to read it in.
    """
    if not Path(path).is_file():
        raise RecordingError.at(f"{path}: no such file", "a recording", "none")
    if require_intact(path) is Seal.NONE and not door.is_inside():
        raise UnsealedError
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        with open(path, "rb") as begin:
            is_ours = begin.read(len(SIGNATURE)) == SIGNATURE
        what = "cut short or damaged, copy it anew" if is_ours else "not an HDF5 file"
        found = f"expected one that can be opened, found: {error}"
        raise RecordingError(f"{path}: {what}: {found}") from error
    try:
        with file:
            require_sound(file, most_unpacked_mb)
            yield file
    except Exception as error:  # a damaged file makes h5py raise almost anything
        words = str(error)
        if isinstance(error, KeyError) and error.args:
            words = str(error.args[0])  # without the quotes of a missing key
        if "expected" not in words:
            words = f"expected it to be readable, found: {words}"
        raise RecordingError(f"{path}: {fault}: {words}") from error


def require_intact(path: str | Path) -> Seal:
    """Require that a file which hopdata sealed has the bytes that hopdata wrote.

    Returns
    -------
    Seal
        Whether it is whole, or there is none.

    Raises
    ------
    RecordingError
        If bytes have changed since they were written.
    """
    seal = seal_of(path)
    if seal is Seal.BROKEN:
        where = "their checksum stands at the end of the file"
        wanted = f"the bytes that hopdata wrote ({where})"
        raise RecordingError.at(path, wanted, "others; it is damaged, copy it anew")
    return seal


def _texts(group: h5py.Group, name: str, entries: Sequence[str]) -> None:
    group.create_dataset(
        name, data=list(entries), dtype=h5py.string_dtype(), track_times=False
    )


def _read_events(file: h5py.File) -> tuple[Event, ...]:
    if "events" not in file:
        return ()
    times = numbers(file, "events/time")
    labels = stored_texts(file, "events/label")
    if times.shape != (len(labels),) or not np.isfinite(times).all():
        wanted = f"expected {len(labels)} finite times"
        raise ValueError(f"events: {wanted}, found {times.shape}")
    return tuple(
        Event(label, float(time_s)) for label, time_s in zip(labels, times, strict=True)
    )


def _dataset(group: h5py.Group, name: str, array: NDArray[Any]) -> None:
    """Store an array in chunks along its first axis, which compresses best."""
    if array.size == 0:
        group.create_dataset(name, data=array, track_times=False)
        return
    n_frames = min(CHUNK_FRAMES, len(array))
    stored = group.create_dataset(
        name,
        shape=array.shape,
        dtype=array.dtype,
        chunks=(n_frames, *(1 for _ in array.shape[1:])),
        track_times=False,
        shuffle=True,
        compression="gzip",
        compression_opts=COMPRESSION,
    )
    # In parts, without a temporary array of full size.
    for first in range(0, len(array), CHUNK_FRAMES):
        part = slice(first, first + CHUNK_FRAMES)
        stored[part] = array[part]
