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


FIGURES: dict[str, Callable[..., Figure]] = {
    "learning_curve": learning_curve_figure,
    "kernel_smoothness": kernel_smoothness_figure,
    "adaptation": adaptation_figure,
}


if __name__ == "__main__":
    main(FIGURES)
