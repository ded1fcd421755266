"""MAT files, read by SciPy or, from version 7.3 on, h5py; and QTM's exports in them.

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
from hopdata.recordings.budget import (
    DEFLATE_MOST,
    MOST_LINKS,
    MOST_MATRICES,
    require_unpacked,
)
from hopdata.recordings.readers.hdf5 import SIGNATURE, require_intact
from hopdata.recordings.readers.hdf5_checks import (
    checked_attribute,
    require_sound,
    whole_array,
)
from hopdata.recordings.readers.qtm import moment
from hopdata.recordings.readers.text import one_line

Element = tuple[int, int, int]  # type, start and end of content

_HEADER_BYTES = 128

# Types of elements.
_INT8 = 1
_INT32 = 5
_UINT32 = 6
_MATRIX = 14
_COMPRESSED = 15
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_TEXTS = frozenset({1, 2, 4, 16, 17, 18})

# Types that may stand in each class of matrix: cells, structs, text and numbers.
_HOLDS = {1: frozenset({_MATRIX}), 2: frozenset({_INT8, _INT32, _MATRIX}), 4: _TEXTS}
_HOLDS |= dict.fromkeys(range(6, 16), _NUMBERS)

# Flag of a matrix with a second part.
_IS_COMPLEX = 0x800

#: Levels of nested structs and cells beyond which a file is refused.
#: Unit: 1. Origin: chosen.
_DEEPEST = 12

# Compressed bytes that are unpacked at a time: to at most 17 MB.
_PIECE = 1 << 14


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
            # In version 7.3 a block for the user may precede the HDF5 file.
            is_hdf5 = SIGNATURE in (lead[: len(SIGNATURE)], lead[512:])
            if not is_hdf5:
                return _version_5(file, most_unpacked_mb)
        return _version_73(path, most_unpacked_mb)
    except RecordingError:
        raise
    except OSError as error:
        found = one_line(error.strerror or str(error))
        raise RecordingError(f"{path}: expected a MAT file, found: {found}") from None
    except Exception as error:
        # A damaged file makes both libraries raise almost anything.
        why = one_line(str(error)) or type(error).__name__
        is_told = "expected" in why and "found" in why
        message = f"{path}: expected a MAT file of QTM"
        message += f"; {why}" if is_told else f", found: {why}"
        raise RecordingError(message) from None


# Version 5.


def _version_5(file: BinaryIO, most_mb: float) -> dict[str, Any]:
    """Decode a version 5 file: check each variable, then have SciPy read them.

    Only one variable at a time is unpacked for the check, and SciPy unpacks from the
    file. So the memory is that of the result, not several times as much.
    """
    import scipy.io

    file.seek(0)
    lead = file.read(_HEADER_BYTES)
    if len(lead) < _HEADER_BYTES:
        wanted = f"expected a header of {_HEADER_BYTES} bytes"
        raise ValueError(f"{wanted}, found {len(lead)}")
    mark = lead[126:128]
    if mark == b"IM":
        order = "<"
        codec = "utf-16-le"
    elif mark == b"MI":
        order = ">"
        codec = "utf-16-be"
    else:
        raise ValueError(f"byte 126: expected 'IM' or 'MI', found {mark!r}")
    _check_variables(file, order, most_mb)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + np.array(0x100, f"{order}u2").tobytes()
    sound = _WithHeader(file, header + mark)
    with warnings.catch_warnings():
        # About unreadable variables, which may not be needed.
        warnings.simplefilter("ignore")
        variables = scipy.io.loadmat(sound, uint16_codec=codec)
    return {
        name: _plain(value)
        for name, value in variables.items()
        if not name.startswith("__")
    }


class _WithHeader:
    """A file to read, whose first bytes are replaced by a header known to be sound."""

    def __init__(self, file: BinaryIO, header: bytes) -> None:
        self._file = file
        self._header = header
        self.seek = file.seek
        self.tell = file.tell
        self.seek(0)

    def read(self, n_bytes: int = -1) -> bytes:
        """Read bytes as a file does."""
        start = self._file.tell()
        data = self._file.read(n_bytes)
        lead = self._header[start : start + len(data)]
        return lead + data[len(lead) :] if lead else data


def _plain(value: Any) -> Any:
    """Convert SciPy's form of a variable to a dict, a list, text or numbers."""
    if not isinstance(value, np.ndarray):
        return None
    names = value.dtype.names
    if names:
        structs = [
            {name: _plain(one[name]) for name in names}
            for one in value.ravel(order="F")
        ]
        return structs[0] if len(structs) == 1 else structs
    if value.dtype == object:
        return [_plain(one) for one in value.ravel(order="F")]
    if value.dtype.kind == "U":
        return "".join(value.ravel())
    return value


# The check of a version 5 file: SciPy trusts types and sizes, and crashes if they are
# wrong.


def _check_variables(file: BinaryIO, order: str, most_mb: float) -> None:
    """Refuse impossible claims, and more numbers than memory may hold."""
    n_numbers = 0
    n_bytes = 0
    room = iter(range(MOST_MATRICES))
    for data in _variables(file, order, most_mb):
        n_bytes += len(data)
        require_unpacked(n_bytes, most_mb)
        for element in _elements(data, 0, len(data), order):
            n_numbers += _count(data, element, order, room)
        require_unpacked(8 * n_numbers, most_mb)  # each number ends up as a float
        del data  # before the next is unpacked


def _variables(file: BinaryIO, order: str, most_mb: float) -> Iterator[bytearray]:
    """Yield the elements of a file, decompressed, with their first eight bytes."""
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
    """Decompress the element where a file stands, to the size that it states itself."""
    start = file.tell()
    lengths = [_PIECE] * (n_packed // _PIECE) + [n_packed % _PIECE]
    pieces = map(file.read, lengths)
    stream = zlib.decompressobj()
    lead = stream.decompress(next(pieces), 8)
    size = int(np.frombuffer(lead.ljust(8, b"\0"), f"{order}u4")[1])
    require_unpacked(size, most_mb)
    if size > DEFLATE_MOST * n_packed:  # before memory is asked for
        wanted = f"at most {DEFLATE_MOST * n_packed} bytes from {n_packed} packed ones"
        raise ValueError(f"byte {start}: expected {wanted}, found a claim of {size}")
    data = bytearray(8 + size)
    data[: len(lead)] = lead
    n_filled = len(lead)
    is_too_long = False
    for piece in chain([stream.unconsumed_tail], pieces):
        room = len(data) - n_filled
        # One more, to notice what is too long.
        unpacked = stream.decompress(piece, room + 1)
        if len(unpacked) > room:
            is_too_long = True
            break
        data[n_filled : n_filled + len(unpacked)] = unpacked
        n_filled += len(unpacked)
    if is_too_long or not stream.eof or n_filled != len(data):
        wanted = f"expected {len(data)} bytes compressed"
        raise ValueError(f"byte {start}: {wanted}, found more or less")
    return data


def _count(
    data: bytearray, element: Element, order: str, room: Iterator[int], depth: int = 0
) -> int:
    """Count the numbers that a matrix and those inside it claim to hold.

    Impossible claims are refused. `room` yields a number for each matrix that a file
    may have.
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
    parts = _parts(data, start, stop, order)
    _, shape_start, shape_stop = parts[0]
    shape = np.frombuffer(data[shape_start:shape_stop], f"{order}i4").tolist()
    if min(shape, default=-1) < 0 or prod(shape) > stop - start:
        wanted = f"expected a size for {stop - start} bytes"
        raise ValueError(f"byte {start} unpacked: {wanted}, found {shape}")
    n_numbers = prod(shape)
    for part in parts:
        if part[0] == _MATRIX:
            n_numbers += _count(data, part, order, room, depth + 1)
    return n_numbers


def _parts(data: bytearray, start: int, stop: int, order: str) -> list[Element]:
    """Return shape, name and content of a matrix, which must be of known types."""
    flags, *parts = _elements(data, start, stop, order)
    bits = int(np.frombuffer(data, f"{order}u4", 1, start + 8)[0])
    holds = _HOLDS.get(bits & 0xFF, frozenset())
    kinds = [kind for kind, _, _ in parts]
    is_sound = (
        flags == (_UINT32, start + 8, start + 16)
        and kinds[:2] == [_INT32, _INT8]
        and holds.issuperset(kinds[2:])
    )
    if holds == _NUMBERS:
        n_contents = 2 if bits & _IS_COMPLEX else 1
        is_sound &= len(kinds) == 2 + n_contents
    elif holds == _TEXTS:
        is_sound &= len(kinds) == 3
    if not is_sound:
        wanted = "expected a matrix of numbers, text, cells or structs"
        found = f"found the class {bits & 0xFF} with elements of types {kinds}"
        raise ValueError(f"byte {start} unpacked: {wanted}, {found}")
    return parts


def _elements(data: bytearray, at: int, end: int, order: str) -> list[Element]:
    """List the elements between two byte positions."""
    found = []
    while at < end:
        tag = data[at : at + 8].ljust(8, b"\0")
        kind, size = np.frombuffer(tag, f"{order}u4").tolist()
        if kind >> 16:  # small element: the size precedes the type
            size = kind >> 16
            kind &= 0xFFFF
            start = at + 4
            room = 4
            after = at + 8
        else:
            start = at + 8
            room = end - start
            padding = 0 if kind == _COMPRESSED else -size % 8
            after = start + size + padding
        if size > room or at + 8 > end:
            wanted = f"expected an element of {size} bytes"
            raise ValueError(f"byte {at}: {wanted}, found {room}")
        found.append((kind, start, start + size))
        at = after
    return found


# Version 7.3, which is HDF5 with reversed axes.


def _version_73(path: Path, most_mb: float) -> dict[str, Any]:
    """Decode a version 7.3 file; restore the order of axes."""
    require_intact(path)
    with h5py.File(path, "r", locking=False) as file:
        require_sound(file, most_mb)
        decode = _Decoder(file)
        return {name: decode(file[name]) for name in file if not name.startswith("#")}


class _Decoder:
    """Decodes items of a file; a damaged one may refer to itself, so not for ever."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file
        self._room = iter(range(MOST_LINKS))

    def __call__(self, item: Any) -> Any:
        """Return a group as a dict, a dataset as text, numbers or a list."""
        if next(self._room, None) is None:
            raise ValueError(f"expected at most {MOST_LINKS} items, found more")
        if isinstance(item, h5py.Group):
            return {name: self(item[name]) for name in item}
        if not isinstance(item, h5py.Dataset):
            found = type(item).__name__
            raise ValueError(f"{item.name}: expected a group or dataset, found {found}")
        is_text = checked_attribute(item, "MATLAB_class") in (b"char", "char")
        if checked_attribute(item, "MATLAB_empty") is not None:
            return "" if is_text else np.empty((0, 0))
        array = whole_array(item).T
        if array.dtype == h5py.ref_dtype:
            # A cell array, or a field of an array of structs.
            references = array.ravel(order="F")
            return [self(self._file[reference]) for reference in references]
        if array.dtype.kind not in "biuf":
            found = f"found {array.dtype}"
            raise ValueError(f"dataset '{item.name}': expected numbers, {found}")
        if is_text:
            words = array.ravel(order="F").astype("<u2").tobytes()
            return words.decode("utf-16-le", errors="replace")
        return array


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
    trajectories = _field(export, "Trajectories", place)
    labelled = _field(trajectories, "Labeled", f"{place}.Trajectories")
    inner = f"{place}.Trajectories.Labeled"
    data = _positions(labelled, inner)
    labels = _labels(labelled, inner)
    if len(labels) != len(data):
        wanted = f"{len(data)} as in Data"
        raise RecordingError.at(f"{inner}.Labels", wanted, len(labels))
    frames_first = np.moveaxis(data[:, :3], 2, 0)
    positions: FloatArray = np.array(frames_first, np.float64, order="C")
    n_frames, n_markers = positions.shape[:2]
    _require_stated(export, "Frames", n_frames, place)
    _require_stated(labelled, "Count", n_markers, inner)
    start = _number(export, "StartFrame", place)
    first_frame = 1.0 if start is None else start
    return raw.assembled(
        f"{place}.FrameRate",
        raw.distinct_names(f"{inner}.Labels", labels),
        positions,
        number=np.arange(n_frames, dtype=float) + first_frame,
        unit=(place, "mm"),
        rates_hz=(_number(export, "FrameRate", place), rate_hz),
        events=_events(export, place),
        started=moment(export.get("Timestamp")),
    )


def _require_stated(struct: dict[str, Any], key: str, found: int, place: str) -> None:
    """Require as many frames or markers as the file states, if it does."""
    stated = _number(struct, key, place)
    if stated is None or stated == found:
        return
    cut = ""
    if key == "Frames" and stated > found:
        cut = "; was the file cut short?"
    raise RecordingError.at(f"{place}.{key}", f"{stated:g} as stated", f"{found}{cut}")


def _export(path: Path, variables: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return name and content of the one struct with trajectories."""
    for name, value in variables.items():
        if isinstance(value, dict) and "Trajectories" in value:
            return name, value
    names = ", ".join(variables) or "none"
    found = f"the variables {names}; Recording.from_arrays takes these"
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
        found = " x ".join(map(str, data.shape))
        raise RecordingError.at(f"{place}.Data", "markers x 4 x frames", found)
    return np.asarray(data)


def _labels(labelled: Any, place: str) -> list[str]:
    labels = _field(labelled, "Labels", place)
    if isinstance(labels, str):
        labels = [labels]
    if not isinstance(labels, list) or not all(isinstance(one, str) for one in labels):
        raise RecordingError.at(f"{place}.Labels", "a cell of texts", _kind(labels))
    return [label.strip(" \0") for label in labels]


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
    """Return the events, which stand in one or several structs."""
    place = f"{place}.Events"
    events = []
    for event in _structs(export.get("Events")):
        label = _field(event, "Label", place)
        time_s = _number(event, "Time", place)
        if not isinstance(label, str) or time_s is None:
            found = f"{_kind(label)} and {time_s}"
            raise RecordingError.at(place, "a Label and a Time each", found)
        events.append(Event(label.split("\0")[0].strip(), time_s))
    return tuple(events)


def _structs(found: Any) -> list[Any]:
    """Return the entries of an array of structs, which version 7.3 stores as lists."""
    if isinstance(found, list):
        return found
    if not isinstance(found, dict):
        return []
    if not any(isinstance(value, list) for value in found.values()):
        return [found]
    lists = [value if isinstance(value, list) else [value] for value in found.values()]
    structs = []
    for entries in zip(*lists, strict=False):
        structs.append(dict(zip(found, entries, strict=False)))
    return structs


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {' x '.join(map(str, value.shape))} {value.dtype}"
    names: dict[type, str] = {dict: "a struct", list: "a list", str: "text"}
    return names.get(type(value), "something else")
