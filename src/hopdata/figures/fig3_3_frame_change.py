"""Figure 3.3: the frame change of a hop over boom angle and swing, and how sure it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.figures.style import (
    DOUBLE_COLUMN_MM,
    INK,
    VERMILION,
    letter,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Column of the tables: what the reader sees, its unit, whether zero is a middle.
COMPONENTS = {
    "dx_mm": ("forward", "Δx (mm)", False),
    "dy_mm": ("sideways", "Δy (mm)", True),
    "dtheta_deg": ("turn", "Δθ (degrees)", True),
}
ONE_SIDED, ABOUT_ZERO, SPREAD = "cividis", "RdBu_r", "Greys"


@styled
def frame_change_figure(maps: pd.DataFrame, hops: pd.DataFrame) -> Figure:
    """Draw three maps above their standard deviations, with the hops behind them.

    Parameters
    ----------
    maps : DataFrame
        One row a node of an even grid: ``boom_angle_rad``, ``swing_rad``, the predictions ``dx_mm,
        dy_mm, dtheta_deg``, and their standard deviations, with ``_sd``.
    hops : DataFrame
        Hops learned from: the same columns but the standard deviations.

    Returns
    -------
    Figure
        Each panel has a scale of its own. Dots are hops, in the colour of what was measured.
    """
    if maps.empty:
        return message_figure("No map of frame changes to show.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplots(2, len(COMPONENTS), sharex=True, sharey=True)
    for column, (name, (title, label, centred)) in zip(panels.T, COMPONENTS.items(), strict=True):
        upper, lower = column
        colours, limits = _colours(maps[name], hops[name], centred)
        image = _draw(upper, maps, name, colours, limits)
        upper.scatter(
            hops["boom_angle_rad"], hops["swing_rad"], c=hops[name], cmap=colours,
            vmin=limits[0], vmax=limits[1], s=5, linewidths=0.3, edgecolors=INK,
        )  # fmt: skip
        upper.set_title(title)
        figure.colorbar(image, ax=upper, location="bottom", label=label, aspect=25, pad=0.03)
        spread = maps[f"{name}_sd"]
        image = _draw(lower, maps, f"{name}_sd", SPREAD, (spread.min(), spread.max()))
        lower.scatter(
            hops["boom_angle_rad"], hops["swing_rad"], color=VERMILION, s=1.5, linewidths=0
        )
        figure.colorbar(
            image, ax=lower, location="bottom", label=f"sd of {label}", aspect=25, pad=0.03
        )
    _axes(panels)
    for axes, name in zip(panels.ravel(), "abcdef", strict=True):
        letter(axes, name)
    return figure


def _colours(
    predicted: pd.Series, measured: pd.Series, centred: bool
) -> tuple[str, tuple[float, float]]:
    """Colour map and its limits, wide enough for map and all but the most extreme hops."""
    values = np.concatenate([predicted, np.quantile(measured, [0.02, 0.98])])
    low, high = float(values.min()), float(values.max())
    if centred:
        return ABOUT_ZERO, (-max(abs(low), abs(high)), max(abs(low), abs(high)))
    return ONE_SIDED, (low, high)


def _draw(
    axes: Axes, maps: pd.DataFrame, name: str, colours: str, limits: tuple[float, float]
) -> Any:
    wide = maps.pivot_table(index="swing_rad", columns="boom_angle_rad", values=name)
    angle, swing = wide.columns.to_numpy(float), wide.index.to_numpy(float)
    return axes.imshow(
        wide.to_numpy(float),
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        aspect="auto",
        origin="lower",
        interpolation="bilinear",
        extent=(*_edges(angle), *_edges(swing)),
    )


def _edges(nodes: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of the cells around even nodes."""
    half = (nodes[-1] - nodes[0]) / (len(nodes) - 1) / 2
    return float(nodes[0] - half), float(nodes[-1] + half)


def _axes(panels: Any) -> None:
    turns = [-2, -1, 0, 1, 2, 3, 4]
    labels = ["−2π", "", "0", "", "2π", "", "4π"]
    for axes in panels.ravel():
        for turn in (0.0, 2 * np.pi):
            axes.axvline(turn, color=INK, linewidth=0.6, linestyle=(0, (4, 2)))
        axes.set_xticks([turn * np.pi for turn in turns], labels)
        axes.set_yticks([-1, 0, 1])
    for axes in panels[0]:
        axes.tick_params(labelbottom=False)
    for axes in panels[-1]:
        axes.set_xlabel("boom angle φ (rad)")
    for axes in panels[:, 0]:
        axes.set_ylabel("swing Δφ (rad)")
