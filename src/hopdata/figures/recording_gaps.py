"""When each marker of each recording of a study was not seen, and where there are faults."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hopdata.figures.gap_timeline import ROW_MM, TIME, draw_timeline
from hopdata.figures.style import DOUBLE_COLUMN_MM, message_figure, paper_figure, styled

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

BETWEEN_MM, LEGEND_MM = 14.0, 8.0


@styled
def recording_gaps_figure(
    markers: pd.DataFrame, gaps: pd.DataFrame, faults: pd.DataFrame
) -> Figure:
    """Draw a line of time for each marker of each recording.

    Parameters
    ----------
    markers : DataFrame
        ``recording, marker, duration_s``: one row a line.
    gaps : DataFrame
        ``recording, marker, start_s, stop_s``, from the first frame of the recording.
    faults : DataFrame
        ``recording, kind, marker, start_s``; kinds as in `hopdata.figures.gap_timeline`.
    """
    if gaps.empty and faults.empty:
        return message_figure("Every marker was seen in every frame, and no faults were found.")
    rows = markers["recording"].value_counts(sort=False)
    height = LEGEND_MM + BETWEEN_MM * len(rows) + ROW_MM * len(markers)
    figure = paper_figure(DOUBLE_COLUMN_MM, height)
    grid = figure.subplots(len(rows), 1, squeeze=False, height_ratios=list(rows))[:, 0]
    signs = {}
    for axes, recording in zip(grid, rows.index, strict=True):
        own, missing, wrong = (t[t["recording"] == recording] for t in (markers, gaps, faults))
        draw_timeline(
            axes,
            missing,
            wrong.rename(columns={"start_s": "time_s"}),
            markers=list(own["marker"]),
            duration_s=float(own["duration_s"].max()),
        )
        axes.set_title(str(recording), loc="left")
        handles, labels = axes.get_legend_handles_labels()
        signs.update(dict(zip(labels, handles, strict=True)))
    grid[-1].set_xlabel(TIME)
    figure.legend(signs.values(), signs.keys(), loc="outside upper right", ncols=6)
    return figure
