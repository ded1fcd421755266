"""The part on orders: rows that can be filled, and a verdict that follows from numbers."""

import numpy as np
import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.making import Record
from hopdata.dissertation.parts import order
from hopdata.dissertation.report.entries import entries_of, faults_of
from hopdata.dissertation.rows import Agreement
from hopdata.errors import AnalysisError


@pytest.fixture(scope="module")
def made():
    """Measure with fewer and longer steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(order, "SHORTEST", 5e-3)
        patch.setattr(order, "N_STEPS", 21)
        return order.make([3])


def test_each_item_has_a_row_whose_sentences_can_be_filled(made):
    items = read_part("order")
    assert [one.number for one in items] == [row.item for row in made.rows]
    record = Record("order", rows=made.rows, figures=["fig4_2_order", "theorem_4_2_1"])
    assert faults_of(entries_of(items, [record]), [record]) == []


def test_definitions_and_theorem_hold(made):
    rows = {row.item: row for row in made.rows}
    assert rows[81].agreement is Agreement.BUILT
    assert rows[82].agreement is Agreement.AGREES
    assert rows[82].values["euler"] == pytest.approx(1.0, abs=0.1)
    assert rows[83].agreement is Agreement.AGREES
    assert rows[83].values["above"] == 0
    assert rows[84].values["measured"] < rows[84].values["proven"]


def test_the_error_falls_with_the_fourth_power(made):
    values = made.rows[-1].values
    assert values["slope"] == pytest.approx(4.0, abs=0.4)
    assert values["sweep_least"] < values["slope"] < values["sweep_most"]
    assert values["ratio"] > 3.0
    assert values["count"] >= 4
    assert values["shortest"] >= 5e-3 * (1 - 1e-9)


def test_a_bound_that_is_broken_is_told(made):
    table = made.tables["theorem"].copy()
    table.loc[3, "time_bound"] = table.loc[3, "time_error"] / 2.0
    row = order.theorem_row(table)
    assert row.agreement is Agreement.DIFFERS
    assert row.values["above"] == 1


@pytest.mark.parametrize(
    ("slope", "error", "most", "expected"),
    [
        (4.12, 0.05, 4.3, Agreement.AGREES),
        (3.95, 0.02, 4.5, Agreement.PARTLY),
        (3.95, 0.02, 4.1, Agreement.DIFFERS),
        (3.0, 0.02, 4.5, Agreement.DIFFERS),
    ],
)
def test_the_judgement_follows_from_slope_and_error(slope, error, most, expected):
    values = {"slope": slope, "slope_se": error, "sweep_least": 3.5, "sweep_most": most}
    assert order.judged(values)[0] is expected


def test_without_a_straight_part_the_row_says_so():
    steps = np.geomspace(0.5, 0.005, 21)
    rng = np.random.default_rng(1)
    ragged = order.Sweep(steps, 10.0 ** rng.uniform(-16, -8, (1, 21, 2)))
    tables = order.error_table({"printed": ragged}), order.slope_table(ragged)
    with pytest.raises(AnalysisError, match="a straight part"):
        order.figure_row({"printed": ragged}, *tables)


def test_the_figures_state_what_was_fitted(made):
    figures = order.draw(made.tables)
    assert set(figures) == {"fig4_2_order", "theorem_4_2_1"}
    left, right = figures["fig4_2_order"].axes
    words = left.texts[0].get_text()
    values = made.rows[-1].values
    assert f"slope {values['slope']:.2f}" in words
    assert f"{values['count']} steps" in words
    assert "4.2" in words
    # The printed slope, and that of a third-order method.
    heights = [line.get_ydata()[0] for line in right.get_lines()]
    assert {4.0, 4.2} <= set(heights)
