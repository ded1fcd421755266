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
        passed = bool(value <= bound)
        return cls(condition, passed, float(value), f"<= {bound:g}", detail)

    @classmethod
    def above(cls, condition: str, value: float, bound: float, detail: str) -> Finding:
        """Return a finding that passes if the value exceeds a bound."""
        passed = bool(value > bound)
        return cls(condition, passed, float(value), f"> {bound:g}", detail)

    def cells(self) -> tuple[str, ...]:
        """Return one row of a table."""
        passed = "yes" if self.passed else "NO"
        value = "-" if isnan(self.value) else f"{self.value:.3g}"
        return (passed, self.condition, value, self.needed, self.detail)

    @staticmethod
    def table(findings: Sequence[Finding]) -> str:
        """Return the findings as aligned lines."""
        head = ("", "condition", "found", "needed", "the number is")
        rows = [head, *(finding.cells() for finding in findings)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = []
        for row in rows:
            cells = [one.ljust(width) for one, width in zip(row, widths, strict=True)]
            lines.append("  ".join(cells).rstrip())
        return "\n".join(lines)
