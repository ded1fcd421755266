import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.fig4_3_calibration import LINES, calibration_figure


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
    empty = pd.DataFrame({"solver": pd.Series(dtype=str), "time_s": pd.Series(dtype=float)})
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
    assert figure.axes[0].lines[1].get_ydata()[-1] == pytest.approx(1 + abs(np.cos(6)) + 0.06)


def test_a_solver_may_be_missing():
    figure = calibration_figure(trajectories(("exact", "hopdata")))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["exact", "hopdata"]
    assert text_faults(figure) == []


def test_no_trajectories_are_said():
    assert "No trajectories" in calibration_figure(trajectories(())).texts[0].get_text()
