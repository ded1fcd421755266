"""Quality checks of a study: each compares a value found in the data with its limits.

The limits are conventions: they say where to look first, and change nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from hopdata.arrays import pd
from hopdata.errors import counted, with_names
from hopdata.landings.contacts.altered import FILTER_DELAYS
from hopdata.landings.contacts.remarks import one_for_all_feet
from hopdata.landings.exclusion import reason_of
from hopdata.landings.fault_places import fault_places
from hopdata.landings.touchdowns import NO_FOOT_LANDED
from hopdata.messages import Message, without_exponent

GOOD = "good"
LOOK = "look"
POOR = "poor"
UNKNOWN = "not known"
NOT_ASKED = "not asked"  # nothing is configured to compare the value with

#: Probability at or above which an order counts as sure.
#: Unit: 1. Origin: chosen.
SURE = 0.9

#: Standard error above which a contact hardly changes the foot's velocity.
#: Unit: s. Origin: chosen.
NO_KINK_S = 0.005

#: Gap of a body marker in which whole descents may go unseen.
#: Unit: s. Origin: chosen.
LONG_S = 1.0

#: Standard errors beyond which a drift counts.
#: Unit: standard errors. Origin: convention: three sigmas.
SURE_OF_DRIFT = 3.0


class Question(NamedTuple):
    """A question, its topic, and the limits of good and poor values."""

    what: str
    about: str
    unit: str
    good: float
    poor: float


SEEN = Question("frames seen, worst marker", "Recordings", "%", 99.0, 95.0)
# Kind of fault -> one of them in words, where the kind is no noun.
FAULT_WORDS = {
    "frozen": "frozen marker",
    "filled": "filled gap",
    "dropped": "frame drop",
    "copy": "repeat",
    "rate": "wrong rate",
    "jitter": "uneven stretch",
    "irregular": "odd time stamp",
    "backward": "backward time stamp",
}
FAULTS = Question("swaps, spikes, jumps, frozen, time", "Recordings", "", 0.0, 10.0)
NOISE = Question("noise of a coordinate over expected", "Recordings", "", 1.5, 3.0)
USED = Question("touchdowns used", "Landings", "%", 80.0, 50.0)
ERRORS = Question("error of a contact over the spread", "Landings", "", 0.1, 0.3)
ORDERS = Question(f"orders less sure than {SURE:g}", "Landings", "%", 10.0, 30.0)
SECTIONS = Question("sections move, over their distance", "Stability", "%", 5.0, 15.0)
DRIFT = Question("drift, in spreads", "Stability", "", 0.5, 1.0)

# What the standard errors of the printed methods do not contain.
ERRORS_BY = {
    "velocity_minimum": "landings.and_errors_of_frames",
    "velocity_minimum_parabola": "landings.and_errors_of_heights",
}


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
    remarks : tuple of Message
        Where the value comes from, or what to look at.
    """

    what: str
    about: str
    value: float | None
    unit: str
    good: float
    poor: float
    status: str
    remarks: tuple[Message, ...]

    @property
    def remark(self) -> str:
        """The remarks in words."""
        return "".join(message.text() for message in self.remarks)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON; the remarks are one text."""
        return {
            "what": self.what,
            "about": self.about,
            "value": self.value,
            "unit": self.unit,
            "good": self.good,
            "poor": self.poor,
            "status": self.status,
            "remark": self.remark,
        }


def check_study(  # noqa: PLR0913 - all that is checked, each by its name
    markers: pd.DataFrame,
    faults: pd.DataFrame,
    touchdowns: pd.DataFrame,
    stability: pd.DataFrame,
    drift: pd.DataFrame,
    floors: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    *,
    expected_noise_m: float | None = None,
    other_feet: bool = False,
    contact_remarks: Sequence[Message] = (),
    starts_s: Mapping[str, float] = MappingProxyType({}),
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
    contact_remarks : sequence of Message
        From `hopdata.landings.contacts.remarks`.
    starts_s : mapping
        Time of the first frame of each recording, s, by name; 0 by default.
    """
    drifts = _drift(drift)
    moves = []
    for name, floor in floors.items():
        if len(floor["moved_m"]) > 1:
            values = {"recording": name, "note": floor["note"]}
            moves.append(Message("landings.and_floor", values))
    return [
        _seen(markers),
        _faults(faults, touchdowns, starts_s),
        _noise(markers, expected_noise_m),
        _used(markers, touchdowns, other_feet),
        _contact_errors(touchdowns, contact_remarks),
        _doubtful_orders(touchdowns),
        _sections(stability),
        replace(drifts, remarks=(*drifts.remarks, *moves)),
    ]


def _check(question: Question, value: float | None, *remarks: Message) -> Check:
    """Judge a value by the limits of its question.

    Higher is better if the good limit exceeds the poor one.
    """
    if value is None or not np.isfinite(value):
        return Check(
            **question._asdict(), value=None, status=UNKNOWN, remarks=tuple(remarks)
        )
    sign = 1.0
    if question.good > question.poor:
        sign = -1.0
    if sign * value <= sign * question.good:
        status = GOOD
    elif sign * value > sign * question.poor:
        status = POOR
    else:
        status = LOOK
    return Check(
        **question._asdict(), value=float(value), status=status, remarks=tuple(remarks)
    )


def _seen(markers: pd.DataFrame) -> Check:
    """Ask how much of the marker that is seen least is seen."""
    used = markers[markers["role"].isin(("body", "foot"))]
    if used.empty:
        return _check(SEEN, None, Message("landings.no_markers"))
    missing = used["missing"] / used["frames"]
    worst = used.iloc[int(np.argmax(missing.to_numpy(float)))]
    share = 100.0 * (1.0 - float(missing.max()))
    values = {
        "marker": worst["marker"],
        "recording": worst["recording"],
        "longest_s": float(worst["longest_s"]),
    }
    return _check(SEEN, share, Message("landings.least_seen", values))


def _faults(
    faults: pd.DataFrame, touchdowns: pd.DataFrame, starts_s: Mapping[str, float]
) -> Check:
    """Ask how many faults the recordings have; one of several markers counts once."""
    places = None
    if len(faults):
        places = fault_places(faults, touchdowns, starts_s)
    faults = faults.drop(columns="marker", errors="ignore").drop_duplicates()
    kinds = faults["kind"].value_counts()
    if len(kinds):
        found = []
        for kind, n in kinds.items():
            found.append(counted(n, FAULT_WORDS.get(str(kind), str(kind))))
        counts = ", ".join(found)
        remark = Message("landings.faults", {"counts": counts})
    else:
        remark = Message("landings.no_faults")
    remarks = [remark]
    if places is not None:
        remarks.append(Message("landings.and_fault_places", {"places": places}))
    return _check(FAULTS, float(len(faults)), *remarks)


def _noise(markers: pd.DataFrame, expected_m: float | None) -> Check:
    """Ask how large the noise is, over the one expected."""
    known = markers["noise_m"].dropna()
    if known.empty:
        return _check(NOISE, None, Message("landings.no_noise"))
    found_m = float(known.median())
    found = Message("landings.noise_found", {"found_mm": 1e3 * found_m})
    if expected_m is None:
        unasked = _check(NOISE, None, found, Message("landings.and_noise_not_asked"))
        return replace(unasked, status=NOT_ASKED)
    ratio = np.nan
    if expected_m:
        ratio = found_m / expected_m
    expected = Message("landings.and_noise_expected", {"expected_mm": 1e3 * expected_m})
    return _check(NOISE, ratio, found, expected)


def _unseen(markers: pd.DataFrame) -> list[Message]:
    """Name the body marker whose long gaps may hide descents that no table counts."""
    body = markers[(markers["role"] == "body") & (markers["longest_s"] > LONG_S)]
    if body.empty:
        return []
    missing = (body["missing"] / body["frames"]).to_numpy(float)
    worst = body.iloc[int(np.argmax(missing))]
    values = {
        "marker": worst["marker"],
        "percent": 100.0 * float(worst["missing"] / worst["frames"]),
        "recording": worst["recording"],
    }
    return [Message("landings.and_marker_unseen", values)]


def _used(markers: pd.DataFrame, touchdowns: pd.DataFrame, other_feet: bool) -> Check:
    """Ask which share of the landings is used, and why others are not."""
    unseen = _unseen(markers)
    if touchdowns.empty:
        return _check(USED, None, Message("landings.no_descent"), *unseen)
    of_others = other_feet & (touchdowns["reason"] == NO_FOOT_LANDED)
    if of_others.all():
        values = {"reason": NO_FOOT_LANDED, "descents": len(of_others)}
        return _check(USED, 0.0, Message("landings.none_landed", values))
    touchdowns = touchdowns[~of_others]
    by_hand = _by_hand(touchdowns)
    touchdowns = touchdowns[~by_hand]
    out = touchdowns["excluded"].astype(bool)
    code = "landings.landings_used" if other_feet else "landings.descents_used"
    used_values = {"used": int((~out).sum()), "count": len(out)}
    remarks = [Message(code, used_values)]
    reasons = touchdowns.loc[out, "reason"].value_counts()
    if len(reasons):
        values = {
            "reason": with_names(reasons.index[0], touchdowns),
            "count": int(reasons.iloc[0]),
        }
        remarks.append(Message("landings.and_most_often", values))
    if of_others.any():
        values = {"descents": int(of_others.sum())}
        remarks.append(Message("landings.and_of_other_feet", values))
    if by_hand.any():
        values = {"landings": int(by_hand.sum())}
        remarks.append(Message("landings.and_by_hand", values))
    first_contact = touchdowns.filter(regex="^contact_.*_s$").min(axis=1)
    ahead_s = touchdowns["t_pre_s"] - first_contact
    continued_s = ahead_s[~out & (ahead_s > 0)]
    if len(continued_s):
        values = {"count": len(continued_s), "most_ms": 1e3 * float(continued_s.max())}
        remarks.append(Message("landings.and_flights_continued", values))
    share = 100.0 * float((~out).mean()) if len(out) else None
    return _check(USED, share, *remarks, *unseen)


def _by_hand(touchdowns: pd.DataFrame) -> pd.Series[bool]:
    """Return which touchdowns the user has left out, for a reason of their own."""
    columns = touchdowns.filter(regex="^contact_.*_s$").columns
    feet = [name.removeprefix("contact_").removesuffix("_s") for name in columns]
    out = touchdowns["excluded"].astype(bool)
    reasons = touchdowns.loc[out, "reason"].unique()
    own_words = [words for words in reasons if reason_of(words, feet) is None]
    return out & touchdowns["reason"].isin(own_words)


def _used_touchdowns(touchdowns: pd.DataFrame) -> pd.DataFrame:
    return touchdowns[~touchdowns["excluded"].astype(bool)]


def _contact_errors(
    touchdowns: pd.DataFrame, contact_remarks: Sequence[Message]
) -> Check:
    """Ask how large the usual error of a foot's contact is, over the spread."""
    told = [
        Message("landings.and_remark", {"remark": one})
        for one in one_for_all_feet(contact_remarks)
    ]
    used = _used_touchdowns(touchdowns)
    errors = used.filter(regex="^se_").median()
    if not errors.notna().any():
        return _check(ERRORS, None, Message("landings.no_contact"), *told)
    worst = int(np.nanargmax(errors.to_numpy(float)))
    error_s = float(errors.iloc[worst])
    spread_s = float(used["spread_s"].median())
    foot = str(errors.index[worst]).removeprefix("se_").removesuffix("_s")
    values = {"error_ms": 1e3 * error_s, "spread_ms": 1e3 * spread_s, "foot": foot}
    remarks = [Message("landings.worst_foot", values), *_common(used)]
    method = str(used["method"].iloc[0])
    if method in ERRORS_BY:
        remarks.append(Message(ERRORS_BY[method]))
    ratio = np.nan
    if spread_s > 0:
        ratio = error_s / spread_s
    return _check(ERRORS, ratio, *remarks, *told)


def _doubtful_orders(touchdowns: pd.DataFrame) -> Check:
    """Ask which share of the orders is doubtful, and which feet make them so."""
    used = _used_touchdowns(touchdowns)
    share = np.nan
    if len(used):
        share = 100.0 * float((used["probability"] < SURE).mean())
    return _check(ORDERS, share, Message("landings.of_used"), *_open_feet(used))


def _open_feet(used: pd.DataFrame) -> list[Message]:
    """Name the two feet whose order is most often the least certain, and why."""
    doubtful = used[used["probability"] < SURE]
    names = [name for name in used.columns if name.startswith("contact_")]
    feet = [name.removeprefix("contact_").removesuffix("_s") for name in names]
    if not len(doubtful) or len(feet) < 2:
        return []
    instant = doubtful.filter(regex="^contact_").to_numpy(float)
    se = doubtful.filter(regex="^se_").to_numpy(float)
    pairs = list(combinations(range(len(feet)), 2))
    apart = []
    for i, j in pairs:
        between_s = np.abs(instant[:, i] - instant[:, j])
        apart.append(between_s / np.hypot(se[:, i], se[:, j]))
    closest = np.nan_to_num(apart, nan=np.inf).argmin(axis=0)
    counts = np.bincount(closest, minlength=len(pairs))
    first, second = pairs[int(counts.argmax())]
    usual_s = np.nanmedian(se[:, [first, second]], axis=0)
    error_s, foot = max(zip(usual_s.tolist(), (feet[first], feet[second]), strict=True))
    values = {
        "count": int(counts.max()),
        "doubtful": len(doubtful),
        "first": feet[first],
        "second": feet[second],
        "error_ms": 1e3 * error_s,
    }
    by_kink = (used["method"] == "kink").all()
    if by_kink and error_s > NO_KINK_S:
        return [Message("landings.and_no_kink", {**values, "foot": foot})]
    return [Message("landings.and_close_together", values)]


def _common(used: pd.DataFrame) -> list[Message]:
    """Report the error that contacts of a foot share, where it exceeds their own."""
    feet = []
    for name in used.columns[used.columns.str.startswith("common_")]:
        common_s = float(used[name].median())
        foot = str(name).removeprefix("common_")
        if common_s > float(used[f"se_{foot}"].median()):
            feet.append(
                f"{foot.removesuffix('_s')} by {without_exponent(1e3 * common_s)} ms"
            )
    if not feet:
        return []
    return [Message("landings.and_common", {"feet": ", ".join(feet)})]


def blurred(touchdowns: pd.DataFrame) -> str:
    """Explain which recording a low-pass filter has blurred too much to compare maps.

    Empty if none is. It has if half a period of its cut-off is longer than a landing
    from section to section: states before and after the contacts are then mixed, and
    equal maps look different.
    """
    used = _used_touchdowns(touchdowns)
    for name, own in used.groupby("recording"):
        landing_s = float((own["t_post_s"] - own["t_pre_s"]).median())
        late_s = float(own.filter(regex="^common_").median().max())
        period_s = late_s / FILTER_DELAYS
        if period_s > 2 * landing_s:
            values = {
                "recording": name,
                "cut_off_hz": 1 / period_s,
                "landing_ms": 1e3 * landing_s,
            }
            return Message("landings.blurred", values).text()
    return ""


def _sections(stability: pd.DataFrame) -> Check:
    """Ask how far the sections move in variants of the data."""
    heights = ["pre_height_m", "post_height_m"]
    chosen = stability.iloc[0][heights].astype(float)
    pre_m, post_m = chosen
    others = stability.iloc[1:]
    moved_m = (others[heights] - chosen).abs().max(axis=1)
    n_failed = int(others["note"].fillna("").astype(bool).sum())
    if moved_m.notna().sum() == 0 or not pre_m > post_m:
        return _check(SECTIONS, None, Message("landings.no_variant"))
    variant = str(others.iloc[int(np.nanargmax(moved_m.to_numpy(float)))]["variant"])
    if not variant.startswith("without "):
        variant = f"with {variant}"
    most_m = float(moved_m.max())
    of_each_m = (others[heights] - chosen).abs().max()
    section = str(of_each_m.idxmax()).removesuffix("_height_m")
    values = {"most_mm": 1e3 * most_m, "variant": variant, "section": section}
    remarks = [Message("landings.sections_move", values)]
    if n_failed:
        values = {"failed": n_failed, "variants": len(others)}
        remarks.append(Message("landings.and_variants_failed", values))
    share = 100.0 * most_m / (pre_m - post_m)
    if n_failed or share > SECTIONS.good:
        remarks.append(Message("landings.and_look_at_sections"))
    return _check(SECTIONS, share, *remarks)


def _drift(drift: pd.DataFrame) -> Check:
    """Ask how far a part of the study is from the others."""
    if drift.empty:
        return _check(DRIFT, None, Message("landings.few_touchdowns"))
    apart = (drift["median_of_part"] - drift["typical"]).abs()
    sure = apart > SURE_OF_DRIFT * drift["se"]
    if not sure.any():
        return _check(DRIFT, 0.0, Message("landings.no_drift"))
    deviations = drift.loc[sure, "deviation"].abs().to_numpy(float)
    worst = drift[sure].iloc[int(np.argmax(deviations))]
    values = {"quantity": worst["quantity"], "part": worst["part"]}
    return _check(
        DRIFT, abs(float(worst["deviation"])), Message("landings.drift", values)
    )
