"""From a file and the configuration to the canonical `Recording`: metres, z up, roles in order."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.plausibility import (
    FILE_AXES,
    PLAUSIBLE_EXTENT_M,
    extent,
)
from hopdata.recordings.raw import METRES_PER_UNIT, FloatArray, RawRecording, resolve_rate
from hopdata.recordings.recording import Recording
from hopdata.recordings.truth import Truth

ROLE_OF_KEY = {"body": "body", "feet": "foot", "boom": "boom"}

PER_FOOT = ("contact_times", "foot_down", "contact_points", "floor_at_contacts", "preloads_n")

Reader = Callable[..., RawRecording]


def import_recording(
    path: str | Path,
    *,
    name: str,
    markers: Mapping[str, Sequence[str]],
    unit: str = "auto",
    vertical_axis: str = "z",
    rate_hz: float | None = None,
) -> tuple[Recording, Truth | None]:
    """Read a file of any known format into the canonical recording.

    Whether the result makes sense is for `plausibility.check_plausible` to say.

    Parameters
    ----------
    path : path
        A file whose suffix is one of `suffixes`.
    name : str
        Name of the recording in the study.
    markers : mapping
        Marker names for each of ``"body"``, ``"feet"``, ``"boom"``; the result keeps this order.
    unit : {"auto", "m", "mm"}
        Unit of the file's positions; ``"auto"`` takes the format's own unit, or the other one if
        only that gives a plausible size.
    vertical_axis : {"x", "y", "z"}
        Axis of the file that points up.
    rate_hz : float, optional
        Frame rate, for files that do not state it.

    Returns
    -------
    recording : Recording
        Positions in m, z up, with the file's sha256.
    truth : Truth or None
        That of a synthetic recording, as long as body, feet and axes are those it was made for.

    Raises
    ------
    RecordingError
        If the file cannot be read or lacks a marker.
    """
    path = Path(path)
    raw = read_raw(path, rate_hz=rate_hz)
    chosen, roles = _select(path, raw.markers, markers)
    positions = raw.positions[:, [raw.markers.index(m) for m in chosen]]
    positions *= METRES_PER_UNIT[choose_unit(positions, unit=unit, nominal=raw.unit)]
    recording = Recording(
        name=name,
        time=raw.time,
        positions=rotate_up(positions, vertical_axis),
        markers=chosen,
        roles=roles,
        rate_hz=raw.rate_hz,
        source=os.fsencode(path.as_posix()).decode(errors="replace"),  # a name need not be UTF-8
        source_sha256=sha256(path),
        vertical_axis=vertical_axis if vertical_axis != "z" else raw.vertical_axis,
    )
    turned = vertical_axis != "z"
    return recording, None if turned else _truth(path, raw, recording)


def suffixes() -> tuple[str, ...]:
    """File suffixes that can be read."""
    return tuple(_READERS)


def read_raw(path: str | Path, *, rate_hz: float | None = None) -> RawRecording:
    """Read all markers of a file, by the reader that its suffix calls for.

    Raises
    ------
    RecordingError
        If there is no such file or no reader for it, or if the reader finds a fault.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(
            f"{path}: format: expected a file ending in {', '.join(_READERS)}, "
            f"found '{path.suffix}'"
        )
    if not path.is_file():
        raise RecordingError(f"{path}: expected a file, found none{_near_files(path)}")
    return reader(path, rate_hz=rate_hz)


def choose_unit(positions: FloatArray, *, unit: str, nominal: str) -> str:
    """Choose the unit: as given, or for ``"auto"`` the format's unless only another fits.

    Parameters
    ----------
    positions : (N, M, 3) array
        In the unknown unit.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.
    nominal : {"m", "mm"}
        The format's own unit.
    """
    if unit != "auto":
        return unit
    low, high = PLAUSIBLE_EXTENT_M
    size = extent(positions)
    fitting = [u for u, metres in METRES_PER_UNIT.items() if low <= size * metres <= high]
    return fitting[0] if fitting else nominal


def rotate_up(positions: FloatArray, vertical_axis: str) -> FloatArray:
    """Turn (..., 3) positions so that the axis that pointed up becomes z.

    The axes are exchanged in a circle, which is a proper rotation: handedness is kept, and no
    number changes.
    """
    order = ["xyz".index(axis) for axis in FILE_AXES[vertical_axis]]
    return positions if order == [0, 1, 2] else np.ascontiguousarray(positions[..., order])


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _select(
    path: Path, present: tuple[str, ...], wanted: Mapping[str, Sequence[str]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and roles of the configured markers, body first, then feet, then boom."""
    chosen: list[str] = []
    roles: list[str] = []
    for key, role in ROLE_OF_KEY.items():
        for marker in wanted.get(key) or ():
            if marker not in present:
                raise RecordingError(
                    f"{path}: markers.{key}: expected a marker of the file "
                    f"({_listed(present)}), found '{marker}'{did_you_mean(marker, present)}"
                )
            if marker in chosen:
                raise RecordingError(
                    f"markers.{key}: expected each marker once, found '{marker}' twice"
                )
            chosen.append(marker)
            roles.append(role)
    return tuple(chosen), tuple(roles)


def _truth(path: Path, raw: RawRecording, recording: Recording) -> Truth | None:
    """Truth in the file, its feet in the recording's order; None where it does not apply."""
    if not raw.roles:
        return None
    stated = {
        role: [m for m, r in zip(raw.markers, raw.roles, strict=True) if r == role]
        for role in ("body", "foot")
    }
    if any(set(names) != set(recording.names(role)) for role, names in stated.items()):
        return None
    from hopdata.recordings.hdf5 import read_truth

    truth = read_truth(path)
    if truth is None:
        return None
    expected = (len(raw.time), len(stated["foot"]))
    if truth.foot_down.shape != expected:
        raise RecordingError(
            f"{path}: truth: expected {expected[0]} frames and {expected[1]} feet as in the "
            f"recording, found {truth.foot_down.shape[0]} and {truth.foot_down.shape[1]}"
        )
    order = [stated["foot"].index(name) for name in recording.names("foot")]
    return replace(truth, **{key: getattr(truth, key)[:, order] for key in PER_FOOT})


def _listed(names: Sequence[str], *, most: int = 12) -> str:
    more = f", ... {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _near_files(path: Path) -> str:
    """Hint at a file of a similar name in the same folder."""
    if not path.parent.is_dir():
        return f"; there is no folder {path.parent}"
    return did_you_mean(path.name, [p.name for p in path.parent.iterdir()])


def _read_tsv(path: Path, *, rate_hz: float | None) -> RawRecording:
    from hopdata.recordings.qtm_tsv import read_qtm_tsv

    return read_qtm_tsv(path, rate_hz=rate_hz)


def _read_hdf5(path: Path, *, rate_hz: float | None) -> RawRecording:
    from hopdata.recordings.hdf5 import read_recording

    own = read_recording(path)
    rate = resolve_rate(str(path), stated=own.rate_hz, given=rate_hz)
    if own.filled is not None:  # what was filled in was not seen
        own.positions[own.filled] = np.nan
    return RawRecording(
        own.markers,
        own.time,
        own.positions,
        rate,
        unit="m",
        vertical_axis=own.vertical_axis,
        roles=own.roles,
    )


_READERS: dict[str, Reader] = {".tsv": _read_tsv, ".h5": _read_hdf5, ".hdf5": _read_hdf5}
