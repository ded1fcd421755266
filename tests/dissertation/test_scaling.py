"""The cost of a contact: slopes are those of the times, and rows follow from them."""

from importlib.util import find_spec
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.dissertation.figures.scaling import LINES, scaling_figure
from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import scaling
from hopdata.dissertation.parts.scaling import (
    NAMES,
    Race,
    by_hopdata,
    by_printed,
    draw,
    largest_deviation,
    make,
    scaling_row,
    settling_bed,
    solved,
)
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement
from hopdata.scenes.plate import Plate

needs_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="MuJoCo is not installed"
)
COUNTS = np.arange(2.0, 36.0)
START = Plate().initial_states(1, 3)[0]


def race(counts=COUNTS, events=6.0, **slopes):
    """Return times on straight lines, with other offsets for each seed and start."""
    costs = {"mujoco": 40.0, "balls": 200.0, "printed": 400.0, "hopdata": 5.0} | slopes
    offsets = np.random.default_rng(1).uniform(100.0, 101.0, (2, 4, 1))
    times = {NAMES[name]: offsets + cost * counts for name, cost in costs.items()}
    errors = {name: np.full(one.shape, 0.1) for name, one in times.items()}
    return Race(counts, times, errors, np.full((2, 4, len(counts)), events) * counts)


def test_the_cost_of_a_contact_is_the_slope_of_the_medians():
    row = scaling_row(race(), race(np.array([2.0, 13.0, 24.0]), 1.0, printed=20.0), "4")
    assert row.values["printed_us"] == pytest.approx([400.0, 400.0])
    assert row.values["printed_ratio"] == pytest.approx([10.0, 10.0])
    assert row.values["balls_ratio"] == pytest.approx([2.0, 2.0])
    assert row.values["settling_ratio"] == pytest.approx([0.5, 0.5])
    assert row.values["hopdata_times_faster"] == pytest.approx([8.0, 8.0])
    assert (row.values["events"], row.values["settling_events"]) == (6.0, 1.0)


@pytest.mark.parametrize(
    ("printed", "settling", "hopdata", "agreement"),
    [
        (50.0, 30.0, 5.0, Agreement.AGREES),
        (400.0, 30.0, 5.0, Agreement.PARTLY),
        (50.0, 30.0, 60.0, Agreement.PARTLY),
        (400.0, 400.0, 5.0, Agreement.PARTLY),
        (400.0, 400.0, 60.0, Agreement.DIFFERS),
        (1.0, 1.0, 60.0, Agreement.DIFFERS),
    ],
)
def test_the_row_agrees_by_its_ratios(printed, settling, hopdata, agreement):
    bouncing = race(printed=printed, hopdata=hopdata)
    assert scaling_row(bouncing, race(printed=settling), "4").agreement == agreement


def test_local_slopes_and_their_bands():
    table = race().marginal(11)
    printed = table[table["solver"] == "printed"]
    assert printed["n_contacts"].tolist() == list(range(7, 31))
    assert printed["marginal_us"].to_numpy() == pytest.approx(np.full(24, 400.0))
    noisy = race()
    times = noisy.times_us["printed"]
    times += np.random.default_rng(2).normal(0.0, 300.0, times.shape)
    printed = noisy.marginal(11).query("solver == 'printed'")
    width = printed["high95_us"] - printed["low95_us"]
    assert (width > 10.0).all()
    assert (width < 400.0).all()


def test_the_printed_method_is_accurate_enough_at_its_step():
    for plate in (Plate(9), settling_bed(9)):
        exact = by_hopdata(plate, 1e-11)(START)
        assert np.abs(by_printed(plate)(START) - exact).max() < 0.03
        assert np.abs(by_hopdata(plate)(START) - exact).max() < 1e-4


def test_a_bar_settles_with_critical_damping():
    assert len(solved(Plate(9), START, 1e-6).events) > 3 * 9
    assert len(solved(settling_bed(9), START, 1e-6).events) == 9


@needs_mujoco
def test_depths_in_mujoco_are_the_event_functions(monkeypatch):
    assert largest_deviation(Plate(5)) < 1e-12
    monkeypatch.setattr(scaling, "PRESSED", (0.0, 0.95, 0.1, 0.0, 0.0, 0.0))
    assert largest_deviation(Plate(5)) == np.inf


@needs_mujoco
def test_the_part_is_made_and_told(monkeypatch):
    small = {"CONTACTS": (2, 5, 8), "SETTLING_CONTACTS": (2, 8), "PROCEDURAL": (2, 8)}
    for name, value in (small | {"STARTS": 1, "WINDOW": 3, "DRAWS": 20}).items():
        monkeypatch.setattr(scaling, name, value)
    made = make([1, 2])
    rows = {row.item: row for row in made.rows}
    items = {item.number: item for item in read_part("scaling")}
    assert set(rows) == set(items) == {13, 97}
    for number, item in items.items():
        for text in (item.printed_method, item.ours, *item.reasons.values()):
            assert "{" not in filled(text, rows[number].values)
        assert not rows[number].reason or rows[number].reason in item.reasons
    assert rows[13].agreement == Agreement.BUILT
    assert rows[97].values["printed_error"] < rows[97].values["mujoco_error"]
    assert rows[97].values["hopdata_error"] < 1e-4
    stored = {
        name: pd.read_csv(StringIO(table.to_csv(index=False)))
        for name, table in made.tables.items()
    }
    (figure,) = draw(stored).values()
    assert text_faults(figure) == []


# The figure.


def test_two_panels_with_bands_and_the_bed_that_damps():
    settling = race(np.array([2.0, 13.0, 24.0]), printed=20.0).marginal(2)
    figure = scaling_figure(race().table(), race().marginal(11), settling)
    left, right = figure.axes
    assert [len(axes.collections) for axes in (left, right)] == [4, 4 + 2]
    assert [line.get_label() for line in left.lines] == [x[0] for x in LINES.values()]
    assert left.get_yscale() == right.get_yscale() == "log"
    assert right.lines[0].get_ydata() == pytest.approx(np.full(24, 400.0))
    assert text_faults(figure) == []


def test_nothing_to_show_is_said():
    none = race().table().iloc[:0]
    (text,) = scaling_figure(none, none, none).texts
    assert "No run times" in text.get_text()
