"""What `tests/mutants.py` changes, what it tries again, and what it calls missed."""

from dataclasses import replace
from pathlib import Path

import pytest

from mutants import (
    Running,
    Tried,
    candidates,
    is_known,
    paths_of_tests,
    report,
    what_noticed,
)

MODULE = '''"""A module of 1 function."""

LIMIT = 3


def clipped(value: int | None, least: int = 0) -> int:
    """Return a value, or fail."""
    allowed: int = LIMIT + 1
    if value is None or value > allowed:
        raise ValueError(f"expected {1 + 1}, found {value - 1}")
    logger.info("found %s", value + 2)
    return value
'''
SURVIVOR = Tried(
    room="maps",
    module="maps/affine.py",
    operator="core/AddNot",
    occurrence=2,
    line=7,
    digest="module",
    tests="tests",
    outcome="survived",
    noticed="",
    seconds=1.0,
    change="-    if a < b:\n+    if a <= b:",
)
KILLED = replace(
    SURVIVOR, occurrence=3, outcome="killed", noticed="test_affine.py::test_a"
)


def place_of(text):
    """Return line and column at which a text stands in the module."""
    before = MODULE.partition(text)[0]
    return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1)


@pytest.mark.parametrize("text", ["+ 1\n", "is None or", "> allowed"])
def test_what_a_function_computes_is_changed(text):
    assert place_of(text) in Running(MODULE)


@pytest.mark.parametrize(
    "text",
    ["3\n", "| None", "0) ->", "int = LIMIT", "1 + 1", "- 1}", "+ 2)"],
)
def test_annotations_and_what_is_only_said_are_not_changed(text):
    assert place_of(text) not in Running(MODULE)


def test_a_result_holds_while_module_and_tests_are_the_same():
    again = replace(SURVIVOR, tests="new")
    shown = {(SURVIVOR.module, SURVIVOR.change)}
    assert is_known(SURVIVOR, [SURVIVOR], set())
    assert is_known(KILLED, [KILLED], set())
    # After new tests only a survivor that changes a result is tried again.
    assert not is_known(again, [SURVIVOR], set())
    assert is_known(again, [SURVIVOR], shown)
    assert is_known(replace(KILLED, tests="new"), [KILLED], set())
    # A new module may have something else at this place.
    assert not is_known(replace(KILLED, digest="new"), [KILLED], set())
    assert not is_known(replace(KILLED, occurrence=9), [KILLED], set())


def test_a_survivor_is_missed_unless_its_change_is_known_to_be_equivalent(capsys):
    other = replace(SURVIVOR, occurrence=4, change="-    a\n+    b")
    shown = {(SURVIVOR.module, SURVIVOR.change)}
    assert report([SURVIVOR, KILLED, other], shown) == [other]
    table, _, listed = capsys.readouterr().out.partition("\n\n")
    assert table.splitlines()[1].split() == ["maps", "3", "1", "1", "1"]
    assert other.change in listed
    assert SURVIVOR.change not in listed
    assert report([KILLED], set()) == []
    # The same change in another module is another change.
    elsewhere = replace(SURVIVOR, module="maps/units.py")
    assert report([elsewhere], shown) == [elsewhere]


def test_the_failed_test_is_named():
    output = "F.\nFAILED tests/maps/test_units.py::test_it - assert 1 == 2\n1 failed"
    assert what_noticed(output) == "tests/maps/test_units.py::test_it"
    assert what_noticed("timeout") == "timeout"


def test_changes_and_tests_of_a_module(tmp_path):
    pytest.importorskip("cosmic_ray")
    package = tmp_path / "src" / "hopdata" / "maps" / "verdict"
    package.mkdir(parents=True)
    (package / "judge.py").write_text(MODULE, encoding="utf-8")
    folder = tmp_path / "tests" / "maps" / "verdict"
    folder.mkdir(parents=True)
    for name in ("test_group.py", "test_judge.py"):
        (folder / name).write_text("", encoding="utf-8")

    found = list(candidates("verdict", tmp_path))
    assert {one.module for one in found} == {"maps/verdict/judge.py"}
    assert {(one.operator, one.line) for one in found} == {
        ("core/ReplaceBinaryOperator_Add_Sub", 8),
        ("core/NumberReplacer", 8),
        ("core/ReplaceComparisonOperator_Gt_GtE", 9),
        ("core/ReplaceComparisonOperator_Gt_Lt", 9),
        ("core/ReplaceOrWithAnd", 9),
        ("core/AddNot", 9),
    }
    # A room does not hold what belongs to a room inside it.
    assert list(candidates("maps", tmp_path)) == []

    module = Path("maps/verdict/judge.py")
    own, others = paths_of_tests(module, tmp_path)
    assert [path.name for path in own] == ["test_judge.py"]
    assert [path.name for path in others] == ["test_group.py"]
    # Without tests of its own, those of `judge` are the nearest.
    own, others = paths_of_tests(Path("maps/verdict/judge_limits.py"), tmp_path)
    assert own == []
    assert [path.name for path in others] == ["test_judge.py", "test_group.py"]


def test_tests_of_the_integrator_on_scenes_belong_to_its_modules(tmp_path):
    for folder in ("tests/hybrid/driver", "tests/scenes/hybrid"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "test_sleep.py").write_text("", encoding="utf-8")
    own, others = paths_of_tests(Path("hybrid/driver/sleep.py"), tmp_path)
    assert [path.parent.name for path in own] == ["driver", "hybrid"]
    assert others == []
