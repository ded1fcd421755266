"""Fig. 2.4 by both methods, and what spread, order and number of landings do to it."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from hopdata.figures import style

# The boxes of Fig. 2.4 from left to right, with the label of each.
MODELS = {
    "specialised": "affine\nspecialised",
    "near": "affine\nnear",
    "all": "affine\nall",
    "far": "affine\nfar",
    "specialised_mean": "mean\nspecialised",
    "mean": "mean\nall",
}
QUANTILES = ("p2_5", "q25", "median_mse", "q75", "p97_5")
# Method: its label, colour, and place beside the tick.
METHODS = {
    "printed": ("printed method", style.PRINTED, -0.19),
    "hopdata": ("hopdata's method", style.OURS, 0.19),
}
# Case: its label and colour.
CASES = {
    "C1": ("C1 hopper", style.OURS),
    "control": ("control: a map for each order", style.PRINTED),
}
PRINTED_IMPACTS = 100


@style.styled
def boxes_figure(boxes: pd.DataFrame) -> Figure:
    """Draw the six boxes of Fig. 2.4, by the printed method and by ours.

    Parameters
    ----------
    boxes : DataFrame
        One row per ``method`` and ``model``, with the quantiles ``p2_5, q25,
        median_mse, q75, p97_5`` of the combined MSE in squared normalised units.

    Returns
    -------
    Figure
        One logarithmic axis; whiskers from 2.5 % to 97.5 %.
    """
    figure = style.paper_figure(style.WIDEST_PANEL_MM, 70.0)
    axes = figure.subplots()
    axes.set_yscale("log")
    for method, (_, colour, beside) in METHODS.items():
        rows = boxes[boxes["method"] == method].set_index("model")
        for place, model in enumerate(MODELS):
            values = [float(rows[name][model]) for name in QUANTILES]
            style.box(axes, place + beside, values, colour, widths=0.32)
    axes.set_xticks(range(len(MODELS)), [*MODELS.values()])
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.6, len(MODELS) - 0.4)
    axes.axvline(3.5, color=style.GREY, linewidth=0.6)
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    style.plain_numbers(axes.yaxis)
    axes.grid(axis="y")
    axes.set_ylabel("combined prediction MSE (units²)")
    axes.set_title("One map for all orders errs less near the simultaneous contact")
    faces = []
    for label, colour, _ in METHODS.values():
        faces.append(
            Patch(facecolor=colour, alpha=0.55, edgecolor=style.INK, label=label)
        )
    axes.legend(handles=faces, loc="upper left")
    return figure


@style.styled
def ratio_figure(ratios: pd.DataFrame) -> Figure:
    """Draw the error of one map over that of maps of each order, by contact spread.

    Parameters
    ----------
    ratios : DataFrame
        One row per small study: ``seed, scale, case, noise, spread_ms, ratio``.

    Returns
    -------
    Figure
        A panel with the noise of motion capture and one without, with a line for the
        C1 hopper and one for the control: medians and ranges over the seeds.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 70.0)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = {"noise": "seen by motion capture", "none": "without noise"}
    for axes, (noise, title) in zip(panels, titles.items(), strict=True):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.axhline(1.0, color=style.INK, linewidth=0.8, linestyle=(0, (2, 1.5)))
        for case, look in CASES.items():
            chosen = ratios[(ratios["noise"] == noise) & (ratios["case"] == case)]
            _line_over(axes, chosen.groupby("scale"), "spread_ms", "ratio", look)
        axes.set_title(title, loc="left")
        axes.set_xlabel("spread of the contacts of a landing (ms)")
        axes.xaxis.set_major_locator(ticker.FixedLocator([3, 5, 10, 15]))
        axes.yaxis.set_major_locator(ticker.FixedLocator([1, 1.5, 2, 3, 4]))
        style.plain_numbers(axes.xaxis)
        style.plain_numbers(axes.yaxis)
        axes.grid(axis="y")
    style.note(panels[0], "as printed: equal", (3.4, 1.0), (0, -8))
    panels[0].set_ylim(0.85, 4.6)
    panels[0].set_ylabel("MSE, one map for all orders /\nmap of each order")
    panels[1].legend(loc="upper right")
    figure.suptitle(
        "C1: seen with noise, both models err alike as the contacts draw together; "
        "without noise, curvature stays.",
        x=0.01,
        ha="left",
        fontsize=style.pt(8),
    )
    style.letters(panels)
    return figure


def _line_over(
    axes: Axes, groups: Any, x: str, y: str, look: tuple[str, str], **options: Any
) -> None:
    """Draw medians of groups as a line, and their ranges as bars."""
    label, colour = look
    middle = groups[[x, y]].median()
    low = middle[y] - groups[y].min()
    high = groups[y].max() - middle[y]
    axes.errorbar(
        middle[x],
        middle[y],
        yerr=[low, high],
        color=colour,
        label=label,
        marker="o",
        markersize=3,
        capsize=2,
        **options,
    )


@style.styled
def unseen_figure(table: pd.DataFrame) -> Figure:
    """Draw the error for an order that was left out of the fit, by contact spread.

    Parameters
    ----------
    table : DataFrame
        One row per case and scale: ``case, spread_ms``, and the errors ``unseen`` and
        ``seen`` as shares of the variation of the outcome.

    Returns
    -------
    Figure
        One panel, both axes logarithmic.
    """
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, 80.0)
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    kinds = {"unseen": ("never trained on", "-"), "seen": ("trained on", (0, (4, 2)))}
    for case, (label, colour) in CASES.items():
        rows = table[table["case"] == case]
        for kind, (words, dash) in kinds.items():
            axes.plot(
                rows["spread_ms"],
                100 * rows[kind],
                color=colour,
                linestyle=dash,
                marker="o",
                markersize=3,
                label=f"{label.partition(':')[0]}, {words}",
            )
    axes.set_xlabel("spread of the contacts of a landing (ms)")
    axes.set_ylabel("error for the order (% of the variation)")
    axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    style.plain_numbers(axes.xaxis)
    style.plain_numbers(axes.yaxis)
    axes.grid(axis="y")
    axes.legend(loc="lower right")
    axes.set_title(
        "Near the simultaneous contact a C1 map predicts\nan order "
        "that it never saw; the control's does not",
        loc="left",
    )
    return figure


@style.styled
def impacts_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of affine maps by the number of landings they are fitted to.

    Parameters
    ----------
    table : DataFrame
        One row per ``what`` (``prediction`` or ``map``), ``seed`` and ``landings``,
        with ``median_error, q05, q95``: for predictions the MSE as a share of that of
        the mean, for the map its relative error.

    Returns
    -------
    Figure
        A panel for predictions and one for the map itself, with the dissertation's 100
        impacts marked.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 66.0)
    panels = figure.subplots(1, 2, sharex=True)
    labels = {
        "prediction": "error of predictions\n(% of the variance)",
        "map": "error of the map against the exact one\n(% of the map)",
    }
    for axes, (what, label) in zip(panels, labels.items(), strict=True):
        by_size = table[table["what"] == what].groupby("landings")
        levels = 100 * by_size[["median_error", "q05", "q95"]].median()
        sizes = pd.Series(levels.index.to_numpy(float))
        middle = pd.Series(levels["median_error"].to_numpy())
        band = (levels["q05"], levels["q95"])
        style.banded_line(axes, sizes, middle, band, ("", style.OURS, "-", "o"))
        axes.set_xscale("log")
        axes.set_ylim(0, 1.1 * float(levels["q95"].max()))
        axes.axvline(PRINTED_IMPACTS, color=style.SHADE, linewidth=1.0)
        last = (float(sizes.iloc[-1]), float(middle.iloc[-1]))
        axes.axhline(last[1], color=style.GREY, linewidth=0.8, linestyle=(0, (4, 2)))
        axes.set_ylabel(label)
        axes.set_xlabel("landings of any order that the map is fitted to")
        axes.xaxis.set_major_locator(ticker.FixedLocator(sizes.tolist()))
        style.plain_numbers(axes.xaxis)
        at = (PRINTED_IMPACTS, 0.97 * axes.get_ylim()[1])
        words = f"the dissertation's {PRINTED_IMPACTS}"
        style.note(axes, words, at, (4, -6), color=style.SHADE)
        left_over = f"{last[1]:.3g} % remain: noise and curvature"
        if what == "map":
            left_over = f"{last[1]:.3g} % remain: curvature"
        style.note(axes, left_over, last, (0, -9), ha="right", color=style.INK)
    style.letters(panels)
    return figure
