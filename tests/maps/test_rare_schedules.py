"""Schedules with too few landings are named while they are few, and counted where they are many."""

from hopdata.maps.rare_schedules import MOST_ONE_BY_ONE, rare_notes


def test_a_few_are_named():
    sizes = {f"{k}": 10 + k for k in range(MOST_ONE_BY_ONE)}
    notes = rare_notes("subspaces", sizes, "30 wanted")
    assert [note["what"] for note in notes] == [f"subspaces of schedule {name}" for name in sizes]
    assert notes[1]["reason"] == "11 touchdowns, 30 wanted"
    assert rare_notes("subspaces", {}, "30 wanted") == []


def test_many_are_counted():
    sizes = {f"{k}": 1 + k % 3 for k in range(300)}
    assert rare_notes("specialised models", sizes, "at least 40 wanted") == [
        {
            "what": "specialised models of 300 schedules",
            "reason": "1 to 3 touchdowns each, 600 in all, at least 40 wanted",
        }
    ]
