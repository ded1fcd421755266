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
    INK,
    PURPLE,
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
DETECTABLE: Mapping[str, Any] = {"color": PURPLE, "linestyle": (0, (1.5, 1.2)), "linewidth": 1.4}
# An interval longer than this many times all else is cut and ends in an arrowhead.
LONGEST = 3.0
SENTENCE_WIDTH = 100


@styled
def verdict_figure(verdict: Mapping[str, Any], windows: pd.DataFrame) -> Figure:
    """Draw the verdict on a study.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``; see docs/verdict.md.
    windows : DataFrame
        One row a window of contact spread: ``window`` (share of the landings),
        ``kinks, kinks_low, kinks_high`` (relative differences; NaN where not known) and ``chosen``.

    Returns
    -------
    Figure
        (a) the jump at zero spread found in each window, (b) size and limits of the difference;
        the verdict in words beneath. A study without an answer has the words alone.
    """
    if verdict.get("effect") is None or windows.empty:
        return message_figure(_wrapped(verdict), width_mm=DOUBLE_COLUMN_MM)
    figure = paper_figure(DOUBLE_COLUMN_MM, 62.0)
    left, right = figure.subplots(1, 2)
    rows = windows.sort_values("window").to_dict("records")
    top = _top(verdict, rows)
    _draw_kinks(left, rows, top)
    _draw_limits(left, verdict)
    _draw_size(right, verdict, top)
    figure.supxlabel(_wrapped(verdict), fontsize=8, fontweight="bold")
    letter(left, "a")
    letter(right, "b")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _number(mapping: Mapping[Any, Any], key: str) -> float:
    value = mapping.get(key)
    return np.nan if value is None else float(value)


def _top(verdict: Mapping[str, Any], rows: list[dict[Any, Any]]) -> float:
    """Upper end of the axes of relative difference: all points, and the intervals that count."""
    effect = verdict["effect"]
    points = [_number(row, "kinks") for row in rows]
    points += [
        _number(verdict, "margin"),
        *(_number(effect, k) for k in ("estimate", "detectable")),
    ]
    ends = [_number(effect, "high"), _number(effect, "upper_bound")]
    most = float(np.nanmax(points))
    return 1.12 * min(max(most, float(np.nanmax([*ends, most]))), LONGEST * most)


def _draw_kinks(axes: Axes, rows: list[dict[Any, Any]], top: float) -> None:
    """Draw the jump of the derivative at zero spread, a place for each window."""
    for place, row in enumerate(rows):
        chosen = bool(row["chosen"])
        low, high = _number(row, "kinks_low"), _number(row, "kinks_high")
        strength: dict[str, Any] = {"color": BLUE, "alpha": 1.0 if chosen else 0.55}
        axes.plot(
            [place, place], [low, min(high, top)], linewidth=2.4 if chosen else 1.0, **strength
        )
        if high > top:
            axes.plot(place, top, marker="^", clip_on=False, markersize=4, **strength)
        axes.plot(
            place,
            _number(row, "kinks"),
            marker="s",
            linestyle="",
            markersize=6 if chosen else 4,
            markerfacecolor=BLUE if chosen else "white",
            clip_on=False,
            zorder=3,
            label="jump of the derivative" if chosen else None,
            **strength,
        )
    axes.set_xticks(range(len(rows)), [f"{100 * float(row['window']):.0f}" for row in rows])
    axes.get_xticklabels()[[bool(row["chosen"]) for row in rows].index(True)].set_fontweight("bold")
    axes.set_xlim(-0.6, len(rows) - 0.4)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("window: touchdowns used (%)")
    axes.set_ylabel(DIFFERENCE)


def _draw_limits(axes: Axes, verdict: Mapping[str, Any]) -> None:
    seen, label = _number(verdict["effect"], "detectable"), f"detectable{_with_power(verdict)}"
    axes.axhline(_number(verdict, "margin"), zorder=1, label="margin to exclude", **MARGIN)
    axes.axhline(seen, zorder=1, label=label, **DETECTABLE)


def _with_power(verdict: Mapping[str, Any]) -> str:
    power = verdict.get("power")
    return "" if power is None else f" with {100 * float(power):g} % power"


def _draw_size(axes: Axes, verdict: Mapping[str, Any], top: float) -> None:
    """Draw interval, excluded and detectable differences, one below the other."""
    effect = verdict["effect"]
    sure = f"{100 * float(verdict['confidence']):g} %"
    low, high = _number(effect, "low"), _number(effect, "high")
    bound, seen = _number(effect, "upper_bound"), _number(effect, "detectable")
    estimate = _number(effect, "estimate")
    axes.plot([low, min(high, top)], [0, 0], color=BLUE, linewidth=2.4)
    axes.plot(estimate, 0, color=BLUE, marker="s", markersize=6, clip_on=False)
    for place, start, colour in ((1, bound, INK), (2, seen, PURPLE)):
        if start < top:
            axes.plot([start, top], [place, place], color=colour, linewidth=1.6)
            axes.plot(start, place, color=colour, marker="|", markersize=9, markeredgewidth=1.6)
            axes.plot(top, place, color=colour, marker=">", markersize=4, clip_on=False)
    axes.axvline(_number(verdict, "margin"), zorder=1, **MARGIN)
    labels = (
        f"estimate, two-sided {sure}\n{estimate:.2g} ({low:.2g} to {high:.2g})",
        f"excluded, one-sided {sure}\nabove {bound:.2g}",
        f"random kinds of kinks found\nfrom {seen:.2g}{_with_power(verdict)}",
    )
    axes.set_yticks(range(3), labels)
    axes.set_ylim(2.6, -0.6)
    axes.set_xlim(0.0, top)
    axes.tick_params(axis="y", length=0, pad=6)
    axes.set_xlabel(DIFFERENCE)


def _wrapped(verdict: Mapping[str, Any]) -> str:
    """Break the sentence into lines, but never within ``p = 0.05`` or ``95 %``."""
    sentence = str(verdict["sentence"])
    for sign in ("=", "<="):
        sentence = sentence.replace(f" {sign} ", f"\u00a0{sign}\u00a0")
    sentence = sentence.replace("<=", "\u2264").replace(" %", "\u00a0%")
    return textwrap.fill(sentence, SENTENCE_WIDTH)
