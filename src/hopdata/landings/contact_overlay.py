"""Contacts that hopdata found beside those that another device knows, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.landings.contact_matching import likely_offset, match_instants
from hopdata.recordings.external import ContactTimes
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MATCHED, MISSED, INVENTED = "matched", "missed", "invented"
OTHER_FOOT, NOT_COMPARED = "other foot", "not compared"
LATE_S = 0.1  # a foot may land so long after the post section and belong to the same touchdown
NO_DESCENT = "no descent through the pre section"
COLUMNS = (
    "recording",
    "source",
    "column",
    "feet",
    "status",
    "external_s",
    "found_s",
    "se_s",
    "difference_s",
    "first_foot",
    "index",
    "excluded",
    "reason",
)


def compare_contacts(
    recording: Recording, touchdowns: pd.DataFrame, external: ContactTimes, *, window_s: float
) -> pd.DataFrame:
    """Compare the first contacts of a column's feet with the instants that are known from outside.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    touchdowns : pandas.DataFrame
        Its touchdowns, as `touchdown_table` makes them.
    external : ContactTimes
        Instants of one column.
    window_s : float
        Contacts further apart than this are not the same, s.

    Returns
    -------
    pandas.DataFrame
        One row a contact, `COLUMNS`, by time. `status` is ``matched``; ``missed`` (known outside,
        not found); ``invented`` (found and used, not known outside); ``other foot`` (known outside,
        by a foot that is not followed); or ``not compared``, with the reason. `difference_s` is
        found less external: positive where hopdata is late. `excluded` tells whether the touchdown
        with this index is left out of the study, and `reason` why.

    Raises
    ------
    AnalysisError
        If times do not overlap, or no contact of the one is near any of the other.
    """
    import pandas as pd

    _check_overlap(recording, external)
    found = _found(touchdowns, external.column.feet)
    inside = _within(external.instant, recording.time[0], recording.time[-1], -window_s)
    others = inside & _by_others(recording, external)
    judged = np.flatnonzero(inside & ~others)
    known = _within(found["found_s"].to_numpy(), *external.span_s, window_s)
    shown = np.flatnonzero(known)
    at, of = match_instants(
        external.instant[judged], found["found_s"].to_numpy()[shown], window_s=window_s
    )
    if not len(at) and len(judged) and len(found):
        raise _nothing_near(
            recording, external, external.instant[judged], found["found_s"], window_s
        )
    partner = np.full(len(external.instant), -1)
    partner[judged[at]] = shown[of]
    rows = _external_rows(external, partner, inside, others, found, touchdowns)
    rows += _unmatched_rows(found, np.setdiff1d(np.arange(len(found)), shown[of]), known)
    table = pd.DataFrame(rows, columns=list(COLUMNS[4:]))
    table["index"] = table["index"].astype("Int64")
    table["difference_s"] = table["found_s"] - table["external_s"]
    by_time = table["external_s"].fillna(table["found_s"]).sort_values(kind="stable").index
    table = table.loc[by_time].reset_index(drop=True)
    return table.assign(
        recording=recording.name,
        source=external.source,
        column=external.column.name,
        feet=" ".join(external.column.feet),
    )[list(COLUMNS)]


def _found(touchdowns: pd.DataFrame, feet: Sequence[str]) -> pd.DataFrame:
    """First contact of these feet in each touchdown that has one: with its foot and index."""
    import pandas as pd

    instants = touchdowns[[f"contact_{foot}_s" for foot in feet]].to_numpy(dtype=np.float64)
    errors = touchdowns[[f"se_{foot}_s" for foot in feet]].to_numpy(dtype=np.float64)
    rows = np.flatnonzero(~np.isnan(instants).all(axis=1))
    first = np.nanargmin(instants[rows], axis=1) if len(rows) else np.empty(0, dtype=np.int64)
    return pd.DataFrame(
        {
            "found_s": instants[rows, first],
            "se_s": errors[rows, first],
            "first_foot": [feet[i] for i in first],
            "index": touchdowns["index"].to_numpy()[rows],
            "excluded": touchdowns["excluded"].to_numpy(dtype=bool)[rows],
            "reason": touchdowns["reason"].astype(object).fillna("").to_numpy()[rows],
        }
    )


def _by_others(recording: Recording, external: ContactTimes) -> BoolArray:
    """Whether all feet of the column are in the air at each external instant, (K,)."""
    if external.other_feet_above_m is None:
        return np.zeros(len(external.instant), dtype=bool)
    names = recording.names("foot")
    lowest = np.full(len(external.instant), np.inf)
    for foot in external.column.feet:
        height = recording.feet[:, names.index(foot), 2]
        seen = ~np.isnan(height)
        at = np.interp(external.instant, recording.time[seen], height[seen])
        lowest = np.minimum(lowest, at)
    return lowest > external.other_feet_above_m


def _external_rows(
    external: ContactTimes,
    partner: NDArray[np.int64],
    inside: BoolArray,
    others: BoolArray,
    found: pd.DataFrame,
    touchdowns: pd.DataFrame,
) -> list[dict[str, Any]]:
    rows = []
    for k, instant in enumerate(external.instant):
        row: dict[str, Any] = {"external_s": instant, "excluded": False}
        if not inside[k]:
            row |= {"status": NOT_COMPARED, "reason": "outside the recording"}
        elif others[k]:
            row |= {"status": OTHER_FOOT, "reason": "all feet of this column are in the air"}
        elif partner[k] >= 0:
            row |= {"status": MATCHED, **found.iloc[partner[k]].to_dict()}
        else:
            row |= {"status": MISSED, **_descent_at(touchdowns, float(instant))}
        rows.append(row)
    return rows


def _unmatched_rows(
    found: pd.DataFrame, unmatched: NDArray[np.int64], known: BoolArray
) -> list[dict[str, Any]]:
    """Contacts found that no external one stands beside."""
    rows = []
    for i in unmatched:
        row = found.iloc[i].to_dict()
        if not known[i]:
            row |= {"status": NOT_COMPARED, "reason": "outside the external data"}
        else:
            row["status"] = NOT_COMPARED if row["excluded"] else INVENTED
        rows.append(row)
    return rows


def _descent_at(touchdowns: pd.DataFrame, instant: float) -> dict[str, Any]:
    """Touchdown during which an instant lies, and why it has no contact there."""
    before = np.flatnonzero(touchdowns["t_pre_s"].to_numpy() <= instant)
    if len(before):
        row = touchdowns.iloc[before[-1]]
        if not instant > row["t_post_s"] + LATE_S:  # nor if the post section was never reached
            return {"index": row["index"], "excluded": bool(row["excluded"]),
                    "reason": row["reason"] or "found at another time"}  # fmt: skip
    return {"reason": NO_DESCENT}


def _within(instants: FloatArray, first: float, last: float, margin: float) -> BoolArray:
    inside: BoolArray = (instants >= first - margin) & (instants <= last + margin)
    return inside


def _check_overlap(recording: Recording, external: ContactTimes) -> None:
    start, end = float(recording.time[0]), float(recording.time[-1])
    first, last = external.span_s
    if last < start or first > end:
        raise AnalysisError(
            f"{recording.name}: {external.source}, column '{external.column.name}': expected times "
            f"within the recording ({start:.3f} to {end:.3f} s), found {first:.3f} to {last:.3f} s;"
            f" check {external.source}.offset_s and the unit"
        )


def _nothing_near(
    recording: Recording,
    external: ContactTimes,
    instants: FloatArray,
    found: pd.Series,
    window_s: float,
) -> AnalysisError:
    shift = likely_offset(found.to_numpy(), instants, window_s=window_s)
    hint = "" if shift is None else (
        f"; they would fit if {external.source}.offset_s were larger by {shift:.3f}"
    )  # fmt: skip
    return AnalysisError(
        f"{recording.name}: {external.source}, column '{external.column.name}': expected contacts "
        f"within {window_s:g} s of those found, found none among {len(instants)} and "
        f"{len(found)}{hint}"
    )
