"""The scaling study: what linear maps leave over as landings draw together, case by case."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    letter,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Name, strength and its column, colour and marker of each case, in the order of the legend.
CASES = {
    "hopper": ("hopper", "", BLUE, "o"),
    "coupling": ("coupled forces", "coupling", VERMILION, "s"),
    "impulse": ("rigid impulses", "impulse", GREEN, "^"),
    "delay": ("contact by velocity", "delay_s", ORANGE, "D"),
    "study": ("this study's control", "", PURPLE, "v"),
}
SYMBOLS = {"coupling": "κ = {:g}", "impulse": "ε = {:g}", "delay_s": "τ = {:g} s"}
PANELS = {
    "pooled_rms": "error of one map for all orders\n(rms, in sd of the outcomes)",
    "pooled_over_specialised": "MSE of one map\nover one for each order",
    "map_difference": "largest difference between\nthe maps of two orders (relative)",
}
SEEN = 1e-6  # an exact difference below this is zero


@styled
def scaling_study_figure(table: pd.DataFrame) -> Figure:
    """Draw three panels over the scale of the deviations, one line a case.

    Parameters
    ----------
    table : DataFrame
        As `hopdata.maps.truth.scaling.scaling_table` writes it.

    Returns
    -------
    Figure
        (a) Error of the pooled map, with its slope; (b) its mean square over that of the maps of
        the schedules; (c) largest difference between these, dashed that of the exact maps.
    """
    figure = paper_figure(DOUBLE_COLUMN_MM, 78.0)
    panels = figure.subplots(1, 3)
    cases = [case for case in CASES if (table["case"] == case).any()]
    for axes, (column, label), name in zip(panels, PANELS.items(), "abc", strict=True):
        for case in cases:
            _draw(axes, table[table["case"] == case], case, column)
        _label(axes, table, label)
        letter(axes, name)
    _draw_guides(panels[0], table)
    for case in cases:
        exact = float(table.loc[table["case"] == case, "exact_difference"].median())
        if exact > SEEN:
            panels[2].axhline(exact, color=CASES[case][2], linestyle=(0, (4, 2)), linewidth=0.8)
    panels[2].text(0.97, 0.03, "dashed: exact maps", transform=panels[2].transAxes, ha="right",
                   fontsize=6, color=GREY)  # fmt: skip
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside upper center",
        ncols=len(cases),
        frameon=False,
    )
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, case: str, column: str) -> None:
    name, strength, colour, marker = CASES[case]
    slope = float(rows["slope"].iloc[0])
    label = f"{name}, " + (
        f"slope {slope:.2f}" if np.isfinite(slope) else "not between the sections"
    )
    if strength:
        label = (
            f"{name}, {SYMBOLS[strength].format(rows[strength].iloc[0])}\n" + label[len(name) + 2 :]
        )
    axes.loglog(
        rows["scale"], rows[column], marker=marker, markersize=3.5, color=colour, label=label
    )


def _draw_guides(axes: Axes, table: pd.DataFrame) -> None:
    """Lines of slope 1 and 2, as a measure for the eye, below all curves."""
    scales = np.array([table["scale"].min(), table["scale"].max()])
    place = float(scales[1] ** 0.8 * scales[0] ** 0.2)
    for power, share in ((1, 1.0), (2, 0.3)):
        start = share * float(table["pooled_rms"].min())
        axes.plot(
            scales, start * (scales / scales[0]) ** power, color=GREY, linewidth=0.7, linestyle=":"
        )
        axes.annotate(
            f"slope {power}",
            xy=(place, start * (place / scales[0]) ** power),
            xytext=(4, -2),
            textcoords="offset points",
            va="top",
            fontsize=6,
            color=GREY,
        )


def _label(axes: Axes, table: pd.DataFrame, label: str) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    axes.xaxis.set_major_locator(FixedLocator(sorted(set(table["scale"]))))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _fraction(value)))
    axes.set_xlabel("scale of the deviations")
    axes.set_ylabel(label)
    axes.grid(axis="y", which="major")


def _fraction(value: float) -> str:
    """Write a scale as 1/n where it is one."""
    whole = round(1 / value)
    return f"1/{whole}" if whole > 1 and abs(whole * value - 1) < 1e-9 else f"{value:g}"
