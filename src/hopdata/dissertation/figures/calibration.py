"""Fig. 4.3: the hopper's path by MuJoCo, the printed method and hopdata."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Solver: label, colour, line style, width, marker. Exact, MuJoCo and the printed method
# have the lines of the print; its forms show the points of their meshes.
LINES: dict[str, tuple[str, str, Any, float, str]] = {
    "exact": ("exact", style.PALE, (0, (1, 1)), 2.4, ""),
    "MuJoCo": ("MuJoCo", style.SHADE, (0, (5, 1.5)), 1.0, ""),
    "printed": ("printed method, to the letter", style.PRINTED, "-", 0.8, "x"),
    "restarted, tight": (
        "printed method, restarted at contacts",
        style.PRINTED,
        "-",
        0.8,
        "o",
    ),
    "hopdata": ("hopdata", style.INK, (0, (5, 1.2, 1.5, 1.2)), 0.8, ""),
}
# Quantity: end of its columns, unit, and the limits of its axis and of its residuals'.
QUANTITIES = {
    "height": ("m", "m", (0.7, 2.1), (1e-17, 1e5)),
    "velocity": ("m_s", "m/s", (-5.2, 5.2), (1e-17, 1e5)),
}
# Where the note stands that tells of the first contact, s and m.
UNDER_THE_ARCH = (1.0, 0.95)


@style.styled
def calibration_figure(trajectories: pd.DataFrame) -> Figure:
    """Draw height and velocity above, and the sizes of their residuals below.

    Parameters
    ----------
    trajectories : DataFrame
        One row a solver and instant: ``solver`` (of `LINES`), ``time_s``, ``height_m``,
        ``velocity_m_s``, ``height_residual_m`` and ``velocity_residual_m_s``, the
        deviations from the closed form.

    Returns
    -------
    Figure
        Two columns; residuals are on a logarithmic axis, on which none is zero.
    """
    if trajectories.empty:
        return style.message_figure("No trajectories to compare.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 100.0)
    panels = figure.subplots(2, 2, sharex=True)
    for (upper, lower), name in zip(panels.T, QUANTITIES, strict=True):
        column, unit, limits, residual_limits = QUANTITIES[name]
        _draw(upper, trajectories, f"{name}_{column}")
        _draw(lower, trajectories, f"{name}_residual_{column}", residual=True)
        upper.set_ylim(limits)
        upper.set_ylabel(f"{name} ({unit})")
        lower.set_yscale("log")
        lower.set_ylim(residual_limits)
        lower.set_ylabel(f"|{name} residual| ({unit})")
        lower.set_xlabel("time (s)")
        lower.grid(axis="y")
    if (trajectories["solver"] == "printed").any():
        note = "to the letter, it leaves\nat the first contact"
        style.note(panels[0, 0], note, UNDER_THE_ARCH, (0, 0), ha="center")
    style.letters(panels.flat)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def _draw(
    axes: Axes, trajectories: pd.DataFrame, column: str, *, residual: bool = False
) -> None:
    """Draw a column for each solver: its values, or their sizes."""
    for solver, (label, colour, dash, width, marker) in LINES.items():
        rows = trajectories[trajectories["solver"] == solver]
        values = rows[column]
        if residual:
            values = values.abs().where(values != 0.0)
        if not values.notna().any():
            continue
        look: Any = {"color": colour, "linestyle": dash, "linewidth": width}
        look |= {"marker": marker, "markersize": 2.6, "label": label}
        axes.plot(rows["time_s"], values, **look)
