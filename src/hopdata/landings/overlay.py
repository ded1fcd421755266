"""Contacts that hopdata found, compared with those from another device, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, pd
from hopdata.errors import AnalysisError
from hopdata.recording import Recording
from hopdata.recordings.external import ContactTimes

# Match the contacts of two lists one to one, within a window.

LARGEST_TABLE = 4_000_000  # most pairwise differences in the search for an offset


def match_instants(
    first: FloatArray, second: FloatArray, *, window_s: float
) -> tuple[IntArray, IntArray]:
    """Match two lists of instants: as many pairs as possible, then the nearest ones.

    Parameters
    ----------
    first : (A,) array
        Instants, s, in any order.
    second : (B,) array
        Instants, s, in any order.
    window_s : float
        Largest difference within a pair, s.

    Returns
    -------
    in_first, in_second : (P,) int arrays
        Indices of the pairs in order of time; each entry of either list is in at most
        one pair.
    """
    groups = _clusters(first, second, window_s)
    pairs = [_assigned(first, second, *group, window_s) for group in groups]
    table = np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs])
    at, of = table[np.argsort(first[table[:, 0]], kind="stable")].T
    return at, of


def _clusters(
    first: FloatArray, second: FloatArray, window_s: float
) -> list[tuple[IntArray, IntArray]]:
    """Split into groups farther apart than the window; keep those with instants of both lists."""
    together = np.concatenate([first, second])
    order = np.argsort(together, kind="stable")
    ends = np.flatnonzero(np.diff(together[order]) > window_s) + 1
    groups = [(group[group < len(first)], group[group >= len(first)] - len(first))
              for group in np.split(order, ends)]  # fmt: skip
    return [(rows, columns) for rows, columns in groups if len(rows) and len(columns)]


def _assigned(
    first: FloatArray,
    second: FloatArray,
    rows: IntArray,
    columns: IntArray,
    window_s: float,
) -> IntArray:
    if (
        len(rows) == len(columns) == 1
    ):  # as in most recordings, which need no slow import then
        return np.column_stack([rows, columns])
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(first[rows][:, None] - second[columns])
    price = (
        1.0 + len(apart) + len(columns)
    )  # one more pair outweighs any sum of differences
    cost = np.where(apart <= window_s, apart / window_s, price)
    i, j = linear_sum_assignment(cost)
    return np.column_stack([rows[i], columns[j]])[apart[i, j] <= window_s]


def likely_offset(
    first: FloatArray, second: FloatArray, *, window_s: float
) -> float | None:
    """Return the shift of `second` that aligns the most instants, s; None if none stands out.

    Two clocks that were not started together differ by a constant, at which the
    differences of all pairs pile up.

    Parameters
    ----------
    first, second : (A,), (B,) arrays
        Instants, s.
    window_s : float
        Width within which differences count as the same, s.
    """
    if not 0 < len(first) * len(second) <= LARGEST_TABLE:
        return None
    apart = np.sort((first[:, None] - second).ravel())
    inside = np.searchsorted(apart, apart + window_s, side="right") - np.arange(
        len(apart)
    )
    best = int(np.argmax(inside))
    if inside[best] < max(3, 0.5 * min(len(first), len(second))):
        return None
    return float(np.median(apart[best : best + inside[best]]))


MATCHED, MISSED, INVENTED = "matched", "missed", "invented"
OTHER_FOOT, NOT_COMPARED = "other foot", "not compared"
UNMATCHED = (MISSED, INVENTED, OTHER_FOOT, NOT_COMPARED)
# Time after the post section, s, in which a contact belongs to the same touchdown
LATE_S = 0.1
NO_DESCENT = "no descent through the pre section"
COLUMNS = (
    *(
        "recording",
        "source",
        "column",
        "feet",
        "status",
        "external_s",
        "found_s",
        "se_s",
    ),
    *("difference_s", "first_foot", "index", "excluded", "reason"),
)


def compare_contacts(
    recording: Recording,
    touchdowns: pd.DataFrame,
    external: ContactTimes,
    *,
    window_s: float,
) -> pd.DataFrame:
    """Compare the first contacts of a column's feet with instants from an external device.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    touchdowns : pandas.DataFrame
        Its touchdowns, from `touchdown_table`.
    external : ContactTimes
        Instants of one column.
    window_s : float
        Largest difference between matching contacts, s.

    Returns
    -------
    pandas.DataFrame
        One row for each contact, with `COLUMNS`, in order of time. `status` is
        ``matched``; ``missed`` (external, not found); ``invented`` (found and used, not
        external); ``other foot`` (external, from a foot that is not followed); or ``not
        compared``, with the reason. `difference_s` is found minus external: positive if
        hopdata is late. `excluded` is whether the touchdown with this index is excluded
        from the study, and `reason` is why.

    Raises
    ------
    AnalysisError
        If the times do not overlap, or no found contact is near any external one.
    """
    _check_overlap(recording, external)
    found = _found(touchdowns, external.column.feet)
    ours = found["found_s"].to_numpy()
    inside = _within(external.instant, recording.time[0], recording.time[-1], -window_s)
    others = inside & _by_others(recording, external)
    judged = np.flatnonzero(inside & ~others)
    known = _within(ours, *external.span_s, window_s)
    shown, instants = np.flatnonzero(known), external.instant[judged]
    at, of = match_instants(instants, ours[shown], window_s=window_s)
    if not len(at) and len(judged) and len(found):
        shift, hint = likely_offset(ours, instants, window_s=window_s), ""
        if shift is not None:
            hint = f"; they would fit if {external.source}.offset_s were larger by {shift:.3f}"
        wanted = f"contacts within {window_s:g} s of those found"
        none = f"none among {len(instants)} and {len(found)}{hint}"
        raise AnalysisError.at(_place(recording, external), wanted, none)
    partner = dict(zip(judged[at].tolist(), shown[of].tolist(), strict=True))
    rows: list[dict[Any, Any]] = []
    of_ours: list[dict[Any, Any]] = found.to_dict("records")
    for k, instant in enumerate(external.instant.tolist()):
        row: dict[Any, Any] = {"external_s": instant, "excluded": False}
        if not inside[k]:
            row |= {"status": NOT_COMPARED, "reason": "outside the recording"}
        elif others[k]:
            row |= {
                "status": OTHER_FOOT,
                "reason": "all feet of this column are in the air",
            }
        elif k in partner:
            row |= {"status": MATCHED, **of_ours[partner[k]]}
        else:
            row |= {"status": MISSED, **_descent_at(touchdowns, instant)}
        rows.append(row)
    for i in np.setdiff1d(np.arange(len(found)), shown[of]):
        status = {"status": NOT_COMPARED if of_ours[i]["excluded"] else INVENTED}
        outside = {"status": NOT_COMPARED, "reason": "outside the external data"}
        rows.append(of_ours[i] | (status if known[i] else outside))
    table = pd.DataFrame(rows, columns=list(COLUMNS[4:]))
    table["index"] = table["index"].astype("Int64")
    table["difference_s"] = table["found_s"] - table["external_s"]
    by_time = (
        table["external_s"].fillna(table["found_s"]).sort_values(kind="stable").index
    )
    table = table.loc[by_time].reset_index(drop=True)
    same = (
        recording.name,
        external.source,
        external.column.name,
        " ".join(external.column.feet),
    )
    return table.assign(**dict(zip(COLUMNS[:4], same, strict=True)))[list(COLUMNS)]


def _found(touchdowns: pd.DataFrame, feet: Sequence[str]) -> pd.DataFrame:
    """Return the first contact of these feet in each touchdown that has one."""
    instants = touchdowns[[f"contact_{foot}_s" for foot in feet]].to_numpy(
        dtype=np.float64
    )
    errors = touchdowns[[f"se_{foot}_s" for foot in feet]].to_numpy(dtype=np.float64)
    rows = np.flatnonzero(~np.isnan(instants).all(axis=1))
    first = (
        np.nanargmin(instants[rows], axis=1)
        if len(rows)
        else np.empty(0, dtype=np.int64)
    )
    own = touchdowns[["index", "excluded", "reason"]].iloc[rows].reset_index(drop=True)
    own = own.astype({"excluded": bool}).fillna({"reason": ""})
    names = [feet[i] for i in first]
    return own.assign(
        found_s=instants[rows, first], se_s=errors[rows, first], first_foot=names
    )


def _by_others(recording: Recording, external: ContactTimes) -> BoolArray:
    """Return whether all feet of the column are in the air at each external instant, (K,)."""
    if external.other_feet_above_m is None:
        return np.zeros(len(external.instant), dtype=bool)
    names = recording.names("foot")
    lowest = np.full(len(external.instant), np.inf)
    for foot in external.column.feet:
        height = recording.feet[:, names.index(foot), 2]
        seen = ~np.isnan(height)
        lowest = np.minimum(
            lowest, np.interp(external.instant, recording.time[seen], height[seen])
        )
    return lowest > external.other_feet_above_m


def _descent_at(touchdowns: pd.DataFrame, instant: float) -> dict[str, Any]:
    """Return the touchdown that contains an instant, and why it has no contact there."""
    before = np.flatnonzero(touchdowns["t_pre_s"].to_numpy() <= instant)
    if len(before):
        row = touchdowns.iloc[before[-1]]
        if (
            not instant > row["t_post_s"] + LATE_S
        ):  # true if the post section was never reached
            return {"index": row["index"], "excluded": bool(row["excluded"]),
                    "reason": row["reason"] or "found at another time"}  # fmt: skip
    return {"reason": NO_DESCENT}


def _within(
    instants: FloatArray, first: float, last: float, margin: float
) -> BoolArray:
    return np.asarray((instants >= first - margin) & (instants <= last + margin))


def _check_overlap(recording: Recording, external: ContactTimes) -> None:
    start, end = float(recording.time[0]), float(recording.time[-1])
    first, last = external.span_s
    if last < start or first > end:
        wanted = f"times within the recording ({start:.3f} to {end:.3f} s)"
        found = f"{first:.3f} to {last:.3f} s; check {external.source}.offset_s and the unit"
        raise AnalysisError.at(_place(recording, external), wanted, found)


def _place(recording: Recording, external: ContactTimes) -> str:
    return f"{recording.name}: {external.source}, column '{external.column.name}'"


# How well found and external contacts agree: counts, bias and scatter of each column.

CONFIDENCE = 0.95
# Fewest and most contacts from which a drift is estimated, and the confidence that it
# needs.
LEAST_FOR_DRIFT, MOST_FOR_DRIFT, SURELY = 10, 1000, 0.999
ALL = "all"


def summarise_overlay(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise the agreement of each column of each recording, and of all recordings together.

    Parameters
    ----------
    table : pandas.DataFrame
        Comparison from `compare_contacts`, of one or more recordings and columns.

    Returns
    -------
    pandas.DataFrame
        recording (``all`` where several share a column), source, column, feet,
        first_feet (which of the feet touched first, and how often), n_external
        (contacts of these feet), n_matched, n_excluded (matched contacts in excluded
        touchdowns), n_missed, n_invented, n_other_foot, n_not_compared; bias_s (median
        difference of matched contacts), bias_low_s and bias_high_s (95 % interval by
        order statistics), robust_sd_s (from the median absolute deviation), drift_s
        (change of the difference from the first contact to the last, by the median
        slope; 0 if chance may explain it, NaN for several recordings or fewer than ten
        contacts), sd_s, largest_s (largest distance from the bias), scatter_over_se
        (robust sd of the distances from the bias in units of their standard errors: 1
        if these are right).
    """
    keys = ["source", "column", "feet"]
    groups = list(table.groupby(["recording", *keys], sort=False))
    for key, group in table.groupby(keys, sort=False):
        if len(group["recording"].unique()) > 1:
            groups.append(((ALL, *key), group))
    names = ["recording", *keys]
    return pd.DataFrame(
        [dict(zip(names, key, strict=True)) | _measures(g) for key, g in groups]
    )


def median_interval(values: FloatArray) -> tuple[float, float]:
    """Return a distribution-free interval for the median, between two order statistics.

    Parameters
    ----------
    values : (n,) array
        Independent draws.

    Returns
    -------
    low, high : float
        Bounds of the median with a confidence of at least `CONFIDENCE`; NaN if n is too
        small.
    """
    from scipy.stats import quantile_test

    if len(values) < 2:
        return float("nan"), float("nan")
    low, high = quantile_test(values).confidence_interval(CONFIDENCE)
    return float(low), float(high)


def robust_sd(values: FloatArray) -> float:
    """Estimate the sd from the median absolute deviation; NaN for fewer than two values."""
    from scipy.stats import median_abs_deviation

    return (
        float(median_abs_deviation(values, scale="normal"))
        if len(values) > 1
        else float("nan")
    )


def _drift(time: FloatArray, difference: FloatArray) -> float:
    """Return the change of the differences over the contacts, s, as between drifting clocks."""
    from scipy.stats import theilslopes

    some = slice(None, None, 1 + len(time) // MOST_FOR_DRIFT)
    slope, _, low, high = theilslopes(difference[some], time[some], SURELY)
    return float(slope * np.ptp(time)) if low * high > 0 else 0.0


def _measures(group: pd.DataFrame) -> dict[str, Any]:
    status = group["status"]
    matched = group[status == MATCHED]
    difference = matched["difference_s"].to_numpy(dtype=np.float64)
    n = len(difference)
    clocks = n >= LEAST_FOR_DRIFT and group["recording"].nunique() == 1
    bias = float(np.median(difference)) if n else float("nan")
    low, high = median_interval(difference)
    first = matched["first_foot"].value_counts()
    error = matched["se_s"].to_numpy(dtype=np.float64)
    return {
        "first_feet": ", ".join(
            f"{foot} {count}" for foot, count in sorted(first.items())
        ),
        "n_external": int(status.isin([MATCHED, MISSED]).sum()),
        "n_matched": n,
        "n_excluded": int(matched["excluded"].astype(bool).sum()),
        **{
            f"n_{kind.replace(' ', '_')}": int((status == kind).sum())
            for kind in UNMATCHED
        },
        "bias_s": bias,
        "bias_low_s": low,
        "bias_high_s": high,
        "drift_s": _drift(matched["external_s"].to_numpy(), difference)
        if clocks
        else np.nan,
        "robust_sd_s": robust_sd(difference),
        "sd_s": float(np.std(difference, ddof=1)) if n > 1 else float("nan"),
        "largest_s": float(np.abs(difference - bias).max()) if n else float("nan"),
        "scatter_over_se": robust_sd((difference - bias) / error),
    }
