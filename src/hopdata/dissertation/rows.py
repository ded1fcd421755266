"""What a part of the dissertation's page finds: its rows, and the tables it draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

from hopdata.errors import AnalysisError

if TYPE_CHECKING:
    import pandas as pd

Measured = TypeVar("Measured")


class Agreement(StrEnum):
    """Whether what is found here agrees with what the dissertation prints."""

    AGREES = "agrees"
    #: Some of the item's claims or numbers agree.
    PARTLY = "partly"
    DIFFERS = "differs"
    #: The text makes a definition or an algorithm, not a claim: it is built and runs.
    BUILT = "built"


@dataclass(frozen=True)
class Row:
    """One item of the dissertation, as it is found here.

    Attributes
    ----------
    item
        Its number, 1 to 100.
    agreement
        Whether print and result agree.
    values
        The numbers that the item's sentences ask for, by name, in the unit that the
        sentence states. A sequence is one number a seed; it is shown as its median and
        range.
    reason
        The name of the sentence, among the item's ``reasons``, that says why they do
        not agree, or what else a reader should know; empty if there is nothing to say.
    """

    item: int
    agreement: Agreement
    values: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the row for JSON.

        Raises
        ------
        AnalysisError
            If a value is neither a text nor a finite number, nor a sequence of these.
        """
        values = {}
        for name, value in self.values.items():
            values[name] = _plain(f"row {self.item}, {name}", value)
        return {
            "item": self.item,
            "agreement": str(self.agreement),
            "values": values,
            "reason": self.reason,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Row:
        """Return the row of which `to_dict` made `content`."""
        return cls(
            content["item"],
            Agreement(content["agreement"]),
            content["values"],
            content["reason"],
        )


@dataclass(frozen=True)
class Made:
    """What a part has made: its rows, and the tables that its figures draw."""

    rows: Sequence[Row]
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)


def over_seeds(
    measure: Callable[[int], Measured], seeds: Sequence[int]
) -> list[Measured]:
    """Measure once with each seed; an error names the seed with which it came."""
    found = []
    for seed in seeds:
        try:
            found.append(measure(seed))
        except Exception as error:
            error.add_note(f"with the seed {seed}")
            raise
    return found


def _plain(place: str, value: Any) -> Any:
    """Return a value as JSON knows it: numbers of NumPy become Python's."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise AnalysisError.at(place, "a finite number", value)
        return value
    if isinstance(value, Sequence):
        return [_plain(place, one) for one in value]
    wanted = "a number, a text, or a sequence of these"
    raise AnalysisError.at(place, wanted, f"a {type(value).__name__}")
