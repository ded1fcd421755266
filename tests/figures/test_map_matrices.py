import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.map_matrices import INPUTS, OUTPUTS, matrices_figure


def table(matrix):
    return pd.DataFrame(
        {
            "input": np.repeat(list(INPUTS), 11),
            "output": np.tile(list(OUTPUTS), 8),
            "standardised": matrix.T.ravel(),
        }
    )


TRUE = np.random.default_rng(1).normal(size=(11, 8))
FOUND = {"printed": TRUE + 0.2, "ols": 0 * TRUE, "corrected_curved": TRUE - 0.05}
ESTIMATES = pd.concat([table(m).assign(estimator=name) for name, m in FOUND.items()])


def images(figure):
    panels = [axes for axes in figure.axes if axes.images]
    return [(axes.get_title(loc="left"), axes.images[0]) for axes in panels]


def test_maps_and_differences_side_by_side():
    figure = matrices_figure(ESTIMATES, table(TRUE))
    shown = images(figure)
    expected = (TRUE, FOUND["printed"], FOUND["corrected_curved"], 0 * TRUE + 0.2, 0 * TRUE - 0.05)
    assert len(shown) == 5
    for (_, image), matrix in zip(shown, expected, strict=True):
        np.testing.assert_allclose(image.get_array(), matrix, atol=1e-12)
    assert shown[0][0] == "exact"
    limits = [image.get_clim() for _, image in shown]
    assert limits[0] == limits[1] == limits[2] != limits[3] == limits[4]
    assert all(low == -high for low, high in limits)
    assert text_faults(figure) == []


def test_without_an_exact_map_the_estimates_are_compared():
    figure = matrices_figure(ESTIMATES)
    shown = images(figure)
    assert len(shown) == 3
    np.testing.assert_allclose(shown[2][1].get_array(), 0.25, atol=1e-12)
    assert text_faults(figure) == []


def test_maps_that_were_not_estimated_are_said_to_be_missing():
    (text,) = matrices_figure(ESTIMATES[ESTIMATES["estimator"] == "printed"]).texts
    assert "too few landings" in text.get_text()
