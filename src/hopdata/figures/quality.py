"""Visibility of each marker, stability of the sections, and drift."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

# When each marker was seen, and what looks wrong, over the time of a recording.

ROW_MM, BETWEEN_MM, LEGEND_MM = 4.2, 14.0, 8.0
BAR = 0.62
SHORTEST = 0.0015  # of the duration: shorter gaps are drawn this long to be visible
# Kind: colour, marker, label.
SIGNS = {
    "swap": (style.VERMILION, "v", "swapped markers"),
    "spike": (style.INK, "x", "spike"),
    "jump": (style.PURPLE, ">", "jump"),
    "frozen": (style.ORANGE, "s", "frozen"),
    "filled": (style.ORANGE, "D", "filled"),
}


@style.styled
def recording_gaps_figure(
    markers: pd.DataFrame, gaps: pd.DataFrame, faults: pd.DataFrame
) -> Figure:
    """Draw a bar for each marker of each recording, blue where seen, with gaps and faults.

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
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height)
    grid = figure.subplots(len(rows), 1, squeeze=False, height_ratios=list(rows))[:, 0]
    signs = {}
    for axes, recording in zip(grid, rows.index, strict=True):
        own, missing, wrong = (
            t[t["recording"] == recording] for t in (markers, gaps, faults)
        )
        names, duration_s = list(own["marker"]), float(own["duration_s"].max())
        for row, marker in enumerate(names):
            _draw_gaps(axes, row, missing[missing["marker"] == marker], duration_s)
        _draw_faults(axes, wrong, names)
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
        color=style.BLUE,
        alpha=0.55,
        linewidth=0,
        label=label,
    )
    stretches = [
        (start, max(stop - start, SHORTEST * duration_s))
        for start, stop in zip(gaps["start_s"], gaps["stop_s"], strict=True)
    ]
    axes.broken_barh(stretches, (row - BAR / 2, BAR), facecolors="white", linewidth=0)


def _draw_faults(axes: Axes, faults: pd.DataFrame, markers: Sequence[str]) -> None:
    """Draw a symbol for each fault in its marker's row, and lines across for dropped frames."""
    for kind, (colour, sign, meaning) in SIGNS.items():
        found = faults[faults["kind"] == kind]
        if len(found):
            rows = [list(markers).index(name) for name in found["marker"]]
            (line,) = axes.plot(
                found["start_s"], rows, sign, color=colour, label=meaning
            )
            line.set(markersize=3.5, markeredgewidth=0.9, zorder=3, clip_on=False)
    for i, time in enumerate(faults.loc[faults["kind"] == "dropped", "start_s"]):
        label = "frames dropped" if i == 0 else ""
        axes.axvline(time, color=style.GREY, linewidth=0.7, linestyle=":", label=label)


# Stability of the sections, and drift between parts of a study.

SECTIONS = (
    ("pre_height_m", "pre section", style.BLUE, "o"),
    ("post_height_m", "post section", style.VERMILION, "D"),
)
MARKS = "osD^vPX<>"
MOST_IN_LEGEND = 6


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
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 26.0 + 5.5 * rows)
    left, right = figure.subplots(1, 2)
    _draw_sections(left, stability)
    _draw_drift(right, drift)
    style.letters((left, right))
    for axes in (left, right):
        axes.axvline(0.0, color=style.GREY, linewidth=0.8, zorder=1)
        axes.locator_params(axis="x", nbins=5)
    return figure


def _draw_sections(axes: Axes, stability: pd.DataFrame) -> None:
    chosen, others = stability.iloc[0], stability.iloc[1:]
    place = np.arange(len(others))
    for column, label, colour, mark in SECTIONS:
        moved = 1e3 * (others[column].to_numpy(float) - float(chosen[column]))
        axes.plot(
            moved,
            place,
            linestyle="",
            marker=mark,
            color=colour,
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
        error = 2.0 * own["se"].to_numpy(float) / np.where(spread > 0, spread, np.inf)
        axes.errorbar(
            own["deviation"], place, xerr=error, linestyle="", capsize=0, markersize=3.5,
            marker=MARKS[number % len(MARKS)], color=style.foot_colour(number), label=part,
        )  # fmt: skip
    # Break long labels near the middle.
    style.name_rows(
        axes, ["\n".join(wrap(q, max(12, (len(q) + 1) // 2 + 4))) for q in quantities]
    )
    reach = max(1.0, *map(abs, axes.get_xlim()))
    told = "median of each part minus that of all\n(in spreads between touchdowns)"
    axes.set(xlim=(-reach, reach), xlabel=told)
    if 0 < len(parts) <= MOST_IN_LEGEND:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=min(len(parts), 2)
        )
