"""The verdict as one picture: the answer, its certainty, and what it means for a landing."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from hopdata.figures import style
from hopdata.figures.schedule import ARROW

ROW_MM, MEMBER_MM, TITLE_MM = 58.0, 4.2, 3.0
SAID_WIDTH = 90  # characters of a line of the verdict in words
LINE_MM = 3.0  # height of such a line
ASKED = "difference between the maps of the contact orders"
# Quantity that decides the answer: its axis label.
AXES = {
    "effect": f"{ASKED}\n(% of the map; 0: one and the same map)",
    "jump": "jump of the outcome between contact orders\n(% of what it varies; 0: none)",
}
# Conclusion: a short answer, and its colour.
ANSWERS = {
    "different": ("Different maps", style.VERMILION),
    "no difference": ("One smooth map", style.GREEN),
    "cannot tell": ("Cannot tell", style.GREY),
}
# An interval longer than this multiple of everything else is cut, and ends in an
# arrowhead.
LONGEST = 3.0


@style.styled
def verdict_figure(
    verdict: Mapping[str, Any],
    touchdowns: pd.DataFrame,
    truth: pd.DataFrame | None = None,
) -> Figure:
    """Draw the verdict on a study.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``; see docs/verdict.md.
    touchdowns : DataFrame
        The touchdown table; its two most common orders of contact are drawn.
    truth : DataFrame, optional
        The ``true_effect`` of a simulated study, marked on the axis.

    Returns
    -------
    Figure
        (a) The difference and its uncertainty. (b) What it means for two landings. The
        verdict in words is below. If a study has no answer, the words are beside (b).
    """
    if verdict.get("effect") is None and _used(touchdowns).empty:
        return style.message_figure(
            _said(verdict, SAID_WIDTH), width_mm=style.DOUBLE_COLUMN_MM
        )
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, _height_mm(verdict))
    true = None if truth is None or truth.empty else float(truth["true_effect"].iloc[0])
    top = max(_top(verdict), 112.0 * (true or 0.0))
    left = _draw_row(figure, verdict, touchdowns, top)
    if true is not None:
        left.plot(
            100.0 * true,
            0.0,
            "^",
            color=style.BLUE,
            markersize=5,
            clip_on=False,
            zorder=5,
        )
        words = f"true: {_percent(true)}, estimated: {_percent(verdict['effect']['estimate'])}"
        _write(left, words, (100.0 * true, TRUE_ROW), style.BLUE, top)
    return figure


@style.styled
def verdicts_figure(*content: Any, names: Sequence[str]) -> Figure:
    """Draw the verdicts of several studies below each other, on one scale.

    Parameters
    ----------
    content
        Verdict and touchdown table of each study in turn, as for `verdict_figure`.
    names : sequence of str
        Titles of the studies.
    """
    rows = list(zip(content[::2], content[1::2], names, strict=True))
    heights = [_height_mm(verdict) + TITLE_MM for verdict, _, _ in rows]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, sum(heights))
    top = max(_top(verdict) for verdict, _, _ in rows)
    parts = figure.subfigures(
        len(rows), 1, squeeze=False, height_ratios=heights
    ).ravel()
    for part, (verdict, touchdowns, name) in zip(parts, rows, strict=True):
        part.suptitle(style.label_of(name), fontsize=style.pt(8), x=0.01, ha="left")
        _draw_row(part, verdict, touchdowns, top)
    return figure


def _height_mm(verdict: Mapping[str, Any]) -> float:
    """Return the height of a row of two plots with the verdict in words below them."""
    n_lines = _said(verdict, SAID_WIDTH).count("\n") + 1
    return ROW_MM + LINE_MM * n_lines


def _draw_row(
    figure: Figure | SubFigure,
    verdict: Mapping[str, Any],
    touchdowns: pd.DataFrame,
    top: float,
) -> Axes:
    """Draw size and landings side by side; without an answer, the reason replaces the size."""
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_landings(right, verdict["conclusion"], touchdowns)
    if verdict.get("effect") is None:
        left.set_title(in_short(verdict), fontsize=style.pt(10), fontweight="bold")
        left.text(0.5, 0.55, _said(verdict, 48), ha="center", va="center")
        left.set_axis_off()
        return left
    _draw_size(left, verdict, top)
    figure.supxlabel(_said(verdict, SAID_WIDTH), fontsize=style.pt(7))
    style.letters((left, right))
    return left


def _decided(verdict: Mapping[str, Any]) -> str:
    """Return what decides the answer: the difference of the maps, or a jump of the outcome."""
    return str(verdict.get("decided_by", "effect"))


def _top(verdict: Mapping[str, Any]) -> float:
    """Return the upper end of the axis, per cent: above all points and the end of the interval."""
    effect = verdict[_decided(verdict)]
    if effect is None:
        return 0.0
    most = max(verdict["margin"], effect["estimate"], min(effect["detectable"], 1.0))
    return 112.0 * max(most, min(_end(verdict["conclusion"], effect), LONGEST * most))


def _end(conclusion: str, effect: Mapping[str, Any]) -> float:
    """Return the end of what is not excluded: of the interval if different, else the bound."""
    return float(effect["high" if conclusion == "different" else "upper_bound"])


# Rows of the plot of the size, from the axis (0) upwards. Each text has a row of its
# own, as high as two of its lines, so that no text can cover another wherever the data
# place them.
TRUE_ROW, SEEN_TEXT_ROW, SEEN_ROW, BAR_ROW, BAR_TEXT_ROW, NONE_ROW = (
    0.13,
    0.6,
    1.0,
    1.4,
    1.82,
    2.4,
)
HIGHEST_ROW = 2.65


def _draw_size(axes: Axes, verdict: Mapping[str, Any], top: float) -> None:
    """Draw what is known of the difference above an axis that begins at zero."""
    effect = verdict[_decided(verdict)]
    colour = ANSWERS[verdict["conclusion"]][1]
    look: Any = {"fontsize": style.pt(9), "fontweight": "bold", "loc": "left"}
    axes.set_title(in_short(verdict), color=colour, **look)
    low = 100.0 * effect["low"]
    end = 100.0 * _end(verdict["conclusion"], effect)
    _draw_interval(axes, verdict, (low, end), colour, top)
    if low <= 0:  # a difference that was found does not count as none
        margin = 100.0 * verdict["margin"]
        axes.axvline(margin, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
        none = f"smaller than {margin:g} %\ncounts as none"
        _write(axes, none, (margin, NONE_ROW), style.INK, top)
    _draw_seen(axes, verdict, top)
    axes.set_ylim(0.0, HIGHEST_ROW)
    axes.set_xlim(0.0, top)
    axes.set_yticks([])
    axes.spines["left"].set_linewidth(2.0)
    axes.set_xlabel(AXES[_decided(verdict)])


def _draw_interval(
    axes: Axes,
    verdict: Mapping[str, Any],
    interval: tuple[float, float],
    colour: str,
    top: float,
) -> None:
    """Draw the interval, per cent, as a bar; if it is cut, the bar ends in an arrowhead."""
    low, end = interval
    effect = verdict[_decided(verdict)]
    sure = f"{100 * float(verdict['confidence']):g} %"
    bar: Any = {"color": colour, "linewidth": 7, "solid_capstyle": "butt"}
    axes.plot([low, min(end, top)], [BAR_ROW, BAR_ROW], **bar)
    if end > top:
        axes.plot(top, BAR_ROW, ">", color=colour, markersize=9, clip_on=False)
    if low > 0:
        axes.plot(100.0 * effect["estimate"], BAR_ROW, "|", color="white", ms=7, mew=2)
        words = f"{sure} interval"
    else:
        words = f"not excluded by this study\n(at {sure} confidence)"
    _write(axes, words, (low, BAR_TEXT_ROW), colour, top)


def _draw_seen(axes: Axes, verdict: Mapping[str, Any], top: float) -> None:
    """Draw from where on such studies would have found a difference."""
    seen = 100.0 * verdict[_decided(verdict)]["detectable"]
    power = f"{100 * float(verdict['power']):g} %"
    words = "nothing could have been seen"
    if seen < top:
        words = f"from here on, {power} of\nsuch studies find a difference"
        axes.plot([seen, top], [SEEN_ROW, SEEN_ROW], color=style.PURPLE, linewidth=1.2)
        start: Any = {"color": style.PURPLE, "markersize": 8, "markeredgewidth": 1.5}
        axes.plot(seen, SEEN_ROW, "|", **start)
        axes.plot(top, SEEN_ROW, ">", color=style.PURPLE, markersize=4, clip_on=False)
    _write(axes, words, (min(seen, top), SEEN_TEXT_ROW), style.PURPLE, top)


def _write(
    axes: Axes, words: str, at: tuple[float, float], colour: str, top: float
) -> None:
    """Write in a row beside a place, on the side with more room."""
    left = at[0] < 0.5 * top
    look = {"ha": "left" if left else "right", "va": "center", "color": colour}
    style.note(
        axes, words, at, (3 if left else -3, 0), fontsize=7, bbox=style.ON_WHITE, **look
    )


def in_short(verdict: Mapping[str, Any]) -> str:
    """Return the answer in a few words, with its size."""
    answer, effect = ANSWERS[verdict["conclusion"]][0], verdict[_decided(verdict)]
    if effect is None:
        return answer
    size, low, high, bound = (
        _percent(effect[key]) for key in ("estimate", "low", "high", "upper_bound")
    )
    by = {"effect": "by", "jump": "a jump of"}[_decided(verdict)]
    interval = f"{low.removesuffix(PER_CENT)} to {high}"
    sizes = {
        "different": f"{by} {size} ({interval})",
        "no difference": f"no difference above {bound}",
        "cannot tell": f"up to {bound} possible",
    }
    return f"{answer}: {sizes[verdict['conclusion']]}"


PER_CENT = "\u00a0%"  # the space keeps number and sign on one line


def _percent(share: float) -> str:
    return f"{float(f'{100 * share:.2g}'):g}{PER_CENT}"


def _said(verdict: Mapping[str, Any], longest: int) -> str:
    """Return the sentence and the outlook, wrapped to as few, evenly long lines as possible."""
    said = f"{verdict['sentence']} {verdict.get('outlook', '')}".strip().replace(
        " %", PER_CENT
    )
    filled = [textwrap.wrap(said, width) for width in range(20, longest + 1)]
    return "\n".join(next(lines for lines in filled if len(lines) == len(filled[-1])))


# Drawing of a landing: feet that touch later are higher above the ground.
WIDTH, STEP, HIP, ROW = 3.2, 0.32, 1.7, 3.6
ORDINALS = ("1st", "2nd", "3rd", "4th", "5th", "6th")


def _used(touchdowns: pd.DataFrame) -> pd.Series:
    """Return the orders of the touchdowns used."""
    return touchdowns.loc[~touchdowns["excluded"].astype(bool), "schedule"].dropna()


def _draw_landings(axes: Axes, conclusion: str, touchdowns: pd.DataFrame) -> None:
    """Draw the two most common orders of contact, and the maps that follow from them."""
    counts = _used(touchdowns).value_counts()
    orders = [str(order).split(">") for order in counts.index[:2]]
    grounds = [-ROW * row for row in range(len(orders))]
    colour, levels = ANSWERS[conclusion][1], [ground + 0.9 for ground in grounds]
    for order, ground, level in zip(orders, grounds, levels, strict=True):
        _draw_landing(
            axes, [order.index(foot) for foot in sorted(order, key=int)], ground
        )
        number = int(counts[">".join(order)])
        name = f"feet {ARROW.join(order)}: {number} landing{'s' if number > 1 else ''}"
        axes.text(0.5 * WIDTH, ground - 0.65, name, ha="center", va="top")
        goal = level if conclusion == "different" else float(np.mean(levels))
        look = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.4}
        axes.annotate("", (6.0, goal), (WIDTH + 0.5, level), arrowprops=look)
    words = {
        "different": [f"map of\n{ARROW.join(order)}" for order in orders],
        "no difference": ["one map\nfor every order"],
        "cannot tell": ["one map,\nor several?"],
    }[conclusion]
    box = {"boxstyle": "round,pad=0.5", "facecolor": colour, "linewidth": 0}
    for row, text in enumerate(words):
        level = levels[row] if conclusion == "different" else float(np.mean(levels))
        axes.text(
            6.2, level, text, va="center", color="white", fontweight="bold", bbox=box
        )
    few = f"the 2 commonest of {len(counts)} orders; " if len(counts) > 2 else ""
    what = textwrap.fill(
        f"{few}map: from the state before a landing to the state after it", 50
    )
    axes.text(
        0.0, grounds[-1] - 1.6, what, va="top", color=style.INK, fontsize=style.pt(7)
    )
    axes.set_xlim(-0.3, 9.2)
    axes.set_ylim(grounds[-1] - 2.2, 2.2)
    axes.set_axis_off()


def _draw_landing(axes: Axes, ranks: Sequence[int], ground: float) -> None:
    """Draw a body above the ground on numbered legs; the foot of rank 0 touches first."""
    hip, body, size = (
        ground + HIP,
        [0.1, WIDTH - 0.1],
        style.pt(min(6.0, 24.0 / len(ranks))),
    )
    axes.plot([0.0, WIDTH], [ground, ground], color=style.INK, linewidth=1.0)
    axes.plot(body, [hip, hip], color=style.INK, linewidth=7, solid_capstyle="round")
    for number, rank in enumerate(ranks):
        place = 0.3 + (WIDTH - 0.6) * number / (len(ranks) - 1)
        foot, colour = (
            ground + STEP * rank * 2 / (len(ranks) - 1) + 0.09,
            style.foot_colour(number),
        )
        axes.plot([place, place], [foot, hip], color=colour, linewidth=1.6)
        axes.plot(place, foot, "o", color=colour, markersize=4)
        axes.text(
            place, ground - 0.1, ORDINALS[rank], ha="center", va="top", fontsize=size
        )
        axes.text(
            place, hip, f"{number + 1}", fontsize=style.pt(5), fontweight="bold", color="white",
            ha="center", va="center_baseline",
        )  # fmt: skip


# The verdicts of a group below each other: a forest plot.


@style.styled
def group_figure(group: Mapping[str, Any]) -> Figure:
    """Draw the sizes of all members with an answer, and the size of the group.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    """
    rows = [row for row in group["members"] if not row["reason"]]
    if not rows:
        return style.message_figure(group["sentence"], width_mm=style.DOUBLE_COLUMN_MM)
    effect = group["effect"]
    whole = (
        [{**effect, "name": "all", "conclusion": group["conclusion"]}] if effect else []
    )
    height = 18.0 + MEMBER_MM * (len(rows) + 1.5 * len(whole))
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height)
    axes = figure.subplots()
    sizes = [row["estimate"] for row in rows if "jump_low" not in row] + [
        group["margin"]
    ]
    ends = [
        0.0 if "jump_low" in row else _end(row["conclusion"], row)
        for row in (*rows, *whole)
    ]
    top = min(max(ends), LONGEST * max(*sizes, sorted(ends)[len(ends) // 2]))
    places = [*range(len(rows)), *([len(rows) + 0.5] if whole else [])]
    for y, row, end in zip(places, (*rows, *whole), ends, strict=True):
        of_all = y == len(rows) + 0.5
        look: dict[str, Any] = {
            "color": ANSWERS[row["conclusion"]][1],
            "clip_on": False,
        }
        if "jump_low" in row:  # a jump is not a fraction of the map
            size, low, high = (
                _percent(row[f"jump_{one}"]) for one in ("estimate", "low", "high")
            )
            words = f"the outcome jumps, by {size} ({low} to {high}) of what it varies"
            white = {"va": "center", "color": look["color"], "bbox": style.ON_WHITE}
            style.note(axes, words, (0.0, y), (4, 0), **white)
            continue
        ends_shown = [100 * row["low"], 100 * min(end, top)]
        axes.plot(ends_shown, [y, y], linewidth=4.0 if of_all else 1.5, **look)
        axes.plot(
            100 * row["estimate"], y, "D" if of_all else "s", markersize=5, **look
        )
        if end > top:
            axes.plot(100 * top, y, ">", markersize=4, **look)
    axes.axvline(
        100 * group["margin"], color=style.INK, linewidth=0.8, linestyle=(0, (4, 2))
    )
    shown = [
        (row.get("subject", row["name"]), row.get("condition"))
        for row in (*rows, *whole)
    ]
    axes.set_yticks(
        places, [style.label_of(", ".join(filter(None, one))) for one in shown]
    )
    axes.set_ylim(places[-1] + 0.8, -0.8)
    axes.set_xlim(0.0, 102.0 * max(top, group["margin"]))
    axes.set_xlabel(f"{ASKED} (% of the map)")
    return figure


# How many landings a study needs.


@style.styled
def plan_figure(
    needed: Mapping[float, int], pilot: tuple[int, float], power: float
) -> Figure:
    """Draw the number of landings needed to detect a difference.

    Parameters
    ----------
    needed : mapping
        Number of landings by difference, as a fraction of the map.
    pilot : (int, float)
        Landings of the pilot, and the difference it can detect.
    power : float
        Fraction of studies in which a difference is to be found.
    """
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, 60.0)
    axes = figure.subplots()
    axes.loglog(
        [100.0 * size for size in needed], list(needed.values()), color=style.BLUE
    )
    axes.plot(100.0 * pilot[1], pilot[0], "o", color=style.VERMILION, markersize=5)
    style.note(
        axes, "pilot", (100.0 * pilot[1], pilot[0]), (5, 4), color=style.VERMILION
    )
    for axis in (axes.xaxis, axes.yaxis):
        style.plain_numbers(axis)
    axes.set_xticks([100.0 * size for size in needed])
    axes.set_xlabel("difference between the maps (% of the map)")
    axes.set_ylabel(f"landings that show it\nin {100 * power:g} % of studies")
    axes.grid(True)
    return figure
