"""Choice of the reader by file suffix; readers are imported only when needed.

Whatever the format, a file is read in a process of its own (`hopdata.foreign.door`), of
which plain arrays come back.
"""

from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from hopdata.errors import HopdataError, RecordingError
from hopdata.foreign import door
from hopdata.foreign.plugins import plugins
from hopdata.messages import Message
from hopdata.recording import Event
from hopdata.recordings import raw as reading
from hopdata.recordings.budget import unpacked_mb
from hopdata.recordings.readers.text import one_line, require_file
from hopdata.time_stamps import SLOWEST_S

#: Coordinate beyond which a file is refused.
#: Unit: that of the file, mm or m. Origin: chosen. Beyond the range of any camera.
LARGEST = 1e9

#: Score below which a keypoint of a video counts as unseen.
#: Unit: 1. Origin: convention. The default of `input.least_score` in the schema.
LEAST_SCORE = 0.6

# Reader for each suffix, and the limits passed to it.
_TEXT = ("hopdata.recordings.readers.csv_exports:read_export", ("least_score",))
_HDF5 = (
    "hopdata.recordings.readers.keypoints:read_hdf5",
    ("most_unpacked_mb", "least_score"),
)
READERS: dict[str, tuple[str, tuple[str, ...]]] = {
    ".tsv": _TEXT,
    ".txt": _TEXT,
    ".csv": _TEXT,
    ".mat": ("hopdata.recordings.readers.mat:read_qtm_mat", ("most_unpacked_mb",)),
    ".c3d": ("hopdata.recordings.readers.c3d:read_c3d", ()),
    ".trc": ("hopdata.recordings.readers.trc:read_trc", ()),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".bvh": ("hopdata.recordings.readers.bvh:read_bvh", ()),
    ".trb": ("hopdata.recordings.readers.trb:read_trb", ()),
    ".mvnx": ("hopdata.recordings.readers.mvnx:read_mvnx", ()),
    ".xlsx": (
        "hopdata.recordings.readers.xlsx:read_xlsx",
        ("most_unpacked_mb", "least_score"),
    ),
    ".ktk.zip": (
        "hopdata.recordings.readers.kinetics_toolkit:read_ktk",
        ("most_unpacked_mb",),
    ),
}

# Suffixes of plain arrays, which do not say what their columns are.
OF_ARRAYS = (".npz", ".npy", ".pkl", ".pickle")

# Libraries that these import once they read.
_LIBRARIES: dict[str, tuple[str, ...]] = {
    ".tsv": ("pandas",),
    ".txt": ("pandas",),
    ".csv": ("pandas",),
    ".trc": ("pandas",),
    ".mat": ("scipy.io", "h5py"),
    ".h5": ("h5py",),
    ".hdf5": ("h5py",),
    ".bvh": ("pandas",),
    ".xlsx": ("pandas", "openpyxl"),
}


@cache
def _others() -> dict[str, EntryPoint]:
    """Return the readers of installed packages (``hopdata.readers``) by suffix."""
    return plugins("hopdata.readers", "reader", READERS)


def suffixes() -> tuple[str, ...]:
    """Return the file suffixes that can be read."""
    return (*READERS, *_others())


def suffix_of(path: Path) -> str:
    """Return the suffix by which a reader is chosen, which may have two parts."""
    name = path.name.lower()
    double = "".join(Path(name).suffixes[-2:])
    return double if double in suffixes() else Path(name).suffix


def read_raw(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    least_score: float = LEAST_SCORE,
) -> reading.RawRecording:
    """Read all markers of a file with the reader for its suffix.

    Parameters
    ----------
    path : path
        A file whose suffix is one of `suffixes`.
    rate_hz : float, optional
        Frame rate, for files that state none or a wrong one.
    least_score : float
        Keypoints from video with a lower score count as unseen.

    Raises
    ------
    RecordingError
        If the file or a reader for it does not exist, if the reader finds a fault, or
        if it fails in any other way (`hopdata.foreign.door`).
    """
    path = Path(path)
    suffix = suffix_of(path)
    if suffix not in suffixes():
        found = f"'{path.suffix}'"
        if path.is_dir():
            found = "a folder: name its files one by one"
        elif suffix in OF_ARRAYS:
            way_in = Message("recordings.arrays")
            found += f" ({way_in})"
        wanted = f"a file ending in {', '.join(suffixes())}"
        raise RecordingError.at(f"{path}: format", wanted, found)
    require_file(path)
    reader = f"the reader of {suffix} files"
    if suffix in _others():
        reader = _name_of(_others()[suffix])
    libraries = _LIBRARIES.get(suffix, ())
    if suffix in READERS:
        function, _ = READERS[suffix]
        libraries = (function.partition(":")[0], *libraries)
    raw: reading.RawRecording = door.read(
        f"{__name__}:read_here",
        str(path),
        rate_hz,
        least_score,
        place=path,
        n_bytes=door.size_of(path),
        reader=reader,
        kinds=(reading.RawRecording, Event),
        libraries=libraries,
    )
    _check_parts(f"{path}: {reader}", raw)
    return raw


def read_here(
    place: str, rate_hz: float | None, least_score: float
) -> reading.RawRecording:
    """Read all markers of a file in this process; `read_raw` has another do so.

    Parameters
    ----------
    place : str
        A file with a known suffix.
    rate_hz, least_score
        As in `read_raw`.

    Raises
    ------
    RecordingError
        If the reader finds a fault.
    """
    path = Path(place)
    suffix = suffix_of(path)
    if suffix in READERS:
        function, taken = READERS[suffix]
        limits = {"most_unpacked_mb": unpacked_mb(path), "least_score": least_score}
        given = {limit: limits[limit] for limit in taken}
        raw: reading.RawRecording = resolve_name(function)(
            path, rate_hz=rate_hz, **given
        )
    else:
        raw = _read_with_plugin(_others()[suffix], path, rate_hz)
    raw = reading.overrule_rate(str(path), raw, rate_hz)
    _check_numbers(path, raw)
    remarks = raw.remarks + reading.events_outside(str(path), raw)
    return replace(raw, remarks=remarks, suffix=suffix)


def _name_of(plugin: EntryPoint) -> str:
    """Return how a message names the reader of another package."""
    package = f"{plugin.dist.name} " if plugin.dist is not None else ""
    return f"the reader {package}({plugin.value})"


def _read_with_plugin(
    plugin: EntryPoint, path: Path, rate_hz: float | None
) -> reading.RawRecording:
    """Read a file with the reader of another package; its errors may be of any kind."""
    reader = _name_of(plugin)
    try:
        found = plugin.load()(path, rate_hz)
    except HopdataError:
        raise
    except MemoryError:
        raise
    except Exception as error:
        found = f"{type(error).__name__}: {one_line(str(error))}"
        raise RecordingError.at(path, f"{reader} to read it", found) from error
    _check_parts(f"{path}: {reader}", found)
    return found


def _check_parts(place: str, found: Any) -> None:
    """Require what was read to be a recording whose parts fit one another."""
    if not isinstance(found, reading.RawRecording):
        raise RecordingError.at(place, "a RawRecording", type(found).__name__)
    n_frames = len(found.time)
    _require_floats(f"{place}: time", found.time, (n_frames,))
    shape = (n_frames, len(found.markers), 3)
    _require_floats(f"{place}: positions", found.positions, shape)
    if found.unit not in reading.METRES_PER_UNIT:
        units = " or ".join(reading.METRES_PER_UNIT)
        raise RecordingError.at(f"{place}: unit", units, f"{found.unit!r}")


def _require_floats(place: str, array: Any, shape: tuple[int, ...]) -> None:
    is_array = isinstance(array, np.ndarray) and array.dtype == np.float64
    if not is_array or array.shape != shape:
        kind = getattr(array, "dtype", type(array).__name__)
        found = f"{kind} of {np.shape(array)}"
        raise RecordingError.at(place, f"float64 of {shape}", found)


def _check_numbers(path: Path, raw: reading.RawRecording) -> None:
    """Require finite times, s, and positions that are NaN or possible."""
    if not np.isfinite(raw.time).all():
        frame = int(np.argmin(np.isfinite(raw.time)))
        place = f"{path}: frame {frame + 1}"
        raise RecordingError.at(place, "a finite time", raw.time[frame])
    if raw.has_stamps and len(raw.time) > 1:
        step_s = float(np.median(np.diff(raw.time)))
        if step_s > SLOWEST_S:
            wanted = f"s, at most {SLOWEST_S} from frame to frame"
            divide = "if these are ms or µs divide them"
            how = f"{divide}, or leave the time out and set input.rate_hz"
            raise RecordingError.at(f"{path}: time", wanted, f"{step_s:g}; {how}")
    if reading.largest(raw.positions) > LARGEST:
        frame, marker, axis = np.argwhere(np.abs(raw.positions) > LARGEST)[0]
        name = raw.markers[marker]
        place = f"{path}: frame {frame + 1}, marker {name}, {'xyz'[axis]}"
        wanted = f"a coordinate below {LARGEST:g} {raw.unit}"
        found = f"{raw.positions[frame, marker, axis]:g}"
        raise RecordingError.at(place, wanted, found)
