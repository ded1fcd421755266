"""What a reader hands over: all markers of one file, in the file's own unit and axes."""

import math
import re
from collections import Counter
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

METRES_PER_UNIT: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "m": 1.0})
USUAL_UNIT = "mm"  # of files that may state a unit and do not
# How files spell units; numbers times the factor are in mm or m.
_SPELT = (
    (r"mm|millimet(er|re)s?", "mm", 1.0),
    (r"cm|centimet(er|re)s?", "mm", 10.0),
    (r"m|met(er|re)s?", "m", 1.0),
    (r"in|inch(es)?", "mm", 25.4),
)
_BY_PROGRAM = re.compile(r"(.*:)?(\*\d+|unlabel+ed.*)", re.IGNORECASE)

UNSEEN_FROM = 9999.0  # what programs write three times for a marker that was not seen, and more
FASTEST_HZ = 1e5  # as in the schema of input.rate_hz
MOST_UNPACKED_MB = 2000.0  # as the default of input.most_unpacked_mb in the schema
RATE_TOLERANCE = 1e-3  # relative; files round their rate, but not by more than this
SLACK = 0.02  # relative, of the rate by rounded time stamps


class RateUnknownError(RecordingError):
    """Neither the file nor the configuration tells the frame rate."""


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
        Marker positions along the file's axes, in `unit`; NaN where a marker was not seen.
    rate_hz : float
        Nominal frame rate, Hz.
    unit : str
        Unit that the file or its format states, ``"mm"`` or ``"m"``.
    vertical_axis : str
        Direction of the original source that was up, if the format says so.
    roles : tuple of str
        Role of each marker, if the format says so.
    events : tuple of Event
        Events marked in the file, on the same clock as `time`.
    stated_up : str
        Axis that the file itself says points up; empty if it says nothing.
    started : datetime, optional
        When the measurement began, on the clock of the computer that made it.
    unit_is_stated : bool
        Whether it does; otherwise `unit` is only what is usual.
    remarks : tuple of str
        What the file says that does not hold and could be put right, one line each, counted.
    has_stamps : bool
        Whether `time` stands in the file; otherwise it is counted from the frames at `rate_hz`.
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
        If neither is known (`RateUnknownError`), or a rate is not positive or beyond any camera's.
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
    """Let the configuration overrule the frame rate that a file states, but not time stamps.

    Parameters
    ----------
    place : str
        The file, for message and remark.
    raw : RawRecording
        As read, at the rate that the file states.
    given : float or None
        ``input.rate_hz`` of the configuration, Hz.

    Raises
    ------
    RecordingError
        If the time stamps run at another rate than `given`.
    """
    if given is None or abs(given - raw.rate_hz) <= RATE_TOLERANCE * raw.rate_hz:
        return raw
    told = f"{place}: frame rate: {given:g} Hz as in input.rate_hz; the file states {raw.rate_hz:g}"
    if raw.has_stamps:
        own = 1 / float(np.median(np.diff(raw.time))) if len(raw.time) > 1 else raw.rate_hz
        if not abs(own - given) <= SLACK * given:
            wanted = f"{own:.4g} Hz as its time stamps run"
            found = f"input.rate_hz: {given:g}; leave it out, or correct the time in the export"
            raise RecordingError.at(f"{place}: frame rate", wanted, found)
    longer = 1.0 if raw.has_stamps else raw.rate_hz / given
    events = tuple(Event(event.label, event.time_s * longer) for event in raw.events)
    raw = replace(raw, time=raw.time * longer, rate_hz=given, events=events)
    return replace(raw, remarks=(*raw.remarks, told))


def metric(place: str, stated: str) -> tuple[str, float]:
    """Return mm or m, and the factor to it, of a unit as files spell it: ``Centimeters``, ``in``.

    Raises
    ------
    RecordingError
        If it is no unit of length; it begins with `place`.
    """
    for form, unit, factor in _SPELT:
        if re.fullmatch(form, stated.strip().lower()):
            return unit, factor
    raise RecordingError.at(place, "mm, cm, m or inches", f"'{stated[:40]}'")


def labelled(place: str, names: Sequence[str]) -> tuple[list[int], tuple[str, ...]]:
    """Return which trajectories somebody named, and a remark on those that a program did.

    ``*113`` and ``Unlabeled 7`` are pieces of any marker; a file of nothing else keeps them.
    """
    kept = [i for i, name in enumerate(names) if not _BY_PROGRAM.fullmatch(name)]
    if not kept or len(kept) == len(names):
        return list(range(len(names))), ()
    return kept, (f"{place}: {len(names) - len(kept)} unlabeled trajectories are left out",)


def without_subject(names: Sequence[str]) -> tuple[str, ...]:
    """Return names without their subject (``Anna:toe``), unless those of several have one."""
    subjects = {name.partition(":")[0] for name in names if ":" in name}
    return tuple(name.split(":", 1)[-1] if len(subjects) == 1 else name for name in names)


def require_unpacked(n_bytes: int, most_mb: float) -> None:
    """Refuse content that would take more memory than a file may ask for.

    Raises
    ------
    ValueError
        Without the file's name.
    """
    if n_bytes > 1e6 * most_mb:
        most = f"{most_mb:g} MB once it is unpacked (input.most_unpacked_mb, --most-unpacked-mb)"
        found = f"{n_bytes / 1e6:.0f} MB; raise it if the file is what it should be"
        raise ValueError(f"expected at most {most}, found {found}")


def largest(numbers: FloatArray) -> float:
    """Largest absolute value of an array, in no memory of its size; NaN if all are."""
    bounds = (extreme.reduce(numbers, axis=None, initial=np.nan) for extreme in (np.fmin, np.fmax))
    return float(max(map(abs, bounds)))


def distinct_names(
    place: str, names: Sequence[str], *, may_lack: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return marker names that are all there and all different, and remarks on those changed.

    Markers of one name are numbered, all of them: who asks for that name finds none, and may then
    choose.

    Parameters
    ----------
    place : str
        File (and line), for the message.
    names : sequence of str
        The M names, in the file's order.
    may_lack : bool
        Whether a marker without a name is called ``unnamed`` and its number.

    Raises
    ------
    RecordingError
        If a name holds control characters, or is empty and may not be.
    """
    for i, name in enumerate(names, start=1):
        if not name and not may_lack:
            raise RecordingError.at(place, f"a name for marker {i}", "none")
        if not name.isprintable():
            wanted = f"a name of letters and digits for marker {i}"
            raise RecordingError.at(place, wanted, repr(name))
    distinct = [name or f"unnamed {i}" for i, name in enumerate(names, start=1)]
    remarks = []
    if n_nameless := sum(not name for name in names):
        told = f"{n_nameless} of {len(names)} markers have no name, called 'unnamed <number>'"
        remarks.append(f"{place}: {told}")
    taken = set(distinct)
    for name in [name for name, times in Counter(distinct).items() if times > 1]:
        free = (f"{name} {k}" for k in count(1) if f"{name} {k}" not in taken)
        at = [i for i, other in enumerate(distinct) if other == name]
        for i in at:
            distinct[i] = next(free)
        told = ", ".join(f"'{distinct[i]}'" for i in at)
        found = f"'{name}' twice or more; they are called {told}"
        remarks.append(mismatch(place, "each marker name once", found))
        taken.update(distinct)
    return tuple(distinct), tuple(remarks)


def blank_unseen(positions: FloatArray) -> None:
    """Set markers (in place) to NaN in the frames in which the file says they were not seen.

    Those are frames in which a coordinate is missing, or all three are 0 or one number as large
    as 9999 (-9999, 9999.99, 99999).
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
    """Make a recording of what stands in a file: settle its unit, rate and time.

    Parameters
    ----------
    place : str
        The file, for messages.
    named : tuple
        What `distinct_names` returned.
    positions : (N, M, 3) array
        In the unit stated; multiplied in place, once what says "unseen" is NaN (`blank_unseen`).
    number : (N,) array
        Number of each frame, from 1.
    stamps : (N,) array, optional
        Time of each frame as printed, s.
    unit : tuple of str
        Where the file states its unit, and how it spells it; empty if it does not.
    rates_hz : tuple
        Rate that the file states, and ``input.rate_hz``, Hz, or None. If stamps alone tell the
        rate, it is theirs.
    rate_place : str
        Where the rate should stand, by default the file.
    remarks : tuple of str
        Those of the reader.
    **others
        Further fields of the recording.

    Raises
    ------
    RecordingError
        If the unit is none, or no rate is known.
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
    others = {"unit_is_stated": bool(unit[1]), "has_stamps": stamps is not None, **others}
    said = (*remarks, *named[1], *late)
    return RawRecording(named[0], time, positions, rate, of_unit, remarks=said, **others)


def frame_count(place: str, key: str, stated: float | None, n_rows: int) -> tuple[str, ...]:
    """Remark on a stated number of frames that is not that of the rows."""
    if stated is None or stated == n_rows:
        return ()
    found = f"{n_rows} rows, which are taken" + "; was the file cut short?" * (n_rows < stated)
    return (mismatch(f"{place}: {key}", f"{stated:g} frames as stated", found),)


# The axes of a file, and those of a recording, where z is up.

# The recording's x, y, z as directions of the file, for each direction that pointed up there. Along
# an axis they are exchanged in a circle; against one, the first and the last of these are mirrored
# as well. So all are proper rotations, which keep right from left.
FILE_AXES = {
    "x": ("y", "z", "x"), "y": ("z", "x", "y"), "z": ("x", "y", "z"),
    "-x": ("-y", "z", "-x"), "-y": ("-z", "x", "-y"), "-z": ("-x", "y", "-z"),
}  # fmt: skip


DIRECTIONS = ("x", "-x", "y", "-y", "z", "-z")


def rotate_up(positions: FloatArray, vertical_axis: str) -> FloatArray:
    """Turn (..., 3) positions so that the direction that pointed up, one of `FILE_AXES`, becomes z.

    Numbers are exchanged and mirrored, so that none loses a digit.
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
    """Return the direction against one of the file's: ``"-x"`` for ``"x"``, and back."""
    return axis.removeprefix("-") if axis.startswith("-") else f"-{axis}"


def along_file(offset: FloatArray, vertical_axis: str) -> dict[str, float]:
    """Return an offset (3,) of the recording by the axes of the file."""
    pairs = zip(FILE_AXES[vertical_axis], offset.tolist(), strict=True)
    parts = {axis[-1]: -value if axis.startswith("-") else value for axis, value in pairs}
    return {axis: parts[axis] for axis in "xyz"}


# Time stamps and frame rate of a file: what agrees, what is only rounded, what is irregular.

SNAP = 0.05  # of a frame: time stamps this near to the nominal grid are its rounded values
FINER = 0.9  # of a frame: the last decimal of stamps that are not printed to whole frames
_MOST_DECIMALS = 6


def settle(
    place: str, stamps: FloatArray, number: FloatArray, rate_hz: float
) -> tuple[FloatArray, tuple[str, ...]]:
    """Put time stamps back onto the grid from which they were printed.

    Exports round the time to 10 us or 1 ms, and some spread N frames over N / rate. Stamps that
    are evenly spaced but for that are those of the cameras' clock; all others stay as they are,
    for the checks to judge.

    Parameters
    ----------
    place : str
        The file, for the remark.
    stamps, number : (N,) array
        Time of each frame as printed, s, and the frame's number.
    rate_hz : float
        The nominal rate, Hz.

    Returns
    -------
    time : (N,) array
        s.
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
    told = f"time stamps run evenly at {own:.7g} Hz up to {stamps[-1]:.6g} s, but {ends}"
    return grid, (f"{place}: {told}; all {len(grid)} are taken from the rate",)


def _fitting_grid(stamps: FloatArray, number: FloatArray, rate_hz: float) -> FloatArray | None:
    """Return the grid of which the stamps are the rounded times; None if there is none.

    It begins at the first stamp or, since that is rounded too, midway between the bounds that all
    stamps set. (Not where they are printed to whole frames: a stamp that is repeated would pass.)
    """
    ticks: FloatArray = (number - number[0]) / rate_hz
    late = stamps - ticks
    begins = [stamps[0]]
    if printed_digit(stamps) * rate_hz < FINER:
        begins.append(0.5 * (late.min() + late.max()))
    fitting = (begin + ticks for begin in begins)
    return next((grid for grid in fitting if on_the_grid(stamps, grid, rate_hz)), None)


def on_the_grid(stamps: FloatArray, grid: FloatArray, rate_hz: float) -> bool:
    """Tell whether stamps are those of the grid but for the rounding with which they were printed.

    Parameters
    ----------
    stamps, grid : (N,) array
        Time of each frame as printed, and as it would be at the nominal rate, s.
    rate_hz : float
        The nominal rate, Hz.
    """
    digit = printed_digit(stamps)
    rounding = 0.5 * digit * (1 + 1e-6) if digit * rate_hz <= 1 else 0.0
    return bool(np.max(np.abs(stamps - grid)) < max(SNAP / rate_hz, rounding))


def printed_digit(stamps: FloatArray) -> float:
    """Place of the last decimal with which time stamps (N,) were printed, s; at least 1 us."""
    shown = ((n, np.round(stamps, n)) for n in range(_MOST_DECIMALS))
    told = (n for n, one in shown if np.allclose(stamps, one, rtol=1e-12, atol=1e-9))
    return float(10.0 ** -next(told, _MOST_DECIMALS))


def rate_of(stamps: FloatArray, number: FloatArray, *, whole: bool = True) -> float | None:
    """Frame rate by time stamps and frame numbers (N,), Hz; None if they do not tell.

    With `whole`, a rate within the usual rounding of a whole number is that number; and where the
    first and last stamp are too coarse, it is that of fewest decimals that gives all stamps.
    """
    if len(stamps) < 2 or not (stamps[-1] > stamps[0] and number[-1] > number[0]):
        return None
    number = _with_missing_rows(stamps, number)
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    if whole and rate > 0 and _fitting_grid(stamps, number, rate) is None:  # two are too coarse
        slope = float(np.polyfit(number - number[0], stamps, 1)[0])
        plain = (round(1 / slope, n) for n in range(_MOST_DECIMALS) if slope > 0)
        fitting = (x for x in plain if x > 0 and _fitting_grid(stamps, number, x) is not None)
        rate = next(fitting, rate)
    nearest = np.round(rate)
    return float(nearest if whole and abs(rate - nearest) < RATE_TOLERANCE * rate else rate)


def _with_missing_rows(stamps: FloatArray, number: FloatArray) -> FloatArray:
    """Let frame numbers (N,) go on by as many frames as are missing by the time stamps, s.

    Rows may have been cut out of a table whose frames are counted by its rows.
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
    """Remark on events before the first frame or after the last."""
    if not len(raw.time):
        return ()
    (first, last), frame_s = raw.time[[0, -1]].tolist(), 1 / raw.rate_hz
    outside = sum(not first - frame_s <= e.time_s <= last + frame_s for e in raw.events)
    told = f"{outside} of {len(raw.events)} events lie outside the recording"
    return (f"{place}: {told} ({first:.6g} to {last:.6g} s)",) * bool(outside)


PAUSE_S = 1.0  # between files that do not say when they began; longer than any landing


def is_pause(time: FloatArray, rate_hz: float) -> BoolArray:
    """Tell which steps of time stamps (N,), s, are pauses, (N - 1,): nothing was recorded then."""
    return np.asarray(np.diff(time) > PAUSE_S - 0.5 / rate_hz)
