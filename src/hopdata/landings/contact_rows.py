"""Rows of the tables of contacts and of their orders, and landings without a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.errors import counted
from hopdata.landings import schedules
from hopdata.landings.contact_feet import sides_of
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.law import UNDETERMINED_S
from hopdata.landings.contacts.passes import LONG_WINDOWS_S
from hopdata.messages import Message
from hopdata.recording import Recording

# What became of a foot that may have landed: the words of the column `remark`.
REMARKS = {
    descents.MISSING: "landings.contact_hidden",
    descents.POOR_FIT: "landings.contact_poor_fit",
    descents.RISES: "landings.contact_rises",
    descents.THIN: "landings.contact_thin",
    descents.GLIDES: "landings.contact_glides",
}
# A foot that is hidden may not have landed at all.
SEEN_TO_COME_DOWN = frozenset(REMARKS) - {descents.MISSING}

COLUMNS = (
    "recording",
    "landing",
    "foot",
    "side",
    "marker",
    "marker_probability",
    "contact_s",
    "se_s",
    "common_s",
    "found",
    "remark",
    "plate",
    "plate_s",
    "plate_se_s",
)

#: Share of the landings in which a foot is seen, above which it lands with the others:
#: it should then touch where it is hidden, too.
#: Unit: 1. Origin: chosen.
LANDS_WITH_OTHERS = 0.5

# A contact without a force plate.
NO_PLATE = ("", float("nan"), float("nan"))
# Landings, or onsets of plates, of one kind whose times a remark tells.
MOST_NAMED = 6

ORDER_COLUMNS = (
    "recording",
    "landing",
    "begin_s",
    "end_s",
    "feet",
    "order",
    "probability",
    "runner_up",
    "runner_up_probability",
    "sure",
)


def landed(landings: pd.DataFrame, feet: Sequence[str]) -> pd.DataFrame:
    """Return the descents in which a foot landed, or may have; others are dropped."""
    status = landings[[f"status_{foot}" for foot in feet]].to_numpy()
    idle = np.isin(status, (descents.ALREADY_DOWN, descents.NOT_LANDED))
    timed = landings[[f"contact_{foot}_s" for foot in feet]].notna().to_numpy()
    # A foot that is hidden for long may have landed at any time: that is no landing.
    is_landing = (timed & ~idle).any(axis=1)
    kept = landings.iloc[np.flatnonzero(is_landing)]
    instants = kept[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    first = np.fmin.reduce(instants, axis=1)
    return kept.iloc[np.argsort(first, kind="stable")].reset_index(drop=True)


def untimed(recording: Recording, landings: pd.DataFrame) -> list[Message]:
    """Say in which descents feet came down, though none of them could be timed.

    Such a landing has no row. A single marker that fits badly has an instant all the
    same; a foot of several has none, since any of them may have been the first. A
    descent of the body may be long, and a foot that is timed in it has a row of its
    own: that landing is not left out.
    """
    feet = recording.names("foot")
    instants = {foot: landings[f"contact_{foot}_s"].to_numpy(float) for foot in feet}
    named = []
    cut = _cut_off(recording, landings)
    is_cut_off = cut["begin"] | cut["end"]  # these are told by `cut_off`
    for landing in landings[~is_cut_off].to_dict("records"):
        if any(np.isfinite(landing[f"contact_{foot}_s"]) for foot in feet):
            continue
        status = {foot: int(landing[f"status_{foot}"]) for foot in feet}
        begin_s, end_s = landing["begin_s"], landing["end_s"]
        came_down = []
        for foot in feet:
            after_begin = instants[foot] >= begin_s
            before_end = instants[foot] <= end_s
            is_timed_elsewhere = (after_begin & before_end).any()
            if status[foot] in SEEN_TO_COME_DOWN and not is_timed_elsewhere:
                came_down.append(foot)
        if not came_down:
            continue
        reasons = [f"{foot}: {Message(REMARKS[status[foot]])}" for foot in came_down]
        named.append(f"{begin_s:.2f} to {end_s:.2f} s ({', '.join(reasons)})")
    if not named:
        return []
    places = "; ".join(named[:MOST_NAMED])
    if len(named) > MOST_NAMED:
        places += f"; and {len(named) - MOST_NAMED} more"
    often = counted(len(named), "landing")
    values = {"recording": recording.name, "often": often, "places": places}
    return [Message("landings.untimed_landings", values)]


def cut_off(
    recordings: Sequence[Recording], tables: Sequence[pd.DataFrame]
) -> list[Message]:
    """Say how many landings are left out because a recording begins or ends in them.

    At the begin the feet are down already while the body still sinks. At the end too
    few frames follow to time a contact.

    Parameters
    ----------
    recordings : sequence of Recording
    tables : sequence of DataFrame
        The descents of each, of `hopdata.landings.contacts.find.find_study_landings`.
    """
    n_landings = 0
    places = []
    for recording, landings in zip(recordings, tables, strict=True):
        sides = _sides_cut_off(recording, landings)
        n_landings += len(sides)
        if sides:
            places.append(f"{recording.name} ({' and '.join(sides)})")
    if not places:
        return []
    listed = ", ".join(places[:MOST_NAMED])
    if len(places) > MOST_NAMED:
        listed += f" and {len(places) - MOST_NAMED} more"
    values = {"often": counted(n_landings, "landing"), "recordings": listed}
    return [Message("landings.cut_off", values)]


def _sides_cut_off(recording: Recording, landings: pd.DataFrame) -> list[str]:
    """Return at which ends of a recording a landing is cut off: begin, end."""
    cut = _cut_off(recording, landings)
    return [side for side, rows in cut.items() if rows.any()]


def _cut_off(recording: Recording, landings: pd.DataFrame) -> dict[str, BoolArray]:
    """Return which of L descents the begin of a recording cuts off, and its end."""
    feet = recording.names("foot")
    instants = landings[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    status = landings[[f"status_{foot}" for foot in feet]].to_numpy()
    is_untimed = np.isnan(instants).all(axis=1)
    # A descent of the body begins and ends with frames that show it.
    body = recording.positions[:, recording.indices("body"), 2]
    seen = recording.time[np.isfinite(body).any(axis=1)]
    if not len(seen):
        nowhere = np.zeros(len(landings), bool)
        return {"begin": nowhere, "end": nowhere}
    begins = landings["begin_s"].to_numpy() <= seen[0]
    ends = landings["end_s"].to_numpy() >= seen[-1]
    are_down = (status == descents.ALREADY_DOWN).all(axis=1)
    lack_frames = np.isin(status, (descents.THIN, descents.MISSING)).any(axis=1)
    return {
        "begin": is_untimed & begins & are_down,
        "end": is_untimed & ends & lack_frames,
    }


def hidden_contacts(recording: Recording, landings: pd.DataFrame) -> list[Message]:
    """Say which feet are hidden at their contacts, in how many landings, and when.

    Parameters
    ----------
    recording : Recording
    landings : DataFrame
        As of `landed`.
    """
    messages = []
    for foot in recording.names("foot"):
        status = landings[f"status_{foot}"].to_numpy()
        may_land = ~np.isin(status, (descents.ALREADY_DOWN, descents.NOT_LANDED))
        # A landing that only others show says nothing of a foot that no frame shows.
        unseen = ~may_land & _is_unseen(recording, landings, foot)
        elsewhere = may_land[~unseen]
        if elsewhere.sum() > LANDS_WITH_OTHERS * len(elsewhere):
            may_land |= unseen
        hidden = (status == descents.MISSING) | (unseen & may_land)
        if not hidden.any():
            continue
        values = {
            "recording": recording.name,
            "foot": foot,
            "hidden": int(hidden.sum()),
            "landings": int(may_land.sum()),
            "often": counted(int(may_land.sum()), "landing"),
            "from_s": float(landings.loc[hidden, "begin_s"].min()),
            "to_s": float(landings.loc[hidden, "end_s"].max()),
        }
        messages.append(Message("landings.contacts_hidden", values))
    return messages


def _is_unseen(recording: Recording, landings: pd.DataFrame, foot: str) -> BoolArray:
    """Mark the landings (L,) in which no frame about their contacts shows a foot."""
    feet = recording.names("foot")
    instants = landings[[f"contact_{other}_s" for other in feet]].to_numpy(float)
    before_s, after_s = (span_s * recording.time_scale for span_s in LONG_WINDOWS_S)
    first = np.searchsorted(recording.time, np.fmin.reduce(instants, axis=1) - before_s)
    stop = np.searchsorted(recording.time, np.fmax.reduce(instants, axis=1) + after_s)
    seen = np.isfinite(recording[foot][:, 2])
    count = np.concatenate([[0], np.cumsum(seen)])
    return np.asarray(count[stop] == count[first])


def contact_rows(recording: Recording, landings: pd.DataFrame) -> list[tuple[Any, ...]]:
    """Return the rows of `ContactTimes.table` of one recording."""
    rows = []
    feet = recording.names("foot")
    side_of = dict(zip(feet, sides_of(feet), strict=True))
    for number, landing in enumerate(landings.to_dict("records"), start=1):
        of_landing = []
        for foot in feet:
            status = int(landing[f"status_{foot}"])
            if status in (descents.ALREADY_DOWN, descents.NOT_LANDED):
                continue
            instant = landing[f"contact_{foot}_s"]
            is_found = status == descents.LANDED and np.isfinite(instant)
            se_s = landing[f"se_{foot}_s"]
            remark = ""
            marker = landing[f"marker_{foot}"]
            probability = landing[f"probability_{foot}"]
            if not is_found:
                marker = ""
                probability = np.nan
                code = REMARKS.get(status, "landings.contact_not_determined")
                remark = str(Message(code))
            elif se_s >= UNDETERMINED_S * recording.time_scale:
                remark = str(Message("landings.contact_without_kink"))
            of_landing.append(
                (
                    recording.name,
                    number,
                    foot,
                    side_of[foot],
                    marker,
                    probability,
                    instant,
                    se_s,
                    landing[f"common_{foot}_s"],
                    is_found,
                    remark,
                    *NO_PLATE,
                )
            )
        of_landing.sort(key=_in_time)
        rows += of_landing
    return rows


def _in_time(row: tuple[Any, ...]) -> float:
    """Return the contact of a row, s; those without one are last."""
    contact_s = row[COLUMNS.index("contact_s")]
    return float(np.nan_to_num(contact_s, nan=np.inf))


def order_table(rows: list[tuple[Any, ...]]) -> pd.DataFrame:
    """Return the rows as a table in which ``sure`` may be missing."""
    table = pd.DataFrame(rows, columns=list(ORDER_COLUMNS))
    return table.astype({"sure": "boolean"})


def order_rows(
    recording: Recording, landings: pd.DataFrame, sure: float
) -> list[tuple[Any, ...]]:
    """Return the rows of `ContactTimes.orders` of one recording."""
    feet = recording.names("foot")
    rows = []
    for number, landing in enumerate(landings.to_dict("records"), start=1):
        timed = [
            foot
            for foot in feet
            if landing[f"status_{foot}"] == descents.LANDED
            and np.isfinite(landing[f"contact_{foot}_s"])
        ]
        may_have_landed = [
            foot
            for foot in feet
            if landing[f"status_{foot}"] in REMARKS and foot not in timed
        ]
        instants = np.array([[landing[f"contact_{foot}_s"] for foot in timed]])
        errors = np.array([[landing[f"se_{foot}_s"] for foot in timed]])
        order = _Order.of(instants, errors, timed)
        is_sure = None
        if np.isfinite(order.probability):
            is_sure = bool(order.probability >= sure and not may_have_landed)
        every = [landing[f"contact_{foot}_s"] for foot in feet]
        rows.append(
            (
                recording.name,
                number,
                float(np.fmin.reduce([landing["begin_s"], *every])),
                float(np.fmax.reduce([landing["end_s"], *every])),
                len(timed),
                order.name,
                order.probability,
                order.other_name,
                order.other_probability,
                is_sure,
            )
        )
    return rows


@dataclass(frozen=True)
class _Order:
    """The most probable order of some contacts, and the next."""

    name: str
    probability: float
    other_name: str
    other_probability: float

    @classmethod
    def of(cls, instants: FloatArray, errors: FloatArray, feet: list[str]) -> _Order:
        """Return the order of the contacts (1, n) of these n feet, s."""
        named = schedules.contact_order(instants)[0]
        name = _chain(named, feet)
        if len(feet) < 2:
            return cls(name, float("nan"), "", float("nan"))
        probability = schedules.order_probability(instants, errors)
        other, of_other = schedules.runner_up(instants, errors)
        return cls(
            name, float(probability[0]), _chain(other[0], feet), float(of_other[0])
        )


def _chain(order: Any, feet: list[str]) -> str:
    """Return the names of feet in an order, as ``left > right``."""
    return " > ".join(feet[foot] for foot in order)
