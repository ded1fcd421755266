"""The figure of contacts from other sources."""

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.overlay import contact_overlay_figure


def contacts(n_columns=1, n=30, unmatched=True):
    rng = np.random.default_rng(2)
    pieces = []
    for column in range(n_columns):
        table = pd.DataFrame(
            {
                "recording": "run",
                "column": f"plate{column + 1}",
                "feet": "foot1 foot2" if n_columns == 1 else f"foot{column + 1}",
                "status": "matched",
                "external_s": np.linspace(1, 29, n),
                "difference_s": rng.normal(0.002, 0.001, n),
                "se_s": 0.0008,
                "external_se_s": np.nan,
                "excluded": np.arange(n) % 10 == 3,
            }
        )
        table["found_s"] = table["external_s"] + table["difference_s"]
        if unmatched:
            table.loc[4, ["status", "found_s", "difference_s", "se_s"]] = ["missed"] + [
                np.nan
            ] * 3
            table.loc[8, ["status", "external_s", "difference_s"]] = [
                "invented",
                np.nan,
                np.nan,
            ]
        pieces.append(table)
    return pd.concat(pieces, ignore_index=True)


def summary(table):
    rows = []
    for column, group in table.groupby("column"):
        bias = group["difference_s"].median()
        rows.append({"recording": "run", "column": column, "bias_s": bias,
                     "bias_low_s": bias - 0.0003, "bias_high_s": bias + 0.0004})  # fmt: skip
    return pd.DataFrame(rows)


def example(n_feet=3, force="N"):
    time = np.arange(-0.08, 0.12, 0.01)
    rows = [
        ("external", "plate1", 0.0, np.nan, "s"),
        ("found", "foot1", 0.002, np.nan, "s"),
    ]
    for foot in range(n_feet):
        rows += [
            ("height", f"foot{foot + 1}", t, max(0.0, -t * (1 + foot)), "m")
            for t in time
        ]
    if force:
        rows += [("force", "plate1", t, max(0.0, 9000 * t), force) for t in time]
        rows += [("threshold", "plate1", 0.0, 30.0, force)]
    return pd.DataFrame(rows, columns=["kind", "name", "time_s", "value", "unit"])


def draw(n_columns=1, n_feet=3, force="N", **options):
    table = contacts(n_columns, **options)
    return contact_overlay_figure(table, summary(table), example(n_feet, force))


@pytest.mark.parametrize("n_columns", [1, 2, 6])
@pytest.mark.parametrize("n_feet", [1, 3, 6])
def test_labels_units_and_no_text_over_another(n_columns, n_feet):
    figure = draw(n_columns, n_feet)
    error, share, height, force = figure.axes
    assert error.get_ylabel() == "contact, found minus\nexternal (ms)"
    assert error.get_xlabel() == "time in the recording (s)"
    assert share.get_xlabel() == "share of the contacts (%)"
    assert height.get_ylabel() == "foot height (mm)"
    assert force.get_ylabel() == "force (N)"
    assert force.get_xlabel() == "time after the first external contact (ms)"
    assert text_faults(figure) == []


def test_each_contact_stands_with_its_error():
    table = contacts(unmatched=False)
    error = contact_overlay_figure(table, summary(table), example()).axes[0]
    used, left_out = error.containers
    shown = table[~table["excluded"]]
    np.testing.assert_allclose(
        used[0].get_ydata().astype(float), shown["difference_s"] * 1000
    )
    low, high = used[2][0].get_segments()[0][:, 1]
    assert (high - low) / 2 == pytest.approx(0.8)
    assert left_out[0].get_markerfacecolor() == "white"
    assert len(left_out[0].get_xdata()) == table["excluded"].sum()


def test_missed_and_invented_contacts_are_counted_in_the_legend():
    labels = [text.get_text() for text in draw(2).legends[0].get_texts()]
    assert sorted(labels) == [
        "invented (2)",
        "missed (2)",
        "plate1",
        "plate2",
        "touchdown excluded",
    ]


def test_the_shares_end_at_one_and_the_median_is_marked():
    table = contacts(unmatched=False)
    share = contact_overlay_figure(table, summary(table), example()).axes[1]
    x, y = share.lines[0].get_data()
    assert x[0] == pytest.approx(100 * 0.5 / 30)
    assert x[-1] == pytest.approx(100 * 29.5 / 30)
    np.testing.assert_allclose(y, np.sort(table["difference_s"]) * 1000)
    marked = share.containers[0][0].get_ydata()[0]
    assert marked == pytest.approx(table["difference_s"].median() * 1000)


def test_without_forces_there_is_no_panel_of_them():
    figure = draw(force=None)
    assert len(figure.axes) == 3
    assert figure.axes[2].get_xlabel() == "time after the first external contact (ms)"
    assert text_faults(figure) == []


def test_body_weights_and_unknown_intervals():
    table = contacts(n=3, unmatched=False)
    few = summary(table).assign(bias_low_s=np.nan, bias_high_s=np.nan)
    figure = contact_overlay_figure(table, few, example(force="body_weight"))
    assert figure.axes[3].get_ylabel() == "force (body weights)"


def test_nothing_matched_is_said():
    table = contacts().assign(status="missed")
    figure = contact_overlay_figure(table, summary(table), example())
    assert "No contact could be matched" in figure.texts[0].get_text()
