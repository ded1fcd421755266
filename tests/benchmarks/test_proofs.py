"""The comparison of guards: what peers lose is counted, and a run goes on."""

import sys

import numpy as np
import pandas as pd
import proofs
import pytest

MEMBER = ([1.0, 0.0], [0.5, 0.2], 7.0)  # the roots of (x - 0.5)(x - 0.7) on a circle
ROOTS = np.sort([np.arccos(x) for x in (0.5, 0.7)])
ALL = np.concatenate([ROOTS, 2.0 * np.pi - ROOTS[::-1]])


def circle(t):
    return np.array([np.cos(t), np.sin(t)])


@pytest.mark.parametrize(
    ("events", "missed", "spurious"),
    [
        (ALL, 0, 0),
        (ALL[2:], 2, 0),
        (ALL[:3], 1, 0),
        (np.concatenate([ALL, [1.5, 2.0]]), 0, 2),
    ],
    ids=["all", "two lost", "the last lost", "two too many"],
)
def test_events_of_a_peer_are_compared_with_its_path(events, missed, spurious):
    seen = proofs.Seen(np.asarray(events), circle, 0.0)
    assert proofs.compared("near roots", MEMBER, seen) == (missed, spurious, 0)


def test_scipy_loses_what_lies_within_a_step():
    row = proofs.peer_row("SciPy", "box 0.01", 1e-6, 3, 0)
    assert row["missed"] > 0
    assert row["failed"] == 0
    smooth = proofs.peer_row("SciPy", "foot", 1e-9, 3, 0)
    assert (smooth["missed"], smooth["spurious"]) == (0, 0)
    assert smooth["events"] > 0


def test_a_run_goes_on_where_it_was(tmp_path, monkeypatch, capsys):
    out = tmp_path / "proofs.csv"
    command = ["proofs.py", "--out", str(out), "--members", "1", "--families", "foot"]
    monkeypatch.setattr(sys, "argv", [*command, "--rtols", "1e-6"])
    proofs.main()
    first = out.read_bytes()
    assert capsys.readouterr().out
    proofs.main()
    assert out.read_bytes() == first
    assert not capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", [*command, "--rtols", "1e-6", "1e-3", "--peers"])
    proofs.main()
    table = pd.read_csv(out)
    assert len(table) == 6
    assert (table["solver"] == "hopdata").sum() == 2
    ours = table[table["solver"] == "hopdata"]
    assert (ours[["missed", "spurious", "unproven"]] == 0).all(axis=None)
