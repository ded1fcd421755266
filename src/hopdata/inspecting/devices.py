"""What a file holds beside markers, in lines: force plates, events, analog channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hopdata.errors import RecordingError, counted
from hopdata.messages import Message
from hopdata.recording import Event

if TYPE_CHECKING:
    from hopdata.landings.plate_contacts import Onsets
    from hopdata.recordings.force_plates import ForcePlate
    from hopdata.recordings.readers.c3d import Analogs

# Events, instants and channels that a line lists.
MOST_LISTED = 12


@dataclass(frozen=True)
class Devices:
    """What a file holds beside markers.

    Parameters
    ----------
    plates : tuple of (ForcePlate, Onsets)
        Force plates, and when each begins to bear load.
    events : tuple of Event
        Events marked in the file.
    analogs : Analogs, optional
        Analog channels, if there are any.
    refused : tuple of Message
        Why plates or channels cannot be used, and what had to be put right.
    """

    plates: tuple[tuple[ForcePlate, Onsets], ...] = ()
    events: tuple[Event, ...] = ()
    analogs: Analogs | None = None
    refused: tuple[Message, ...] = ()


def devices_of(
    path: Path,
    *,
    up: str,
    unit: str,
    rate_hz: float | None = None,
    events: Sequence[Event] = (),
) -> Devices:
    """Read what a file holds beside markers.

    Parameters
    ----------
    path : path
        A file of any format; only C3D files hold plates and channels that are read.
    up : str
        Axis of the file that points up.
    unit : {"m", "mm", ...}
        Unit of the file's positions; one that is not m or mm is taken from the file.
    rate_hz : float, optional
        Frame rate, Hz, if it is not that of the file.
    events : sequence of Event
        Events of the file, from its reader.
    """
    from hopdata.landings.plate_contacts import find_onsets
    from hopdata.recordings.force_plates import read_force_plates
    from hopdata.recordings.readers.c3d import has_channels, read_analogs

    kept = tuple(events)
    if path.suffix.lower() != ".c3d":
        return Devices(events=kept)
    analogs = None
    try:
        if has_channels(path):
            analogs = read_analogs(path)
        found = read_force_plates(path, vertical_axis=up, unit=unit, rate_hz=rate_hz)
    except RecordingError as error:
        why = Message("inspecting.devices_not_read", {"why": str(error)})
        return Devices(events=kept, analogs=analogs, refused=(why,))
    plates = []
    refused = list(found.refused)
    for plate in found.plates:
        plates.append((plate, find_onsets(plate.time, plate.force[:, 2])))
        refused += plate.remarks
    return Devices(tuple(plates), kept, analogs, tuple(refused))


def lines_of(devices: Devices) -> list[tuple[str, str]]:
    """Return a key and a text for each line of the listing of `inspect`."""
    lines = [("plate", plate_line(*one)) for one in devices.plates]
    lines += [("note", str(message)) for message in devices.refused]
    if devices.events:
        lines.append(("events", events_line(devices.events)))
    if devices.analogs is not None:
        lines.append(("analog", analog_line(devices.analogs)))
    return lines


def plate_line(plate: ForcePlate, onsets: Onsets) -> str:
    """Describe a plate: place, channels, rate, largest force and onsets."""
    along_x, along_y = plate.sides_m
    low = plate.corners.min(axis=0)
    high = plate.corners.max(axis=0)
    units = ", ".join(dict.fromkeys(unit or "no unit" for unit in plate.units))
    values = {
        "number": plate.number,
        "type": plate.type,
        "size": f"{along_x:.2f} x {along_y:.2f} m",
        "x": f"{low[0]:.2f} to {high[0]:.2f}",
        "y": f"{low[1]:.2f} to {high[1]:.2f}",
        "z": f"{plate.corners[:, 2].mean():.3f}",
        "channels": f"{plate.channels[0]} to {plate.channels[-1]} ({units})",
        "rate": f"{plate.rate_hz:g}",
        "most": f"{np.nanmax(plate.force[:, 2], initial=0.0):.0f}",
        "onsets": onsets_text(onsets),
    }
    return str(Message("inspecting.plate", values))


def onsets_text(onsets: Onsets) -> str:
    """Describe when a plate begins to bear load, or why this is not known."""
    if not len(onsets.instant):
        return str(Message("inspecting.no_onset"))
    shown = ", ".join(f"{instant:.3f}" for instant in onsets.instant[:MOST_LISTED])
    if len(onsets.instant) > MOST_LISTED:
        shown += ", ..."
    values = {
        "number": counted(len(onsets.instant), "onset"),
        "shown": shown,
        "error_ms": 1e3 * float(np.median(onsets.error_s)),
    }
    return str(Message("inspecting.onsets", values))


def events_line(events: Sequence[Event]) -> str:
    """List events: their labels, with the context in front, and times."""
    shown = [f"{event.label} {event.time_s:.3f} s" for event in events[:MOST_LISTED]]
    if len(events) > MOST_LISTED:
        shown.append(f"and {len(events) - MOST_LISTED} more")
    return f"{len(events)}: {', '.join(shown)}"


def analog_line(analogs: Analogs) -> str:
    """List analog channels with their units and rate."""
    named = []
    for name, unit in zip(analogs.names, analogs.units, strict=True):
        named.append(f"{name or 'unnamed'} ({unit})" if unit else name or "unnamed")
    shown = ", ".join(named[:MOST_LISTED])
    if len(named) > MOST_LISTED:
        shown += f", and {len(named) - MOST_LISTED} more"
    rate = ""
    if len(analogs.time) > 1:
        rate_hz = (len(analogs.time) - 1) / (analogs.time[-1] - analogs.time[0])
        rate = f" at {rate_hz:g} Hz"
    return f"{counted(len(named), 'channel')}{rate}: {shown}"
