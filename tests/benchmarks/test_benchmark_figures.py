"""Figures that only benchmarks draw: their content, and that no texts overlap."""

import numpy as np
import pandas as pd
import pytest
from benchmark_figures import (
    CONTROLS,
    ESTIMATORS,
    RIVALS,
    SCENE_NAMES,
    WAYS,
    map_error_figure,
    side_by_side_figure,
    side_by_side_panels_figure,
    verdict_power_figure,
    work_precision_figure,
)
from overlaps import text_faults


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
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(
        SCENE_NAMES.values()
    )
    for axes in figure.axes:
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert drawn_strongly(axes) == {f"{way}: first" for way in WAYS}
        assert (
            len(axes.lines) == 2 * len(WAYS) + 1
        )  # and the line at the error of comparison
    assert all(
        "error" in axes.get_xlabel() for axes in figure.axes[-3:]
    )  # the lowest panels
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
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "heyoka",
        "another",
    ]
    assert text_faults(figure) == []


def ratios_of(scenes=tuple(SCENE_NAMES), ways=tuple(WAYS)):
    rows = [
        {
            "scene": scene, "way": way, "method": method, "error": 1e-6,
            "time_us": 20.0 * ratio, "ratio": ratio, "best_of_way": method == "first",
        }
        for k, scene in enumerate(scenes)
        for number, way in enumerate(ways)
        for method in ("first", "second")
        for ratio in [2.0**number + k if method == "first" else 1e6]
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_a_row_a_system_with_one_mark_a_package():
    given = ratios_of()
    figure = side_by_side_figure(given)
    (axes,) = figure.axes
    assert axes.get_xscale() == "log"
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == list(SCENE_NAMES.values())
    marks = {
        line.get_label(): line for line in axes.lines if line.get_marker() != "None"
    }
    assert len(marks) == len(RIVALS)
    first = given[given["best_of_way"]]
    rows = first[first["way"] == "heyoka"]
    assert list(marks["heyoka"].get_xdata()) == list(rows["ratio"])
    heights = list(marks["heyoka"].get_ydata())
    assert heights == sorted(heights, reverse=True)  # the first system is uppermost
    assert "10⁻⁶" in axes.get_xlabel()
    assert "20 µs" in [text.get_text() for text in axes.texts]
    assert text_faults(figure) == []


def test_a_package_that_does_not_reach_the_error_has_no_mark():
    given = ratios_of(scenes=("octant",), ways=("hopdata, call", "heyoka", "diffrax"))
    given.loc[given["way"] == "diffrax", "ratio"] = np.nan
    (axes,) = side_by_side_figure(given).axes
    drawn = {line.get_label(): len(line.get_xdata()) for line in axes.lines}
    assert drawn["heyoka"] == 1
    assert drawn["diffrax"] == 0


def test_panels_side_by_side_have_the_fastest_methods_only():
    table = results(ways=("heyoka", "SciPy, Numba", "SciPy, Python"))
    figure = side_by_side_panels_figure(table, chosen(table))
    for axes in figure.axes:
        assert drawn_strongly(axes) == {"heyoka: first", "SciPy, Numba: first"}
        assert len(axes.lines) == 3  # and the line at the error of comparison


# Errors of the landing map.

SIZES = (60, 120, 250, 500, 1000, 2784)


def map_errors(ways=("split_fit", "savitzky_golay"), noises=(0.0, 0.3, 0.6, 1.2)):
    rows = [
        (way, noise, estimator, size, middle, 0.8 * middle, 1.3 * middle)
        for way in ways
        for noise in noises
        for k, estimator in enumerate(("ols", *ESTIMATORS))
        for size in SIZES
        for middle in [(0.02 + 0.1 * noise + 1 / (k + 3)) / np.sqrt(size)]
    ]  # fmt: skip
    columns = ["states", "noise_mm", "estimator", "landings", "median", "q05", "q95"]
    return pd.DataFrame(rows, columns=columns)


def test_a_panel_for_each_noise_and_way():
    figure = map_error_figure(map_errors())
    assert len(figure.axes) == 8
    assert [axes.get_title(loc="left") for axes in figure.axes[:4]] == [
        "no noise", "0.3 mm", "0.6 mm", "1.2 mm",
    ]  # fmt: skip
    assert {len(axes.lines) for axes in figure.axes} == {len(ESTIMATORS)}
    assert text_faults(figure) == []


def test_lines_of_errors_are_the_table():
    table = map_errors(ways=("split_fit",), noises=(0.6,))
    (axes,) = map_error_figure(table).axes
    for line, name in zip(axes.lines, ESTIMATORS, strict=True):
        rows = table[table["estimator"] == name]
        np.testing.assert_array_equal(line.get_xdata(), rows["landings"])
        np.testing.assert_array_equal(line.get_ydata(), rows["median"])
    assert axes.get_xscale() == axes.get_yscale() == "log"


# Size and power of the verdict.

COLUMNS = (
    *("condition", "asked", "true_effect", "found_share", "found_low", "found_high"),
    *("effect_mean", "effect_sd"),
)


def table(kinds=tuple(CONTROLS)):
    rows = [
        (name, 2100, 0.0, 0.05, 0.03, 0.09, 0.03, 0.04)
        for name in ("C1", "C1 softer legs", "C1 stiffer legs", "C1 half the noise")
    ]
    rows += [
        (
            f"{kind} {size}",
            2100,
            size,
            min(1.0, 4 * size),
            max(0.0, 4 * size - 0.1),
            1.0,
            0.9 * size,
            0.05,
        )
        for kind in kinds
        for size in (0.05, 0.1, 0.25)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def test_false_alarms_power_and_sizes_stand_side_by_side():
    figure = verdict_power_figure(table())
    left, middle, _ = figure.axes
    assert [label.get_text() for label in left.get_yticklabels()] == [
        *("hopper", "softer legs", "stiffer legs", "half the noise")
    ]
    assert len(middle.containers) == len(CONTROLS)
    assert text_faults(figure) == []


@pytest.mark.parametrize("kinds", [(), ("kappa",)])
def test_kinds_that_were_not_simulated_are_left_out(kinds):
    figure = verdict_power_figure(table(kinds))
    assert len(figure.axes[1].containers) == len(kinds)
    assert text_faults(figure) == []


NONE = results().assign(time_median_us=np.nan)
NOTHING = {
    "No work-precision results": (work_precision_figure, NONE, chosen(NONE)),
    "No errors of maps": (map_error_figure, map_errors().iloc[:0]),
    "No simulated studies": (verdict_power_figure, table().iloc[:0]),
}


@pytest.mark.parametrize("said", NOTHING)
def test_nothing_to_show_is_said(said):
    draw, *tables = NOTHING[said]
    (text,) = draw(*tables).texts
    assert said in text.get_text()
