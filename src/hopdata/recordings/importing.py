"""Import files as a canonical `Recording`: metres, z up, markers ordered by role."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import RecordingError, counted, did_you_mean, require_choice
from hopdata.foreign import door
from hopdata.messages import Message
from hopdata.recording import ROLES, Event, Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.quality import orientation
from hopdata.recordings.quality.processing import recorded_frames
from hopdata.recordings.raw import (
    METRES_PER_UNIT,
    RawRecording,
    Remark,
    on_shared_name,
    without_subject,
)
from hopdata.recordings.readers.formats import LEAST_SCORE, read_raw
from hopdata.recordings.readers.text import listed
from hopdata.time_stamps import PAUSE_S, RATE_TOLERANCE
from hopdata.truth import Truth

# Frames turned at a time.
BLOCK = 50_000

ROLE_OF_KEY = {"body": "body", "feet": "foot", "boom": "boom"}

# Arrays of a truth that have a column for each foot.
PER_FOOT = (
    "contact_times",
    "foot_down",
    "contact_points",
    "floor_at_contacts",
    "preloads_n",
)

# Advice for a file that has none of the configured markers.
ANOTHER_SESSION = (
    "the file has none of the configured markers, and all files of a study name them "
    "alike: rename them in the export (only a subject's name, as in 'Anna:toe', may be "
    "left out of the configuration), or make a study of its own"
)

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
    shifts = [start - raw.time[0] for start, raw in zip(starts, raws, strict=True)]
    time = [raw.time + shift for raw, shift in zip(raws, shifts, strict=True)]
    events: list[Event] = []
    remarks_of_files: list[Remark] = []
    for raw, shift in zip(raws, shifts, strict=True):
        events += [Event(event.label, event.time_s + shift) for event in raw.events]
        remarks_of_files += raw.remarks
    return replace(
        first,
        time=np.concatenate(time),
        positions=np.concatenate([raw.positions for raw in raws]),
        events=tuple(events),
        unit_is_stated=all(raw.unit_is_stated for raw in raws),
        remarks=(*remarks_of_files, *remarks),
    )


def _check_alike(
    first_path: Path, first: RawRecording, path: Path, raw: RawRecording
) -> None:
    """Require a file to agree with the first one."""

    def require_same(what: str, wanted: object, found: object, is_same: bool) -> None:
        if not is_same:
            raise RecordingError.at(
                f"{path}: {what}",
                f"{wanted} as in {first_path.name}",
                f"{found}; files joined in one recording must agree",
            )

    require_same("unit", first.unit, raw.unit, first.unit == raw.unit)
    require_same("markers", first.markers, raw.markers, first.markers == raw.markers)
    require_same(
        "vertical axis",
        first.stated_up,
        raw.stated_up,
        first.stated_up == raw.stated_up,
    )
    apart_hz = abs(raw.rate_hz - first.rate_hz)
    same_rate = not apart_hz > RATE_TOLERANCE * first.rate_hz
    require_same("frame rate (Hz)", first.rate_hz, raw.rate_hz, same_rate)


def _starts(
    paths: Sequence[Path], raws: Sequence[RawRecording]
) -> tuple[list[float], tuple[str, ...]]:
    """Return the time of each file's first frame on the clock of the first file, s."""
    by_clock = _starts_by_clock(paths, raws)
    if by_clock is not None:
        return by_clock, ()
    starts = [float(raws[0].time[0])]
    end_s = float(raws[0].time[-1])
    moved = []
    for path, raw in zip(paths[1:], raws[1:], strict=True):
        follows = raw.time[0] > end_s + 0.5 / raw.rate_hz
        if follows:
            starts.append(float(raw.time[0]))
        else:
            starts.append(end_s + PAUSE_S)
            moved.append(path.name)
        end_s = starts[-1] + float(raw.time[-1] - raw.time[0])
    if not moved:
        return starts, ()
    which = ", ".join(moved) if len(moved) < 4 else f"{len(moved)} of them"
    remark = (
        f"{paths[0]}: joined with {len(paths) - 1} more; no start is known for "
        f"{which}: put {PAUSE_S:g} s after the file before"
    )
    return starts, (remark,)


def _starts_by_clock(
    paths: Sequence[Path], raws: Sequence[RawRecording]
) -> list[float] | None:
    """Return the times of the first frames, s, as the files state their starts.

    None unless all files state plausible ones.

    Raises
    ------
    RecordingError
        If a file began before the one it should follow.
    """
    began = [raw.started for raw in raws if raw.started is not None]
    if len(began) < len(raws):
        return None
    starts = []
    for raw, at in zip(raws, began, strict=True):
        starts.append((at - began[0]).total_seconds() + float(raw.time[0]))
    for i in range(1, len(raws)):
        before = raws[i - 1]
        if starts[i] < starts[i - 1]:
            raise RecordingError.at(
                paths[i],
                f"a file recorded after {paths[i - 1].name} ({began[i - 1]})",
                f"one that began {began[i]}; name the files in the order of time",
            )
        duration_s = float(before.time[-1] - before.time[0])
        if starts[i] <= starts[i - 1] + duration_s:
            return None  # the files share one date, so it is a placeholder
    return starts


@one_blas_thread()
def import_recording(
    path: str | Path | Sequence[str | Path],
    *,
    name: str,
    markers: Mapping[str, Sequence[str]] | None,
    unit: str = "auto",
    vertical_axis: str = "z",
    rate_hz: float | None = None,
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
    markers : mapping or None
        Marker names for each of ``"body"``, ``"feet"``, ``"boom"``; the result keeps
        this order. None for all markers of the file, with the roles that it states; of
        several files those that all of them have.
    unit : {"auto", "m", "mm"}
        Unit of the file's positions. ``"auto"`` takes the format's own unit, or the
        other one if only that gives a plausible size; a remark says so.
    vertical_axis : {"auto", "x", "y", "z", "-x", "-y", "-z"}
        Axis of the file that points up. ``"auto"`` takes the likeliest by all that the
        file knows (`quality.orientation`); a remark says why.
    rate_hz : float, optional
        Frame rate, for files that state none or a wrong one (`raw.overrule_rate`).
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
    paths = _as_paths(path)
    if not paths:
        raise RecordingError(
            f"recording '{name}': expected at least one file, found none"
        )
    stated_roles = []
    pieces = []
    for one in paths:
        file = read_raw(one, rate_hz=rate_hz, least_score=least_score)
        stated_roles.append(dict(zip(file.markers, file.roles, strict=False)))
        if markers is not None:
            file = _chosen(one, file, markers)
        pieces.append(file)
    if markers is None:
        pieces = _all_shared(pieces)
    sources = [os.fsencode(p.as_posix()).decode(errors="replace") for p in paths]
    alike = orientation.speak_for_silent(sources, pieces, unit)
    raw = join(paths, alike) if len(paths) > 1 else pieces[0]

    taken = orientation.choose_unit(raw.positions, unit=unit, nominal=raw.unit)
    remarks = [str(remark) for remark in raw.remarks]
    if unit == "auto":
        on_unit = orientation.unit_remarks(sources, pieces, raw, taken)
        remarks += [str(remark) for remark in on_unit]
    vertical_axis, on_up = orientation.choose_up(
        vertical_axis, sources[0], raw, taken, markers or {}
    )
    remarks += [str(remark) for remark in on_up]
    _to_metres_and_z_up(raw.positions, taken, vertical_axis)
    roles = _roles_of_file(raw)
    if markers is not None:
        roles = []
        for key, role in ROLE_OF_KEY.items():
            roles += [role] * len(markers.get(key) or ())
    recording = Recording(
        name=name,
        time=raw.time,
        positions=raw.positions,
        markers=raw.markers,
        roles=tuple(roles),
        rate_hz=raw.rate_hz,
        source=", ".join(sources),
        source_sha256=", ".join(sha256(p) for p in paths),
        vertical_axis=vertical_axis if vertical_axis != "z" else raw.vertical_axis,
        events=raw.events,
        remarks=tuple(remarks),
    )
    recording = _without_made_up_frames(recording)
    has_all_frames = len(recording.time) == len(raw.time)
    on_excluded = _exclude(recording, exclude)
    recording = replace(recording, remarks=recording.remarks + on_excluded)
    if len(paths) > 1 or vertical_axis != "z" or not has_all_frames:
        return recording, None
    return recording, _truth(paths[0], stated_roles[0], recording)


def _as_paths(path: str | Path | Sequence[str | Path]) -> list[Path]:
    if isinstance(path, str | Path):
        return [Path(path)]
    return [Path(one) for one in path]


def _to_metres_and_z_up(positions: FloatArray, unit: str, vertical_axis: str) -> None:
    """Scale and turn (N, M, 3) positions in place, since memory may not hold two."""
    for first in range(0, len(positions), BLOCK):
        block = positions[first : first + BLOCK]
        block *= METRES_PER_UNIT[unit]
        block[:] = rotate_up(block, vertical_axis)


def _without_made_up_frames(recording: Recording) -> Recording:
    """Leave out every second frame if it was made up from its neighbours; say so."""
    longest = np.diff(recording.time).max(initial=0.0) * recording.rate_hz
    if not longest < 1.5:  # with missing frames it is not every second one
        return recording
    of_part = recording.body if recording.indices("body") else recording.positions
    kept = recording.part(recorded_frames(of_part))
    if len(kept.time) == len(recording.time):
        return kept
    remark = (
        f"{recording.source}: every second frame is made up from its neighbours, "
        "and left out"
    )
    return replace(kept, remarks=(*kept.remarks, remark))


def _exclude(
    recording: Recording, exclude: Sequence[Mapping[str, Any]]
) -> tuple[str, ...]:
    """Set markers to NaN (in place) where the configuration says so; return remarks."""
    time = recording.time
    remarks = []
    for entry in exclude:
        begin_s = time[0] if entry["from_s"] is None else entry["from_s"]
        end_s = time[-1] if entry["to_s"] is None else entry["to_s"]
        inside = (time >= begin_s) & (time <= end_s)
        for name in entry["markers"]:
            recording.positions[inside, recording.markers.index(name)] = np.nan
            remarks.append(
                f"{recording.source}: marker '{name}' counts as unseen from "
                f"{begin_s:g} to {end_s:g} s, by hand: {entry['reason']}"
            )
    return tuple(remarks)


def sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
    if not any(":" in name for name in asked):
        raw = replace(raw, markers=without_subject(raw.markers))
    chosen: list[str] = []
    for key in ROLE_OF_KEY:
        full_key = f"markers.{key}"
        for marker in wanted.get(key) or ():
            if marker not in raw.markers:
                raise RecordingError.at(
                    f"{path}: {full_key}",
                    f"a marker of the file ({listed(raw.markers)})",
                    f"{marker!r}{_advice(marker, asked, raw)}",
                    key=full_key,
                )
            if marker in chosen:
                found = f"'{marker}' twice"
                raise RecordingError.at(
                    full_key, "each marker once", found, key=full_key
                )
            chosen.append(marker)
    order = [raw.markers.index(marker) for marker in chosen]
    return replace(
        raw, markers=tuple(chosen), positions=_only(raw.positions, order), roles=()
    )


def _all_shared(raws: Sequence[RawRecording]) -> list[RawRecording]:
    """Return what was read with the markers that all files have, in the first's order.

    The name of a file's only subject is left out.
    """
    plain = [replace(raw, markers=without_subject(raw.markers)) for raw in raws]
    if all(raw.markers == plain[0].markers for raw in plain):
        return plain
    shared = set(plain[0].markers).intersection(*(raw.markers for raw in plain))
    names = [name for name in plain[0].markers if name in shared]
    found = []
    for raw in plain:
        order = [raw.markers.index(name) for name in names]
        left_out = len(raw.markers) - len(names)
        remarks = raw.remarks
        if left_out:
            markers = counted(left_out, "marker")
            values = {"markers": markers, "files": len(plain)}
            remarks = (*remarks, Message("recordings.not_in_all_files", values))
        roles = [role for name, role in _named_roles(raw) if name in shared]
        positions = _only(raw.positions, order)
        found.append(
            replace(
                raw,
                markers=tuple(names),
                positions=positions,
                roles=tuple(roles) if raw.roles else (),
                remarks=remarks,
            )
        )
    return found


def _named_roles(raw: RawRecording) -> list[tuple[str, str]]:
    """Return each marker with the role that the file states; ``other`` without one."""
    stated = [role if role in ROLES else "other" for role in raw.roles]
    stated += ["other"] * (len(raw.markers) - len(stated))
    return list(zip(raw.markers, stated, strict=True))


def _roles_of_file(raw: RawRecording) -> list[str]:
    return [role for _, role in _named_roles(raw)]


def _advice(marker: str, asked: Sequence[str], raw: RawRecording) -> str:
    """Return advice on a configured marker that the file does not have."""
    if set(marker.split()) <= set(raw.markers):
        advice = "; is a comma missing?"
    else:
        advice = did_you_mean(marker, raw.markers)
    for remark in raw.remarks:
        told = on_shared_name(remark, marker)
        if told is not None:
            advice += f"; {told}"
    if set(asked).isdisjoint(raw.markers):
        advice += f"; {ANOTHER_SESSION}"
    return advice


def _only(positions: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return some markers of (N, M, 3) positions, overwriting the input's memory."""
    n_frames = len(positions)
    kept = positions.reshape(-1)[: 3 * n_frames * len(order)]
    kept = kept.reshape(n_frames, len(order), 3)
    # Each block is read before it is overwritten.
    for first in range(0, n_frames, BLOCK):
        block = slice(first, first + BLOCK)
        kept[block] = positions[block][:, order]
    return kept


def _truth(path: Path, roles: Mapping[str, str], recording: Recording) -> Truth | None:
    """Return the truth in the file, feet in the recording's order, or None.

    None if it does not apply to this recording.
    """
    from hopdata.recordings.readers.hdf5 import is_truth_of

    body = recording.names("body")
    feet = recording.names("foot")
    if not body or not feet:
        return None
    if not is_truth_of(roles, body=body, feet=feet):
        return None
    truth: Truth | None = door.read(
        "hopdata.recordings.readers.hdf5:read_truth",
        str(path),
        place=path,
        n_bytes=door.size_of(path),
        reader="the HDF5 library",
        kinds=(Truth,),
        libraries=("h5py",),
    )
    if truth is None:
        return None
    feet_in_file = [marker for marker, role in roles.items() if role == "foot"]
    expected = (len(recording.time), len(feet_in_file))
    if truth.foot_down.shape != expected:
        n_frames, n_feet = expected
        found_frames, found_feet = truth.foot_down.shape
        raise RecordingError.at(
            f"{path}: truth",
            f"{n_frames} frames and {n_feet} feet as in the recording",
            f"{found_frames} and {found_feet}",
        )
    order = [feet_in_file.index(name) for name in feet]
    per_foot = [*PER_FOOT]
    if truth.longer_m is not None:
        per_foot.append("longer_m")
    in_order = {key: getattr(truth, key)[:, order] for key in per_foot}
    return replace(truth, **in_order)
