"""Where each marker was seen, and what looks wrong there, over the time of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    label_of,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_MM, MARGIN_MM = 4.2, 20.0
BAR = 0.62
TIME = "time after the first frame (s)"
SHORTEST = 0.0015  # of the duration: a shorter stretch is drawn this long, or nobody would see it
# kind: colour, sign, what it means.
SIGNS = {
    "swap": (VERMILION, "v", "swapped markers"),
    "spike": (INK, "x", "spike"),
    "jump": (PURPLE, ">", "jump"),
    "frozen": (ORANGE, "s", "frozen"),
}


@styled
def gap_timeline_figure(
    gaps: pd.DataFrame, faults: pd.DataFrame, *, markers: Sequence[str], duration_s: float
) -> Figure:
    """Draw one bar a marker: seen in blue, gaps left white, faults as signs.

    Parameters
    ----------
    gaps : DataFrame
        ``marker``, ``start_s``, ``stop_s`` of each gap, from the first frame.
    faults : DataFrame
        ``marker`` (empty: of all), ``kind`` (a key of `SIGNS`, or ``"dropped"``), ``time_s``.
    markers : sequence of str
        All names, the first on top.
    duration_s : float
        Time from the first frame to the last, s.
    """
    if not len(markers) or not duration_s > 0:
        return message_figure("No marker, or no time, to show.")
    figure = paper_figure(DOUBLE_COLUMN_MM, MARGIN_MM + ROW_MM * len(markers))
    axes = figure.subplots()
    draw_timeline(axes, gaps, faults, markers=markers, duration_s=duration_s)
    axes.set_xlabel(TIME)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=6)
    return figure


def draw_timeline(
    axes: Axes,
    gaps: pd.DataFrame,
    faults: pd.DataFrame,
    *,
    markers: Sequence[str],
    duration_s: float,
) -> None:
    """Draw the bars of one recording; arguments as for `gap_timeline_figure`."""
    for row, marker in enumerate(markers):
        _draw_gaps(axes, row, gaps[gaps["marker"] == marker], duration_s)
    _draw_faults(axes, faults, markers)
    axes.set_yticks(range(len(markers)), [label_of(marker) for marker in markers])
    axes.set_ylim(len(markers) - 0.4, -0.6)
    axes.set_xlim(0.0, duration_s)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _draw_gaps(axes: Axes, row: int, gaps: pd.DataFrame, duration_s: float) -> None:
    """Draw the bar of one marker, and its gaps upon it."""
    label = "seen" if row == 0 else None
    axes.barh(row, duration_s, height=BAR, color=BLUE, alpha=0.55, linewidth=0, label=label)
    stretches = [
        (start, max(stop - start, SHORTEST * duration_s))
        for start, stop in zip(gaps["start_s"], gaps["stop_s"], strict=True)
    ]
    axes.broken_barh(stretches, (row - BAR / 2, BAR), facecolors="white", linewidth=0)


def _draw_faults(axes: Axes, faults: pd.DataFrame, markers: Sequence[str]) -> None:
    """Draw a sign for each fault in its marker's row, a line through all for dropped frames."""
    for kind, (colour, sign, meaning) in SIGNS.items():
        found = faults[faults["kind"] == kind]
        if len(found):
            rows = [list(markers).index(name) for name in found["marker"]]
            (line,) = axes.plot(found["time_s"], rows, sign, color=colour, label=meaning)
            line.set(markersize=3.5, markeredgewidth=0.9, zorder=3, clip_on=False)
    dropped = faults.loc[faults["kind"] == "dropped", "time_s"]
    for i, time in enumerate(dropped):
        axes.axvline(
            time, color=GREY, linewidth=0.7, linestyle=":", label="frames dropped" if i == 0 else ""
        )
