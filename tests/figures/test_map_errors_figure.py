import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.map_errors import MODELS, SHORT, SOURCES, map_errors_figure

SIZES = np.array([30, 120, 480, 2800])
INPUTS = list(SHORT)[:8]
OUTPUTS = [*list(SHORT)[8:], *INPUTS]


def errors(models=tuple(MODELS)):
    rows = [
        pd.DataFrame(
            {
                "source": source,
                "model": model,
                "landings": SIZES,
                "draws": 200,
                "median": 0.13 + 3 / SIZES,
                "q05": 0.12 + 2 / SIZES,
                "q95": 0.14 + 4 / SIZES,
            }
        )
        for source in SOURCES
        for model in models
    ]
    return pd.concat(rows)


def entries():
    rng = np.random.default_rng(1)
    names = [(output, given) for output in OUTPUTS for given in INPUTS]
    parts = [
        pd.DataFrame(names, columns=["output", "input"]).assign(
            source=source, value_mm=3 * rng.normal(size=len(names))
        )
        for source in ("exact", "measured")
    ]
    return pd.concat(parts)


def test_errors_with_bands_and_two_maps_of_one_colour_scale():
    figure = map_errors_figure(errors(), entries())
    first, second, third = figure.axes[:3]
    assert len(first.lines) == len(first.collections) == 4
    assert second.images[0].get_clim() == third.images[0].get_clim()
    assert second.images[0].get_array().shape == (11, 8)
    assert text_faults(figure) == []


def test_what_is_drawn_is_the_table():
    table = entries()
    figure = map_errors_figure(errors(("pooled",)), table)
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), 0.13 + 3 / SIZES)
    for axes, source in zip(figure.axes[1:3], ("exact", "measured"), strict=True):
        drawn = axes.images[0].get_array()
        np.testing.assert_array_equal(drawn.ravel(), table[table["source"] == source]["value_mm"])
    large = (table["value_mm"].abs() >= 0.05 * table["value_mm"].abs().max()).sum()
    assert sum(len(axes.texts) for axes in figure.axes[1:3]) == large + 2, "and two letters"
