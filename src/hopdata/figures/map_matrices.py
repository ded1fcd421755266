"""The landing map as a picture: what is true, what was estimated, and the difference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.figures.style import (
    DOUBLE_COLUMN_MM,
    INK,
    letter,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INPUTS = {
    "pitch_rad": "pitch",
    "roll_rad": "roll",
    "forward_m_s": "forward",
    "sideways_m_s": "sideways",
    "climb_m_s": "climb",
    "spin_x_rad_s": "spin x",
    "spin_y_rad_s": "spin y",
    "spin_z_rad_s": "spin z",
}
OUTPUTS = {"step_x_m": "step x", "step_y_m": "step y", "turn_rad": "turn", **INPUTS}
PRINTED, BEST = "printed", "corrected_curved"
FIRST_VELOCITY = 5  # rows above are displacements, rows below come from velocities
COLOURS = "RdBu_r"


@styled
def matrices_figure(estimates: pd.DataFrame, exact: pd.DataFrame | None = None) -> Figure:
    """Draw maps as images, 8 inputs across and 11 outputs down.

    Parameters
    ----------
    estimates : DataFrame
        ``estimator, input, output, standardised``: displacement of the markers, mm, by one standard
        deviation of the input. ``printed`` and ``corrected_curved`` are drawn.
    exact : DataFrame, optional
        The same without ``estimator``, where the exact map is known.

    Returns
    -------
    Figure
        Maps on the left, on one scale; differences on the right, on another: both estimates minus
        the exact map, or, where it is not known, the printed one minus the corrected one.
    """
    found = {
        name: _matrix(estimates[estimates["estimator"] == name])
        for name in (PRINTED, BEST)
        if (estimates["estimator"] == name).any()
    }
    if len(found) < 2:
        return message_figure("The landing map could not be estimated: too few landings.")
    maps = {
        "least squares,\nas printed": found[PRINTED],
        "noise and curvature\ncorrected": found[BEST],
    }
    if exact is None:
        differences = {"printed\nminus corrected": found[PRINTED] - found[BEST]}
    else:
        true = _matrix(exact)
        maps = {"exact": true, **maps}
        differences = {
            "printed\nminus exact": found[PRINTED] - true,
            "corrected\nminus exact": found[BEST] - true,
        }
    return _draw_all(maps, differences)


def _draw_all(maps: Mapping[str, Any], differences: Mapping[str, Any]) -> Figure:
    figure = paper_figure(DOUBLE_COLUMN_MM, 82.0)
    panels = figure.subplots(1, len(maps) + len(differences), sharey=True)
    groups = (
        (panels[: len(maps)], maps, "maps (mm per sd of the input)"),
        (panels[len(maps) :], differences, "differences (mm per sd of the input)"),
    )
    for axes, matrices, label in groups:
        limit = max(float(np.abs(matrix).max()) for matrix in matrices.values())
        for one, (title, matrix) in zip(axes, matrices.items(), strict=True):
            image = _draw(one, matrix, limit)
            one.set_title(title)
        figure.colorbar(
            image, ax=list(axes), location="bottom", label=label, shrink=0.8, aspect=30, pad=0.02
        )
    panels[0].set_yticks(range(len(OUTPUTS)), list(OUTPUTS.values()))
    panels[0].set_ylabel("state after the landing")
    for one in panels:
        one.set_xlabel("state before")
    for name, one in zip("abcde", panels, strict=False):
        letter(one, name)
    return figure


def _draw(axes: Axes, matrix: NDArray[np.float64], limit: float) -> Any:
    image = axes.imshow(matrix, cmap=COLOURS, vmin=-limit, vmax=limit, aspect="auto")
    axes.set_xticks(range(len(INPUTS)), list(INPUTS.values()), rotation=90)
    axes.tick_params(length=0)
    axes.axhline(FIRST_VELOCITY - 0.5, color=INK, linewidth=0.5)
    return image


def _matrix(table: pd.DataFrame) -> NDArray[np.float64]:
    """Return the outputs (11) by the inputs (8)."""
    wide = table.pivot_table(index="output", columns="input", values="standardised")
    matrix: NDArray[np.float64] = wide.loc[list(OUTPUTS), list(INPUTS)].to_numpy(float)
    return matrix
