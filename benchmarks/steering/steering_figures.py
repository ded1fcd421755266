"""Draw a figure of steering's benchmarks from their tables.

python benchmarks/steering/steering_figures.py adaptation adaptation_return.csv --out adaptation
"""

from __future__ import annotations

from collections.abc import Callable

import beside  # noqa: F401  finds `benchmark_figures`
import pandas as pd
from benchmark_figures import main
from matplotlib.figure import Figure

from hopdata.figures import style
from hopdata.steering.figures.models import (
    kernel_smoothness_figure,
    learning_curve_figure,
)

# How a controller comes back after the robot has changed.

RETURNS = {
    "as it was": (style.VERMILION, (0, (4, 2))),
    "adaptive": (style.BLUE, "-"),
    "learned anew": (style.GREY, (0, (1, 1.5))),
}
LEAST_RUNS = 6  # fewest runs for which a median is drawn


@style.styled
def adaptation_figure(table: pd.DataFrame) -> Figure:
    """Draw the distance of stances from their predictions, by the hops since the change.

    Parameters
    ----------
    table : DataFrame
        One row per change, controller and hop: ``change, controller, hop, median_m,
        runs``.

    Returns
    -------
    Figure
        One panel per change, one line per controller.
    """
    changes = list(dict.fromkeys(table["change"]))
    if not changes:
        return style.message_figure("No change was made.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 62.0)
    panels = figure.subplots(1, len(changes), sharey=True, squeeze=False)[0]
    for axes, change in zip(panels, changes, strict=True):
        for name, (colour, line) in RETURNS.items():
            rows = table[(table["change"] == change) & (table["controller"] == name)]
            rows = rows[rows["runs"] >= LEAST_RUNS].sort_values("hop")
            axes.plot(
                rows["hop"],
                1e3 * rows["median_m"],
                color=colour,
                linestyle=line,
                label=name,
            )
        axes.set_title(change)
        axes.set_xlabel("hops since the change")
    panels[0].set_ylabel("stance from where foretold,\nmedian (mm)")
    panels[0].set_ylim(bottom=0.0)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=3
    )
    return figure


# How often each controller arrives in worlds that differ from the plain one.

WORLDS = {
    ("planner", "learned anew"): ("planner, learned there", style.BLUE, "o"),
    ("planner, last step", "learned anew"): (
        "planner that knows the last step, learned there",
        style.GREEN,
        "D",
    ),
    ("planner", "as it was"): (
        "planner, learned in the plain world",
        style.ORANGE,
        "s",
    ),
    ("printed", "learned anew"): (
        "printed controller, learned there",
        style.VERMILION,
        "^",
    ),
    ("printed", "as it was"): (
        "printed controller, learned in the plain world",
        style.PURPLE,
        "v",
    ),
    ("random", "none"): ("random swings", style.GREY, "x"),
    ("none", "none"): ("boom at rest", style.INK, "+"),
}
LANE = 0.8  # share of the height of a world that its controllers fill


@style.styled
def worlds_figure(table: pd.DataFrame) -> Figure:
    """Draw the share of starts from which each controller arrives, by world.

    Parameters
    ----------
    table : DataFrame
        One row per seed, world, model and controller: ``arrived`` of ``starts``.

    Returns
    -------
    Figure
        One line per world: a symbol at the median over the seeds, and a line from
        there to the worst seed. The number of seeds stands beside it.
    """
    if not len(table):
        return style.message_figure("No world was tried.")
    share = table.assign(share=100 * table["arrived"] / table["starts"])
    cells = share.groupby(["world", "controller", "model"], sort=False)["share"]
    found = cells.agg(median="median", worst="min", seeds="size").reset_index()
    worlds = list(dict.fromkeys(table["world"]))
    series = [
        key
        for key in WORLDS
        if ((found["controller"] == key[0]) & (found["model"] == key[1])).any()
    ]
    height_mm = 26.0 + len(worlds) * max(5.5, 1.9 * len(series))
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    axes = figure.subplots()
    for lane, key in enumerate(series):
        label, colour, symbol = WORLDS[key]
        rows = found[(found["controller"] == key[0]) & (found["model"] == key[1])]
        offset = LANE * ((lane + 0.5) / len(series) - 0.5)
        places = rows["world"].map(worlds.index) + offset
        axes.hlines(places, rows["worst"], rows["median"], color=colour, linewidth=1.0)
        axes.plot(
            rows["median"], places, symbol, color=colour, label=label, clip_on=False
        )
        axes.plot(rows["worst"], places, "|", color=colour, clip_on=False)
    seeds = found.groupby("world", sort=False)["seeds"]
    names = []
    for world in worlds:
        least, most = seeds.min()[world], seeds.max()[world]
        count = f"{least}" if least == most else f"{least} to {most}"
        unit = "seed" if most == 1 else "seeds"
        names.append(f"{world} ({count} {unit})")
    axes.set_yticks(range(len(worlds)), names)
    for boundary in range(1, len(worlds)):
        axes.axhline(boundary - 0.5, color=style.GREY, linewidth=0.3)
    axes.set_ylim(len(worlds) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("starts from which it arrives (%)")
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside upper center", ncols=2
    )
    return figure


FIGURES: dict[str, Callable[..., Figure]] = {
    "learning_curve": learning_curve_figure,
    "kernel_smoothness": kernel_smoothness_figure,
    "adaptation": adaptation_figure,
    "worlds": worlds_figure,
}


if __name__ == "__main__":
    main(FIGURES)
