"""The standing corpus: each file gives what its row of corpus.csv says."""

from functools import cache

import pytest
from corpus import READ, TABLE, cases, row_of, stored

ROWS = {(row["program"], row["habit"]): row for row in stored().to_dict("records")}
MOST_REFUSED = 0.02


@cache
def every_case():
    return {(case.program, case.habit): case for case in cases()}


def test_each_row_of_the_table_has_a_case_and_each_case_a_row():
    assert list(ROWS) == list(every_case())
    assert len(ROWS) > 150


@pytest.mark.parametrize("key", ROWS, ids=": ".join)
def test_a_file_gives_what_its_row_says(key, tmp_path):
    found = row_of(every_case()[key], tmp_path)
    kept = ROWS[key]
    moved = [
        f"{column}: {kept[column] or 'nothing'} -> {found[column] or 'nothing'}"
        for column in found
        if found[column] != kept[column]
    ]
    how = f"if that is meant: python tests/recordings/corpus.py --write ({TABLE.name})"
    assert not moved, "\n".join([": ".join(key), *moved, how])


def test_what_a_careful_person_would_refuse_is_refused_and_little_else():
    readable = [row for row in ROWS.values() if row["file"] == READ]
    refused = [row for row in readable if row["found_file"] != READ]
    assert len(refused) <= MOST_REFUSED * len(readable)
    others = [row for row in ROWS.values() if row["file"] != READ]
    assert len(others) > 20
    assert not [row["habit"] for row in others if row["found_file"] == READ]


def test_all_positions_are_right():
    compared = [row for row in ROWS.values() if row["found_positions"]]
    assert len(compared) > 120
    assert not [row["habit"] for row in compared if row["found_positions"] != "right"]
