"""Figs. 3.5, 3.6, 3.8 and 3.9: one run in the arena and over time, beside what the model says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREY,
    INK,
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

# Curve: its name, colour, line and mark. Drawn in this order, the measured motion on top.
CURVES: dict[str, tuple[str, str, Any, str]] = {
    "pure": ("pure simulation", VERMILION, (0, (1.2, 1.2)), ""),
    "response": ("simulated control response", BLUE, (0, (4, 1.5)), "x"),
    "measured": ("measured motion", INK, "-", "o"),
}
TICK_M = 0.07  # length of the line that shows a heading
BESIDE_M = 0.12  # how far the board is drawn beyond the path on both sides


@styled
def steering_run_figure(curves: pd.DataFrame) -> Figure:
    """Draw one run.

    Parameters
    ----------
    curves : DataFrame
        Three curves of one run, as from `hopdata.steering.experiments.study.run_experiment`.

    Returns
    -------
    Figure
        (a) The arena: path, headings, goal, and the board where it stood and where it was pushed
        to; (b) x, (c) y and (d) heading over time.
    """
    if curves.empty:
        return message_figure("No run was made.")
    turn = str(curves["experiment"].iloc[0]).startswith("turn")
    figure = paper_figure(DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplot_mosaic("ax;ay;ah", width_ratios=(1.15, 1))
    _draw_arena(panels["a"], curves, turn)
    for panel, column, label, factor in (
        ("x", "x_m", "x (m)", 1.0),
        ("y", "y_m", "y (m)", 1.0),
        ("h", "heading_rad", "heading (°)", 180 / np.pi),
    ):
        _draw_over_time(panels[panel], curves, column, factor)
        panels[panel].set_ylabel(label)
    _draw_goals(panels, curves, turn)
    panels["h"].set_xlabel("time (s)")
    for above in "xy":
        panels[above].sharex(panels["h"])
        panels[above].tick_params(labelbottom=False)
    figure.align_ylabels([panels[name] for name in "xyh"])
    for text, name in zip("abcd", "axyh", strict=True):
        letter(panels[name], text)
    handles, labels = panels["x"].get_legend_handles_labels()
    places, names = panels["a"].get_legend_handles_labels()
    figure.legend(
        [*handles[::-1], *places], [*labels[::-1], *names], loc="outside upper center", ncols=7
    )
    return figure


def _curve(curves: pd.DataFrame, name: str) -> pd.DataFrame:
    return curves[curves["curve"] == name]


def _draw_over_time(axes: Axes, curves: pd.DataFrame, column: str, factor: float) -> None:
    for name, (label, colour, dash, mark) in CURVES.items():
        rows = _curve(curves, name)
        axes.plot(
            rows["time_s"], rows[column] * factor, color=colour, linestyle=dash, marker=mark,
            ms=2.2 if mark == "o" else 3, mew=0.7, label=label,
        )  # fmt: skip
    axes.margins(y=0.12)


def _draw_goals(panels: dict[str, Axes], curves: pd.DataFrame, turn: bool) -> None:
    """Draw the goal as a thin line: zero in x and y, or half a turn to the side that was turned."""
    if not turn:
        for name in "xy":
            panels[name].axhline(0.0, color=GREY, linewidth=0.6, zorder=0)
        return
    last = _curve(curves, "measured")["heading_rad"].dropna().iloc[-1]
    panels["h"].axhline(np.sign(last) * 180, color=GREY, linewidth=0.6, zorder=0)


def _draw_arena(axes: Axes, curves: pd.DataFrame, turn: bool) -> None:
    for name, (_, colour, dash, mark) in CURVES.items():
        rows = _curve(curves, name)
        axes.plot(
            rows["x_m"], rows["y_m"], color=colour, linestyle=dash, marker=mark,
            ms=2.2 if mark == "o" else 3, mew=0.7,
        )  # fmt: skip
    measured = _curve(curves, "measured")
    _draw_headings(axes, measured)
    _draw_board(axes, measured)
    if not turn:
        axes.plot(0, 0, "*", color=VERMILION, mec="white", mew=0.5, ms=10, zorder=5, label="goal")
        angle = np.linspace(0, 2 * np.pi, 73)
        near = float(curves["near"].iloc[0])
        axes.plot(near * np.cos(angle), near * np.sin(angle), color=GREY, linewidth=0.6, zorder=0)
    _draw_start(axes, measured)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _draw_headings(axes: Axes, measured: pd.DataFrame) -> None:
    x, y, heading = (measured[name].to_numpy() for name in ("x_m", "y_m", "heading_rad"))
    dx, dy = TICK_M * np.cos(heading), TICK_M * np.sin(heading)
    axes.plot(np.stack([x, x + dx]), np.stack([y, y + dy]), color=INK, linewidth=0.5, zorder=1)


def _draw_board(axes: Axes, measured: pd.DataFrame) -> None:
    """Draw the board, as wide as the path: pale where it stood, dark where it was pushed to."""
    first, last = measured["board_first_m"].iloc[0], measured["board_m"].dropna()
    if np.isnan(first) or last.empty:
        return
    way = measured[["board_x", "board_y"]].iloc[0].to_numpy(dtype=float)
    across = np.array([-way[1], way[0]])
    sideways = measured[["x_m", "y_m"]].dropna().to_numpy() @ across
    sides = (sideways.min() - BESIDE_M, sideways.max() + BESIDE_M)
    for place, colour, label in (
        (float(first), "#d8c9a8", "board at first"),
        (float(last.iloc[-1]), "#8a6d2f", "board in the end"),
    ):
        ends = np.stack([place * way + side * across for side in sides])
        axes.plot(
            ends[:, 0], ends[:, 1], color=colour, linewidth=3, solid_capstyle="butt", zorder=0,
            label=label,
        )  # fmt: skip


def _draw_start(axes: Axes, measured: pd.DataFrame) -> None:
    start = measured.dropna(subset=["x_m"]).iloc[0]
    axes.plot(
        start["x_m"], start["y_m"], "o", color="white", mec=INK, ms=5, mew=0.9, zorder=4,
        label="start",
    )  # fmt: skip
