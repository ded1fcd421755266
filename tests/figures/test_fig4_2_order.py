import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.fig4_2_order import order_figure

METHODS = {"printed, DOPRI5, Illinois": 4.0, "hopdata, dopri5": 5.0, "hopdata, dop853": 8.0}


def errors(methods=METHODS):
    """Straight lines between a plateau and rounding."""
    step, tables = np.geomspace(0.5, 5e-4, 31), []
    for name, order in methods.items():
        line = step**order
        error = np.clip(line, 3e-15, 1e-2)
        used = (error > 1e-12) & (error < 1e-3)
        columns = {"method": name, "max_step": step, "error_rms": error, "in_fit": used}
        tables.append(pd.DataFrame({**columns, "fitted_order": order, "fitted_error": line}))
    return pd.concat(tables)


def lines(figure, kind):
    return [line for line in figure.axes[0].lines if line.get_label() == f"_{kind}"]


def curves(figure):
    return [line for line in figure.axes[0].lines if not line.get_label().startswith("_")]


def test_a_curve_a_line_and_an_interval_each():
    table = errors()
    figure = order_figure(table.sample(frac=1, random_state=2))
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert len(curves(figure)) == len(lines(figure, "fit")) == len(lines(figure, "interval")) == 3
    assert text_faults(figure) == []


def test_what_is_drawn_is_what_the_table_says():
    table = errors({"only": 4.0})
    figure = order_figure(table)
    table = table.sort_values("max_step")
    (curve,), (fit,), (interval,) = curves(figure), lines(figure, "fit"), lines(figure, "interval")
    assert curve.get_xdata() == pytest.approx(1 / table["max_step"])
    assert curve.get_ydata() == pytest.approx(table["error_rms"])
    assert fit.get_ydata() == pytest.approx(table["fitted_error"])
    used = table[table["in_fit"]]
    assert interval.get_xdata() == pytest.approx(1 / used["max_step"])
    low, high = figure.axes[0].get_ylim()
    assert low < table["error_rms"].min() < table["error_rms"].max() < high


def test_the_orders_are_named():
    labels = [curve.get_label() for curve in curves(order_figure(errors()))]
    assert labels == [f"{name}\norder {order:.2f}" for name, order in METHODS.items()]


def test_methods_can_be_told_apart():
    many = {f"method {k}": 4.0 for k in range(7)}
    figure = order_figure(errors(many))
    looks = {(curve.get_color(), curve.get_marker()) for curve in curves(figure)}
    assert len(looks) == 7
    assert len({marker for _, marker in looks}) == 7
    assert text_faults(figure) == []


def test_a_method_without_a_straight_part_is_said():
    table = errors({"scattered": 4.0}).assign(
        in_fit=False, fitted_order=np.nan, fitted_error=np.nan
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


def test_nothing_measured_is_said():
    figure = order_figure(errors().iloc[:0])
    assert "No errors" in figure.texts[0].get_text()
