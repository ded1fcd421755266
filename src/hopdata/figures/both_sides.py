"""Figure 2.5 for a landing that is C1 and for one that is not, side by side, with both verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hopdata.errors import chosen
from hopdata.figures.distances import KINDS, draw_box, draw_cumulative, label_axes
from hopdata.figures.style import DOUBLE_COLUMN_MM, letter, paper_figure, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@styled
def both_sides_figure(
    studies: Mapping[str, tuple[pd.DataFrame, pd.DataFrame, Mapping[str, Any]]],
) -> Figure:
    """Draw the distances between subspaces of several studies, each above its verdict.

    Parameters
    ----------
    studies : mapping
        Name -> the tables of `hopdata.figures.distances.distances_figure` and the content of
        ``verdict.json``.

    Returns
    -------
    Figure
        One column a study: distributions, boxes, and the verdict's conclusion with its p-value.
    """
    figure = paper_figure(DOUBLE_COLUMN_MM, 96.0)
    rows = figure.subplots(
        2, len(studies), sharex=True, sharey="row", height_ratios=(1.7, 1), squeeze=False
    )
    for column, (name, (distances, summary, verdict)) in enumerate(studies.items()):
        upper, lower = rows[0, column], rows[1, column]
        boxes = {str(row["kind"]): row for row in summary.to_dict("records")}
        for place, kind in enumerate(KINDS):
            own = distances.loc[distances["kind"] == kind, "distance_rad"].dropna()
            draw_cumulative(upper, kind, own.to_numpy())
            draw_box(lower, place, kind, boxes.get(kind, {}))
        label_axes(upper, lower)
        upper.set_title(f"{name}\nverdict: {_in_short(verdict)}", loc="left")
        letter(upper, "abcdef"[column])
    for axes in rows[:, 1:].ravel():
        axes.set_ylabel("")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _in_short(verdict: Mapping[str, Any]) -> str:
    effect, test = verdict["effect"], verdict["test"]
    if effect is None or test is None:
        return str(verdict["conclusion"])
    sizes = {
        "different": f"different by {effect['estimate']:.2g}",
        "no difference": f"no difference above {effect['upper_bound']:.2g}",
        "cannot tell": "these data cannot tell",
    }
    size = chosen("conclusion", verdict["conclusion"], sizes)
    return f"{size} (p = {test['p_value']:.2g})"
