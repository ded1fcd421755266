"""The lines of the page on groups compute what the answer of a group holds."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hopdata.group import put_together
from hopdata.jobs import write_table
from hopdata.maps.verdict.group import Combined
from test_group import GROUP, made_up

PAGE = Path(__file__).parents[2] / "docs" / "group.md"
OF_GROUP = ("estimate", "low", "high", "upper_bound", "alone", "alone_p_value")


def conditions_of(number, shift):
    """Return rows of subjects in one or two conditions, with errors that differ."""
    rng = np.random.default_rng(number)
    rows = []
    for k, one in enumerate(made_up(number)):
        subject = f"s{k if k < 5 else k - 4}"
        errors = rng.uniform(0.01, 0.05, size=4)
        names = ("squared_error", "along_error", "allowed", "left")
        more = dict(zip(names, errors.tolist(), strict=True))
        moved = {"subject": subject, "condition": "ab"[k >= 5]}
        rows.append({**one, **more, **moved, "squared": one["squared"] + shift})
    return rows


def scope_of_the_lines(rows, tmp_path, monkeypatch):
    """Return what the lines of the page compute from the table of these rows."""
    table = tmp_path / "results/jumps/tables/group.csv"
    table.parent.mkdir(parents=True)
    write_table(table, pd.DataFrame(rows).drop(columns=["further", "quality"]))
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    scope = {}
    exec(compile(block, "docs/group.md", "exec"), scope)
    return scope


def require_same(ours, effect):
    for name in [item.name for item in fields(Combined)]:
        of_model = effect["combined"][name]
        assert ours["combined"][name] == pytest.approx(of_model, rel=1e-6), name
    for name in OF_GROUP:
        assert ours[name] == pytest.approx(effect[name], rel=1e-6), name


@pytest.mark.parametrize("shift", [0.0, -0.06])
def test_the_lines_compute_every_number_of_a_group(tmp_path, monkeypatch, shift):
    rows = [{**row, "condition": ""} for row in conditions_of(12, shift)]
    rows = [{**row, "subject": f"s{k}"} for k, row in enumerate(rows)]
    found = put_together(rows, GROUP)
    assert (found["effect"]["low"] > 0.0) == (shift == 0.0)
    assert found["by_condition"] == []
    scope = scope_of_the_lines(rows, tmp_path, monkeypatch)
    require_same(scope["effect"], found["effect"])


def test_the_lines_compute_every_number_of_each_condition(tmp_path, monkeypatch):
    """Subjects are in one condition or in both, so that not all are compared."""
    rows = conditions_of(12, 0.0)
    found = put_together(rows, GROUP)
    assert found["effect"] is None
    scope = scope_of_the_lines(rows, tmp_path, monkeypatch)
    assert [one["condition"] for one in found["by_condition"]] == ["a", "b"]
    for one in found["by_condition"]:
        require_same(scope["by_condition"][one["condition"]], one["effect"])
    (row,) = found["conditions"]
    ours = scope["conditions"]["a", "b"]
    for name, number in ours.items():
        assert row[name] == pytest.approx(number, rel=1e-6), name
    assert row["n"] < max(one["subjects"] for one in found["by_condition"])
