import pytest
from made_up import SOUND, SOUND_ITEMS, install, item

from hopdata.dissertation.items import read_items
from hopdata.dissertation.making import Failure, Record, make_part
from hopdata.dissertation.report.entries import (
    answer,
    counts_of,
    entries_of,
    faults_of,
    found_of,
)
from hopdata.dissertation.rows import Agreement, Row


@pytest.fixture
def items(tmp_path):
    (tmp_path / "made_up.toml").write_text(SOUND_ITEMS)
    return read_items(tmp_path)


@pytest.fixture
def record(tmp_path, monkeypatch):
    install(monkeypatch, "made_up", SOUND)
    return make_part("made_up", tmp_path / "made_up", [3, 4], formats=["svg"])


def by_number(items, *records):
    return {entry.item.number: entry for entry in entries_of(items, records)}


def test_numbers_are_put_into_the_sentences(items, record):
    entries = by_number(items, record)
    assert list(entries) == [1, 32, 93]
    order = entries[93]
    assert order.standing == "differs"
    assert order.sign == "≠"
    assert order.printed_method == "slope 4.20"
    assert order.ours == "slope 4.5 (4.0 to 5.0)"
    assert order.why.endswith("all give 4 (4 to 5)")
    assert order.failure is None
    assert order.figure_failure is None
    assert entries[1].printed_method == "error 3\u00a0×\u00a010⁻¹⁶"
    assert entries[1].ours == ""
    assert faults_of([*entries.values()], [record]) == []


def test_a_part_that_failed_is_told_at_each_item_and_in_one_line(items):
    failed = Record("made_up", failure=Failure("no MuJoCo", "install it"))
    entries = by_number(items, failed)
    assert {entry.word for entry in entries.values()} == {"cannot be made"}
    assert entries[32].failure.why == "no MuJoCo"
    faults = faults_of([*entries.values()], [failed])
    assert [fault.line for fault in faults] == [
        "made_up (items 1, 32, 93): cannot be made: no MuJoCo; install it"
    ]
    assert faults[0].part == "made_up"


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([], "the part made_up returned no row for it"),
        ([Row(32, Agreement.AGREES)], "the part made_up gives no 'maps' for its"),
        (
            [Row(32, Agreement.AGREES, {"maps": 1}, "odd")],
            "the part made_up gives no 'odd' for its sentences",
        ),
    ],
)
def test_a_row_that_cannot_be_shown_leaves_the_others(items, record, rows, why):
    kept = [row for row in record.rows if row.item != 32]
    record = Record("made_up", [1], [*kept, *rows], record.figures)
    entries = by_number(items, record)
    assert entries[32].standing == "missing"
    assert why in entries[32].failure.why
    assert entries[1].standing == "built"
    (fault,) = faults_of([*entries.values()], [record])
    assert fault.line.startswith("item 32 (Affine maps): cannot be made: the part")


def test_a_number_that_does_not_suit_its_sentence_is_told(items, record):
    kept = [row for row in record.rows if row.item != 93]
    row = Row(93, Agreement.AGREES, {"slope": "four", "printed": 4.2})
    record = Record("made_up", [1], [*kept, row], record.figures)
    entry = by_number(items, record)[93]
    assert "its sentences do not suit its numbers" in entry.failure.why


@pytest.mark.parametrize(
    ("failed", "why"),
    [
        ({}, "the part made_up drew no figure of this name"),
        ({"fig4_2_order": Failure("no axes")}, "no axes"),
        ({"": Failure("no table")}, "no table"),
    ],
)
def test_a_figure_that_was_not_drawn_is_told_and_keeps_its_row(
    items, record, failed, why
):
    record = Record("made_up", [1], record.rows, [], failed_figures=failed)
    entries = by_number(items, record)
    assert entries[93].standing == "differs"
    assert entries[93].figure_failure.why == why
    assert entries[1].figure_failure is None
    (fault,) = faults_of([*entries.values()], [record])
    assert fault.line == f"item 93: fig4_2_order: cannot be drawn: {why}"


def test_a_row_without_an_item_and_an_item_without_a_part_are_faults(
    items, record, tmp_path
):
    rows = [*record.rows, Row(77, Agreement.AGREES)]
    record = Record("made_up", [1], rows, record.figures)
    (tmp_path / "other.toml").write_text(item(50))
    more = read_items(tmp_path)
    entries = entries_of(more, [record])
    assert [fault.line for fault in faults_of(entries, [record])] == [
        "item 77: items/made_up.toml has no entry for it",
        "item 50 (Item 50): cannot be made: there is no part other",
    ]


def test_the_answer_counts(items, record):
    found = found_of(items, [record])
    assert found["counts"] == {
        "agrees": 1, "partly": 0, "differs": 1, "built": 1, "missing": 0,
    }  # fmt: skip
    assert found["standings"] == {"1": "built", "32": "agrees", "93": "differs"}
    assert found["faults"] == []
    assert found["answer"] == (
        "Of 2 results, 1 agrees and 1 differs. "
        "1 definition or algorithm is built and run."
    )
    counts = dict(counts_of(entries_of(items, [record])), agrees=3, missing=2)
    assert answer(counts).startswith("Of 4 results, 3 agree and 1 differs.")
    assert answer(counts).endswith("2 items cannot be made here.")
