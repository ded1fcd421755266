"""Size and power of the verdict: false alarms, differences found, and the sizes estimated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    INK,
    ORANGE,
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

SAME = "C1"
# kind of control: what the reader sees, colour, marker.
CONTROLS = {
    "kappa": ("coupled forces, κ", VERMILION, "s"),
    "eps": ("rigid impulses, ε", GREEN, "^"),
    "tau": ("contact by velocity, τ", ORANGE, "D"),
}
LEVEL, WANTED_POWER = 0.05, 0.8
_TOLERATED = (0.02, 0.08)


@styled
def verdict_power_figure(table: pd.DataFrame) -> Figure:
    """Draw the shares of simulated studies in which a difference is found, and its size.

    Parameters
    ----------
    table : DataFrame
        One row a condition: ``condition`` (those that begin with ``C1`` have no difference),
        ``strength``, ``true_effect``, ``found_share`` with its interval ``found_low`` and
        ``found_high``, ``effect_mean`` and ``effect_sd``.

    Returns
    -------
    Figure
        (a) False alarms of landings that are C1; (b) power by true difference; (c) estimated
        over true difference. Bars are 95 % intervals in (a) and (b), standard deviations in (c).
    """
    if table.empty:
        return message_figure("No simulated studies to show.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 66.0)
    left, middle, right = figure.subplots(1, 3)
    same = table["condition"].str.startswith(SAME)
    _draw_alarms(left, table[same])
    none = table[table["condition"] == SAME]
    for kind in CONTROLS:
        rows = table[table["condition"] == kind]
        if len(rows):
            _draw_power(middle, rows, kind)
            _draw_sizes(right, rows, kind)
    _label_power(middle, none)
    _label_sizes(right, table[~same])
    figure.legend(*middle.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    for axes, name in zip((left, middle, right), "abc", strict=True):
        letter(axes, name)
    return figure


def _draw_alarms(axes: Axes, rows: pd.DataFrame) -> None:
    places = np.arange(len(rows))[::-1]
    share = rows["found_share"].to_numpy()
    bars = np.abs(rows[["found_low", "found_high"]].to_numpy().T - share)
    axes.axvspan(*(100 * edge for edge in _TOLERATED), color=GREY, alpha=0.2, linewidth=0)
    axes.axvline(100 * LEVEL, color=INK, linewidth=0.6)
    axes.errorbar(100 * share, places, xerr=100 * bars, fmt="o", color=BLUE, markersize=3)
    names = [str(name).removeprefix(SAME).strip() or "hopper" for name in rows["condition"]]
    axes.set_yticks(places, names)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("false alarms (%)\ngrey: 2 to 8 %, line: nominal")


def _draw_power(axes: Axes, rows: pd.DataFrame, kind: str) -> None:
    label, colour, marker = CONTROLS[kind]
    ordered = rows.sort_values("true_effect")
    share = ordered["found_share"].to_numpy()
    bars = np.abs(ordered[["found_low", "found_high"]].to_numpy().T - share)
    axes.errorbar(
        ordered["true_effect"], 100 * share, yerr=100 * bars,
        color=colour, marker=marker, markersize=3, label=label,
    )  # fmt: skip


def _label_power(axes: Axes, none: pd.DataFrame) -> None:
    if len(none):
        axes.plot([0.0], 100 * none["found_share"], "o", color=BLUE, markersize=3, label="hopper")
    axes.axhline(100 * WANTED_POWER, color=INK, linewidth=0.6, linestyle=(0, (4, 2)))
    axes.set_ylim(-3.0, 103.0)
    axes.set_xlabel("true difference (share of the map)")
    axes.set_ylabel("studies that find a difference (%)")


def _draw_sizes(axes: Axes, rows: pd.DataFrame, kind: str) -> None:
    _, colour, marker = CONTROLS[kind]
    axes.errorbar(
        rows["true_effect"], rows["effect_mean"], yerr=rows["effect_sd"],
        fmt=marker, color=colour, markersize=3,
    )  # fmt: skip


def _label_sizes(axes: Axes, rows: pd.DataFrame) -> None:
    most = float(rows[["true_effect", "effect_mean"]].max().max()) if len(rows) else 1.0
    axes.plot([0.0, most], [0.0, most], color=GREY, linewidth=0.8, zorder=0)
    axes.set_xlabel("true difference (share of the map)")
    axes.set_ylabel("estimated difference")
