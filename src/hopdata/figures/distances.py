"""Figure 2.5: distances between the constraint subspaces of the mode schedules."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style
from hopdata.figures.verdict import in_short

# Kind: its label, colour and line style.
KINDS: dict[str, tuple[str, str, Any]] = {
    "in_class": ("in-class", style.INK, "-"),
    "cross_class": ("cross-class", style.INK, (0, (5, 1.5))),
    "noised_identity": ("identities with noise", style.GREY, (0, (1.5, 1.2))),
    "random": ("random", style.GREY, (0, (5, 1.2, 1.5, 1.2))),
}
QUANTILES = ("q05", "q25", "median_distance", "q75", "q95")
# Most steps of a drawn distribution.
MOST_STEPS = 2000


@style.styled
def distances_figure(distances: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Draw Fig. 2.5: distribution and box plot of each kind of arc-length distance.

    Parameters
    ----------
    distances : DataFrame
        One row per pair of subspaces: ``kind``, ``distance_rad``.
    summary : DataFrame
        One row per kind: ``kind`` and the quantiles ``q05, q25, median_distance, q75,
        q95``, rad.

    Returns
    -------
    Figure
        The distributions, and below them the boxes on the same axis (whiskers from 5 %
        to 95 %). A kind without data is marked "none".
    """
    if not distances["distance_rad"].notna().any():
        return style.message_figure(
            "No distances: no mode schedule holds enough touchdowns."
        )
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, 102.0)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
    _draw_study(upper, lower, distances, summary)
    style.lettered(figure, (upper, lower), ncols=2)
    return figure


def _draw_study(
    upper: Axes, lower: Axes, distances: pd.DataFrame, summary: pd.DataFrame
) -> None:
    """Draw the distributions above and the boxes below, and label the axes."""
    boxes = {str(row["kind"]): row for row in summary.to_dict("records")}
    for place, kind in enumerate(KINDS):
        of_kind = distances.loc[distances["kind"] == kind, "distance_rad"]
        sample = of_kind.dropna().to_numpy()
        _draw_cumulative(upper, kind, sample)
        _draw_box(lower, place, kind, boxes.get(kind, {}))
    upper.set_ylabel("cumulative share")
    upper.set_ylim(0, 1.02)
    upper.grid(axis="x")
    upper.locator_params(axis="x", nbins=7)
    lower.grid(axis="x")
    style.name_rows(lower, [label for label, _, _ in KINDS.values()])
    lower.set_xlabel("arc-length distance (rad)")


def _draw_cumulative(axes: Axes, kind: str, sample: np.ndarray) -> None:
    """Draw the distribution of one kind, or its legend entry "none" without data."""
    label, colour, dash = KINDS[kind]
    if not len(sample):
        axes.plot([], [], color=colour, linestyle=dash, label=f"{label} (none)")
        return
    n = len(sample)
    ordered = np.sort(sample)
    share = np.arange(1, n + 1) / n
    shown = np.unique(np.linspace(0, n - 1, min(n, MOST_STEPS)).astype(int))
    x = np.concatenate([ordered[:1], ordered[shown]])
    y = np.concatenate([[0.0], share[shown]])
    axes.plot(x, y, color=colour, linestyle=dash, label=label, drawstyle="steps-post")


def _draw_box(axes: Axes, place: int, kind: str, row: Any) -> None:
    """Draw the box of one kind from its row of the summary."""
    _, colour, _ = KINDS[kind]
    values = [float(row.get(quantile, np.nan)) for quantile in QUANTILES]
    if not np.all(np.isfinite(values)):
        style.lacking(axes, 0.5, place, "none", axes.get_yaxis_transform())
        return
    style.box(axes, place, values, colour, widths=0.55, orientation="horizontal")


# Figure 2.5 for studies side by side, such as a C1 landing and one that is not, with
# verdicts.


@style.styled
def both_sides_figure(*content: Any, names: Sequence[str]) -> Figure:
    """Draw the distances between subspaces of several studies, each with its verdict.

    Parameters
    ----------
    content
        For each study in turn: the two tables of `distances_figure`, and its
        ``verdict.json``.
    names
        Titles of the studies.

    Returns
    -------
    Figure
        One column per study: distributions, boxes, and the verdict's conclusion with
        its size.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 96.0)
    rows = figure.subplots(
        2, len(names), sharex=True, sharey="row", height_ratios=(1.7, 1), squeeze=False
    )
    for column, name in enumerate(names):
        distances, summary, verdict = content[3 * column : 3 * column + 3]
        upper = rows[0, column]
        lower = rows[1, column]
        _draw_study(upper, lower, distances, summary)
        upper.set_title(f"{name}\nverdict: {in_short(verdict)}", loc="left")
    for axes in rows[:, 1:].ravel():
        axes.set_ylabel("")
    style.lettered(figure, rows[0], ncols=4)
    return figure
