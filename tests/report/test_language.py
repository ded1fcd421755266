"""The page in another language: one file a room for sentences, and one for words."""

import re
import shutil
import string
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from fake_study import full_study, verdict

from hopdata import messages
from hopdata.errors import ConfigError
from hopdata.messages import Message
from hopdata.report import language
from hopdata.report.language import require_language, said
from hopdata.report.page import build_report

SENTENCE = Message(
    "maps.no_difference",
    {"compared": "6 orders", "bound": "12 %", "where": "", "confidence": "95 %"},
)
NOTE = Message(
    "maps.gross_errors",
    {"count": 3, "landings": 9, "judged": 6, "why": "3 odd", "which": "Rows: 1, 2, 3"},
)


@pytest.fixture
def german(tmp_path, monkeypatch):
    """A German that translates a few sentences of two rooms, and two words."""
    for room in ("maps", "report"):
        (tmp_path / room).mkdir()
        shutil.copy(messages.PACKAGE / room / "messages.toml", tmp_path / room)
    (tmp_path / "report" / "messages.de.toml").write_text(
        'glance = "Auf einen Blick"\nframes = "{frames} Bilder"\nnote = "{what} - {reason}"\n'
    )
    (tmp_path / "maps" / "messages.de.toml").write_text(
        'no_difference = "Kein Unterschied über {bound}."\ngross_errors = "{count} Ausreißer"\n'
    )
    (tmp_path / "report" / "words.de.toml").write_text(
        'Recordings = "Aufnahmen"\n"rate (Hz)" = "Bildrate (Hz)"\n'
    )
    monkeypatch.setattr(messages, "PACKAGE", tmp_path)
    monkeypatch.setattr(language, "FOLDER", tmp_path / "report")
    messages._templates.cache_clear()
    yield
    messages._templates.cache_clear()


def study():
    """Return a study whose verdict has its sentence and a note as messages."""
    note = {"what": str(Message("maps.gross_errors_what")), "reason": str(NOTE)}
    known = verdict(
        sentence=str(SENTENCE),
        messages={"sentence": SENTENCE.to_dict()},
        notes=[note | NOTE.to_dict()],
    )
    return full_study(verdict=known)


def test_a_page_is_translated_as_far_as_there_are_words(german):
    page = build_report(replace(study(), language="de"))
    assert '<html lang="de">' in page
    assert "<h2>Auf einen Blick</h2>" in page
    assert re.search(r"\d Bilder", page)
    assert "<caption>Aufnahmen</caption>" in page
    assert ">Bildrate (Hz)</th>" in page
    assert "Kein Unterschied über 12 %." in page.replace("\u00a0", " ")
    assert "landings left out as far off - 3 Ausreißer" in page
    assert "Descents that are not used" in page  # not translated


def test_english_is_the_page_without_a_language(german):
    page = build_report(study())
    assert page == build_report(replace(study(), language="en"))
    assert "At a glance" in page
    assert "Bilder" not in page
    assert str(SENTENCE) in page.replace("\u00a0", " ")
    assert f"landings left out as far off: {NOTE}" in page


def test_a_language_without_a_file_is_an_error():
    with pytest.raises(ConfigError, match=r"report\.language: .*en.*'xx'"):
        build_report(full_study(language="xx"))
    require_language("en")


def test_what_is_neither_message_nor_word_stays_as_it_is(german):
    assert said(3, "de") == 3
    assert said("rate (Hz)") == "rate (Hz)"
    assert said("rate (Hz)", "de") == "Bildrate (Hz)"


@pytest.mark.parametrize("room", ["maps", "report"])
def test_every_sentence_is_used_and_has_plain_fields(room):
    """A name that no code says would be translated in vain."""
    folder = messages.PACKAGE / room
    sources = [*folder.rglob("*.py"), *folder.rglob("*.j2")]
    sources += messages.PACKAGE.joinpath("commands").glob("*.py")
    sources += messages.PACKAGE.glob("*.py")
    text = "\n".join(Path(path).read_text("utf-8") for path in sources)
    templates = tomllib.loads((folder / "messages.toml").read_text("utf-8"))
    for name, template in templates.items():
        stem = name.removeprefix("group_").removesuffix("_what").removesuffix("_means")
        variable = stem in ("different", "no_difference", "cannot_tell")
        variable |= stem in ("tilt", "velocity", "spin") or "meaning_of_" in stem
        assert variable or re.search(rf"\b({stem}|{name})\b", text), name
        for _, field, _, _ in string.Formatter().parse(template):
            assert field is None or field.isidentifier(), name
