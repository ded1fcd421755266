"""Which contact orders differ: the size of each pair and each order, as intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.feet import AND, foot_names, with_foot_names
from hopdata.figures import style

NO_SIZES = "This study has no size of a difference for each two contact orders."
# Axis label of each kind of size, and the columns of panels in which the kinds stand.
LABELS = {
    "map": "difference between two maps\nover these landings (% of the map)",
    "order": "own map against all others\n(% of the map)",
    "jump": "jump where two feet exchange\n(% of the map)",
}
COLUMNS = (("map",), ("order", "jump"))
# Height of the figure: of the frame of a panel, and of each of its rows.
FRAME_MM = 20.0
ROW_MM = 3.7
# An interval longer than this multiple of all others is cut, and ends in an arrowhead.
LONGEST = 3.0
# Characters of the longest label with names; if one is longer, feet are numbered.
LONGEST_LABEL = 52


@style.styled
def orders_figure(
    verdict: Mapping[str, Any], touchdowns: pd.DataFrame | None = None
) -> Figure:
    """Draw which contact orders, or feet, differ, and by how much.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``.
    touchdowns : DataFrame, optional
        The touchdown table, whose columns name the feet. They are numbered without it,
        and if the names are long.

    Returns
    -------
    Figure
        Estimate and interval of each two orders, of each order against all others, and
        of the jump at the exchange of each two feet, one panel for each kind that the
        study has. Filled: found to differ. The intervals of a kind hold together.
    """
    effects = verdict.get("orders") or []
    columns = []
    for kinds in COLUMNS:
        parts = [_rows_of(effects, kind) for kind in kinds]
        parts = [rows for rows in parts if rows]
        if parts:
            columns.append(parts)
    if not columns:
        return style.message_figure(NO_SIZES, width_mm=style.WIDEST_PANEL_MM)
    names: tuple[str, ...] = ()
    if touchdowns is not None:
        names = foot_names(touchdowns.columns)
    if any(len(label_of(one, names)) > LONGEST_LABEL for one in effects):
        names = ()
    heights = []
    for parts in columns:
        heights.append(sum(FRAME_MM + ROW_MM * max(2, len(rows)) for rows in parts))
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, max(heights))
    halves = figure.subfigures(1, len(columns), squeeze=False)[0]
    panels = []
    for half, parts in zip(halves, columns, strict=True):
        sizes = [len(rows) + 1 for rows in parts]
        every = half.subplots(len(parts), 1, squeeze=False, height_ratios=sizes)
        for axes, rows in zip(every[:, 0], parts, strict=True):
            _draw_intervals(axes, rows, names)
            panels.append(axes)
    style.letters(panels)
    return figure


def _rows_of(
    effects: Sequence[Mapping[str, Any]], kind: str
) -> list[Mapping[str, Any]]:
    """Return the sizes of a kind, the largest first."""
    rows = [effect for effect in effects if effect["of"] == kind]
    return sorted(rows, key=lambda row: (row["low"], row["estimate"]), reverse=True)


def _draw_intervals(
    axes: Axes, rows: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> None:
    """Draw a row for each size, with its interval."""
    top = 100.0 * _top(rows)
    for place, row in enumerate(rows):
        _draw_interval(axes, row, place, top)
    axes.set_yticks(range(len(rows)), [label_of(row, names) for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.04 * top)
    axes.set_xlabel(LABELS[str(rows[0]["of"])])
    axes.tick_params(axis="y", length=0, pad=4)
    axes.spines["left"].set_linewidth(1.5)
    axes.grid(axis="x")


def _top(rows: Sequence[Mapping[str, Any]]) -> float:
    """Return where the axis ends: one long interval does not squeeze all others."""
    ends = sorted(float(row["high"]) for row in rows)
    middle = ends[len(ends) // 2]
    most = max(middle, *(float(row["estimate"]) for row in rows))
    return min(ends[-1], LONGEST * most) or 1.0


def _draw_interval(axes: Axes, row: Mapping[str, Any], place: int, top: float) -> None:
    """Draw one size, %: filled if it was found, open otherwise."""
    is_found = row["low"] > 0.0
    colour = style.INK if is_found else style.GREY
    low = 100.0 * row["low"]
    high = 100.0 * row["high"]
    width = 1.8 if is_found else 0.9
    axes.plot([low, min(high, top)], [place, place], color=colour, linewidth=width)
    if high > top:
        axes.plot(top, place, ">", color=colour, markersize=4, clip_on=False)
    look: dict[str, Any] = {
        "color": colour,
        "markersize": 4,
        "markerfacecolor": colour if is_found else "white",
        "clip_on": False,
    }
    axes.plot(100.0 * row["estimate"], place, "o", **look)


def label_of(effect: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return what is compared, with the names of the feet.

    Parameters
    ----------
    effect : mapping
        Of ``verdict.json``: ``of``, ``first`` and ``second``.
    names : sequence of str
        Names of the feet, which orders number from 1; without them numbers stay.
    """
    short = [style.label_of(name) for name in names]
    first = with_foot_names(effect["first"], short)
    if effect["of"] == "order":
        return first
    if len(effect["first"].split(AND)[0].split(">")) == 2:  # either order of two feet
        return first.replace(" → ", " and ")
    return f"{first}  |  {with_foot_names(effect['second'], short)}"
