import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.fig4_4_scaling import SERIES, scaling_figure

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


def test_no_times_are_said():
    assert "No run times" in scaling_figure(times(()), marginal()).texts[0].get_text()
