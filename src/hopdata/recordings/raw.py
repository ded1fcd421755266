"""A reader's output: all markers of one file, in the file's own unit and axes."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import count
from types import MappingProxyType
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import RecordingError, chosen, mismatch
from hopdata.recording import Event
from hopdata.recordings.budget import MOST_MARKERS

METRES_PER_UNIT: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "m": 1.0})
USUAL_UNIT = "mm"  # assumed for files that could state a unit but do not
# Spellings of units in files; numbers times the factor are in mm or m.
_SPELT = (
    (r"mm|millimet(er|re)s?", "mm", 1.0),
    (r"cm|centimet(er|re)s?", "mm", 10.0),
    (r"m|met(er|re)s?", "m", 1.0),
    (r"in|inch(es)?", "mm", 25.4),
)
_BY_PROGRAM = re.compile(r"(.*:)?(\*\d+|unlabel+ed.*)", re.IGNORECASE)

UNSEEN_FROM = (
    9999.0  # programs write at least this, three times, for a marker that was not seen
)
FASTEST_HZ = 1e5  # Hz, as in the schema of input.rate_hz
RATE_TOLERANCE = 1e-3  # relative; larger than the error of any rounded rate in a file
MOST_LISTED = 12  # names in a remark
SLACK = 0.02  # relative error of a rate estimated from rounded time stamps


class RateUnknownError(RecordingError):
    """Raised if neither the file nor the configuration states the frame rate."""


@dataclass(frozen=True)
class RawRecording:
    """All markers of one file, before selection, scaling and rotation.

    Parameters
    ----------
    markers : tuple of str
        The M marker names, in the file's order.
    time : (N,) array
        Time stamp of each frame, s.
    positions : (N, M, 3) array
        Marker positions along the file's axes, in `unit`; NaN where a marker was not
        seen.
    rate_hz : float
        Nominal frame rate, Hz.
    unit : str
        Unit that the file or its format states, ``"mm"`` or ``"m"``.
    vertical_axis : str
        Direction of the original source that points up, if the format states it.
    roles : tuple of str
        Role of each marker, if the format states it.
    events : tuple of Event
        Events marked in the file, on the same clock as `time`.
    stated_up : str
        Axis that points up according to the file; empty if it does not say.
    started : datetime, optional
        When the measurement began, on the clock of the computer that made it.
    unit_is_stated : bool
        Whether the file states its unit; otherwise `unit` is the usual one.
    remarks : tuple of str
        False statements of the file that could be corrected, one line each.
    has_stamps : bool
        Whether `time` comes from the file; otherwise it is counted in frames at
        `rate_hz`.
    """

    markers: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    rate_hz: float
    unit: str
    vertical_axis: str = "z"
    roles: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    stated_up: str = ""
    started: datetime | None = None
    unit_is_stated: bool = True
    remarks: tuple[str, ...] = ()
    has_stamps: bool = True


def resolve_rate(place: str, *, stated: float | None, given: float | None) -> float:
    """Take the frame rate from the file or, if it states none, from the configuration.

    Parameters
    ----------
    place : str
        File (and line), for the message.
    stated : float or None
        Rate that the file states, Hz; None if it states none.
    given : float or None
        ``input.rate_hz`` of the configuration, Hz.

    Raises
    ------
    RecordingError
        If neither is known (`RateUnknownError`), or a rate is not positive or beyond
        any camera's.
    """
    for where, rate in ((f"{place}: frame rate", stated), ("input.rate_hz", given)):
        if rate is not None and not 0 < rate < math.inf:
            raise RecordingError(f"{where}: expected more than 0 Hz, found {rate:g} Hz")
    if stated is not None and stated > FASTEST_HZ:
        fastest = f"at most {FASTEST_HZ:g} Hz"
        raise RecordingError.at(f"{place}: frame rate", fastest, f"{stated:g} Hz")
    rate = given if stated is None else stated
    if rate is None:
        wanted = "a number in the file or in input.rate_hz"
        found = "neither; hopdata.read takes it as rate_hz"
        raise RateUnknownError.at(f"{place}: frame rate", wanted, found)
    return float(rate)


def overrule_rate(place: str, raw: RawRecording, given: float | None) -> RawRecording:
    """Replace the frame rate stated by a file by the configured one, unless time stamps disagree.

    Parameters
    ----------
    place : str
        The file, for the message and the remark.
    raw : RawRecording
        As read, at the rate stated by the file.
    given : float or None
        ``input.rate_hz`` of the configuration, Hz.

    Raises
    ------
    RecordingError
        If the time stamps run at a rate other than `given`.
    """
    if given is None or abs(given - raw.rate_hz) <= RATE_TOLERANCE * raw.rate_hz:
        return raw
    told = f"{place}: frame rate: {given:g} Hz as in input.rate_hz; the file states {raw.rate_hz:g}"
    if raw.has_stamps:
        own = (
            1 / float(np.median(np.diff(raw.time)))
            if len(raw.time) > 1
            else raw.rate_hz
        )
        if not abs(own - given) <= SLACK * given:
            wanted = f"{own:.4g} Hz as in its time stamps"
            found = f"input.rate_hz: {given:g}; leave it out, or correct the time in the export"
            raise RecordingError.at(f"{place}: frame rate", wanted, found)
    longer = 1.0 if raw.has_stamps else raw.rate_hz / given
    events = tuple(Event(event.label, event.time_s * longer) for event in raw.events)
    raw = replace(raw, time=raw.time * longer, rate_hz=given, events=events)
    return replace(raw, remarks=(*raw.remarks, told))


def metric(place: str, stated: str) -> tuple[str, float]:
    """Return mm or m for a unit as files spell it (``Centimeters``, ``in``), and the factor to it.

    Raises
    ------
    RecordingError
        If it is not a unit of length; the message begins with `place`.
    """
    for form, unit, factor in _SPELT:
        if re.fullmatch(form, stated.strip().lower()):
            return unit, factor
    raise RecordingError.at(place, "mm, cm, m or inches", f"'{stated[:40]}'")


def labelled(place: str, names: Sequence[str]) -> tuple[list[int], tuple[str, ...]]:
    """Return which trajectories were named by a person, and a remark on the others.

    ``*113`` and ``Unlabeled 7`` are fragments of any marker. They are kept if a file
    has nothing else.
    """
    kept = [i for i, name in enumerate(names) if not _BY_PROGRAM.fullmatch(name)]
    if not kept or len(kept) == len(names):
        return list(range(len(names))), ()
    return kept, (
        f"{place}: {len(names) - len(kept)} unlabeled trajectories are left out",
    )


def without_subject(names: Sequence[str]) -> tuple[str, ...]:
    """Drop the subject from names such as ``Anna:toe``, unless there are several subjects."""
    subjects = {name.partition(":")[0] for name in names if ":" in name}
    return tuple(
        name.split(":", 1)[-1] if len(subjects) == 1 else name for name in names
    )


def largest(numbers: FloatArray) -> float:
    """Return the largest absolute value without a temporary array; NaN if all values are NaN."""
    bounds = (
        extreme.reduce(numbers, axis=None, initial=np.nan)
        for extreme in (np.fmin, np.fmax)
    )
    return float(max(map(abs, bounds)))


def distinct_names(
    place: str, names: Sequence[str], *, may_lack: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Make marker names complete and distinct; return them with remarks on the changes.

    All markers that share a name are numbered, so that a request for that name fails
    and the user can choose.

    Parameters
    ----------
    place : str
        File (and line), for the message.
    names : sequence of str
        The M names, in the file's order.
    may_lack : bool
        Whether markers may lack a name; they are then called ``unnamed`` and numbered.

    Raises
    ------
    RecordingError
        If a name holds control characters, or is empty although it may not be.
    """
    for i, name in enumerate(names, start=1):
        if not name and not may_lack:
            raise RecordingError.at(place, f"a name for marker {i}", "none")
        if not name.isprintable():
            wanted = f"a name of letters and digits for marker {i}"
            raise RecordingError.at(place, wanted, repr(name))
    if len(names) > MOST_MARKERS:
        raise RecordingError.at(
            place, f"at most {MOST_MARKERS:,} markers", f"{len(names):,}"
        )
    distinct = [name or f"unnamed {i}" for i, name in enumerate(names, start=1)]
    remarks = []
    if n_nameless := sum(not name for name in names):
        told = f"{n_nameless} of {len(names)} markers lack a name and are called 'unnamed <number>'"
        remarks.append(f"{place}: {told}")
    taken = set(distinct)
    places: dict[str, list[int]] = {}
    for i, name in enumerate(distinct):
        places.setdefault(name, []).append(i)
    for name, at in places.items():
        if len(at) == 1:
            continue
        free = (f"{name} {k}" for k in count(1) if f"{name} {k}" not in taken)
        for i in at:
            distinct[i] = next(free)
        told = ", ".join(f"'{distinct[i]}'" for i in at[:MOST_LISTED])
        if len(at) > MOST_LISTED:
            told += f", ... {len(at) - MOST_LISTED} more"
        found = f"'{name}' twice or more; they are called {told}"
        remarks.append(mismatch(place, "each marker name once", found))
        taken.update(distinct)
    return tuple(distinct), tuple(remarks)


def blank_unseen(positions: FloatArray) -> None:
    """Set markers to NaN (in place) in frames where the file marks them as not seen.

    In those frames a coordinate is missing, all three are 0, or all three are one
    number of at least 9999 in size (-9999, 9999.99, 99999).
    """
    for track in np.moveaxis(positions, 1, 0):
        x, y, z = track.T
        filled = (x == y) & (y == z) & ((x == 0) | (np.abs(x) >= UNSEEN_FROM))
        track[filled | np.isnan(x + y + z)] = np.nan


def assembled(
    place: str,
    named: tuple[tuple[str, ...], tuple[str, ...]],
    positions: FloatArray,
    *,
    number: FloatArray,
    stamps: FloatArray | None = None,
    unit: tuple[str, str] = ("", ""),
    rates_hz: tuple[float | None, float | None],
    rate_place: str = "",
    remarks: tuple[str, ...] = (),
    **others: Any,
) -> RawRecording:
    """Make a recording from the contents of a file: settle its unit, rate and time.

    Parameters
    ----------
    place : str
        The file, for messages.
    named : tuple
        Output of `distinct_names`.
    positions : (N, M, 3) array
        In the stated unit. Unseen positions are set to NaN (`blank_unseen`), then all
        are scaled in place.
    number : (N,) array
        Number of each frame, from 1.
    stamps : (N,) array, optional
        Time of each frame as printed, s.
    unit : tuple of str
        Where the file states its unit, and its spelling; empty if it does not.
    rates_hz : tuple
        Rate stated by the file, and ``input.rate_hz``, Hz, or None. If the file states
        none, the time stamps give its rate.
    rate_place : str
        Where the rate should stand; by default the file.
    remarks : tuple of str
        Remarks of the reader.
    **others
        Further fields of the recording.

    Raises
    ------
    RecordingError
        If the unit is not one of length, or no rate is known.
    """
    of_unit, factor = metric(*unit) if unit[1] else (USUAL_UNIT, 1.0)
    blank_unseen(positions)
    positions *= factor
    stated, given = rates_hz
    if stated is None and stamps is not None:
        stated = rate_of(stamps, number)
    rate = resolve_rate(rate_place or place, stated=stated, given=given)
    time: FloatArray = (number - 1.0) / rate
    late: tuple[str, ...] = ()
    if stamps is not None:
        time, late = settle(place, stamps, number, rate)
    others = {
        "unit_is_stated": bool(unit[1]),
        "has_stamps": stamps is not None,
        **others,
    }
    said = (*remarks, *named[1], *late)
    return RawRecording(
        named[0], time, positions, rate, of_unit, remarks=said, **others
    )


def frame_count(
    place: str, key: str, stated: float | None, n_rows: int
) -> tuple[str, ...]:
    """Return a remark if the stated number of frames differs from the number of rows."""
    if stated is None or stated == n_rows:
        return ()
    found = f"{n_rows} rows, which are used" + "; was the file cut short?" * (
        n_rows < stated
    )
    return (mismatch(f"{place}: {key}", f"{stated:g} frames as stated", found),)


# Axes of the file and axes of the recording, in which z is up.

# Directions of the file that become the recording's x, y, z, for each direction that
# pointed up in the file. If an axis pointed up, the axes are permuted cyclically; if
# its opposite did, the first and the last of them are also mirrored. All are proper
# rotations, which keep right and left apart.
FILE_AXES = {
    "x": ("y", "z", "x"), "y": ("z", "x", "y"), "z": ("x", "y", "z"),
    "-x": ("-y", "z", "-x"), "-y": ("-z", "x", "-y"), "-z": ("-x", "y", "-z"),
}  # fmt: skip


DIRECTIONS = ("x", "-x", "y", "-y", "z", "-z")


def rotate_up(positions: FloatArray, vertical_axis: str) -> FloatArray:
    """Turn (..., 3) positions so that the given up direction, one of `FILE_AXES`, becomes z.

    Coordinates are only exchanged and negated, so no digit is lost.
    """
    axes = chosen("input.vertical_axis", vertical_axis, FILE_AXES)
    if axes == FILE_AXES["z"]:
        return positions
    return np.stack([along(positions, axis) for axis in axes], axis=-1)


def along(positions: FloatArray, direction: str) -> FloatArray:
    """Return the coordinate (...) of (..., 3) positions along a direction such as ``"-y"``."""
    coordinate = positions[..., "xyz".index(direction[-1])]
    return -coordinate if direction.startswith("-") else coordinate


def opposite(axis: str) -> str:
    """Return the opposite direction: ``"-x"`` for ``"x"``, and vice versa."""
    return axis.removeprefix("-") if axis.startswith("-") else f"-{axis}"


def along_file(offset: FloatArray, vertical_axis: str) -> dict[str, float]:
    """Return an offset (3,) of the recording along the axes of the file."""
    pairs = zip(FILE_AXES[vertical_axis], offset.tolist(), strict=True)
    parts = {
        axis[-1]: -value if axis.startswith("-") else value for axis, value in pairs
    }
    return {axis: parts[axis] for axis in "xyz"}


# Time stamps and frame rate of a file: consistent, rounded or irregular.

SNAP = 0.05  # frames; stamps this close to the nominal grid are rounded values of it
# Frames; a last decimal below this means that stamps are not printed to whole frames
FINER = 0.9
_MOST_DECIMALS = 6


def settle(
    place: str, stamps: FloatArray, number: FloatArray, rate_hz: float
) -> tuple[FloatArray, tuple[str, ...]]:
    """Put time stamps back onto the grid they were rounded from.

    Exports round the time to 10 us or 1 ms, and some spread N frames over N / rate.
    Stamps that are otherwise evenly spaced follow the cameras' clock. All others are
    left unchanged for the checks to judge.

    Parameters
    ----------
    place : str
        The file, for the remark.
    stamps, number : (N,) array
        Time of each frame as printed, s, and its frame number.
    rate_hz : float
        The nominal rate, Hz.

    Returns
    -------
    time : (N,) array
        Time of each frame, s.
    remarks : tuple of str
    """
    number = _with_missing_rows(stamps, number)
    if (fitting := _fitting_grid(stamps, number, rate_hz)) is not None:
        return fitting, ()
    own = rate_of(stamps, number, whole=False)
    near = own is not None and abs(own - rate_hz) <= RATE_TOLERANCE * rate_hz
    if own is None or not near or _fitting_grid(stamps, number, own) is None:
        return stamps, ()
    grid: FloatArray = stamps[0] + (number - number[0]) / rate_hz
    ends = f"at the rate of {rate_hz:g} Hz they would end at {grid[-1]:.6g} s"
    told = (
        f"time stamps run evenly at {own:.7g} Hz up to {stamps[-1]:.6g} s, but {ends}"
    )
    return grid, (f"{place}: {told}; all {len(grid)} are taken from the rate",)


def _fitting_grid(
    stamps: FloatArray, number: FloatArray, rate_hz: float
) -> FloatArray | None:
    """Return the grid that the stamps are rounded from; None if there is none.

    It begins at the first stamp or, since that is rounded too, midway between the
    bounds set by all stamps. The second choice is not tried for stamps printed to whole
    frames, because it would accept a repeated stamp.
    """
    ticks: FloatArray = (number - number[0]) / rate_hz
    late = stamps - ticks
    begins = [stamps[0]]
    if printed_digit(stamps) * rate_hz < FINER:
        begins.append(0.5 * (late.min() + late.max()))
    fitting = (begin + ticks for begin in begins)
    return next((grid for grid in fitting if on_the_grid(stamps, grid, rate_hz)), None)


def on_the_grid(stamps: FloatArray, grid: FloatArray, rate_hz: float) -> bool:
    """Tell whether stamps agree with the grid to within their rounding.

    Parameters
    ----------
    stamps, grid : (N,) array
        Time of each frame as printed, and at the nominal rate, s.
    rate_hz : float
        The nominal rate, Hz.
    """
    digit = printed_digit(stamps)
    rounding = 0.5 * digit * (1 + 1e-6) if digit * rate_hz <= 1 else 0.0
    return bool(np.max(np.abs(stamps - grid)) < max(SNAP / rate_hz, rounding))


def printed_digit(stamps: FloatArray) -> float:
    """Return the last decimal place printed in time stamps (N,), s; at least 1 us."""
    shown = ((n, np.round(stamps, n)) for n in range(_MOST_DECIMALS))
    told = (n for n, one in shown if np.allclose(stamps, one, rtol=1e-12, atol=1e-9))
    return float(10.0 ** -next(told, _MOST_DECIMALS))


def rate_of(
    stamps: FloatArray, number: FloatArray, *, whole: bool = True
) -> float | None:
    """Return the frame rate from time stamps and frame numbers (N,), Hz; None if undetermined.

    With `whole`, a rate within the usual rounding of a whole number becomes that
    number. If the first and last stamps are too coarse, the rate is the one of fewest
    decimals that reproduces all stamps.
    """
    if len(stamps) < 2 or not (stamps[-1] > stamps[0] and number[-1] > number[0]):
        return None
    number = _with_missing_rows(stamps, number)
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    if (
        whole and rate > 0 and _fitting_grid(stamps, number, rate) is None
    ):  # ends are too coarse
        slope = float(np.polyfit(number - number[0], stamps, 1)[0])
        plain = (round(1 / slope, n) for n in range(_MOST_DECIMALS) if slope > 0)
        fitting = (
            x for x in plain if x > 0 and _fitting_grid(stamps, number, x) is not None
        )
        rate = next(fitting, rate)
    nearest = np.round(rate)
    return float(
        nearest if whole and abs(rate - nearest) < RATE_TOLERANCE * rate else rate
    )


def _with_missing_rows(stamps: FloatArray, number: FloatArray) -> FloatArray:
    """Advance frame numbers (N,) by the frames that are missing according to the time stamps, s.

    Rows may have been cut out of a table whose frames are numbered by its rows.
    """
    steps, frames = np.diff(stamps), np.diff(number)
    if not (frames > 0).all() or not stamps[-1] > stamps[0]:
        return number
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    if on_the_grid(stamps, stamps[0] + (number - number[0]) / rate, rate):
        return number
    low, usual, high = np.quantile(steps / frames, [0.1, 0.5, 0.9])
    missing = steps / frames - usual > max(0.5 * usual, 1.5 * (high - low))
    if usual <= 0 or not missing.any():
        return number
    rate = frames[~missing].sum() / steps[~missing].sum()
    frames[missing] = np.round(steps[missing] * rate)
    return np.concatenate([number[:1], number[0] + np.cumsum(frames)])


def events_outside(place: str, raw: RawRecording) -> tuple[str, ...]:
    """Return a remark on events before the first frame or after the last."""
    if not len(raw.time):
        return ()
    (first, last), frame_s = raw.time[[0, -1]].tolist(), 1 / raw.rate_hz
    outside = sum(not first - frame_s <= e.time_s <= last + frame_s for e in raw.events)
    told = f"{outside} of {len(raw.events)} events lie outside the recording"
    return (f"{place}: {told} ({first:.6g} to {last:.6g} s)",) * bool(outside)


PAUSE_S = 1.0  # s, between files that do not state their start; longer than any landing


def is_pause(time: FloatArray, rate_hz: float) -> BoolArray:
    """Tell which steps of time stamps (N,), s, are pauses in the recording, (N - 1,)."""
    return np.asarray(np.diff(time) > PAUSE_S - 0.5 / rate_hz)
