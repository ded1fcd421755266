"""Figure 4.1: one step with an event, and the spline that stands in for it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures import style

# Half the width of the enlarged part, in distances of root and instant.
ENLARGED = 6.0
SLOPE_LENGTH = 0.17  # of a drawn slope, as a share of the step


@style.styled
def step_figure(step: pd.DataFrame) -> Figure:
    """Draw the event function of one step: along the flow, locked, and its spline.

    Parameters
    ----------
    step : DataFrame
        One row per time: ``time``, ``true`` (h along the flow), ``locked`` (h with the
        locks held), ``spline`` (the Hermite cubic of h), ``instant`` (t*) and ``root``
        (t'), the last two the same in all rows.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 74.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    for axes in (left, right):
        _draw_curves(axes, step)
        axes.axhline(0.0, color=style.GREY, linewidth=0.7, zorder=0)
    _name_step(left, step)
    _enlarge(right, step)
    style.letters((left, right))
    handles = left.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3)
    return figure


def _draw_curves(axes: Axes, step: pd.DataFrame) -> None:
    time = step["time"]
    axes.plot(
        time, step["locked"], color=style.PALE, linewidth=4.0,
        solid_capstyle="butt", label="h(x(t)) with the locks held: f₁ to the end",
    )  # fmt: skip
    axes.plot(
        time, step["true"], color=style.INK, linewidth=1.2,
        label="h(x(t)): f₁ until t*, then f₂",
    )  # fmt: skip
    axes.plot(
        time, step["spline"], color=style.PRINTED, linestyle="--", linewidth=1.2,
        label="Hermite cubic from both ends",
    )  # fmt: skip
    axes.set_xlabel("time (dimensionless)")


def _name_step(axes: Axes, step: pd.DataFrame) -> None:
    """Mark both ends with their slopes, and the event."""
    axes.set_ylabel("event function h (dimensionless)")
    time, locked = step["time"].to_numpy(), step["locked"].to_numpy()
    rates = np.gradient(locked, time)
    reach = SLOPE_LENGTH * (time[-1] - time[0])
    words = {0: "t₀: h and ∇h·f₁", -1: "t₁: h and ∇h·f₁,\nlocks held"}
    for place, text in words.items():
        start = np.array([time[place], locked[place]])
        along = 0.5 * np.array([reach, rates[place] * reach])
        ends = np.array([start - along, start + along])
        axes.plot(*ends.T, color=style.SHADE, linewidth=1.4, zorder=4)
        axes.plot(*start, "o", color=style.SHADE, markersize=4.5, zorder=5)
        side: Any = {"ha": "left", "va": "top"}
        offset = (8, -6)
        if place == -1:
            side = {"ha": "right", "va": "top"}
            offset = (16, -34)
        style.note(axes, text, tuple(start), offset, **side)
    instant = float(step["instant"].iloc[0])
    axes.plot(instant, 0.0, "o", color=style.INK, markersize=4, zorder=6)
    style.note(axes, "event at t*", (instant, 0.0), (-5, 5), ha="right")


def _enlarge(axes: Axes, step: pd.DataFrame) -> None:
    """Show the surroundings of the event, where root and instant are apart."""
    instant, root = float(step["instant"].iloc[0]), float(step["root"].iloc[0])
    apart = abs(root - instant)
    time, locked = step["time"].to_numpy(), step["locked"].to_numpy()
    rate = float(np.interp(instant, time, np.gradient(locked, time)))
    middle = 0.5 * (instant + root)
    axes.set_xlim(middle - ENLARGED * apart, middle + ENLARGED * apart)
    height = ENLARGED * apart * rate
    axes.set_ylim(-height, height)
    axes.set_xticks([instant, root], ["t*", "t′"])
    axes.set_yticks([0.0], ["0"])
    power = int(np.floor(np.log10(apart)))
    tens = f"10{str(power).translate(style.SUPERSCRIPTS)}"
    axes.set_xlabel(f"enlarged: |t′ − t*| = {apart / 10.0**power:.1f} × {tens}")
    for place, colour in ((instant, style.INK), (root, style.PRINTED)):
        axes.plot(place, 0.0, "o", color=colour, markersize=4, zorder=6)
        axes.axvline(place, color=colour, linewidth=0.6, linestyle=":")
