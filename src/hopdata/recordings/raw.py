"""What a reader hands over: all markers of one file, in the file's own unit and axes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import count
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError

FloatArray = NDArray[np.float64]

METRES_PER_UNIT: Mapping[str, float] = MappingProxyType({"mm": 1e-3, "m": 1.0})
USUAL_UNIT = "mm"  # of files that may state a unit and do not

FASTEST_HZ = 1e5  # as in the schema of input.rate_hz
MOST_UNPACKED_MB = 2000.0  # as the default of input.most_unpacked_mb in the schema
RATE_TOLERANCE = 1e-3  # relative; files round their rate, but not by more than this


@dataclass(frozen=True)
class Event:
    """An event that an operator or a device marked in the file.

    Parameters
    ----------
    label : str
        Name of the event.
    time_s : float
        Time stamp as in the file, s.
    """

    label: str
    time_s: float


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
    trajectory_types : tuple of str
        How each marker came about (such as ``"Measured"``), if the format says so.
    stated_up : str
        Axis that the file itself says points up; empty if it says nothing.
    started : datetime, optional
        When the measurement began, on the clock of the computer that made it.
    unit_is_stated : bool
        Whether it does; otherwise `unit` is only what is usual.
    remarks : tuple of str
        What the file says that does not hold and could be put right, one line each, counted.
    """

    markers: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    rate_hz: float
    unit: str
    vertical_axis: str = "z"
    roles: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    trajectory_types: tuple[str, ...] = ()
    stated_up: str = ""
    started: datetime | None = None
    unit_is_stated: bool = True
    remarks: tuple[str, ...] = ()


def resolve_rate(place: str, *, stated: float | None, given: float | None) -> float:
    """Agree on the frame rate between the file and the configuration.

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
        If neither is known, the rate is not positive or beyond any camera's, or the two disagree.
    """
    if stated is not None and not (math.isfinite(stated) and stated > 0):
        raise RecordingError(f"{place}: frame rate: expected more than 0 Hz, found {stated:g} Hz")
    if stated is not None and stated > FASTEST_HZ:
        raise RecordingError(
            f"{place}: frame rate: expected at most {FASTEST_HZ:g} Hz, found {stated:g} Hz"
        )
    if given is not None and not (math.isfinite(given) and given > 0):
        raise RecordingError(f"input.rate_hz: expected more than 0 Hz, found {given:g} Hz")
    if stated is None and given is None:
        raise RecordingError(
            f"{place}: frame rate: expected a number in the file or in input.rate_hz, found neither"
        )
    if stated is None or given is None:
        return float(stated if given is None else given)  # type: ignore[arg-type]
    if abs(given - stated) > RATE_TOLERANCE * stated:
        raise RecordingError(
            f"{place}: frame rate: expected {stated:g} Hz as the file states, "
            f"found input.rate_hz: {given:g}; leave that key out"
        )
    return stated


def require_unpacked(n_bytes: int, most_mb: float) -> None:
    """Refuse content that would take more memory than a file may ask for.

    Raises
    ------
    ValueError
        Without the file's name.
    """
    if n_bytes > 1e6 * most_mb:
        raise ValueError(
            f"expected at most {most_mb:g} MB once it is unpacked (input.most_unpacked_mb, "
            f"--most-unpacked-mb), found {n_bytes / 1e6:.0f} MB; raise it if the file is what it "
            "should be"
        )


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
    n_nameless = sum(not name for name in names)
    for i, name in enumerate(names):
        if not name and not may_lack:
            raise RecordingError(f"{place}: expected a name for marker {i + 1}, found none")
        if not name.isprintable():
            raise RecordingError(
                f"{place}: expected a name of letters and digits for marker {i + 1}, found {name!r}"
            )
    distinct = [name or f"unnamed {i + 1}" for i, name in enumerate(names)]
    remarks = []
    if n_nameless:
        remarks.append(
            f"{place}: {n_nameless} of {len(names)} markers have no name, called 'unnamed <number>'"
        )
    taken = set(distinct)
    for name in [name for name, times in Counter(distinct).items() if times > 1]:
        free = (f"{name} {k}" for k in count(1) if f"{name} {k}" not in taken)
        at = [i for i, other in enumerate(distinct) if other == name]
        for i in at:
            distinct[i] = next(free)
        told = ", ".join(f"'{distinct[i]}'" for i in at)
        remarks.append(
            f"{place}: expected each marker name once, found '{name}' twice or more; "
            f"they are called {told}"
        )
        taken.update(distinct)
    return tuple(distinct), tuple(remarks)
