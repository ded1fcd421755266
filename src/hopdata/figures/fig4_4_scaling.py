"""Figure 4.4: run time on the plate by number of contacts, for MuJoCo and our integrator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    ORANGE,
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

# solver: what the reader sees, its colour, its line style.
SERIES: dict[str, tuple[str, str, Any]] = {
    "MuJoCo contact 2 ms": ("MuJoCo, its contacts, 2 ms", BLUE, (0, (5, 1.5))),
    "MuJoCo callback 2 ms": ("MuJoCo, our springs, 2 ms", GREEN, (0, (5, 1.2, 1.5, 1.2))),
    "hopdata": ("hopdata", VERMILION, "-"),
    "hopdata sums": ("hopdata, sums kept", ORANGE, (0, (1.5, 1.2))),
}


@styled
def scaling_figure(times: pd.DataFrame, marginal: pd.DataFrame) -> Figure:
    """Draw Fig. 4.4: run time (a), marginal run time (b) and error (c) by number of contacts.

    Parameters
    ----------
    times : DataFrame
        One row a solver (of `SERIES`; others are left out) and number of contacts: ``solver``,
        ``n_contacts``, ``time_median_us_per_s``, ``time_q25_us_per_s``, ``time_q75_us_per_s``,
        ``error_median`` and ``error_max``.
    marginal : DataFrame
        One row a solver and window: ``solver``, ``window`` (only ``local`` is drawn),
        ``n_contacts``, ``marginal_us_per_contact_s``, ``low95_us_per_contact_s``,
        ``high95_us_per_contact_s``.

    Returns
    -------
    Figure
        Bands are quartiles in (a), 95 % confidence in (b), and median to largest in (c).
    """
    if times.empty:
        return message_figure("No run times to compare.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 66.0)
    left, middle, right = figure.subplots(1, 3)
    local = marginal[marginal["window"] == "local"]
    _bands(left, times, "time_q25_us_per_s", "time_median_us_per_s", "time_q75_us_per_s")
    _bands(
        middle, local,
        "low95_us_per_contact_s", "marginal_us_per_contact_s", "high95_us_per_contact_s",
    )  # fmt: skip
    _bands(right, times, "error_median", "error_median", "error_max")
    left.set_ylabel("run time per simulated second (µs)")
    middle.set_ylabel("run time per further contact (µs/s)")
    right.set_ylabel("error of the final state (m, rad, 1/s)")
    left.set_yscale("log")
    right.set_yscale("log")
    middle.axhline(0.0, color="#333333", linewidth=0.5)
    for name, axes in zip("abc", (left, middle, right), strict=True):
        axes.set_xlabel("number of contacts")
        axes.grid(axis="y")
        letter(axes, name)
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _bands(axes: Axes, table: pd.DataFrame, low: str, middle: str, high: str) -> None:
    """Draw a line and the band about it for each solver."""
    for solver, (label, colour, dash) in SERIES.items():
        rows = table[table["solver"] == solver].sort_values("n_contacts")
        if rows.empty:
            continue
        axes.fill_between(
            rows["n_contacts"], rows[low], rows[high], color=colour, alpha=0.2, linewidth=0
        )
        axes.plot(rows["n_contacts"], rows[middle], color=colour, linestyle=dash, label=label)
