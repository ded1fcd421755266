import logging
import sys

import pandas as pd
import pytest
from made_up import SOUND, install

from hopdata.dissertation.making import (
    Failure,
    make_part,
    read_record,
    seeds_of,
)
from hopdata.jobs import read_table


def made(monkeypatch, folder, text):
    install(monkeypatch, "made_up", text)
    return make_part("made_up", folder, [3, 4], formats=["svg"])


def test_a_part_leaves_rows_tables_and_figures(tmp_path, monkeypatch):
    record = made(monkeypatch, tmp_path, SOUND)
    assert read_record(tmp_path) == record
    assert [row.item for row in record.rows] == [1, 32, 93]
    assert record.rows[2].values["slope"] == [5.0, 4.0]
    assert record.seeds == [3, 4]
    assert record.failure is None
    assert record.figures == ["fig4_2_order"]
    assert (tmp_path / "figures/fig4_2_order.svg").stat().st_size > 2000
    assert len(read_table(tmp_path / "tables/order.csv")) == 2


def test_the_same_part_leaves_the_same_bytes(tmp_path, monkeypatch):
    for name in "ab":
        made(monkeypatch, tmp_path / name, SOUND)
    for file in ("rows.json", "figures/fig4_2_order.svg", "tables/order.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (
            tmp_path / "b" / file
        ).read_bytes()


def test_what_an_earlier_run_left_is_removed(tmp_path, monkeypatch):
    made(monkeypatch, tmp_path, SOUND)
    record = made(monkeypatch, tmp_path, "def make(seeds): raise ValueError('no')")
    assert record.figures == []
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == [
        "rows.json"
    ]


@pytest.mark.parametrize(
    ("text", "why", "what_to_do"),
    [
        (
            "from hopdata.errors import AnalysisError\n"
            "def make(seeds): raise AnalysisError('3 landings are too few')",
            "3 landings are too few",
            "",
        ),
        (
            "def make(seeds): raise ModuleNotFoundError('x', name='mujoco.viewer')",
            "mujoco is not installed",
            "make dissertation, or pip install 'hopdata[dissertation]'",
        ),
        (
            "def make(seeds): return 1 / 0",
            "ZeroDivisionError: division by zero",
            "python -m hopdata.dissertation made_up shows more",
        ),
        (
            "from hopdata.dissertation.rows import over_seeds\n"
            "def make(seeds): return over_seeds([7, 7, 7, 7].__getitem__, seeds)",
            "IndexError: list index out of range with the seed 4",
            "python -m hopdata.dissertation made_up shows more",
        ),
    ],
)
def test_a_part_that_fails_says_why_and_what_to_do(
    tmp_path, monkeypatch, text, why, what_to_do
):
    record = made(monkeypatch, tmp_path, text)
    assert record.failure == Failure(why, what_to_do)
    assert record.rows == []
    assert read_record(tmp_path) == record


def test_a_part_that_is_not_there_is_a_failure(tmp_path):
    record = make_part("no_such_part", tmp_path, [1])
    assert "no_such_part" in record.failure.why


def test_the_traceback_of_an_unforeseen_error_is_logged(tmp_path, monkeypatch, caplog):
    with caplog.at_level(logging.ERROR):
        made(monkeypatch, tmp_path, "def make(seeds): return 1 / 0")
    assert "Traceback" in caplog.text


def test_a_row_that_cannot_be_kept_leaves_the_others(tmp_path, monkeypatch):
    text = SOUND.replace("3e-16", "float('nan')")
    record = made(monkeypatch, tmp_path, text)
    assert [row.item for row in record.rows] == [32, 93]
    assert "row 1, error" in record.failed_rows[1].why
    assert read_record(tmp_path) == record


def test_figures_that_cannot_be_drawn_leave_the_rows(tmp_path, monkeypatch):
    text = SOUND + "\ndef draw(tables): raise KeyError('step')"
    record = made(monkeypatch, tmp_path, text)
    assert len(record.rows) == 3
    assert record.failed_figures[""].why == "KeyError: 'step'"
    text = SOUND.replace('{"fig4_2_order": figure}', '{"good": figure, "bad": None}')
    record = made(monkeypatch, tmp_path, text)
    assert record.figures == ["good"]
    assert "bad: expected a figure" in record.failed_figures["bad"].why
    assert read_record(tmp_path) == record


def test_figures_are_drawn_from_the_tables_as_they_are_read_again(
    tmp_path, monkeypatch
):
    text = SOUND.replace("[1.0, 2.0]", "[1 / 3, 2.0]") + (
        "\nSEEN = []\nold = draw\n"
        "def draw(tables):\n    SEEN.append(tables['order'])\n    return old(tables)"
    )
    install(monkeypatch, "made_up", text)
    make_part("made_up", tmp_path, [3], formats=["svg"])
    seen = sys.modules["hopdata.dissertation.parts.made_up"].SEEN[0]
    pd.testing.assert_frame_equal(seen, read_table(tmp_path / "tables/order.csv"))
    assert seen["step"].iloc[0] != 1 / 3


def test_more_repetitions_keep_the_seeds_that_were_there():
    assert seeds_of(1, 5)[:3] == seeds_of(1, 3)
    assert len(set(seeds_of(1, 5))) == 5
    assert seeds_of(2, 3) != seeds_of(1, 3)


def test_a_failure_is_told_in_a_line():
    assert str(Failure("no data")) == "no data"
    assert str(Failure("no data", "record some")) == "no data; record some"
