"""The page of messages holds every code, and says what to do about codes that exist."""

import importlib.util
import re
from pathlib import Path

import pandas as pd
import pytest

from hopdata import messages

ROOT = Path(__file__).parents[2]
CODE = re.compile(r"`([a-z]+\.[a-z]\w+)`")
QUALITY = re.compile(r"quality: \*([^*]+)\*")


def packaging(name):
    path = ROOT / "packaging" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def page():
    return packaging("troubleshooting")


@pytest.fixture(scope="module")
def cannot_tell():
    return packaging("cannot_tell")


def test_the_page_on_limits_has_the_advice_of_the_report(cannot_tell):
    text = cannot_tell.PAGE.read_text("utf-8")
    assert text == cannot_tell.written(text), "run: make docs"
    placed = {name for _, name, _ in cannot_tell.PLACE.findall(text)}
    known = set(cannot_tell.advice())
    assert placed <= known
    # The page's first table gives the one; the other is a part of what it says.
    assert known - placed == {"feet", "landings_all_used"}


def test_other_advice_is_noticed(cannot_tell):
    text = cannot_tell.PAGE.read_text("utf-8")
    other = text.replace("Give one export", "Give two exports")
    assert other != text == cannot_tell.written(other)


def test_the_advice_on_two_feet_is_that_of_the_campaign(cannot_tell):
    """Of C1 bodies cleared, and of kinks found, with 1,000 landings of 0.6 mm noise."""
    table = pd.read_csv(ROOT / "docs" / "verdict_campaign.csv")

    def counted(mechanism, feet, what):
        rows = table[(table["mechanism"] == mechanism) & (table["feet"] == feet)]
        assert set(rows["landings"]) == {1000}
        return round((rows[what] * rows["studies"]).sum()), rows["studies"].sum()

    said = cannot_tell.advice()["two_feet"]
    assert counted("c1", 2, "called_none") == (0, 44)
    assert "Of 44 simulated bodies without a difference, none was cleared" in said
    assert (
        "of four feet, {} of {} were".format(*counted("c1", 4, "called_none")) in said
    )
    assert "found in {} of {}".format(*counted("clutch", 2, "called_different")) in said


def test_the_page_is_what_would_be_written_now(page):
    assert page.PAGE.read_text("utf-8") == page.written(), "run: make docs"


def test_every_code_of_every_room_stands_on_it(page):
    rooms = {path.parent.name for path in messages.PACKAGE.glob("*/messages.toml")}
    assert set(page.ROOMS) | page.LABELS == rooms
    listed = re.findall(r"^\| `(\w+\.\w+)` \|", page.written(), re.MULTILINE)
    assert sorted(listed) == sorted(page.codes())
    assert len(listed) > 400


def test_what_to_do_is_about_codes_that_exist(page):
    assert set(page.what_to_do()) <= set(page.codes())
    assert len(page.what_to_do()) > 100


def unknown_names(text, codes):
    """Return the codes and quality checks that a page names and nothing has."""
    from hopdata.landings import checks

    rooms = {code.partition(".")[0] for code in codes}
    named = {one for one in CODE.findall(text) if one.partition(".")[0] in rooms}
    # Keys of the configuration look alike: `landings` and `maps` are no blocks of it.
    named = {one for one in named if one.partition(".")[0] in ("landings", "maps")}
    whats = {
        one.what for one in vars(checks).values() if isinstance(one, checks.Question)
    }
    return (named - set(codes)) | (set(QUALITY.findall(text)) - whats)


@pytest.mark.parametrize("name", ["cannot_tell", "reporting", "protocol", "faq"])
def test_pages_name_codes_and_checks_that_exist(page, name):
    text = (ROOT / "docs" / f"{name}.md").read_text("utf-8")
    assert not unknown_names(text, page.codes())


def test_an_unknown_name_is_noticed(page):
    assert unknown_names("`maps.no_such_code`", page.codes())
    assert unknown_names("quality: *nobody asks this*", page.codes())


def keys_of(text):
    """Return the keys of verdict.json that a page names."""
    block = r"`((?:effect|preliminary)\.\w+|landings_needed|n_landings|contacts_r2|posture)`"
    return set(re.findall(block, text))


def test_keys_of_the_verdict_on_the_pages_exist():
    verdict = "\n".join(
        path.read_text("utf-8") for path in (ROOT / "docs").glob("verdict*.md")
    )
    named = set()
    for name in ("cannot_tell", "reporting"):
        named |= keys_of((ROOT / "docs" / f"{name}.md").read_text("utf-8"))
    assert len(named) > 5
    lost = {key for key in named if f"`{key.split('.')[-1]}`" not in verdict}
    assert not lost
