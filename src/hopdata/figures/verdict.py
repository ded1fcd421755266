"""The verdict as one picture: how different the maps are, how sure that is, what could be seen."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
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

DIFFERENCE = "difference (share of the map)"
MARGIN: Mapping[str, Any] = {"color": GREEN, "linestyle": (0, (5, 1.5)), "linewidth": 1.2}
# An interval longer than this many times all else is cut and ends in an arrowhead.
LONGEST = 3.0
SENTENCE_WIDTH = 100


@styled
def verdict_figure(verdict: Mapping[str, Any]) -> Figure:
    """Draw the verdict on a study.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``; see docs/verdict.md.

    Returns
    -------
    Figure
        The difference with its interval on an axis that begins at zero, the margin, what is
        excluded and what could be seen; the verdict in words beneath. A study without an answer has
        the words alone.
    """
    effect = verdict.get("effect")
    if effect is None:
        return message_figure(_wrapped(verdict), width_mm=DOUBLE_COLUMN_MM)
    sizes = {key: float(effect[key]) for key in ("estimate", "low", "high")}
    bound, seen, margin = effect["upper_bound"], effect["detectable"], verdict["margin"]
    most = max(sizes["estimate"], seen, margin)
    top = 1.12 * min(max(most, sizes["high"], bound), LONGEST * most)
    figure = paper_figure(DOUBLE_COLUMN_MM, 48.0)
    axes = figure.subplots()
    axes.plot([sizes["low"], min(sizes["high"], top)], [0, 0], color=BLUE, linewidth=2.4)
    if sizes["high"] > top:
        axes.plot(top, 0, color=BLUE, marker=">", markersize=4, clip_on=False)
    axes.plot(sizes["estimate"], 0, color=BLUE, marker="s", markersize=6, clip_on=False)
    for place, start, colour in ((1, bound, INK), (2, seen, PURPLE)):
        if start < top:
            axes.plot([start, top], [place, place], color=colour, linewidth=1.6)
            axes.plot(start, place, color=colour, marker="|", markersize=9, markeredgewidth=1.6)
            axes.plot(top, place, color=colour, marker=">", markersize=4, clip_on=False)
    axes.axvline(margin, zorder=1, label=f"margin to exclude, {margin:g}", **MARGIN)
    sure, low, high = f"{100 * verdict['confidence']:g} %", sizes["low"], sizes["high"]
    labels = (
        f"found, {sure} interval\n{sizes['estimate']:.2g} ({low:.2g} to {high:.2g})",
        f"excluded, one-sided {sure}\nabove {bound:.2g}",
        f"found in {100 * verdict['power']:g} % of such studies\nfrom {seen:.2g}",
    )
    axes.set_yticks(range(3), labels)
    axes.set_ylim(2.6, -0.6)
    axes.set_xlim(0.0, top)
    axes.tick_params(axis="y", length=0, pad=6)
    axes.set_xlabel(DIFFERENCE)
    figure.supxlabel(_wrapped(verdict), fontsize=8, fontweight="bold")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right")
    return figure


def _wrapped(verdict: Mapping[str, Any]) -> str:
    """Break the sentence into lines, but never within ``95 %``."""
    sentence = str(verdict["sentence"]).replace(" %", "\u00a0%")
    return textwrap.fill(sentence, SENTENCE_WIDTH)


# Size and power of the verdict: false alarms, differences found, and the sizes estimated.

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
        One row a condition and number of landings: ``condition`` (those that begin with ``C1`` have
        no difference), ``asked``, landings of a study, of which the most are shown,
        ``true_effect``, ``found_share`` with its interval ``found_low`` and
        ``found_high``, ``effect_mean`` and ``effect_sd``.

    Returns
    -------
    Figure
        (a) False alarms of landings that are C1; (b) power by true difference; (c) estimated
        over true difference. Bars are 95 % intervals in (a) and (b), standard deviations in (c).
    """
    if table.empty:
        return message_figure("No simulated studies to show.")
    table = table[table["asked"] == table["asked"].max()]
    figure = paper_figure(DOUBLE_COLUMN_MM, 66.0)
    left, middle, right = figure.subplots(1, 3)
    same = table["condition"].str.startswith(SAME)
    _draw_alarms(left, table[same])
    none = table[table["condition"] == SAME]
    for kind in CONTROLS:
        rows = table[table["condition"].str.startswith(f"{kind} ")]
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
