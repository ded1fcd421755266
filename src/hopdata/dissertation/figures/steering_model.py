"""Drawing of the models of the frame change: kernels of C1 and C2 functions."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures import style
from hopdata.steering.figures.models import DATA, FLOOR

# Reading: how it is told.
READINGS = {
    "printed, all fixed": "all fixed",
    "printed, length fitted": "length fitted,\nin mm",
    "printed, length and noise fitted, m": "length, noise\nfitted, in m",
    "standardised, all fitted": "standardised,\nall fitted",
}
COMPONENTS = {"dx": "forward", "dy": "sideways", "dtheta": "turn"}
# Kernel: its smoothness, label, colour, marker and shift.
KERNELS = (
    (1.5, "C1 kernel (3/2), printed", style.PRINTED, "o", -0.12),
    (2.5, "C2 kernel (5/2), said to fail", style.OURS, "s", 0.12),
)


@style.styled
def kernels_figure(table: pd.DataFrame) -> Figure:
    """Draw what kernels of C1 and C2 functions explain, by reading of the set-up.

    Parameters
    ----------
    table : DataFrame
        ``data, reading, smoothness, component``, and ``median_r2, least_r2,
        largest_r2``.

    Returns
    -------
    Figure
        A row for each data set, a panel for each component; bars from the least to the
        largest of the seeds. Values below `FLOOR` are drawn there.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 96.0)
    panels = figure.subplots(len(DATA), len(COMPONENTS), sharex=True, sharey=True)
    for line, (data, told) in zip(panels, DATA.items(), strict=True):
        for axes, component in zip(line, COMPONENTS, strict=True):
            is_here = (table["data"] == data) & (table["component"] == component)
            _draw_kernels(axes, table[is_here])
        line[0].set_ylabel(f"{told}\nR² of other hops")
    for axes, title in zip(panels[0], COMPONENTS.values(), strict=True):
        axes.set_title(title)
    for axes in panels[-1]:
        labels = list(READINGS.values())
        axes.set_xticks(range(len(labels)), labels, rotation=90)
    panels[0, 0].set(xlim=(-0.5, len(READINGS) - 0.5), ylim=(FLOOR - 0.05, 1.05))
    style.lettered(figure, panels.flat, ncols=2)
    return figure


def _draw_kernels(axes: Axes, table: pd.DataFrame) -> None:
    """Draw both kernels in each reading."""
    places = list(READINGS)
    look: Any = {"linestyle": "", "markersize": 4, "elinewidth": 1.0}
    for smoothness, label, colour, marker, shift in KERNELS:
        rows = table[table["smoothness"] == smoothness]
        at = [places.index(reading) + shift for reading in rows["reading"]]
        shown = rows[["median_r2", "least_r2", "largest_r2"]].clip(lower=FLOOR)
        spread = [
            (shown["median_r2"] - shown["least_r2"]).to_numpy(),
            (shown["largest_r2"] - shown["median_r2"]).to_numpy(),
        ]
        own: Any = {"color": colour, "marker": marker, "label": label}
        axes.errorbar(at, shown["median_r2"], yerr=spread, **own, **look)
    axes.grid(axis="y")
