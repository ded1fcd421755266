"""The verdicts of a group, one below the other: a forest plot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from hopdata.figures import style
from hopdata.figures.verdict import ANSWERS, ASKED

ROW_MM, LONGEST = 4.2, 3.0


@style.styled
def group_figure(group: Mapping[str, Any]) -> Figure:
    """Draw the sizes of all members that have an answer, and that of the group.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    """
    rows = [row for row in group["members"] if not row["reason"]]
    if not rows:
        return style.message_figure(group["sentence"], width_mm=style.DOUBLE_COLUMN_MM)
    effect = group["effect"]
    whole = [{**effect, "name": "all", "conclusion": group["conclusion"]}] if effect else []
    figure = style.paper_figure(
        style.DOUBLE_COLUMN_MM, 18.0 + ROW_MM * (len(rows) + 1.5 * len(whole))
    )
    axes = figure.subplots()
    sizes = [row["estimate"] for row in rows] + [group["margin"]]
    ends = [_end(row) for row in (*rows, *whole)]
    top = min(max(ends), LONGEST * max(*sizes, sorted(ends)[len(ends) // 2]))
    for place, row in enumerate((*rows, *whole)):
        colour = ANSWERS[row["conclusion"]][1]
        y, is_whole = place + 0.5 * (place == len(rows)), place == len(rows)
        end = min(_end(row), top)
        axes.plot(
            [100 * row["low"], 100 * end], [y, y], color=colour, linewidth=4 - 2.5 * (not is_whole)
        )
        axes.plot(
            100 * row["estimate"],
            y,
            "D" if is_whole else "s",
            color=colour,
            markersize=5,
            clip_on=False,
        )
        if end < _end(row):
            axes.plot(100 * top, y, ">", color=colour, markersize=4, clip_on=False)
    axes.axvline(100 * group["margin"], color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    places = [*range(len(rows)), *([len(rows) + 0.5] if whole else [])]
    axes.set_yticks(places, [style.label_of(row["name"]) for row in (*rows, *whole)])
    axes.set_ylim(places[-1] + 0.8, -0.8)
    axes.set_xlim(0.0, 102.0 * top)
    axes.set_xlabel(ASKED)
    return figure


def _end(row: Mapping[str, Any]) -> float:
    return float(row["high" if row["conclusion"] == "different" else "upper_bound"])
