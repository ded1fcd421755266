"""Tables of recordings, floor, sections and touchdowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hopdata.report.formatting import MISSING, count, fixed, is_missing, labelled, significant
from hopdata.report.table import Table, flat, scaled

if TYPE_CHECKING:
    import pandas as pd

SECTION_NAMES = {
    "min_foot_threshold_m": "threshold of the minimum foot height",
    "max_foot_threshold_m": "threshold of the maximum foot height",
    "pre_height_m": "pre section",
    "post_height_m": "post section",
}
DETAIL_NAMES = {
    "ground_m": "ground mode of all feet",
    "min_foot_mode height_m": "ground mode of the minimum foot height",
    "min_foot_mode sigma_m": "its scatter",
    "min_foot_mode bandwidth_m": "bandwidth that it was found with",
    "max_foot_mode height_m": "ground mode of the maximum foot height",
    "max_foot_mode sigma_m": "its scatter",
    "max_foot_mode bandwidth_m": "bandwidth that it was found with",
    "threshold_sigmas": "scatters from a mode to its threshold",
    "tail_fraction": "tail on the wrong side of a section",
    "frames": "kind of frames used",
    "n_frames": "frames in which all markers are seen",
    "n_used": "frames that the sections are made from",
}
MOST_SCHEDULES = 24
MOST_RECORDINGS = 6
MOST_GAPPY = 24


def recordings_table(recordings: Sequence[Mapping[str, Any]]) -> Table | None:
    """One row a recording: where it is from, how long it is and how much of it was seen."""
    rows = tuple(
        (
            str(item.get("name", MISSING)),
            str(item.get("source") or MISSING),
            count(item.get("n_frames")),
            fixed(item.get("duration_s"), 1),
            significant(item.get("rate_hz"), 4),
            count(item.get("n_feet")),
            count(item.get("n_body")),
            fixed(scaled(item.get("seen"), 100), 2),
        )
        for item in recordings
    )
    head = ("recording", "source", "frames", "duration (s)", "rate (Hz)", "feet", "body markers")
    return Table("Recordings", (*head, "seen (%)"), rows, text_columns=2) if rows else None


def filled_table(
    filled: pd.DataFrame | None, touchdowns: pd.DataFrame | None = None
) -> Table | None:
    """One row a marker with gaps, those most often unseen first; None if there are no gaps."""
    if filled is None or filled.empty or not (filled["gaps"] > 0).any():
        return None
    gappy = filled[filled["gaps"] > 0].sort_values("missing", ascending=False, kind="stable")
    rows = tuple(
        (
            str(row["recording"]),
            str(row["marker"]),
            str(row["role"]),
            count(row["gaps"]),
            fixed(row["longest_s"], 2),
            count(row["missing"]),
            fixed(100 * row["missing"] / row["frames"], 2),
            count(row["filled"]),
            count(row["left"]),
        )
        for row in gappy[:MOST_GAPPY].to_dict("records")
    )
    total = f"Of {count(gappy['missing'].sum())} missing places {count(gappy['filled'].sum())} were"
    shown = (
        "" if len(gappy) <= MOST_GAPPY else f"; {len(gappy) - MOST_GAPPY} more in tables/filled.csv"
    )
    head = ("recording", "marker", "part", "gaps", "longest (s)", "frames missing", "missing (%)")
    note = f"{total} filled in{_resting(touchdowns)}{shown}."
    return Table(
        "Gaps and what was filled of them",
        (*head, "filled in", "left"),
        rows,
        text_columns=3,
        note=note,
    )


def _resting(touchdowns: pd.DataFrame | None) -> str:
    """Say how many of the touchdowns used rest on places that were filled in."""
    if touchdowns is None or "filled_share" not in touchdowns:
        return ""
    used = touchdowns[~excluded(touchdowns)]
    resting = count((used["filled_share"] > 0).sum())
    return f"; {resting} of {count(len(used))} touchdowns used rest on some of these"


def floor_table(floors: Mapping[str, Mapping[str, Any]]) -> Table | None:
    """One row a recording: the floor model and what it leaves."""
    rows = tuple((name, *_floor_cells(floor)) for name, floor in floors.items())
    head = (
        "recording",
        "degree",
        "rest points",
        "outliers",
        "residual (mm)",
        "feet differ by (mm)",
    )
    notes = [f"{name}: {floor['note']}" for name, floor in floors.items() if floor.get("note")]
    return Table("Floor", head, rows, note="; ".join(notes)) if rows else None


def _floor_cells(floor: Mapping[str, Any]) -> tuple[str, ...]:
    offsets = [value for value in floor.get("foot_offsets_m") or () if not is_missing(value)]
    return (
        count(floor.get("degree")),
        count(floor.get("n_points")),
        count(floor.get("n_outliers")),
        fixed(scaled(floor.get("residual_rms_m"), 1e3), 2),
        fixed((max(offsets) - min(offsets)) * 1e3, 2) if offsets else MISSING,
    )


def sections_table(sections: Mapping[str, Any] | None) -> Table | None:
    """Thresholds, sections and the travel between them first, then all else in the file."""
    if not sections:
        return None
    decided = sections.get("decided") or {}
    rows = [
        (_decided(name, decided.get(key)), fixed(scaled(sections.get(key), 1e3), 2), "mm")
        for key, name in SECTION_NAMES.items()
    ]
    pre, post = sections.get("pre_height_m"), sections.get("post_height_m")
    if pre is not None and post is not None:
        rows.append(("travel from pre to post", fixed((pre - post) * 1e3, 2), "mm"))
    shown = {*SECTION_NAMES, "decided"}
    others = flat({key: value for key, value in sections.items() if key not in shown})
    for key, value in others:
        words, text, unit = labelled(key, value)
        rows.append((DETAIL_NAMES.get(key, words), text, unit))
    return Table("Thresholds and sections", ("quantity", "value", "unit"), tuple(rows))


def _decided(name: str, by: Any) -> str:
    return f"{name} (from the configuration)" if by == "config" else name


def schedules_table(touchdowns: pd.DataFrame | None) -> Table | None:
    """One row a mode schedule: its used touchdowns and the spread of their contacts."""
    if touchdowns is None or touchdowns.empty:
        return None
    used = touchdowns[~excluded(touchdowns)]
    groups = sorted(used.groupby("schedule"), key=lambda item: (-len(item[1]), str(item[0])))
    rows = [
        (
            str(schedule).replace(">", " → "),
            count(len(group)),
            count((group["class"] == "ambiguous").sum()) if "class" in group else MISSING,
            fixed(100 * len(group) / len(used), 1),
            fixed(scaled(_median(group, "spread_s"), 1e3), 2),
            fixed(_mean(group, "probability"), 3),
        )
        for schedule, group in groups[:MOST_SCHEDULES]
    ]
    head = ("order of contacts", "touchdowns", "of them ambiguous", "share (%)")
    rarer = [len(group) for _, group in groups[MOST_SCHEDULES:]]
    note = ""
    if rarer:
        orders = "1 rarer order is" if len(rarer) == 1 else f"{len(rarer)} rarer orders are"
        left = "1 touchdown" if sum(rarer) == 1 else f"{sum(rarer)} touchdowns"
        note = f"{orders} not listed: {left}, at most {max(rarer)} each."
    medians = ("median spread of contacts (ms)", "mean probability of the order")
    return Table("Used touchdowns by mode schedule", (*head, *medians), tuple(rows), note=note)


def exclusions_table(touchdowns: pd.DataFrame | None) -> Table | None:
    """Descents that are not used by reason, and by recording where these are few."""
    if touchdowns is None or touchdowns.empty or not excluded(touchdowns).any():
        return None
    out = touchdowns[excluded(touchdowns)]
    reasons = out["reason"].astype(object).fillna("").replace("", "no reason given")
    names = [str(name) for name in dict.fromkeys(touchdowns["recording"])]
    shown = names if 1 < len(names) <= MOST_RECORDINGS else []
    rows = []
    for reason, total in reasons.value_counts().items():
        of_reason = out.loc[reasons == reason, "recording"].astype(str)
        each = tuple(count((of_reason == name).sum()) for name in shown)
        rows.append((str(reason), *each, count(total)))
    each = tuple(count((out["recording"].astype(str) == name).sum()) for name in shown)
    rows.append(("all reasons", *each, count(len(out))))
    return Table("Descents that are not used", ("reason", *shown, "descents"), tuple(rows))


def excluded(touchdowns: pd.DataFrame) -> pd.Series:
    """Whether each touchdown was excluded, also where CSV made text of the booleans."""
    return touchdowns["excluded"].astype(str).str.lower().isin(("true", "1", "1.0"))


def _mean(group: pd.DataFrame, column: str) -> float | None:
    return float(group[column].mean()) if column in group else None


def _median(group: pd.DataFrame, column: str) -> float | None:
    return float(group[column].median()) if column in group else None
