"""Findings of a check, and the table that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan


@dataclass(frozen=True)
class Finding:
    """One condition: what was found, and what is needed.

    Parameters
    ----------
    condition : str
        What should hold.
    passed : bool
        Whether it does.
    value : float
        What was found; NaN if it could not be computed.
    needed : str
        What the value has to be.
    detail : str
        What the value is.
    """

    condition: str
    passed: bool
    value: float
    needed: str
    detail: str

    def cells(self) -> tuple[str, ...]:
        """Return the row of a table."""
        value = "-" if isnan(self.value) else f"{self.value:.3g}"
        return ("yes" if self.passed else "NO", self.condition, value, self.needed, self.detail)


def at_most(condition: str, value: float, bound: float, detail: str) -> Finding:
    """Return a finding that passes if the value is not above a bound."""
    return Finding(condition, bool(value <= bound), float(value), f"<= {bound:g}", detail)


def above(condition: str, value: float, bound: float, detail: str) -> Finding:
    """Return a finding that passes if the value is above a bound."""
    return Finding(condition, bool(value > bound), float(value), f"> {bound:g}", detail)


def not_computed(condition: str, needed: str, why: str) -> Finding:
    """Return a finding that fails since there is nothing to compute."""
    return Finding(condition, False, float("nan"), needed, why)


def findings_table(findings: Sequence[Finding]) -> str:
    """Return findings as aligned lines."""
    rows = [("", "condition", "found", "needed", "the number is"), *(f.cells() for f in findings)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)
