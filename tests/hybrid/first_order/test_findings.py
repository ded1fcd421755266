"""Findings and their table."""

from __future__ import annotations

import numpy as np

from hopdata.hybrid.first_order.findings import above, at_most, findings_table, not_computed


def test_bounds():
    assert at_most("a", 1.0, 1.0, "").passed
    assert not at_most("a", 1.1, 1.0, "").passed
    assert not above("a", 1.0, 1.0, "").passed
    assert above("a", 1.1, 1.0, "").passed
    assert not at_most("a", np.nan, 1.0, "").passed
    assert not above("a", np.nan, 1.0, "").passed
    assert not not_computed("a", "x", "why").passed


def test_columns_are_aligned():
    table = findings_table(
        [at_most("short", 0.123456, 1, "one"), not_computed("longer", "x", "two")]
    )
    assert table.split("\n") == [
        "     condition  found  needed  the number is",
        "yes  short      0.123  <= 1    one",
        "NO   longer     -      x       two",
    ]
