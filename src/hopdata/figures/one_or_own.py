"""What a map of its own gains for landings: what is missed, in mm and degrees."""

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from hopdata.figures import style

NOTHING_FORETOLD = "Too few landings, or a single order: none is foretold."
# Units of the rows of a panel; panels in this order, line by line.
PANELS = ("mm", "°", "mm/s", "°/s")
# Height of the frame of a panel, and of each of its rows.
FRAME_MM = 13.0
ROW_MM = 5.0
# Of a row, which is 1 high: where the one map and own maps stand, and the height of
# their bars.
ONE = -0.18
OWN = 0.18
BAR = 0.3
# Shades of the typical errors: of one map and of own maps. Colours mean feet only.
SHADES = {ONE: "#dcdcdc", OWN: "#b4b4b4"}
# The axis is longer than what it has to show by this factor.
ROOM = 1.1
# Places as a share of the width of a panel, and by its rows.
ACROSS = ("axes fraction", "data")


@style.styled
def one_or_own_figure(table: pd.DataFrame) -> Figure:
    """Draw by how much one map, and own maps of the orders, miss landings.

    Parameters
    ----------
    table : DataFrame
        ``one_or_own.csv``; see `hopdata.maps.one_or_own.one_or_own`.

    Returns
    -------
    Figure
        A panel for each unit, and a row for each outcome. What happened is at zero.
        Marks: what one map (open) and the own map of its order (filled) foretold of an
        example, less what happened. Bars: the median of what either missed over all
        landings, which were not fitted, to both sides; the numbers are these medians.
    """
    if table.empty:
        return style.message_figure(NOTHING_FORETOLD, width_mm=style.WIDEST_PANEL_MM)
    parts = [table[table["unit"] == unit] for unit in PANELS]
    parts = [part for part in parts if len(part)]
    columns = min(2, len(parts))
    lines = -(-len(parts) // columns)
    rows = [max(map(len, parts[columns * k : columns * (k + 1)])) for k in range(lines)]
    height_mm = FRAME_MM * (lines + 0.5) + ROW_MM * sum(rows)
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    panels = figure.subplots(lines, columns, squeeze=False, height_ratios=rows)
    for axes, part in zip(panels.flat, parts, strict=False):
        _draw_outcomes(axes, part)
    for axes in panels.flat[len(parts) :]:
        axes.set_axis_off()
    # A narrow page stacks the panels column by column.
    style.letters([axes for axes in panels.T.flat if axes.axison])
    figure.legend(handles=_legend(), loc="outside upper center", ncols=3)
    return figure


def _draw_outcomes(axes: Axes, part: pd.DataFrame) -> None:
    """Draw the outcomes of one unit, a row for each."""
    unit = part["unit"].iloc[0]
    reach = 0.0
    for place, row in enumerate(part.to_dict("records")):
        reach = max(reach, _draw_outcome(axes, row, place))
    reach = ROOM * reach or 1.0
    style.name_rows(axes, [f"{name} ({unit})" for name in part["outcome"]])
    style.note(axes, "one → own", (1.0, -0.6), (5, 0), xycoords=ACROSS)
    axes.axvline(0.0, color=style.INK, linewidth=1.0)
    axes.set_xlim(-reach, reach)
    axes.locator_params(axis="x", nbins=3)  # small numbers are long
    axes.set_xlabel(f"foretold less what happened ({unit})")
    axes.spines["left"].set_visible(False)


def _draw_outcome(axes: Axes, row: dict[Any, Any], place: int) -> float:
    """Draw one outcome, and return how far it reaches from zero."""
    errors = {
        ONE: row["one_map"] - row["happened"],
        OWN: row["own_map"] - row["happened"],
    }
    missed = {ONE: row["missed_by_one"], OWN: row["missed_by_own"]}
    insides = {ONE: "white", OWN: style.INK}
    for shift, error in errors.items():
        typical = missed[shift]
        corner = (-typical, place + shift - 0.5 * BAR)
        look: Any = {"facecolor": SHADES[shift], "linewidth": 0}
        axes.add_patch(Rectangle(corner, 2 * typical, BAR, **look))
        mark: Any = {"color": style.INK, "markerfacecolor": insides[shift]}
        axes.plot(error, place + shift, "o", markersize=4, zorder=3, **mark)
    words = f"{_short(missed[ONE])} → {_short(missed[OWN])}"
    style.note(axes, words, (1.0, place), (5, 0), xycoords=ACROSS, va="center")
    return float(max(*map(abs, errors.values()), *missed.values()))


def _short(value: float) -> str:
    """Return two significant digits, and no decimals of large numbers."""
    if abs(value) >= 10.0:
        return f"{value:.0f}"
    return f"{value:#.2g}"


def _legend() -> list[Any]:
    """Return what marks and bars are."""
    look: Any = {"linestyle": "none", "marker": "o", "color": style.INK}
    happened: Any = {"linestyle": "none", "marker": "|", "color": style.INK}
    return [
        Line2D([], [], label="what happened", markersize=8, **happened),
        Line2D([], [], label="one map", markerfacecolor="white", **look),
        Line2D([], [], label="its order's own map", **look),
        Patch(facecolor=SHADES[ONE], label="one map, typically"),
        Patch(facecolor=SHADES[OWN], label="own maps, typically"),
    ]
