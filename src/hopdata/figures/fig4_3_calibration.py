"""Figure 4.3: the hopper's trajectory by MuJoCo and by our integrator, beside the exact one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREY,
    PURPLE,
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

# solver: its colour, its line style, its width.
LINES: dict[str, tuple[str, Any, float]] = {
    "exact": (GREY, (0, (1, 1)), 2.2),
    "MuJoCo default contact": (BLUE, (0, (5, 1.5)), 1.0),
    "MuJoCo best at 2 ms": (PURPLE, (0, (5, 1.2, 1.5, 1.2)), 1.0),
    "hopdata": (VERMILION, "-", 0.8),
}
QUANTITIES = {"height": ("height_m", "m"), "velocity": ("velocity_m_s", "m/s")}
RESIDUALS = {
    "height": ("height_residual_m", "m"),
    "velocity": ("velocity_residual_m_s", "m/s"),
}


@styled
def calibration_figure(trajectories: pd.DataFrame) -> Figure:
    """Draw Fig. 4.3: height and velocity above, the sizes of their residuals below.

    Parameters
    ----------
    trajectories : DataFrame
        One row a solver and instant: ``solver`` (of `LINES`), ``time_s``, ``height_m``,
        ``velocity_m_s``, and ``height_residual_m``, ``velocity_residual_m_s``, which are the
        deviations from the exact solution.

    Returns
    -------
    Figure
        Two columns; the residuals are on a logarithmic axis, where an exact value has no place.
    """
    if trajectories.empty:
        return message_figure("No trajectories to compare.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 95.0)
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(1, 1))
    for column, quantity in enumerate(QUANTITIES):
        upper, lower = axes[0, column], axes[1, column]
        _draw(upper, trajectories, QUANTITIES[quantity][0], residual=False)
        _draw(lower, trajectories, RESIDUALS[quantity][0], residual=True)
        upper.set_ylabel(f"{quantity} ({QUANTITIES[quantity][1]})")
        lower.set_ylabel(f"|{quantity} residual| ({RESIDUALS[quantity][1]})")
        lower.set_xlabel("time (s)")
    for name, one in zip("abcd", axes.flat, strict=True):
        letter(one, name)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw(axes: Axes, trajectories: pd.DataFrame, column: str, *, residual: bool) -> None:
    """Draw a column for each solver: as it is, or its size on a logarithmic axis."""
    for solver, (colour, dash, width) in LINES.items():
        rows = trajectories[trajectories["solver"] == solver]
        if rows.empty or (residual and solver == "exact"):
            continue
        values = rows[column].abs().where(rows[column] != 0) if residual else rows[column]
        axes.plot(
            rows["time_s"], values, color=colour, linestyle=dash, linewidth=width, label=solver
        )
    if residual:
        axes.set_yscale("log")
        axes.grid(axis="y")
