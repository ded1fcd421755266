import numpy as np
import pandas as pd
import pytest
from fake_tables import MODELS, prediction_summary, units
from overlaps import text_faults

from hopdata.figures.prediction import prediction_figure, significant, units_text


def boxes(figure):
    return figure.axes[0].patches


def test_six_boxes_in_the_printed_order():
    figure = prediction_figure(
        prediction_summary().sample(frac=1, random_state=1), units()
    )
    axes = figure.axes[0]
    names = [label.get_text().splitlines()[:2] for label in axes.get_xticklabels()]
    assert names == [
        ["affine", "(specialised)"],
        ["affine", "(near)"],
        ["affine", "(all)"],
        ["affine", "(far)"],
        ["mean", "(specialised)"],
        ["mean", "(all)"],
    ]
    assert len(boxes(figure)) == 6
    assert axes.get_yscale() == "log"
    assert text_faults(figure) == []


def test_what_it_cannot_show_is_left_to_the_caption():
    axes = prediction_figure(prediction_summary(), units()).axes[0]
    assert axes.get_title("left") == ""


def test_boxes_are_the_quantiles_given():
    table = prediction_summary()
    axes = prediction_figure(table, units()).axes[0]
    for patch, row in zip(axes.patches, table.to_dict("records"), strict=True):
        vertices = patch.get_path().vertices[:, 1]
        assert (vertices.min(), vertices.max()) == pytest.approx(
            (row["q25"], row["q75"])
        )
    ends = {float(y) for line in axes.lines for y in line.get_ydata()}
    for value in table[["p2_5", "p97_5", "median_mse"]].to_numpy().ravel():
        assert any(np.isclose(value, end, rtol=1e-12) for end in ends)


def test_units_and_split_are_written():
    axes = prediction_figure(prediction_summary(), units()).axes[0]
    assert "units: 29.1 mm and 27 ms" in axes.get_ylabel()
    assert all("120 / 41" in label.get_text() for label in axes.get_xticklabels())
    assert units_text({}) == "units not determined"


@pytest.mark.parametrize("missing", ["row", "nan"])
def test_a_model_that_was_not_fitted_is_named(missing):
    table = prediction_summary(tuple(m for m in MODELS if m != "far"))
    if missing == "nan":
        table = prediction_summary()
        table.loc[table["model"] == "far", ["median_mse", "q25", "n_train"]] = np.nan
    figure = prediction_figure(table, units())
    assert len(boxes(figure)) == 5
    said = [
        text
        for text in figure.axes[0].texts
        if text.get_text().startswith("not fitted")
    ]
    assert len(said) == 1
    assert said[0].get_position()[0] == MODELS.index("far")
    assert text_faults(figure) == []


@pytest.mark.parametrize("spread", [1.02, 3.0, 1e4])
def test_at_least_two_ticks_hold_the_boxes_between_them(spread):
    low, high = 0.06, 0.06 * spread
    row = {
        "model": "all",
        "p2_5": low,
        "q25": low,
        "median_mse": low,
        "q75": high,
        "p97_5": high,
    }
    figure = prediction_figure(pd.DataFrame([row]), units())
    axes = figure.axes[0]
    bottom, top = axes.get_ylim()
    ticks = [tick for tick in axes.get_yticks() if bottom <= tick <= top]
    assert len(ticks) >= 2
    assert bottom <= low
    assert top >= high


def test_no_whisker_lies_on_the_line_of_an_axis():
    row = {
        "model": "all",
        "p2_5": 0.00102,
        "q25": 0.01,
        "median_mse": 0.02,
        "q75": 0.05,
    }
    figure = prediction_figure(pd.DataFrame([row | {"p97_5": 0.0984}]), units())
    assert figure.axes[0].get_ylim() == pytest.approx((0.0005, 0.2))


def test_errors_of_zero_do_not_break_the_logarithmic_axis():
    row = {
        "model": "all",
        "p2_5": 0.0,
        "q25": 0.0,
        "median_mse": 0.0,
        "q75": 0.0,
        "p97_5": 0.0,
    }
    figure = prediction_figure(pd.DataFrame([row]), units())
    assert np.isfinite(figure.axes[0].get_ylim()).all()
    assert text_faults(figure) == []


def test_one_model_and_extra_columns_are_enough():
    table = (
        prediction_summary(("mean",))
        .assign(remark="x")
        .drop(columns=["n_train", "n_test"])
    )
    figure = prediction_figure(table, units())
    assert len(boxes(figure)) == 1
    assert text_faults(figure) == []


def test_no_model_is_said():
    figure = prediction_figure(pd.DataFrame(columns=["model", "median_mse"]), {})
    assert "No model could be fitted" in figure.texts[0].get_text()


def test_three_digits():
    cases = (0.00195, 29.13, 27.0, 2860.4)
    assert [significant(v) for v in cases] == ["0.00195", "29.1", "27", "2860"]
