"""Drawings of what decides a frame change, and of models by mode schedule."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

COMPONENTS = {"dx": "x", "dy": "y", "dtheta": "heading"}
UNITS = {"dx": "mm", "dy": "mm", "dtheta": "degrees"}
# What is known of a hop, in the order in which it is added, with its colour.
KNOWN = {
    "boom angle and swing": ("boom angle and swing", style.OURS),
    "and the swing before": ("and the swing before", style.SHADE),
    "and the velocity at the apex": ("and the velocity at the apex", style.PRINTED),
    "and the whole state at the apex": ("and the whole state", "#dedede"),
}
GIVEN = {
    "inputs": ("given boom angle and swing", style.PRINTED, "o"),
    "inputs and state": ("and the state at the apex", style.OURS, "s"),
}
BODIES = {
    "hopper": ("hopper", style.OURS, "o"),
    "coupled legs": ("coupled legs (not C1)", style.PRINTED, "s"),
}


@style.styled
def orders_figure(
    decided: pd.DataFrame, orders: pd.DataFrame, scaled: pd.DataFrame
) -> Figure:
    """Draw what decides a frame change, and what the contact orders add.

    Parameters
    ----------
    decided : DataFrame
        From `hopdata.steering.models.residuals.decided_by`, with ``seed``.
    orders : DataFrame
        From `hopdata.steering.models.residuals.order_effects`, with ``seed``.
    scaled : DataFrame
        ``body, scale, component, effect, spread, seed``.

    Returns
    -------
    Figure
        (a) Share of the variance that is decided by what is known. (b) Rms of what an
        order adds, without and with the state. (c) What the landing order adds to a
        linear map of the state, over the spread of the frame change.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 78.0)
    panels = figure.subplots(1, 3, width_ratios=(1, 1.15, 1))
    _draw_decided(panels[0], decided)
    _draw_orders(panels[1], orders)
    _draw_scaled(panels[2], scaled)
    style.letters(panels)
    return figure


def _draw_decided(axes: Axes, decided: pd.DataFrame) -> None:
    for row, component in enumerate(COMPONENTS):
        own = decided[decided["component"] == component]
        share = 100 * own.groupby("known")["share"].median()
        begun = 0.0
        for known, (label, colour) in KNOWN.items():
            # A share is adjusted for its coefficients, so it may fall a little.
            end = max(begun, float(share[known]))
            name = label if row == 0 else "_"
            axes.barh(
                row, end - begun, left=begun, color=colour, label=name, height=0.6
            )
            begun = end
    axes.set(xlim=(0, 100), xlabel="decided (% of the variance)")
    style.name_rows(axes, list(COMPONENTS.values()))
    _legend_above(axes)


def _draw_orders(axes: Axes, orders: pd.DataFrame) -> None:
    rows = []
    for component, name in COMPONENTS.items():
        for order in ("landing", "lift-off"):
            unit = "°" if component == "dtheta" else "mm"
            rows.append((component, order, f"{name} ({unit}), {order}"))
    for given, (label, colour, mark) in GIVEN.items():
        look: Any = {"color": colour, "marker": mark, "ms": 4, "ls": ""}
        for row, (component, order, _) in enumerate(rows):
            of_row = (orders["component"] == component) & (orders["order"] == order)
            effect = orders.loc[of_row & (orders["given"] == given), "effect"]
            effect = effect[effect > 0]
            if effect.empty:
                continue
            ends = [effect.min(), effect.max()]
            axes.plot(ends, [row, row], color=colour, lw=1.0)
            axes.plot(effect.median(), row, **look)
        axes.plot([], [], label=label, **look)
    axes.set_xscale("log")
    style.plain_numbers(axes.xaxis)
    style.name_rows(axes, [name for _, _, name in rows])
    axes.grid(axis="x")
    axes.set_xlabel("what the order adds, rms (mm or degrees)")
    _legend_above(axes)


def _draw_scaled(axes: Axes, scaled: pd.DataFrame) -> None:
    rows = scaled[scaled["component"] == "dx"]
    for body, (label, colour, mark) in BODIES.items():
        own = rows[rows["body"] == body]
        for _, of_seed in own.groupby("seed"):
            line = of_seed.sort_values("spread")
            axes.plot(line["spread"], line["effect"], color=colour, lw=0.6, alpha=0.6)
        middle = own.groupby("scale")[["spread", "effect"]].median()
        look: Any = {"color": colour, "marker": mark, "ms": 4.5, "lw": 1.5}
        axes.plot(middle["spread"], middle["effect"], label=label, **look)
        ratio = middle.iloc[-1] / middle.iloc[0]
        power = np.log(ratio["effect"]) / np.log(ratio["spread"])
        at = tuple(middle.iloc[-1])
        text = f"power {power:.1f}"
        below: Any = {"ha": "right", "va": "top", "bbox": style.ON_WHITE}
        style.note(axes, text, at, (4, -8), color=colour, **below)
    axes.set(xscale="log", yscale="log")
    style.plain_numbers(axes.xaxis)
    style.plain_numbers(axes.yaxis)
    axes.set_xticks([4, 6, 8, 12])
    axes.set_yticks([0.03, 0.1, 0.3, 1])
    axes.set_xlabel("spread of Δx (mm)")
    axes.set_ylabel("what the landing order adds to Δx,\nrms (mm)")
    _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.4)


# Models by schedule.

MODELS = {
    "one model for all": ("one model for all", style.OURS, "-", "o"),
    "one model a schedule, which is known": (
        "one a schedule, which is known",
        style.SHADE,
        (0, (4, 1.5)),
        "s",
    ),
    "one model a schedule, which is unknown": (
        "one a schedule, which is unknown",
        style.PRINTED,
        (0, (1.5, 1.2)),
        "^",
    ),
}


@style.styled
def schedules_figure(curve: pd.DataFrame) -> Figure:
    """Draw the errors of models on fresh hops, by the number of hops to learn from.

    Parameters
    ----------
    curve : DataFrame
        From `hopdata.steering.models.by_schedule.schedule_curve`, with ``seed``.

    Returns
    -------
    Figure
        One panel a component: median and range over the seeds.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 66.0)
    panels = figure.subplots(1, len(COMPONENTS))
    for axes, (component, title) in zip(panels, COMPONENTS.items(), strict=True):
        own = curve[curve["component"] == component]
        for model, line in MODELS.items():
            errors = own[own["model"] == model].groupby("hops")["rmse"]
            x = pd.Series(sorted(own["hops"].unique()))
            band = (errors.min(), errors.max())
            style.banded_line(axes, x, errors.median(), band, line)
        axes.set_xscale("log")
        style.plain_numbers(axes.xaxis)
        axes.set_xticks(sorted(own["hops"].unique()))
        axes.set(xlabel="hops to learn from", title=title)
        axes.set_ylabel(f"rms error of fresh hops ({UNITS[component]})")
        axes.set_ylim(0, None)
    style.lettered(figure, panels, ncols=3)
    return figure


# Sustained turns.


@style.styled
def turning_figure(turns: pd.DataFrame) -> Figure:
    """Draw turn and turning radius by the swing in each hop.

    Parameters
    ----------
    turns : DataFrame
        ``swing_deg, turn_deg, step_m, radius_m, seed``.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 58.0)
    turn, radius = figure.subplots(1, 2)
    line: Any = ("simulated", style.OURS, "-", "o")
    for axes, column in ((turn, "turn_deg"), (radius, "radius_m")):
        rows = turns
        if column == "radius_m":
            rows = turns[turns["swing_deg"] != 0.0]
        values = rows.groupby("swing_deg")[column]
        x = values.median().index.to_series()
        for side in (x < 0, x > 0):
            if column == "turn_deg":
                side = x < np.inf
            where = side.to_numpy()
            band = (values.min()[where], values.max()[where])
            style.banded_line(axes, x[where], values.median()[where], band, line)
        axes.set_xlabel("swing of the boom in each hop (degrees)")
        axes.set_xticks(sorted(turns["swing_deg"].unique()))
    turn.axhline(0.0, color=style.GREY, lw=0.6, zorder=0)
    turn.set_ylabel("turn in a hop (degrees)")
    look: Any = {"transform": turn.transAxes, "color": style.GREY}
    turn.text(0.98, 0.97, "counter-clockwise", ha="right", va="top", **look)
    turn.text(0.02, 0.03, "clockwise", ha="left", va="bottom", **look)
    dashed: Any = {"color": style.SHADE, "lw": 0.9, "ls": (0, (4, 2))}
    radius.axhline(0.6, **dashed)
    printed = "0.6 m, as printed"
    style.note(radius, printed, (0, 0.6), (0, 3), ha="center", color=style.SHADE)
    radius.set(ylabel="turning radius (m)", ylim=(0, None))
    style.letters([turn, radius])
    return figure
