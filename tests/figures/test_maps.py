import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.maps import (
    CASES,
    INPUTS,
    OUTPUTS,
    matrices_figure,
    scaling_study_figure,
)


def table(matrix):
    return pd.DataFrame(
        {
            "input": np.repeat(list(INPUTS), 11),
            "output": np.tile(list(OUTPUTS), 8),
            "value": 0.5 * matrix.T.ravel(),
            "standardised": matrix.T.ravel(),
        }
    )


TRUE = np.random.default_rng(1).normal(size=(11, 8))
FOUND = {"printed": TRUE + 0.2, "ols": TRUE + 0.2, "corrected_curved": TRUE - 0.05}
ESTIMATES = pd.concat([table(m).assign(estimator=name) for name, m in FOUND.items()])


def noise_removed(share):
    """Return what is used of ``map_estimates.json``."""
    corrected = {"corrected_curved": {"noise_removed": share}}
    return {"maps": corrected, "n_landings": 1622}


ALL_REMOVED = noise_removed(1.0)


def images(figure):
    panels = [axes for axes in figure.axes if axes.images]
    return [(axes.get_title(loc="left"), axes.images[0]) for axes in panels]


def test_cells_that_noise_explains_are_grey():
    """One cell is uncertain: it is left out of the maps and of the difference to the other map."""
    found = ESTIMATES.assign(standard_error=1e-9)
    bad = (found["input"] == "pitch_rad") & (found["output"] == "turn_rad")
    found.loc[bad, "standard_error"] = 10.0
    for _, image in images(matrices_figure(found, ALL_REMOVED)):
        mask = np.ma.getmaskarray(image.get_array())
        assert mask[list(OUTPUTS).index("turn_rad"), list(INPUTS).index("pitch_rad")]
        assert mask.sum() == 1


def test_maps_and_differences_side_by_side():
    figure = matrices_figure(ESTIMATES, ALL_REMOVED, table(TRUE))
    shown = images(figure)
    expected = (
        TRUE,
        FOUND["printed"],
        FOUND["corrected_curved"],
        0 * TRUE + 0.2,
        0 * TRUE - 0.05,
    )
    assert len(shown) == 5
    for (_, image), matrix in zip(shown, expected, strict=True):
        np.testing.assert_allclose(image.get_array(), matrix, atol=1e-12)
    assert shown[0][0] == "exact"
    limits = [image.get_clim() for _, image in shown]
    assert limits[0] == limits[1] == limits[2] != limits[3] == limits[4]
    assert all(low == -high for low, high in limits)
    assert text_faults(figure) == []


@pytest.mark.parametrize(
    ("share", "title"),
    [
        (1.0, "noise and curvature\ncorrected"),
        (0.113, "curvature and 11 %\nof noise corrected"),
        (0.0, "curvature\ncorrected"),
    ],
)
def test_the_corrected_map_says_for_what_it_was_corrected(share, title):
    figure = matrices_figure(ESTIMATES, noise_removed(share), table(TRUE))
    assert images(figure)[2][0] == title
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert "maps (mm per sd of the input), 1,622 landings" in labels
    assert text_faults(figure) == []


def test_a_bent_line_tells_where_its_slope_goes():
    bent = table_scaling_study(("hopper",))
    bent["pooled_rms"] = SCALES**2 / (1 + 3 * SCALES)
    figure = scaling_study_figure(bent.assign(slope=1.73))
    label = figure.legends[0].get_texts()[0].get_text()
    assert label == "hopper, slope 1.73, at the end 1.79"


@pytest.mark.parametrize("exact", [None, pd.DataFrame(columns=["input", "output"])])
def test_without_an_exact_map_the_estimates_are_compared(exact):
    figure = matrices_figure(ESTIMATES, ALL_REMOVED, exact)
    shown = images(figure)
    assert len(shown) == 3
    np.testing.assert_allclose(shown[2][1].get_array(), 0.25, atol=1e-12)
    assert text_faults(figure) == []


def test_maps_that_were_not_estimated_are_said_to_be_missing():
    (text,) = matrices_figure(
        ESTIMATES[ESTIMATES["estimator"] == "printed"], ALL_REMOVED
    ).texts
    assert "too few landings" in text.get_text()


SCALES = np.array([1, 1 / 2, 1 / 4, 1 / 8, 1 / 16])


def table_scaling_study(cases=("hopper", *CASES)):
    rows = [
        pd.DataFrame(
            {
                "case": case,
                "coupling": 0.2 * (case in ("coupling", "study")),
                "impulse": 0.3 * (case == "impulse"),
                "delay_s": 0.01 * (case == "delay"),
                "scale": SCALES,
                "pooled_rms": 0.4 * SCALES ** (1 + (case == "hopper")),
                "pooled_over_specialised": 7.0
                * SCALES ** -(0.0 + 2 * (case != "hopper")),
                "map_difference": 0.8 * SCALES ** (0.0 + (case == "hopper")),
                "exact_difference": 1e-15 if case == "hopper" else 0.6,
                "slope": 1.0 + (case == "hopper"),
            }
        )
        for case in cases
    ]
    return pd.concat(rows)


def test_three_panels_with_a_line_a_case():
    figure = scaling_study_figure(
        table_scaling_study(("hopper", "coupling", "impulse", "delay"))
    )
    first, second, third = figure.axes
    assert len(second.lines) == 4
    assert len(first.lines) == 4 + 2, "two guides"
    assert len(third.lines) == 4 + 3, "the exact differences of the controls"
    assert text_faults(figure) == []
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[0] == "hopper, slope 2.00, at the end 2.00"
    assert labels[1] == "coupled forces, κ = 0.2\nslope 1.00, at the end 1.00"
    assert labels[4:] == ["slope 1, to compare", "slope 2, to compare"]
    inside = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert inside == ["a", "b", "c"], "no text lies on a line"


def numbers_in_sight(axes):
    """Return the numbers of the upright axis that are drawn, with their texts."""
    axes.figure.draw_without_rendering()
    low, high = axes.get_ylim()
    ticks = [*axes.yaxis.get_major_ticks(), *axes.yaxis.get_minor_ticks()]
    inside = [tick for tick in ticks if low <= tick.get_loc() <= high]
    return {tick.get_loc(): tick.label1.get_text() for tick in inside}


SUPERSCRIPTS = {10: "¹", 100: "²", 1000: "³"}


def test_an_axis_within_a_decade_has_plain_numbers_and_a_longer_one_powers_of_ten():
    near = table_scaling_study(("coupling",)).assign(
        map_difference=[0.83, 1.0, 1.08, 1.15, 1.2], exact_difference=1.25
    )
    _, second, third = scaling_study_figure(near).axes
    shown = numbers_in_sight(third)
    assert len(shown) >= 3
    assert all(float(text) == pytest.approx(at) for at, text in shown.items())
    assert second.get_ylim()[1] / second.get_ylim()[0] > 10
    labels = numbers_in_sight(second)
    for power in (10, 100, 1000):
        assert labels[power] == f"10{SUPERSCRIPTS[power]}"


def test_a_case_without_landings_is_named():
    empty = table_scaling_study(("delay",)).assign(
        slope=np.nan, pooled_rms=np.nan, exact_difference=np.nan
    )
    empty[["pooled_over_specialised", "map_difference"]] = np.nan
    figure = scaling_study_figure(pd.concat([table_scaling_study(("hopper",)), empty]))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[1] == "contact by velocity, τ = 0.01 s\nnot between the sections"
    assert text_faults(figure) == []


def test_lines_are_the_table_scaling_study():
    figure = scaling_study_figure(table_scaling_study(("hopper", "delay")))
    for axes, column in zip(
        figure.axes,
        ("pooled_rms", "pooled_over_specialised", "map_difference"),
        strict=True,
    ):
        np.testing.assert_array_equal(
            axes.lines[1].get_ydata(), table_scaling_study(("delay",))[column]
        )
        assert [text.get_text() for text in axes.get_xticklabels()][-1] == "1"
        assert axes.get_xticklabels()[0].get_text() == "1/16"
