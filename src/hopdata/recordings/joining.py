"""Several files of one day as one recording: their frames one after the other, with a pause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError
from hopdata.recordings.raw import RATE_TOLERANCE, Event, FloatArray, RawRecording

PAUSE_S = 1.0  # between files that do not say when they began; longer than any landing


def is_pause(time: FloatArray, rate_hz: float) -> NDArray[np.bool_]:
    """Tell which steps of time stamps (N,), s, are pauses, (N - 1,): nothing was recorded then."""
    pause: NDArray[np.bool_] = np.diff(time) > PAUSE_S - 0.5 / rate_hz
    return pause


def join(paths: Sequence[Path], raws: Sequence[RawRecording]) -> RawRecording:
    """Join files in the order given, which must be that of time.

    Where each file says when its measurement began, that is its place in time. Otherwise a file
    whose time stamps follow those of the file before keeps them, and any other is moved to begin
    `PAUSE_S` after it, with a remark. No frame is made up for the time between.

    Parameters
    ----------
    paths, raws
        The files, and what was read from them, with the same markers in the same order.

    Raises
    ------
    RecordingError
        If the files differ in rate, unit, markers or stated vertical axis, or are out of order.
    """
    first = raws[0]
    for path, raw in zip(paths[1:], raws[1:], strict=True):
        _check_alike(paths[0], first, path, raw)
    starts, remarks = _starts(paths, raws)
    shifts = [start - raw.time[0] for start, raw in zip(starts, raws, strict=True)]
    return replace(
        first,
        time=np.concatenate([raw.time + s for raw, s in zip(raws, shifts, strict=True)]),
        positions=np.concatenate([raw.positions for raw in raws]),
        events=tuple(
            Event(event.label, event.time_s + s)
            for raw, s in zip(raws, shifts, strict=True)
            for event in raw.events
        ),
        trajectory_types=first.trajectory_types
        if all(raw.trajectory_types == first.trajectory_types for raw in raws)
        else (),
        unit_is_stated=all(raw.unit_is_stated for raw in raws),
        remarks=sum((raw.remarks for raw in raws), ()) + remarks,
    )


def _check_alike(first_path: Path, first: RawRecording, path: Path, raw: RawRecording) -> None:
    for what, wanted, found in (
        ("unit", first.unit, raw.unit),
        ("markers", first.markers, raw.markers),
        ("vertical axis", first.stated_up, raw.stated_up),
        ("frame rate (Hz)", first.rate_hz, raw.rate_hz),
    ):
        same = wanted == found
        if what.startswith("frame rate"):
            same = abs(raw.rate_hz - first.rate_hz) <= RATE_TOLERANCE * first.rate_hz
        if not same:
            raise RecordingError(
                f"{path}: {what}: expected {wanted} as in {first_path.name}, found {found}; "
                "files joined in one recording must agree"
            )


def _starts(
    paths: Sequence[Path], raws: Sequence[RawRecording]
) -> tuple[list[float], tuple[str, ...]]:
    """Time of each file's first frame on the clock of the first file, s."""
    by_clock = _starts_by_clock(paths, raws)
    if by_clock is not None:
        return by_clock, ()
    starts, end = [float(raws[0].time[0])], float(raws[0].time[-1])
    moved = []
    for path, raw in zip(paths[1:], raws[1:], strict=True):
        follows = raw.time[0] > end + 0.5 / raw.rate_hz
        starts.append(float(raw.time[0]) if follows else end + PAUSE_S)
        end = starts[-1] + float(raw.time[-1] - raw.time[0])
        if not follows:
            moved.append(path.name)
    if not moved:
        return starts, ()
    return starts, (
        f"{paths[0]}: joined with {len(paths) - 1} more; {len(moved)} of them "
        f"({', '.join(moved)}) do not say when they began and are put {PAUSE_S:g} s after the file "
        "before",
    )


def _starts_by_clock(paths: Sequence[Path], raws: Sequence[RawRecording]) -> list[float] | None:
    """Return times of the first frames where every file says when it began, and that can be true.

    Raises
    ------
    RecordingError
        If a file began before the one that it is to follow.
    """
    if any(raw.started is None for raw in raws):
        return None
    began = [(raw.started - raws[0].started).total_seconds() for raw in raws]  # type: ignore[operator]
    starts = [at + float(raw.time[0]) for at, raw in zip(began, raws, strict=True)]
    for i in range(1, len(raws)):
        if starts[i] < starts[i - 1]:
            raise RecordingError(
                f"{paths[i]}: expected a file recorded after {paths[i - 1].name} "
                f"({raws[i - 1].started}), found one that began {raws[i].started}; "
                "name the files in the order of time"
            )
        if starts[i] <= starts[i - 1] + float(raws[i - 1].time[-1] - raws[i - 1].time[0]):
            return None  # the same date in each file: a placeholder
    return starts
