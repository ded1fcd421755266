import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.scaling_study import CASES, scaling_study_figure

SCALES = np.array([1, 1 / 2, 1 / 4, 1 / 8, 1 / 16])


def table(cases=tuple(CASES)):
    rows = [
        pd.DataFrame(
            {
                "case": case,
                "coupling": 0.2 * (case in ("coupling", "study")),
                "impulse": 0.3 * (case == "impulse"),
                "delay_s": 0.01 * (case == "delay"),
                "scale": SCALES,
                "pooled_rms": 0.4 * SCALES ** (1 + (case == "hopper")),
                "pooled_over_specialised": 7.0 * SCALES ** -(0.0 + 2 * (case != "hopper")),
                "map_difference": 0.8 * SCALES ** (0.0 + (case == "hopper")),
                "exact_difference": 1e-15 if case == "hopper" else 0.6,
                "slope": 1.0 + (case == "hopper"),
            }
        )
        for case in cases
    ]
    return pd.concat(rows)


def test_three_panels_with_a_line_a_case():
    figure = scaling_study_figure(table(("hopper", "coupling", "impulse", "delay")))
    first, second, third = figure.axes
    assert len(second.lines) == 4
    assert len(first.lines) == 4 + 2, "two guides"
    assert len(third.lines) == 4 + 3, "the exact differences of the controls"
    assert text_faults(figure) == []
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[0] == "hopper, slope 2.00"
    assert labels[1] == "coupled forces, κ = 0.2\nslope 1.00"


def test_a_case_without_landings_is_named():
    empty = table(("delay",)).assign(slope=np.nan, pooled_rms=np.nan, exact_difference=np.nan)
    empty[["pooled_over_specialised", "map_difference"]] = np.nan
    figure = scaling_study_figure(pd.concat([table(("hopper",)), empty]))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[1] == "contact by velocity, τ = 0.01 s\nnot between the sections"
    assert text_faults(figure) == []


def test_lines_are_the_table():
    figure = scaling_study_figure(table(("hopper", "delay")))
    for axes, column in zip(
        figure.axes, ("pooled_rms", "pooled_over_specialised", "map_difference"), strict=True
    ):
        np.testing.assert_array_equal(axes.lines[1].get_ydata(), table(("delay",))[column])
        assert [text.get_text() for text in axes.get_xticklabels()][-1] == "1"
        assert axes.get_xticklabels()[0].get_text() == "1/16"
