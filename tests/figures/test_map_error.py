import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.map_error import LINES, map_error_figure

SIZES = (60, 120, 250, 500, 1000, 2784)


def errors(ways=("split_fit", "savitzky_golay"), noises=(0.0, 0.3, 0.6, 1.2)):
    rows = [
        (way, noise, estimator, size, middle, 0.8 * middle, 1.3 * middle)
        for way in ways
        for noise in noises
        for k, estimator in enumerate(("ols", *LINES))
        for size in SIZES
        for middle in [(0.02 + 0.1 * noise + 1 / (k + 3)) / np.sqrt(size)]
    ]  # fmt: skip
    columns = ["states", "noise_mm", "estimator", "landings", "median", "q05", "q95"]
    return pd.DataFrame(rows, columns=columns)


def test_a_panel_for_each_noise_and_way():
    figure = map_error_figure(errors())
    assert len(figure.axes) == 8
    assert [axes.get_title(loc="left") for axes in figure.axes[:4]] == [
        "no noise", "0.3 mm", "0.6 mm", "1.2 mm",
    ]  # fmt: skip
    assert {len(axes.lines) for axes in figure.axes} == {len(LINES)}
    assert text_faults(figure) == []


def test_lines_are_the_table():
    table = errors(ways=("split_fit",), noises=(0.6,))
    (axes,) = map_error_figure(table).axes
    for line, name in zip(axes.lines, LINES, strict=True):
        rows = table[table["estimator"] == name]
        np.testing.assert_array_equal(line.get_xdata(), rows["landings"])
        np.testing.assert_array_equal(line.get_ydata(), rows["median"])
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_nothing_to_show_is_said():
    (text,) = map_error_figure(errors().iloc[:0]).texts
    assert "No errors" in text.get_text()
