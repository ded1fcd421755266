"""The table of samples of a group: its rows, and the studies that they make."""

import os
import re
import time
from pathlib import Path

import pytest
import yaml

from hopdata.errors import ConfigError
from hopdata.samples import read_group

CONFIG = {
    "study": "jumps",
    "samples": "samples.tsv",
    "markers": {
        "body": ["body1", "body2", "body3"],
        "feet": ["foot1", "foot2", "foot3"],
    },
}


@pytest.fixture
def group(tmp_path, monkeypatch):
    """Return a function that writes a table of samples beside a configuration, and reads both."""
    monkeypatch.chdir(tmp_path)

    def read(table, **keys):
        Path("samples.tsv").write_text(table)
        Path("group.yaml").write_text(yaml.safe_dump(CONFIG | keys))
        return read_group("group.yaml")

    return read


def test_rows_of_a_subject_and_condition_are_one_study(group):
    read = group(
        "subject\tsession\tcondition\tfile\tmass\n"
        "anna\t1\tbare\ta.h5\t60\nanna\t2\tbare\tb.h5\t60\nanna\t1\tshod\tc.h5\t60\nben\t1\tbare\td.h5\t\n"
    )
    members = read["members"]
    assert list(members) == ["anna_bare", "anna_shod", "ben_bare"]
    assert members["anna_bare"]["config"]["recordings"] == [
        {"name": "1", "file": "a.h5"}, {"name": "2", "file": "b.h5"}
    ]  # fmt: skip
    assert members["anna_shod"]["further"] == {"mass": "60"}
    seeds = {member["config"]["seed"] for member in members.values()}
    assert len(seeds) == 3


def test_what_the_files_of_a_study_do_not_share_is_shown_of_each(group):
    table = "subject\tfile\tshoe\tmass\nanna\ta.h5\tred\t60\nanna\tb.h5\tblue\t60\n"
    further = group(table)["members"]["anna"]["further"]
    assert list(further.items()) == [("shoe", "red, blue"), ("mass", "60")]


def test_only_a_line_that_begins_with_a_hash_is_a_remark(group):
    table = "# runs\nsubject\tfile\tmass\t\nP#1\ta#2.h5\t60\t\n#P2\tb.h5\t\nP3\tc.h5\n"
    members = group(table)["members"].values()
    assert [member["subject"] for member in members] == ["P#1", "P3"]
    files = [member["config"]["recordings"][0]["file"] for member in members]
    assert files == ["a#2.h5", "c.h5"]
    assert [member["further"]["mass"] for member in members] == ["60", ""]


def test_a_subject_more_leaves_the_others_alone(group):
    few = group("subject\tfile\nanna\ta.h5\nben\tb.h5\n")["members"]
    more = group("subject\tfile\nzoe\tz.h5\nanna\ta.h5\nben\tb.h5\n")["members"]
    assert {name: more[name] for name in few} == few


def test_names_are_shown_as_written_and_made_safe_for_folders(group):
    table = "subject\tfile\tcondition\nJürgen B.\ta.h5\tslow run\nJürgen B.\tb.h5\tslow run\n"
    members = group(table + "2.1\tc.h5\tbare\n")["members"]
    assert list(members) == ["Jurgen-B-_slow-run", "2-1_bare"]
    first = members["Jurgen-B-_slow-run"]
    assert (first["subject"], first["condition"]) == ("Jürgen B.", "slow run")
    assert len(first["config"]["recordings"]) == 2


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (
            "subject\tpath\nanna\ta.h5\n",
            "columns subject, file, separated by tabs, found 1 rows of subject, path",
        ),
        ("subject\tfile\n", "found 0 rows"),
        ("# runs\n\nsubject\tfile\n\ta.h5\n", "line 4: subject: expected a name"),
        (
            "subject\tfile\nanna\n",
            "line 2: expected the 2 columns subject, file, separated by tabs",
        ),
        ("subject\tfile\nanna\ta.h5\tb.h5\n", "separated by tabs, found 3"),
        (
            "subject\tfile\nanna\ta.h5\nben\t./a.h5\n",
            "line 3: file: expected each file once",
        ),
        (
            "subject\tfile\nanna\ta.h5\nben\t\n",
            "line 3: file: expected a value in each row",
        ),
        (
            "subject\tcondition\tfile\nanna\t\ta.h5\nben\tshod\tb.h5\n",
            "line 2: condition: expected a value in each row",
        ),
        ("subject\tsubject\tfile\nanna\tben\ta.h5\n", "no column twice, and"),
        ("subject\tfile\nanna\ta.h5\nAnna\tb.h5\nben\tc.h5\n", "found 'anna', 'Anna'"),
        ("subject\tfile\nmüde\ta.h5\nben\tc.h5\nmude\tb.h5\n", "found 'müde', 'mude'"),
    ],
)
def test_a_wrong_table_is_refused(group, table, told):
    with pytest.raises(ConfigError, match=re.escape(told)):
        group(table)


def test_a_mistake_common_to_all_is_told_once_with_its_line(group):
    with pytest.raises(ConfigError, match=r"group\.yaml, line \d+: sections\.pre: "):
        group("subject\tfile\nanna\ta.h5\nben\tb.h5\n", sections={"pre": 1})


@pytest.mark.parametrize("n_characters", [131_072, 131_073])
def test_a_cell_that_is_too_long_is_refused_with_its_line(group, n_characters):
    table = f"subject\tfile\nanna\ta.h5\nben\t{'x' * n_characters}\n"
    if n_characters > 131_072:
        with pytest.raises(
            ConfigError, match=r"samples.tsv, line 3: expected cells of at most"
        ):
            group(table)
    else:
        assert list(group(table)["members"]) == ["anna", "ben"]


def test_a_table_that_asks_for_far_more_cells_than_it_has_is_refused(group):
    columns = "\t".join(f"c{i}" for i in range(10_000))
    rows = "".join(f"s{i}\tf{i}.h5\n" for i in range(1000))
    begin = time.process_time()
    with pytest.raises(ConfigError, match="at most 4,000,000 cells, found 10,002,000"):
        group(f"subject\tfile\t{columns}\n{rows}")
    assert time.process_time() - begin < 5


def test_a_table_with_more_rows_than_any_group_is_refused(group, monkeypatch):
    monkeypatch.setattr("hopdata.samples.MOST_ROWS", 2)
    group("subject\tfile\na\ta.h5\nb\tb.h5\n")
    with pytest.raises(ConfigError, match="at most 2 rows, found 3"):
        group("subject\tfile\na\ta.h5\nb\tb.h5\nc\tc.h5\n")


def test_an_endless_line_is_told_in_a_short_one(group):
    columns = "\t".join(f"c{i}" for i in range(100_000))
    with pytest.raises(ConfigError, match="99980 more") as caught:
        group(f"{columns}\n1\t2\n")
    assert len(str(caught.value)) < 500


def test_a_pipe_is_no_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("samples.tsv")
    Path("group.yaml").write_text(yaml.safe_dump(CONFIG))
    with pytest.raises(ConfigError, match=r"samples: samples\.tsv: .*found a pipe"):
        read_group("group.yaml")
