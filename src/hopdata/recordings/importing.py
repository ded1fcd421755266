"""Import files as a canonical `Recording`: metres, z up, markers ordered by role."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import RecordingError, did_you_mean, require_choice
from hopdata.recording import Event, Recording, Truth
from hopdata.recordings import raw as reading
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.budget import MOST_UNPACKED_MB
from hopdata.recordings.quality import orientation
from hopdata.recordings.quality.rigid import recorded_frames
from hopdata.recordings.raw import RawRecording, without_subject
from hopdata.recordings.readers.formats import LEAST_SCORE, read_raw
from hopdata.recordings.readers.text import listed
from hopdata.time_stamps import PAUSE_S, RATE_TOLERANCE

# Several files of one day are joined into one recording, frames in sequence, with a
# pause between.


def join(paths: Sequence[Path], raws: Sequence[RawRecording]) -> RawRecording:
    """Join files, which must be given in order of time.

    If every file states when its measurement began, that sets its place in time.
    Otherwise, a file keeps its time stamps if they follow those of the file before; any
    other file is moved to begin `PAUSE_S` after the previous one, with a remark. No
    frames are made up for the time between.

    Parameters
    ----------
    paths, raws
        The files and what was read from them, with the same markers in the same order.

    Raises
    ------
    RecordingError
        If the files differ in rate, unit, markers or stated vertical axis, or are out
        of order.
    """
    first = raws[0]
    for path, raw in zip(paths[1:], raws[1:], strict=True):
        _check_alike(paths[0], first, path, raw)
    starts, remarks = _starts(paths, raws)
    moved = [
        (raw, start - raw.time[0]) for start, raw in zip(starts, raws, strict=True)
    ]
    events = tuple(
        Event(event.label, event.time_s + s) for raw, s in moved for event in raw.events
    )
    return replace(
        first,
        time=np.concatenate([raw.time + s for raw, s in moved]),
        positions=np.concatenate([raw.positions for raw in raws]),
        events=events,
        unit_is_stated=all(raw.unit_is_stated for raw in raws),
        remarks=sum((raw.remarks for raw in raws), ()) + remarks,
    )


def _check_alike(
    first_path: Path, first: RawRecording, path: Path, raw: RawRecording
) -> None:
    for what, wanted, found in (
        ("unit", first.unit, raw.unit),
        ("markers", first.markers, raw.markers),
        ("vertical axis", first.stated_up, raw.stated_up),
        ("frame rate (Hz)", first.rate_hz, raw.rate_hz),
    ):
        apart = (
            abs(raw.rate_hz - first.rate_hz) > RATE_TOLERANCE * first.rate_hz
        )
        if apart if what.startswith("frame rate") else wanted != found:
            told = f"{found}; files joined in one recording must agree"
            raise RecordingError.at(
                f"{path}: {what}", f"{wanted} as in {first_path.name}", told
            )


def _starts(
    paths: Sequence[Path], raws: Sequence[RawRecording]
) -> tuple[list[float], tuple[str, ...]]:
    """Return the time of each file's first frame on the clock of the first file, s."""
    if (by_clock := _starts_by_clock(paths, raws)) is not None:
        return by_clock, ()
    starts, end = [float(raws[0].time[0])], float(raws[0].time[-1])
    moved = []
    for path, raw in zip(paths[1:], raws[1:], strict=True):
        follows = raw.time[0] > end + 0.5 / raw.rate_hz
        starts.append(float(raw.time[0]) if follows else end + PAUSE_S)
        end = starts[-1] + float(raw.time[-1] - raw.time[0])
        if not follows:
            moved.append(path.name)
    which = ", ".join(moved) if len(moved) < 4 else f"{len(moved)} of them"
    told = f"{paths[0]}: joined with {len(paths) - 1} more; no start is known for {which}: put "
    return starts, (f"{told}{PAUSE_S:g} s after the file before",) * bool(moved)


def _starts_by_clock(
    paths: Sequence[Path], raws: Sequence[RawRecording]
) -> list[float] | None:
    """Return the times of the first frames, or None unless all files state plausible starts.

    Raises
    ------
    RecordingError
        If a file began before the one it should follow.
    """
    if any(raw.started is None for raw in raws):
        return None
    began = [(raw.started - raws[0].started).total_seconds() for raw in raws]  # type: ignore[operator]
    starts = [at + float(raw.time[0]) for at, raw in zip(began, raws, strict=True)]
    for i in range(1, len(raws)):
        if starts[i] < starts[i - 1]:
            wanted = (
                f"a file recorded after {paths[i - 1].name} ({raws[i - 1].started})"
            )
            found = (
                f"one that began {raws[i].started}; name the files in the order of time"
            )
            raise RecordingError.at(paths[i], wanted, found)
        if starts[i] <= starts[i - 1] + float(
            raws[i - 1].time[-1] - raws[i - 1].time[0]
        ):
            return None  # the files share one date, so it is a placeholder
    return starts


BLOCK = 50_000  # frames turned at a time
ROLE_OF_KEY = {"body": "body", "feet": "foot", "boom": "boom"}

PER_FOOT = (
    "contact_times",
    "foot_down",
    "contact_points",
    "floor_at_contacts",
    "preloads_n",
)


@one_blas_thread()
def import_recording(
    path: str | Path | Sequence[str | Path],
    *,
    name: str,
    markers: Mapping[str, Sequence[str]],
    unit: str = "auto",
    vertical_axis: str = "z",
    rate_hz: float | None = None,
    most_unpacked_mb: float = MOST_UNPACKED_MB,
    least_score: float = LEAST_SCORE,
    exclude: Sequence[Mapping[str, Any]] = (),
) -> tuple[Recording, Truth | None]:
    """Read a file of any known format, or several in order of time, as one recording.

    `plausibility.check_plausible` decides whether the result makes sense.

    Parameters
    ----------
    path : path or sequence of path
        A file whose suffix is one of `formats.suffixes`, or several to be joined (see
        `join`).
    name : str
        Name of the recording in the study.
    markers : mapping
        Marker names for each of ``"body"``, ``"feet"``, ``"boom"``; the result keeps
        this order.
    unit : {"auto", "m", "mm"}
        Unit of the file's positions. ``"auto"`` takes the format's own unit, or the
        other one if only that gives a plausible size; a remark says so.
    vertical_axis : {"auto", "x", "y", "z", "-x", "-y", "-z"}
        Axis of the file that points up. ``"auto"`` takes the axis along which the
        markers fall, or the body is above its feet; a remark says so.
    rate_hz : float, optional
        Frame rate, for files that state none or a wrong one (`raw.overrule_rate`).
    most_unpacked_mb : float
        Most memory that a packed file (MAT, HDF5) may use, MB.
    least_score : float
        Keypoints from video with a lower score count as unseen.
    exclude : sequence of mappings
        ``recordings[].exclude`` of the configuration: the ``markers`` of an entry count
        as unseen from ``from_s`` to ``to_s``; a remark says so.

    Returns
    -------
    recording : Recording
        Positions in m, z up, with the file's SHA-256. For several files, names and
        digests are joined by commas.
    truth : Truth or None
        Truth of a synthetic recording, if body, feet and axes are those it was made
        for. None for several files.

    Raises
    ------
    RecordingError
        If the file cannot be read or lacks a configured marker.
    """
    paths = [Path(p) for p in ([path] if isinstance(path, str | Path) else path)]
    if not paths:
        raise RecordingError(
            f"recording '{name}': expected at least one file, found none"
        )
    limits = {"most_unpacked_mb": most_unpacked_mb, "least_score": least_score}
    stated, pieces = [], []
    for p in paths:
        file = read_raw(p, rate_hz=rate_hz, **limits)
        stated.append(dict(zip(file.markers, file.roles, strict=False)))
        pieces.append(_chosen(p, file, markers))
    sources = [os.fsencode(p.as_posix()).decode(errors="replace") for p in paths]
    spoken = orientation.speak_for_silent(sources, pieces, unit)
    raw = join(paths, spoken) if len(paths) > 1 else pieces[0]
    positions = raw.positions
    taken = orientation.choose_unit(positions, unit=unit, nominal=raw.unit)
    guessed = (
        orientation.unit_remarks(sources, pieces, raw, taken) if unit == "auto" else ()
    )
    vertical_axis, found = orientation.choose_up(
        vertical_axis, sources[0], raw, taken, markers
    )
    for first in range(0, len(positions), BLOCK):
        block = positions[first : first + BLOCK]
        block *= reading.METRES_PER_UNIT[taken]
        block[:] = rotate_up(block, vertical_axis)
    recording = Recording(
        name=name,
        time=raw.time,
        positions=positions,
        markers=raw.markers,
        roles=tuple(
            role for key, role in ROLE_OF_KEY.items() for _ in markers.get(key) or ()
        ),
        rate_hz=raw.rate_hz,
        source=", ".join(sources),
        source_sha256=", ".join(sha256(p) for p in paths),
        vertical_axis=vertical_axis if vertical_axis != "z" else raw.vertical_axis,
        events=raw.events,
        remarks=raw.remarks + guessed + found,
    )
    if (
        np.diff(raw.time).max(initial=0.0) * raw.rate_hz < 1.5
    ):  # only then is it every second
        recording = recording.part(recorded_frames(recording.body))
    halved = len(recording.time) < len(raw.time)
    told = f"{recording.source}: every second frame is made up from its neighbours, and left out"
    more = (told,) * halved + _unseen(recording, exclude)
    recording = replace(recording, remarks=recording.remarks + more)
    if len(paths) > 1 or vertical_axis != "z" or halved:
        return recording, None
    return recording, _truth(paths[0], stated[0], recording)


def _unseen(
    recording: Recording, exclude: Sequence[Mapping[str, Any]]
) -> tuple[str, ...]:
    """Set markers to NaN (in place) where the configuration excludes them; return remarks."""
    remarks = []
    for entry in exclude:
        begin, end = (recording.time[k] if t is None else t
                      for k, t in ((0, entry["from_s"]), (-1, entry["to_s"])))  # fmt: skip
        inside = (recording.time >= begin) & (recording.time <= end)
        told = (
            f"counts as unseen from {begin:g} to {end:g} s, by hand: {entry['reason']}"
        )
        for name in entry["markers"]:
            recording.positions[inside, recording.markers.index(name)] = np.nan
            remarks.append(f"{recording.source}: marker '{name}' {told}")
    return tuple(remarks)


def sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


#: Advice for a file that has none of the configured markers.
ANOTHER_SESSION = (
    "; the file has none of the configured markers, and all files of a study name them alike: "
    "rename them in the export (only a subject's name, as in 'Anna:toe', may be left out of "
    "the configuration), or make a study of its own"
)


def _chosen(
    path: Path, raw: RawRecording, wanted: Mapping[str, Sequence[str]]
) -> RawRecording:
    """Keep only the configured markers, body first, then feet, then boom.

    If no configured name has a subject (`Anna:toe`) and the file has only one subject,
    its name is dropped.
    """
    for key in wanted:
        require_choice("markers", key, ROLE_OF_KEY)
    asked = [name for names in wanted.values() for name in names or ()]
    if ":" not in "".join(asked):
        raw = replace(raw, markers=without_subject(raw.markers))
    chosen: list[str] = []
    for key in ROLE_OF_KEY:
        for marker in wanted.get(key) or ():
            if marker not in raw.markers:
                several = set(marker.split()) <= set(raw.markers)
                near = (
                    "; is a comma missing?"
                    if several
                    else did_you_mean(marker, raw.markers)
                )
                near += "".join(
                    f"; {told}" for told in raw.remarks if f"'{marker}' twice" in told
                )
                near += ANOTHER_SESSION * set(asked).isdisjoint(raw.markers)
                place, there = f"{path}: markers.{key}", f"({listed(raw.markers)})"
                raise RecordingError.at(
                    place, f"a marker of the file {there}", f"{marker!r}{near}"
                )
            if marker in chosen:
                raise RecordingError.at(
                    f"markers.{key}", "each marker once", f"'{marker}' twice"
                )
            chosen.append(marker)
    order = [raw.markers.index(marker) for marker in chosen]
    return replace(
        raw, markers=tuple(chosen), positions=_only(raw.positions, order), roles=()
    )


def _only(positions: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return some markers of (N, M, 3) positions, overwriting the memory of the input."""
    kept = positions.reshape(-1)[: 3 * len(positions) * len(order)]
    kept = kept.reshape(len(positions), len(order), 3)
    for first in range(
        0, len(positions), BLOCK
    ):  # each block is read before it is overwritten
        block = slice(first, first + BLOCK)
        kept[block] = positions[block][:, order]
    return kept


def _truth(path: Path, roles: Mapping[str, str], recording: Recording) -> Truth | None:
    """Return the truth in the file, feet in the recording's order, or None if it does not apply."""
    from hopdata.recordings.readers.hdf5 import is_truth_of, read_truth

    if not is_truth_of(
        roles, body=recording.names("body"), feet=recording.names("foot")
    ):
        return None
    truth = read_truth(path)
    if truth is None:
        return None
    feet = [marker for marker, role in roles.items() if role == "foot"]
    expected = (len(recording.time), len(feet))
    if truth.foot_down.shape != expected:
        wanted = "{} frames and {} feet as in the recording".format(*expected)
        place = f"{path}: truth"
        raise RecordingError.at(
            place, wanted, "{} and {}".format(*truth.foot_down.shape)
        )
    order = [feet.index(name) for name in recording.names("foot")]
    return replace(truth, **{key: getattr(truth, key)[:, order] for key in PER_FOOT})
