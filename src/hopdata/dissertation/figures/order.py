"""Figure 4.2, error over the inverse step; and the errors that Theorem 4.2.1 bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures import style

PRINTED_SLOPE = 4.2
THIRD_ORDER = 4.0
# Label, colour and dash of each method beside the printed one.
OTHERS: dict[str, tuple[str, str, Any]] = {
    "corrected": ("slopes refreshed", style.PRINTED, "-"),
    "dopri5": ("hopdata, DOPRI5", style.OURS, (0, (5, 1.5))),
    "dop853": ("hopdata, DOP853", style.SHADE, (0, (1.5, 1.2))),
}
MESH_LOOKS = {
    "exact": ("exact mesh", style.PALE, "s"),
    "dopri5": ("DOPRI5 mesh", style.OURS, "o"),
    "heun3": ("Heun's third-order mesh", style.SHADE, "^"),
}
BAND = "#D9D9D9"


@style.styled
def order_figure(errors: pd.DataFrame, slopes: pd.DataFrame) -> Figure:
    """Draw Figure 4.2, and the slope of its curve over each decade of steps.

    Parameters
    ----------
    errors : DataFrame
        One row per method and step: ``method`` ("printed" and others), ``step``,
        ``error``, ``in_fit``, ``fitted`` (the line's error), ``slope``, ``slope_se``.
    slopes : DataFrame
        One row per decade of the printed method: ``step`` (its middle), ``slope``,
        ``low`` and ``high``.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 82.0)
    left, right = figure.subplots(1, 2)
    _draw_errors(left, errors)
    _draw_slopes(right, slopes, errors)
    for axes in (left, right):
        axes.set_xlabel("1/ε, inverse of the step (dimensionless)")
    style.letters((left, right))
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside upper center", ncols=4
    )
    return figure


def _draw_errors(axes: Axes, errors: pd.DataFrame) -> None:
    printed = errors[errors["method"] == "printed"]
    inverse = 1.0 / printed["step"]
    used = printed["in_fit"].astype(bool)
    axes.set(xscale="log", yscale="log")
    axes.set_ylabel("RMS error of the final state (dimensionless)")
    if used.any():
        axes.axvspan(
            inverse[used].min(),
            inverse[used].max(),
            color=BAND,
            linewidth=0,
            label="steps of the fit",
            zorder=0,
        )
        axes.plot(
            inverse,
            printed["fitted"],
            color=style.INK,
            linestyle="--",
            linewidth=0.9,
            label="fit, extended",
            zorder=3,
        )
    for name, (label, colour, dash) in OTHERS.items():
        rows = errors[errors["method"] == name]
        axes.plot(
            1.0 / rows["step"],
            rows["error"],
            color=colour,
            linestyle=dash,
            linewidth=0.9,
            label=label,
        )
    axes.plot(
        inverse,
        printed["error"],
        color=style.INK,
        linestyle=":",
        linewidth=1.4,
        marker="o",
        markersize=2.2,
        label="printed method",
        zorder=4,
    )
    shown = errors["error"]
    axes.set_ylim(max(shown.min() / 3.0, 1e-16), shown.max() * 10.0)
    if used.any():
        _tell_fit(axes, printed, used)


def _tell_fit(axes: Axes, printed: pd.DataFrame, used: pd.Series) -> None:
    """Say which slope was fitted, to which steps; and the printed one."""
    steps = printed["step"][used]
    slope = printed["slope"].iloc[0]
    error = printed["slope_se"].iloc[0]
    lines = (
        f"fit: slope {slope:.2f} ± {error:.2f}",
        f"{len(steps)} steps, {steps.max():.2g} to {steps.min():.2g}",
        f"dissertation: {PRINTED_SLOPE}",
    )
    text = "\n".join(lines)
    look: Any = {"va": "top", "ha": "right", "zorder": 6}
    axes.text(0.97, 0.97, text, transform=axes.transAxes, **look)


def _draw_slopes(axes: Axes, slopes: pd.DataFrame, errors: pd.DataFrame) -> None:
    inverse = 1.0 / slopes["step"]
    axes.set_xscale("log")
    axes.set_ylabel("slope over a decade of steps")
    axes.fill_between(inverse, slopes["low"], slopes["high"], color=BAND, linewidth=0)
    axes.plot(inverse, slopes["slope"], color=style.INK, marker="o", markersize=2.2)
    axes.axhline(THIRD_ORDER, color=style.GREY, linewidth=0.8)
    axes.axhline(
        PRINTED_SLOPE, color=style.SHADE, linewidth=0.9, linestyle=(0, (5, 1.5))
    )
    right = 1.15 * float(inverse.max())
    look: Any = {"ha": "left", "fontsize": 7}
    printed = (right, PRINTED_SLOPE)
    style.note(
        axes, "4.2: print", printed, (0, 3), va="bottom", color=style.SHADE, **look
    )
    third = (right, THIRD_ORDER)
    style.note(
        axes, "4: third order", third, (0, -3), va="top", color=style.GREY, **look
    )
    middle = int(np.argmin(np.abs(slopes["slope"].to_numpy() - 3.0)))
    pooled = (float(inverse.iloc[middle]), float(slopes["slope"].iloc[middle]))
    style.note(axes, "all sweeps together", pooled, (7, -7), va="top", **look)
    place = len(slopes) // 2
    single = (float(inverse.iloc[place]), float(slopes["high"].iloc[place]))
    style.note(
        axes, "nine of ten single sweeps", single, (0, 6), va="bottom", ha="center",
        color=style.SHADE,
    )  # fmt: skip
    limits = 1.0 / errors["step"]
    axes.set_xlim(limits.min() / 1.4, limits.max() * 2.0)


@style.styled
def theorem_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of localised events as shares of their proven bounds.

    Parameters
    ----------
    table : DataFrame
        One row per mesh, place of the event in its step, and step: ``mesh``, ``place``,
        ``dt``, and ``time_error``, ``time_bound``, ``state_error``, ``state_bound``.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 72.0)
    panels = figure.subplots(1, 2)
    titles = {"time": "|t′ − t*| of the event, s", "state": "|p(t′) − y(t*)|, largest"}
    for axes, (what, title) in zip(panels, titles.items(), strict=True):
        axes.set(xscale="log", yscale="log", xlabel="step δt, s", ylabel=title)
        for mesh, (label, colour, marker) in MESH_LOOKS.items():
            rows = table[table["mesh"] == mesh]
            worst = rows.groupby("dt")[[f"{what}_error", f"{what}_bound"]].max()
            axes.plot(
                worst.index,
                worst[f"{what}_error"],
                color=colour,
                marker=marker,
                markersize=4,
                markerfacecolor="none",
                linestyle="none",
                label=f"{label}: largest error",
            )
            axes.plot(
                worst.index,
                worst[f"{what}_bound"],
                color=colour,
                linewidth=0.8,
                label="proven bound",
            )
    style.lettered(figure, panels, ncols=3)
    return figure
