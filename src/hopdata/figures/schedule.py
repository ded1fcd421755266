"""Figure 2.3: one touchdown, from foot heights to the order of contacts."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.errors import chosen
from hopdata.feet import foot_places
from hopdata.figures import style

# Instant and standard error for each foot, ms.
Contacts = Mapping[str, tuple[float, float]]

# The method whose standard errors are those of the instants, not of rounding alone.
KINK = "kink"
# `UNDETERMINED_S` of the kink fit: such an error means that none was seen.
UNDETERMINED_MS = 15.0
# What the probability of an order rests on, by method.
SURE_BY = {
    KINK: "{} % sure",
    "velocity_minimum": "{} % by rounding alone",
    "velocity_minimum_parabola": "{} % by noise alone",
}


def touchdown_of(example: pd.DataFrame, touchdowns: pd.DataFrame) -> dict[str, Any]:
    """Return the touchdown that `example` shows, by recording and index, or nothing."""
    if example.empty:
        return {}
    shown = example.iloc[0]
    of_recording = touchdowns["recording"] == shown["recording"]
    rows = touchdowns[of_recording & (touchdowns["touchdown"] == shown["touchdown"])]
    if rows.empty:
        return {}
    return {str(key): value for key, value in rows.to_dict("records")[0].items()}


@style.styled
def schedule_figure(example: pd.DataFrame, touchdowns: pd.DataFrame) -> Figure:
    """Draw Fig. 2.3: heights, vertical velocities and contacts of one touchdown.

    Parameters
    ----------
    example : DataFrame
        Tidy samples of one touchdown: its ``recording, index``; ``time_s`` (relative to
        the pre section), ``foot``, ``height_m``, ``velocity_m_s``.
    touchdowns : DataFrame
        The touchdown table; of the example's row, ``method``, ``t_pre_s``,
        ``t_post_s``, ``contact_<foot>_s``, ``se_<foot>_s``, ``schedule`` and, if
        present, ``probability`` are used.

    Returns
    -------
    Figure
        (a) Heights and (b) velocities, with a plus at each contact. (c) The contacts
        with their standard errors, earliest at the top.
    """
    names = tuple(dict.fromkeys(example["foot"]))
    touchdown = touchdown_of(example, touchdowns)
    if not touchdown:
        return style.message_figure("No usable touchdown to show as an example.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 74.0)
    mosaic: Any = [["height", "contact"], ["velocity", "contact"]]
    panels = figure.subplot_mosaic(mosaic, width_ratios=(1.9, 1))
    panels["velocity"].sharex(panels["height"])
    contacts = _contacts(touchdown, names)
    by_kink = touchdown["method"] == KINK
    _draw_signal(
        panels["height"], example, names, contacts, "height_m", at_kink=by_kink
    )
    _draw_signal(
        panels["velocity"], example, names, contacts, "velocity_m_s", at_kink=False
    )
    _shade_transition(panels, touchdown)
    _draw_contacts(panels["contact"], names, contacts, touchdown)
    panels["height"].set_ylabel("foot height (mm)")
    panels["height"].tick_params(labelbottom=False)
    panels["velocity"].set_ylabel("vertical velocity,\nsmoothed (m/s)")
    panels["velocity"].set_xlabel("time after the pre section (ms)")
    panels["contact"].set_xlabel(
        "contact after the pre section\n(ms; bars: ±1 standard error)"
    )
    style.letters(panels[name] for name in ("height", "velocity", "contact"))
    named = panels["height"].get_legend_handles_labels()
    figure.legend(*named, loc="outside lower center", ncols=len(names) + 2)
    return figure


def _contacts(touchdown: Mapping[str, Any], feet: Sequence[str]) -> Contacts:
    """Return contact after the pre section and standard error, ms; NaN if unknown."""
    t_pre_s = float(touchdown["t_pre_s"])
    found = {}
    for foot in feet:
        instant_s = float(touchdown.get(f"contact_{foot}_s", np.nan))
        error_s = float(touchdown.get(f"se_{foot}_s", np.nan))
        found[foot] = ((instant_s - t_pre_s) * 1e3, error_s * 1e3)
    return found


def _draw_signal(
    axes: Axes,
    example: pd.DataFrame,
    feet: Sequence[str],
    contacts: Contacts,
    column: str,
    *,
    at_kink: bool,
) -> None:
    """Draw one quantity of every foot, with a plus at its contact."""
    scale = 1e3 if column == "height_m" else 1.0
    places = foot_places(feet)
    for foot, place in places.items():
        rows = example[example["foot"] == foot]
        time = rows["time_s"].to_numpy() * 1e3
        value = rows[column].to_numpy() * scale
        axes.plot(time, value, **style.foot_line(place), label=style.label_of(foot))
        seen = np.isfinite(value)
        instant, _ = contacts[foot]
        if np.isfinite(instant) and seen.any():
            at_contact = _level_at(instant, time[seen], value[seen], at_kink)
            axes.plot(
                instant, at_contact, "+", color=style.INK, ms=6, mew=0.9, zorder=4
            )
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.5, zorder=0)


def _level_at(instant: float, time: Any, value: Any, of_kink: bool) -> float:
    """Interpolate a signal; at a kink, extrapolate from the two frames before it."""
    before = int(np.searchsorted(time, instant)) - 1
    if not of_kink or before < 1:
        return float(np.interp(instant, time, value))
    slope = (value[before] - value[before - 1]) / (time[before] - time[before - 1])
    return float(value[before] + slope * (instant - time[before]))


def _shade_transition(panels: Mapping[str, Axes], touchdown: Mapping[str, Any]) -> None:
    end = (float(touchdown["t_post_s"]) - float(touchdown["t_pre_s"])) * 1e3
    for name in ("height", "velocity"):
        panels[name].axvspan(
            0.0, end, color=style.BETWEEN_SECTIONS, alpha=0.35, linewidth=0, zorder=-1
        )
    panels["height"].plot([], [], "+", color=style.INK, ms=6, mew=0.9, label="contact")
    panels["height"].fill_between(
        [], [], color=style.BETWEEN_SECTIONS, alpha=0.35, label="transition"
    )


def _draw_contacts(
    axes: Axes, feet: Sequence[str], contacts: Contacts, touchdown: Mapping[str, Any]
) -> None:
    """Draw one row per foot, earliest contact on top, with bars of one se."""
    instants = [contacts[foot][0] for foot in feet]
    by_instant = np.argsort(np.nan_to_num(instants, nan=np.inf), kind="stable")
    order = by_instant.tolist()  # feet that did not touch come last
    places = foot_places(feet)
    for row, number in enumerate(order):
        instant, error = contacts[feet[number]]
        colour = style.foot_colour(places[feet[number]])
        look: Any = {"fmt": "o", "color": colour, "ms": 2.2, "capsize": 3.5}
        dash: Literal["-", "--"] = "-"
        if touchdown["method"] == KINK and error >= UNDETERMINED_MS:
            look |= {"mfc": "white", "capsize": 0, "alpha": 0.6}
            dash = "--"
            axes.text(
                instant, row - 0.12, "not determined", ha="center", color=style.INK
            )
        bars = axes.errorbar(instant, row, xerr=error, **look).lines[2]
        bars[0].set_linestyle(dash)
        if not np.isfinite(instant):
            across = axes.get_yaxis_transform()
            axes.text(0.5, row, "no contact", transform=across, ha="center")
    names = [style.label_of(feet[number]) for number in order]
    axes.set_yticks(range(len(feet)), names)
    axes.set_ylim(len(feet) - 0.4, -0.6)
    axes.margins(x=0.15)
    axes.grid(axis="x")
    axes.set_title(_order_text(touchdown))


def _order_text(touchdown: Mapping[str, Any]) -> str:
    """Return how sure the order is; the rows of the panel show it."""
    schedule = touchdown.get("schedule")
    if not isinstance(schedule, str) or not schedule:
        return "order not determined"
    probability = touchdown.get("probability")
    if probability is None or not np.isfinite(float(probability)):
        return ""
    value = float(probability)
    share = f"{100 * value:.3g}"
    if value > 0.999:
        share = "> 99.9"
    sure = chosen("touchdowns.method", touchdown["method"], SURE_BY).format(share)
    return f"order {sure}"
