"""Error of the estimated landing map by number of landings, for levels of noise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures.banded import banded_line, plain_numbers
from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
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

# Estimator: what the reader sees, colour, line style, marker. OLS on rigid-body coordinates is the
# printed one but for rounding, and is left out.
LINES: dict[str, tuple[str, str, Any, str]] = {
    "printed": ("least squares, as printed", GREY, "-", "o"),
    "corrected": ("corrected for noise", ORANGE, (0, (5, 1.5)), "s"),
    "curved": ("with curvature", BLUE, (0, (1.5, 1.2)), "^"),
    "corrected_curved": ("with both", VERMILION, "-", "D"),
}
STATES = {"split_fit": "states split at contacts", "savitzky_golay": "states by 7-frame cubic"}


@styled
def map_error_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors, a row of panels for each way of fitting states, a column for each noise.

    Parameters
    ----------
    table : DataFrame
        One row a setting: ``states`` (of `STATES`), ``noise_mm``, ``estimator`` (of `LINES`;
        others are left out), ``landings``, and over the draws ``median, q05, q95``.

    Returns
    -------
    Figure
        Logarithmic axes; bands from 5 to 95 %.
    """
    ways = [way for way in STATES if (table["states"] == way).any()]
    if not ways:
        return message_figure("No errors of maps to show.")
    noises = sorted(table["noise_mm"].unique())
    figure = paper_figure(DOUBLE_COLUMN_MM, 20.0 + 47.0 * len(ways))
    panels = figure.subplots(len(ways), len(noises), sharex=True, sharey=True, squeeze=False)
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    for row, way in zip(panels, ways, strict=True):
        for axes, noise in zip(row, noises, strict=True):
            _draw(axes, table[(table["states"] == way) & (table["noise_mm"] == noise)])
            letter(axes, next(letters))
        row[0].set_ylabel(f"relative error of the map\n{STATES[way]}")
    for axes, noise in zip(panels[0], noises, strict=True):
        axes.set_title(f"{noise:g} mm" if noise > 0 else "no noise")
    for axes in panels[-1]:
        axes.set_xlabel("landings")
    _ticks(panels[0, 0])
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw(axes: Axes, table: pd.DataFrame) -> None:
    for estimator, line in LINES.items():
        rows = table[table["estimator"] == estimator].sort_values("landings")
        if rows.empty:
            continue
        banded_line(axes, rows["landings"], rows["median"], (rows["q05"], rows["q95"]), line)
    axes.grid(axis="y")


def _ticks(axes: Axes) -> None:
    """Plain numbers on both logarithmic axes, which all panels share."""
    from matplotlib.ticker import FixedLocator, LogLocator

    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(FixedLocator([60, 250, 1000, 3000]))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis)
