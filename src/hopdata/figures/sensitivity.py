"""How distances between subspaces answer to noise, and the readings of "a SNR of 10"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
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

# distance: what the reader sees, its colour, its line style.
SERIES: dict[str, tuple[str, str, Any]] = {
    "arc_length": ("arc length", VERMILION, "-"),
    "chordal_f": ("chordal F (Procrustes)", BLUE, (0, (5, 1.5))),
    "projection_f": ("projection F (chordal)", GREEN, (0, (1.5, 1.2))),
    "fubini_study": ("Fubini-Study", PURPLE, (0, (5, 1.2, 1.5, 1.2))),
    "chordal_2": ("chordal 2-norm", ORANGE, (0, (8, 2))),
    "projection_2": ("projection 2-norm", SKY, (0, (3, 1, 1, 1, 1, 1))),
}
QUANTILES = ("q05", "q25", "median", "q75", "q95")
RATIOS = {"amplitude": "1/10 of", "power": "10 dB below"}
SIGNALS = {"entry": "an entry", "matrix": "the norm"}
MATRICES = {2: "both noised", 1: "one noised"}
KINDS = {"in_class": "in-class", "cross_class": "cross-class", "random": "random"}


@styled
def sensitivity_figure(
    sensitivity: pd.DataFrame, readings: pd.DataFrame, measured: pd.DataFrame
) -> Figure:
    """Draw size and resolution of each distance by noise, and the arc lengths of each reading.

    Parameters
    ----------
    sensitivity : DataFrame
        One row a distance and level: ``distance``, ``noise_sd``, ``mean``, ``doubling``.
    readings : DataFrame
        One row a reading and one of random subspaces: ``kind``, ``ratio``, ``signal``, ``noised``,
        ``noise_sd``, ``printed`` and the quantiles ``q05, q25, median, q75, q95``, rad.
    measured : DataFrame
        One row a kind of distance of the study: ``kind`` and the same quantiles.

    Returns
    -------
    Figure
        Distance (a), and how well one value tells a level of noise from its double (b), by noise;
        arc lengths of the baselines in every reading and of the study (c), the printed one filled.
    """
    if sensitivity.empty or readings.empty:
        return message_figure("No distances: their sensitivity to noise was not studied.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 118.0)
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
    upper, below = parts
    left, right = upper.subplots(1, 2)
    lower = below.subplots()
    _lines(left, sensitivity, "mean")
    _lines(right, sensitivity, "doubling")
    left.set_ylabel("mean distance")
    right.set_ylabel("change by twice the noise (sd)")
    _boxes(lower, [*_reading_rows(readings), *_study_rows(measured, readings)])
    lower.set_xlabel("arc-length distance (rad)")
    for name, axes in zip("abc", (left, right, lower), strict=True):
        letter(axes, name)
    upper.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _lines(axes: Axes, table: pd.DataFrame, column: str) -> None:
    for name, (label, colour, dash) in SERIES.items():
        part = table[table["distance"] == name].dropna(subset=[column])
        axes.plot(part["noise_sd"], part[column], color=colour, linestyle=dash, label=label)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)
    axes.axvline(0.1, color=GREY, linewidth=0.6, zorder=0)
    axes.set_xlabel("sd of the noise on each entry")
    axes.grid(axis="y")


def _reading_rows(readings: pd.DataFrame) -> list[tuple[str, Any, bool]]:
    """Return label, quantiles and whether it is the printed one, of each reading by its noise."""
    rows = []
    for row in readings.sort_values("noise_sd", kind="stable").to_dict("records"):
        if row["kind"] == "random":
            continue
        level = f"{RATIOS[str(row['ratio'])]} {SIGNALS[str(row['signal'])]}"
        label = f"{level}, {MATRICES[int(row['noised'])]}"
        rows.append((label, row, bool(row["printed"])))
    return rows


def _study_rows(measured: pd.DataFrame, readings: pd.DataFrame) -> list[tuple[str, Any, bool]]:
    rows = measured[measured["kind"].isin(["in_class", "cross_class"])].to_dict("records")
    rows += readings[readings["kind"] == "random"].to_dict("records")
    return [(KINDS[str(row["kind"])], row, False) for row in rows]


def _boxes(axes: Axes, rows: list[tuple[str, Any, bool]]) -> None:
    for place, (_, row, printed) in enumerate(rows):
        values = [float(row[quantile]) for quantile in QUANTILES]
        if not np.all(np.isfinite(values)):
            continue
        study = str(row["kind"]) in ("in_class", "cross_class")
        colour = VERMILION if printed else BLUE if study else "white"
        axes.bxp(
            [dict(zip(("whislo", "q1", "med", "q3", "whishi"), values, strict=True))],
            positions=[place],
            widths=0.6,
            orientation="horizontal",
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": colour, "alpha": 0.7, "edgecolor": INK},
            medianprops={"color": INK, "linewidth": 1.2},
            whiskerprops={"color": INK, "linewidth": 0.8},
            capprops={"color": INK, "linewidth": 0.8},
            manage_ticks=False,
        )
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    for tick, (_, _, printed) in zip(axes.get_yticklabels(), rows, strict=True):
        tick.set_fontweight("bold" if printed else "normal")
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(left=0)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")
