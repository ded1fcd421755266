"""Visibility of each marker, stability of the sections, and drift."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

# When each marker was seen, and what looks wrong, over the time of a recording.

# Heights of a bar's row, of the space between recordings, and of the legend.
ROW_MM = 4.2
BETWEEN_MM = 14.0
LEGEND_MM = 8.0
# Height of a bar, in rows.
BAR = 0.62
# Shorter gaps are drawn as long as this share of the duration, to be visible.
SHORTEST = 0.0015
SEEN = "#c4c4c4"
# Kind: marker, label.
SIGNS = {
    "swap": ("v", "swapped markers"),
    "spike": ("x", "spike"),
    "jump": (">", "jump"),
    "frozen": ("s", "frozen"),
    "filled": ("D", "filled"),
}


@style.styled
def recording_gaps_figure(
    markers: pd.DataFrame, gaps: pd.DataFrame, faults: pd.DataFrame
) -> Figure:
    """Draw a bar for each marker, grey where it was seen, with gaps and faults.

    Parameters
    ----------
    markers : DataFrame
        ``recording, marker, duration_s``: one row per bar, the first on top.
    gaps : DataFrame
        ``recording, marker, start_s, stop_s``, from the first frame of the recording.
    faults : DataFrame
        ``recording, marker`` (empty for all), ``kind`` (a key of `SIGNS`, or
        ``"dropped"``; others are ignored), ``start_s``.
    """
    rows = markers["recording"].value_counts(sort=False)
    if rows.empty or not markers["duration_s"].min() > 0:
        return style.message_figure("No marker, or no time, to show.")
    height = LEGEND_MM + BETWEEN_MM * len(rows) + ROW_MM * len(markers)
    figure = style.paper_figure(style.WIDEST_PANEL_MM, height)
    grid = figure.subplots(len(rows), 1, squeeze=False, height_ratios=list(rows))[:, 0]
    signs = {}
    for axes, recording in zip(grid, rows.index, strict=True):
        own_markers = markers[markers["recording"] == recording]
        own_gaps = gaps[gaps["recording"] == recording]
        own_faults = faults[faults["recording"] == recording]
        names = list(own_markers["marker"])
        duration_s = float(own_markers["duration_s"].max())
        for row, marker in enumerate(names):
            of_marker = own_gaps[own_gaps["marker"] == marker]
            _draw_gaps(axes, row, of_marker, duration_s)
        _draw_faults(axes, own_faults, names)
        style.name_rows(axes, [style.label_of(marker) for marker in names])
        axes.set_xlim(0.0, duration_s)
        axes.spines["left"].set_visible(False)
        axes.set_title(str(recording), loc="left")
        handles, labels = axes.get_legend_handles_labels()
        signs.update(dict(zip(labels, handles, strict=True)))
    grid[-1].set_xlabel("time after the first frame (s)")
    figure.legend(signs.values(), signs.keys(), loc="outside upper right", ncols=6)
    return figure


def _draw_gaps(axes: Axes, row: int, gaps: pd.DataFrame, duration_s: float) -> None:
    """Draw the bar of one marker, and its gaps on top."""
    label = "seen" if row == 0 else None
    axes.barh(
        row,
        duration_s,
        height=BAR,
        color=SEEN,
        linewidth=0,
        label=label,
    )
    shortest_s = SHORTEST * duration_s
    stretches = []
    for start, stop in zip(gaps["start_s"], gaps["stop_s"], strict=True):
        stretches.append((start, max(stop - start, shortest_s)))
    axes.broken_barh(stretches, (row - BAR / 2, BAR), facecolors="white", linewidth=0)


def _draw_faults(axes: Axes, faults: pd.DataFrame, markers: Sequence[str]) -> None:
    """Draw a symbol for each fault in its marker's row; lines for dropped frames."""
    row_of = {name: row for row, name in enumerate(markers)}
    for kind, (sign, meaning) in SIGNS.items():
        found = faults[faults["kind"] == kind]
        if found.empty:
            continue
        rows = [row_of[name] for name in found["marker"]]
        (line,) = axes.plot(
            found["start_s"], rows, sign, color=style.INK, label=meaning
        )
        line.set(markersize=3.5, markeredgewidth=0.9, zorder=3, clip_on=False)
    for i, time in enumerate(faults.loc[faults["kind"] == "dropped", "start_s"]):
        label = "frames dropped" if i == 0 else ""
        axes.axvline(time, color=style.GREY, linewidth=0.7, linestyle=":", label=label)


# Stability of the sections, and drift between parts of a study.

SECTIONS = (
    ("pre_height_m", "pre section", "white", "o"),
    ("post_height_m", "post section", style.INK, "D"),
)
MARKS = "osD^vPX<>"
# Insides of the marks of the parts, from the first on.
PART_SHADES = ("white", "#c4c4c4", "#7a7a7a", style.INK)
MOST_IN_LEGEND = 6
# Characters of a part's name up to which two stand beside each other.
SHORT_NAME = 14
NOTHING = "Nothing to compare the sections with."


@style.styled
def stability_figure(stability: pd.DataFrame, drift: pd.DataFrame) -> Figure:
    """Draw the sections for other bandwidths and parts, and the drift between parts.

    Parameters
    ----------
    stability : DataFrame
        ``kind, variant, pre_height_m, post_height_m``; the first row is the chosen one.
    drift : DataFrame
        ``quantity, part, deviation, se, spread``.

    Returns
    -------
    Figure
        (a) Change of both sections, mm, one row per variant. (b) Median of each part
        relative to the typical one, in spreads between touchdowns, with bars of two
        standard errors.
    """
    rows = max(len(stability) - 1, 2 * drift["quantity"].nunique(), 6)
    if len(stability) < 2 and drift.empty:
        return style.message_figure(NOTHING, width_mm=style.WIDEST_PANEL_MM)
    parts: list[tuple[Any, pd.DataFrame]] = []
    if len(stability) > 1:
        parts.append((_draw_sections, stability))
    if len(drift):
        parts.append((_draw_drift, drift))
    width_mm = style.WIDEST_PANEL_MM
    if len(parts) > 1:
        width_mm = style.DOUBLE_COLUMN_MM
    figure = style.paper_figure(width_mm, 26.0 + 5.5 * rows)
    panels = figure.subplots(1, len(parts), squeeze=False)[0]
    for axes, (draw, table) in zip(panels, parts, strict=True):
        draw(axes, table)
    style.letters(panels)
    for axes in panels:
        axes.axvline(0.0, color=style.GREY, linewidth=0.8, zorder=1)
        axes.locator_params(axis="x", nbins=5)
    return figure


def _draw_sections(axes: Axes, stability: pd.DataFrame) -> None:
    chosen = stability.iloc[0]
    others = stability.iloc[1:]
    place = np.arange(len(others))
    for column, label, inside, mark in SECTIONS:
        moved = 1e3 * (others[column].to_numpy(float) - float(chosen[column]))
        axes.plot(
            moved,
            place,
            linestyle="",
            marker=mark,
            color=style.INK,
            markerfacecolor=inside,
            label=label,
            markersize=4,
        )
    for row in np.flatnonzero(others["pre_height_m"].isna()):
        style.lacking(axes, 0.0, float(row), "none")
    style.name_rows(axes, list(others["variant"]))
    reach = 1.08 * max(map(abs, axes.get_xlim()))
    axes.set(xlim=(-reach, reach), xlabel="change of the section (mm)")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_drift(axes: Axes, drift: pd.DataFrame) -> None:
    quantities = list(dict.fromkeys(drift["quantity"]))
    parts = list(dict.fromkeys(drift["part"]))
    step = 0.7 / max(len(parts), 1)
    for number, part in enumerate(parts):
        own = drift[drift["part"] == part]
        beside = step * (number - (len(parts) - 1) / 2)
        place = [quantities.index(q) + beside for q in own["quantity"]]
        spread = own["spread"].to_numpy(float)
        # Two standard errors; none where there is no spread to compare with.
        error = 2.0 * own["se"].to_numpy(float) / np.where(spread > 0, spread, np.inf)
        axes.errorbar(
            own["deviation"],
            place,
            xerr=error,
            linestyle="",
            capsize=0,
            markersize=3.5,
            marker=MARKS[number % len(MARKS)],
            color=style.INK,
            markerfacecolor=PART_SHADES[number % len(PART_SHADES)],
            label=part,
        )
    style.name_rows(axes, [_broken(quantity) for quantity in quantities])
    reach = max(1.0, *map(abs, axes.get_xlim()))
    told = "median of each part minus that of all\n(in spreads between touchdowns)"
    axes.set(xlim=(-reach, reach), xlabel=told)
    if 0 < len(parts) <= MOST_IN_LEGEND:
        columns = 1
        if max(map(len, parts)) <= SHORT_NAME:
            columns = min(len(parts), 2)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns)


def _broken(label: str) -> str:
    """Break a long label near its middle."""
    near_half = (len(label) + 1) // 2 + 4
    return "\n".join(wrap(label, max(12, near_half)))
