"""A reader's output: all markers of one file, in the file's own unit and axes."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from types import MappingProxyType
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, mismatch, printable
from hopdata.messages import Message
from hopdata.recording import Event
from hopdata.recordings.budget import MOST_MARKERS
from hopdata.time_stamps import RATE_TOLERANCE, rate_of, settle

METRES_PER_UNIT: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "m": 1.0})

# Assumed for files that could state a unit but do not.
USUAL_UNIT = "mm"

# Spellings of units in files; numbers times the factor are in mm or m.
_SPELLINGS = (
    (r"mm|millimet(er|re)s?", "mm", 1.0),
    (r"cm|centimet(er|re)s?", "mm", 10.0),
    (r"m|met(er|re)s?", "m", 1.0),
    (r"in|inch(es)?", "mm", 25.4),
)
_BY_PROGRAM = re.compile(r"(.*:)?(\*\d+|unlabel+ed.*)", re.IGNORECASE)

#: Three equal coordinates of at least this size mean that a marker was not seen.
#: Unit: the file's. Origin: convention: programs write -9999, 9999.99 or 99999.
UNSEEN_FROM = 9999.0

#: Highest frame rate that a file may state.
#: Unit: Hz. Origin: convention: as in the schema of input.rate_hz.
FASTEST_HZ = 1e5

#: Lowest frame rate that a file may state.
#: Unit: Hz. Origin: chosen. It is one frame in twelve days.
SLOWEST_HZ = 1e-6

#: Largest difference of a configured rate from that of a file's time stamps.
#: Unit: 1. Origin: chosen. Stamps are rounded, so their rate is only an estimate.
SLACK = 0.02

# Names in a remark.
MOST_LISTED = 12

# What a reader says of a file; a message where other code must recognise it.
Remark = str | Message

# Code of the remark that markers of a file share a name.
NAME_SHARED = "recordings.name_shared"


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
    remarks : tuple of Remark
        False statements of the file that could be corrected, one line each.
    has_stamps : bool
        Whether `time` comes from the file; otherwise it is counted in frames at
        `rate_hz`.
    suffix: str
        Suffix of the file, such as ``".trc"``; empty if it comes from no file.
    plate_corners : (P, 4, 3) array, optional
        Corners of the force plates that the file states, in its unit and axes.
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
    remarks: tuple[Remark, ...] = ()
    has_stamps: bool = True
    suffix: str = ""
    plate_corners: FloatArray | None = None


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
    if stated is not None:
        if not SLOWEST_HZ <= stated <= FASTEST_HZ:
            wanted = f"at least {SLOWEST_HZ:g} and at most {FASTEST_HZ:g} Hz"
            raise RecordingError.at(f"{place}: frame rate", wanted, f"{stated:g} Hz")
        return float(stated)
    if given is None:
        raise RateUnknownError.at(
            f"{place}: frame rate",
            "a number in the file or in input.rate_hz",
            "neither; hopdata.read takes it as rate_hz",
        )
    return float(given)


def overrule_rate(place: str, raw: RawRecording, given: float | None) -> RawRecording:
    """Replace the rate that a file states by the configured one.

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
    remark = (
        f"{place}: frame rate: {given:g} Hz as in input.rate_hz; "
        f"the file states {raw.rate_hz:g}"
    )
    if raw.has_stamps:
        _require_rate_of_stamps(place, raw, given)
        longer = 1.0
    else:  # the time was counted at the stated rate
        longer = raw.rate_hz / given
    return replace(
        raw,
        time=raw.time * longer,
        rate_hz=given,
        events=tuple(Event(e.label, e.time_s * longer) for e in raw.events),
        remarks=(*raw.remarks, remark),
    )


def _require_rate_of_stamps(place: str, raw: RawRecording, given: float) -> None:
    """Require the time stamps of a file to run at the given rate, Hz."""
    own_hz = raw.rate_hz
    if len(raw.time) > 1:
        own_hz = 1 / float(np.median(np.diff(raw.time)))
    if not abs(own_hz - given) <= SLACK * given:
        raise RecordingError.at(
            f"{place}: frame rate",
            f"{own_hz:.4g} Hz as in its time stamps",
            f"input.rate_hz: {given:g}; leave it out, "
            "or correct the time in the export",
        )


def metric(place: str, stated: str) -> tuple[str, float]:
    """Return mm or m for a unit as files spell it (``Centimeters``), and the factor.

    Raises
    ------
    RecordingError
        If it is not a unit of length; the message begins with `place`.
    """
    for form, unit, factor in _SPELLINGS:
        if re.fullmatch(form, stated.strip().lower()):
            return unit, factor
    raise RecordingError.at(place, "mm, cm, m or inches", f"'{stated[:40]}'")


def labelled(place: str, names: Sequence[str]) -> tuple[list[int], tuple[str, ...]]:
    """Return which trajectories a person has named, and a remark on the others.

    ``*113`` and ``Unlabeled 7`` are fragments of any marker. They are kept if a file
    has nothing else.
    """
    kept = [i for i, name in enumerate(names) if not _BY_PROGRAM.fullmatch(name)]
    n_left = len(names) - len(kept)
    if not kept or not n_left:
        return list(range(len(names))), ()
    return kept, (f"{place}: {n_left} unlabeled trajectories are left out",)


def without_subject(names: Sequence[str]) -> tuple[str, ...]:
    """Drop the subject from names such as ``Anna:toe``, if there is only one."""
    subjects = {name.partition(":")[0] for name in names if ":" in name}
    if len(subjects) != 1:
        return tuple(names)
    return tuple(name.split(":", 1)[-1] for name in names)


def subject_left_out(place: str, names: Sequence[str]) -> tuple[Remark, ...]:
    """Return a remark on the subject that `without_subject` drops, if it drops one."""
    if without_subject(names) == tuple(names):
        return ()
    subject = next(name.partition(":")[0] for name in names if ":" in name)
    values = {"place": place, "subject": subject}
    return (Message("recordings.subject_left_out", values),)


def largest(numbers: FloatArray) -> float:
    """Return the largest absolute value; NaN if all values are NaN.

    No temporary array is made.
    """
    low = np.fmin.reduce(numbers, axis=None, initial=np.nan)
    high = np.fmax.reduce(numbers, axis=None, initial=np.nan)
    return float(max(abs(low), abs(high)))


def distinct_names(
    place: str, names: Sequence[str], *, may_lack: bool = False
) -> tuple[tuple[str, ...], tuple[Remark, ...]]:
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
    _check_names(place, names, may_lack)
    remarks: list[Remark] = []
    n_nameless = sum(not name for name in names)
    if n_nameless:
        remarks.append(
            f"{place}: {n_nameless} of {len(names)} markers lack a name and are called "
            "'unnamed <number>'"
        )
    complete = [name or f"unnamed {i}" for i, name in enumerate(names, start=1)]
    distinct, shared = _numbered(complete)
    if shared:
        remarks.append(_on_shared_names(place, shared))
    return tuple(distinct), tuple(remarks)


def _on_shared_names(place: str, shared: Mapping[str, Sequence[str]]) -> Message:
    """Return one remark on all names that markers share, and what these became."""
    values = {
        "place": place,
        "names": _listed(list(shared)),
        "listed": _listed([new for own in shared.values() for new in own]),
        "shared": [[name, list(own)] for name, own in shared.items()],
    }
    return Message(NAME_SHARED, values)


def _listed(names: Sequence[str]) -> str:
    """Return names in quotes, the first of them if there are many."""
    listed = ", ".join(f"'{name}'" for name in names[:MOST_LISTED])
    if len(names) > MOST_LISTED:
        listed += f", ... {len(names) - MOST_LISTED} more"
    return listed


def on_shared_name(remark: Remark, name: str) -> Message | None:
    """Return what a remark says of a name that markers share; None if nothing."""
    if not isinstance(remark, Message) or remark.code != NAME_SHARED:
        return None
    new_names = dict(remark.values["shared"]).get(name)
    if new_names is None:
        return None
    return _on_shared_names(remark.values["place"], {name: new_names})


def _check_names(place: str, names: Sequence[str], may_lack: bool) -> None:
    """Require names that can be printed, and no more than any recording has."""
    for i, name in enumerate(names, start=1):
        if not name and not may_lack:
            raise RecordingError.at(place, f"a name for marker {i}", "none")
        if printable(name) != name:
            wanted = f"a name of letters and digits for marker {i}"
            raise RecordingError.at(place, wanted, repr(name))
    if len(names) > MOST_MARKERS:
        raise RecordingError.at(
            place, f"at most {MOST_MARKERS:,} markers", f"{len(names):,}"
        )


def _numbered(names: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Return names, repeated ones numbered, and what each of these became."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(name, []).append(i)
    taken = set(names)
    distinct = list(names)
    shared = {}
    for name, places_of_name in places.items():
        if len(places_of_name) == 1:
            continue
        number = 0
        for i in places_of_name:
            number += 1
            while f"{name} {number}" in taken:
                number += 1
            distinct[i] = f"{name} {number}"
        shared[name] = [distinct[i] for i in places_of_name]
        taken.update(shared[name])
    return distinct, shared


def blank_unseen(positions: FloatArray) -> None:
    """Set markers to NaN (in place) in frames where the file marks them as not seen.

    In those frames a coordinate is missing, all three are 0, or all three are one
    number of at least 9999 in size (-9999, 9999.99, 99999).
    """
    for track in np.moveaxis(positions, 1, 0):
        x, y, z = track.T
        filled = (x == y) & (y == z) & ((x == 0) | (np.abs(x) >= UNSEEN_FROM))
        missing = np.isnan(track).any(axis=1)
        track[filled | missing] = np.nan


def assembled(  # noqa: PLR0913  what a file states, each of which it may lack
    place: str,
    named: tuple[tuple[str, ...], tuple[Remark, ...]],
    positions: FloatArray,
    *,
    number: FloatArray,
    stamps: FloatArray | None = None,
    unit: tuple[str, str] = ("", ""),
    rates_hz: tuple[float | None, float | None],
    rate_place: str = "",
    remarks: tuple[Remark, ...] = (),
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
    remarks : tuple of Remark
        Remarks of the reader.
    **others
        Further fields of the recording.

    Raises
    ------
    RecordingError
        If the unit is not one of length, or no rate is known.
    """
    markers, remarks_on_names = named
    _, spelling = unit
    unit_of_file, factor = metric(*unit) if spelling else (USUAL_UNIT, 1.0)
    blank_unseen(positions)
    positions *= factor

    stated_hz, given_hz = rates_hz
    if stated_hz is None and stamps is not None:
        stated_hz = rate_of(stamps, number)
    rate_hz = resolve_rate(rate_place or place, stated=stated_hz, given=given_hz)
    time: FloatArray = (number - 1.0) / rate_hz
    remarks_on_time: tuple[str, ...] = ()
    if stamps is not None:
        time, remarks_on_time = settle(place, stamps, number, rate_hz)

    others.setdefault("unit_is_stated", bool(spelling))
    others.setdefault("has_stamps", stamps is not None)
    return RawRecording(
        markers,
        time,
        positions,
        rate_hz,
        unit_of_file,
        remarks=(*remarks, *remarks_on_names, *remarks_on_time),
        **others,
    )


def frame_count(
    place: str, key: str, stated: float | None, n_rows: int
) -> tuple[str, ...]:
    """Return a remark if the stated number of frames is not that of the rows."""
    if stated is None or stated == n_rows:
        return ()
    found = f"{n_rows} rows, which are used"
    if n_rows < stated:
        found += "; was the file cut short?"
    return (mismatch(f"{place}: {key}", f"{stated:g} frames as stated", found),)


def events_outside(place: str, raw: RawRecording) -> tuple[str, ...]:
    """Return a remark on events before the first frame or after the last."""
    if not len(raw.time):
        return ()
    first_s, last_s = raw.time[[0, -1]].tolist()
    frame_s = 1 / raw.rate_hz
    n_outside = 0
    for event in raw.events:
        if not first_s - frame_s <= event.time_s <= last_s + frame_s:
            n_outside += 1
    if not n_outside:
        return ()
    remark = (
        f"{place}: {n_outside} of {len(raw.events)} events lie outside the recording "
        f"({first_s:.6g} to {last_s:.6g} s)"
    )
    return (remark,)
