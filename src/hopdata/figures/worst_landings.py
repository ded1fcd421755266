"""Thumbnails of the landings that deserve a look."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    DOUBLE_COLUMN_MM,
    MM_PER_M,
    MS_PER_S,
    YELLOW,
    foot_colour,
    foot_dash,
    label_of,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS = 3
ROW_MM = 38.0
TITLE_WIDTH = 40


@styled
def worst_landings_figure(landings: pd.DataFrame, samples: pd.DataFrame) -> Figure:
    """Draw foot heights and contacts of each landing.

    Parameters
    ----------
    landings : DataFrame
        ``landing, why, recording, index, t_pre_s, t_post_s``, ``contact_<foot>_s`` and
        ``se_<foot>_s`` of each foot.
    samples : DataFrame
        ``landing, foot, time_s`` (from the pre section), ``height_m``.
    """
    if landings.empty:
        return message_figure("No landing to show.")
    rows = -(-len(landings) // ACROSS)
    figure = paper_figure(DOUBLE_COLUMN_MM, 12.0 + ROW_MM * rows)
    grid = figure.subplots(rows, ACROSS, squeeze=False)
    feet = list(dict.fromkeys(samples["foot"]))
    for axes, row in zip(grid.flat, landings.to_dict("records"), strict=False):
        own = samples[samples["landing"] == row["landing"]]
        _draw(axes, {str(key): value for key, value in row.items()}, own, feet)
    for axes in grid.flat[len(landings) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("foot height (mm)")
    last = [
        grid[min(rows - 1, (len(landings) - 1 - k) // ACROSS), k]
        for k in range(min(ACROSS, len(landings)))
    ]
    for axes in last:
        axes.set_xlabel("time after the pre section (ms)")
    figure.legend(
        *grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(feet)
    )
    return figure


def _draw(axes: Axes, row: Mapping[str, Any], samples: pd.DataFrame, feet: list[str]) -> None:
    for number, foot in enumerate(feet):
        own = samples[samples["foot"] == foot]
        colour = foot_colour(number)
        axes.plot(
            MS_PER_S * own["time_s"], MM_PER_M * own["height_m"], color=colour,
            linestyle=foot_dash(number), marker="o", markersize=1.6, linewidth=0.8,
            label=label_of(foot),
        )  # fmt: skip
        contact = MS_PER_S * (float(row[f"contact_{foot}_s"]) - float(row["t_pre_s"]))
        if np.isfinite(contact):
            axes.axvline(contact, color=colour, linestyle=foot_dash(number), linewidth=0.7)
    end = MS_PER_S * (float(row["t_post_s"]) - float(row["t_pre_s"]))
    if np.isfinite(end):
        axes.axvspan(0.0, end, color=YELLOW, alpha=0.25, linewidth=0, zorder=0)
    else:
        axes.axvline(0.0, color=YELLOW, linewidth=2.0, zorder=0)
    title = f"{row['recording']}, descent {int(row['index'])}: {row['why']}"
    axes.set_title(fill(title, TITLE_WIDTH), loc="left", fontsize=6)
