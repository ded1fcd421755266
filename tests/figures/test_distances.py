import numpy as np
import pandas as pd
from overlaps import text_faults

from hopdata.figures.distances import (
    KINDS,
    QUANTILES,
    both_sides_figure,
)

DIFFERENT = {
    "conclusion": "different",
    "effect": {"estimate": 0.347, "low": 0.3, "high": 0.39, "upper_bound": 0.38},
}
SAME = {
    "conclusion": "no difference",
    "effect": {"estimate": 0.01, "low": 0.0, "high": 0.14, "upper_bound": 0.126},
}
NONE = {"conclusion": "cannot tell", "effect": None}


def tables(shift):
    rng = np.random.default_rng(3)
    samples = {
        kind: shift + rng.normal(2 + k / 4, 0.1, 300) for k, kind in enumerate(KINDS)
    }
    distances = pd.concat(
        [
            pd.DataFrame({"kind": kind, "distance_rad": values})
            for kind, values in samples.items()
        ]
    )
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    rows = [(kind, *np.quantile(values, shares)) for kind, values in samples.items()]
    return distances, pd.DataFrame(rows, columns=["kind", *QUANTILES])


def test_each_study_stands_under_its_verdict():
    figure = both_sides_figure(
        *tables(0),
        SAME,
        *tables(0.1),
        DIFFERENT,
        names=("C1 hopper", "control, not C1"),
    )
    titles = [axes.get_title(loc="left") for axes in figure.axes[:2]]
    assert "No difference above 13\u00a0%" in titles[0]
    assert "Different maps: by 35\u00a0%" in titles[1]
    assert text_faults(figure) == []


def test_a_study_without_an_answer():
    figure = both_sides_figure(*tables(0), NONE, names=["one"])
    assert "Cannot tell" in figure.axes[0].get_title(loc="left")
