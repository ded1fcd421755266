"""How well kernels of four smoothnesses predict, by what is fitted and in which units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    letter,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Reading: what the reader sees, colour, line style, marker.
LINES: dict[str, tuple[str, str, Any, str]] = {
    "printed, all fixed": ("printed formula, nothing fitted", GREY, "-", "o"),
    "printed, length fitted": ("length fitted, mm", ORANGE, (0, (5, 1.5)), "v"),
    "printed, length and noise fitted, mm": (
        "length and noise fitted, mm", GREEN, (0, (3, 1, 1, 1)), "D",
    ),
    "printed, length and noise fitted, m": (
        "length and noise fitted, m", VERMILION, (0, (1.5, 1.2)), "^",
    ),
    "standardised, all fitted": ("standardised, all fitted", BLUE, "-", "s"),
}  # fmt: skip
ROWS = {"smooth truth": "analytic, smooth", "hopper": "hopper"}
COLUMNS = {"dx": "forward", "dy": "sideways", "dtheta": "turn"}
SMOOTHNESSES = {0.5: "1/2", 1.5: "3/2", 2.5: "5/2", np.inf: "∞"}
FLOOR = -0.15  # lower values are drawn here


@styled
def kernel_smoothness_figure(table: pd.DataFrame) -> Figure:
    """Draw the share of variance that is predicted, by smoothness.

    Parameters
    ----------
    table : DataFrame
        One row a setting: ``data`` (of `ROWS`), ``reading`` (of `LINES`), ``component`` (of
        `COLUMNS`), ``smoothness``, ``r2`` and its standard error ``r2_se``.

    Returns
    -------
    Figure
        Values below `FLOOR` are drawn there.
    """
    rows = [name for name in ROWS if (table["data"] == name).any()]
    if not rows:
        return message_figure("No kernels to compare.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 22.0 + 40.0 * len(rows))
    panels = figure.subplots(len(rows), len(COLUMNS), sharex=True, sharey=True, squeeze=False)
    for line, data in zip(panels, rows, strict=True):
        for axes, component in zip(line, COLUMNS, strict=True):
            chosen = (table["data"] == data) & (table["component"] == component)
            _draw(axes, table[chosen])
        line[0].set_ylabel(f"{ROWS[data]}\nR² of other hops")
    for axes, title in zip(panels[0], COLUMNS.values(), strict=True):
        axes.set_title(title)
    for axes in panels[-1]:
        axes.set_xlabel("smoothness ν of the kernel")
    panels[0, 0].set_xticks(range(len(SMOOTHNESSES)), list(SMOOTHNESSES.values()))
    panels[0, 0].set_yticks([0, 0.25, 0.5, 0.75, 1])
    for axes, name in zip(panels.ravel(), "abcdef", strict=False):
        letter(axes, name)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _draw(axes: Axes, table: pd.DataFrame) -> None:
    places = list(SMOOTHNESSES)
    for shift, (reading, (label, colour, dash, marker)) in enumerate(LINES.items()):
        rows = table[table["reading"] == reading].sort_values("smoothness")
        if rows.empty:
            continue
        x = np.array([places.index(value) for value in rows["smoothness"]]) + 0.05 * (shift - 2)
        axes.errorbar(
            x, rows["r2"].clip(lower=FLOOR), yerr=np.where(rows["r2"] > FLOOR, rows["r2_se"], 0),
            color=colour, linestyle=dash, marker=marker, markersize=3, elinewidth=0.6, label=label,
        )  # fmt: skip
    axes.set_ylim(FLOOR - 0.05, 1.05)
    axes.grid(axis="y")
