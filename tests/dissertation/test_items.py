"""Every item of the dissertation has one entry, and one part that measures it."""

import re
from pathlib import Path

import pytest
from asked_values import asked, not_given, texts_of
from made_up import SOUND_ITEMS, item

from hopdata.dissertation import items
from hopdata.dissertation.items import NUMBER_OF_ITEMS, read_items, read_part
from hopdata.dissertation.report.document import section_of, stated
from hopdata.dissertation.report.entries import WORDS
from hopdata.errors import ConfigError

DOCS = Path(__file__).parents[2] / "docs"
PARTS = {
    path.stem: path
    for path in items.FOLDER.parent.joinpath("parts").glob("*.py")
    if not path.stem.startswith("_")
}

# Items whose entries are still being written; empty once all are there.
PENDING = set(range(1, NUMBER_OF_ITEMS + 1))


def test_every_item_has_one_entry():
    numbers = [one.number for one in read_items()]
    missing = set(range(1, NUMBER_OF_ITEMS + 1)) - set(numbers)
    assert missing - PENDING == set()
    assert set(numbers) <= set(range(1, NUMBER_OF_ITEMS + 1))


def test_every_part_has_items_and_every_file_of_items_a_part():
    assert set(items.part_names()) == set(PARTS)


def test_every_item_has_a_chapter_and_says_something_of_a_result():
    for one in read_items():
        assert one.chapter in WORDS["chapters"], one.number
        assert one.printed_method or one.ours, one.number


@pytest.mark.parametrize("part", PARTS)
def test_sentences_ask_for_values_that_the_part_gives(part):
    texts = texts_of(PARTS[part])
    for one in read_part(part):
        names = asked(one) | set(one.reasons)
        assert not_given(names, *texts) == set(), f"item {one.number}"


def test_a_value_that_no_part_gives_is_noticed():
    text = """
def make(seeds):
    values = {"slope": 4.0, **{f"{name}_mm": 1.0 for name in ("pre", "post")}}
    return Made([Row(93, Agreement.AGREES, dict(values, error=1.0), "why")])
"""
    assert not_given({"slope", "pre_mm", "error", "why"}, text) == set()
    wrong = {"slopes", "pre_m", "reason"}
    assert not_given(wrong, text) == wrong


def test_the_document_states_what_the_items_say():
    """`make dissertation-docs` writes it; its numbers are those of the last run."""
    text = (DOCS / "dissertation.md").read_text()
    rows = {}
    for line in text.splitlines():
        cells = re.split(r"(?<!\\) \| ", line.removeprefix("| "))
        if cells[0].isdecimal():
            rows[int(cells[0])] = tuple(cells[:3])
    expected = {one.number: stated(one) for one in read_items()}
    told = {number: row for number, row in rows.items() if number not in PENDING}
    due = {number: row for number, row in expected.items() if number not in PENDING}
    assert told == due


def test_the_corrections_lead_to_the_rows_that_measure_them():
    text = (DOCS / "decisions.md").read_text()
    links = re.findall(r"\[row (\d+)\]\(dissertation\.md#section-(\d+)\)", text)
    assert len(links) == text.count("](dissertation.md#")
    assert len(links) > 10
    places = {one.number: section_of(one).replace(".", "") for one in read_items()}
    for number, place in links:
        if int(number) not in PENDING:
            assert places[int(number)] == place, f"row {number}"


def test_items_are_read_in_the_order_of_the_text(tmp_path):
    (tmp_path / "one.toml").write_text(SOUND_ITEMS)
    later = item(50, section="4.10, Fig. 4.9") + item(99, section="1.3.5")
    (tmp_path / "two.toml").write_text(later)
    found = read_items(tmp_path)
    assert [one.number for one in found] == [1, 99, 32, 93, 50]
    assert [one.part for one in found] == ["one", "two", "one", "one", "two"]
    assert found[-1].place == (4, 10)
    order = read_part("one", tmp_path)[0]
    assert order.chapter == "4"
    assert order.reasons["all_points"].startswith("the printed fit")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (item(7) + item(7), "item 7: expected one entry, found another in one.toml"),
        (item(7, printed=""), "item 7: printed: expected a value"),
        (item(7, section="Fig. 4.2"), "item 7: section: expected a text that begins"),
        (item(7, where=""), "item 7: where: expected a value"),
        (item(7, figures="fig"), r"item 7: expected fields .* found \['figures'\]"),
        (item(7, figure="fig4_2"), "item 7: figure_printed: expected what the"),
    ],
)
def test_an_entry_with_a_mistake_is_refused(tmp_path, text, told):
    (tmp_path / "one.toml").write_text(text)
    with pytest.raises(ConfigError, match=told):
        read_items(tmp_path)
