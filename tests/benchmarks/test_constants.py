"""The page of constants is made from the code, and a changed constant is a changed module."""

import ast
from dataclasses import replace
from pathlib import Path

import constants
import pytest

SOURCE = '''"""A module."""

#: Largest share that may be missing.
#: Unit: 1. Origin: measured: by a benchmark | of ours.
MOST_MISSING = 0.2

#: Frames in a window, half of which lie before it.
#: Unit: frames. Origin: chosen.
FRAMES: int = 5
#: No number that steers anything.
OTHER = 3
TWICE = 2 * MOST_MISSING
'''


@pytest.fixture
def package(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "module.py").write_text(SOURCE)
    return tmp_path


def test_constants_are_read_from_the_comments_above_them(package):
    share, frames = constants.constants(package)
    assert (share.name, share.value, share.unit, share.origin) == (
        *("MOST_MISSING", "0.2", "1", "measured"),
    )
    assert share.why == "by a benchmark | of ours."
    assert share.decides == "Largest share that may be missing."
    assert (frames.unit, frames.origin, frames.why) == ("frames", "chosen", "")
    assert frames.room == "room"


@pytest.mark.parametrize(
    ("factor", "share", "frames"), [(1.5, 0.3, 8), (1 / 1.5, 0.4 / 3, 3)]
)
def test_one_constant_is_changed_and_no_other(package, factor, share, frames):
    both = list(constants.constants(package))
    values = {}
    for one in both:
        exec(constants.changed_source(SOURCE, one, factor), found := {})
        values[one.name] = found
    assert values["MOST_MISSING"]["MOST_MISSING"] == pytest.approx(share)
    assert values["MOST_MISSING"]["TWICE"] == pytest.approx(2 * share)
    assert values["MOST_MISSING"]["FRAMES"] == 5
    assert values["FRAMES"]["FRAMES"] == frames
    assert values["FRAMES"]["MOST_MISSING"] == 0.2


def test_a_row_escapes_what_would_end_a_cell(package):
    share = next(constants.constants(package))
    row = constants.table_row(share, [], {})
    assert "by a benchmark \\| of ours." in row
    assert row.endswith("| - |")


def test_what_a_constant_moves_is_told_beside_what_the_study_usually_says():
    usual = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    moved = constants.Moved(
        *("landings/a.py", "B", "x 1.5", "sample", "", "cannot tell"),
        *("0.0390", "0.2100", "1622", "+0.000", "-1.500", "0.1000", "2"),
    )
    said = constants.usual_of([usual, usual, moved])[constants.run_of(usual)]
    assert constants.moves(moved, said) == (
        "conclusion no difference to cannot tell, bound 0.1340 to 0.2100, "
        "post section -1.500 mm, 2 rows of quality, instants 0.1000 ms"
    )
    assert constants.moves(usual, said) == ""
    assert constants.is_large(moved, said)
    assert not constants.is_large(usual, said)


def test_what_a_study_says_is_that_of_the_run_of_its_room():
    """The verdict may have changed between the runs of two rooms."""
    before = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    after = replace(before, module="maps/b.py", bound="0.1251")
    usual = constants.usual_of([before, after])
    for row in (before, after):
        assert constants.moves(row, usual[constants.run_of(row)]) == ""


def test_the_page_tells_how_many_numbers_were_tried_in_which_study():
    one = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    rows = [one, replace(one, factor="/ 1.5"), replace(one, study="runner")]
    assert constants.numbers_tried(rows) == [
        "- Tried in `landings`: 1 in the sample, 0 in the control, 1 in the runner."
    ]


def test_the_page_tells_the_baseline_of_each_room():
    before = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    after = replace(before, module="maps/b.py", estimate="0.0333", bound="0.1251")
    runner = replace(before, study="runner", estimate="", bound="", n_used="39")
    rows = constants.baselines(constants.usual_of([before, after, runner]))[-3:]
    assert rows == [
        "| `landings` | runner | 39 | none | none |",
        "| `landings` | sample | 1622 | 0.0390 | 0.1340 |",
        "| `maps` | sample | 1622 | 0.0333 | 0.1251 |",
    ]


@pytest.mark.parametrize(
    ("column", "small", "large"),
    [
        ("n_used", "1610", "1600"),
        ("estimate", "0.0450", "0.0460"),
        ("bound", "0.1400", "0.1410"),
        ("post_mm", "-1.900", "-2.100"),
        ("instants_ms", "0.0900", "0.1100"),
    ],
)
def test_what_no_reader_would_see_is_not_large(column, small, large):
    usual = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    said = constants.usual_of([usual])[constants.run_of(usual)]
    assert not constants.is_large(replace(usual, **{column: small}), said)
    assert constants.is_large(replace(usual, **{column: large}), said)


def test_every_origin_is_of_a_known_kind():
    for one in constants.constants():
        assert one.origin in constants.ORIGINS, (one.module, one.name, one.origin)


def test_the_page_is_what_the_code_says():
    assert constants.PAGE.read_text("utf-8") == constants.page()


def test_numbers_of_the_detectors_and_the_verdict_state_their_origin():
    """A number in capitals, in a room that a study reaches, has unit and origin."""
    stated = {(one.module, one.name) for one in constants.constants()}
    for room in constants.STUDIED:
        for path in sorted((constants.PACKAGE / room).rglob("*.py")):
            module = str(path.relative_to(constants.PACKAGE))
            for name in numbers_of(path):
                assert (module, name) in stated, f"{module}: {name}"


def numbers_of(path: Path):
    """Yield the names in capitals to which a module assigns a number with a fraction."""
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
            target = node.targets[0]
            if isinstance(target, ast.Name) and isinstance(node.value.value, float):
                yield target.id


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(0.2, 4)", (0.3, 6)),
        ("1e-3", 1.5e-3),
        ("2**4", 24),
        ("1", 2),
        ("2.0 * 3", 9.0),
    ],
)
def test_whole_numbers_stay_whole_and_tuples_are_scaled_one_by_one(text, expected):
    value = ast.parse(text, mode="eval").body
    found = eval(constants.scaled(value, text, 1.5))
    assert found == pytest.approx(expected)
    assert type(found) is type(expected)


def test_quantiles_keep_within_0_and_1():
    source = (
        SOURCE
        + """
#: Lowest and highest of what is looked at.
#: Unit: 1. Origin: chosen.
RANGE_QUANTILES = (0.02, 0.98)
"""
    )
    one = constants.Constant("a.py", "RANGE_QUANTILES", 0, "", "", "1", "chosen", "")
    exec(constants.changed_source(source, one, 1.5), found := {})
    assert found["RANGE_QUANTILES"] == pytest.approx((0.03, 0.97))


def test_constants_of_a_module_are_changed_together(package):
    exec(
        constants.changed_source(SOURCE, list(constants.constants(package)), 1.5),
        found := {},
    )
    assert found["MOST_MISSING"] == pytest.approx(0.3)
    assert found["FRAMES"] == 8
    assert found["OTHER"] == 3


@pytest.fixture
def trials(package, tmp_path, monkeypatch):
    """Studies whose answer is a share of the module; yield the constants tried alone."""
    monkeypatch.setattr(constants, "PACKAGE", package)
    monkeypatch.setattr(constants, "TABLE", tmp_path / "constants.csv")
    tried = []

    def changed_study(module, changed, trial):
        tried.append([one.name for one in changed])
        moved = "MOST_MISSING" in tried[-1] and trial.study == "moved"
        return constants.difference(study(0.3 if moved else 0.2), trial.before)

    monkeypatch.setattr(constants, "changed_study", changed_study)
    return tried


def study(bound):
    return {
        **{"pre_m": 0.5, "post_m": 0.3, "n_used": 10, "instants_s": [[0.1, 0.2]]},
        **{"conclusion": "different", "estimate": 0.4, "bound": bound, "quality": []},
    }


def test_constants_that_move_nothing_together_are_not_tried_alone(package, trials):
    both = list(constants.constants(package))
    for name in ("still", "moved", "still"):
        trial = constants.Trial(name, "x 1.5", 1.5, study(0.2))
        constants.try_module("room/module.py", both, trial)
    together = ["MOST_MISSING", "FRAMES"]
    assert trials == [together, together, ["MOST_MISSING"], ["FRAMES"]]
    bounds = {(row.study, row.name): row.bound for row in constants.known_rows()}
    assert bounds == {
        ("still", "MOST_MISSING"): "0.2000",
        ("still", "FRAMES"): "0.2000",
        ("moved", "MOST_MISSING"): "0.3000",
        ("moved", "FRAMES"): "0.2000",
    }


def test_a_value_with_which_no_study_runs_moves_nothing():
    usual = constants.Moved(
        *("landings/a.py", "A", "x 1.5", "sample", "", "no difference"),
        *("0.0390", "0.1340", "1622", "+0.000", "+0.000", "0.0000", "0"),
    )
    words = "ValueError: Quantiles must be in [0, 1]"
    ended = replace(usual, name="B", conclusion=words)
    ended = replace(ended, estimate="", bound="", n_used="", quality="")
    rows = [usual, usual, ended]
    said = constants.usual_of(rows)[constants.run_of(usual)]
    assert not constants.is_large(ended, said)
    assert constants.moves(ended, said) == ""
    assert not constants.is_impossible(usual)
    assert constants.impossible_values([usual]) == []
    table = constants.impossible_values(rows)
    assert "| `B` (landings/a.py) | sample x 1.5: ValueError: Quantiles" in table[-2]
    page = constants.summary(rows)
    assert any(line.startswith("Of 2 numbers that were tried, 2 move") for line in page)
