"""Figure 2.5: how far apart the constraint subspaces of the mode schedules are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.errors import chosen
from hopdata.figures import style

# kind: what the reader sees, its colour, its line style.
KINDS: dict[str, tuple[str, str, Any]] = {
    "in_class": ("in-class", style.BLUE, "-"),
    "cross_class": ("cross-class", style.VERMILION, (0, (5, 1.5))),
    "noised_identity": ("noised identity", style.GREEN, (0, (1.5, 1.2))),
    "random": ("random", style.PURPLE, (0, (5, 1.2, 1.5, 1.2))),
}
QUANTILES = ("q05", "q25", "median", "q75", "q95")
MOST_STEPS = 2000


@style.styled
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
        return style.message_figure("No distances: no mode schedule holds enough touchdowns.")
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, 92.0)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
    _draw_study(upper, lower, distances, summary)
    style.letters((upper, lower))
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _draw_study(upper: Axes, lower: Axes, distances: pd.DataFrame, summary: pd.DataFrame) -> None:
    """Draw the distributions above and the boxes below, and name the axes."""
    boxes = {str(row["kind"]): row for row in summary.to_dict("records")}
    for place, kind in enumerate(KINDS):
        sample = distances.loc[distances["kind"] == kind, "distance_rad"].dropna().to_numpy()
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


def _draw_box(axes: Axes, place: int, kind: str, row: Any) -> None:
    """Draw the box of one kind from its row of the summary."""
    _, colour, _ = KINDS[kind]
    values = [float(row.get(quantile, np.nan)) for quantile in QUANTILES]
    if not np.all(np.isfinite(values)):
        axes.text(
            0.5, place, "none", transform=axes.get_yaxis_transform(), ha="center", va="center",
            color=style.GREY,
        )  # fmt: skip
        return
    style.box(axes, place, values, colour, widths=0.55, orientation="horizontal")


# Figure 2.5 for a landing that is C1 and for one that is not, side by side, with both verdicts.


@style.styled
def both_sides_figure(*content: Any, names: Sequence[str]) -> Figure:
    """Draw the distances between subspaces of several studies, each above its verdict.

    Parameters
    ----------
    content
        Of each study in turn: the two tables of `distances_figure`, and its ``verdict.json``.
    names
        Of the studies, as titles.

    Returns
    -------
    Figure
        One column a study: distributions, boxes, and the verdict's conclusion with its size.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 96.0)
    rows = figure.subplots(
        2, len(names), sharex=True, sharey="row", height_ratios=(1.7, 1), squeeze=False
    )
    for column, name in enumerate(names):
        distances, summary, verdict = content[3 * column : 3 * column + 3]
        upper, lower = rows[0, column], rows[1, column]
        _draw_study(upper, lower, distances, summary)
        upper.set_title(f"{name}\nverdict: {_in_short(verdict)}", loc="left")
        style.letter(upper, "abcdef"[column])
    for axes in rows[:, 1:].ravel():
        axes.set_ylabel("")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _in_short(verdict: Mapping[str, Any]) -> str:
    effect = verdict["effect"]
    if effect is None:
        return str(verdict["conclusion"])
    sizes = {
        "different": f"different by {effect['estimate']:.2g}",
        "no difference": f"no difference above {effect['upper_bound']:.2g}",
        "cannot tell": "these data cannot tell",
    }
    return chosen("conclusion", verdict["conclusion"], sizes)


# How distances between subspaces answer to noise, and the readings of "a SNR of 10".

# distance: what the reader sees, its colour, its line style.
SERIES: dict[str, tuple[str, str, Any]] = {
    "arc_length": ("arc length", style.VERMILION, "-"),
    "chordal_f": ("chordal F (Procrustes)", style.BLUE, (0, (5, 1.5))),
    "projection_f": ("projection F (chordal)", style.GREEN, (0, (1.5, 1.2))),
    "fubini_study": ("Fubini-Study", style.PURPLE, (0, (5, 1.2, 1.5, 1.2))),
    "chordal_2": ("chordal 2-norm", style.ORANGE, (0, (8, 2))),
    "projection_2": ("projection 2-norm", style.SKY, (0, (3, 1, 1, 1, 1, 1))),
}
RATIOS = {"amplitude": "1/10 of", "power": "10 dB below"}
SIGNALS = {"entry": "an entry", "matrix": "the norm"}
MATRICES = {2: "both noised", 1: "one noised"}
SENSITIVITY_KINDS = {"in_class": "in-class", "cross_class": "cross-class", "random": "random"}


@style.styled
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
        return style.message_figure("No distances: their sensitivity to noise was not studied.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 118.0)
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
    style.letters((left, right, lower))
    upper.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _lines(axes: Axes, table: pd.DataFrame, column: str) -> None:
    for name, (label, colour, dash) in SERIES.items():
        part = table[table["distance"] == name].dropna(subset=[column])
        axes.plot(part["noise_sd"], part[column], color=colour, linestyle=dash, label=label)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)
    axes.axvline(0.1, color=style.GREY, linewidth=0.6, zorder=0)
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
    return [(SENSITIVITY_KINDS[str(row["kind"])], row, False) for row in rows]


def _boxes(axes: Axes, rows: list[tuple[str, Any, bool]]) -> None:
    for place, (_, row, printed) in enumerate(rows):
        values = [float(row[quantile]) for quantile in QUANTILES]
        if not np.all(np.isfinite(values)):
            continue
        study = str(row["kind"]) in ("in_class", "cross_class")
        colour = style.VERMILION if printed else style.BLUE if study else "white"
        style.box(axes, place, values, colour, widths=0.6, alpha=0.7, orientation="horizontal")
    style.name_rows(axes, [label for label, _, _ in rows])
    for tick, (_, _, printed) in zip(axes.get_yticklabels(), rows, strict=True):
        tick.set_fontweight("bold" if printed else "normal")
    axes.set_xlim(left=0)
    axes.grid(axis="x")
