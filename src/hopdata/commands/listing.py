"""An inspection as text for a terminal."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from hopdata.commands.suspects import suspects
from hopdata.commands.words import counted

if TYPE_CHECKING:
    from hopdata.recordings.quality.gaps import MarkerGaps
    from hopdata.recordings.quality.inspection import Inspection

WIDTH, COLUMNS, MOST_SUSPECTS = 100, 50, 20
SEEN, PARTLY, UNSEEN = "█", "▒", "·"
PLAIN = {SEEN: "#", PARTLY: "+", UNSEEN: "."}
MM_PER_M = 1000.0


def listing(inspection: Inspection, file: str, *, encoding: str = "utf-8") -> str:
    """Say what is in a recording.

    Parameters
    ----------
    inspection : Inspection
        What was measured.
    file : str
        The file, for the first line.
    encoding : str
        Of the terminal; the picture is drawn in ASCII where it needs to be.
    """
    lines = [file, *_facts(inspection), "", *_rigid(inspection), "", *_gaps(inspection), ""]
    text = "\n".join([*lines, *_suspects(inspection)])
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        for drawn, plain in PLAIN.items():
            text = text.replace(drawn, plain)
        text = text.encode("ascii", errors="replace").decode("ascii")
    return text


def answer(inspection: Inspection) -> str:
    """Say in one sentence whether there is anything wrong."""
    n = inspection.n_problems
    if not n:
        return "No swapped or frozen markers, spikes, jumps, dropped frames or irregular stamps."
    kinds: dict[str, int] = {}
    for suspect in suspects(inspection):
        kinds[suspect.kind] = kinds.get(suspect.kind, 0) + 1
    parts = ", ".join(f"{count} {_plural(kind, count)}" for kind, count in kinds.items())
    return f"{counted(n, 'suspect')}: {parts}."


def _plural(kind: str, count: int) -> str:
    words = {
        "frozen": ("frozen marker", "frozen markers"),
        "unseen": ("marker never seen", "markers never seen"),
        "dropped": ("place with dropped frames", "places with dropped frames"),
        "rate": ("wrong frame rate", "wrong frame rates"),
        "time": ("irregular time stamp", "irregular time stamps"),
    }
    return words.get(kind, (kind, f"{kind}s"))[count > 1]


def _facts(inspection: Inspection) -> list[str]:
    timing = inspection.timing
    stamps = f"time stamps regular to {1e3 * timing.jitter_s:.3f} ms"
    if timing.n_dropped:
        stamps = f"{timing.n_dropped} frames dropped"
    rate = f"{len(inspection.time)} at {inspection.rate_hz:g} Hz, {inspection.duration_s:.1f} s"
    unit, up = inspection.unit, inspection.up
    names = ", ".join(inspection.markers)
    return [
        _line("frames", f"{rate}; {stamps}"),
        *_wrapped("markers", f"{len(inspection.markers)}: {names}"),
        *_wrapped("unit", f"{unit.value}: {unit.reason}" + _unsure(unit.is_sure)),
        *_wrapped("up", f"{up.value}: {up.reason}" + _unsure(up.is_sure)),
    ]


def _unsure(is_sure: bool) -> str:
    return "" if is_sure else " (not sure)"


def _rigid(inspection: Inspection) -> list[str]:
    white = MM_PER_M * inspection.typical_noise_m
    noise = f"{white:.2f} mm a coordinate from frame to frame (median of the markers)"
    lines = _wrapped("noise", noise if np.isfinite(white) else "no five frames in a row")
    for cluster in inspection.clusters:
        names = ", ".join(inspection.markers[m] for m in cluster.markers)
        noise = f"{MM_PER_M * cluster.noise:.2f} mm a coordinate by its distances"
        lines += _wrapped("rigid", f"{names}; {noise}")
    if not inspection.clusters:
        lines += _wrapped("rigid", "no three markers that keep their distances")
    return lines


def _gaps(inspection: Inspection) -> list[str]:
    """One bar a marker, and its gaps in numbers."""
    width = max(map(len, inspection.markers), default=0)
    n_columns = max(1, min(COLUMNS, len(inspection.time)))
    column = inspection.duration_s / n_columns
    head = f"  gaps (a column is {column:.3g} s; {SEEN} seen, {PARTLY} partly, {UNSEEN} unseen)"
    lines = [head]
    for gaps in inspection.gaps:
        numbers = "no gap"
        if gaps.count:
            longest = (
                f"{counted(gaps.longest, 'frame')} ({gaps.longest / inspection.rate_hz:.3g} s)"
            )
            share = f"{100 * gaps.share:.2g} % unseen"
            numbers = f"{counted(gaps.count, 'gap')}, longest {longest}, {share}"
        lines.append(f"  {gaps.marker:{width}} {_bar(gaps, n_columns)} {numbers}")
    return lines


def _bar(gaps: MarkerGaps, n_columns: int) -> str:
    """Draw one bar; a column is partly seen if a single frame in it is missing."""
    unseen = np.zeros(gaps.n_frames, dtype=bool)
    for start, stop in gaps.stretches:
        unseen[start:stop] = True
    columns = np.array_split(unseen, n_columns)
    return "".join(UNSEEN if c.all() else PARTLY if c.any() else SEEN for c in columns)


def _suspects(inspection: Inspection) -> list[str]:
    found = suspects(inspection)
    lines = [f"  {answer(inspection)}"]
    for suspect in found[:MOST_SUSPECTS]:
        where = f"frame {suspect.frame} ({suspect.time_s:.3f} s)"
        lines.append(f"    {suspect.kind:8} {where:24} {suspect.text}")
    if len(found) > MOST_SUSPECTS:
        lines.append(f"    and {len(found) - MOST_SUSPECTS} more; --html lists all")
    return lines


def _line(key: str, text: str) -> str:
    return f"  {key:8} {text}"


def _wrapped(key: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=f"  {key:8} ", subsequent_indent=" " * 11)
