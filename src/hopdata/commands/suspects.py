"""Faults of an inspection, one line each, in the order of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hopdata.commands.words import counted

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection

MM_PER_M = 1000.0


@dataclass(frozen=True)
class Suspect:
    """One thing that looks wrong.

    Parameters
    ----------
    kind : str
        ``swap``, ``spike``, ``jump``, ``frozen``, ``unseen``, ``dropped``, ``rate`` or ``time``.
    markers : tuple of str
        Those concerned; none for the time stamps.
    frame : int
        First frame, from 1 as in the file.
    time_s : float
        Time after the first frame, s.
    text : str
        What was found.
    """

    kind: str
    markers: tuple[str, ...]
    frame: int
    time_s: float
    text: str


def suspects(inspection: Inspection) -> list[Suspect]:
    """List all faults, the earliest first."""
    return sorted(_all(inspection), key=lambda s: (s.frame, s.kind, s.markers))


def _all(inspection: Inspection) -> Iterator[Suspect]:
    faults, timing = inspection.faults, inspection.timing

    def suspect(kind: str, markers: tuple[str, ...], frame: int, text: str) -> Suspect:
        time = float(inspection.time[frame] - inspection.time[0])
        return Suspect(kind, markers, frame + 1, time, text)

    for swap in faults.swaps:
        names = " and ".join(swap.markers) if len(swap.markers) == 2 else ", ".join(swap.markers)
        until = "to the end" if swap.stop is None else f"to frame {swap.stop}"
        text = f"{names} exchanged {until} (by {' and '.join(swap.found_by)})"
        yield suspect("swap", swap.markers, swap.start, text)
    for spike in faults.spikes:
        length = counted(spike.stop - spike.start, "frame")
        text = f"{spike.marker} is {_mm(spike.size)} off for {length}"
        yield suspect("spike", (spike.marker,), spike.start, text)
    for jump in faults.jumps:
        text = f"{jump.marker} jumps by {_mm(jump.size)}"
        yield suspect("jump", (jump.marker,), jump.frame, text)
    for frozen in faults.frozen:
        text = f"{frozen.marker} repeats one position in {frozen.stop - frozen.start} frames"
        yield suspect("frozen", (frozen.marker,), frozen.start, text)
    for name in faults.never_seen:
        yield suspect("unseen", (name,), 0, f"{name} is in no frame")
    if inspection.has_wrong_rate:
        found, stated = timing.rate_hz, inspection.rate_hz
        text = f"the time stamps run at {found:g} Hz, and the frame rate stated is {stated:g} Hz"
        yield suspect("rate", (), 0, text)
    for frame, missing in timing.drops.tolist():
        text = f"{counted(missing, 'frame')} dropped after this one"
        yield suspect("dropped", (), int(frame), text)
    for frame in timing.irregular:
        yield suspect("time", (), int(frame), "irregular step of the time stamps after this one")
    for frame in timing.backward:
        yield suspect("time", (), int(frame), "the next time stamp is not later")


def _mm(metres: float) -> str:
    return f"{metres * MM_PER_M:.1f} mm"
