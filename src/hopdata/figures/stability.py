"""How stable the sections are, and what drifts between parts of a study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREY,
    MM_PER_M,
    ON_WHITE,
    VERMILION,
    foot_colour,
    letter,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_MM = 5.5
MARGIN_MM = 26.0
SECTIONS = (
    ("pre_height_m", "pre section", BLUE, "o"),
    ("post_height_m", "post section", VERMILION, "D"),
)
MARKS = "osD^vPX<>"
MOST_IN_LEGEND = 6


@styled
def stability_figure(stability: pd.DataFrame, drift: pd.DataFrame) -> Figure:
    """Draw the sections of other bandwidths and parts, and the drift between parts.

    Parameters
    ----------
    stability : DataFrame
        ``kind, variant, pre_height_m, post_height_m``; the first row is what was chosen.
    drift : DataFrame
        ``quantity, part, deviation, se, spread``.

    Returns
    -------
    Figure
        (a) change of both sections, mm, a row a variant; (b) medians of the parts, in spreads
        between touchdowns from the typical one, with two standard errors each way.
    """
    rows = max(len(stability) - 1, 2 * drift["quantity"].nunique(), 6)
    figure = paper_figure(DOUBLE_COLUMN_MM, MARGIN_MM + ROW_MM * rows)
    left, right = figure.subplots(1, 2)
    _draw_sections(left, stability)
    _draw_drift(right, drift)
    for axes, text in ((left, "a"), (right, "b")):
        letter(axes, text)
        axes.axvline(0.0, color=GREY, linewidth=0.8, zorder=1)
        axes.tick_params(axis="y", length=0)
        axes.locator_params(axis="x", nbins=5)
    return figure


def _draw_sections(axes: Axes, stability: pd.DataFrame) -> None:
    chosen, others = stability.iloc[0], stability.iloc[1:]
    place = np.arange(len(others))
    for column, label, colour, mark in SECTIONS:
        moved = MM_PER_M * (others[column].to_numpy(float) - float(chosen[column]))
        axes.plot(moved, place, linestyle="", marker=mark, color=colour, label=label, markersize=4)
    for row in np.flatnonzero(others["pre_height_m"].isna()):
        axes.text(0.0, float(row), "none", ha="center", va="center", color=GREY, bbox=ON_WHITE)
    axes.set_yticks(place, list(others["variant"]))
    axes.set_ylim(len(others) - 0.4, -0.6)
    reach = 1.08 * max(map(abs, axes.get_xlim()))
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("change of the section (mm)")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_drift(axes: Axes, drift: pd.DataFrame) -> None:
    quantities = list(dict.fromkeys(drift["quantity"]))
    parts = list(dict.fromkeys(drift["part"]))
    step = 0.7 / max(len(parts), 1)
    for number, part in enumerate(parts):
        own = drift[drift["part"] == part]
        place = [
            quantities.index(q) + step * (number - (len(parts) - 1) / 2) for q in own["quantity"]
        ]
        spread = own["spread"].to_numpy(float)
        error = 2.0 * own["se"].to_numpy(float) / np.where(spread > 0, spread, np.inf)
        axes.errorbar(
            own["deviation"], place, xerr=error, linestyle="", capsize=0, markersize=3.5,
            marker=MARKS[number % len(MARKS)], color=foot_colour(number), label=part,
        )  # fmt: skip
    axes.set_yticks(range(len(quantities)), [_wrapped(q) for q in quantities])
    axes.set_ylim(max(len(quantities), 1) - 0.4, -0.6)
    reach = max(1.0, *map(abs, axes.get_xlim()))
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("median of a part from that of all\n(in spreads between touchdowns)")
    if 0 < len(parts) <= MOST_IN_LEGEND:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=min(len(parts), 2))


def _wrapped(words: str) -> str:
    """Break a name near its middle."""
    from textwrap import wrap

    return "\n".join(wrap(words, max(12, (len(words) + 1) // 2 + 4)))
