"""Drawing of success: by experiment, by the heading of the start, and by horizon."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures import style

# Who steers: label, colour, marker.
WHO = {
    "printed": ("all as printed", style.PRINTED, "s"),
    "printed controller": ("printed controller, hopdata's model", style.SHADE, "D"),
    "planner": ("hopdata's planner", style.OURS, "o"),
}
EXPERIMENTS = {
    "origin": "to the origin",
    "origin_board": "to it, board in the way",
    "turn": "half turn",
    "turn_board": "turn, board in the way",
}
# Angles between heading and goal: their ends in degrees.
BEARINGS = (0, 60, 120, 180)
APART = 0.2


@style.styled
def success_figure(runs: pd.DataFrame, farther: pd.DataFrame) -> Figure:
    """Draw the share of runs that succeed.

    Parameters
    ----------
    runs : DataFrame
        ``seed, who, experiment, success, bearing_rad``.
    farther : DataFrame
        ``seed, horizon, success`` of the printed controller.

    Returns
    -------
    Figure
        (a) Median over the seeds of each experiment, and the range. (b) To the origin,
        all seeds together, by the angle between the first heading and the goal. (c) By
        the horizon, from the same starts.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 66.0)
    panels = figure.subplots(1, 3, width_ratios=(1.5, 1.2, 0.7))
    by_experiment, by_bearing, by_horizon = panels
    _draw_experiments(by_experiment, runs)
    _draw_bearings(by_bearing, runs[runs["experiment"] == "origin"])
    shares = 100 * farther.groupby("horizon")["success"].mean()
    _, colour, mark = WHO["printed"]
    by_horizon.plot(shares.index, shares, f"{mark}-", color=colour)
    by_horizon.set_xticks(shares.index)
    by_horizon.set(xlabel="horizon (hops)", ylabel="to the origin (%)")
    for axes in (by_bearing, by_horizon):
        axes.set_ylim(-4, 104)
    style.lettered(figure, panels, ncols=3)
    return figure


def _draw_experiments(axes: Axes, runs: pd.DataFrame) -> None:
    """Draw median and range over the seeds, by experiment."""
    names = list(EXPERIMENTS)
    for k, (who, (label, colour, mark)) in enumerate(WHO.items()):
        own = runs[runs["who"] == who]
        for row, name in enumerate(names):
            made = own[own["experiment"] == name]
            if made.empty:
                continue
            shares = 100 * made.groupby("seed")["success"].mean()
            at = row + APART * (k - 1)
            axes.plot([shares.min(), shares.max()], [at, at], color=colour, lw=0.9)
            axes.plot(shares.median(), at, mark, color=colour, mec="white", mew=0.4)
        axes.plot([], [], mark, color=colour, label=label)
    style.name_rows(axes, list(EXPERIMENTS.values()))
    axes.set(xlim=(-4, 104), xlabel="runs that succeeded (%)")


def _draw_bearings(axes: Axes, runs: pd.DataFrame) -> None:
    """Draw success by the angle between the first heading and the goal."""
    ends = np.array(BEARINGS)
    middles = (ends[:-1] + ends[1:]) / 2
    for who, (_, colour, mark) in WHO.items():
        own = runs[runs["who"] == who]
        place = np.digitize(np.rad2deg(own["bearing_rad"]), ends[1:-1])
        shares = 100 * own.groupby(place)["success"].mean()
        axes.plot(middles[shares.index], shares, f"{mark}-", color=colour)
    axes.set_xticks(ends)
    axes.set(xlabel="first heading from the goal (°)", ylabel="to the origin (%)")
