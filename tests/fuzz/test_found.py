"""Inputs that once broke a promise: each is tried again."""

import pytest
from doors import DOORS
from long_run import FOUND, LIST, known
from oracle import Watched

ROWS = known()


@pytest.fixture(scope="module")
def watched():
    with Watched() as one:
        yield one


@pytest.mark.parametrize("row", ROWS, ids=[row["file"] for row in ROWS])
def test_what_was_found_once_does_no_harm_any_more(watched, row):
    name = row["file"].split("-", 2)[2]
    verdict = watched.enter(row["door"], name, (FOUND / row["file"]).read_bytes())
    assert not verdict.fault, verdict


def test_every_input_that_is_kept_is_listed():
    listed = [row["file"] for row in ROWS]
    assert len(set(listed)) == len(listed)
    kept = {one.name for one in FOUND.iterdir()} - {LIST.name}
    assert kept == set(listed)
    assert {row["door"] for row in ROWS} <= set(DOORS)
