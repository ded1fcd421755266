"""How close fitted maps come to the exact ones, by the number of landings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hopdata.figures.style import (
    BLUE,
    SINGLE_COLUMN_MM,
    VERMILION,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SOURCES = {"noise_free": (BLUE, "without noise"), "measured": (VERMILION, "as measured")}
MODELS: Mapping[str, tuple[str | tuple[float, tuple[float, ...]], str, str]] = {
    "pooled": ("-", "o", "one map"),
    "specialised": ((0, (4, 1.5)), "s", "one a schedule"),
}


@styled
def map_errors_figure(errors: pd.DataFrame) -> Figure:
    """Draw errors of fitted maps over the number of landings.

    Parameters
    ----------
    errors : DataFrame
        Table ``map_errors``, see `hopdata.maps.truth.map_errors`.

    Returns
    -------
    Figure
        Median and 5 to 95 % of the error of least squares.
    """
    figure = paper_figure(SINGLE_COLUMN_MM, 70.0)
    axes = figure.subplots()
    for model in MODELS:
        for source in SOURCES:
            _draw(axes, errors[(errors["source"] == source) & (errors["model"] == model)])
    _label(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame) -> None:
    if rows.empty:
        return
    (colour, data), (dash, marker, which) = (
        SOURCES[rows["source"].iloc[0]],
        MODELS[rows["model"].iloc[0]],
    )
    ordered = rows.sort_values("landings")
    n = ordered["landings"].to_numpy()
    axes.fill_between(n, ordered["q05"], ordered["q95"], color=colour, alpha=0.15, linewidth=0)
    axes.loglog(
        n, ordered["median"], color=colour, linestyle=dash, marker=marker, markersize=3,
        label=f"{which}, {data}",
    )  # fmt: skip


def _label(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xlabel("landings that a map is fitted to")
    axes.set_ylabel("error relative to the exact map")
    for axis, steps in ((axes.yaxis, (1.0, 2.0, 5.0)), (axes.xaxis, (1.0, 3.0))):
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", which="major")
