"""The oracle of the fuzzing: it must see each kind of fault, and none in what is sound."""

import sys

import pytest
from oracle import Watched

# Only Linux limits addresses, and tells the memory of another process.
ONLY_LINUX_TELLS = []
if sys.platform == "linux":
    ONLY_LINUX_TELLS = [
        ("reserves_memory", "memory", "MemoryError"),
        ("lets_a_child_touch_memory", "memory", "MB for 5 bytes"),
    ]


@pytest.fixture(scope="module")
def watched():
    with Watched(most_cpu_s=4.0, doors="bad_doors") as one:
        yield one


@pytest.fixture(scope="module")
def hurried():
    with Watched(most_cpu_s=0.5, doors="bad_doors") as one:
        yield one


@pytest.mark.parametrize(
    ("door", "words"), [("loops", "ended"), ("takes_long", "s of CPU")]
)
def test_what_takes_too_long_is_seen(hurried, door, words):
    verdict = hurried.enter(door, "a.txt", b"bytes")
    assert verdict.fault == "time", verdict
    assert words in verdict.told
    assert not hurried.enter("sound", "a.txt", b"bytes").fault


@pytest.mark.parametrize(
    ("door", "fault", "words"),
    [
        ("sound", "", ""),
        ("refuses", "", "input.txt"),
        ("raises", "traceback", "KeyError"),
        ("warns", "traceback", "RuntimeWarning"),
        ("exits", "end", "SystemExit"),
        ("dies", "end", "code 7"),
        ("touches_memory", "memory", "MB for 5 bytes"),
        *ONLY_LINUX_TELLS,
        ("colours_its_error", "message", ""),
        ("prints_escapes", "message", "\\x1b"),
        ("breaks_its_error", "message", "more lines"),
        ("talks_on_and_on", "message", "characters"),
        ("names_no_file", "message", "no file named"),
        ("writes_outside", "outside", "written.txt"),
        ("starts_a_program", "outside", "subprocess"),
        ("connects", "outside", "socket.connect"),
        ("loads_a_pickle", "outside", "pickle"),
        ("returns_nonsense", "result", "no finite time"),
    ],
)
def test_each_kind_of_fault_is_seen(watched, door, fault, words):
    verdict = watched.enter(door, "a.txt", b"bytes")
    assert verdict.fault == fault, verdict
    assert words in verdict.told, verdict


def test_a_fault_leaves_no_mark_on_the_next_input(watched):
    for bad in ("touches_memory", "raises", "dies"):
        watched.enter(bad, "a.txt", b"bytes")
        verdict = watched.enter("sound", "a.txt", b"bytes")
        assert not verdict.fault
        assert verdict.memory < 50e6


def test_a_large_input_may_take_ten_times_its_size(watched):
    assert not watched.enter("copies", "a.txt", bytes(20_000_000)).fault
