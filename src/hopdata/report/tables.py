"""The tables of the page, and its statements on the quality of the data."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import counted, with_names
from hopdata.feet import foot_names, with_foot_names
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.report import formatting as show
from hopdata.report.inputs import count_feet
from hopdata.report.scene import small_plot

# Recordings, floor, sections and touchdowns.

SECTION_NAMES = show.WORDS["sections"]
LEVERAGE_NAMES = {"usual": "time per mm of height", "large": "its 95 % quantile"}
DETAIL_NAMES = show.WORDS["details"]

# Most rows, or columns, of a table.
MOST_SCHEDULES = 24
MOST_RECORDINGS = 6
MOST_GAPPY = 24
MOST_LAGS = 24


def recordings_table(
    recordings: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any] | None = None
) -> show.Table | None:
    """Return one row per recording: its source, its duration and how much was seen."""
    columns: show.Columns = {
        "recording": show.text("name"),
        "source": show.text("source"),
        "frames": show.counted("n_frames"),
        "duration (s)": show.decimals("duration_s", 1),
        "rate (Hz)": lambda item: show.significant(item.get("rate_hz"), 4),
        "feet": lambda item: show.count(count_feet(item, provenance)),
        "foot markers": show.counted("n_feet"),
        "body markers": show.counted("n_body"),
        "seen (%)": show.decimals("seen", 2, 100),
    }
    return show.table_of("Recordings", recordings, columns, text_columns=2)


def filled_table(
    filled: pd.DataFrame | None, touchdowns: pd.DataFrame | None = None
) -> show.Table | None:
    """Return one row per marker with gaps, the least seen first; None without gaps."""
    if filled is None:
        return None
    gappy = filled[filled["gaps"] > 0].sort_values(
        "missing", ascending=False, kind="stable"
    )
    columns: show.Columns = {
        "recording": show.text("recording"),
        "marker": show.text("marker"),
        "part": show.text("role"),
        "gaps": show.counted("gaps"),
        "longest (s)": show.decimals("longest_s", 2),
        "frames missing": show.counted("missing"),
        "missing (%)": lambda row: show.fixed(100 * row["missing"] / row["frames"], 2),
        "filled in": show.counted("filled"),
        "left": show.counted("left"),
    }
    more: Message | str = ""
    if len(gappy) > MOST_GAPPY:
        more = Message("report.more_gaps", {"count": len(gappy) - MOST_GAPPY})
    values = {
        "filled": show.count(gappy["filled"].sum()),
        "missing": show.count(gappy["missing"].sum()),
        "resting": _resting(touchdowns),
        "more": more,
    }
    note = Message("report.filled_note", values)
    rows = show.records(gappy)[:MOST_GAPPY]
    title = "Gaps, and how much of them was filled"
    return show.table_of(title, rows, columns, text_columns=3, note=note)


def _resting(touchdowns: pd.DataFrame | None) -> Message | str:
    """Say how many of the touchdowns used depend on positions that were filled in."""
    if touchdowns is None or "filled_share" not in touchdowns:
        return ""
    used = touchdowns[~excluded(touchdowns)]
    values = {
        "resting": show.count((used["filled_share"] > 0).sum()),
        "used": show.count(len(used)),
    }
    return Message("report.resting", values)


def floor_table(floors: Mapping[str, Mapping[str, Any]]) -> show.Table | None:
    """Return one row per recording: the floor model and its residuals."""
    columns: show.Columns = {
        "recording": show.text("recording"),
        "degree": show.counted("degree"),
        "rest points": show.counted("n_points"),
        "outliers": show.counted("n_outliers"),
        "residual (mm)": show.decimals("residual_rms_m", 2, 1e3),
        "feet differ by (mm)": _spread_of_feet,
    }
    rows = []
    notes = []
    for name, floor in floors.items():
        rows.append({"recording": name, **floor})
        if floor.get("note"):
            notes.append(f"{name}: {floor['note']}")
    return show.table_of("Floor", rows, columns, note="; ".join(notes))


def _spread_of_feet(floor: Mapping[str, Any]) -> str:
    offsets_m = floor.get("foot_offsets_m") or ()
    known = [offset for offset in offsets_m if not show.is_missing(offset)]
    if not known:
        return show.MISSING
    return show.fixed((max(known) - min(known)) * 1e3, 2)


def sections_table(
    sections: Mapping[str, Any] | None, *, is_levelled: bool = False
) -> show.Table | None:
    """Return thresholds, sections and the travel between them, then all else.

    On a floor that was levelled it is said what heights are above.
    """
    if not sections:
        return None
    decided = sections.get("chosen_by") or {}
    rows = []
    for key, name in SECTION_NAMES.items():
        decided_by = show.WORDS["decided"].get(decided.get(key, "data"), "")
        height = show.fixed(show.scaled(sections.get(key), 1e3), 2)
        rows.append((f"{name}{decided_by}", height, "mm"))
    pre_m = sections.get("pre_height_m")
    post_m = sections.get("post_height_m")
    if pre_m is not None and post_m is not None:
        travel = show.fixed((pre_m - post_m) * 1e3, 2)
        rows.append(("travel from pre to post", travel, "mm"))
    rows += _leverage_rows(sections.get("instant_shift_s_m") or {})
    said = (*SECTION_NAMES, "chosen_by", "instant_shift_s_m")
    others = {key: value for key, value in sections.items() if key not in said}
    for key, value in show.flat(others):
        if value == []:
            continue
        words, text, unit = show.labelled(key, value)
        rows.append((DETAIL_NAMES.get(key, words), text, unit))
    head = ("quantity", "value", "unit")
    note = Message("report.sections_zero") if is_levelled else ""
    return show.Table("Thresholds and sections", head, tuple(rows), note=note)


def _leverage_rows(leverage: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return by how many ms a height that is wrong by 1 mm shifts a passage."""
    rows = []
    for side in ("pre", "post"):
        of_side = leverage.get(side) or {}
        for which, words in LEVERAGE_NAMES.items():
            s_per_m = of_side.get(which)
            if s_per_m is not None:
                name = f"{words}, {side} section"
                rows.append((name, show.fixed(s_per_m, 2), "ms"))
    return rows


def schedules_table(touchdowns: pd.DataFrame | None) -> show.Table | None:
    """Return one row per mode schedule: its used touchdowns, and their spread."""
    if touchdowns is None or touchdowns.empty:
        return None
    used = touchdowns[~excluded(touchdowns)]
    by_schedule = [(str(name), group) for name, group in used.groupby("schedule")]
    by_schedule.sort(key=lambda item: (-len(item[1]), item[0]))  # commonest first
    names = foot_names(touchdowns.columns)
    rows = []
    for schedule, group in by_schedule[:MOST_SCHEDULES]:
        row = (
            with_foot_names(schedule, names),
            show.count(len(group)),
            show.count((group["order_class"] == "ambiguous").sum()),
            show.fixed(100 * len(group) / len(used), 1),
            show.fixed(1e3 * group["spread_s"].median(), 2),
            show.fixed(group["probability"].mean(), 3),
        )
        rows.append(row)
    head = (
        "order of contacts",
        "touchdowns",
        "of them ambiguous",
        "share (%)",
        "median spread of contacts (sd, ms)",
        "mean probability of the order",
    )
    rarer = [len(group) for _, group in by_schedule[MOST_SCHEDULES:]]
    note: Message | str = ""
    if rarer:
        values = {
            "orders": counted(len(rarer), "rarer order"),
            "landings": counted(sum(rarer), "touchdown"),
            "most": max(rarer),
        }
        note = Message("report.rarer", values)
    return show.Table("Used touchdowns by mode schedule", head, tuple(rows), note=note)


def study_lags_table(lags: pd.DataFrame | None) -> show.Table | None:
    """Return the first `MOST_LAGS` lags of a study; a note counts the rest."""
    rows = show.records(lags)
    more: Message | str = ""
    if len(rows) > MOST_LAGS:
        values = {"count": len(rows) - MOST_LAGS, "file": "lags"}
        more = Message("report.more_rows", values)
    return lags_table(rows[:MOST_LAGS], Message("report.lags_note", {"more": more}))


def lags_table(
    rows: Sequence[Mapping[str, Any]], note: Message | str
) -> show.Table | None:
    """Return a line for each two feet that land together, None if there are none.

    `rows` are those of `hopdata.landings.contact_lags.lag_table`.
    """
    columns: show.Columns = {
        "lag": lambda row: f"{row['foot']} minus {row['other']}",
        "landings": show.counted("landings"),
        "mean (ms)": show.decimals("mean_s", 2, 1e3),
        "from (ms)": show.decimals("low_s", 2, 1e3),
        "to (ms)": show.decimals("high_s", 2, 1e3),
        "standard error (ms)": show.decimals("se_s", 2, 1e3),
        "common error (ms)": show.decimals("common_s", 2, 1e3),
        "median |lag| (ms)": show.decimals("median_abs_s", 2, 1e3),
        "sd (ms)": show.decimals("sd_s", 2, 1e3),
    }
    return show.table_of("Lags of the feet", rows, columns, note=note)


def exclusions_table(touchdowns: pd.DataFrame | None) -> show.Table | None:
    """Count unused descents by reason, and by recording if there are few recordings."""
    if touchdowns is None or touchdowns.empty or not excluded(touchdowns).any():
        return None
    out = _left_out(touchdowns)
    reasons = out["reason"].replace("", "no reason given")
    columns = [str(name) for name in dict.fromkeys(touchdowns["recording"])]
    if not 1 < len(columns) <= MOST_RECORDINGS:
        columns = []
    recordings = out["recording"].astype(str)
    parts = [
        (str(name), recordings[reasons == name])
        for name in reasons.value_counts().index
    ]
    parts.append(("all reasons", recordings))
    rows = []
    for reason, part in parts:
        in_each = [show.count((part == name).sum()) for name in columns]
        rows.append((reason, *in_each, show.count(len(part))))
    head = ("reason", *columns, "descents")
    return show.Table("Why descents are not used", head, tuple(rows))


def _left_out(touchdowns: pd.DataFrame) -> pd.DataFrame:
    """Return descents not used, landings first, with names of feet in the reasons."""
    unused = touchdowns[excluded(touchdowns)]
    landings_first = (unused["reason"] == NO_FOOT_LANDED).argsort(kind="stable")
    out = unused.iloc[landings_first]
    reasons = out["reason"].astype(object).fillna("").astype(str)
    return out.assign(reason=[with_names(one, touchdowns) for one in reasons])


# What is said of landings that the verdict left out, by the reason in its file.
FAR_OFF = {
    "markers_apart": "report.far_off_markers_apart",
    "state_far_off": "report.far_off_state",
    "contacts_far_off": "report.far_off_contacts",
    "outcome_far_off": "report.far_off_outcome",
}


def _with_far_off(
    unused: pd.DataFrame,
    touchdowns: pd.DataFrame,
    far_off: Sequence[Mapping[str, Any]],
) -> pd.DataFrame:
    """Return landings that are not used after those that are used, but not judged."""
    if not far_off:
        return unused
    reasons = {}
    for one in far_off:
        why = Message(FAR_OFF[one["reason"]])
        said = str(Message("report.far_off", {"why": why}))
        reasons[str(one["recording"]), int(one["touchdown"])] = said
    names = [
        (str(recording), int(number))
        for recording, number in zip(
            touchdowns["recording"], touchdowns["touchdown"], strict=True
        )
    ]
    named = touchdowns[[name in reasons for name in names]]
    told = [reasons[name] for name in names if name in reasons]
    return pd.concat([named.assign(reason=told), unused])


def excluded(touchdowns: pd.DataFrame) -> pd.Series:
    """Return whether each touchdown was excluded; booleans may have become text."""
    return touchdowns["excluded"].astype(str).str.lower().isin(("true", "1", "1.0"))


# Tables of prediction, distances, accuracy and time.

MODEL_NAMES = show.WORDS["models"]
KIND_NAMES = show.WORDS["kinds"]
# Measures that are shares of the map.
SHARES = ("recorded_true_effect", "verdict_true_effect", "verdict_effect")
COUNTED = ("landings", "touchdowns")
SHOWN_ELSEWHERE = ("study", "config", "inputs", "versions", "stage_seconds")


def prediction_table(summary: pd.DataFrame | None) -> show.Table | None:
    """Return one row per model, in the printed order, including those not fitted."""
    rows = _in_order(summary, "model", MODEL_NAMES)
    scale, power = show.common_scale([row.get("median_mse") for row in rows])
    columns: show.Columns = {
        "model": lambda row: MODEL_NAMES.get(row["model"], str(row["model"])),
        "classes": show.counted("n_classes"),
        "train": show.counted("n_train"),
        "test": show.counted("n_test"),
        show.percent(2.5): show.decimals("p2_5", 2, 1 / scale),
        show.percent(25): show.decimals("q25", 2, 1 / scale),
        "median": show.decimals("median_mse", 2, 1 / scale),
        show.percent(75): show.decimals("q75", 2, 1 / scale),
        show.percent(97.5): show.decimals("p97_5", 2, 1 / scale),
        "worst position (mm)": show.decimals("worst_position_mm", 1),
        "worst velocity (m/s)": show.decimals("worst_velocity_m_s", 3),
    }
    note: Message = Message("report.prediction_note", {"power": power})
    if any(len(row) == 1 for row in rows):  # a model with only its name
        note = Message("report.not_fitted", {"note": note})
    return show.table_of("Prediction errors", rows, columns, note=note)


def distances_table(summary: pd.DataFrame | None) -> show.Table | None:
    """Return one row per kind of distance, including kinds without pairs."""
    columns: show.Columns = {
        "subspaces": lambda row: KIND_NAMES.get(row["kind"], str(row["kind"])),
        "pairs": lambda row: show.count(row.get("n", 0)),
        "mean": show.decimals("mean_distance", 3),
        "sd": show.decimals("sd", 3),
        show.percent(5): show.decimals("q05", 3),
        show.percent(25): show.decimals("q25", 3),
        "median": show.decimals("median_distance", 3),
        show.percent(75): show.decimals("q75", 3),
        show.percent(95): show.decimals("q95", 3),
        "AUC": show.decimals("auc_against_in_class", 3),
    }
    note = Message("report.arc_lengths")
    rows = _in_order(summary, "kind", KIND_NAMES)
    return show.table_of("Arc-length distances", rows, columns, note=note)


def _in_order(
    summary: pd.DataFrame | None, key: str, names: Mapping[str, str]
) -> list[show.Row]:
    """Return a row for each name, in the printed order; a missing one has no more."""
    found = {str(row[key]): row for row in show.records(summary)}
    if not found:
        return []
    names_of_all = dict.fromkeys((*names, *found))
    return [{**found.get(name, {}), key: name} for name in names_of_all]


def truth_table(truth: Mapping[str, Mapping[str, Any]] | None) -> show.Table | None:
    """Return one row per measure: the result compared with what the simulator knew."""
    rows = []
    for name, entry in (truth or {}).items():
        what = str(entry.get("what") or name)
        value, unit = _measured(name, entry)
        rows.append((_capital(what), value, unit))
    if not rows:
        return None
    head = ("quantity", "value", "unit")
    return show.Table("Estimates and truth", head, tuple(rows))


def _measured(name: str, entry: Mapping[str, Any]) -> tuple[str, str]:
    """Return value and unit as elsewhere on the page: lengths in mm, shares in %."""
    value = entry.get("value")
    unit = str(entry.get("unit") or "")
    if name.startswith("labels_right_"):
        return show.fixed(show.scaled(value, 100), 1), "%"
    if name in SHARES and value is not None:
        # Rounding leaves some 1e-16 of a difference that does not exist.
        return show.significant(round(100 * value, 6)), "%"
    if unit == "m":
        return show.plain(show.scaled(value, 1e3)), "mm"
    if unit in COUNTED:
        return show.count(value), unit
    if unit in ("1", "yes/no"):
        return show.plain(value), ""
    return show.plain(value), unit


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def times_table(seconds: Mapping[str, Any]) -> show.Table | None:
    """Return the time of each job, longest first."""
    ordered = sorted(seconds.items(), key=lambda item: -float(item[1]))
    rows = tuple((name, show.fixed(value, 2)) for name, value in ordered)
    if not rows:
        return None
    return show.Table("Time per job", ("job", "time (s)"), rows)


def record_tables(record: Mapping[str, Any]) -> dict[str, show.Table | None]:
    """Return tables of `provenance.json`: origin of a run, inputs, versions, times."""
    others = {key: value for key, value in record.items() if key not in SHOWN_ELSEWHERE}
    digests = record.get("inputs") or {}
    versions = record.get("versions") or {}
    return {
        "origin": show.mapping_table("Run", ("what", "value"), others),
        "digests": show.mapping_table("Inputs", ("source file", "SHA-256"), digests),
        "versions": show.mapping_table("Versions", ("package", "version"), versions),
        "times": times_table(record.get("stage_seconds") or {}),
    }


# Tables of the contacts known from other sources.

MOST_UNMATCHED = 60
UNMATCHED = ("missed", "invented")
AGREEMENT: show.Columns = {
    "recording": show.text("recording"),
    "column": show.text("column"),
    "feet": show.text("feet"),
    "known": show.counted("n_external"),
    "matched": show.counted("n_matched"),
    "of these excluded": show.counted("n_excluded"),
    "missed": show.counted("n_missed"),
    "invented": show.counted("n_invented"),
    "of other feet": show.counted("n_other_foot"),
    "not compared": show.counted("n_not_compared"),
    "bias (ms)": show.decimals("bias_s", 2, 1e3),
    "95 % interval (ms)": lambda row: (
        f"{_ms(row['bias_low_s'])} to {_ms(row['bias_high_s'])}"
    ),
    "clock drift (ms)": show.decimals("drift_s", 1, 1e3),
    "robust sd (ms)": show.decimals("robust_sd_s", 2, 1e3),
    "largest deviation from bias (ms)": show.decimals("largest_s", 2, 1e3),
    "error of the other device (ms)": show.decimals("external_se_s", 2, 1e3),
    "scatter / standard error": show.decimals("scatter_over_se", 2),
}


def agreement_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return one row per column and recording: counts, bias with interval, scatter."""
    rows = show.records(overlay.get("contact_overlay_summary"))
    note = Message("report.agreement")
    title = "Agreement of the contacts"
    return show.table_of(title, rows, AGREEMENT, text_columns=3, note=note)


def unmatched_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return every contact that was missed or invented, and the reason if known."""
    contacts = overlay.get("contact_overlay")
    if contacts is None:
        return None
    out = contacts[contacts["status"].isin(UNMATCHED)]
    columns: show.Columns = {
        "recording": show.text("recording"),
        "column": show.text("column"),
        "contact": show.text("status"),
        "descent": show.counted("touchdown"),
        "reason": show.text("reason"),
        "time (s)": _time_of_unmatched,
    }
    title = "Contacts missed or invented"
    file = "contact_overlay"
    return show.first_rows(title, out, columns, MOST_UNMATCHED, file, texts=5)


def _time_of_unmatched(row: show.Row) -> str:
    if row["status"] == "missed":
        return show.fixed(row["external_s"], 3)
    return show.fixed(row["found_s"], 3)


def thresholds_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return bias and scatter as functions of the force threshold."""
    columns: show.Columns = {
        "recording": show.text("recording"),
        "column": show.text("column"),
        "threshold": lambda row: show.significant(row["threshold"], 3),
        "unit": lambda row: str(row["unit"]).replace("body_weight", "body weights"),
        "missed": show.counted("n_missed"),
        "invented": show.counted("n_invented"),
        "bias (ms)": show.decimals("bias_s", 2, 1e3),
        "robust sd (ms)": show.decimals("robust_sd_s", 2, 1e3),
    }
    rows = show.records(overlay.get("contact_overlay_thresholds"))
    title = "Agreement at other force thresholds"
    return show.table_of(title, rows, columns, text_columns=2)


def own_devices_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return one row per note on force plates and events in a recording's own file."""
    columns = {"recording": show.text("recording"), "note": show.text("note")}
    rows = show.records(overlay.get("contact_overlay_notes"))
    title = "Force plates and events of the files"
    return show.table_of(title, rows, columns, text_columns=2)


def _ms(value: Any) -> str:
    return show.fixed(show.scaled(value, 1e3), 2)


# The quality of the data: checks, faults, and every touchdown that was left out.

Checks = Sequence[Mapping[str, Any]]

# Between the folders of a path, on any system.
FOLDERS = r"[/\\]"
# Status of a check: as it is shown.
STATUS = {
    "good": f"●{show.NO_BREAK_SPACE}good",
    "look": f"◐{show.NO_BREAK_SPACE}look",
    "poor": f"○{show.NO_BREAK_SPACE}poor",
    "not known": f"–{show.NO_BREAK_SPACE}not known",
    "not asked": f"–{show.NO_BREAK_SPACE}not asked",
}
# The statuses that are judged, from the best to the worst.
JUDGED = ("good", "look", "poor")
# Nothing was configured to compare with, so there is nothing to judge.
NOT_ASKED = "not asked"
MOST_FAULTS = 30
MOST_EXCLUDED = 500
# The reason in the table of touchdowns.
NO_FOOT_LANDED = Message("landings.no_foot_landed").text()


def quality_summary(checks: Checks | None) -> tuple[str | None, str]:
    """Say how many checks are good and poor, and list those not good, worst first."""
    asked = [check for check in checks or () if check["status"] != NOT_ASKED]
    if not asked:
        return None, ""
    counts = Counter(str(check["status"]) for check in asked)
    summary = f"{counts['good']} of {len(asked)} good"
    if counts["poor"]:
        summary += f", {counts['poor']} poor"
    not_good = []
    for status in ("poor", "look", "not known"):
        for check in asked:
            if check["status"] == status:
                not_good.append(f"{status}: {check['what']}")
    return summary, "; ".join(not_good)


def quality_table(checks: Checks | None) -> show.Table | None:
    """Return one row per check: the value found, and the limits for good and poor."""
    columns: show.Columns = {
        "check": lambda check: str(check["what"]),
        "status": lambda check: STATUS.get(str(check["status"]), str(check["status"])),
        "remark": lambda check: str(check["remark"]),
        "found": lambda check: show.with_unit(
            show.significant(check["value"], 3), str(check["unit"])
        ),
        "good": lambda check: _limits(check)[0],
        "poor": lambda check: _limits(check)[1],
    }
    return show.table_of(
        "Can these data be trusted?", checks or (), columns, text_columns=3
    )


def _limits(check: Mapping[str, Any]) -> tuple[str, str]:
    """Return the limits for good and for poor, in words."""
    good = float(check["good"])
    poor = float(check["poor"])
    unit = str(check["unit"])
    good_limit = show.with_unit(f"{good:g}", unit)
    poor_limit = show.with_unit(f"{poor:g}", unit)
    if good > poor:
        return f"≥ {good_limit}", f"< {poor_limit}"
    if good == 0.0:  # nothing is below it
        return good_limit, f"> {poor_limit}"
    return f"≤ {good_limit}", f"> {poor_limit}"


def faults_table(faults: pd.DataFrame | None) -> show.Table | None:
    """Return one row per fault of the recordings, the first thirty."""
    columns = {
        "recording": show.text("recording"),
        "fault": show.text("kind"),
        "marker": show.text("marker"),
        "remark": show.text("remark"),
        "from (s)": show.decimals("start_s", 2),
        "to (s)": show.decimals("stop_s", 2),
    }
    title = "Faults of the recordings"
    return show.first_rows(title, faults, columns, MOST_FAULTS, "faults", texts=4)


def remarks_table(remarks: pd.DataFrame | None) -> show.Table | None:
    """Return one row per remark: what was guessed or corrected, the first thirty."""
    columns: show.Columns = {
        "recording": show.text("recording"),
        "remark": lambda row: _without_folder(str(row["remark"])),
    }
    title = "Remarks on the recordings"
    return show.first_rows(title, remarks, columns, MOST_FAULTS, "remarks", texts=2)


def _without_folder(remark: str) -> str:
    """Return a remark that begins with the path of a file with the file's name only."""
    path, colon, rest = remark.partition(": ")
    return f"{re.split(FOLDERS, path)[-1]}{colon}{rest}"


def lights(checks: Checks | None) -> list[tuple[str, str, str]]:
    """Return the subjects of the checks, with the worst status of each, in short.

    Each names the checks with this status, and those that could not be judged. Their
    remarks are in the table. A subject of which nothing was judged has no light.
    """
    shown = []
    for name in dict.fromkeys(str(check["about"]) for check in checks or ()):
        own = [check for check in checks or () if check["about"] == name]
        judged = [check for check in own if check["status"] in JUDGED]
        if not judged:
            continue
        worst = max(judged, key=lambda check: JUDGED.index(str(check["status"])))
        status = str(worst["status"])
        told = [counted(len(judged), "check")]
        if status != "good":
            told = [str(one["what"]) for one in judged if one["status"] == status]
        open_ones = [str(one["what"]) for one in own if one["status"] not in JUDGED]
        if open_ones:
            told.append(f"not judged: {', '.join(open_ones)}")
        shown.append((name, STATUS[status], "; ".join(told)))
    return shown


def excluded_table(
    touchdowns: pd.DataFrame | None,
    levelled: Sequence[Recording] = (),
    far_off: Sequence[Mapping[str, Any]] = (),
) -> show.Table | None:
    """Return one row per landing not used, with its reason and its feet's heights.

    Descents in which no foot of the study landed are counted alone. Landings that only
    the verdict left out (`far_off` of ``verdict.json``) come first.
    """
    from markupsafe import Markup

    by_name = {recording.name: recording for recording in levelled}
    out = None
    n_others = 0
    if touchdowns is not None:
        every = _left_out(touchdowns)
        landed = every["reason"] != NO_FOOT_LANDED
        n_others = int((~landed).sum())
        out = _with_far_off(every[landed], touchdowns, far_off)
    columns: dict[str, show.Cell] = {
        "recording": show.text("recording"),
        "reason": show.text("reason"),
        "descent": show.counted("touchdown"),
        "time (s)": show.decimals("t_pre_s", 2),
    }
    if by_name:
        columns["feet, coloured as in 3-D, and when they touched"] = lambda row: Markup(
            small_plot(by_name.get(str(row["recording"])), row)
        )
    title = "Every landing that is not used"
    table = show.first_rows(title, out, columns, MOST_EXCLUDED, "touchdowns", texts=2)
    if table is None or not n_others:
        return table
    values = {"descents": counted(n_others, "descent"), "reason": NO_FOOT_LANDED}
    note = f"{table.note} {Message('report.not_landings', values)}".strip()
    return replace(table, note=note)
