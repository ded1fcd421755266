"""Contacts compared with those of another device: errors, and one landing."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.errors import chosen
from hopdata.feet import foot_places
from hopdata.figures import style

UNMATCHED = {"missed": ("x", "missed"), "invented": ("1", "invented")}
# Kind of instant: its label, line style, and colour if feet are not distinguished.
INSTANTS: dict[str, tuple[str, dict[str, Any], str]] = {
    "external": ("external contact", {"ls": "-", "lw": 1.2}, style.GREY),
    "found": ("contact found", {"ls": (0, (2, 1.2)), "lw": 1.0}, style.INK),
}
# Number of contacts above which the markers are small.
MANY = 300
UNITS = {"N": "N", "body_weight": "body weights"}
ALL = "all"

# Height in mm, panels (errors, shares, heights, force), and heights of their rows.
Panels = tuple[float, str, tuple[float, ...]]
WITH_FORCE: Panels = (100.0, "es;hf", (1.2, 1))
WITHOUT_FORCE: Panels = (100.0, "es;h.", (1.2, 1))


@style.styled
def contact_overlay_figure(
    contacts: pd.DataFrame, summary: pd.DataFrame, example: pd.DataFrame
) -> Figure:
    """Draw the contacts that hopdata found against those known from another device.

    Parameters
    ----------
    contacts : DataFrame
        Table ``contact_overlay``: one row per contact, see `hopdata.landings.overlay`.
    summary : DataFrame
        Table ``contact_overlay_summary``: ``recording, column, bias_s, bias_low_s,
        bias_high_s``.
    example : DataFrame
        Table ``contact_overlay_example``: ``time_s, kind, name, value, unit`` of one
        landing.

    Returns
    -------
    Figure
        (a) Difference, found minus external, of each contact over time, with its
        standard error, which includes that of the other device if it is known. (b)
        Cumulative distribution of the differences, with the median and its 95 %
        interval. (c) Foot heights and (d) force in one landing.
    """
    if not (contacts["status"] == "matched").any():
        return style.message_figure(
            "No contact could be matched with one known from elsewhere."
        )
    has_force = (example["kind"] == "force").any()
    if has_force:
        height_mm, mosaic, height_ratios = WITH_FORCE
    else:
        height_mm, mosaic, height_ratios = WITHOUT_FORCE
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    panels = figure.subplot_mosaic(
        mosaic, width_ratios=(1.6, 1), height_ratios=height_ratios
    )
    looks = _looks_of_columns(contacts, _feet_of(example))
    _draw_errors(panels["e"], contacts, looks)
    _draw_shares(panels["s"], contacts, summary, looks)
    panels["s"].sharey(panels["e"])
    panels["s"].tick_params(labelleft=False)
    _draw_example(panels, example, looks)
    style.lettered(figure, panels.values(), ncols=5)
    return figure


# Column of another device -> its colour, dashes and mark, as keywords of a line.
Looks = Mapping[str, dict[str, Any]]


def _feet_of(example: pd.DataFrame) -> list[str]:
    """Return the feet in the order of the recording."""
    return list(dict.fromkeys(example.loc[example["kind"] == "height", "name"]))


def _looks_of_columns(contacts: pd.DataFrame, feet: list[str]) -> Looks:
    """Return how each column is drawn: as its foot, or in ink if several share it."""
    places = foot_places(feet)
    of_column = contacts.drop_duplicates("column").set_index("column")["feet"]
    looks = {}
    for number, (column, of_feet) in enumerate(of_column.astype(str).items()):
        place = places.get(of_feet)
        look = {"color": style.INK, "linestyle": style.foot_dash(number)}
        if place is not None:
            look = style.foot_line(place)
        mark = style.foot_mark(number if place is None else place)
        looks[str(column)] = {**look, "marker": mark}
    return looks


def _of(contacts: pd.DataFrame, column: str, status: str) -> pd.DataFrame:
    of_column = contacts["column"].astype(str) == column
    return contacts[of_column & (contacts["status"] == status)]


def _draw_errors(axes: Axes, contacts: pd.DataFrame, looks: Looks) -> None:
    look: Any = {"ms": 3.0, "mew": 0.7, "elinewidth": 0.6, "capsize": 1.2}
    if len(contacts) > MANY:
        look = {"ms": 1.3, "mew": 0.3, "elinewidth": 0.25, "capsize": 0.0, "alpha": 0.6}
    for column, of_column in looks.items():
        matched = _of(contacts, column, "matched")
        is_excluded = matched["excluded"].astype(bool)
        used = matched[~is_excluded]
        excluded = matched[is_excluded]
        colour = of_column["color"]
        label: str | None = style.label_of(column)
        for rows, face in ((used, colour), (excluded, "white")):
            if rows.empty:
                continue
            axes.errorbar(
                rows["external_s"],
                rows["difference_s"] * 1e3,
                yerr=np.hypot(rows["se_s"], rows["external_se_s"].fillna(0)) * 1e3,
                fmt=of_column["marker"],
                color=colour,
                markerfacecolor=face,
                label=label,
                **look,
            )
            label = None  # each column is named once
    if contacts.loc[contacts["status"] == "matched", "excluded"].astype(bool).any():
        hollow: Any = {"color": style.INK, "mfc": "white", "ms": 3, "mew": 0.7}
        axes.plot([], [], "o", label="touchdown excluded", **hollow)
    for status, (marker, label) in UNMATCHED.items():
        rows = contacts[contacts["status"] == status]
        if rows.empty:
            continue
        times = rows["found_s"]
        if status == "missed":
            times = rows["external_s"]
        axes.plot(
            times,
            np.full(len(times), 0.06),
            marker,
            color=style.INK,
            ms=6,
            mew=1.1,
            transform=axes.get_xaxis_transform(),
            label=f"{label} ({len(times)})",
        )
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.6, zorder=0)
    axes.margins(y=0.12)
    axes.set(
        xlabel="time in the recording (s)", ylabel="contact, found minus\nexternal (ms)"
    )


def _draw_shares(
    axes: Axes, contacts: pd.DataFrame, summary: pd.DataFrame, looks: Looks
) -> None:
    for number, (column, look) in enumerate(looks.items()):
        matched = _of(contacts, column, "matched")
        errors = np.sort(matched["difference_s"].to_numpy() * 1e3)
        if not len(errors):
            continue
        share = (np.arange(len(errors)) + 0.5) / len(errors) * 100
        axes.step(share, errors, where="mid", **look | {"marker": ""})
        of_column = summary[summary["column"].astype(str) == column]
        _draw_bias(axes, of_column, 50 + 3 * number, look)
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.6, zorder=0)
    axes.set(xlim=(0, 100), xlabel="share of the contacts (%)")


def _draw_bias(
    axes: Axes, summary: pd.DataFrame, place: float, look: Mapping[str, Any]
) -> None:
    """Draw a column's bias and interval, over all recordings if there are several."""
    rows = summary[summary["recording"] == ALL]
    if rows.empty:
        rows = summary
    row = rows.iloc[-1]
    bias = 1e3 * float(row["bias_s"])
    low = 1e3 * float(row["bias_low_s"])
    high = 1e3 * float(row["bias_high_s"])
    interval = None
    if np.isfinite([low, high]).all():
        interval = [[bias - low], [high - bias]]
    axes.errorbar(
        place,
        bias,
        yerr=interval,
        fmt=look["marker"],
        color=style.INK,
        ms=4,
        mew=0.7,
        capsize=2.5,
        zorder=4,
        markerfacecolor=look["color"],
    )


def _draw_example(
    panels: Mapping[str, Axes], example: pd.DataFrame, looks: Looks
) -> None:
    height = panels["h"]
    places = foot_places(_feet_of(example))
    for foot, place in places.items():
        rows = example[(example["kind"] == "height") & (example["name"] == foot)]
        height.plot(
            rows["time_s"] * 1e3,
            rows["value"] * 1e3,
            **style.foot_line(place),
            marker=".",
            ms=3,
            label=style.label_of(foot),
        )
    height.set_ylabel("foot height (mm)")
    _draw_instants(height, example, places)
    height.set_xlabel("time after the first external contact (ms)")
    if "f" in panels:
        _draw_instants(panels["f"], example, places)
        _draw_force(panels["f"], example, looks)
        panels["f"].sharex(height)
        panels["f"].set_xlabel("time after the first external contact (ms)")
    height.legend(loc="best")


def _draw_instants(
    axes: Axes, example: pd.DataFrame, places: Mapping[str, int]
) -> None:
    """Draw a line at each instant, coloured if each foot has its own column."""
    external_names = set(example.loc[example["kind"] == "external", "name"])
    each_has_own = external_names <= set(places)
    for kind, (label, line, shared) in INSTANTS.items():
        for row in example[example["kind"] == kind].to_dict("records"):
            colour = shared
            if each_has_own:
                colour = style.foot_colour(places[row["name"]])
            axes.axvline(row["time_s"] * 1e3, color=colour, zorder=0, **line)
        axes.plot([], [], color=shared, label=label, **line)


def _draw_force(axes: Axes, example: pd.DataFrame, looks: Looks) -> None:
    rows = example[example["kind"] == "force"]
    columns = rows.groupby("name", sort=False)
    for number, (column, samples) in enumerate(columns):
        in_ink = {"color": style.INK, "linestyle": style.foot_dash(number)}
        axes.plot(
            samples["time_s"] * 1e3,
            samples["value"],
            **looks.get(str(column), in_ink) | {"marker": "."},
            ms=2.5,
            label=style.label_of(str(column)),
        )
    threshold = float(example.loc[example["kind"] == "threshold", "value"].iloc[0])
    axes.axhline(threshold, color=style.GREY, linestyle=(0, (1, 1)), linewidth=0.8)
    place: Any = {"xycoords": axes.get_yaxis_transform(), "ha": "right", "va": "bottom"}
    style.note(axes, "threshold", (1, threshold), (-2, 1.5), color=style.INK, **place)
    unit = chosen("unit", str(rows["unit"].iloc[0]), UNITS)
    axes.set_ylabel(f"force ({unit})")
