"""Figures of contacts: a cell for each landing, and how far feet land apart."""

import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.contacts import landings_figure, spread_figure
from hopdata.figures.style import FOOT_COLOURS, ORANGE, VERMILION

FEET = ("left", "right")


def made_up(n_landings):
    """Return curves, contacts and orders of landings; the last order is unsure."""
    curves = []
    contacts = []
    orders = []
    for landing in range(1, n_landings + 1):
        for number, foot in enumerate(FEET):
            contact_s = landing + 0.01 * number
            time = contact_s + np.arange(-0.05, 0.05, 0.01)
            height = np.maximum(contact_s - time, 0.0)
            curve = {"recording": "one", "landing": landing, "foot": foot}
            curves.append(pd.DataFrame({**curve, "time_s": time, "height_m": height}))
            instant = {"contact_s": contact_s, "se_s": 0.001, "found": True}
            instant["plate_s"] = np.nan
            contacts.append({**curve, **instant})
        probability = 0.999 if landing < n_landings else 0.6
        order = {"order": "left > right", "probability": probability}
        sure = {"sure": probability > 0.9}
        orders.append({"recording": "one", "landing": landing, **order, **sure})
    return pd.concat(curves), pd.DataFrame(contacts), pd.DataFrame(orders)


def test_each_landing_has_a_cell_and_an_unsure_order_stands_out():
    figure = landings_figure(*made_up(5), FEET)
    cells = [axes for axes in figure.axes if axes.axison]
    assert len(cells) == 5
    titles = [axes.get_title(loc="left") for axes in cells]
    assert titles[0].startswith("1: left > right\n99.9")
    assert titles[4].endswith("unsure")
    frames = [axes.spines["top"].get_linestyle() for axes in cells]
    assert frames[:4] == ["solid"] * 4
    assert frames[4] != "solid"
    assert cells[4].spines["top"].get_visible()


def test_feet_have_no_colour_of_a_warning_and_sides_keep_theirs():
    made = made_up(2)
    colours = []
    for feet in (FEET, FEET[::-1]):
        legend = landings_figure(*made, feet).legends[0]
        names = [text.get_text() for text in legend.get_texts()]
        lines = [line.get_color() for line in legend.get_lines()]
        colours.append(dict(zip(names, lines, strict=True)))
    assert colours[0] == colours[1]
    assert not {VERMILION, ORANGE} & set(FOOT_COLOURS[:4])
    assert set(colours[0].values()) < set(FOOT_COLOURS[:4])


def test_the_first_of_more_landings_are_said_to_be_so():
    some = landings_figure(*made_up(2), FEET, of_landings=85)
    assert some.get_supxlabel().endswith("the first 2 of 85 landings")
    assert "first 2" not in landings_figure(*made_up(2), FEET).get_supxlabel()


def test_contacts_of_an_unsure_order_are_hollow():
    _, contacts, orders = made_up(3)
    axes = spread_figure(contacts, orders, FEET).axes[0]
    hollow = {
        int(x)
        for line in axes.lines
        if line.get_markerfacecolor() == "white"
        for x in line.get_xdata()
    }
    assert hollow == {3}


def test_feet_of_long_orders_are_told_by_number():
    curves, contacts, orders = made_up(2)
    long = "a foot with a very long name"
    names = {"left": long, "right": "right"}
    curves["foot"] = curves["foot"].map(names)
    contacts["foot"] = contacts["foot"].map(names)
    orders["order"] = f"{long} > right"
    figure = landings_figure(curves, contacts, orders, [long, "right"])
    assert figure.axes[0].get_title(loc="left").startswith("1: 1 > 2")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[1] == "2: right"


def test_long_names_of_recordings_do_not_overlap():
    recordings = ["subject07_droplanding_40cm_shoes_trial01", "short"]
    made = [made_up(4) for _ in recordings]
    for tables, recording in zip(made, recordings, strict=True):
        for table in tables:
            table["recording"] = recording
    curves, contacts, orders = (pd.concat(tables) for tables in zip(*made, strict=True))
    figure = landings_figure(curves, contacts, orders, FEET)
    titles = [axes.get_title(loc="left").split("\n") for axes in figure.axes]
    assert titles[0][0].startswith("subject07")
    assert titles[0][0].endswith("trial01")
    assert titles[4][0] == "short"
    assert titles[4][1] == "1: left > right"
    assert text_faults(figure) == []


def test_without_a_landing_the_figure_says_so():
    none = pd.DataFrame(columns=["recording", "landing", "order", "probability"])
    figure = landings_figure(none, none, none, FEET)
    assert [text.get_text() for text in figure.texts] == ["No contact was found."]


def test_times_after_the_first_foot_are_drawn():
    _, contacts, orders = made_up(3)
    figure = spread_figure(contacts, orders, FEET)
    (axes,) = figure.axes
    left, right = (container.lines[0].get_ydata() for container in axes.containers)
    np.testing.assert_allclose(np.asarray(left, float), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.asarray(right, float), 10.0)
