"""Interactive parts of the page: markers in 3-D, and small plots of the feet."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.recording import Recording

BEFORE_S, AFTER_S = 0.15, 0.25  # shown around a landing
MOST_ORDERS = 6
STRETCHES, MOST_FRAMES, MOST_PLACES = (
    5,
    2000,
    40_000,
)  # of a recording; frames times markers
FASTEST_HZ = 120.0
UNSEEN = -32768
FINEST_M = 1e-4
Row = Mapping[Any, Any]


def landings_scene(
    recordings: Sequence[Recording], touchdowns: pd.DataFrame | None
) -> str:
    """Return a typical landing of each of the most common orders as JSON; empty if there is none.

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
    used, parts = touchdowns[~touchdowns["excluded"].astype(bool)], []
    for order in used["schedule"].value_counts().index[:MOST_ORDERS]:
        same = used[used["schedule"] == order].sort_values("spread_s", kind="stable")
        row = same.iloc[len(same) // 2].to_dict()
        recording, zero = by_name[str(row["recording"])], float(row["t_pre_s"])
        near = slice(*recording.time.searchsorted(_span(row, BEFORE_S, AFTER_S)))
        contacts = [
            float(row[f"contact_{foot}_s"]) - zero for foot in recording.names("foot")
        ]
        title = f"feet {str(order).replace('>', ' → ')}, of {len(same)} landings"
        parts.append(_part(recording.part(near), title, zero, contacts))
    return _scene(parts, 0.1)


def recording_scene(recording: Recording) -> str:
    """Return a recording (m, z up); of a long one, stretches spread from beginning to end."""
    some = recording.part(
        slice(None, None, max(1, round(recording.rate_hz / FASTEST_HZ)))
    )
    frames, seen = len(some.time), min(MOST_FRAMES, MOST_PLACES // len(some.markers))
    number = min(STRETCHES, -(-frames // seen))
    starts = np.linspace(0, max(frames - seen, 0), number).astype(int)
    stretches = [some.part(slice(start, start + seen)) for start in starts]
    titles = [f"{part.time[0]:.1f} to {part.time[-1]:.1f} s" for part in stretches]
    return _scene(
        [
            _part(part, title, 0.0)
            for part, title in zip(stretches, titles, strict=True)
        ],
        1.0,
    )


def _scene(parts: list[dict[str, Any]], speed: float) -> str:
    # No text in it may close the script element it is in.
    return (
        json.dumps({"speed": speed, "parts": parts}).replace("<", "\\u003c")
        if parts
        else ""
    )


def _part(
    recording: Recording, title: str, zero_s: float, contacts: Sequence[float] = ()
) -> dict[str, Any]:
    """Return one stretch, packed: times from zero, s, and positions in steps from the middle."""
    places = recording.positions
    low, high = np.nanmin(places, axis=(0, 1)), np.nanmax(places, axis=(0, 1))
    middle, step = (low + high) / 2, max(FINEST_M, float((high - low).max()) / 65_000)
    return {
        "title": title,
        "markers": recording.markers,
        "roles": recording.roles,
        "time": _packed(recording.time - zero_s, "<f4"),
        "places": _packed(
            np.nan_to_num(np.round((places - middle) / step), nan=UNSEEN), "<i2"
        ),
        "middle": middle.tolist(),
        "step": step,
        "contacts": [round(at, 6) if np.isfinite(at) else None for at in contacts],
    }


def _packed(values: FloatArray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


def _span(row: Row, before_s: float, after_s: float) -> tuple[float, float]:
    """Return the time span shown of a landing, s: from its pre section to its post section."""
    start, stop = float(row["t_pre_s"]), float(row["t_post_s"])
    return start - before_s, (stop if np.isfinite(stop) else start + after_s) + before_s


# A small plot of a landing, as SVG.

WIDTH, HEIGHT, POINTS = 150, 34, 24


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
    near = slice(*recording.time.searchsorted((start, stop)))
    heights, time = recording.feet[near, :, 2], recording.time[near]
    if not np.isfinite(heights).any():
        return ""
    some = np.unique(np.linspace(0, len(time) - 1, POINTS).astype(int))
    low, high = np.nanmin(heights), np.nanmax(heights)
    x = WIDTH * (time[some] - start) / (stop - start)
    y = (HEIGHT - 2) * (1 - (heights[some] - low) / max(high - low, 1e-6)) + 1
    lines = []
    for number, foot in enumerate(recording.names("foot")):
        points = (
            f"{a:.0f} {b:.0f}" for a, b in zip(x, y[:, number], strict=True) if b == b
        )
        drawn = f'<path d="M{"L".join(points)}"/>'
        contact = (
            WIDTH
            * (float(row.get(f"contact_{foot}_s", np.nan)) - start)
            / (stop - start)
        )
        if np.isfinite(contact):
            drawn += f'<path d="M{contact:.0f} 0V{HEIGHT}" class="at"/>'
        lines.append(f'<g class="foot{number % 6}">{drawn}</g>')
    told = escape(
        f"heights of {', '.join(recording.names('foot'))}, {1e3 * (high - low):.0f} mm"
    )
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    return f'<svg class="small" role="img" aria-label="{told}" {size}>{"".join(lines)}</svg>'
