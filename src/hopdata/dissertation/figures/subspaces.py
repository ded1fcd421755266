"""Fig. 2.5 by both methods, the spectrum of the pairs, and the choice of a distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

# Kinds of Fig. 2.5: label, colour, dashes.
KINDS: dict[str, tuple[str, str, Any]] = {
    "in_class": ("in-class", style.OURS, "-"),
    "cross_class": ("cross-class", style.SHADE, (0, (5, 1.5))),
    "noised_identity": ("I + noise", style.PRINTED, (0, (1.5, 1.2))),
    "random": ("random", style.PALE, (0, (5, 1.2, 1.5, 1.2))),
}
METHODS = {
    "printed": "printed method",
    "hopdata": "hopdata's method",
    "control": "control (a map for each order)",
}
BOX = (0.05, 0.25, 0.5, 0.75, 0.95)
# Distance: label, colour, dashes.
DISTANCES: dict[str, tuple[str, str, Any]] = {
    "arc_length": ("arc length", style.OURS, "-"),
    "chordal_f": ("chordal, Frobenius", style.SHADE, (0, (5, 1.5))),
    "projection_f": ("projection, Frobenius", style.PRINTED, (0, (1.5, 1.2))),
    "fubini_study": ("Fubini-Study", style.OURS, (0, (5, 1.2, 1.5, 1.2))),
    "chordal_2": ("chordal, 2-norm", style.SHADE, (0, (8, 2))),
    "projection_2": ("projection, 2-norm", style.PRINTED, (0, (3, 1, 1, 1, 1, 1))),
}
PRINTED_CUT = 17
LEAST_DRAWN = 1e-5


@style.styled
def distances_figure(distances: pd.DataFrame) -> Figure:
    """Draw Fig. 2.5: distributions above, boxes below, a column for each method.

    Parameters
    ----------
    distances : DataFrame
        Quantiles of the arc lengths: ``method, kind, share, distance_rad``.

    Returns
    -------
    Figure
        Boxes with whiskers from 5 % to 95 %.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 92.0)
    grid = figure.subplots(
        2, len(METHODS), sharex=True, sharey="row", height_ratios=(1.6, 1)
    )
    for column, (method, title) in enumerate(METHODS.items()):
        upper = grid[0, column]
        lower = grid[1, column]
        rows = distances[distances["method"] == method]
        for place, (kind, (label, colour, dash)) in enumerate(KINDS.items()):
            of_kind = rows[rows["kind"] == kind].set_index("share")["distance_rad"]
            upper.plot(
                of_kind, of_kind.index, color=colour, linestyle=dash, label=label
            )
            values = [_at(of_kind, share) for share in BOX]
            style.box(
                lower, place, values, colour, widths=0.55, orientation="horizontal"
            )
        upper.set_title(title, loc="left")
        upper.set_ylim(0, 1.02)
        upper.grid(axis="x")
        lower.grid(axis="x")
        style.name_rows(lower, [label for label, _, _ in KINDS.values()])
    grid[0, 0].set_ylabel("cumulative share")
    grid[1, 1].set_xlabel("arc-length distance (rad)")
    style.lettered(figure, grid[0], ncols=4)
    return figure


def _at(quantiles: pd.Series, share: float) -> float:
    """Return the quantile at a share, between those of the index."""
    shares = quantiles.index.to_numpy(float)
    return float(np.interp(share, shares, quantiles.to_numpy(float)))


@style.styled
def spectrum_figure(spectrum: pd.DataFrame) -> Figure:
    """Draw the sd along each principal component of the pairs, noise, and truth.

    Parameters
    ----------
    spectrum : DataFrame
        One row per component: ``component, sd, noise_sd, true_sd``, in units.

    Returns
    -------
    Figure
        One panel, logarithmic; values below 1e-5 stand at the bottom.
    """
    figure = style.paper_figure(style.WIDEST_PANEL_MM, 76.0)
    axes = figure.subplots()
    axes.set_yscale("log")
    n = len(spectrum)
    axes.axvspan(n - 1.5, n + 0.5, color=style.GREY, alpha=0.2, linewidth=0)
    x = spectrum["component"]
    lines = {
        "noise_sd": ("noise in this component", style.SHADE, (0, (4, 2)), ""),
        "true_sd": ("the same landings without noise", style.PRINTED, "-", "."),
        "sd": ("measured", style.OURS, "", "o"),
    }
    for name, (label, colour, dash, marker) in lines.items():
        shown = spectrum[name].clip(lower=LEAST_DRAWN)
        axes.plot(
            x,
            shown,
            color=colour,
            linestyle=dash or "none",
            marker=marker,
            markersize=4,
            label=label,
        )
    axes.axvline(PRINTED_CUT + 0.5, color=style.INK, linewidth=0.8)
    style.note(
        axes, "17 leading | 17 small", (PRINTED_CUT + 0.5, 1.0), (0, -2), ha="center",
        bbox=style.ON_WHITE,
    )  # fmt: skip
    axes.text(
        n - 0.5, 1.5e-4, "the two sections", rotation=90, ha="center", va="center"
    )
    axes.set_xlim(0.3, n + 0.5)
    axes.set_ylim(0.6 * LEAST_DRAWN, 2.0)
    axes.set_xticks([1, 5, 10, 15, 20, 25, 30, n])
    axes.set_xlabel("principal component of the pairs of states")
    axes.set_ylabel("standard deviation (units)")
    axes.legend(loc="lower left")
    axes.set_title(
        "Two components are the sections; the cut at 17 lies in the noise", loc="left"
    )
    return figure


@style.styled
def sensitivity_figure(sensitivity: pd.DataFrame) -> Figure:
    """Draw how six distances between equal subspaces respond to noise.

    Parameters
    ----------
    sensitivity : DataFrame
        From `hopdata.maps.distances.noise_sensitivity`, with a column ``seed``.

    Returns
    -------
    Figure
        Sizes, and how clearly a doubling of the noise is seen.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 72.0)
    panels = figure.subplots(1, 2)
    labels = {
        "mean_distance": "distance (rad, or 1)",
        "doubling": "change as noise doubles (sd)",
    }
    for axes, (column, label) in zip(panels, labels.items(), strict=True):
        _draw_response(axes, sensitivity, column)
        axes.set_xscale("log")
        axes.set_xlabel("sd of the noise on each entry")
        axes.set_ylabel(label)
        axes.xaxis.set_major_locator(ticker.FixedLocator([0.01, 0.02, 0.05, 0.1, 0.2]))
        style.plain_numbers(axes.xaxis)
        axes.grid(axis="y")
    panels[0].set_title("how far apart equal subspaces look", loc="left")
    panels[1].set_title("how clearly the noise is seen", loc="left")
    style.lettered(figure, panels, ncols=3)
    return figure


def _draw_response(axes: Axes, sensitivity: pd.DataFrame, column: str) -> None:
    for name, (label, colour, dash) in DISTANCES.items():
        rows = sensitivity[sensitivity["distance"] == name].dropna(subset=[column])
        middle = rows.groupby("noise_sd")[column].median()
        axes.plot(
            middle.index,
            middle,
            color=colour,
            linestyle=dash,
            marker="o",
            markersize=2.5,
            label=label,
        )
