"""Figures of the quality of a study: what is in the tables is on the paper, and legible."""

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.recording_gaps import recording_gaps_figure
from hopdata.figures.stability import stability_figure
from hopdata.figures.worst_landings import worst_landings_figure


def stability(recordings=2, missing=False):
    variants = ["all data", *(f"bandwidth × {f}" for f in (0.35, 0.5, 0.71, 1.41, 2, 2.83))]
    variants += ["first half", "second half", *(f"trial{k}" for k in range(recordings))]
    n = np.arange(len(variants))
    pre = 0.5 + 0.001 * np.sin(n)
    pre[0] = 0.5
    if missing:
        pre[-1] = np.nan
    return pd.DataFrame({"variant": variants, "pre_height_m": pre, "post_height_m": 0.3})


def drift(parts=2, name="trial{}"):
    quantities = ["time between the sections", "height of the feet at the post section"]
    rows = [(q, name.format(k), 0.1 * k - 0.1, 0.02, 0.1) for q in quantities for k in range(parts)]
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


def landings(n, feet=("left", "right")):
    rows, samples = [], []
    for k in range(n):
        row = {"landing": k + 1, "why": "excluded (8 times): foot 1 not down by the post section"}
        row |= {"recording": "hopper", "index": 37 * k, "t_pre_s": 1.0, "t_post_s": 1.1}
        row |= {f"contact_{foot}_s": 1.05 + 0.01 * i for i, foot in enumerate(feet)}
        rows.append(row)
        times = np.arange(-6, 17) * 0.01
        for foot in feet:
            height = np.maximum(0.1 - 2 * (times + 0.01), 0.0)
            samples.append(
                pd.DataFrame({"landing": k + 1, "foot": foot, "time_s": times, "height_m": height})
            )
    return pd.DataFrame(rows), pd.concat(samples)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12])
def test_a_panel_for_each_landing(n):
    figure = worst_landings_figure(*landings(n))
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == n
    assert "descent 0" in shown[0].get_title(loc="left")
    labelled = [axes for axes in shown if axes.get_xlabel()]
    assert len(labelled) == min(n, 3)
    assert text_faults(figure) == []


def test_a_landing_without_end_or_contact_is_drawn():
    table, samples = landings(1)
    table.loc[0, ["t_post_s", "contact_left_s"]] = np.nan
    assert text_faults(worst_landings_figure(table, samples)) == []


def test_no_landing_is_said_in_words():
    table, samples = landings(1)
    figure = worst_landings_figure(table.head(0), samples.head(0))
    assert figure.texts[0].get_text() == "No landing to show."


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
        {"recording": [names[-1]], "kind": ["spike"], "marker": ["f1"], "start_s": [30.0]}
    )
    figure = recording_gaps_figure(markers, gaps, faults)
    assert [axes.get_title(loc="left") for axes in figure.axes] == names
    (spike,) = figure.axes[-1].get_lines()
    assert (spike.get_xdata()[0], spike.get_ydata()[0]) == (30.0, 2)
    assert text_faults(figure) == []


def test_nothing_missing_is_said_in_words():
    markers = pd.DataFrame({"recording": ["a"], "marker": ["b1"], "duration_s": [1.0]})
    gaps = pd.DataFrame(columns=["recording", "marker", "start_s", "stop_s"])
    faults = pd.DataFrame(columns=["recording", "kind", "marker", "start_s"])
    figure = recording_gaps_figure(markers, gaps, faults)
    assert "every frame" in figure.texts[0].get_text()
