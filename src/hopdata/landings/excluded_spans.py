"""Spans of a recording whose frames count as unseen, as its user asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hopdata.errors import ArgumentError
from hopdata.messages import Message
from hopdata.recording import Recording


def without_spans(
    recording: Recording, spans: Sequence[tuple[float, float]]
) -> tuple[Recording, list[Message]]:
    """Return a recording in which the frames of some spans, s, count as unseen.

    Parameters
    ----------
    recording : Recording
        It stays as it is.
    spans : sequence of (begin, end)
        On the clock of the recording, s; frames at both ends are in it.

    Returns
    -------
    recording : Recording
    remarks : list of Message
        Which spans were left out.

    Raises
    ------
    ArgumentError
        If a span is none, or holds no frame of the recording.
    """
    if not len(spans):
        return recording, []
    positions = recording.positions.copy()
    named = []
    for span in spans:
        begin_s, end_s = _span(span)
        inside = (recording.time >= begin_s) & (recording.time <= end_s)
        if not inside.any():
            first_s, last_s = recording.time[[0, -1]]
            wanted = f"spans with frames of {recording.name}, {first_s:g} to {last_s:g}"
            found = f"{begin_s:g} to {end_s:g} s"
            raise ArgumentError.at("exclude", f"{wanted} s", found)
        positions[inside] = np.nan
        named.append(f"{begin_s:g} to {end_s:g} s")
    values = {"recording": recording.name, "spans": ", ".join(named)}
    remark = Message("landings.spans_excluded", values)
    return replace(recording, positions=positions), [remark]


def _span(span: tuple[float, float]) -> tuple[float, float]:
    """Return begin and end of a span, s."""
    wanted = "spans of begin and end, s, as [(4.1, 4.4)]"
    try:
        begin_s, end_s = (float(one) for one in span)
    except (TypeError, ValueError):
        raise ArgumentError.at("exclude", wanted, f"{span!r}"[:60]) from None
    if not begin_s < end_s:
        raise ArgumentError.at("exclude", wanted, f"{begin_s:g} to {end_s:g}")
    return begin_s, end_s
