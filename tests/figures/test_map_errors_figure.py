import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.map_errors import MODELS, SOURCES, map_errors_figure

SIZES = np.array([30, 120, 480, 2800])


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


def test_errors_with_bands():
    figure = map_errors_figure(errors())
    axes = figure.axes[0]
    assert len(axes.lines) == len(axes.collections) == 4
    assert text_faults(figure) == []


def test_what_is_drawn_is_the_table():
    figure = map_errors_figure(errors(("pooled",)))
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), 0.13 + 3 / SIZES)
