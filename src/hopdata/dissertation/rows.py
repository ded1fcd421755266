"""What a part of the dissertation's page finds: rows, tables, and how they are stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


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
        The name of the sentence, among the item's ``reasons``, that says why they do not
        agree, or what else a reader should know; empty if there is nothing to say.
    """

    item: int
    agreement: Agreement
    values: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""


@dataclass(frozen=True)
class Made:
    """What a part has made: its rows, and the tables that its figures draw."""

    rows: Sequence[Row]
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
