import numpy as np
import pytest
from fake_tables import KINDS, distance_summary, distances
from overlaps import text_faults

from hopdata.figures.distances import MOST_STEPS, distances_figure


def draw(table):
    return distances_figure(table, distance_summary(table))


def test_four_kinds_above_and_below():
    figure = draw(distances())
    upper, lower = figure.axes
    assert upper.get_ylabel() == "cumulative share"
    assert lower.get_xlabel() == "arc-length distance (rad)"
    assert [label.get_text() for label in lower.get_yticklabels()] == [
        "in-class",
        "cross-class",
        "identities with noise",
        "random",
    ]
    assert len(upper.lines) == len(lower.patches) == 4
    assert upper.get_xlim() == lower.get_xlim()
    assert text_faults(figure) == []


def test_the_curve_is_the_empirical_distribution():
    table = distances(n=200)
    line = draw(table).axes[0].lines[0]
    sample = np.sort(table.loc[table["kind"] == "in_class", "distance_rad"])
    for at in (sample[0] - 1e-9, sample[10], sample[150] + 1e-9, sample[-1]):
        step = np.searchsorted(line.get_xdata(), at, side="right") - 1
        shown = line.get_ydata()[step] if step >= 0 else 0.0
        assert shown == pytest.approx(np.mean(sample <= at))


def test_boxes_are_the_quantiles_given():
    table = distances()
    summary = distance_summary(table)
    lower = distances_figure(table, summary).axes[1]
    for patch, row in zip(lower.patches, summary.to_dict("records"), strict=True):
        vertices = patch.get_path().vertices[:, 0]
        assert (vertices.min(), vertices.max()) == pytest.approx(
            (row["q25"], row["q75"])
        )


def test_many_pairs_are_thinned_and_keep_their_ends():
    table = distances(n=20000)
    line = draw(table).axes[0].lines[3]
    sample = table.loc[table["kind"] == "random", "distance_rad"]
    assert len(line.get_xdata()) <= MOST_STEPS + 1
    assert (line.get_xdata()[0], line.get_xdata()[-1]) == (sample.min(), sample.max())
    assert line.get_ydata()[-1] == 1


@pytest.mark.parametrize(
    "kinds", [("noised_identity", "random"), ("random",), KINDS[:1]]
)
def test_an_empty_kind_is_named(kinds):
    figure = draw(distances(kinds, n=20))
    lower = figure.axes[1]
    empty = 4 - len(kinds)
    assert [text.get_text() for text in lower.texts].count("none") == empty
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sum(label.endswith("(none)") for label in labels) == empty
    assert len(lower.patches) == len(kinds)
    assert text_faults(figure) == []


def test_one_pair_is_enough_and_none_is_said():
    assert text_faults(draw(distances(("random",), n=1))) == []
    assert "No distances" in draw(distances(())).texts[0].get_text()
