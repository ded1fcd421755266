"""How close fitted maps come to the exact ones, and the two side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    INK,
    VERMILION,
    letter,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

SOURCES = {"noise_free": (BLUE, "without noise"), "measured": (VERMILION, "as measured")}
MODELS: Mapping[str, tuple[str | tuple[float, tuple[float, ...]], str, str]] = {
    "pooled": ("-", "o", "one map"),
    "specialised": ((0, (4, 1.5)), "s", "one a schedule"),
}
SHORT = {
    "pitch_rad": "pitch",
    "roll_rad": "roll",
    "forward_m_s": "forward",
    "sideways_m_s": "sideways",
    "climb_m_s": "climb",
    "spin_x_rad_s": "spin x",
    "spin_y_rad_s": "spin y",
    "spin_z_rad_s": "spin z",
    "step_x_m": "step x",
    "step_y_m": "step y",
    "turn_rad": "turn",
}
DARK = 0.6  # share of the range above which ink is not read on a colour


@styled
def map_errors_figure(errors: pd.DataFrame, entries: pd.DataFrame) -> Figure:
    """Draw errors over the number of landings, and the exact and the fitted map.

    Parameters
    ----------
    errors, entries : DataFrame
        Tables ``map_errors`` and ``map_entries``, see `hopdata.maps.map_errors`.

    Returns
    -------
    Figure
        (a) Median and 5 to 95 % of the error of least squares; (b) the exact map and (c) that of
        all measured landings, as displacements for a standard deviation of each input.
    """
    figure = paper_figure(DOUBLE_COLUMN_MM, 82.0)
    first, second, third = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.0))
    for model in MODELS:
        for source in SOURCES:
            _draw(first, errors[(errors["source"] == source) & (errors["model"] == model)])
    _label(first)
    most = float(entries["value_mm"].abs().max())
    for axes, source, title in (
        (second, "exact", "exact"),
        (third, "measured", "fitted to all landings"),
    ):
        image = _draw_map(axes, entries[entries["source"] == source], most)
        axes.set_title(title)
    third.set_yticklabels([])
    figure.colorbar(image, ax=[second, third], location="bottom", shrink=0.7, aspect=40).set_label(
        "displacement of the markers for one sd of the input (mm)"
    )
    for axes, name in zip((first, second, third), "abc", strict=True):
        letter(axes, name)
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
    axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.02), fontsize=6, frameon=False)


def _draw_map(axes: Axes, rows: pd.DataFrame, most: float) -> AxesImage:
    outputs, inputs = (list(dict.fromkeys(rows[name])) for name in ("output", "input"))
    values = rows["value_mm"].to_numpy().reshape(len(outputs), len(inputs))
    image = axes.imshow(values, cmap="RdBu_r", vmin=-most, vmax=most, aspect="auto")
    axes.set_xticks(range(len(inputs)), [SHORT.get(name, name) for name in inputs], rotation=90)
    axes.set_yticks(range(len(outputs)), [SHORT.get(name, name) for name in outputs])
    axes.tick_params(length=0)
    axes.set_xlabel("input at the pre section")
    for place in np.argwhere(np.abs(values) >= 0.05 * most):
        row, column = (int(k) for k in place)
        value = float(values[row, column])
        colour = "white" if abs(value) > DARK * most else INK
        axes.text(column, row, f"{value:.2g}", ha="center", va="center", fontsize=5, color=colour)
    return image
