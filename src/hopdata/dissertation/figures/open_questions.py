"""Figures of the part on open questions: a filter and a gradient through contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import ticker

from hopdata.figures import style
from hopdata.hybrid.filtering import confidence_limit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

N_STATES = 12
CONFIDENCE = 0.95
# Miss at which a target counts as reached, cm and degrees.
REACHED = 1e-3
# What a filter or a gradient is drawn with: label, colour and line.
WITH = ("with saltation matrices", style.OURS, "-")
WITHOUT = ("without", style.PRINTED, "--")


@style.styled
def filters(table: pd.DataFrame) -> Figure:
    """Draw the errors of two filters over time, and how often they keep their word.

    Parameters
    ----------
    table : DataFrame
        As `hopdata.dissertation.parts.open_questions.track_all` returns it, of all
        seeds.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 62.0)
    over_time, shares = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    limit = confidence_limit(N_STATES, share=CONFIDENCE)
    hopper = table[table["legs"] == "hopper"]
    _shade_contacts(over_time, hopper)
    for name, (label, colour, dash) in (("saltation", WITH), ("none", WITHOUT)):
        own = hopper[hopper["filtered_by"] == name].groupby("time_s")["prediction"]
        median = own.median().reset_index()
        band = own.quantile(0.25), own.quantile(0.75)
        line = (label, colour, dash, "")
        times, errors = median["time_s"], median["prediction"]
        style.banded_line(over_time, times, errors, band, line)
    over_time.axhline(limit, color=style.INK, linewidth=0.7, linestyle=":")
    style.note(over_time, "95 % of errors\nshould be below", (0.52, limit), (0, 3))
    over_time.set_yscale("log")
    style.plain_numbers(over_time.yaxis)
    over_time.set_yticks([5, 10, 20, 50, 100])
    over_time.set_xlim(0, hopper["time_s"].max())
    over_time.set(
        xlabel="time since the apex (s)",
        ylabel="normalised error of the prediction\n(12 states; median and quartiles)",
    )
    over_time.legend(loc="upper left", bbox_to_anchor=(0.0, 1.0))
    _draw_shares(shares, table, limit)
    style.letters((over_time, shares))
    return figure


def _shade_contacts(axes: Axes, table: pd.DataFrame) -> None:
    """Shade the times at which feet touch or leave the floor in some run."""
    share = table.groupby("time_s")["contact"].mean()
    times = share.index.to_numpy()
    step = float(np.diff(times).mean())
    for time in times[share.to_numpy() > 0]:
        axes.axvspan(time - step, time, color=style.GREY, alpha=0.15, linewidth=0)


def _draw_shares(axes: Axes, table: pd.DataFrame, limit: float) -> None:
    """Draw the share of errors within the confidence, at contacts and elsewhere."""
    groups = {
        "frames with\na contact": (table["legs"] == "hopper") & table["contact"],
        "frames\nwithout": (table["legs"] == "hopper") & ~table["contact"],
        "legs without\npreload": (table["legs"] != "hopper") & table["contact"],
    }
    width = 0.38
    for k, chosen in enumerate(groups.values()):
        for offset, name, (_, colour, _) in (
            (-0.5, "saltation", WITH),
            (0.5, "none", WITHOUT),
        ):
            own = table[chosen & (table["filtered_by"] == name)]
            held = (own["prediction"] < limit).groupby(own["seed"]).mean()
            share = 100 * float(held.median())
            place = k + offset * width
            axes.bar(place, share, width * 0.94, color=colour, alpha=0.75, linewidth=0)
            style.note(
                axes,
                f"{share:.0f}",
                (place, share),
                (0, -3),
                ha="center",
                va="top",
                color="white",
                fontweight="bold",
            )
    axes.axhline(100 * CONFIDENCE, color=style.INK, linewidth=0.7, linestyle=":")
    axes.set_xticks(range(len(groups)), list(groups))
    axes.tick_params(axis="x", length=0)
    axes.set_ylim(0, 104)
    axes.set_yticks([0, 25, 50, 75, 95])
    axes.set_ylabel("errors within the 95 % confidence (%)")


@style.styled
def convergence(table: pd.DataFrame) -> Figure:
    """Draw what is left of the way to each target over the evaluations.

    Parameters
    ----------
    table : DataFrame
        As `hopdata.dissertation.parts.open_questions.optimise_both` returns it, of all
        seeds.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 60.0)
    panels = figure.subplots(1, 2, sharey=True)
    titles = {
        "place": "target: place",
        "place and heading": "target: place and heading",
    }
    for axes, (goal, title) in zip(panels, titles.items(), strict=True):
        _draw_runs(axes, table[table["goal"] == goal])
        axes.axhline(REACHED, color=style.INK, linewidth=0.7, linestyle=":")
        right = table["evaluation"].max()
        style.note(axes, "reached (0.01 mm)", (right, REACHED), (-2, 2), ha="right")
        axes.set_xlim(1, right)
        axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
        axes.set_title(title, fontsize=style.pt(7))
        axes.set_xlabel("hops tried, each with its gradient")
    panels[0].set_ylabel("miss of the next apex (cm and degrees)")
    panels[0].legend(loc="upper right")
    style.letters(panels)
    return figure


def _draw_runs(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the best miss so far of each target, by gradient."""
    looks = {"through contacts": WITH, "contacts ignored": WITHOUT}
    for name, (_, colour, dash) in looks.items():
        label: str | None = f"gradient, {name}"
        for _, run in table[table["gradient"] == name].groupby("seed", sort=False):
            axes.plot(
                run["evaluation"],
                run["best"],
                color=colour,
                linestyle=dash,
                linewidth=1.0,
                marker=".",
                markersize=2.5,
                label=label,
            )
            label = None
    axes.set_yscale("log")
