"""Every item of the dissertation has one entry, and one part that measures it."""

import pytest
from made_up import SOUND_ITEMS, item

from hopdata.dissertation import items, parts
from hopdata.dissertation.items import NUMBER_OF_ITEMS, read_items, read_part
from hopdata.dissertation.report.entries import WORDS
from hopdata.errors import ConfigError

PARTS = {
    path.stem
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
    assert set(items.part_names()) == PARTS
    assert parts.__doc__


def test_every_item_has_a_chapter_and_says_something_of_a_result():
    for one in read_items():
        assert one.chapter in WORDS["chapters"], one.number
        assert one.printed_method or one.ours, one.number


def test_items_are_read_in_the_order_of_the_text(tmp_path):
    (tmp_path / "one.toml").write_text(SOUND_ITEMS)
    (tmp_path / "two.toml").write_text(item(50))
    found = read_items(tmp_path)
    assert [one.number for one in found] == [1, 32, 50, 93]
    assert [one.part for one in found] == ["one", "one", "two", "one"]
    order = read_part("one", tmp_path)[0]
    assert order.chapter == "4"
    assert order.reasons["all_points"].startswith("the printed fit")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (item(7) + item(7), "item 7: expected one entry, found another in one.toml"),
        (item(7, printed=""), "item 7: printed: expected a value"),
        (item(7, where=""), "item 7: where: expected a value"),
        (item(7, figures="fig"), r"item 7: expected fields .* found \['figures'\]"),
        (item(7, figure="fig4_2"), "item 7: figure_printed: expected what the"),
    ],
)
def test_an_entry_with_a_mistake_is_refused(tmp_path, text, told):
    (tmp_path / "one.toml").write_text(text)
    with pytest.raises(ConfigError, match=told):
        read_items(tmp_path)
