"""One condition of a checklist: the value found, the value needed, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan


@dataclass(frozen=True)
class Finding:
    """One condition: the value found and the value needed.

    Parameters
    ----------
    condition : str
        The condition.
    passed : bool
        Whether it holds.
    value : float
        Value found; NaN if it could not be computed.
    needed : str
        Required value.
    detail : str
        Meaning of the value.
    """

    condition: str
    passed: bool
    value: float
    needed: str
    detail: str

    @classmethod
    def at_most(
        cls, condition: str, value: float, bound: float, detail: str
    ) -> Finding:
        """Return a finding that passes if the value does not exceed a bound."""
        return cls(
            condition, bool(value <= bound), float(value), f"<= {bound:g}", detail
        )

    @classmethod
    def above(cls, condition: str, value: float, bound: float, detail: str) -> Finding:
        """Return a finding that passes if the value exceeds a bound."""
        return cls(condition, bool(value > bound), float(value), f"> {bound:g}", detail)

    def cells(self) -> tuple[str, ...]:
        """Return one row of a table."""
        value = "-" if isnan(self.value) else f"{self.value:.3g}"
        return (
            "yes" if self.passed else "NO",
            self.condition,
            value,
            self.needed,
            self.detail,
        )

    @staticmethod
    def table(findings: Sequence[Finding]) -> str:
        """Return the findings as aligned lines."""
        head = "", "condition", "found", "needed", "the number is"
        rows = [head, *(finding.cells() for finding in findings)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = (
            "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True))
            for row in rows
        )
        return "\n".join(line.rstrip() for line in lines)
