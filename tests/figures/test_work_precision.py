import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.work_precision import SCENE_NAMES, WAYS, work_precision_figure


def results(scenes=tuple(SCENE_NAMES), ways=tuple(WAYS), methods=("first", "second")):
    rows = [
        {
            "scene": scene, "way": way, "method": method, "setting": setting,
            "error_max": setting * 10.0**number, "time_median_us": 3.0**number / setting**0.1,
            "time_q25_us": 2.9**number / setting**0.1, "time_q75_us": 3.2**number / setting**0.1,
        }
        for scene in scenes
        for number, way in enumerate(ways)
        for method in methods
        for setting in (1e-4, 1e-8, 1e-12)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def chosen(table, best="first"):
    solvers = table[["scene", "way", "method"]].drop_duplicates()
    return solvers.assign(error=1e-9, best_of_way=solvers["method"] == best)


def drawn_strongly(axes):
    return {container.get_label() for container in axes.containers}


def test_a_panel_a_scene_with_one_line_a_solver():
    table = results()
    figure = work_precision_figure(table, chosen(table))
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(SCENE_NAMES.values())
    for axes in figure.axes:
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert "error" in axes.get_xlabel()
        assert drawn_strongly(axes) == {f"{way}: first" for way in WAYS}
        assert len(axes.lines) == 2 * len(WAYS) + 1  # and the line at the error compared at
    assert "µs" in figure.axes[0].get_ylabel()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(WAYS)
    assert text_faults(figure) == []


def test_lines_are_the_medians_over_the_errors_with_their_quartiles():
    table = results(ways=("heyoka",), methods=("first",))
    container = work_precision_figure(table, chosen(table)).axes[0].containers[0]
    rows = table[table["scene"] == "octant"]
    line, _, (bars,) = container
    assert np.array_equal(line.get_xdata(), rows["error_max"])
    assert np.array_equal(line.get_ydata(), rows["time_median_us"])
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    assert ends == pytest.approx(rows[["time_q25_us", "time_q75_us"]].to_numpy())


def test_the_best_method_may_differ_between_scenes():
    table = results(scenes=("octant", "plate"), ways=("diffrax",))
    marks = chosen(table)
    marks["best_of_way"] = [True, False, False, True]
    left, right = work_precision_figure(table, marks).axes
    assert drawn_strongly(left) == {"diffrax: first"}
    assert drawn_strongly(right) == {"diffrax: second"}


def test_failures_and_absent_peers_are_left_out():
    table = results(scenes=("octant",), ways=("heyoka", "diffrax"), methods=("first",))
    table.loc[table["way"] == "diffrax", "time_median_us"] = np.nan
    figure = work_precision_figure(table, chosen(table))
    assert drawn_strongly(figure.axes[0]) == {"heyoka: first"}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["heyoka"]


def test_an_unknown_way_is_drawn_and_named_too():
    table = results(scenes=("octant",), ways=("heyoka", "another"), methods=("first",))
    figure = work_precision_figure(table, chosen(table))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["heyoka", "another"]
    assert text_faults(figure) == []


def test_without_results_the_figure_says_so():
    table = results().assign(time_median_us=np.nan)
    assert (
        "No work-precision results"
        in work_precision_figure(table, chosen(table)).texts[0].get_text()
    )
