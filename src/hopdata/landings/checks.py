"""Quality checks of a study: each compares a value found in the data with its limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from types import MappingProxyType
from typing import Any

import numpy as np

from hopdata.arrays import pd
from hopdata.errors import with_names
from hopdata.landings.contacts.find import FILTER_DELAYS
from hopdata.landings.touchdowns import NO_FOOT_LANDED

GOOD, LOOK, POOR, UNKNOWN = "good", "look", "poor", "not known"
NOT_ASKED = "not asked"  # nothing is configured to compare the value with
SURE = 0.9  # probability at or above which an order counts as sure
# Standard error, s, above which the contact hardly changes the foot's velocity
NO_KINK_S = 0.005
# What the standard errors of the printed methods do not contain.
ERRORS_BY = {
    "velocity_minimum": "; only the rounding to a frame counts in these errors",
    "velocity_minimum_parabola": "; only the noise of the heights counts in these errors",
}
LONG_S = 1.0  # gap of a body marker, s, in which whole descents may go unseen


@dataclass(frozen=True)
class Check:
    """One question put to the data.

    Parameters
    ----------
    what : str
        The question.
    about : str
        Its topic; the report page has a light for each topic.
    value : float or None
        The answer, in `unit`; None if it cannot be known.
    unit : str
        Unit of the value and of the limits.
    good, poor : float
        Limits of a good and of a poor value; a value between them deserves a look.
    status : str
        ``good, look, poor``, ``not known``, or ``not asked`` if the study configures
        nothing to compare with.
    remark : str
        Where the value comes from, or what to look at.
    """

    what: str
    about: str
    value: float | None
    unit: str
    good: float
    poor: float
    status: str
    remark: str

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON."""
        return asdict(self)


def check_study(
    markers: pd.DataFrame,
    faults: pd.DataFrame,
    touchdowns: pd.DataFrame,
    stability: pd.DataFrame,
    drift: pd.DataFrame,
    floors: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    *,
    expected_noise_m: float | None = None,
    other_feet: bool = False,
) -> list[Check]:
    """Judge a study by its tables.

    Parameters
    ----------
    markers, faults : DataFrame
        From `hopdata.recordings.quality.inspection`.
    touchdowns : DataFrame
        The study's table of touchdowns.
    stability, drift : DataFrame
        From `hopdata.landings.stability`.
    floors : mapping
        Fields of the `FloorModel` of each recording, by name; floors that move are
        reported.
    expected_noise_m : float, optional
        Known noise of a marker coordinate in the recording system, m.
    other_feet : bool
        Whether the animal also lands on feet that the study does not follow. Descents
        in which none of the study's feet landed then do not count against it.
    """
    moves = [
        f"{name}: {one['note']}"
        for name, one in floors.items()
        if len(one["moved_m"]) > 1
    ]
    drifts = _drift(drift)
    return [
        _seen(markers),
        _faults(faults),
        _noise(markers, expected_noise_m),
        _used(markers, touchdowns, other_feet),
        *_orders(touchdowns),
        _sections(stability),
        replace(drifts, remark="; ".join([drifts.remark, *moves])),
    ]


# Question: (topic, unit, limit of good values, limit of poor values).
QUESTIONS = {
    "frames seen, worst marker": ("Recordings", "%", 99.0, 95.0),
    "swaps, spikes, jumps, frozen, time": ("Recordings", "", 0.0, 10.0),
    "noise of a coordinate over expected": ("Recordings", "", 1.5, 3.0),
    "touchdowns used": ("Landings", "%", 80.0, 50.0),
    "error of a contact over the spread": ("Landings", "", 0.1, 0.3),
    f"orders less sure than {SURE:g}": ("Landings", "%", 10.0, 30.0),
    "sections move, over their distance": ("Stability", "%", 5.0, 15.0),
    "drift, in spreads": ("Stability", "", 0.5, 1.0),
}


def _check(what: str, value: float | None, remark: str) -> Check:
    """Judge a value by its limits; higher is better if the good limit exceeds the poor one."""
    about, unit, good, poor = QUESTIONS[what]
    if value is None or not np.isfinite(value):
        return Check(what, about, None, unit, good, poor, UNKNOWN, remark)
    sign = 1.0 if good <= poor else -1.0
    status = (
        GOOD
        if sign * value <= sign * good
        else POOR
        if sign * value > sign * poor
        else LOOK
    )
    return Check(what, about, float(value), unit, good, poor, status, remark)


def _seen(markers: pd.DataFrame) -> Check:
    what, used = (
        "frames seen, worst marker",
        markers[markers["role"].isin(("body", "foot"))],
    )
    if used.empty:
        return _check(what, None, "no markers")
    missing = used["missing"] / used["frames"]
    worst = used.iloc[int(np.argmax(missing.to_numpy(float)))]
    where = f"{worst['marker']} in {worst['recording']}"
    share = 100.0 * (1.0 - float(missing.max()))
    return _check(what, share, f"{where}; its longest gap {worst['longest_s']:.3g} s")


def _faults(faults: pd.DataFrame) -> Check:
    faults = faults.drop(columns="marker", errors="ignore").drop_duplicates()
    kinds = faults["kind"].value_counts()
    remark = ", ".join(f"{n} × {kind}" for kind, n in kinds.items()) or "none found"
    return _check("swaps, spikes, jumps, frozen, time", float(len(faults)), remark)


def _noise(markers: pd.DataFrame, expected_m: float | None) -> Check:
    what, known = "noise of a coordinate over expected", markers["noise_m"].dropna()
    if known.empty:
        return _check(what, None, "no five frames in a row")
    found = float(known.median())
    told = f"{1e3 * found:.2g} mm found"
    if expected_m is None:
        remark = f"{told}; to compare it, set report.expected_noise_m"
        return replace(_check(what, None, remark), status=NOT_ASKED)
    ratio = found / expected_m if expected_m else np.nan
    return _check(what, ratio, f"{told}, {1e3 * expected_m:.2g} mm expected")


def _unseen(markers: pd.DataFrame) -> str:
    """Name the body marker whose long gaps may hide descents that no table counts."""
    body = markers[(markers["role"] == "body") & (markers["longest_s"] > LONG_S)]
    if body.empty:
        return ""
    worst = body.iloc[
        int(np.argmax((body["missing"] / body["frames"]).to_numpy(float)))
    ]
    share = 100.0 * float(worst["missing"] / worst["frames"])
    where = f"{worst['marker']} (missing in {share:.2g} % of {worst['recording']})"
    return f"; none is found where a body marker is missing for long: {where}"


def _used(markers: pd.DataFrame, touchdowns: pd.DataFrame, other_feet: bool) -> Check:
    what, unseen = "touchdowns used", _unseen(markers)
    if touchdowns.empty:
        return _check(what, None, f"no descent found{unseen}")
    theirs = other_feet & (touchdowns["reason"] == NO_FOOT_LANDED)
    if theirs.all():
        return _check(what, 0.0, f"{NO_FOOT_LANDED} in any of {len(theirs)} descents")
    touchdowns = touchdowns[~theirs]
    out = touchdowns["excluded"].astype(bool)
    reasons = touchdowns.loc[out, "reason"].value_counts()
    remark = (
        f"{int((~out).sum())} of {len(out)} {'landings' if other_feet else 'descents'}"
    )
    if len(reasons):
        remark += f"; most often: {with_names(reasons.index[0], touchdowns)} ({reasons.iloc[0]})"
    if theirs.any():
        remark += f"; not counted: {int(theirs.sum())} more descents, of other feet"
    ahead = touchdowns["t_pre_s"] - touchdowns.filter(regex="^contact_.*_s$").min(
        axis=1
    )
    ahead = ahead[~out & (ahead > 0)]
    if len(ahead):
        remark += f"; in {len(ahead)} the flight is continued to the pre section, by "
        remark += f"{1e3 * float(ahead.max()):.2g} ms at most"
    return _check(what, 100.0 * float((~out).mean()), remark + unseen)


def _orders(touchdowns: pd.DataFrame) -> Iterator[Check]:
    used = touchdowns[~touchdowns["excluded"].astype(bool)]
    errors = used.filter(regex="^se_").median()
    what = "error of a contact over the spread"
    if errors.notna().any():
        worst = int(np.nanargmax(errors.to_numpy(float)))
        error, spread = float(errors.iloc[worst]), float(used["spread_s"].median())
        foot = str(errors.index[worst]).removeprefix("se_").removesuffix("_s")
        remark = f"{1e3 * error:.2g} ms of {1e3 * spread:.2g} ms; worst foot {foot}"
        remark += _common(used) + ERRORS_BY.get(str(used["method"].iloc[0]), "")
        yield _check(what, error / spread if spread > 0 else np.nan, remark)
    else:
        yield _check(what, None, "no contact")
    doubtful = (
        100.0 * float((used["probability"] < SURE).mean()) if len(used) else np.nan
    )
    remark = "of the touchdowns used" + _open_foot(used)
    yield _check(f"orders less sure than {SURE:g}", doubtful, remark)


def _open_foot(used: pd.DataFrame) -> str:
    """Name the two feet whose order is most often the least certain, and why."""
    doubtful = used[used["probability"] < SURE]
    feet = [name[8:-2] for name in used.columns if name.startswith("contact_")]
    instant, se = (
        doubtful.filter(regex=k).to_numpy(float) for k in ("^contact_", "^se_")
    )
    if not len(doubtful) or len(feet) < 2:
        return ""
    pairs = list(combinations(range(len(feet)), 2))
    apart = [
        np.abs(instant[:, i] - instant[:, j]) / np.hypot(se[:, i], se[:, j])
        for i, j in pairs
    ]
    counts = np.bincount(
        np.nan_to_num(apart, nan=np.inf).argmin(axis=0), minlength=len(pairs)
    )
    pair = pairs[int(counts.argmax())]
    error, foot = max((float(np.nanmedian(se[:, k])), feet[k]) for k in pair)
    both = f"{feet[pair[0]]} and {feet[pair[1]]}"
    told = f"; in {counts.max()} of {len(doubtful)}, {both} "
    by_kink = (used["method"] == "kink").all()
    if by_kink and error > NO_KINK_S:
        return f"{told}are least sure: {foot} slows without a kink (error {1e3 * error:.2g} ms)"
    return f"{told}land as close together as their errors of {1e3 * error:.2g} ms"


def _common(used: pd.DataFrame) -> str:
    """Report the error that all contacts of a foot may share, where it exceeds their own."""
    told = []
    for name in used.columns[used.columns.str.startswith("common_")]:
        common, foot = float(used[name].median()), str(name).removeprefix("common_")
        if common > float(used[f"se_{foot}"].median()):
            told.append(f"{foot.removesuffix('_s')} by {1e3 * common:.2g} ms")
    return (
        f"; contacts of a foot may all be early or late: {', '.join(told)}"
        if told
        else ""
    )


def blurred(touchdowns: pd.DataFrame) -> str:
    """Explain which recording a low-pass filter has blurred too much to compare maps; else empty.

    It has if half a period of its cut-off is longer than a landing from section to
    section: states before and after the contacts are then mixed, and equal maps look
    different.
    """
    for name, used in touchdowns[~touchdowns["excluded"].astype(bool)].groupby(
        "recording"
    ):
        landing_s = float((used["t_post_s"] - used["t_pre_s"]).median())
        period_s = float(used.filter(regex="^common_").median().max()) / FILTER_DELAYS
        if period_s > 2 * landing_s:
            cut = f"by a low-pass of some {1 / period_s:.2g} Hz"
            mixed = f"mixes before and after, {1e3 * landing_s:.2g} ms from section to section"
            return f"'{name}' is smoothed as {cut}, which {mixed}: export it unfiltered"
    return ""


def _sections(stability: pd.DataFrame) -> Check:
    what, heights = (
        "sections move, over their distance",
        ["pre_height_m", "post_height_m"],
    )
    chosen = stability.iloc[0][heights].astype(float)
    pre, post = chosen
    others = stability.iloc[1:]
    largest = (others[heights] - chosen).abs().max(axis=1)
    failed = int(others["note"].fillna("").astype(bool).sum())
    if largest.notna().sum() == 0 or not pre > post:
        return _check(what, None, "no variant gives sections")
    worst = others.iloc[int(np.nanargmax(largest.to_numpy(float)))]
    variant = str(worst["variant"])
    how = variant if variant.startswith("without ") else f"with {variant}"
    remark = f"{1e3 * float(largest.max()):.2g} mm {how}"
    remark += f"; {failed} of {len(others)} variants have no sections" if failed else ""
    share = 100.0 * float(largest.max()) / (pre - post)
    if failed or share > QUESTIONS[what][2]:
        remark += "; look at Fig. 2.2: if they look wrong, set sections.pre_height_m, post_height_m"
    return _check(what, share, remark)


def _drift(drift: pd.DataFrame) -> Check:
    what, sure = (
        "drift, in spreads",
        (drift["median"] - drift["typical"]).abs() > 3.0 * drift["se"],
    )
    if drift.empty:
        return _check(what, None, "too few touchdowns")
    if not sure.any():
        return _check(what, 0.0, "nothing beyond three standard errors")
    worst = drift[sure].iloc[
        int(np.argmax(drift.loc[sure, "deviation"].abs().to_numpy(float)))
    ]
    return _check(
        what, abs(float(worst["deviation"])), f"{worst['quantity']} in {worst['part']}"
    )
