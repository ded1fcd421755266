"""Contacts that hopdata found, compared with those from another device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, pd
from hopdata.errors import AnalysisError
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.external import ExternalContacts

LARGEST_TABLE = 4_000_000  # most differences in the search for an offset, for memory

#: Share of the instants that an offset must align to stand out.
#: Unit: 1. Origin: chosen.
ALIGNED_SHARE = 0.5

#: Fewest instants that an offset must align to stand out.
#: Unit: instants. Origin: chosen.
LEAST_ALIGNED = 3

#: Time after the post section in which a contact belongs to the same touchdown.
#: Unit: s. Origin: chosen.
LATE_S = 0.1

#: Confidence of the interval for the bias.
#: Unit: 1. Origin: convention.
CONFIDENCE = 0.95

#: Fewest contacts from which a drift is estimated.
#: Unit: contacts. Origin: chosen.
LEAST_FOR_DRIFT = 10

#: Most contacts from which a drift is estimated, evenly spaced.
#: Unit: contacts. Origin: chosen.
MOST_FOR_DRIFT = 1000

#: Confidence that a drift needs.
#: Unit: 1. Origin: chosen.
SURELY = 0.999

MATCHED = "matched"
MISSED = "missed"
INVENTED = "invented"
OTHER_FOOT = "other foot"
NOT_COMPARED = "not compared"
UNMATCHED = (MISSED, INVENTED, OTHER_FOOT, NOT_COMPARED)
ALL = "all"

# Why a contact has no partner, in words.
NO_DESCENT = Message("landings.no_descent_there").text()
OUTSIDE_RECORDING = Message("landings.outside_recording").text()
OUTSIDE_EXTERNAL = Message("landings.outside_external").text()
FEET_IN_AIR = Message("landings.feet_in_air").text()
OTHER_TIME = Message("landings.other_time").text()

# What a comparison says of all its contacts, and of each.
SHARED_COLUMNS = ("recording", "source", "column", "feet")
COLUMNS = (
    *SHARED_COLUMNS,
    "status",
    "external_s",
    "external_se_s",
    "found_s",
    "se_s",
    "difference_s",
    "first_foot",
    "touchdown",
    "excluded",
    "reason",
)

# Match the contacts of two lists one to one, within a window.


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
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for rows, columns in _clusters(first, second, window_s):
        pairs.append(_assigned(first, second, rows, columns, window_s))
    table = np.concatenate(pairs)
    by_time = np.argsort(first[table[:, 0]], kind="stable")
    in_first, in_second = table[by_time].T
    return in_first, in_second


def _clusters(
    first: FloatArray, second: FloatArray, window_s: float
) -> list[tuple[IntArray, IntArray]]:
    """Split into groups farther apart than the window.

    Only groups with instants of both lists are kept.
    """
    together = np.concatenate([first, second])
    order = np.argsort(together, kind="stable")
    ends = np.flatnonzero(np.diff(together[order]) > window_s) + 1
    groups = []
    for group in np.split(order, ends):
        is_first = group < len(first)
        rows = group[is_first]
        columns = group[~is_first] - len(first)
        if len(rows) and len(columns):
            groups.append((rows, columns))
    return groups


def _assigned(
    first: FloatArray,
    second: FloatArray,
    rows: IntArray,
    columns: IntArray,
    window_s: float,
) -> IntArray:
    """Return the pairs (P, 2) of a group: as many as possible, then the nearest."""
    if len(rows) == len(columns) == 1:
        # As in most recordings, which then need no slow import.
        return np.column_stack([rows, columns])
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(first[rows][:, None] - second[columns])
    # One more pair outweighs any sum of differences.
    price = 1.0 + len(apart) + len(columns)
    cost = np.where(apart <= window_s, apart / window_s, price)
    i, j = linear_sum_assignment(cost)
    return np.column_stack([rows[i], columns[j]])[apart[i, j] <= window_s]


def likely_offset(
    first: FloatArray, second: FloatArray, *, window_s: float
) -> float | None:
    """Return the shift of `second` that aligns the most instants, s.

    None if none stands out. Two clocks that were not started together differ by a
    constant, at which the differences of all pairs pile up.

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
    stop = np.searchsorted(apart, apart + window_s, side="right")
    inside = stop - np.arange(len(apart))
    best = int(np.argmax(inside))
    most_possible = min(len(first), len(second))
    if inside[best] < max(LEAST_ALIGNED, ALIGNED_SHARE * most_possible):
        return None
    return float(np.median(apart[best : best + inside[best]]))


def compare_contacts(
    recording: Recording,
    touchdowns: pd.DataFrame,
    external: ExternalContacts,
    *,
    window_s: float,
) -> pd.DataFrame:
    """Compare the first contacts of a column's feet with those of another device.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    touchdowns : pandas.DataFrame
        Its touchdowns, from `touchdown_table`.
    external : ExternalContacts
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
        hopdata is late. `external_se_s` is the standard error of the other device, NaN
        if it is not known. `excluded` is whether the touchdown with this index is
        excluded from the study, and `reason` is why.

    Raises
    ------
    AnalysisError
        If the times do not overlap, or no found contact is near any external one.
    """
    _check_overlap(recording, external)
    found = _found(touchdowns, external.column.feet)
    ours = found["found_s"].to_numpy()
    is_inside = _within(
        external.instant, recording.time[0], recording.time[-1], -window_s
    )
    is_of_others = is_inside & _by_others(recording, external)
    judged = np.flatnonzero(is_inside & ~is_of_others)
    is_known = _within(ours, *external.span_s, window_s)
    shown = np.flatnonzero(is_known)
    instants = external.instant[judged]
    at, of = match_instants(instants, ours[shown], window_s=window_s)
    if not len(at) and len(judged) and len(found):
        hint = ""
        shift = likely_offset(ours, instants, window_s=window_s)
        if shift is not None:
            key = f"{external.source}.offset_s"
            hint = f"; they would fit if {key} were larger by {shift:.3f}"
        raise AnalysisError.at(
            _place(recording, external),
            f"contacts within {window_s:g} s of those found",
            f"none among {len(instants)} and {len(found)}{hint}",
        )
    partner = dict(zip(judged[at].tolist(), shown[of].tolist(), strict=True))
    of_ours: list[dict[Any, Any]] = found.to_dict("records")
    rows: list[dict[Any, Any]] = []
    errors = _errors(external)
    for k, instant in enumerate(external.instant.tolist()):
        row: dict[Any, Any] = {"external_s": instant, "excluded": False}
        row["external_se_s"] = errors[k]
        if not is_inside[k]:
            row |= {"status": NOT_COMPARED, "reason": OUTSIDE_RECORDING}
        elif is_of_others[k]:
            row |= {"status": OTHER_FOOT, "reason": FEET_IN_AIR}
        elif k in partner:
            row |= {"status": MATCHED, **of_ours[partner[k]]}
        else:
            row |= {"status": MISSED, **_descent_at(touchdowns, instant)}
        rows.append(row)
    for i in np.setdiff1d(np.arange(len(found)), shown[of]):
        row = dict(of_ours[i])
        if not is_known[i]:
            row |= {"status": NOT_COMPARED, "reason": OUTSIDE_EXTERNAL}
        elif row["excluded"]:
            row["status"] = NOT_COMPARED
        else:
            row["status"] = INVENTED
        rows.append(row)
    return _compared(rows, recording, external)


def _compared(
    rows: list[dict[Any, Any]], recording: Recording, external: ExternalContacts
) -> pd.DataFrame:
    """Tabulate the contacts of a column in order of time."""
    table = pd.DataFrame(rows, columns=list(COLUMNS[len(SHARED_COLUMNS) :]))
    table["touchdown"] = table["touchdown"].astype("Int64")
    table["difference_s"] = table["found_s"] - table["external_s"]
    time = table["external_s"].fillna(table["found_s"])
    by_time = time.sort_values(kind="stable").index
    table = table.loc[by_time].reset_index(drop=True)
    table = table.assign(
        recording=recording.name,
        source=external.source,
        column=external.column.name,
        feet=" ".join(external.column.feet),
    )
    return table[list(COLUMNS)]


def _found(touchdowns: pd.DataFrame, feet: Sequence[str]) -> pd.DataFrame:
    """Return the first contact of these feet in each touchdown that has one."""
    contact_columns = [f"contact_{foot}_s" for foot in feet]
    error_columns = [f"se_{foot}_s" for foot in feet]
    instants = touchdowns[contact_columns].to_numpy(dtype=np.float64)
    errors = touchdowns[error_columns].to_numpy(dtype=np.float64)
    rows = np.flatnonzero(~np.isnan(instants).all(axis=1))
    first = np.empty(0, dtype=np.int64)
    if len(rows):
        first = np.nanargmin(instants[rows], axis=1)
    own = (
        touchdowns[["touchdown", "excluded", "reason"]]
        .iloc[rows]
        .reset_index(drop=True)
    )
    own = own.astype({"excluded": bool}).fillna({"reason": ""})
    return own.assign(
        found_s=instants[rows, first],
        se_s=errors[rows, first],
        first_foot=[feet[int(i)] for i in first],
    )


def _errors(external: ExternalContacts) -> list[float]:
    """Return the standard errors of a column's instants, s; NaN if not known."""
    if external.error_s is None:
        return [float("nan")] * len(external.instant)
    return [float(error) for error in external.error_s]


def _by_others(recording: Recording, external: ExternalContacts) -> BoolArray:
    """Tell whether all feet of the column are in the air at each instant, (K,)."""
    if external.of_other_foot is not None:
        return external.of_other_foot
    if external.other_feet_above_m is None:
        return np.zeros(len(external.instant), dtype=bool)
    names = recording.names("foot")
    lowest = np.full(len(external.instant), np.inf)
    for foot in external.column.feet:
        height = recording.feet[:, names.index(foot), 2]
        seen = ~np.isnan(height)
        then = np.interp(external.instant, recording.time[seen], height[seen])
        lowest = np.minimum(lowest, then)
    return lowest > external.other_feet_above_m


def _descent_at(touchdowns: pd.DataFrame, instant: float) -> dict[str, Any]:
    """Return the touchdown at an instant, and why it has no contact there."""
    before = np.flatnonzero(touchdowns["t_pre_s"].to_numpy() <= instant)
    if not len(before):
        return {"reason": NO_DESCENT}
    row = touchdowns.iloc[before[-1]]
    # Without a crossing of the post section, the comparison is false.
    if instant > row["t_post_s"] + LATE_S:
        return {"reason": NO_DESCENT}
    return {
        "touchdown": row["touchdown"],
        "excluded": bool(row["excluded"]),
        "reason": row["reason"] or OTHER_TIME,
    }


def _within(
    instants: FloatArray, first: float, last: float, margin: float
) -> BoolArray:
    return np.asarray((instants >= first - margin) & (instants <= last + margin))


def _check_overlap(recording: Recording, external: ExternalContacts) -> None:
    start = float(recording.time[0])
    end = float(recording.time[-1])
    first, last = external.span_s
    if last < start or first > end:
        key = f"{external.source}.offset_s"
        raise AnalysisError.at(
            _place(recording, external),
            f"times within the recording ({start:.3f} to {end:.3f} s)",
            f"{first:.3f} to {last:.3f} s; check {key} and the unit",
        )


def _place(recording: Recording, external: ExternalContacts) -> str:
    return f"{recording.name}: {external.source}, column '{external.column.name}'"


# How well found and external contacts agree: counts, bias and scatter of each column.


def summarise_overlay(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise the agreement of each column, for each recording and for all.

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
        (robust sd of the distances from the bias in units of their standard errors,
        which include those of the other device where they are known: 1 if these are
        right), external_se_s (median standard error of the other device, NaN if it is
        not known).
    """
    keys = ["source", "column", "feet"]
    if table.empty:
        # The columns of a table with rows, so that a file of it can be read.
        return pd.DataFrame(columns=["recording", *keys, *_measures(table)])
    groups = list(table.groupby(["recording", *keys], sort=False))
    for key, group in table.groupby(keys, sort=False):
        if len(group["recording"].unique()) > 1:
            groups.append(((ALL, *key), group))
    names = ["recording", *keys]
    rows = []
    for key, group in groups:
        rows.append(dict(zip(names, key, strict=True)) | _measures(group))
    return pd.DataFrame(rows)


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
    """Estimate the sd from the median absolute deviation; NaN of fewer than two."""
    from scipy.stats import median_abs_deviation

    if len(values) < 2:
        return float("nan")
    return float(median_abs_deviation(values, scale="normal"))


def _drift(time: FloatArray, difference: FloatArray) -> float:
    """Return the change of differences over the contacts, s, as by drifting clocks."""
    from scipy.stats import theilslopes

    some = slice(None, None, 1 + len(time) // MOST_FOR_DRIFT)
    slope, _, low, high = theilslopes(difference[some], time[some], SURELY)
    is_sure = low * high > 0  # both ends of the interval have one sign
    if not is_sure:
        return 0.0
    return float(slope * np.ptp(time))


def _error_of_difference(matched: pd.DataFrame) -> FloatArray:
    """Return the standard error of each difference, s: of both devices, if known."""
    ours = matched["se_s"].to_numpy(dtype=np.float64)
    theirs = matched["external_se_s"].to_numpy(dtype=np.float64)
    return np.asarray(np.hypot(ours, np.nan_to_num(theirs)))


def _measures(group: pd.DataFrame) -> dict[str, Any]:
    """Return counts, bias and scatter of the contacts of a column."""
    status = group["status"]
    matched = group[status == MATCHED]
    difference = matched["difference_s"].to_numpy(dtype=np.float64)
    error = _error_of_difference(matched)
    n = len(difference)
    nan = float("nan")
    bias = float(np.median(difference)) if n else nan
    low, high = median_interval(difference)
    has_one_clock = group["recording"].nunique() == 1
    drift = nan
    if n >= LEAST_FOR_DRIFT and has_one_clock:
        drift = _drift(matched["external_s"].to_numpy(), difference)
    first = matched["first_foot"].value_counts()
    counts = [f"{foot} {count}" for foot, count in sorted(first.items())]
    measures: dict[str, Any] = {
        "first_feet": ", ".join(counts),
        "n_external": int(status.isin([MATCHED, MISSED]).sum()),
        "n_matched": n,
        "n_excluded": int(matched["excluded"].astype(bool).sum()),
    }
    for kind in UNMATCHED:
        measures[f"n_{kind.replace(' ', '_')}"] = int((status == kind).sum())
    measures["bias_s"] = bias
    measures["bias_low_s"] = low
    measures["bias_high_s"] = high
    measures["drift_s"] = drift
    measures["robust_sd_s"] = robust_sd(difference)
    measures["sd_s"] = float(np.std(difference, ddof=1)) if n > 1 else nan
    measures["largest_s"] = float(np.abs(difference - bias).max()) if n else nan
    measures["scatter_over_se"] = robust_sd((difference - bias) / error)
    measures["external_se_s"] = float(matched["external_se_s"].median()) if n else nan
    return measures
