"""Figures of the models of frame changes: they draw the table, and nothing overlaps."""

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.steering.figures.models import (
    COLUMNS,
    COMPONENTS,
    DATA,
    FLOOR,
    LINES,
    PANELS,
    READINGS,
    SMOOTHNESSES,
    frame_change_figure,
    kernel_smoothness_figure,
    learning_curve_figure,
    printed_and_own_figure,
)


def maps():
    angle, swing = np.meshgrid(
        np.linspace(-2 * np.pi, 4 * np.pi, 37), np.linspace(-1.2, 1.2, 9)
    )
    table = pd.DataFrame({"boom_angle_rad": angle.ravel(), "swing_rad": swing.ravel()})
    for k, name in enumerate(COMPONENTS):
        table[name] = 40 * np.cos(table["boom_angle_rad"] + k) + 10 * table["swing_rad"]
        table[f"{name}_sd"] = 1 + table["swing_rad"] ** 2
    return table.sample(frac=1, random_state=1)


def hops():
    return maps().iloc[:30].drop(columns=[f"{name}_sd" for name in COMPONENTS])


def test_six_maps_with_bars_and_hops():
    figure = frame_change_figure(maps(), hops())
    assert len(figure.axes) == 12
    assert text_faults(figure) == []
    panel = figure.axes[0]
    image = panel.images[0]
    wide = maps().pivot_table(
        index="swing_rad", columns="boom_angle_rad", values="dx_mm"
    )
    np.testing.assert_array_equal(image.get_array(), wide.to_numpy())
    assert image.get_extent()[0] == pytest.approx(-2 * np.pi - np.pi / 12)
    (dots,) = panel.collections
    np.testing.assert_allclose(dots.get_offsets()[:, 0], hops()["boom_angle_rad"])
    np.testing.assert_allclose(dots.get_array(), hops()["dx_mm"])


def test_maps_with_a_middle_have_it_at_zero():
    figure = frame_change_figure(maps(), hops())
    low, high = figure.axes[1].images[0].get_clim()
    assert low == -high


def test_the_printed_map_stands_above_the_own_at_one_scale():
    printed = maps()[maps()["swing_rad"].abs() < 0.7]
    figure = printed_and_own_figure(printed, maps(), hops())
    assert text_faults(figure) == []
    panels = figure.axes[:6]
    reach = [panel.get_ylim()[1] for panel in panels]
    assert reach == pytest.approx([0.6] * 3 + [1.2] * 3, abs=1e-5)
    heights = [panel.get_position().height for panel in panels]
    assert heights[3] / heights[0] == pytest.approx(2.0, rel=0.02)
    for above, below in zip(panels[:3], panels[3:], strict=True):
        assert above.images[0].get_clim() == below.images[0].get_clim()
        assert len(above.collections[0].get_offsets()) < 30
        assert len(below.collections[0].get_offsets()) == 30
        dotted = [line.get_ydata()[0] for line in below.lines if line.get_ls() == ":"]
        assert dotted == pytest.approx([-0.6, 0.6])
    alike = printed_and_own_figure(maps(), maps(), hops())
    assert not any(line.get_ls() == ":" for line in alike.axes[3].lines)


def curve():
    return pd.DataFrame(
        [
            (model, component, n, (k + 2) / np.sqrt(n), 0.1, 0.4)
            for k, model in enumerate([*LINES, "copies"])
            for component in PANELS
            for n in (20, 35, 60, 100, 170, 300)
        ],
        columns=["model", "component", "hops", "rmse", "rmse_q05", "rmse_q95"],
    )


def test_learning_curves_are_the_table():
    figure = learning_curve_figure(curve())
    assert len(figure.axes) == 3
    assert text_faults(figure) == []
    table = curve()
    for line, model in zip(figure.axes[0].lines, LINES, strict=True):
        rows = table[(table["model"] == model) & (table["component"] == "dx")]
        np.testing.assert_array_equal(line.get_ydata(), rows["rmse"])


def kernels():
    return pd.DataFrame(
        [
            (data, reading, component, smoothness, 0.9 - 0.5 * k, 0.02)
            for data in DATA
            for k, reading in enumerate(READINGS)
            for component in COLUMNS
            for smoothness in SMOOTHNESSES
        ],
        columns=["data", "reading", "component", "smoothness", "r2", "r2_se"],
    )


def test_kernels_are_the_table_with_a_floor():
    figure = kernel_smoothness_figure(kernels())
    assert len(figure.axes) == 6
    assert text_faults(figure) == []
    heights = [
        container.lines[0].get_ydata()[0] for container in figure.axes[0].containers
    ]
    expected = [max(0.9 - 0.5 * k, FLOOR) for k in range(len(READINGS))]
    np.testing.assert_allclose(heights, expected)


def test_nothing_to_show_is_said():
    figures = (
        frame_change_figure(maps().iloc[:0], hops()),
        learning_curve_figure(curve().iloc[:0]),
        kernel_smoothness_figure(kernels().iloc[:0]),
    )
    for figure in figures:
        assert "No " in figure.texts[0].get_text()
