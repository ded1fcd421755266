import numpy as np
import pandas as pd
import pytest
from fake_tables import example, feet_names, touchdown
from overlaps import text_faults

from hopdata.figures.schedule import schedule_figure, touchdown_of
from hopdata.landings.contacts.timing import METHODS


def drawn(samples, row):
    return schedule_figure(samples, pd.DataFrame([row]))


@pytest.mark.parametrize("n_feet", [2, 3, 4, 6])
def test_any_number_of_feet(n_feet):
    row = touchdown(n_feet)
    height, contact, velocity = (figure := drawn(example(row, n_feet), row)).axes
    assert height.get_ylabel() == "foot height (mm)"
    assert velocity.get_ylabel() == "vertical velocity,\nsmoothed (m/s)"
    assert velocity.get_xlabel() == "time after the pre section (ms)"
    assert "±1 standard error" in contact.get_xlabel()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [*feet_names(n_feet), "contact", "transition"]
    assert len(contact.containers) == n_feet
    assert text_faults(figure) == []


def test_contacts_stand_in_order_with_their_errors():
    row = touchdown(3)
    contact = drawn(example(row), row).axes[1]
    order = [int(foot) for foot in row["schedule"].split(">")]
    ticks = [label.get_text() for label in contact.get_yticklabels()]
    assert ticks == [f"foot{i}" for i in order]
    assert contact.get_title(loc="left") == "order 98.7 % sure"
    for container, foot in zip(contact.containers, order, strict=True):
        instant = (row[f"contact_foot{foot}_s"] - row["t_pre_s"]) * 1000
        low, high = container[2][0].get_segments()[0][:, 0]
        assert (low + high) / 2 == pytest.approx(instant)
        assert (high - low) / 2 == pytest.approx(0.9)


BY_METHOD = {
    "kink": "98.7 % sure",
    "velocity_minimum": "98.7 % by rounding alone",
    "velocity_minimum_parabola": "98.7 % by noise alone",
}


@pytest.mark.parametrize("method", METHODS)
def test_an_order_is_as_sure_as_its_method_can_tell(method):
    row = touchdown(3) | {"method": method, "se_foot2_s": 0.03}
    figure = drawn(example(row), row)
    contact = figure.axes[1]
    assert BY_METHOD[method] in contact.get_title(loc="left")
    assert contact.get_title(loc="left").count("sure") == (method == "kink")
    undetermined = [text.get_text() for text in contact.texts].count("not determined")
    assert undetermined == (method == "kink")
    assert text_faults(figure) == []


@pytest.mark.parametrize("method", METHODS)
def test_only_a_kink_lies_where_two_lines_meet(method):
    """The others are instants of the smoothed velocity, so their plus lies on the drawn heights."""
    row = touchdown(2) | {"method": method}
    table = example(row, 2)
    axes = drawn(table, row).axes[0]
    pluses = [line for line in axes.lines if line.get_marker() == "+"][:2]
    for plus, foot in zip(pluses, feet_names(2), strict=True):
        rows = table[table["foot"] == foot]
        level = np.interp(
            plus.get_xdata()[0] / 1000, rows["time_s"], 1e3 * rows["height_m"]
        )
        assert (plus.get_ydata()[0] == pytest.approx(level)) == (method != "kink")


def test_a_contact_that_is_not_determined_looks_so():
    row = touchdown(3)
    figure = drawn(example(row), row | {"se_foot2_s": 0.03})
    contact = figure.axes[1]
    shown = [
        contact.containers[row["schedule"].split(">").index(foot)] for foot in "123"
    ]
    assert [one[0].get_markerfacecolor() == "white" for one in shown] == [
        False,
        True,
        False,
    ]
    assert [text.get_text() for text in contact.texts].count("not determined") == 1
    assert text_faults(figure) == []


def test_the_transition_is_shaded_from_pre_to_post():
    row = touchdown(3)
    for axes in drawn(example(row), row).axes[::2]:
        (band,) = axes.patches
        extent = band.get_extents().transformed(axes.transData.inverted())
        assert (extent.x0, extent.x1) == pytest.approx((0, 130))


def test_the_plus_lies_on_the_curve():
    row = touchdown(2)
    table = example(row, 2)
    axes = drawn(table, row).axes[2]
    pluses = [line for line in axes.lines if line.get_marker() == "+"]
    assert len(pluses) == 2
    for plus, foot in zip(pluses, feet_names(2), strict=True):
        rows = table[table["foot"] == foot]
        at = plus.get_xdata()[0] / 1000
        assert plus.get_ydata()[0] == pytest.approx(
            np.interp(at, rows["time_s"], rows["velocity_m_s"])
        )


def test_a_foot_without_a_contact_and_an_unknown_order_are_said():
    row = touchdown(3) | {
        "contact_foot2_s": np.nan,
        "se_foot2_s": np.nan,
        "schedule": np.nan,
    }
    contact = (figure := drawn(example(touchdown(3)), row)).axes[1]
    assert "no contact" in [text.get_text() for text in contact.texts]
    assert contact.get_title(loc="left") == "order not determined"
    assert contact.get_yticklabels()[-1].get_text() == "foot2"
    assert text_faults(figure) == []


def test_gaps_in_the_samples_do_not_move_the_plus_to_nan():
    row = touchdown(2)
    table = example(row, 2)
    table.loc[table["time_s"].between(0.03, 0.08), ["height_m", "velocity_m_s"]] = (
        np.nan
    )
    axes = drawn(table, row).axes[0]
    pluses = [line for line in axes.lines if line.get_marker() == "+"]
    assert len(pluses) == 3  # two feet and the legend's own, which is empty
    assert np.isfinite([line.get_ydata()[0] for line in pluses[:2]]).all()


def test_without_an_example_the_figure_says_so():
    row = touchdown(3)
    for figure in (
        drawn(example(row).iloc[:0], row),
        drawn(example(row), row | {"recording": "other"}),
    ):
        assert "No usable touchdown" in figure.texts[0].get_text()


def test_the_row_of_the_example_is_found_by_recording_and_index():
    row = touchdown(3)
    others = [row | {"touchdown": 6}, row | {"recording": "other"}]
    table = pd.DataFrame([*others, row])
    assert touchdown_of(example(row), table) == row
    assert touchdown_of(example(row), table.iloc[:2]) == {}
    assert touchdown_of(example(row).iloc[:0], table) == {}
