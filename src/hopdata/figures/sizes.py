"""The sizes of so many studies that no one can read them one by one: a histogram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style
from hopdata.figures.verdict import ANSWERS, ASKED, name_of, over_landings, wholes

# Heights of a histogram, and of what stands around all of them.
PANEL_MM = 42.0
AROUND_MM = 30.0
# Height of the line of all subjects, or of a condition.
LINE_MM = 4.0
# Conditions with a histogram of their own; more share one.
MOST_CONDITIONS = 5
BARS = 40
# Part of the sizes that the axis reaches; the last bar counts the larger ones.
REACHED = 0.99

Row = Mapping[str, Any]


@style.styled
def sizes_figure(group: Mapping[str, Any]) -> Figure:
    """Draw how many studies have which size and answer, and the size of the group.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    """
    rows = [row for row in group["members"] if not row["reason"]]
    if not rows:
        return style.message_figure(group["sentence"], width_mm=style.WIDEST_PANEL_MM)
    parts = _by_condition(rows)
    height_mm = PANEL_MM * len(parts) + AROUND_MM + LINE_MM * len(wholes(group))
    figure = style.paper_figure(style.WIDEST_PANEL_MM, height_mm)
    ratios = [PANEL_MM] * len(parts) + [5.0 + LINE_MM * max(1, len(wholes(group)))]
    panels = figure.subplots(
        len(ratios), sharex=True, squeeze=False, height_ratios=ratios
    )
    *histograms, last = panels[:, 0]
    edges = _edges(rows, group)
    for axes, (condition, some) in zip(histograms, parts.items(), strict=True):
        _draw_counts(axes, some, edges)
        if condition:
            axes.set_title(style.label_of(condition), loc="left")
    _draw_group(last, group, edges[-1])
    for axes in (*histograms, last):
        margin = 100 * group["margin"]
        axes.axvline(margin, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    last.set_xlim(0.0, edges[-1])
    last.set_xlabel(f"{ASKED} (% of the map)")
    return figure


def _by_condition(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the studies of each condition; all together if it has too many."""
    parts: dict[str, list[Row]] = {}
    for row in rows:
        parts.setdefault(row.get("condition") or "", []).append(row)
    if len(parts) > MOST_CONDITIONS:
        return {"": list(rows)}
    return parts


def _sizes(rows: Sequence[Row], conclusion: str = "") -> list[float]:
    """Return the sizes in per cent of the studies with this answer, or of all."""
    return [
        100 * over_landings(row)["estimate"]
        for row in rows
        if "jump_low" not in row and conclusion in ("", row["conclusion"])
    ]


def _edges(rows: Sequence[Row], group: Mapping[str, Any]) -> Any:
    """Return the edges of the bars in per cent."""
    ends = [1.2 * 100 * group["margin"]]
    sizes = _sizes(rows)
    if sizes:
        ends.append(float(np.quantile(sizes, REACHED)))
    return np.linspace(0.0, max(ends), BARS + 1)


def _draw_counts(axes: Axes, rows: Sequence[Row], edges: Any) -> None:
    below = np.zeros(BARS)
    for conclusion, (answer, colour) in ANSWERS.items():
        own = [row for row in rows if row["conclusion"] == conclusion]
        sizes = np.minimum(_sizes(own), edges[-1])
        counts, _ = np.histogram(sizes, edges)
        label = f"{answer} ({len(own):,})"
        width = edges[1] - edges[0]
        axes.bar(
            edges[:-1],
            counts,
            width,
            below,
            align="edge",
            color="white" if conclusion == "no difference" else colour,
            edgecolor=colour,
            linewidth=0.5,
            label=label,
        )
        below += counts
    jumps = sum("jump_low" in row for row in rows)
    title = ""
    if jumps:
        title = f"of these, {jumps:,} by a jump of the outcome"
    axes.legend(loc="upper right", title=title, frameon=False)
    axes.set_ylabel("studies")


def _draw_group(axes: Axes, group: Mapping[str, Any], top: float) -> None:
    rows = wholes(group)
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    names = [name_of(row) for row in rows]
    axes.set_yticks(range(len(rows)), names)
    for place, row in enumerate(rows):
        _, colour = ANSWERS[row["conclusion"]]
        end = row["upper_bound"]
        if row["conclusion"] == "different":
            end = row["high"]
        look: dict[str, Any] = {"color": colour, "clip_on": False}
        interval = [100 * row["low"], min(100 * end, top)]
        axes.plot(interval, [place, place], linewidth=4.0, **look)
        estimate = min(100 * row["estimate"], top)
        axes.plot(estimate, place, "D", markersize=5, **look)
