"""Which texts from elsewhere are read, and that each of the others is told in one line."""

import json
import os
import time

import pytest

from hopdata.errors import ConfigError, RecordingError
from hopdata.foreign import texts

DEEP = 100_000


@pytest.fixture
def written(tmp_path):
    """Return a function that writes bytes or text to a file and returns its path."""

    def write(content):
        path = tmp_path / "file"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def code_of(call, *arguments, **options):
    with pytest.raises(ConfigError) as caught:
        call(*arguments, **options)
    assert str(caught.value).isprintable()
    return caught.value.code


def test_a_plain_file_is_read_whole(written):
    content = bytes(range(256))
    assert texts.bytes_of(written(content), most=256) == content
    assert texts.text_of(written("\ufeffmüde\n")) == "müde\n"


def test_what_is_no_plain_file_is_not_opened(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    begin = time.monotonic()
    for place in (pipe, "/dev/zero", tmp_path):
        assert code_of(texts.bytes_of, place) == "foreign.no_plain_file"
    assert time.monotonic() - begin < 1


@pytest.mark.parametrize("name", ["missing", "a\0b", "a\ud800", "a" * 5000])
def test_a_name_without_a_file_is_told(name, tmp_path):
    with pytest.raises(RecordingError) as caught:
        texts.bytes_of(f"{tmp_path}/{name}", error=RecordingError)
    assert caught.value.code == "foreign.no_file"
    assert texts.is_absent(caught.value) == (name == "missing")


def test_a_file_that_is_longer_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "long"
    with path.open("wb") as file:
        file.truncate(10**12)  # no disk has it, and no memory
    assert code_of(texts.bytes_of, path) == "foreign.too_large"
    path.write_bytes(b"12345")
    assert texts.bytes_of(path, most=5) == b"12345"
    assert code_of(texts.bytes_of, path, most=4) == "foreign.too_large"


def test_a_file_that_states_no_size_is_bounded_too():
    """As those of the system, which say that they have 0 bytes."""
    assert os.stat("/proc/self/status").st_size == 0
    assert texts.bytes_of("/proc/self/status").startswith(b"Name")
    assert code_of(texts.bytes_of, "/proc/self/status", most=9) == "foreign.too_large"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
def test_other_bytes_are_no_text(written, encoding):
    assert (
        code_of(texts.text_of, written("müde".encode(encoding))) == "foreign.not_utf8"
    )


def test_json_as_hopdata_writes_it_comes_back(written):
    content = {
        "a": [1, 2.5, None, True, "\ud83d[[[[,,"],
        "b": {"c": -1e-300, "d": 10**30},
    }
    assert texts.json_of(written(json.dumps(content))) == content


def nested(levels):
    return "[" * levels + "]" * levels


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[" * DEEP, "too_deep"),
        ('{"a":' * DEEP, "too_deep"),
        (nested(texts.MOST_LEVELS + 1), "too_deep"),
        (f"[{'1,' * texts.MOST_VALUES}1]", "too_many"),
        ("[NaN]", "not_json"),
        ("[-Infinity]", "not_json"),
        ("[1e999]", "not_json"),
        ("9" * 1000, "not_json"),
        ('"' + "\\" * 2_000_000, "not_json"),
        ('"\\' * 1_000_000, "not_json"),
        ("", "not_json"),
    ],
)
def test_json_beyond_its_bounds_is_told_within_a_second(written, text, code):
    begin = time.process_time()
    assert code_of(texts.json_of, written(text)) == f"foreign.{code}"
    assert time.process_time() - begin < 1.5


def test_json_up_to_its_bounds_is_read(written):
    texts.json_of(written(nested(texts.MOST_LEVELS)))
    number = "9" * texts.LONGEST_NUMBER
    assert texts.json_of(written(f"[{number}]")) == [int(number)]
    # Brackets and commas within a text are none of JSON.
    assert texts.json_of(written(json.dumps("[," * DEEP))) == "[," * DEEP


def test_json_with_too_many_values_says_how_many_there_are(written):
    """A list has one value more than commas, and is a value itself."""
    most = texts.MOST_VALUES
    assert len(texts.json_of(written(f"[{'1,' * (most - 2)}1]"))) == most - 1
    for n_more, found in ((1, f"{most + 1:,}"), (most + 9, f"more than {2 * most:,}")):
        with pytest.raises(ConfigError) as caught:
            texts.json_of(written(f"[{'1,' * (most - 2 + n_more)}1]"))
        told = f"expected at most {most:,} values, found {found}"
        assert str(caught.value).endswith(told)
