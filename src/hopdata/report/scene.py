"""Interactive parts of the page: markers in 3-D, and small plots of the feet."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import counted
from hopdata.feet import foot_places, with_foot_names
from hopdata.recording import Recording

# What is shown around a landing, and after its pre section if it has no post section.
BEFORE_S = 0.15
AFTER_S = 0.25
# Orders of contact of which a landing is shown.
MOST_ORDERS = 6
# Stretches of a recording, frames of each, and frames times markers of each.
STRETCHES = 5
MOST_FRAMES = 2000
MOST_PLACES = 40_000
# Frame rate shown.
FASTEST_HZ = 120.0
# Number of a position that is not known, and the steps in which positions are counted.
UNSEEN = -32768
FINEST_M = 1e-4
STEPS = 65_000

Row = Mapping[Any, Any]


def landings_scene(
    recordings: Sequence[Recording], touchdowns: pd.DataFrame | None
) -> str:
    """Return a typical landing of each common order as JSON; empty if there is none.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled: m, z up from the floor.
    touchdowns : DataFrame, optional
        The touchdown table of the study.
    """
    if touchdowns is None or not recordings:
        return ""
    by_name = {recording.name: recording for recording in recordings}
    used = touchdowns[~touchdowns["excluded"].astype(bool)]
    parts = []
    for order in used["schedule"].value_counts().index[:MOST_ORDERS]:
        same = used[used["schedule"] == order].sort_values("spread_s", kind="stable")
        row = same.iloc[len(same) // 2].to_dict()
        recording = by_name[str(row["recording"])]
        first, last = recording.time.searchsorted(_span(row, BEFORE_S, AFTER_S))
        landing = recording.part(slice(first, last))
        pre_s = float(row["t_pre_s"])
        contacts = []
        feet = recording.names("foot")
        for foot in feet:
            contacts.append(float(row[f"contact_{foot}_s"]) - pre_s)
        title = f"{with_foot_names(str(order), feet)}: {counted(len(same), 'landing')}"
        parts.append(_part(landing, title, pre_s, contacts))
    return _scene(parts, 0.1)


def recording_scene(recording: Recording) -> str:
    """Return a recording (m, z up); of a long one, stretches from beginning to end."""
    every = max(1, round(recording.rate_hz / FASTEST_HZ))
    thinned = recording.part(slice(None, None, every))
    n_frames = len(thinned.time)
    n_shown = min(MOST_FRAMES, MOST_PLACES // len(thinned.markers))
    n_stretches = min(STRETCHES, -(-n_frames // n_shown))  # rounded up
    starts = np.linspace(0, max(n_frames - n_shown, 0), n_stretches).astype(int)
    parts = []
    for start in starts:
        stretch = thinned.part(slice(start, start + n_shown))
        title = f"{stretch.time[0]:.1f} to {stretch.time[-1]:.1f} s"
        parts.append(_part(stretch, title, 0.0))
    return _scene(parts, 1.0)


def _scene(parts: list[dict[str, Any]], speed: float) -> str:
    """Return parts as JSON in which no text may close the script element it is in."""
    if not parts:
        return ""
    return json.dumps({"speed": speed, "parts": parts}).replace("<", "\\u003c")


def _part(
    recording: Recording, title: str, zero_s: float, contacts: Sequence[float] = ()
) -> dict[str, Any]:
    """Return one stretch, packed: times from zero, s, and positions in steps."""
    positions = recording.positions
    low = np.nanmin(positions, axis=(0, 1))
    high = np.nanmax(positions, axis=(0, 1))
    middle = (low + high) / 2
    step = max(FINEST_M, float((high - low).max()) / STEPS)
    steps = np.nan_to_num(np.round((positions - middle) / step), nan=UNSEEN)
    known_contacts = [round(at, 6) if np.isfinite(at) else None for at in contacts]
    return {
        "title": title,
        "markers": recording.markers,
        "roles": recording.roles,
        "looks": [*foot_places(recording.names("foot")).values()],
        "time": _packed(recording.time - zero_s, "<f4"),
        "places": _packed(steps, "<i2"),
        "middle": middle.tolist(),
        "step": step,
        "contacts": known_contacts,
    }


def _packed(values: FloatArray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


def _span(row: Row, before_s: float, after_s: float) -> tuple[float, float]:
    """Return the time span shown of a landing, s: around its two sections."""
    start = float(row["t_pre_s"])
    stop = float(row["t_post_s"])
    if not np.isfinite(stop):
        stop = start + after_s
    return start - before_s, stop + before_s


# A small plot of a landing, as SVG.

# Its size in pixels, and the points of a curve.
WIDTH = 150
HEIGHT = 34
POINTS = 24


def small_plot(recording: Recording | None, row: Row) -> str:
    """Return an SVG of the heights of the feet during a landing; empty if unknown.

    Parameters
    ----------
    recording : Recording, optional
        Levelled.
    row : mapping
        ``t_pre_s`` and ``t_post_s`` of the landing, s; ``contact_<foot>_s`` for feet
        that touched.
    """
    if recording is None or not np.isfinite(float(row["t_pre_s"])):
        return ""
    start, stop = _span(row, 0.05, 0.25)
    first, last = recording.time.searchsorted((start, stop))
    heights = recording.feet[first:last, :, 2]
    time = recording.time[first:last]
    if not np.isfinite(heights).any():
        return ""
    shown = np.unique(np.linspace(0, len(time) - 1, POINTS).astype(int))
    low = np.nanmin(heights)
    high = np.nanmax(heights)
    x = WIDTH * (time[shown] - start) / (stop - start)
    y = (HEIGHT - 2) * (1 - (heights[shown] - low) / max(high - low, 1e-6)) + 1
    feet = recording.names("foot")
    looks = foot_places(feet)
    lines = []
    for number, foot in enumerate(feet):
        points = []
        for a, b in zip(x, y[:, number], strict=True):
            if np.isfinite(b):
                points.append(f"{a:.0f} {b:.0f}")
        drawn = f'<path d="M{"L".join(points)}"/>'
        contact_s = float(row.get(f"contact_{foot}_s", np.nan))
        contact = WIDTH * (contact_s - start) / (stop - start)
        if np.isfinite(contact):
            drawn += f'<path d="M{contact:.0f} 0V{HEIGHT}" class="at"/>'
        lines.append(f'<g class="foot{looks[foot] % 6}">{drawn}</g>')
    told = escape(f"heights of {', '.join(feet)}, {1e3 * (high - low):.0f} mm")
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    label = f'class="small" role="img" aria-label="{told}"'
    return f"<svg {label} {size}>{''.join(lines)}</svg>"
