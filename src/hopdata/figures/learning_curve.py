"""Error of predicted frame changes by the number of hops learned from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures.banded import banded_line, plain_numbers
from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
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

# Model: what the reader sees, colour, line style, marker.
LINES: dict[str, tuple[str, str, Any, str]] = {
    "printed": ("as printed", GREY, "-", "o"),
    "recommended": ("periodic, standardised", BLUE, "-", "s"),
    "previous swing": ("and previous swing", GREEN, (0, (5, 1.5)), "^"),
    "previous change": ("and previous frame change", VERMILION, (0, (1.5, 1.2)), "D"),
}
PANELS = {"dx": "forward (mm)", "dy": "sideways (mm)", "dtheta": "turn (degrees)"}


@styled
def learning_curve_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of three components, a panel each.

    Parameters
    ----------
    table : DataFrame
        One row a setting: ``model`` (of `LINES`; others are left out), ``component`` (of
        `PANELS`), ``hops``, and over random sets of hops ``rmse, rmse_q05, rmse_q95``.

    Returns
    -------
    Figure
        Logarithmic numbers of hops; means, and bands from 5 to 95 % of the sets.
    """
    if not table["model"].isin(LINES).any():
        return message_figure("No learning curve to show.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 62.0)
    panels = figure.subplots(1, len(PANELS))
    for axes, (component, label) in zip(panels, PANELS.items(), strict=True):
        _draw(axes, table[table["component"] == component])
        axes.set_title(label)
        _hops_axis(axes, sorted(table["hops"].unique()))
    panels[0].set_ylabel("rms error of a hop")
    for axes, name in zip(panels, "abc", strict=True):
        letter(axes, name)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw(axes: Axes, table: pd.DataFrame) -> None:
    for model, line in LINES.items():
        rows = table[table["model"] == model].sort_values("hops")
        if rows.empty:
            continue
        band = (rows["rmse_q05"], rows["rmse_q95"])
        banded_line(axes, rows["hops"], rows["rmse"], band, line)
    axes.grid(axis="y")


def _hops_axis(axes: Axes, hops: list[int]) -> None:
    from matplotlib.ticker import FixedLocator

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(hops))
    plain_numbers(axes.xaxis)
    axes.set_xlabel("hops learned from")
