"""The integrator's part of the page: each row tells the corrected from the printed."""

import numpy as np
import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.making import Record
from hopdata.dissertation.parts import integrator
from hopdata.dissertation.report.entries import entries_of, faults_of
from hopdata.dissertation.rows import Agreement


@pytest.fixture(scope="module")
def made():
    return integrator.make([3])


@pytest.fixture(scope="module")
def rows(made):
    return {row.item: row for row in made.rows}


def test_each_item_has_a_row_whose_sentences_can_be_filled(made):
    items = read_part("integrator")
    assert [one.number for one in items] == [row.item for row in made.rows]
    record = Record("integrator", rows=made.rows, figures=["fig4_1_step"])
    assert faults_of(entries_of(items, [record]), [record]) == []


def test_what_the_text_has_wrong_fails_as_printed_and_not_as_corrected(rows):
    on_guard, events, impacts, joined = (rows[item].values for item in (85, 86, 87, 88))
    assert on_guard["once"] == on_guard["runs"]
    assert on_guard["printed"] > 1e4 * on_guard["kept"]
    assert events["printed"] > 4.0 * events["corrected"]
    assert events["apart_printed"] == pytest.approx(events["apart_corrected"], rel=1e-6)
    assert impacts["refused"] == [integrator.N_LANDINGS]
    assert impacts["corrected"] == [0]
    assert (joined["ends"], joined["corrected_ends"]) == (False, True)
    assert joined["lost"] == [integrator.N_LOW_HOPS]
    assert joined["corrected_lost"] == [0]
    assert (joined["rest_printed"], joined["rest"]) == (0, 1)
    signs = [rows[item].agreement for item in (85, 86, 87, 88)]
    assert signs == [Agreement.PARTLY] * 4


def test_what_the_text_has_right_agrees(rows):
    assert {rows[item].agreement for item in (89, 90, 92)} == {Agreement.AGREES}
    assert rows[98].agreement is Agreement.BUILT
    hopper = rows[91].values
    assert hopper["printed_long"] > 5.0
    assert hopper["restarted_long"] < 1e-5
    assert hopper["printed"] < 1e-4


def test_the_agreement_follows_from_the_numbers(monkeypatch):
    """The same rows with a method that loses events, and with gradients that are wrong."""
    monkeypatch.setattr(integrator, "octant_crossings", lambda: (np.full(3, 0.7), None))
    assert integrator.octant_row().agreement is Agreement.DIFFERS
    monkeypatch.setattr(integrator, "gradient_error", lambda _plate: 1e-3)
    assert integrator.plate_row([1]).agreement is Agreement.DIFFERS
    monkeypatch.setattr(integrator, "CORRECTED", integrator.PRINTED)
    assert integrator.resolution_row().agreement is Agreement.BUILT
    assert integrator.alternation_row([1]).values["corrected_ends"] is True


def test_the_figure_shows_both_roots(made):
    (figure,) = integrator.draw(made.tables).values()
    left, right = figure.axes
    assert len(left.get_lines()) > 5
    instant = made.tables["step"]["instant"].iloc[0]
    ticks = right.get_xticks()
    assert instant in ticks
    assert 0 < abs(ticks[1] - ticks[0]) < 1e-3
