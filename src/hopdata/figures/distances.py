"""Figure 2.5: how far apart the constraint subspaces of the mode schedules are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PURPLE,
    SINGLE_COLUMN_MM,
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

# kind: what the reader sees, its colour, its line style.
KINDS: dict[str, tuple[str, str, Any]] = {
    "in_class": ("in-class", BLUE, "-"),
    "cross_class": ("cross-class", VERMILION, (0, (5, 1.5))),
    "noised_identity": ("noised identity", GREEN, (0, (1.5, 1.2))),
    "random": ("random", PURPLE, (0, (5, 1.2, 1.5, 1.2))),
}
QUANTILES = ("q05", "q25", "median", "q75", "q95")
MOST_STEPS = 2000


@styled
def distances_figure(distances: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Draw Fig. 2.5: cumulative distribution and box of each kind of arc-length distance.

    Parameters
    ----------
    distances : DataFrame
        One row a pair of subspaces: ``kind``, ``distance_rad``.
    summary : DataFrame
        One row a kind: ``kind`` and the quantiles ``q05, q25, median, q75, q95``, rad.

    Returns
    -------
    Figure
        The distributions above, the boxes (whiskers from 5 % to 95 %) below on the same axis.
        A kind without data is named, with the word "none".
    """
    if not distances["distance_rad"].notna().any():
        return message_figure("No distances: no mode schedule holds enough touchdowns.")
    figure = paper_figure(SINGLE_COLUMN_MM, 92.0)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
    boxes = {str(row["kind"]): row for row in summary.to_dict("records")}
    for place, kind in enumerate(KINDS):
        sample = distances.loc[distances["kind"] == kind, "distance_rad"].dropna().to_numpy()
        draw_cumulative(upper, kind, sample)
        draw_box(lower, place, kind, boxes.get(kind, {}))
    label_axes(upper, lower)
    letter(upper, "a")
    letter(lower, "b")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def draw_cumulative(axes: Axes, kind: str, sample: np.ndarray) -> None:
    """Draw the cumulative distribution of one kind; without data its name and the word "none"."""
    label, colour, dash = KINDS[kind]
    if not len(sample):
        axes.plot([], [], color=colour, linestyle=dash, label=f"{label} (none)")
        return
    ordered, share = np.sort(sample), np.arange(1, len(sample) + 1) / len(sample)
    shown = np.unique(np.linspace(0, len(sample) - 1, min(len(sample), MOST_STEPS)).astype(int))
    x = np.concatenate([ordered[:1], ordered[shown]])
    y = np.concatenate([[0.0], share[shown]])
    axes.plot(x, y, color=colour, linestyle=dash, label=label, drawstyle="steps-post")


def draw_box(axes: Axes, place: int, kind: str, row: Any) -> None:
    """Draw the box of one kind from its row of the summary."""
    _, colour, _ = KINDS[kind]
    values = [float(row.get(quantile, np.nan)) for quantile in QUANTILES]
    if not np.all(np.isfinite(values)):
        axes.text(
            0.5, place, "none", transform=axes.get_yaxis_transform(), ha="center", va="center",
            color=GREY,
        )  # fmt: skip
        return
    stats = dict(zip(("whislo", "q1", "med", "q3", "whishi"), values, strict=True))
    axes.bxp(
        [{**stats, "fliers": []}],
        positions=[place],
        widths=0.55,
        orientation="horizontal",
        showfliers=False,
        patch_artist=True,
        boxprops={"facecolor": colour, "alpha": 0.55, "edgecolor": INK},
        medianprops={"color": INK, "linewidth": 1.2},
        whiskerprops={"color": INK, "linewidth": 0.8},
        capprops={"color": INK, "linewidth": 0.8},
        manage_ticks=False,
    )


def label_axes(upper: Axes, lower: Axes) -> None:
    """Name the axes of distributions and boxes."""
    upper.set_ylabel("cumulative share")
    upper.set_ylim(0, 1.02)
    upper.grid(axis="x")
    upper.locator_params(axis="x", nbins=7)
    lower.grid(axis="x")
    lower.set_yticks(range(len(KINDS)), [label for label, _, _ in KINDS.values()])
    lower.set_ylim(len(KINDS) - 0.4, -0.6)
    lower.tick_params(axis="y", length=0)
    lower.set_xlabel("arc-length distance (rad)")
