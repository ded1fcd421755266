"""Fig. 4.4: run time by number of contacts, and the cost of one more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Solver: label, shade, line style. MuJoCo is dashed, as in the print.
LINES: dict[str, tuple[str, str, Any]] = {
    "printed": ("printed method, Python", style.PRINTED, "-"),
    "MuJoCo, sprung balls": (
        "MuJoCo, springs as balls on joints",
        style.PALE,
        (0, (1.5, 1.2)),
    ),
    "MuJoCo": ("MuJoCo, springs as its contacts", style.SHADE, (0, (5, 1.5))),
    "hopdata": ("hopdata", style.INK, (0, (5, 1.2, 1.5, 1.2))),
}
# Solvers that are drawn on the bed on which the bar settles: label, and marker. Both
# may have the same values, so that one is larger and hollow.
SETTLING: dict[str, tuple[str, dict[str, Any]]] = {
    "MuJoCo": (
        "MuJoCo, bar that settles",
        {"fmt": "s", "markersize": 6.0, "markerfacecolor": "none"},
    ),
    "printed": (
        "printed method, bar that settles",
        {"fmt": "o", "markersize": 3.0},
    ),
}


@style.styled
def scaling_figure(
    times: pd.DataFrame, marginal: pd.DataFrame, settling: pd.DataFrame
) -> Figure:
    """Draw run time (a) and marginal run time (b) by number of contacts.

    Parameters
    ----------
    times : DataFrame
        One row a solver (of `LINES`) and number of contacts: ``solver``,
        ``n_contacts``, ``time_q25_us``, ``time_median_us``, ``time_q75_us``.
    marginal : DataFrame
        The same for a window of numbers: ``solver``, ``n_contacts``, ``low95_us``,
        ``marginal_us``, ``high95_us``.
    settling : DataFrame
        As `marginal`, on a bed on which the bar comes to rest without bouncing.

    Returns
    -------
    Figure
        Logarithmic axes; bands are quartiles in (a) and 95 % confidence in (b).
    """
    if times.empty:
        return style.message_figure("No run times to compare.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 75.0)
    left, right = figure.subplots(1, 2)
    _bands(left, times, ("time_q25_us", "time_median_us", "time_q75_us"))
    _bands(right, marginal, ("low95_us", "marginal_us", "high95_us"))
    _points(right, settling)
    left.set_ylabel("run time per simulated second (µs)")
    right.set_ylabel("run time per further contact\nand simulated second (µs)")
    for axes in (left, right):
        axes.set_yscale("log")
        axes.set_xlabel("number of contacts")
        axes.grid(axis="y")
    left.set_xlim(right=times["n_contacts"].max())
    right.set_xlim(left.get_xlim())
    style.letters((left, right))
    handles, labels = left.get_legend_handles_labels()
    points, about_points = right.get_legend_handles_labels()
    handles += points[len(labels) :]
    labels += about_points[len(labels) :]
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def _bands(axes: Axes, table: pd.DataFrame, columns: tuple[str, str, str]) -> None:
    """Draw a line and the band about it for each solver."""
    for solver, (label, colour, dash) in LINES.items():
        rows = table[table["solver"] == solver]
        low, middle, high = (rows[column] for column in columns)
        line = (label, colour, dash, "")
        style.banded_line(axes, rows["n_contacts"], middle, (low, high), line)


def _points(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the bed on which the bar settles, for the two that the text compares."""
    for solver, (label, look) in SETTLING.items():
        colour = LINES[solver][1]
        rows = table[table["solver"] == solver]
        middle = rows["marginal_us"]
        bars = [middle - rows["low95_us"], rows["high95_us"] - middle]
        axes.errorbar(
            rows["n_contacts"], middle, yerr=bars, label=label, color=colour, **look
        )
