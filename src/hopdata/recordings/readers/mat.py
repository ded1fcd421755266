"""MAT files, read by SciPy or, from version 7.3 on, h5py; and QTM's exports in that format.

Both libraries allocate whatever size a file claims. The claims are therefore checked
against the file's bytes and the memory limit before a library reads it.

A QTM export is one struct named after the file. Fields read are ``FrameRate``,
``Frames``, ``StartFrame``, ``Timestamp``, ``Events`` and ``Trajectories.Labeled`` with
``Labels`` and ``Data`` (marker, x y z residual, frame), in mm.
"""

import os
import warnings
import zlib
from collections.abc import Iterator
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hopdata.arrays import FloatArray, h5py
from hopdata.errors import RecordingError, did_you_mean
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.budget import MOST_LINKS, MOST_MATRICES, require_unpacked
from hopdata.recordings.readers.hdf5 import (
    SIGNATURE,
    checked_attribute,
    require_intact,
    require_sound,
    whole_array,
)
from hopdata.recordings.readers.qtm import moment
from hopdata.recordings.readers.text import one_line

Element = tuple[int, int, int]  # type, start and end of content

_HEADER_BYTES = 128
_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15  # types of elements
_NUMBERS, _TEXTS = (
    frozenset({*range(1, 8), 9, 12, 13}),
    frozenset({1, 2, 4, 16, 17, 18}),
)
# Allowed element types in each class of matrix: cells, structs, text and numbers.
_HOLDS = {1: frozenset({_MATRIX}), 2: frozenset({_INT8, _INT32, _MATRIX}), 4: _TEXTS}
_HOLDS |= dict.fromkeys(range(6, 16), _NUMBERS)
_IS_COMPLEX = 0x800
_DEEPEST = 12  # levels of nested structs
_PIECE = 1 << 14  # compressed bytes that are unpacked at a time: to at most 17 MB


def read_mat(path: Path, most_unpacked_mb: float) -> dict[str, Any]:
    """Decode all variables of a MAT file, version 5 to 7.3.

    Parameters
    ----------
    path : path
        The file.
    most_unpacked_mb : float
        Most memory that all numbers may use, MB.

    Returns
    -------
    dict
        Variables by name. A struct is a dict; an array of structs is a list of dicts,
        or in version 7.3 a dict of lists. A cell array is a list and text is str.
        Numbers are arrays with MATLAB's order of axes. Anything else is None.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, what was expected and found.
    """
    try:
        with path.open("rb") as file:
            lead = file.read(512 + len(SIGNATURE))
            if SIGNATURE not in (lead[: len(SIGNATURE)], lead[512:]):
                return _version_5(file, most_unpacked_mb)
        return _version_73(path, most_unpacked_mb)
    except RecordingError:
        raise
    except OSError as error:
        told = one_line(error.strerror or str(error))
        raise RecordingError(f"{path}: expected a MAT file, found: {told}") from None
    except (
        Exception
    ) as error:  # a damaged file makes both libraries raise almost anything
        told = one_line(str(error)) or type(error).__name__
        told = (
            f"; {told}"
            if "expected" in told and "found" in told
            else f", found: {told}"
        )
        raise RecordingError(f"{path}: expected a MAT file of QTM{told}") from None


def _version_5(file: BinaryIO, most_mb: float) -> dict[str, Any]:
    """Decode a version 5 file: check each variable by itself, then have SciPy read them.

    Only one variable at a time is unpacked for the check, and SciPy unpacks from the
    file. So the memory is that of the result, not several times as much.
    """
    import scipy.io

    file.seek(0)
    lead = file.read(_HEADER_BYTES)
    if len(lead) < _HEADER_BYTES:
        raise ValueError(
            f"expected a header of {_HEADER_BYTES} bytes, found {len(lead)}"
        )
    order = {b"IM": "<", b"MI": ">"}.get(lead[126:128])
    if order is None:
        raise ValueError(f"byte 126: expected 'IM' or 'MI', found {lead[126:128]!r}")
    count = n_bytes = 0
    room = iter(range(MOST_MATRICES))
    for data in _variables(file, order, most_mb):
        n_bytes += len(data)
        require_unpacked(n_bytes, most_mb)
        for element in _elements(data, 0, len(data), order):
            count += _count(data, element, order, room)
        require_unpacked(8 * count, most_mb)  # each number ends up as a float
        del data  # before the next is unpacked
    header = b"MATLAB 5.0 MAT-file".ljust(124) + np.array(0x100, f"{order}u2").tobytes()
    sound = _WithHeader(file, header + lead[126:128])
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # about unreadable variables, which may not be needed
        codec = "utf-16-le" if order == "<" else "utf-16-be"
        found = scipy.io.loadmat(sound, uint16_codec=codec)
    return {
        name: _plain(value)
        for name, value in found.items()
        if not name.startswith("__")
    }


class _WithHeader:
    """A file to read, whose first bytes are replaced by a header that is known to be sound."""

    def __init__(self, file: BinaryIO, header: bytes) -> None:
        self._file = file
        self._header = header
        self.seek = file.seek
        self.tell = file.tell
        self.seek(0)

    def read(self, n_bytes: int = -1) -> bytes:
        """Read bytes as a file does."""
        at = self._file.tell()
        data = self._file.read(n_bytes)
        lead = self._header[at : at + len(data)]
        return lead + data[len(lead) :] if lead else data


def _plain(value: Any) -> Any:
    """Convert SciPy's form of a variable to a dict, a list, text or numbers."""
    if not isinstance(value, np.ndarray):
        return None
    if names := value.dtype.names:
        structs = [
            {name: _plain(one[name]) for name in names}
            for one in value.ravel(order="F")
        ]
        return structs[0] if len(structs) == 1 else structs
    if value.dtype == object:
        return [_plain(one) for one in value.ravel(order="F")]
    return "".join(value.ravel()) if value.dtype.kind == "U" else value


def _variables(file: BinaryIO, order: str, most_mb: float) -> Iterator[bytearray]:
    """Yield the elements of a file one by one, decompressed, with their first eight bytes."""
    at = _HEADER_BYTES
    end = file.seek(0, os.SEEK_END)
    while at < end:
        file.seek(at)
        tag = file.read(8)
        kind, size = np.frombuffer(tag.ljust(8, b"\0"), f"{order}u4").tolist()
        start = at + 8
        if kind >> 16 or size > end - start:
            found = f"found type {kind} with {end - at} bytes left"
            raise ValueError(f"byte {at}: expected an element of {size} bytes, {found}")
        if kind == _COMPRESSED:
            at = start + size
            yield _inflated(file, size, order, most_mb)
            continue
        require_unpacked(size, most_mb)
        at = start + size + (-size % 8)
        data = bytearray(8 + size)
        data[:8] = tag
        file.readinto(memoryview(data)[8:])  # type: ignore[attr-defined]
        yield data


def _inflated(file: BinaryIO, n_packed: int, order: str, most_mb: float) -> bytearray:
    """Decompress the element that begins where a file stands to the size that it states itself."""
    start = file.tell()
    lengths = [_PIECE] * (n_packed // _PIECE) + [n_packed % _PIECE]
    pieces = map(file.read, lengths)
    stream = zlib.decompressobj()
    lead = stream.decompress(next(pieces), 8)
    size = int(np.frombuffer(lead.ljust(8, b"\0"), f"{order}u4")[1])
    require_unpacked(size, most_mb)
    data = bytearray(8 + size)
    data[: len(lead)] = lead
    n_filled = len(lead)
    for piece in chain([stream.unconsumed_tail], pieces):
        room = len(data) - n_filled
        found = stream.decompress(
            piece, room + 1
        )  # one more, to notice what is too long
        if len(found) > room:
            n_filled = -1
            break
        data[n_filled : n_filled + len(found)] = found
        n_filled += len(found)
    if not stream.eof or n_filled != len(data):
        told = (
            f"byte {start}: expected {len(data)} bytes compressed, found more or less"
        )
        raise ValueError(told)
    return data


def _count(
    data: bytearray, element: Element, order: str, room: Iterator[int], depth: int = 0
) -> int:
    """Count the numbers that a matrix and those inside it claim to hold; refuse impossible claims.

    SciPy trusts types and sizes, and crashes if they are wrong. `room` yields a number
    for each matrix that a file may have.
    """
    kind, start, stop = element
    if next(room, None) is None:
        raise ValueError(f"expected at most {MOST_MATRICES:,} matrices, found more")
    if kind != _MATRIX or depth > _DEEPEST:
        found = f"found type {kind} on level {depth}"
        wanted = f"expected a matrix on at most {_DEEPEST} levels"
        raise ValueError(f"byte {start} unpacked: {wanted}, {found}")
    if start == stop:
        return 0
    flags, *parts = _elements(data, start, stop, order)
    bits = int(np.frombuffer(data, f"{order}u4", 1, start + 8)[0])
    holds = _HOLDS.get(bits & 0xFF, frozenset())
    kinds = [part[0] for part in parts]
    sound = flags == (_UINT32, start + 8, start + 16) and kinds[:2] == [_INT32, _INT8]
    sound &= holds.issuperset(kinds[2:])
    if holds in (_NUMBERS, _TEXTS):
        sound &= len(kinds) == 3 + bool(holds is _NUMBERS and bits & _IS_COMPLEX)
    if not sound:
        wanted = "expected a matrix of numbers, text, cells or structs"
        found = f"found the class {bits & 0xFF} with elements of types {kinds}"
        raise ValueError(f"byte {start} unpacked: {wanted}, {found}")
    shape = np.frombuffer(data[parts[0][1] : parts[0][2]], f"{order}i4").tolist()
    if min(shape, default=-1) < 0 or prod(shape) > stop - start:
        wanted = f"expected a size for {stop - start} bytes"
        raise ValueError(f"byte {start} unpacked: {wanted}, found {shape}")
    inner = (part for part in parts if part[0] == _MATRIX)
    return prod(shape) + sum(
        _count(data, part, order, room, depth + 1) for part in inner
    )


def _elements(data: bytearray, at: int, end: int, order: str) -> list[Element]:
    """List the elements between two byte positions."""
    found = []
    while at < end:
        kind, size = np.frombuffer(
            data[at : at + 8].ljust(8, b"\0"), f"{order}u4"
        ).tolist()
        start, room = at + 8, end - at - 8
        after = start + size + (0 if kind == _COMPRESSED else -size % 8)
        if kind >> 16:  # small element: the size precedes the type
            kind, size, start, room, after = (
                kind & 0xFFFF,
                kind >> 16,
                at + 4,
                4,
                at + 8,
            )
        if size > room or at + 8 > end:
            raise ValueError(
                f"byte {at}: expected an element of {size} bytes, found {room}"
            )
        found.append((kind, start, start + size))
        at = after
    return found


def _version_73(path: Path, most_mb: float) -> dict[str, Any]:
    """Decode a version 7.3 file, which is HDF5 with reversed axes; restore their order."""
    room = iter(range(MOST_LINKS))  # a damaged file may refer to itself

    def decoded(item: Any) -> Any:
        if next(room, None) is None:
            raise ValueError(f"expected at most {MOST_LINKS} items, found more")
        if isinstance(item, h5py.Group):
            return {name: decoded(item[name]) for name in item}
        if not isinstance(item, h5py.Dataset):
            found = type(item).__name__
            raise ValueError(f"{item.name}: expected a group or dataset, found {found}")
        is_text = checked_attribute(item, "MATLAB_class") in (b"char", "char")
        if checked_attribute(item, "MATLAB_empty") is not None:
            return "" if is_text else np.empty((0, 0))
        array = whole_array(item).T
        if (
            array.dtype == h5py.ref_dtype
        ):  # a cell array, or a field of an array of structs
            return [decoded(file[reference]) for reference in array.ravel(order="F")]
        if array.dtype.kind not in "biuf":
            raise ValueError(
                f"dataset '{item.name}': expected numbers, found {array.dtype}"
            )
        if not is_text:
            return array
        return (
            array.ravel(order="F")
            .astype("<u2")
            .tobytes()
            .decode("utf-16-le", errors="replace")
        )

    require_intact(path, most_mb)
    with h5py.File(path, "r", locking=False) as file:
        require_sound(file, most_mb)
        return {name: decoded(file[name]) for name in file if not name.startswith("#")}


# QTM's exports: one struct, in either version of MAT file.


def read_qtm_mat(
    path: Path, *, rate_hz: float | None = None, most_unpacked_mb: float
) -> raw.RawRecording:
    """Read the labelled trajectories of a MAT file exported by QTM.

    Parameters
    ----------
    path : path
        The ``.mat`` file, version 5 to 7.3.
    rate_hz : float, optional
        Frame rate, for a file that states none.
    most_unpacked_mb : float
        Most memory that the file may use, MB.

    Returns
    -------
    RawRecording
        Positions in mm along the file's axes.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the field, what was expected and
        found.
    """
    name, export = _export(path, read_mat(path, most_unpacked_mb))
    place = f"{path}: {name}"
    labelled = _field(
        _field(export, "Trajectories", place), "Labeled", f"{place}.Trajectories"
    )
    inner = f"{place}.Trajectories.Labeled"
    data = _positions(labelled, inner)
    labels = _labels(labelled, inner)
    if len(labels) != len(data):
        raise RecordingError.at(
            f"{inner}.Labels", f"{len(data)} as in Data", len(labels)
        )
    positions: FloatArray = np.array(
        np.moveaxis(data[:, :3], 2, 0), np.float64, order="C"
    )
    n_frames, n_markers = positions.shape[:2]
    claims = (
        (export, "Frames", n_frames, place),
        (labelled, "Count", n_markers, inner),
    )
    for struct, key, found, where in claims:
        stated = _number(struct, key, where)
        if stated is not None and stated != found:
            cut = (
                "; was the file cut short?"
                if key == "Frames" and stated > found
                else ""
            )
            raise RecordingError.at(
                f"{where}.{key}", f"{stated:g} as stated", f"{found}{cut}"
            )
    start = _number(export, "StartFrame", place)
    return raw.assembled(
        f"{place}.FrameRate",
        raw.distinct_names(f"{inner}.Labels", labels),
        positions,
        number=np.arange(len(positions), dtype=float)
        + (1.0 if start is None else start),
        unit=(place, "mm"),
        rates_hz=(_number(export, "FrameRate", place), rate_hz),
        events=_events(export, place),
        started=moment(export.get("Timestamp")),
    )


def _export(path: Path, variables: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return name and content of the one struct with trajectories."""
    for name, value in variables.items():
        if isinstance(value, dict) and "Trajectories" in value:
            return name, value
    found = f"the variables {', '.join(variables) or 'none'}; Recording.from_arrays takes these"
    raise RecordingError.at(path, "a struct with the field Trajectories", found)


def _field(struct: Any, name: str, place: str) -> Any:
    if not isinstance(struct, dict):
        raise RecordingError.at(place, "a struct", _kind(struct))
    if name not in struct:
        found = f"{', '.join(struct) or 'none'}{did_you_mean(name, struct)}"
        raise RecordingError.at(place, f"the field {name}", found)
    return struct[name]


def _positions(labelled: Any, place: str) -> FloatArray:
    """Return ``Data`` as (M, 4, N); MATLAB drops a last axis of length 1."""
    data = _field(labelled, "Data", place)
    if not isinstance(data, np.ndarray) or data.dtype.kind not in "iuf":
        raise RecordingError.at(f"{place}.Data", "numbers", _kind(data))
    if data.ndim == 2:
        data = data[:, :, None]
    if data.ndim != 3 or data.shape[1] not in (3, 4) or not data.size:
        wanted = "markers x 4 x frames"
        raise RecordingError.at(
            f"{place}.Data", wanted, " x ".join(map(str, data.shape))
        )
    return np.asarray(data)


def _labels(labelled: Any, place: str) -> list[str]:
    labels = _field(labelled, "Labels", place)
    labels = [labels] if isinstance(labels, str) else labels
    if not isinstance(labels, list) or not all(
        isinstance(text, str) for text in labels
    ):
        raise RecordingError.at(f"{place}.Labels", "a cell of texts", _kind(labels))
    return [text.strip(" \0") for text in labels]


def _number(struct: dict[str, Any], name: str, place: str) -> float | None:
    """Return a finite number from a struct; None if it is absent or empty."""
    value = struct.get(name)
    if value is None or (isinstance(value, np.ndarray) and not value.size):
        return None
    is_number = isinstance(value, np.ndarray) and value.dtype.kind in "biuf"
    if not is_number or value.size != 1 or not np.isfinite(value).all():
        raise RecordingError.at(f"{place}.{name}", "a number", _kind(value))
    return float(value.item())


def _events(export: dict[str, Any], place: str) -> tuple[Event, ...]:
    """Return events, stored as an array of structs, or in version 7.3 as a struct of lists."""
    found = export.get("Events")
    if isinstance(found, dict) and any(
        isinstance(value, list) for value in found.values()
    ):
        lists = [
            value if isinstance(value, list) else [value] for value in found.values()
        ]
        found = [
            dict(zip(found, entries, strict=False))
            for entries in zip(*lists, strict=False)
        ]
    events, place = [], f"{place}.Events"
    for event in (
        [found] if isinstance(found, dict) else found if isinstance(found, list) else []
    ):
        label, time = _field(event, "Label", place), _number(event, "Time", place)
        if not isinstance(label, str) or time is None:
            raise RecordingError.at(
                place, "a Label and a Time each", f"{_kind(label)} and {time}"
            )
        events.append(Event(label.split("\0")[0].strip(), time))
    return tuple(events)


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {' x '.join(map(str, value.shape))} {value.dtype}"
    names: dict[type, str] = {dict: "a struct", list: "a list", str: "text"}
    return names.get(type(value), "something else")
