"""Spans of a recording whose frames count as unseen, as its user asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import pd
from hopdata.errors import ArgumentError
from hopdata.messages import Message
from hopdata.recording import Recording

Given = Sequence[Any] | Mapping[str, Any]


@dataclass(frozen=True)
class ExcludedSpan:
    """Frames that count as unseen, in the words of ``recordings[].exclude``.

    Parameters
    ----------
    from_s, to_s : float
        Begin and end on the clock of the recording, s; frames at both are in it.
    reason : str
        Why, in the user's words; may be empty.
    """

    from_s: float
    to_s: float
    reason: str = ""

    def __str__(self) -> str:
        told = f"{self.from_s:g} to {self.to_s:g} s"
        return f"{told} ({self.reason})" if self.reason else told


def excluded_spans(given: Sequence[Given]) -> list[ExcludedSpan]:
    """Return spans given as begin, end and perhaps a reason, or by the names of these.

    Raises
    ------
    ArgumentError
        If one is no span.
    """
    return [_span(one) for one in given]


def without_spans(
    recording: Recording, spans: Sequence[ExcludedSpan]
) -> tuple[Recording, list[Message]]:
    """Return a recording in which the frames of some spans count as unseen.

    Parameters
    ----------
    recording : Recording
        It stays as it is.
    spans : sequence of ExcludedSpan

    Returns
    -------
    recording : Recording
    remarks : list of Message
        Which spans were left out, and why.

    Raises
    ------
    ArgumentError
        If a span holds no frame of the recording.
    """
    if not len(spans):
        return recording, []
    positions = recording.positions.copy()
    for span in spans:
        inside = (recording.time >= span.from_s) & (recording.time <= span.to_s)
        if not inside.any():
            first_s, last_s = recording.time[[0, -1]]
            wanted = f"spans with frames of {recording.name}, {first_s:g} to {last_s:g}"
            found = f"{span.from_s:g} to {span.to_s:g} s"
            raise ArgumentError.at("exclude", f"{wanted} s", found)
        positions[inside] = np.nan
    values = {
        "recording": recording.name,
        "spans": ", ".join(map(str, spans)),
        "all_have_reasons": all(span.reason for span in spans),
    }
    remark = Message("landings.spans_excluded", values)
    return replace(recording, positions=positions), [remark]


def with_reasons(
    table: pd.DataFrame, orders: pd.DataFrame, spans: Sequence[ExcludedSpan]
) -> pd.DataFrame:
    """Return the table of contacts, in which hidden feet have the reasons of the spans.

    Parameters
    ----------
    table, orders : DataFrame
        As of `hopdata.contact_times.ContactTimes`.
    spans : sequence of ExcludedSpan
        A foot that is hidden in a landing which meets one of them has its reason.
    """
    hidden = str(Message("landings.contact_hidden"))
    keys = ["recording", "landing"]
    bounds = table[keys].merge(orders, on=keys, how="left")
    remark = table["remark"].copy()
    for span in spans:
        meets = (bounds["begin_s"] <= span.to_s) & (bounds["end_s"] >= span.from_s)
        is_its = meets.to_numpy() & (table["remark"] == hidden).to_numpy()
        if span.reason:
            told = Message("landings.by_hand", {"reason": span.reason})
            remark[is_its] = str(told)
    return table.assign(remark=remark)


def _span(given: Given) -> ExcludedSpan:
    """Return a span from what a user gave."""
    wanted = "spans of begin and end, s, and perhaps a reason, as [(4.1, 4.4)]"
    try:
        if isinstance(given, Mapping):
            span = ExcludedSpan(**given)
        else:
            span = ExcludedSpan(*given)
        span = ExcludedSpan(float(span.from_s), float(span.to_s), span.reason)
    except (TypeError, ValueError):
        raise ArgumentError.at("exclude", wanted, f"{given!r}"[:60]) from None
    if not isinstance(span.reason, str):
        raise ArgumentError.at("exclude", "a reason in words", f"{span.reason!r}"[:60])
    if not span.from_s < span.to_s:
        raise ArgumentError.at("exclude", wanted, f"{span.from_s:g} to {span.to_s:g}")
    return span
