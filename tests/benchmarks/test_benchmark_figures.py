"""Figures that only benchmarks draw: their content, and that no texts overlap."""

import numpy as np
import pandas as pd
import pytest
from benchmark_figures import (
    CONTROLS,
    ESTIMATORS,
    LINES,
    SCENE_NAMES,
    SERIES,
    WAYS,
    calibration_figure,
    map_error_figure,
    scaling_figure,
    verdict_power_figure,
    work_precision_figure,
)
from overlaps import text_faults


def trajectories(solvers=tuple(LINES)):
    time = np.linspace(0, 2, 101)
    parts = [
        pd.DataFrame(
            {
                "solver": solver,
                "time_s": time,
                "height_m": 1 + np.abs(np.cos(3 * time)) + size * time,
                "velocity_m_s": np.sin(3 * time) + size,
                "height_residual_m": -size * time,
                "velocity_residual_m_s": size * time,
            }
        )
        for solver, size in zip(LINES, (0.0, 3e-2, 2e-4, 1e-10), strict=True)
        if solver in solvers
    ]
    empty = pd.DataFrame(
        {"solver": pd.Series(dtype=str), "time_s": pd.Series(dtype=float)}
    )
    return pd.concat(parts, ignore_index=True) if parts else empty


def test_trajectories_above_and_sizes_of_residuals_below():
    figure = calibration_figure(trajectories())
    height, velocity, below, velocity_below = figure.axes
    assert [len(axes.lines) for axes in figure.axes] == [4, 4, 3, 3]
    assert height.get_ylabel() == "height (m)"
    assert velocity.get_ylabel() == "velocity (m/s)"
    assert below.get_yscale() == velocity_below.get_yscale() == "log"
    assert text_faults(figure) == []


def test_lines_are_the_table():
    figure = calibration_figure(trajectories())
    shown = figure.axes[2].lines[0]
    assert np.isnan(shown.get_ydata()[0])
    assert shown.get_ydata()[1:] == pytest.approx(3e-2 * shown.get_xdata()[1:])
    assert figure.axes[0].lines[1].get_ydata()[-1] == pytest.approx(
        1 + abs(np.cos(6)) + 0.06
    )


def test_a_solver_may_be_missing():
    figure = calibration_figure(trajectories(("exact", "hopdata")))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "exact",
        "hopdata",
    ]
    assert text_faults(figure) == []


COUNTS = np.arange(2, 36)


def times(solvers=tuple(SERIES)):
    parts = []
    for solver, start, slope, error in zip(
        SERIES,
        (1400.0, 700.0, 40.0, 45.0),
        (40.0, 1.0, 3.0, 2.0),
        (5e-2, 5e-3, 3e-8, 3e-8),
        strict=True,
    ):
        middle = start + slope * COUNTS
        columns = {
            "solver": solver,
            "n_contacts": COUNTS,
            "time_median_us_per_s": middle,
            "time_q25_us_per_s": 0.9 * middle,
            "time_q75_us_per_s": 1.2 * middle,
            "error_median": error,
            "error_max": 5 * error,
        }
        parts += [pd.DataFrame(columns)] if solver in solvers else []
    return pd.concat(parts) if parts else pd.DataFrame({"solver": pd.Series(dtype=str)})


def marginal():
    rows = [
        {
            "solver": solver,
            "window": window,
            "n_contacts": n,
            "marginal_us_per_contact_s": slope,
            "low95_us_per_contact_s": slope - 1,
            "high95_us_per_contact_s": slope + 2,
        }
        for solver, slope in zip(SERIES, (40.0, 1.0, 3.0, 2.0), strict=True)
        for window, n in (("all", 18), ("local", 8), ("local", 9), ("local", 10))
    ]
    return pd.DataFrame(rows)


def test_three_panels_with_bands():
    figure = scaling_figure(times(), marginal())
    left, middle, right = figure.axes
    assert [len(axes.collections) for axes in figure.axes] == [4, 4, 4]
    assert left.get_yscale() == right.get_yscale() == "log"
    assert {axes.get_xlabel() for axes in figure.axes} == {"number of contacts"}
    assert "further contact" in middle.get_ylabel()
    assert text_faults(figure) == []


def test_lines_and_bands_are_the_table():
    left, middle, _ = scaling_figure(times(), marginal()).axes
    assert left.lines[0].get_ydata()[0] == pytest.approx(1480.0)
    band = left.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((0.9 * 1480, 1.2 * 2800))
    assert middle.lines[2].get_xdata().tolist() == [8, 9, 10]


def test_other_solvers_are_left_out_and_missing_ones_are_no_fault():
    table = times((next(iter(SERIES)),))
    other = table.assign(solver="something else")
    figure = scaling_figure(pd.concat([table, other]), marginal())
    assert len(figure.axes[0].lines) == 1
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
    "No trajectories": (calibration_figure, trajectories(())),
    "No run times": (scaling_figure, times(()), marginal()),
    "No work-precision results": (work_precision_figure, NONE, chosen(NONE)),
    "No errors of maps": (map_error_figure, map_errors().iloc[:0]),
    "No simulated studies": (verdict_power_figure, table().iloc[:0]),
}


@pytest.mark.parametrize("said", NOTHING)
def test_nothing_to_show_is_said(said):
    draw, *tables = NOTHING[said]
    (text,) = draw(*tables).texts
    assert said in text.get_text()
