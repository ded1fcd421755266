import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.quality import (
    SIGNS,
    recording_gaps_figure,
    stability_figure,
)

MARKERS = ("hip1", "hip2", "toe1", "toe2", "toe3")
GAPS = pd.DataFrame(
    [("", "hip1", 1.0, 2.0), ("", "toe1", 5.0, 5.0001)],
    columns=["recording", "marker", "start_s", "stop_s"],
)
FAULTS = pd.DataFrame(
    [
        ("", name, kind, 3.0 + i)
        for i, (name, kind) in enumerate(zip(MARKERS, SIGNS, strict=True))
    ]
    + [("", "", "dropped", 8.0)],
    columns=["recording", "marker", "kind", "start_s"],
)


def bars(duration_s):
    return pd.DataFrame({"recording": "", "marker": MARKERS, "duration_s": duration_s})


def test_one_bar_a_marker_and_a_white_stretch_for_each_gap():
    figure = recording_gaps_figure(bars(10.0), GAPS, FAULTS)
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == list(MARKERS)
    assert len(axes.patches) == len(MARKERS)
    stretches = [
        path.get_extents().bounds[:1] + path.get_extents().bounds[2:3]
        for collection in axes.collections
        for path in collection.get_paths()
    ]
    assert stretches[0] == (1.0, 1.0)
    start, length = stretches[1]
    assert start == 5.0
    assert length > 0.01  # wide enough to be seen
    assert text_faults(figure) == []


def test_every_kind_of_fault_stands_in_its_row_and_in_the_legend():
    figure = recording_gaps_figure(bars(10.0), GAPS, FAULTS)
    (axes,) = figure.axes
    rows = {line.get_label(): list(line.get_ydata()) for line in axes.lines}
    for row, (_, meaning) in enumerate(SIGNS.values()):
        assert rows[meaning] == [row]
    assert "frames dropped" in rows
    (legend,) = figure.legends
    assert len(legend.get_texts()) == len(SIGNS) + 2


def test_nothing_to_show_is_said():
    figure = recording_gaps_figure(bars(10.0)[:0], GAPS[:0], FAULTS[:0])
    assert "No marker" in figure.texts[0].get_text()


def test_a_whole_recording_without_faults():
    figure = recording_gaps_figure(bars(0.5), GAPS[:0], FAULTS[:0])
    assert len(figure.axes[0].lines) == 0
    assert text_faults(figure) == []


# Figures of the quality of a study: they show what is in the tables, legibly.


def stability(recordings=2, missing=False):
    variants = [
        "all data",
        *(f"bandwidth × {f}" for f in (0.35, 0.5, 0.71, 1.41, 2, 2.83)),
    ]
    variants += ["first half", "second half", *(f"trial{k}" for k in range(recordings))]
    n = np.arange(len(variants))
    pre = 0.5 + 0.001 * np.sin(n)
    pre[0] = 0.5
    if missing:
        pre[-1] = np.nan
    return pd.DataFrame(
        {"variant": variants, "pre_height_m": pre, "post_height_m": 0.3}
    )


def drift(parts=2, name="trial{}"):
    quantities = ["time between the sections", "height of the feet at the post section"]
    rows = [
        (q, name.format(k), 0.1 * k - 0.1, 0.02, 0.1)
        for q in quantities
        for k in range(parts)
    ]
    return pd.DataFrame(rows, columns=["quantity", "part", "deviation", "se", "spread"])


@pytest.mark.parametrize("recordings", [1, 2, 6, 12])
def test_sections_and_drift_are_drawn(recordings):
    figure = stability_figure(stability(recordings), drift(recordings))
    left, right = figure.axes
    pre, post = left.get_lines()[:2]
    assert np.allclose(pre.get_xdata(), np.sin(np.arange(1, len(pre.get_xdata()) + 1)))
    assert np.allclose(post.get_xdata(), 0.0)
    assert left.get_xlabel() == "change of the section (mm)"
    assert len(right.containers) == recordings
    assert text_faults(figure) == []


@pytest.mark.parametrize("name", ["part {} of 4", "a long name of trial {}"])
def test_names_of_parts_stand_beside_the_letter(name):
    assert text_faults(stability_figure(stability(4), drift(4, name))) == []


def test_a_variant_without_sections_says_none():
    left = stability_figure(stability(missing=True), drift()).axes[0]
    assert "none" in [text.get_text() for text in left.texts]


def test_no_drift_to_show_is_no_error():
    figure = stability_figure(stability(), drift(0))
    assert text_faults(figure) == []


@pytest.mark.parametrize("recordings", [1, 4])
def test_gaps_and_faults_stand_in_their_recording(recordings):
    names = [f"trial{k}" for k in range(recordings)]
    markers = pd.DataFrame(
        [(name, m, 60.0) for name in names for m in ("b1", "b2", "f1")],
        columns=["recording", "marker", "duration_s"],
    )
    gaps = pd.DataFrame(
        {"recording": [names[0]], "marker": ["b2"], "start_s": [10.0], "stop_s": [12.0]}
    )
    faults = pd.DataFrame(
        {
            "recording": [names[-1]],
            "kind": ["spike"],
            "marker": ["f1"],
            "start_s": [30.0],
        }
    )
    figure = recording_gaps_figure(markers, gaps, faults)
    assert [axes.get_title(loc="left") for axes in figure.axes] == names
    (spike,) = figure.axes[-1].get_lines()
    assert (spike.get_xdata()[0], spike.get_ydata()[0]) == (30.0, 2)
    assert text_faults(figure) == []
