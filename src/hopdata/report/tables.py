"""The tables of the page, and its statements on the quality of the data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import counted, with_names
from hopdata.recording import Recording
from hopdata.report import formatting as show
from hopdata.report.scene import small_plot

# Recordings, floor, sections and touchdowns.

SECTION_NAMES, DETAIL_NAMES = show.WORDS["sections"], show.WORDS["details"]
MOST_SCHEDULES = 24
MOST_RECORDINGS = 6
MOST_GAPPY = 24


def recordings_table(recordings: Sequence[Mapping[str, Any]]) -> show.Table | None:
    """Return one row per recording: its source, its duration and how much of it was seen."""
    columns: show.Columns = {
        "recording": show.text("name"),
        "source": show.text("source"),
        "frames": show.counted("n_frames"),
        "duration (s)": show.decimals("duration_s", 1),
        "rate (Hz)": lambda item: show.significant(item.get("rate_hz"), 4),
        "feet": show.counted("n_feet"),
        "body markers": show.counted("n_body"),
        "seen (%)": show.decimals("seen", 2, 100),
    }
    return show.table_of("Recordings", recordings, columns, text_columns=2)


def filled_table(
    filled: pd.DataFrame | None, touchdowns: pd.DataFrame | None = None
) -> show.Table | None:
    """Return one row per marker with gaps, the least seen first; None if there are no gaps."""
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
    missing, mended = (show.count(gappy[name].sum()) for name in ("missing", "filled"))
    left = len(gappy) - MOST_GAPPY
    rest = f"; {left} more in tables/filled.csv" if left > 0 else ""
    note = f"{mended} of {missing} missing positions were filled in{_resting(touchdowns)}{rest}."
    rows = show.records(gappy)[:MOST_GAPPY]
    title = "Gaps, and how much of them was filled"
    return show.table_of(title, rows, columns, text_columns=3, note=note)


def _resting(touchdowns: pd.DataFrame | None) -> str:
    """Say how many of the touchdowns used depend on positions that were filled in."""
    if touchdowns is None or "filled_share" not in touchdowns:
        return ""
    used = touchdowns[~excluded(touchdowns)]
    resting = show.count((used["filled_share"] > 0).sum())
    return f"; {resting} of {show.count(len(used))} used touchdowns depend on some of these"


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
    rows = [{"recording": name, **floor} for name, floor in floors.items()]
    notes = [
        f"{name}: {floor['note']}"
        for name, floor in floors.items()
        if floor.get("note")
    ]
    return show.table_of("Floor", rows, columns, note="; ".join(notes))


def _spread_of_feet(floor: Mapping[str, Any]) -> str:
    offsets = [
        value
        for value in floor.get("foot_offsets_m") or ()
        if not show.is_missing(value)
    ]
    return (
        show.fixed((max(offsets) - min(offsets)) * 1e3, 2) if offsets else show.MISSING
    )


def sections_table(sections: Mapping[str, Any] | None) -> show.Table | None:
    """Return thresholds, sections and the travel between them, then everything else in the file."""
    if not sections:
        return None
    decided = sections.get("decided") or {}
    rows = [
        (
            f"{name}{show.WORDS['decided'].get(decided.get(key, 'data'), '')}",
            show.fixed(show.scaled(sections.get(key), 1e3), 2),
            "mm",
        )
        for key, name in SECTION_NAMES.items()
    ]
    pre, post = sections.get("pre_height_m"), sections.get("post_height_m")
    if pre is not None and post is not None:
        rows.append(
            ("travel from pre to post", show.fixed((pre - post) * 1e3, 2), "mm")
        )
    for side in ("pre", "post"):
        speed_m_s = sections.get(f"{side}_speed_m_s")
        if speed_m_s is not None:
            # A height that is wrong by 1 mm shifts the instant of the passage by this
            # many ms.
            name = f"time per mm of height, {side} section"
            rows.append((name, show.fixed(1 / speed_m_s, 2), "ms"))
    shown = {*SECTION_NAMES, "decided"}
    for key, value in show.flat(
        {key: sections[key] for key in sections if key not in shown}
    ):
        words, text, unit = show.labelled(key, value)
        rows.append((DETAIL_NAMES.get(key, words), text, unit))
    return show.Table(
        "Thresholds and sections", ("quantity", "value", "unit"), tuple(rows)
    )


def schedules_table(touchdowns: pd.DataFrame | None) -> show.Table | None:
    """Return one row per mode schedule: its used touchdowns and the spread of their contacts."""
    if touchdowns is None or touchdowns.empty:
        return None
    used = touchdowns[~excluded(touchdowns)]
    groups = sorted(
        used.groupby("schedule"), key=lambda item: (-len(item[1]), str(item[0]))
    )
    rows = [
        (
            str(schedule).replace(">", " → "),
            show.count(len(group)),
            show.count((group["class"] == "ambiguous").sum()),
            show.fixed(100 * len(group) / len(used), 1),
            show.fixed(1e3 * group["spread_s"].median(), 2),
            show.fixed(group["probability"].mean(), 3),
        )
        for schedule, group in groups[:MOST_SCHEDULES]
    ]
    head = ("order of contacts", "touchdowns", "of them ambiguous", "share (%)")
    rarer = [len(group) for _, group in groups[MOST_SCHEDULES:]]
    left = f"{counted(len(rarer), 'rarer order')}, {counted(sum(rarer), 'touchdown')}"
    note = f"Not listed: {left}, at most {max(rarer)} each." if rarer else ""
    medians = ("median spread of contacts (ms)", "mean probability of the order")
    return show.Table(
        "Used touchdowns by mode schedule", (*head, *medians), tuple(rows), note=note
    )


def exclusions_table(touchdowns: pd.DataFrame | None) -> show.Table | None:
    """Count unused descents by reason, and by recording if there are few recordings."""
    if touchdowns is None or touchdowns.empty or not excluded(touchdowns).any():
        return None
    out = _left_out(touchdowns)
    reasons = out["reason"].replace("", "no reason given")
    names = [str(name) for name in dict.fromkeys(touchdowns["recording"])]
    shown = names if 1 < len(names) <= MOST_RECORDINGS else []
    recordings, rows = out["recording"].astype(str), []
    parts = {
        str(reason): recordings[reasons == reason]
        for reason in reasons.value_counts().index
    }
    for reason, part in (*parts.items(), ("all reasons", recordings)):
        each = tuple(show.count((part == name).sum()) for name in shown)
        rows.append((reason, *each, show.count(len(part))))
    return show.Table(
        "Descents that are not used", ("reason", *shown, "descents"), tuple(rows)
    )


def _left_out(touchdowns: pd.DataFrame) -> pd.DataFrame:
    """Return the descents not used, landings first, with the feet's names in the reasons."""
    out = touchdowns[excluded(touchdowns)]
    out = out.iloc[(out["reason"] == NO_FOOT_LANDED).argsort(kind="stable")]
    reasons = out["reason"].astype(object).fillna("").astype(str)
    return out.assign(reason=[with_names(one, touchdowns) for one in reasons])


def excluded(touchdowns: pd.DataFrame) -> pd.Series:
    """Return whether each touchdown was excluded, also if CSV turned the booleans into text."""
    return touchdowns["excluded"].astype(str).str.lower().isin(("true", "1", "1.0"))


# Tables of prediction, distances, accuracy and time.

MODEL_NAMES, KIND_NAMES = show.WORDS["models"], show.WORDS["kinds"]
COUNTED = ("landings", "touchdowns")
SHOWN_ELSEWHERE = ("study", "config", "inputs", "versions", "stage_seconds")


def prediction_table(summary: pd.DataFrame | None) -> show.Table | None:
    """Return one row per model, in the printed order, including models that were not fitted."""
    rows = _in_order(summary, "model", MODEL_NAMES)
    scale, power = show.common_scale([row.get("median") for row in rows])
    columns: show.Columns = {
        "model": lambda row: MODEL_NAMES.get(row["model"], str(row["model"])),
        "classes": show.counted("n_classes"),
        "train": show.counted("n_train"),
        "test": show.counted("n_test"),
        **{
            head: show.decimals(key, 2, 1 / scale)
            for head, key in _quantiles(p2_5=2.5, q25=25, median=50, q75=75, p97_5=97.5)
        },
        "worst position (mm)": show.decimals("worst_position_mm", 1),
        "worst velocity (m/s)": show.decimals("worst_velocity_m_s", 3),
    }
    note = show.NOTES["prediction"].format(power=power)
    note += " A dash: not fitted, too few touchdowns." * any(
        len(row) == 1 for row in rows
    )
    return show.table_of("Prediction errors", rows, columns, note=note)


def distances_table(summary: pd.DataFrame | None) -> show.Table | None:
    """Return one row per kind of distance, including kinds without pairs."""
    columns: show.Columns = {
        "subspaces": lambda row: KIND_NAMES.get(row["kind"], str(row["kind"])),
        "pairs": lambda row: show.count(row.get("n", 0)),
        "mean": show.decimals("mean", 3),
        "sd": show.decimals("sd", 3),
        **{
            head: show.decimals(key, 3)
            for head, key in _quantiles(q05=5, q25=25, median=50, q75=75, q95=95)
        },
        "AUC": show.decimals("auc_against_in_class", 3),
    }
    note = "Arc lengths in rad. AUC: probability that such a distance exceeds an in-class one."
    rows = _in_order(summary, "kind", KIND_NAMES)
    return show.table_of("Arc-length distances", rows, columns, note=note)


def _in_order(
    summary: pd.DataFrame | None, key: str, names: Mapping[str, str]
) -> list[show.Row]:
    """Return a row for each name, in the printed order; a missing one has only its name."""
    found = {str(row[key]): row for row in show.records(summary)}
    names_of_all = dict.fromkeys((*names, *found)) if found else ()
    return [{**found.get(name, {}), key: name} for name in names_of_all]


def _quantiles(**shares: float) -> list[tuple[str, str]]:
    """Return the heading and column of each quantile."""
    return [
        ("median" if key == "median" else show.percent(p), key)
        for key, p in shares.items()
    ]


def truth_table(truth: Mapping[str, Mapping[str, Any]] | None) -> show.Table | None:
    """Return one row per measure: the result compared with what the simulator knew."""
    rows = tuple(
        (_capital(str(entry.get("what") or name)), *_measured(name, entry))
        for name, entry in (truth or {}).items()
    )
    return (
        show.Table("Estimates and truth", ("quantity", "value", "unit"), rows)
        if rows
        else None
    )


def _measured(name: str, entry: Mapping[str, Any]) -> tuple[str, str]:
    """Return value and unit as elsewhere on the page: lengths in mm, shares in per cent."""
    value, unit = entry.get("value"), str(entry.get("unit") or "")
    if name.startswith("labels_right_"):
        return show.fixed(show.scaled(value, 100), 1), "%"
    if unit == "m":
        return show.plain(show.scaled(value, 1e3)), "mm"
    if unit in COUNTED:
        return show.count(value), unit
    return show.plain(value), "" if unit in ("1", "yes/no") else unit


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def times_table(seconds: Mapping[str, Any]) -> show.Table | None:
    """Return the time of each job, longest first."""
    ordered = sorted(seconds.items(), key=lambda item: -float(item[1]))
    rows = tuple((name, show.fixed(value, 2)) for name, value in ordered)
    return show.Table("Time per job", ("job", "time (s)"), rows) if rows else None


def record_tables(record: Mapping[str, Any]) -> dict[str, show.Table | None]:
    """Return tables of `provenance.json`: origin of a run, inputs, versions and times."""
    others = {key: value for key, value in record.items() if key not in SHOWN_ELSEWHERE}
    digests, versions = record.get("inputs") or {}, record.get("versions") or {}
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
    "scatter / standard error": show.decimals("scatter_over_se", 2),
}


def agreement_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return one row per column and recording: counts, bias with its interval, scatter."""
    rows, note = (
        show.records(overlay.get("contact_overlay_summary")),
        show.NOTES["agreement"],
    )
    return show.table_of(
        "Agreement of the contacts", rows, AGREEMENT, text_columns=3, note=note
    )


def unmatched_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return every contact that was missed or invented, and the reason if known."""
    contacts = overlay.get("contact_overlay")
    if contacts is None:
        return None
    out = contacts[contacts["status"].isin(UNMATCHED)]
    columns: show.Columns = {
        **{name: show.text(name) for name in ("recording", "column")},
        "contact": show.text("status"),
        "descent": show.counted("index"),
        "reason": show.text("reason"),
        "time (s)": lambda row: show.fixed(
            row["external_s" if row["status"] == "missed" else "found_s"], 3
        ),
    }
    title, file = "Contacts missed or invented", "contact_overlay"
    return show.first_rows(title, out, columns, MOST_UNMATCHED, file, texts=5)


def thresholds_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Return bias and scatter as functions of the force threshold."""
    columns: show.Columns = {
        **{name: show.text(name) for name in ("recording", "column")},
        "threshold": lambda row: show.significant(row["threshold"], 3),
        "unit": lambda row: str(row["unit"]).replace("body_weight", "body weights"),
        **{name: show.counted(f"n_{name}") for name in UNMATCHED},
        "bias (ms)": show.decimals("bias_s", 2, 1e3),
        "robust sd (ms)": show.decimals("robust_sd_s", 2, 1e3),
    }
    rows = show.records(overlay.get("contact_overlay_thresholds"))
    return show.table_of(
        "Agreement at other force thresholds", rows, columns, text_columns=2
    )


def _ms(value: Any) -> str:
    return show.fixed(show.scaled(value, 1e3), 2)


# The quality of the data: checks, faults, and every touchdown that was left out.

Checks = Sequence[Mapping[str, Any]]

STATUS = {
    status: f"{sign}{show.NO_BREAK_SPACE}{status}"
    for status, sign in {
        "good": "●", "look": "◐", "poor": "○", "not known": "–", "not asked": "–",
    }.items()
}  # fmt: skip
WORSE = ("good", "not known", "look", "poor")
NOT_ASKED = (
    "not asked"  # nothing was configured to compare with, so there is nothing to judge
)
MOST_FAULTS, MOST_EXCLUDED = 30, 500
NO_FOOT_LANDED = "no foot landed"  # the reason in the table of touchdowns


def quality_summary(checks: Checks | None) -> tuple[str | None, str]:
    """Say how many checks are good and poor, and list those that are not good, worst first."""
    asked = [check for check in checks or () if check["status"] != NOT_ASKED]
    if not asked:
        return None, ""
    counts = Counter(str(check["status"]) for check in asked)
    poor = f", {counts['poor']} poor" if counts["poor"] else ""
    others = [
        f"{s}: {one['what']}"
        for s in WORSE[:0:-1]
        for one in asked
        if one["status"] == s
    ]
    return f"{counts['good']} of {len(asked)} good{poor}", "; ".join(others)


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
    good, poor = float(check["good"]), float(check["poor"])
    signs = ("≤", ">") if good <= poor else ("≥", "<")
    unit, none = (
        str(check["unit"]),
        good == 0.0 and signs[0] == "≤",
    )  # nothing is below 0
    return (
        ("" if none else f"{signs[0]} ") + show.with_unit(f"{good:g}", unit),
        f"{signs[1]} {show.with_unit(f'{poor:g}', unit)}",
    )


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
    """Return one row per remark on a recording: what was guessed or corrected, the first thirty."""
    columns = {name: show.text(name) for name in ("recording", "remark")}
    title = "Remarks on the recordings"
    return show.first_rows(title, remarks, columns, MOST_FAULTS, "remarks", texts=2)


def lights(checks: Checks | None) -> list[tuple[str, str, str]]:
    """Return the subjects of the checks, with the worst status of each and its remark.

    Checks that were not asked for light nothing; a good light names what it leaves
    open.
    """
    shown = []
    for name in dict.fromkeys(str(check["about"]) for check in checks or ()):
        of_all = [check for check in checks or () if check["about"] == name]
        own = [check for check in of_all if check["status"] != NOT_ASKED]
        if not own:
            continue
        worst = max(own, key=lambda check: WORSE.index(str(check["status"])))
        told, status = f"{worst['what']}: {worst['remark']}", str(worst["status"])
        if status == "good":
            told = counted(len(own), "check")
            told += "".join(
                f"; {check['what']}: {check['remark']}"
                for check in of_all
                if check not in own
            )
        shown.append((name, status, told))
    return shown


def excluded_table(
    touchdowns: pd.DataFrame | None, levelled: Sequence[Recording] = ()
) -> show.Table | None:
    """Return one row per descent not used, with its reason and the heights of its feet."""
    from markupsafe import Markup

    by_name = {recording.name: recording for recording in levelled}
    out = None if touchdowns is None else _left_out(touchdowns)
    columns: dict[str, show.Cell] = {
        "recording": show.text("recording"),
        "reason": show.text("reason"),
        "descent": show.counted("index"),
        "time (s)": show.decimals("t_pre_s", 2),
    }
    if by_name:
        columns["feet, coloured as in 3-D, and when they touched"] = lambda row: Markup(
            small_plot(by_name.get(str(row["recording"])), row)
        )
    title = "Every descent that is not used"
    return show.first_rows(title, out, columns, MOST_EXCLUDED, "touchdowns", texts=2)
