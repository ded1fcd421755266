"""Messages: codes and values first, words last, in as many languages as there are files."""

import math
import string
import tomllib

import pytest

from hopdata import messages
from hopdata.messages import Message, at_least_in_per_cent, at_most_in_per_cent


@pytest.fixture
def rooms(tmp_path, monkeypatch):
    """Two languages of one made-up room."""
    (tmp_path / "room").mkdir()
    english = 'few = "{n} of {wanted:.1f} landings"\nwhy = "since {reason}"\n'
    (tmp_path / "room" / "messages.toml").write_text(english)
    german = 'few = "{n} von {wanted:.1f} Landungen"\n'
    (tmp_path / "room" / "messages.de.toml").write_text(german)
    monkeypatch.setattr(messages, "PACKAGE", tmp_path)
    messages._templates.cache_clear()
    yield
    messages._templates.cache_clear()


def test_a_message_is_put_into_words_last(rooms):
    few = Message("room.few", {"n": 3, "wanted": 30})
    assert str(few) == "3 of 30.0 landings"
    assert few.text("de") == "3 von 30.0 Landungen"
    assert Message("room.few", {"n": 4, "wanted": 30}) != few


def test_large_numbers_have_no_exponent(rooms):
    folder = messages.PACKAGE / "room" / "messages.toml"
    folder.write_text('error = "{ms:.2g} ms"\n')
    messages._templates.cache_clear()
    told = {value: str(Message("room.error", {"ms": value})) for value in (0.43, 128.0)}
    assert told == {0.43: "0.43 ms", 128.0: "130 ms"}
    assert messages.without_exponent(-1234.0) == "-1200"
    assert messages.without_exponent(1e-7) == "1e-07"


def test_a_sentence_that_a_language_lacks_is_said_in_english(rooms):
    few = Message("room.few", {"n": 3, "wanted": 30})
    assert (
        Message("room.why", {"reason": few}).text("de") == "since 3 von 30.0 Landungen"
    )


def test_a_message_goes_through_json_and_back(rooms):
    few = Message("room.few", {"n": 3, "wanted": 30})
    why = Message("room.why", {"reason": few})
    assert why.to_dict()["text"] == "since 3 of 30.0 landings"
    assert Message.from_dict(why.to_dict()) == why


def test_an_unknown_code_and_a_missing_value_are_errors(rooms):
    with pytest.raises(KeyError):
        str(Message("room.no_such_sentence"))
    with pytest.raises(KeyError):
        str(Message("room.few", {"n": 3}))


def test_the_languages_are_the_files(rooms):
    assert messages.languages() == ["en", "de"]


def test_every_translation_has_the_values_of_its_english_sentence():
    for path in messages.PACKAGE.glob("*/messages.*.toml"):
        english = tomllib.loads(path.with_name("messages.toml").read_text("utf-8"))
        for name, template in tomllib.loads(path.read_text("utf-8")).items():
            assert _fields(template) <= _fields(english[name]), (path, name)


def _fields(template):
    return {name for _, name, _, _ in string.Formatter().parse(template) if name}


@pytest.mark.parametrize(
    ("share", "low", "high"),
    [
        (0.0, 0.0, 0.0),
        (0.12, 12.0, 12.0),
        (0.29, 29.0, 29.0),
        (0.2001, 20.0, 21.0),
        (0.0123, 1.2, 1.3),
        (0.00987, 0.98, 0.99),
        (0.0999, 9.9, 10.0),
        (0.999, 99.0, 100.0),
        (1.0512, 105.0, 106.0),
    ],
)
def test_ends_of_intervals_are_rounded_outwards(share, low, high):
    assert at_least_in_per_cent(share) == low
    assert at_most_in_per_cent(share) == high


def test_a_bound_that_is_not_known_stays_so():
    assert at_most_in_per_cent(math.inf) == math.inf
