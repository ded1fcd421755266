"""Figure 4.2: how the error of the final state falls with the step, for each method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour and marker of each method in turn. Curves may lie on one another, so markers are hollow,
# of different shapes, and the earlier ones larger.
LOOKS: tuple[tuple[str, str], ...] = (
    (BLUE, "o"),
    (ORANGE, "s"),
    (VERMILION, "x"),
    (SKY, "+"),
    (GREY, "*"),
    (INK, "^"),
    (GREEN, "D"),
    (PURPLE, "v"),
)
LARGEST, SMALLEST = 6.5, 2.6  # points
MOST_MARKERS = 24
LIGHT_GREY = "#d4d4d4"  # opaque, so that intervals on one another look like one


@styled
def order_figure(errors: pd.DataFrame) -> Figure:
    """Draw Fig. 4.2: error against the inverse of the longest step, on logarithmic axes.

    Parameters
    ----------
    errors : DataFrame
        One row a method and step: ``method``, ``max_step``, ``error_rms``, ``in_fit`` (whether the
        order was fitted to it), ``fitted_order`` and ``fitted_error`` (the line's error there).
        A method whose order is NaN has no line.

    Returns
    -------
    Figure
        A curve a method, the line fitted to it dashed, and the steps it was fitted to on grey.
    """
    if not (errors["error_rms"] > 0).any():
        return message_figure("No errors: no method was measured.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 95.0)
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    names = list(dict.fromkeys(errors["method"]))
    for place, name in enumerate(names):
        rows = errors[errors["method"] == name].sort_values("max_step")
        _draw_method(axes, rows, place, len(names))
    _label(axes, errors)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")
    return figure


def _draw_method(axes: Axes, rows: pd.DataFrame, place: int, count: int) -> None:
    colour, marker = LOOKS[place % len(LOOKS)]
    size = LARGEST - (LARGEST - SMALLEST) * place / max(count - 1, 1)
    inverse = 1.0 / rows["max_step"].to_numpy()
    used, order = rows["in_fit"].to_numpy(dtype=bool), float(rows["fitted_order"].iloc[0])
    if np.isfinite(order):
        _draw_fit(axes, inverse, rows["fitted_error"].to_numpy(), used, colour)
    axes.plot(
        inverse, rows["error_rms"], color=colour, linestyle=":", linewidth=0.8, marker=marker,
        markersize=size, markerfacecolor="none", markeredgewidth=0.8, label=_name(rows, order),
        markevery=max(1, len(rows) // MOST_MARKERS), zorder=3 + place,
    )  # fmt: skip


def _draw_fit(
    axes: Axes, inverse: np.ndarray, line: np.ndarray, used: np.ndarray, colour: str
) -> None:
    axes.plot(inverse, line, color=colour, linestyle="--", linewidth=0.7, label="_fit", zorder=2)
    wide: dict[str, Any] = {"linewidth": 9, "solid_capstyle": "butt"}
    axes.plot(inverse[used], line[used], color=LIGHT_GREY, label="_interval", zorder=1, **wide)


def _name(rows: pd.DataFrame, order: float) -> str:
    fitted = f"order {order:.2f}" if np.isfinite(order) else "no straight part"
    return f"{rows['method'].iloc[0]}\n{fitted}"


def _label(axes: Axes, errors: pd.DataFrame) -> None:
    shown = errors.loc[errors["error_rms"] > 0, "error_rms"]
    axes.set_ylim(shown.min() / 3, shown.max() * 5)
    axes.set_xlabel("1/ε, inverse of the longest step (dimensionless)")
    axes.set_ylabel("RMS error of the final state (dimensionless)")
    axes.grid(visible=True, which="major")
    axes.minorticks_off()
