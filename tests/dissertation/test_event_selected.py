"""Items 1 to 9: what `check_c1` and the integrator say of the dissertation's claims."""

from dataclasses import replace

import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import event_selected
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement


@pytest.fixture(scope="module")
def made():
    return event_selected.make([3])


@pytest.fixture(scope="module")
def rows(made):
    return {row.item: row for row in made.rows}


def test_every_item_has_a_row_whose_numbers_fill_its_sentences(rows):
    items = read_part("event_selected")
    assert sorted(rows) == [one.number for one in items] == list(range(1, 10))
    for one in items:
        values = rows[one.number].to_dict()["values"]
        reason = rows[one.number].reason
        sentences = [one.printed_method, one.ours]
        if reason:
            sentences.append(one.reasons[reason])
        for sentence in sentences:
            assert "{" not in filled(sentence, values)


def test_what_agrees(rows):
    found = {item: row.agreement for item, row in rows.items()}
    claims = dict.fromkeys((4, 5, 6, 7, 8), Agreement.AGREES)
    definitions = dict.fromkeys((1, 2, 3), Agreement.BUILT)
    assert found == {**definitions, **claims, 9: Agreement.PARTLY}


def test_numbers_that_are_known_otherwise(rows):
    constant = rows[1].values
    assert 0.9 * constant["speed"] < constant["constant"] < constant["speed"]
    assert constant["grazing"] <= 0.0
    assert rows[2].values["coulomb"] > rows[2].values["coulomb_allowed"]
    assert rows[3].values["impact_kept"] == pytest.approx(0.9)
    assert rows[3].values["plastic_kept"] == pytest.approx(0.0, abs=1e-12)
    assert rows[5].values["contacts"] == [6]
    assert rows[8].values["determinant"] == pytest.approx(1.0)  # it loses no energy
    assert (rows[9].values["hops1"], rows[9].values["hops3"]) == (36, 46_656)


def test_each_system_misses_the_lines_that_it_is_made_to_miss(made):
    table = made.tables["table1_1"]
    for system in event_selected.checked_systems():
        own = table[table["system"] == system.name]
        missed = set(own.loc[~own["holds"], "condition"])
        assert set(system.missing) <= missed
        if not system.missing:
            assert missed == set()
    lines = table.groupby("group", sort=False)["condition"].nunique()
    assert lines.to_dict() == {"definitions": 2, "ESS": 4, "FoPAS": 4, "C1": 1}


def test_a_system_that_misses_another_line_is_no_agreement(monkeypatch):
    systems = {one.name: one for one in event_selected.checked_systems()}
    coupled = systems[event_selected.COUPLED]
    jumping = replace(systems[event_selected.IMPACT], name=coupled.name, missing=())
    systems[coupled.name] = replace(coupled, missing=())
    for wrong in (jumping, systems[coupled.name]):
        listed = [*systems.values()]
        listed[-1] = wrong
        monkeypatch.setattr(
            event_selected, "checked_systems", lambda shown=listed: shown
        )
        rows = {row.item: row.agreement for row in event_selected.checklist_rows([3])}
        missing_left = wrong is jumping
        assert (rows[3] == Agreement.DIFFERS) is missing_left
        assert (rows[4] == Agreement.DIFFERS) is not missing_left


def test_the_table_is_drawn(made):
    figures = event_selected.draw(made.tables)
    assert list(figures) == ["table1_1"]
    texts = [text.get_text() for text in figures["table1_1"].axes[0].texts]
    assert len(texts) == len(made.tables["table1_1"]) + 4  # numbers, and groups' names
    figures["table1_1"].savefig("/dev/null", format="svg")
