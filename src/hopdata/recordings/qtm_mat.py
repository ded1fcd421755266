"""Reader of QTM's MAT exports: one struct, named after the file, in either kind of MAT file.

What is read: ``FrameRate``, ``Frames``, ``StartFrame``, ``Timestamp``, ``Events`` and
``Trajectories.Labeled`` with ``Labels``, ``Data`` (marker, x y z residual, frame), in mm, and
``TrajectoryTypes``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.mat5 import HEADER_BYTES, MatError, read_mat5
from hopdata.recordings.mat73 import read_mat73
from hopdata.recordings.qtm_dates import moment
from hopdata.recordings.raw import (
    MOST_UNPACKED_MB,
    Event,
    FloatArray,
    RawRecording,
    distinct_names,
    resolve_rate,
)

_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
TYPE_NAMES = {1: "Measured", 2: "Gap-filled", 3: "Virtual", 4: "Edited"}


def read_qtm_mat(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float = MOST_UNPACKED_MB,
) -> RawRecording:
    """Read the labelled trajectories of a MAT file that QTM exported.

    A marker counts as unseen where a coordinate is NaN, or where all three are 0.

    Parameters
    ----------
    path : path
        The ``.mat`` file, version 5 to 7.3.
    rate_hz : float, optional
        Frame rate; must be the file's.
    most_unpacked_mb : float
        Memory that the file may ask for, MB.

    Returns
    -------
    RawRecording
        Positions in mm along the file's axes.

    Raises
    ------
    RecordingError
        Naming the file, the field, what was expected and what was found.
    """
    path = Path(path)
    name, export = _export(path, _variables(path, most_unpacked_mb))
    place = f"{path}: {name}"
    labelled = _field(_field(export, "Trajectories", place), "Labeled", f"{place}.Trajectories")
    inner = f"{place}.Trajectories.Labeled"
    data = _positions(labelled, inner)
    labels = _labels(labelled, inner)
    if len(labels) != len(data):
        raise RecordingError(
            f"{inner}.Labels: expected {len(data)} as in Data, found {len(labels)}"
        )
    positions: FloatArray = np.array(np.moveaxis(data[:, :3], 2, 0), np.float64, order="C")
    _check_counts(export, labelled, positions, place)
    unseen = np.isnan(positions).any(axis=2) | ~np.any(positions, axis=2)
    positions[unseen] = np.nan
    rate = resolve_rate(
        f"{place}.FrameRate", stated=_number(export, "FrameRate", place), given=rate_hz
    )
    start = _number(export, "StartFrame", place)
    first = 1.0 if start is None else start
    markers, remarks = distinct_names(f"{inner}.Labels", labels)
    return RawRecording(
        markers,
        np.asarray((first - 1 + np.arange(len(positions))) / rate, dtype=np.float64),
        positions,
        rate,
        unit="mm",
        events=_events(export, place),
        trajectory_types=_types(labelled, len(labels)),
        started=moment(export.get("Timestamp")),
        remarks=remarks,
    )


def _variables(path: Path, most_mb: float) -> dict[str, Any]:
    """Variables of a MAT file of either kind; whatever is wrong in it becomes a RecordingError."""
    try:
        with path.open("rb") as file:
            lead = file.read(HEADER_BYTES)
            file.seek(512)
            if _HDF5_MAGIC not in (lead[:8], file.read(8)):
                file.seek(0)
                if len(lead) < HEADER_BYTES:
                    raise MatError(f"expected a header of {HEADER_BYTES} bytes, found {len(lead)}")
                return read_mat5(file.read(), most_mb)
        return read_mat73(path, most_mb)
    except OSError as error:
        raise RecordingError(
            f"{path}: expected a MAT file, found: {error.strerror or error}"
        ) from None
    except MatError as error:
        raise RecordingError(f"{path}: expected a MAT file of QTM; {error}") from None
    except Exception as error:  # a damaged file makes h5py raise almost anything
        raise RecordingError(f"{path}: expected a MAT file of QTM, found: {error}") from None


def _export(path: Path, variables: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Name and content of the one struct with trajectories."""
    for name, value in variables.items():
        if isinstance(value, dict) and "Trajectories" in value:
            return name, value
    found = ", ".join(variables) or "none"
    raise RecordingError(
        f"{path}: expected a struct with the field Trajectories, found the variables {found}"
    )


def _field(struct: Any, name: str, place: str) -> Any:
    if not isinstance(struct, dict):
        raise RecordingError(f"{place}: expected a struct, found {_kind(struct)}")
    if name not in struct:
        raise RecordingError(
            f"{place}: expected the field {name}, found {', '.join(struct) or 'none'}"
            f"{did_you_mean(name, struct)}"
        )
    return struct[name]


def _positions(labelled: Any, place: str) -> FloatArray:
    """Return ``Data`` as (M, 4, N); MATLAB drops a last axis of length 1."""
    data = _field(labelled, "Data", place)
    if not isinstance(data, np.ndarray) or data.dtype.kind not in "iuf":
        raise RecordingError(f"{place}.Data: expected numbers, found {_kind(data)}")
    if data.ndim == 2:
        data = data[:, :, None]
    if data.ndim != 3 or data.shape[1] not in (3, 4) or not data.size:
        raise RecordingError(
            f"{place}.Data: expected markers x 4 x frames, found {' x '.join(map(str, data.shape))}"
        )
    checked: FloatArray = data
    return checked


def _labels(labelled: Any, place: str) -> list[str]:
    labels = _field(labelled, "Labels", place)
    labels = [labels] if isinstance(labels, str) else labels
    if not isinstance(labels, list) or not all(isinstance(text, str) for text in labels):
        raise RecordingError(f"{place}.Labels: expected a cell of texts, found {_kind(labels)}")
    return [text.strip(" \0") for text in labels]


def _check_counts(export: Any, labelled: Any, positions: FloatArray, place: str) -> None:
    n_frames, n_markers = positions.shape[:2]
    for struct, key, found, where in (
        (export, "Frames", n_frames, place),
        (labelled, "Count", n_markers, f"{place}.Trajectories.Labeled"),
    ):
        stated = _number(struct, key, where)
        if stated is not None and stated != found:
            cut = "; was the file cut short?" if key == "Frames" and stated > found else ""
            raise RecordingError(
                f"{where}.{key}: expected {stated:g} as stated, found {found}{cut}"
            )


def _number(struct: dict[str, Any], name: str, place: str) -> float | None:
    """Return a finite number of a struct; None if it is absent or empty."""
    value = struct.get(name)
    if value is None or (isinstance(value, np.ndarray) and not value.size):
        return None
    if not isinstance(value, np.ndarray) or value.size != 1 or not np.isfinite(value).all():
        raise RecordingError(f"{place}.{name}: expected a number, found {_kind(value)}")
    return float(value.item())


def _events(export: dict[str, Any], place: str) -> tuple[Event, ...]:
    """Events: an array of structs, in version 7.3 a struct of lists."""
    found = export.get("Events")
    if isinstance(found, dict) and any(isinstance(value, list) for value in found.values()):
        lists = [value if isinstance(value, list) else [value] for value in found.values()]
        found = [dict(zip(found, entries, strict=False)) for entries in zip(*lists, strict=False)]
    events = []
    for event in [found] if isinstance(found, dict) else found if isinstance(found, list) else []:
        label, time = _field(event, "Label", f"{place}.Events"), None
        if event:
            time = _number(event, "Time", f"{place}.Events")
        if not isinstance(label, str) or time is None:
            raise RecordingError(
                f"{place}.Events: expected a Label and a Time each, found {_kind(label)} and {time}"
            )
        events.append(Event(label.split("\0")[0].strip(), time))
    return tuple(events)


def _types(labelled: dict[str, Any], n_markers: int) -> tuple[str, ...]:
    """How each marker came about: what most of its seen frames are; none if it is not said."""
    types = labelled.get("TrajectoryTypes", labelled.get("Type"))
    if isinstance(types, list) and len(types) == n_markers:
        return tuple(str(kind) for kind in types) if all(isinstance(t, str) for t in types) else ()
    if not isinstance(types, np.ndarray) or types.ndim != 2 or len(types) != n_markers:
        return ()
    counts = [[int(np.sum(row == code)) for code in TYPE_NAMES] for row in types]
    names = list(TYPE_NAMES.values())
    return tuple("Mixed" if sum(n > 0 for n in c) > 1 else names[int(np.argmax(c))] for c in counts)


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {' x '.join(map(str, value.shape))} {value.dtype}"
    names: dict[type, str] = {dict: "a struct", list: "a list", str: "text"}
    return names.get(type(value), "something else")
