"""`python -m hopdata.dissertation NAME`, by which a part is made alone."""

import pytest
from made_up import SOUND, SOUND_ITEMS, install

from hopdata.dissertation import items
from hopdata.dissertation.__main__ import main
from hopdata.dissertation.making import BUNDLED, read_record, seeds_of


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "made_up.toml").write_text(SOUND_ITEMS)
    monkeypatch.setattr(items.read_part, "__defaults__", (tmp_path,))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_part_is_made_and_its_rows_are_told(folder, monkeypatch, capsys):
    install(monkeypatch, "made_up", SOUND)
    options = ["--seeds", "2", "--seed", "7", "--formats", "svg"]
    assert main(["made_up", *options]) == 0
    record = read_record(folder / "results/dissertation/parts/made_up")
    assert record.seeds == seeds_of(7, 2)
    told = capsys.readouterr().out
    assert "93 Order of the method (Sec. 4.4.2)" in told
    assert "  printed method: slope 4.20" in told
    assert "  ≠ differs: the printed fit takes 4 of 37 points" in told
    assert "figure fig4_2_order" in told


def test_what_cannot_be_made_is_the_exit_code(folder, monkeypatch, capsys):
    install(monkeypatch, "made_up", "def make(seeds): raise ValueError('no')")
    assert main(["made_up", "--out", "here"]) == 1
    assert read_record(folder / "here").failure.why == "ValueError: no"
    said = capsys.readouterr()
    assert "hopdata: made_up (items 1, 32, 93): cannot be made" in said.err
    assert "! cannot be made: ValueError: no" in said.out


def test_a_part_that_does_not_exist_is_told_in_a_line(folder, capsys):
    assert main(["no_such_part", "--out", "here"]) == 1
    (told,) = [
        line for line in capsys.readouterr().err.splitlines() if line[:7] == "hopdata"
    ]
    assert told.startswith("hopdata: no_such_part (no item): cannot be made: Module")


def test_parts_run_where_the_bundled_files_are(folder, monkeypatch):
    text = SOUND.replace(
        "def make(seeds):", "def make(seeds):\n    open('config/config.yaml').close()"
    )
    install(monkeypatch, "made_up", text)
    assert main(["made_up", "--out", "here", "--quiet"]) == 0
    assert read_record(folder / "here").failure is None
    assert (BUNDLED / "data/sample/hopper.h5").is_file()
