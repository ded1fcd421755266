"""Success rates and hops to the goal of all controllers, side by side, with intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
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

LOOKS = {
    "printed": ("printed controller", VERMILION, "s"),
    "planner": ("planner", BLUE, "o"),
    "globalised": ("globalised controller", BLUE, "o"),
    "ceiling": ("policy that knows the true map", GREEN, "D"),
}
TASKS = {
    ("origin", "facing"): "to the origin,\nfacing it",
    ("origin", "any"): "to the origin,\nany heading",
    ("origin_board", "facing"): "facing it,\nboard in the way",
    ("origin_board", "any"): "any heading,\nboard in the way",
    ("turn", "any"): "half turn",
    ("turn_board", "any"): "half turn,\nboard in the way",
}
APART = 0.22  # between controllers of one task


@styled
def steering_outcomes_figure(outcomes: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """Draw the outcomes.

    Parameters
    ----------
    outcomes : DataFrame
        As from `hopdata.steering.experiments.outcomes.outcome_table`.
    runs : DataFrame
        One row a run: ``experiment, start, controller, success, hops``.

    Returns
    -------
    Figure
        (a) Share of the runs that succeeded, with intervals, and the target; (b) hops of those
        runs, each a dot, and their median with its interval.
    """
    if outcomes.empty:
        return message_figure("No run was made.")
    keys = list(zip(outcomes["experiment"], outcomes["start"], strict=True))
    tasks = [task for task in TASKS if task in keys]
    figure = paper_figure(DOUBLE_COLUMN_MM, 22.0 + 14.0 * len(tasks))
    rates, hops = figure.subplots(1, 2, sharey=True)
    for row, task in enumerate(tasks):
        chosen = outcomes[[key == task for key in keys]]
        offsets = APART * (np.arange(len(chosen)) - (len(chosen) - 1) / 2)
        for offset, entry in zip(offsets, chosen.to_dict("records"), strict=True):
            _draw_rate(rates, entry, row + offset)
            _draw_hops(hops, entry, runs, row + offset)
    _finish(rates, hops, tasks)
    for name in outcomes["controller"].unique():
        label, colour, mark = LOOKS[name]
        rates.plot([], [], mark, color=colour, ms=4, label=label)
    if outcomes["asked_rate"].notna().any():
        rates.plot([], [], "|", color=INK, ms=8, mew=1.4, label="target")
    figure.legend(*rates.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    letter(rates, "a")
    letter(hops, "b")
    return figure


def _draw_rate(axes: Axes, entry: dict[Any, Any], place: float) -> None:
    _, colour, mark = LOOKS[entry["controller"]]
    rate, low, high = (100 * entry[key] for key in ("rate", "rate_low", "rate_high"))
    axes.errorbar(
        rate, place, xerr=[[rate - low], [high - rate]], fmt=mark, color=colour, ms=4,
        capsize=2, elinewidth=0.9,
    )  # fmt: skip
    axes.annotate(
        f"{entry['succeeded']}/{entry['runs']}", (1, place), xycoords=axes.get_yaxis_transform(),
        xytext=(3, 0), textcoords="offset points", ha="left", va="center", fontsize=6,
        color=INK,
    )  # fmt: skip
    if np.isfinite(entry["asked_rate"]):
        axes.plot(100 * entry["asked_rate"], place, "|", color=INK, ms=8, mew=1.4, zorder=4)


def _draw_hops(axes: Axes, entry: dict[Any, Any], runs: pd.DataFrame, place: float) -> None:
    _, colour, mark = LOOKS[entry["controller"]]
    own = (
        (runs["experiment"] == entry["experiment"])
        & (runs["start"] == entry["start"])
        & (runs["controller"] == entry["controller"])
        & runs["success"].astype(bool)
    )
    axes.plot(
        runs.loc[own, "hops"], np.full(own.sum(), place), ".", color=colour, ms=3.5, mew=0,
        alpha=0.35,
    )  # fmt: skip
    if not own.any():
        return
    middle, low, high = (entry[key] for key in ("hops", "hops_low", "hops_high"))
    known = np.isfinite(low) and np.isfinite(high)
    axes.errorbar(
        middle, place, xerr=[[middle - low], [high - middle]] if known else None, fmt=mark,
        color=colour, mec="white", mew=0.4, ms=4.5, capsize=2, elinewidth=0.9,
    )  # fmt: skip


def _finish(rates: Axes, hops: Axes, tasks: list[tuple[str, str]]) -> None:
    rates.set_yticks(range(len(tasks)), [TASKS[task] for task in tasks])
    rates.set_ylim(len(tasks) - 0.5, -0.5)
    rates.set_xlim(-3, 103)
    rates.set_xlabel("runs that succeeded (%)")
    hops.set_xlabel("hops to the goal")
    hops.set_xlim(0, 1.05 * hops.dataLim.x1 if np.isfinite(hops.dataLim.x1) else 1)
    for axes in (rates, hops):
        axes.tick_params(axis="y", length=0)
        for between in range(1, len(tasks)):
            axes.axhline(between - 0.5, color=GREY, linewidth=0.3)
