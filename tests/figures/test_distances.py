import numpy as np
import pandas as pd
import pytest
from fake_tables import distance_summary, distances
from overlaps import text_faults

from hopdata.figures.distances import (
    KINDS,
    QUANTILES,
    SERIES,
    both_sides_figure,
    sensitivity_figure,
)

DIFFERENT = {
    "conclusion": "different",
    "effect": {"estimate": 0.347, "upper_bound": 0.38},
}
SAME = {
    "conclusion": "no difference",
    "effect": {"estimate": 0.01, "upper_bound": 0.126},
}
NONE = {"conclusion": "cannot tell", "effect": None}


def tables(shift):
    rng = np.random.default_rng(3)
    samples = {kind: shift + rng.normal(2 + k / 4, 0.1, 300) for k, kind in enumerate(KINDS)}
    distances = pd.concat(
        [pd.DataFrame({"kind": kind, "distance_rad": values}) for kind, values in samples.items()]
    )
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    rows = [(kind, *np.quantile(values, shares)) for kind, values in samples.items()]
    return distances, pd.DataFrame(rows, columns=["kind", *QUANTILES])


def test_each_study_stands_under_its_verdict():
    figure = both_sides_figure(
        *tables(0), SAME, *tables(0.1), DIFFERENT, names=("C1 hopper", "control, not C1")
    )
    titles = [axes.get_title(loc="left") for axes in figure.axes[:2]]
    assert "no difference above 0.13" in titles[0]
    assert "different by 0.35" in titles[1]
    assert text_faults(figure) == []


def test_a_study_without_an_answer():
    figure = both_sides_figure(*tables(0), NONE, names=["one"])
    assert "cannot tell" in figure.axes[0].get_title(loc="left")


SENSITIVITY_FIGURE_QUANTILES = ["q05", "q25", "median", "q75", "q95"]


def sensitivity():
    noise = np.geomspace(1e-3, 1, 12)
    parts = [
        pd.DataFrame(
            {
                "distance": name,
                "noise_sd": noise,
                "mean": 3 * noise / (noise + 0.1),
                "doubling": 9.0,
            }
        )
        for name in SERIES
    ]
    return pd.concat(parts, ignore_index=True)


def readings():
    rows = [
        ("noised_identity", ratio, signal, noised, sd, sd == 0.1 and noised == 2, *_levels(20 * sd))
        for ratio, signal, sd in (
            ("amplitude", "entry", 0.1), ("amplitude", "matrix", 0.017),
            ("power", "entry", 0.316), ("power", "matrix", 0.054),
        )
        for noised in (2, 1)
    ]  # fmt: skip
    rows.append(("random", "", "", np.nan, np.nan, False, *_levels(3.76)))
    names = ["kind", "ratio", "signal", "noised", "noise_sd", "printed"]
    return pd.DataFrame(rows, columns=[*names, *SENSITIVITY_FIGURE_QUANTILES])


def _levels(middle):
    return middle * np.array([0.9, 0.95, 1.0, 1.05, 1.1])


def test_lines_boxes_and_the_printed_reading():
    figure = sensitivity_figure(sensitivity(), readings(), distance_summary(distances()))
    left, right, lower = figure.axes
    assert len(left.lines) == len(right.lines) == len(SERIES) + 1
    labels = [label.get_text() for label in lower.get_yticklabels()]
    assert len(labels) == len(lower.patches) == 11
    assert labels[-3:] == ["in-class", "cross-class", "random"]
    bold = [label for label in lower.get_yticklabels() if label.get_fontweight() == "bold"]
    assert [label.get_text() for label in bold] == ["1/10 of an entry, both noised"]
    assert text_faults(figure) == []


def test_boxes_are_the_quantiles_given():
    table = readings()
    lower = sensitivity_figure(sensitivity(), table, distance_summary(distances())).axes[2]
    vertices = lower.patches[-1].get_path().vertices[:, 0]
    row = table.iloc[-1]
    assert (vertices.min(), vertices.max()) == pytest.approx((row["q25"], row["q75"]))


def test_a_study_without_classes_and_one_without_anything():
    figure = sensitivity_figure(sensitivity(), readings(), distance_summary(distances(("random",))))
    assert len(figure.axes[2].patches) == 9
    empty = sensitivity_figure(sensitivity()[:0], readings(), distance_summary(distances()))
    assert "not studied" in empty.texts[0].get_text()
