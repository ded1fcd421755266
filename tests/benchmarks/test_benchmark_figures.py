"""Figures that only benchmarks draw: their content, and that no texts overlap."""

import numpy as np
import pandas as pd
import pytest
from benchmark_figures import (
    CONTROLS,
    ESTIMATORS,
    SCENE_NAMES,
    WAYS,
    map_error_figure,
    order_figure,
    verdict_power_figure,
    work_precision_figure,
)
from overlaps import text_faults

METHODS = {
    "printed, DOPRI5, Illinois": 4.0,
    "hopdata, dopri5": 5.0,
    "hopdata, dop853": 8.0,
}


def errors(methods=METHODS):
    """Return straight lines between a plateau and rounding."""
    step, tables = np.geomspace(0.5, 5e-4, 31), []
    for name, order in methods.items():
        line = step**order
        error = np.clip(line, 3e-15, 1e-2)
        used = (error > 1e-12) & (error < 1e-3)
        columns = {"method": name, "max_step": step, "error_rms": error, "in_fit": used}
        fitted = {"fitted_order": order + 0.7, "fitted_error": line}
        limit = {"limit_order": order, "limit_order_se": 0.12}
        tables.append(pd.DataFrame({**columns, **fitted, **limit}))
    return pd.concat(tables)


def lines(figure, kind):
    return [line for line in figure.axes[0].lines if line.get_label() == f"_{kind}"]


def curves(figure):
    return [
        line for line in figure.axes[0].lines if not line.get_label().startswith("_")
    ]


def test_a_curve_a_line_and_an_interval_each():
    table = errors()
    figure = order_figure(table.sample(frac=1, random_state=2))
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert (
        len(curves(figure))
        == len(lines(figure, "fit"))
        == len(lines(figure, "interval"))
        == 3
    )
    assert text_faults(figure) == []


def test_what_is_drawn_is_what_the_table_says():
    table = errors({"only": 4.0})
    figure = order_figure(table)
    table = table.sort_values("max_step")
    (curve,), (fit,), (interval,) = (
        curves(figure),
        lines(figure, "fit"),
        lines(figure, "interval"),
    )
    assert curve.get_xdata() == pytest.approx(1 / table["max_step"])
    assert curve.get_ydata() == pytest.approx(table["error_rms"])
    assert fit.get_ydata() == pytest.approx(table["fitted_error"])
    used = table[table["in_fit"]]
    assert interval.get_xdata() == pytest.approx(1 / used["max_step"])
    low, high = figure.axes[0].get_ylim()
    assert low < table["error_rms"].min() < table["error_rms"].max() < high


def test_the_orders_are_named():
    """The order is the limit; the slope of a line over a few steps is another number."""
    table = errors()
    steps = table.groupby("method")["in_fit"].sum()
    labels = [curve.get_label() for curve in curves(order_figure(table))]
    assert labels == [
        f"{name}\norder {order:.2f} ± 0.12\nslope {order + 0.7:.2f} over {steps[name]} steps"
        for name, order in METHODS.items()
    ]
    without = order_figure(table.assign(limit_order=np.nan, limit_order_se=np.nan))
    assert [curve.get_label().count("order") for curve in curves(without)] == [0, 0, 0]
    assert [curve.get_label().count("slope") for curve in curves(without)] == [1, 1, 1]


def test_methods_can_be_told_apart():
    many = {f"method {k}": 4.0 for k in range(7)}
    figure = order_figure(errors(many))
    looks = {(curve.get_color(), curve.get_marker()) for curve in curves(figure)}
    assert len(looks) == 7
    assert len({marker for _, marker in looks}) == 7
    assert text_faults(figure) == []


def test_a_method_without_a_straight_part_is_said():
    table = errors({"scattered": 4.0}).assign(
        in_fit=False, fitted_order=np.nan, fitted_error=np.nan, limit_order=np.nan
    )
    figure = order_figure(table)
    assert curves(figure)[0].get_label() == "scattered\nno straight part"
    assert not lines(figure, "fit")
    assert not lines(figure, "interval")


def test_errors_of_zero_do_not_break_the_axis():
    table = errors()
    table.loc[table["max_step"] < 1e-3, "error_rms"] = 0.0
    figure = order_figure(table)
    assert figure.axes[0].get_ylim()[0] > 0
    assert text_faults(figure) == []


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
    "No errors: no method": (order_figure, errors().iloc[:0]),
    "No work-precision results": (work_precision_figure, NONE, chosen(NONE)),
    "No errors of maps": (map_error_figure, map_errors().iloc[:0]),
    "No simulated studies": (verdict_power_figure, table().iloc[:0]),
}


@pytest.mark.parametrize("said", NOTHING)
def test_nothing_to_show_is_said(said):
    draw, *tables = NOTHING[said]
    (text,) = draw(*tables).texts
    assert said in text.get_text()
