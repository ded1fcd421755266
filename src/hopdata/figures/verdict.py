"""The verdict as a picture: the answer, its certainty, what it means for a landing."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from hopdata.errors import counted
from hopdata.feet import foot_names, foot_places
from hopdata.figures import style
from hopdata.messages import (
    at_least_in_per_cent,
    at_most_in_per_cent,
    in_per_cent,
)

# Heights of a row of two plots, of a member of a group, and of a study's title.
ROW_MM = 58.0
MEMBER_MM = 4.2
TITLE_MM = 3.0
# Characters of a line of a reason in words, where there is nothing to draw.
SAID_WIDTH = 76
SAID_WIDTH_BESIDE = 48
ASKED = "difference between the maps of the contact orders"
# Quantity that decides the answer: its axis label.
AXES = {
    "effect": f"{ASKED}\n(% of the map; 0: one and the same map)",
    "jump": ("jump of the outcome between contact orders\n(% of the map; 0: none)"),
}
# The same of a size that is another over the landings.
AT_CONTACT_AXIS = f"{ASKED}\nwhere all feet touch at once (% of the map)"
# Conclusion: a short answer, and its shade. Colours mark the feet, and nothing else.
ANSWERS = {
    "different": ("Different maps", style.INK),
    "no difference": ("No difference found", style.INK),
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
        Contents of ``verdict.json``; see docs/verdict_json.md.
    touchdowns : DataFrame
        The touchdown table, whose orders of contact are drawn.
    truth : DataFrame, optional
        The ``true_effect`` of a simulated study, marked on the axis.

    Returns
    -------
    Figure
        (a) The difference and its uncertainty. (b) All orders of contact, and whether
        their maps were found to differ, all together. If a study has no answer, there
        is (b) alone. All sentences are in the caption.
    """
    if verdict.get("effect") is None and _used(touchdowns).empty:
        return style.message_figure(
            _said(verdict, SAID_WIDTH), width_mm=style.WIDEST_PANEL_MM
        )
    if verdict.get("effect") is None:
        height_mm = _height_of_orders(touchdowns, 0.0)
        figure = style.paper_figure(style.SINGLE_COLUMN_MM, height_mm)
        axes = figure.subplots()
        _draw_orders(axes, verdict, touchdowns, fewest=1)
        axes.set_title(in_short(verdict), **TITLE, color=style.GREY)
        return figure
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, _height_of_orders(touchdowns))
    if truth is None or truth.empty:
        _draw_row(figure, verdict, touchdowns, _top(verdict))
        return figure
    true = round(float(truth["true_effect"].iloc[0]), 9)  # beyond, it is rounding
    top = max(_top(verdict), ROOM * 100.0 * true)
    left = _draw_row(figure, verdict, touchdowns, top)
    left.plot(
        100.0 * true,
        0.0,
        "^",
        color=style.INK,
        markersize=5,
        clip_on=False,
        zorder=5,
    )
    estimated = _percent(verdict["effect"]["estimate"])
    words = f"true: {_percent(true)}, estimated: {estimated}"
    _write(left, words, (100.0 * true, TRUE_ROW), style.INK, top)
    return figure


@style.styled
def size_figure(verdict: Mapping[str, Any]) -> Figure:
    """Draw the difference and its uncertainty alone; without an answer, the reason.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``.
    """
    if verdict.get("effect") is None:
        return style.message_figure(_said(verdict, SAID_WIDTH_BESIDE))
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, ROW_MM)
    _draw_size(figure.subplots(), verdict, _top(verdict))
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
    heights = [_height_of_orders(one) + TITLE_MM for _, one, _ in rows]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, sum(heights))
    top = max(_top(verdict) for verdict, _, _ in rows)
    parts = figure.subfigures(
        len(rows), 1, squeeze=False, height_ratios=heights
    ).ravel()
    for part, (verdict, touchdowns, name) in zip(parts, rows, strict=True):
        part.suptitle(style.label_of(name), fontsize=style.pt(8), x=0.01, ha="left")
        _draw_row(part, verdict, touchdowns, top)
    return figure


def _draw_row(
    figure: Figure | SubFigure,
    verdict: Mapping[str, Any],
    touchdowns: pd.DataFrame,
    top: float,
) -> Axes:
    """Draw size and orders side by side; without an answer, no size."""
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
    _draw_orders(right, verdict, touchdowns)
    if verdict.get("effect") is None:
        left.set_title(in_short(verdict), **TITLE, color=style.GREY)
        left.set_axis_off()
        return left
    _draw_size(left, verdict, top)
    style.letters((left, right))
    return left


def _decided(verdict: Mapping[str, Any]) -> str:
    """Return what decides the answer: a difference of maps, or a jump."""
    return str(verdict.get("decided_by", "effect"))


def _top(verdict: Mapping[str, Any]) -> float:
    """Return the end of the axis, per cent: above all points and the interval's end."""
    effect = verdict[_decided(verdict)]
    if effect is None:
        return 0.0
    most = max(verdict["margin"], effect["estimate"], min(effect["detectable"], 1.0))
    end = _end(verdict["conclusion"], effect)
    longest = LONGEST if math.isfinite(end) else OPEN_ENDED
    end = min(end, longest * most)
    return ROOM * 100.0 * max(most, end)


#: How far a bar without an upper end goes on, so that it leaves room for other bars.
#: Unit: 1, of the largest number beside it. Origin: chosen.
OPEN_ENDED = 1.4
# The axis is longer than what it has to show by this factor.
ROOM = 1.12
# The answer above a panel.
TITLE: dict[str, Any] = {"fontweight": "bold", "loc": "left"}


def _end(conclusion: str, effect: Mapping[str, Any]) -> float:
    """Return the end of what is not excluded: of the interval, or the bound.

    It is infinite if no upper end can be given.
    """
    name = "high" if conclusion == "different" else "upper_bound"
    if effect[name] is None:
        return math.inf
    return float(effect[name])


# Rows of the plot of the size, from the axis (0) upwards. Each text has a row of its
# own, as high as two of its lines, so that no text can cover another wherever the data
# place them.
TRUE_ROW = 0.13
SEEN_TEXT_ROW = 0.6
SEEN_ROW = 1.0
BAR_ROW = 1.4
BAR_TEXT_ROW = 1.82
NONE_ROW = 2.4
HIGHEST_ROW = 2.65
# Where the line of the margin is drawn: across the bars, and beside its name. Rows of
# other texts stay free of it, however long the texts are.
MARGIN_FROM = (0.84, 2.08)
MARGIN_TO = (1.58, HIGHEST_ROW)


def _draw_size(axes: Axes, verdict: Mapping[str, Any], top: float) -> None:
    """Draw what is known of the difference above an axis that begins at zero."""
    effect = verdict[_decided(verdict)]
    _, colour = ANSWERS[verdict["conclusion"]]
    axes.set_title(in_short(verdict), color=colour, fontsize=style.pt(8), **TITLE)
    low = 100.0 * effect["low"]
    end = 100.0 * _end(verdict["conclusion"], effect)
    _draw_interval(axes, verdict, (low, end), colour, top)
    if low <= 0:  # a difference that was found does not count as none
        margin = 100.0 * verdict["margin"]
        _draw_margin(axes, margin)
        none = f"margin {margin:g} %"
        _write(axes, none, (margin, NONE_ROW), style.INK, top)
    _draw_seen(axes, verdict, top)
    axes.set_ylim(0.0, HIGHEST_ROW)
    axes.set_xlim(0.0, top)
    axes.set_yticks([])
    axes.spines["left"].set_linewidth(2.0)
    axes.set_xlabel(_axis_label(verdict))


def _axis_label(verdict: Mapping[str, Any]) -> str:
    """Return what the axis of the size is of; two sizes need their place."""
    decided = _decided(verdict)
    if decided == "effect" and verdict.get("saturates"):
        return AT_CONTACT_AXIS
    return AXES[decided]


def _draw_margin(axes: Axes, margin: float) -> None:
    """Draw the margin, per cent, in the rows in which no other text stands."""
    look: Any = {"colors": style.INK, "linewidths": 0.8, "linestyles": (0, (4, 2))}
    at = [margin] * len(MARGIN_FROM)
    axes.vlines(at, MARGIN_FROM, MARGIN_TO, **look)


def _draw_interval(
    axes: Axes,
    verdict: Mapping[str, Any],
    interval: tuple[float, float],
    colour: str,
    top: float,
) -> None:
    """Draw the interval, per cent, as a bar, with an arrowhead if it is cut."""
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
        words = f"not excluded, {sure} confidence"
    if not math.isfinite(end):
        words = f"no upper end, {sure} confidence"
    _write(axes, words, (low, BAR_TEXT_ROW), colour, top)


def _draw_seen(axes: Axes, verdict: Mapping[str, Any], top: float) -> None:
    """Draw from where on such studies would have found a difference."""
    seen = 100.0 * verdict[_decided(verdict)]["detectable"]
    power = f"{100 * float(verdict['power']):g} %"
    words = "none detectable"
    if seen < top:
        words = f"detectable, {power} power"
        axes.plot([seen, top], [SEEN_ROW, SEEN_ROW], color=style.GREY, linewidth=1.2)
        start: Any = {"color": style.GREY, "markersize": 8, "markeredgewidth": 1.5}
        axes.plot(seen, SEEN_ROW, "|", **start)
        axes.plot(top, SEEN_ROW, ">", color=style.GREY, markersize=4, clip_on=False)
    _write(axes, words, (min(seen, top), SEEN_TEXT_ROW), style.GREY, top)


def _write(
    axes: Axes, words: str, at: tuple[float, float], colour: str, top: float
) -> None:
    """Write in a row beside a place, on the side with more room."""
    if at[0] < 0.5 * top:
        side = "left"
        shift = (3, 0)
    else:
        side = "right"
        shift = (-3, 0)
    style.note(
        axes,
        words,
        at,
        shift,
        bbox=style.ON_WHITE,
        ha=side,
        va="center",
        color=colour,
    )


def in_short(verdict: Mapping[str, Any]) -> str:
    """Return the answer in a few words, with its size."""
    answer, _ = ANSWERS[verdict["conclusion"]]
    effect = verdict[_decided(verdict)]
    if effect is None:
        return answer
    if not math.isfinite(_end(verdict["conclusion"], effect)):
        if verdict["conclusion"] == "different":
            return _in_short_without_end(answer, verdict)
        return f"{answer}: no upper bound"
    bound = _at_most(effect["upper_bound"])
    if verdict["conclusion"] == "no difference":
        return f"No difference above {bound}{_besides(verdict)}"
    if verdict["conclusion"] == "cannot tell":
        return f"{answer}: up to {bound} possible"
    size = _percent(effect["estimate"])
    low = _at_least(effect["low"]).removesuffix(PER_CENT)
    high = _at_most(effect["high"])
    by = {"effect": "by", "jump": "a jump of"}[_decided(verdict)]
    return f"{answer}: {by} {size} ({low} to {high})"


def _in_short_without_end(answer: str, verdict: Mapping[str, Any]) -> str:
    """Return the size over the landings, as the sentence has it, and at the contact."""
    at_least = f"at least {_at_least(verdict['effect']['low'])}"
    over = verdict.get("effect_over_landings")
    if over is None:
        return f"{answer}: by {at_least}"
    size = f"{_percent(over['estimate'])} over these landings"
    return f"{answer}: by {size},\nby {at_least} where all feet touch at once"


def _besides(verdict: Mapping[str, Any]) -> str:
    """Return what the bound of no difference leaves open: the contact, and jumps."""
    besides = ""
    if verdict.get("holds_from") is not None:
        besides = " over these landings"
    jump_bound = verdict.get("jump_bound")
    if jump_bound is not None and jump_bound > verdict["margin"]:
        besides += f",\nbut a jump of up to {_at_most(jump_bound)} is possible"
    return besides


PER_CENT = "\u00a0%"  # the space keeps number and sign on one line


def _percent(share: float) -> str:
    return f"{in_per_cent(share):g}{PER_CENT}"


def _at_least(share: float) -> str:
    return f"{at_least_in_per_cent(share):g}{PER_CENT}"


def _at_most(share: float) -> str:
    return f"{at_most_in_per_cent(share):g}{PER_CENT}"


def _said(verdict: Mapping[str, Any], longest: int) -> str:
    """Return why there is no size, and what is known without one.

    It is wrapped to as few, evenly long lines as possible.
    """
    parts = [verdict.get(name) for name in ("sentence", "contacts", "outlook")]
    said = " ".join(part for part in parts if part).replace(" %", PER_CENT)
    fewest = len(textwrap.wrap(said, longest))
    for width in range(20, longest):
        lines = textwrap.wrap(said, width)
        if len(lines) == fewest:
            return "\n".join(lines)
    return "\n".join(textwrap.wrap(said, longest))


# The table of orders: rows that it shows at most, and the height of a row, of what
# stands around them, and of the legend that some have.
MOST_ORDERS = 24
ORDER_MM = 3.1
AROUND_MM = 14.0
# Fewer rows than this stand as far apart as so many would.
FEWEST_ROWS = 4
# Rows of which "not all" cannot be said.
TWO = 2
# Places across the panel, which is 100 wide: where the feet end, the bars, their
# numbers, the lines to the maps, and the maps.
FEET_END = 52.0
BARS = (54.0, 63.0)
LINES = (75.0, 82.0)
MAP = 91.0
# Size of the letters of a foot's name, width of its mark, and least room after a name,
# in the same unit.
LETTERS = 3.1
MARK = 2.4
AFTER_NAME = 0.4
ORDINALS = ("1st", "2nd", "3rd", "4th", "5th", "6th")


def _used(touchdowns: pd.DataFrame) -> pd.Series:
    """Return the orders of the touchdowns used."""
    return touchdowns.loc[~touchdowns["excluded"].astype(bool), "schedule"].dropna()


def _height_of_orders(touchdowns: pd.DataFrame, least_mm: float = ROW_MM) -> float:
    """Return the height of a figure with a table of all orders, mm."""
    n_orders = _used(touchdowns).nunique()
    n_rows = min(n_orders, MOST_ORDERS) + (n_orders > MOST_ORDERS)
    return max(least_mm, AROUND_MM + ORDER_MM * n_rows)


def _draw_orders(
    axes: Axes,
    verdict: Mapping[str, Any],
    touchdowns: pd.DataFrame,
    *,
    fewest: int = FEWEST_ROWS,
) -> None:
    """Draw a row for each order of contact, the commonest first, and its map.

    A foot has its colour and mark in every row. Rows beyond `MOST_ORDERS` are counted
    together. There is room for the `fewest` rows.
    """
    counts = _used(touchdowns).value_counts()
    orders = [str(order).split(">") for order in counts.index]
    n_feet = len(orders[0]) if orders else 0
    names = [style.label_of(name) for name in foot_names(touchdowns.columns)]
    if len(names) < n_feet:
        names = [str(number + 1) for number in range(n_feet)]
    rows = len(orders[:MOST_ORDERS])
    most = int(counts.max()) if rows else 1
    step = FEET_END / max(n_feet, 1)
    longest = max(map(_width_of, names), default=0.0)
    has_names = MARK + longest + AFTER_NAME < step
    size: Any = {"va": "center_baseline"}
    for k in range(n_feet):
        axes.text(step * k, -1.0, ORDINALS[k], **size)
    axes.text(BARS[0], -1.0, "landings", **size)
    places = foot_places(names)
    for row, order in enumerate(orders[:MOST_ORDERS]):
        for k, foot in enumerate(order):
            name = names[int(foot) - 1]
            place = places[name]
            look: Any = {"color": style.foot_colour(place), "markersize": 3.5}
            axes.plot(step * k + 0.8, row, style.foot_mark(place), **look)
            if has_names:
                axes.text(step * k + MARK, row, name, **size)
        _draw_count(axes, row, int(counts.iloc[row]), most)
    if len(orders) > MOST_ORDERS:
        rarer = counts.iloc[MOST_ORDERS:]
        axes.text(0.0, rows, counted(len(rarer), "rarer order"), **size)
        _draw_count(axes, rows, int(rarer.sum()), most)
        rows += 1
    if rows > 1:  # a single order leaves nothing to compare
        _draw_maps(axes, verdict, rows)
    axes.set_xlim(-1.0, 100.0)
    axes.set_ylim(max(rows, fewest) - 0.4, -1.6)
    axes.set_axis_off()
    if not has_names:
        handles = []
        for name in names:
            place = places[name]
            own: Any = {"color": style.foot_colour(place), "linestyle": "none"}
            mark = style.foot_mark(place)
            handles += axes.plot([], [], marker=mark, label=name, **own)
        columns = min(3, len(names))
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 0.0),
                    ncols=columns, frameon=False)  # fmt: skip


def _width_of(name: str) -> float:
    """Return the width of a foot's name, in hundredths of the panel."""
    from matplotlib.textpath import TextPath

    return float(TextPath((0.0, 0.0), name, size=LETTERS).get_extents().width)


def _draw_count(axes: Axes, row: int, count: int, most: int) -> None:
    """Draw the number of landings of an order as a bar, and write it."""
    left, right = BARS
    length = (right - left) * min(count / most, 1.0)
    axes.barh(row, length, 0.55, left, color=style.GREY, linewidth=0)
    at = (left + length, row)
    style.note(axes, f"{count:,}", at, (2, 0), va="center_baseline")


def _draw_maps(axes: Axes, verdict: Mapping[str, Any], rows: int) -> None:
    """Draw what leads on from the orders: maps alike, different, or it is not known.

    A difference is one of all together. Orders may share a map all the same, so none is
    drawn with a map of its own.
    """
    conclusion = verdict["conclusion"]
    _, colour = ANSWERS[conclusion]
    left, right = LINES
    line: Any = {"color": colour, "linewidth": 0.8}
    middle = 0.5 * (rows - 1)
    for row in range(rows):
        axes.plot([left, right], [row, middle], **line)
    words = "one map?"
    if conclusion == "different":
        words = "not alike" if rows == TWO else "not all\nalike"
    if conclusion == "no difference":
        bound = _at_most(verdict[_decided(verdict)]["upper_bound"])
        words = f"alike to\n{bound}"
    box = {"boxstyle": "round,pad=0.4", "facecolor": colour, "linewidth": 0}
    look: Any = {"color": "white", "fontweight": "bold", "bbox": box}
    axes.text(MAP, middle, words, ha="center", va="center", zorder=3, **look)


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
        return style.message_figure(group["sentence"], width_mm=style.WIDEST_PANEL_MM)
    # Those of a condition below each other, as their sizes over all subjects are.
    conditions = [one["condition"] for one in group.get("by_condition", [])]
    if conditions:
        rows.sort(key=lambda row: conditions.index(row["condition"]))
    some_saturate = any(_saturates(row) for row in rows)
    places: list[float] = [float(number) for number in range(len(rows))]
    height_mm = 18.0 + MEMBER_MM * len(rows)
    for whole in wholes(group):
        rows.append(whole)
        places.append(len(places) + 0.5)
        height_mm += 1.5 * MEMBER_MM
    figure = style.paper_figure(style.WIDEST_PANEL_MM, height_mm)
    axes = figure.subplots()
    top = _top_of_group(rows, group["margin"])
    for place, row in zip(places, rows, strict=True):
        if "jump_low" in row:
            _write_jump(axes, row, place)
        else:
            _draw_member(axes, row, place, top)
        if _saturates(row):
            _draw_at_contact(axes, row, place + BESIDE, top)
    margin = 100 * group["margin"]
    axes.axvline(margin, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    if some_saturate:
        look: Any = {"color": style.INK, "markerfacecolor": "white", "markersize": 5}
        axes.plot([], [], "-s", linewidth=1.5, label="over the landings", **look)
        look |= {"markersize": 4, **AT_CONTACT}
        axes.plot([], [], label="where all feet touch at once", **look)
        figure.legend(loc="outside upper left", ncols=2)
    axes.set_yticks(places, [name_of(row) for row in rows])
    axes.set_ylim(places[-1] + 0.8, -0.8)
    axes.set_xlim(0.0, 102.0 * max(top, group["margin"]))
    axes.set_xlabel(f"{ASKED} (% of the map)")
    return figure


def wholes(group: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the size over all subjects, or that of each condition, as rows."""
    found = []
    for one in [group, *group.get("by_condition", [])]:
        if one["effect"]:
            name = {"name": "all", "condition": one.get("condition", "")}
            of_all = {"conclusion": one["conclusion"], "of_all": True}
            found.append({**one["effect"], **name, **of_all})
    return found


def _top_of_group(rows: Sequence[Mapping[str, Any]], margin: float) -> float:
    """Return where long intervals are cut, as a share of the map."""
    sizes = [margin]
    ends = []
    for row in rows:
        if "jump_low" in row:  # a jump is not a difference of derivatives
            ends.append(0.0)
            continue
        shown = [over_landings(row)]
        if _saturates(row):
            shown.append(row)
        ends += [_end(row["conclusion"], one) for one in shown]
        if "of_all" not in row:
            sizes += [one["estimate"] for one in shown]
    given = sorted(end for end in ends if math.isfinite(end))
    middle = given[len(given) // 2]
    return float(min(max(ends), LONGEST * max(*sizes, middle)))


def _draw_member(axes: Axes, row: Mapping[str, Any], place: float, top: float) -> None:
    """Draw the size of a member, or of all; a long interval ends in an arrow."""
    size = over_landings(row)
    _, colour = ANSWERS[row["conclusion"]]
    mark = "s"
    width = 1.5
    if "of_all" in row:
        mark = "D"
        width = 4.0
    look: dict[str, Any] = {"color": colour, "clip_on": False}
    end = _end(row["conclusion"], size)
    interval = [100 * size["low"], 100 * min(end, top)]
    axes.plot(interval, [place, place], linewidth=width, **look)
    # Filled: found to differ.
    inside = colour if row["conclusion"] == "different" else "white"
    look_of_mark = look | {"markerfacecolor": inside}
    axes.plot(100 * size["estimate"], place, mark, markersize=5, **look_of_mark)
    if end > top:
        axes.plot(100 * top, place, ">", markersize=4, **look)


# How far below the size over the landings that at the contact stands, in rows, and how
# it is drawn.
BESIDE = 0.42
AT_CONTACT: dict[str, Any] = {"marker": "^", "linestyle": (0, (1.5, 1)), "linewidth": 1}


def _saturates(row: Mapping[str, Any]) -> bool:
    """Tell whether a member's difference is another where all feet touch at once."""
    return bool(row.get("saturates")) and "jump_low" not in row


def over_landings(row: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the size over the landings, which the size of all is of."""
    if not _saturates(row):
        return row
    prefix = "over_landings_"
    return {
        key.removeprefix(prefix): value
        for key, value in row.items()
        if key.startswith(prefix)
    }


def _draw_at_contact(
    axes: Axes, row: Mapping[str, Any], place: float, top: float
) -> None:
    """Draw the size at the simultaneous contact below that over the landings."""
    _, colour = ANSWERS[row["conclusion"]]
    end = _end(row["conclusion"], row)
    line: dict[str, Any] = {**AT_CONTACT, "marker": "", "color": colour}
    interval = [100 * row["low"], 100 * min(end, top)]
    axes.plot(interval, [place, place], clip_on=False, **line)
    inside = colour if row["conclusion"] == "different" else "white"
    look: dict[str, Any] = {"color": colour, "markersize": 4, "clip_on": False}
    estimate = 100 * min(row["estimate"], top)
    axes.plot(estimate, place, "^", markerfacecolor=inside, **look)
    if end > top:
        axes.plot(100 * top, place, ">", **look)


def _write_jump(axes: Axes, row: Mapping[str, Any], place: float) -> None:
    """Write the jump of a member in its row."""
    _, colour = ANSWERS[row["conclusion"]]
    size = _percent(row["jump_estimate"])
    interval = f"{_at_least(row['jump_low'])} to {_at_most(row['jump_high'])}"
    words = f"the outcome jumps, by {size} ({interval}) of the map"
    look = {"va": "center", "color": colour, "bbox": style.ON_WHITE}
    style.note(axes, words, (0.0, place), (4, 0), **look)


def name_of(row: Mapping[str, Any]) -> str:
    """Return the subject of a row, and its condition if it has one."""
    name = row.get("subject", row["name"])
    condition = row.get("condition")
    if condition:
        name = f"{name}, {condition}"
    return style.label_of(name)


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
    sizes = [100.0 * size for size in needed]
    axes.loglog(sizes, list(needed.values()), color=style.INK)
    pilot_landings, pilot_size = pilot
    at = (100.0 * pilot_size, pilot_landings)
    axes.plot(*at, "o", color=style.INK, markersize=5)
    style.note(axes, "pilot", at, (5, 4), color=style.INK)
    for axis in (axes.xaxis, axes.yaxis):
        style.plain_numbers(axis)
    axes.set_xticks(sizes)
    axes.set_xlabel("difference between the maps (% of the map)")
    axes.set_ylabel(f"landings that show it\nin {100 * power:g} % of studies")
    axes.grid(True)
    return figure
