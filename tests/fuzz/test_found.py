"""Inputs that once broke a promise: each is tried again."""

from doors import DOORS
from long_run import FOUND, LIST, known
from oracle import Watched

ROWS = known()


def test_what_was_found_once_does_no_harm_any_more():
    assert ROWS
    with Watched() as watched:
        for row in ROWS:
            name = row["file"].split("-", 2)[2]
            data = (FOUND / row["file"]).read_bytes()
            verdict = watched.enter(row["door"], name, data)
            assert not verdict.fault, f"{row['file']}: {verdict}"


def test_every_input_that_is_kept_is_listed():
    listed = [row["file"] for row in ROWS]
    assert len(set(listed)) == len(listed)
    kept = {one.name for one in FOUND.iterdir()} - {LIST.name}
    assert kept == set(listed)
    assert {row["door"] for row in ROWS} <= set(DOORS)
