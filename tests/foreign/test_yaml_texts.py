"""Which YAML is loaded, into which values, and what the rest costs."""

import resource
import subprocess
import sys
import time
from datetime import date

import pytest
import yaml

from hopdata.errors import ConfigError
from hopdata.foreign.texts import MOST_LEVELS
from hopdata.foreign.yaml_texts import MOST_ENTRIES, loaded, root_node


def test_plain_values_are_those_of_the_safe_loader():
    text = "a: &x {b: 1, c: [1.5, .inf, null, ~, yes, 0x10, 1_000]}\nd: {<<: *x, e: 'é'}\nf: 2020-01-02\n"
    assert loaded(text, "f") == yaml.safe_load(text)
    assert loaded(text, "f")["f"] == date(2020, 1, 2)
    assert loaded("", "f") is None


def chain(link, n):
    """Return a text in which each of n keys repeats the one before it nine times."""
    lines = ["a0: &a0 {x: 1}"]
    for i in range(1, n):
        lines.append(f"a{i}: &a{i} " + link.format(", ".join([f"*a{i - 1}"] * 9)))
    return "\n".join(lines)


HOSTILE = {
    "brackets": ("[" * 1_000_000, "too_deep"),
    "braces": ("{a: " * 100_000, "too_deep"),
    "dashes": ("- " * 100_000, "too_deep"),
    "indents": ("".join(" " * i + "a:\n" for i in range(1000)), "too_deep"),
    "aliases": (chain("[{}]", 20), "too_many_once_expanded"),
    "merges": (chain("{{<<: [{}]}}", 20), "too_many_once_expanded"),
    "alias chain": (
        "a0: &a0 [1]\n" + "\n".join(f"a{i}: &a{i} [*a{i - 1}]" for i in range(1, 80)),
        "too_deep",
    ),
    "entries": (f"[{'a,' * 3_000_000}]", "too_many"),
    "documents": ("---\n" * 300_000, "too_many"),
    "directives": ("%TAG !a! b\n" * 100_000, "too_many_directives"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_texts_beyond_their_bounds_cost_a_second_and_little_memory(name):
    text, code = HOSTILE[name]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    with pytest.raises(ConfigError) as caught:
        loaded(text, "study.yaml")
    assert time.process_time() - begin < 2
    assert caught.value.code == f"foreign.{code}"
    assert str(caught.value).startswith("study.yaml: expected")
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert grown_mb < 200


def test_the_parser_alone_would_end_the_process():
    """So the bound on levels must come first: this is what it is for."""
    code = "import yaml; yaml.load('[' * 100_000, Loader=yaml.CSafeLoader)"
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=False
    )
    assert ended.returncode < 0


@pytest.mark.parametrize(
    "text",
    [
        "9" * 1000,
        "0x" + "9" * 1_000_000,
        ":".join(["59"] * 1000),
        "1" + "0" * 1000 + ".5",
        "!!binary aGFsbG8=",
        "!!set {a, b}",
        "!!omap [a: 1]",
        "!!python/object/apply:os.system ['true']",
        "!!timestamp x",
        "!!int x",
        "!own x",
        "a: 1\na: 2",
        "? [a]\n: 1",
        "'\x00'",
        '"\\ud800"',
        "%YAML 9.9\n---\na",
        "a: &a [*b]",
    ],
)
def test_other_values_are_refused(text):
    with pytest.raises(yaml.YAMLError):
        loaded(text, "f")


def test_what_is_just_within_the_bounds_is_loaded():
    levels = MOST_LEVELS
    assert loaded("[" * levels + "]" * levels, "f") is not None
    assert len(loaded(f"[{'a,' * (MOST_ENTRIES - 1)}]", "f")) == MOST_ENTRIES - 1
    assert loaded("a: 0.1234567890123456789012345678901234567890", "f")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        # The mapping, and a key and a value for each entry.
        ("".join(f"a{i}: 1\n" for i in range(MOST_ENTRIES // 2)), "100,001"),
        (f"[{'a,' * (MOST_ENTRIES + 5)}]", "100,006"),
        (f"[{'a,' * (3 * MOST_ENTRIES)}]", "more than 200,000"),
    ],
)
def test_too_many_entries_are_told_by_their_number_without_aliases(text, found):
    with pytest.raises(ConfigError) as caught:
        loaded(text, "f")
    told = f"f: expected at most 100,000 keys and values, found {found}"
    assert str(caught.value) == told
    just_fewer = "".join(f"a{i}: 1\n" for i in range(MOST_ENTRIES // 2 - 1))
    assert len(loaded(just_fewer, "f")) == MOST_ENTRIES // 2 - 1


def test_aliases_are_told_of_where_it_is_they_that_make_it_large():
    with pytest.raises(ConfigError, match=r"100,000 keys and values.*aliases"):
        loaded(chain("[{}]", 8), "f")


def test_a_list_within_itself_is_left_to_the_caller():
    found = loaded("a: &a [*a]", "f")
    assert found["a"][0] is found["a"]
    assert root_node("a: 1", "f").value[0][0].start_mark.line == 0
