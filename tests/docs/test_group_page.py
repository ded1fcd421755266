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


@pytest.mark.parametrize("shift", [0.0, -0.06])
def test_the_lines_compute_every_number_of_the_group(tmp_path, monkeypatch, shift):
    rows = conditions_of(12, shift)
    effect = put_together(rows, GROUP)["effect"]
    table = tmp_path / "results/jumps/tables/group.csv"
    table.parent.mkdir(parents=True)
    write_table(table, pd.DataFrame(rows).drop(columns=["further", "quality"]))
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    scope = {}
    exec(compile(block, "docs/group.md", "exec"), scope)

    of_model = [item.name for item in fields(Combined)]
    for name in of_model:
        assert scope[name] == pytest.approx(effect["combined"][name], rel=1e-6), name
    for name in OF_GROUP:
        assert scope[name] == pytest.approx(effect[name], rel=1e-6), name
    assert (effect["low"] > 0.0) == (shift == 0.0)
