"""Contacts without a study: the heights of the feet in each landing, and all orders."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.feet import foot_places
from hopdata.figures import style

# Cells of a page, and their size.
COLUMNS = 4
CELL_MM = 33.0
FRAME_MM = 14.0
# Characters of an order above a cell; in longer ones feet are told by their numbers.
LONGEST_ORDER = 26
# Characters of a line of a title. Of a longer name of a recording, the middle is left
# out, since trials of one session begin alike and end in their number.
LONGEST_LINE = 28
LEFT_OUT = "\u2026"
BETWEEN = " > "
MM_PER_M = 1e3
MS_PER_S = 1e3
# The frame of a landing whose order is unsure.
UNSURE_FRAME = (0, (4, 2))
NOTHING = "No contact was found."
# The onset of a force plate.
PLATE_LINE = {"linestyle": ":", "linewidth": 0.8, "zorder": 1}
# Errors that are drawn, in standard errors.
DRAWN_ERRORS = 2.0


@style.styled
def landings_figure(
    curves: pd.DataFrame,
    contacts: pd.DataFrame,
    orders: pd.DataFrame,
    feet: Sequence[str],
    *,
    of_landings: int | None = None,
) -> Figure:
    """Draw the heights of the feet about the contacts of some landings.

    Parameters
    ----------
    curves : DataFrame
        ``recording, landing, foot, time_s, height_m`` of each frame.
    contacts, orders : DataFrame
        As in `hopdata.contact_times.ContactTimes`, of the same landings.
    feet : sequence of str
        All feet: their places give their colours; left and right have their own.
    of_landings : int, optional
        How many landings there are, if these are the first of them: it is said then.

    Returns
    -------
    Figure
        A cell for each landing: heights of the feet over the time from its first
        contact, each contact with two standard errors, and the onset of the plate
        that it loads.
    """
    if not len(orders):
        return style.message_figure(NOTHING, width_mm=style.WIDEST_PANEL_MM)
    n_rows = -(-len(orders) // COLUMNS)
    height_mm = FRAME_MM + CELL_MM * n_rows
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    cells = figure.subplots(
        n_rows, COLUMNS, squeeze=False, sharex=True, sharey=True
    ).ravel()
    for cell in cells[len(orders) :]:
        cell.set_axis_off()
    of_curves = dict(list(curves.groupby(["recording", "landing"], sort=False)))
    of_contacts = dict(list(contacts.groupby(["recording", "landing"], sort=False)))
    several = len(orders["recording"].unique()) > 1
    number = {foot: f"{place}" for place, foot in enumerate(feet, start=1)}
    number[""] = ""  # of a landing whose contacts cannot be trusted
    by_number = orders["order"].str.len().max() > LONGEST_ORDER
    for cell, order in zip(cells, orders.to_dict("records"), strict=False):
        key = (order["recording"], order["landing"])
        _draw_landing(cell, of_curves[key], of_contacts[key], feet)
        chain = order["order"]
        if by_number:
            chain = BETWEEN.join(number[foot] for foot in chain.split(BETWEEN))
        title = _title(chain, order)
        if several:
            title = f"{_shortened(order['recording'])}\n{title}"
        cell.set_title(title)
        if _is_unsure(order):
            cell.spines[:].set(visible=True, linestyle=UNSURE_FRAME, linewidth=1.0)
    shown = cells[: len(orders)]
    for cell in shown[max(0, len(orders) - COLUMNS) :]:
        cell.tick_params(labelbottom=True)
    for cell in shown[COLUMNS // 2 :: COLUMNS]:  # a narrow page begins a grid here
        cell.tick_params(labelleft=True)
    below = "time from the first contact (ms)"
    if of_landings is not None and of_landings > len(orders):
        below += f"; the first {len(orders)} of {of_landings} landings"
    figure.supxlabel(below, fontsize=style.pt(7))
    figure.supylabel("height of the foot (mm)", fontsize=style.pt(7))
    handles = []
    lines = _lines(feet)
    for place, foot in enumerate(feet):
        label = style.label_of(foot)
        if by_number:
            label = f"{place + 1}: {label}"
        handles += cells[0].plot([], [], **lines[foot], label=label)
    figure.legend(handles=handles, loc="outside upper left", ncols=len(feet))
    return figure


def _shortened(name: str) -> str:
    """Return a name without its middle if it is too long for a line."""
    if len(name) <= LONGEST_LINE:
        return name
    half = (LONGEST_LINE - len(LEFT_OUT)) // 2
    return f"{name[:half]}{LEFT_OUT}{name[-half:]}"


def _title(chain: str, order: Mapping[Any, Any]) -> str:
    """Return number and order of a landing, and how probable the order is."""
    title = f"{order['landing']}: {chain}"
    if np.isfinite(order["probability"]):
        title += f"\n{_percent(order['probability'])}"
        if _is_unsure(order):
            title += ", unsure"
    return title


def _percent(probability: float) -> str:
    """Return a probability in per cent; none that is not certain is called so."""
    percent = 100 * probability
    if percent > 99.9:
        return "over 99.9 %"
    return f"{percent:.3g} %"


def _is_unsure(order: Mapping[Any, Any]) -> bool:
    """Tell whether the order of a landing is unsure; that of one foot is not."""
    return bool(np.isfinite(order["probability"]) and not order["sure"])


def _lines(feet: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return colour and line style of each foot by name, as keywords of a line."""
    places = foot_places(feet)
    return {foot: style.foot_line(place) for foot, place in places.items()}


def _draw_landing(
    axes: Axes, curves: pd.DataFrame, contacts: pd.DataFrame, feet: Sequence[str]
) -> None:
    """Draw the heights of the feet in one landing, and its contacts."""
    found = contacts[contacts["found"]]
    zero_s = float(found["contact_s"].min())
    if not np.isfinite(zero_s):
        zero_s = float(contacts["contact_s"].min())
    axes.axhline(0.0, color="#cccccc", linewidth=0.6, zorder=0)
    lines = _lines(feet)
    for foot, curve in curves.groupby("foot", sort=False):
        x = MS_PER_S * (curve["time_s"] - zero_s)
        y = MM_PER_M * curve["height_m"]
        line = {**lines[str(foot)], "linewidth": 0.8}
        axes.plot(x, y, marker=".", markersize=1.8, **line)
    for contact in contacts.dropna(subset=["contact_s"]).to_dict("records"):
        colour = lines[str(contact["foot"])]["color"]
        curve = curves[curves["foot"] == contact["foot"]].dropna(subset=["height_m"])
        if not len(curve):
            continue
        height_m = np.interp(contact["contact_s"], curve["time_s"], curve["height_m"])
        x_ms = MS_PER_S * (contact["contact_s"] - zero_s)
        reach_ms = DRAWN_ERRORS * MS_PER_S * contact["se_s"]
        if np.isfinite(float(contact["plate_s"])):
            plate_ms = MS_PER_S * (float(contact["plate_s"]) - zero_s)
            axes.axvline(plate_ms, **{**PLATE_LINE, "color": colour})
        y_mm = MM_PER_M * float(height_m)
        axes.plot(
            [x_ms - reach_ms, x_ms, x_ms + reach_ms],
            [y_mm] * 3,
            color=colour,
            linewidth=1.6,
            marker="o" if contact["found"] else "x",
            markevery=[1],
            markersize=3,
            markerfacecolor="white",
            zorder=3,
        )


@style.styled
def spread_figure(
    contacts: pd.DataFrame, orders: pd.DataFrame, feet: Sequence[str]
) -> Figure:
    """Draw how long after the first foot each foot touched, in all landings.

    Parameters
    ----------
    contacts, orders : DataFrame
        As in `hopdata.contact_times.ContactTimes`.
    feet : sequence of str
        All feet: their places give their colours.
    """
    ordered = orders[orders["probability"].notna()]
    if not len(ordered):
        return style.message_figure(
            "No two feet landed together.", width_mm=style.WIDEST_PANEL_MM
        )
    keys = ["recording", "landing"]
    place = ordered.assign(place=np.arange(1, len(ordered) + 1))[
        [*keys, "place", "sure"]
    ]
    shown = contacts[contacts["found"]].merge(place, on=keys)
    first_s = shown.groupby("place")["contact_s"].transform("min")
    shown = shown.assign(after_ms=MS_PER_S * (shown["contact_s"] - first_s))
    figure = style.paper_figure(style.WIDEST_PANEL_MM, 60.0)
    axes = figure.subplots()
    is_sure = shown["sure"].astype(bool)
    size = 2.5 if len(ordered) < 200 else 1.5
    for foot, line in _lines(feet).items():
        own = shown["foot"] == foot
        points: dict[str, Any] = {
            "linestyle": "",
            "marker": "o",
            "markersize": size,
            "color": line["color"],
        }
        axes.errorbar(
            shown.loc[own, "place"],
            shown.loc[own, "after_ms"],
            yerr=MS_PER_S * shown.loc[own, "se_s"],
            elinewidth=0.6,
            label=style.label_of(foot),
            **points,
        )
        unsure = shown[own & ~is_sure]
        hollow: dict[str, Any] = {**points, "markerfacecolor": "white", "zorder": 3}
        axes.plot(unsure["place"], unsure["after_ms"], **hollow)
    axes.set_xlabel("landing")
    axes.set_ylabel("after the first foot (ms)")
    figure.legend(loc="outside upper left", ncols=len(feet))
    return figure
