"""Figure of the part on event-selected systems: table 1.1 with its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hopdata.figures import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Short names of the conditions, in the order in which they are drawn, by group.
GROUPS = {
    "definitions": ["event functions (1.2.1)", "smooth fields (1.2.2)"],
    "ESS": [
        "trajectories are continuous",
        "smooth collision surfaces",
        "contact made or broken once",
        "penetration velocity is kept",
    ],
    "FoPAS": [
        "is ESS",
        "positions and velocities",
        "contacts depend on position",
        "additive accelerations",
    ],
    "C1": ["one saltation product"],
}
# What holds and what does not, pale enough for the numbers on it.
HOLDS = "#f2f2f2"
FAILS = "#c9c9c9"


@style.styled
def checklist(table: pd.DataFrame) -> Figure:
    """Draw systems as columns and the lines of table 1.1 as rows, each with its number.

    Parameters
    ----------
    table : DataFrame
        Rows of ``system``, ``group``, ``condition``, ``holds`` and ``value``, systems
        and conditions in the order in which they are drawn.
    """
    systems = list(dict.fromkeys(table["system"]))
    conditions = list(dict.fromkeys(table["condition"]))
    labels = [label for group in GROUPS.values() for label in group]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 88.0)
    axes = figure.subplots()
    places = _places()
    columns = (table["system"], table["condition"], table["holds"], table["value"])
    for system, condition, holds, value in zip(*columns, strict=True):
        row = places[conditions.index(condition)]
        column = systems.index(system)
        colour = HOLDS if holds else FAILS
        axes.bar(column, 0.94, 0.96, row - 0.47, color=colour, linewidth=0)
        weight = "normal" if holds else "bold"
        axes.text(
            column,
            row,
            _short(value),
            ha="center",
            va="center",
            fontweight=weight,
        )
    axes.set_yticks(places, labels)
    axes.set_ylim(places[-1] + 0.55, -0.55)
    axes.set_xlim(-0.55, len(systems) - 0.45)
    names = [_broken(name) for name in systems]
    axes.set_xticks(range(len(systems)), names)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    _name_groups(axes, places)
    return figure


def _places() -> list[float]:
    """Return the heights of the rows, with a gap between groups."""
    gap = 0.45
    places = []
    top = 0.0
    for labels in GROUPS.values():
        places += [top + k for k in range(len(labels))]
        top = places[-1] + 1.0 + gap
    return places


def _name_groups(axes: Axes, places: list[float]) -> None:
    """Write the name of each group at the right, over the height of its rows."""
    names = {
        "definitions": "definitions",
        "ESS": "Table 1.1,\nleft: ESS",
        "FoPAS": "Table 1.1,\nright: FoPAS",
        "C1": "C1",
    }
    first = 0
    for group, labels in GROUPS.items():
        middle = 0.5 * (places[first] + places[first + len(labels) - 1])
        axes.text(
            1.01,
            middle,
            names[group],
            transform=axes.get_yaxis_transform(),
            ha="left",
            va="center",
            fontweight="bold",
        )
        first += len(labels)


def _broken(name: str) -> str:
    """Return a name with a line for each word; a number stays with its sign."""
    return name.replace(" %", "\u00a0%").replace(" ", "\n")


def _short(value: float) -> str:
    """Return a number in few characters; a dash where there is none."""
    if not np.isfinite(value):
        return "–"
    if abs(value) < 1e-9:  # rounding
        return "0"
    text = f"{value:.2g}"
    mantissa, _, power = text.partition("e")
    if power:
        exponent = str(int(power)).translate(style.SUPERSCRIPTS)
        return f"{float(mantissa):.0f}·10{exponent}"
    return text
