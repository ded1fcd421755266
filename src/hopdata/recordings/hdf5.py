"""Recordings (and the truth of synthetic ones) as HDF5 files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata import __version__
from hopdata.errors import RecordingError
from hopdata.jobs import whole_file
from hopdata.recordings.axes import FILE_AXES
from hopdata.recordings.hdf5_content import number, numbers, stored_texts, text, texts
from hopdata.recordings.hdf5_limits import require_sound
from hopdata.recordings.raw import Event
from hopdata.recordings.recording import ROLES, Recording
from hopdata.recordings.truth import Truth, check_sizes

if TYPE_CHECKING:
    import h5py

CHUNK_FRAMES = 16384
COMPRESSION = 6  # of 9, which takes twice the time for 0.2 % of the bytes
SIGNATURE = b"\x89HDF\r\n\x1a\n"  # with which HDF5 files begin
_TRUTH_ATTRIBUTES = ("noise_m", "parameters_json")
_TRUTH_DATASETS = tuple(f.name for f in fields(Truth) if f.name not in _TRUTH_ATTRIBUTES)
_TEXT_ATTRIBUTES = ("name", "source", "source_sha256", "vertical_axis")


def write_recording(path: str | Path, recording: Recording, truth: Truth | None = None) -> None:
    """Write a recording, and its truth if there is one, to an HDF5 file.

    The file appears under its name only once it is whole. Positions are stored as float32 (their
    rounding, 0.06 um within 1 m of the origin, is far below any marker's noise), one coordinate
    of one marker after the other, shuffled and deflated. Equal content gives equal bytes.

    Parameters
    ----------
    path : path
        File to write; replaced if it exists.
    recording : Recording
    truth : Truth, optional
    """
    import h5py

    with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
        _write_content(file, recording)
        if truth is not None:
            _write_truth(file.create_group("truth"), truth)


def read_recording(path: str | Path, *, most_unpacked_mb: float = np.inf) -> Recording:
    """Read a recording from an HDF5 file.

    Parameters
    ----------
    path : path
    most_unpacked_mb : float
        Memory that the file may ask for, MB; without limit for files that hopdata has written.

    Raises
    ------
    RecordingError
        If the file cannot be read, or lacks a dataset or attribute, or their kinds or sizes are
        not those of a recording.
    """
    with _open(path, "not a recording", most_unpacked_mb) as file:
        recording = Recording(
            time=numbers(file, "time"),
            positions=numbers(file, "positions"),
            markers=texts(file, "markers"),
            roles=texts(file, "roles"),
            rate_hz=number(file, "rate_hz"),
            **{key: text(file, key) for key in _TEXT_ATTRIBUTES},
            events=_read_events(file),
            remarks=stored_texts(file, "remarks") if "remarks" in file else (),
            filled=numbers(file, "filled").astype(bool) if "filled" in file else None,
        )
        for key, values, choices in (
            ("roles", recording.roles, ROLES),
            ("vertical_axis", (recording.vertical_axis,), tuple(FILE_AXES)),
        ):
            for value in set(values) - set(choices):
                raise ValueError(f"{key}: expected any of {', '.join(choices)}, found '{value}'")
        return recording


def read_truth(path: str | Path) -> Truth | None:
    """Read the truth of a synthetic recording; None if the file holds none.

    Raises
    ------
    RecordingError
        If the file cannot be read or its truth is not whole.
    """
    with _open(path, "truth is not whole") as file:
        if "truth" not in file:
            return None
        group = file["truth"]
        truth = Truth(
            **{key: numbers(group, key) for key in _TRUTH_DATASETS},
            noise_m=number(group, "noise_m"),
            parameters_json=text(group, "parameters_json"),
        )
        check_sizes(truth)
        return truth


def _signed(path: str | Path) -> bool:
    """Tell whether a file begins as HDF5 files do."""
    with open(path, "rb") as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


@contextmanager
def _open(path: str | Path, fault: str, most_unpacked_mb: float = np.inf) -> Iterator[h5py.File]:
    """Open a file; what is wrong in it, or with it, becomes a RecordingError that names it."""
    import h5py

    if not Path(path).is_file():
        raise RecordingError(f"{path}: no such file: expected a recording, found none")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        what = "cut short or damaged" if _signed(path) else "not an HDF5 file"
        raise RecordingError(
            f"{path}: {what}: expected one that can be opened, found: {error}"
        ) from error
    try:
        with file:
            require_sound(file, most_unpacked_mb)
            yield file
    except Exception as error:  # a damaged file makes h5py raise almost anything
        words = _in_words(error)
        told = words if "expected" in words else f"expected it to be readable, found: {words}"
        raise RecordingError(f"{path}: {fault}: {told}") from error


def _in_words(error: Exception) -> str:
    return str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)


def _write_content(file: h5py.File, recording: Recording) -> None:
    _dataset(file, "time", recording.time)
    _dataset(file, "positions", recording.positions.astype(np.float32))
    if recording.filled is not None:
        _dataset(file, "filled", recording.filled)
    file.attrs["markers"] = list(recording.markers)
    file.attrs["roles"] = list(recording.roles)
    file.attrs["rate_hz"] = recording.rate_hz
    for key in _TEXT_ATTRIBUTES:
        file.attrs[key] = getattr(recording, key)
    file.attrs["hopdata_version"] = __version__
    if recording.events:
        _dataset(file, "events/time", np.asarray([event.time_s for event in recording.events]))
        _texts_dataset(file, "events/label", [event.label for event in recording.events])
    if recording.remarks:
        _texts_dataset(file, "remarks", recording.remarks)


def _texts_dataset(group: h5py.Group, name: str, entries: Sequence[str]) -> None:
    import h5py

    group.create_dataset(name, data=list(entries), dtype=h5py.string_dtype(), track_times=False)


def _read_events(file: h5py.File) -> tuple[Event, ...]:
    if "events" not in file:
        return ()
    times, labels = numbers(file, "events/time"), stored_texts(file, "events/label")
    if times.shape != (len(labels),) or not np.isfinite(times).all():
        raise ValueError(f"events: expected {len(labels)} finite times, found {times.shape}")
    return tuple(Event(label, float(t)) for label, t in zip(labels, times, strict=True))


def _write_truth(group: h5py.Group, truth: Truth) -> None:
    for key in _TRUTH_DATASETS:
        array = getattr(truth, key)
        _dataset(group, key, array.astype(np.float32) if key == "body_height" else array)
    for key in _TRUTH_ATTRIBUTES:
        group.attrs[key] = getattr(truth, key)


def _dataset(group: h5py.Group, name: str, array: NDArray[Any]) -> None:
    """Store an array in chunks that run along its first axis, which compresses best."""
    if array.size == 0:
        group.create_dataset(name, data=array, track_times=False)
        return
    chunks = (max(1, min(CHUNK_FRAMES, len(array))), *(1 for _ in array.shape[1:]))
    group.create_dataset(
        name,
        data=array,
        chunks=chunks,
        shuffle=True,
        compression="gzip",
        compression_opts=COMPRESSION,
        track_times=False,
    )
