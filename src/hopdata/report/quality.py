"""The quality of the data: checks, faults, and every touchdown that was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.arrays import pd
from hopdata.recording import Recording
from hopdata.report import formatting as show
from hopdata.report.scene import small_plot
from hopdata.report.tables import excluded

# Tables of the contacts that are known from elsewhere.

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
    "95 % interval (ms)": lambda row: f"{_ms(row['bias_low_s'])} to {_ms(row['bias_high_s'])}",
    "robust sd (ms)": show.decimals("robust_sd_s", 2, 1e3),
    "largest from bias (ms)": show.decimals("largest_s", 2, 1e3),
    "scatter / standard error": show.decimals("scatter_over_se", 2),
}


def agreement_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """One row a column and recording: counts, bias with its interval, scatter."""
    note = (
        "Contact found less contact known: the median, and the deviation by the median absolute "
        "deviation. All counts are of contacts; those excluded are of descents that are not used. "
        "Of feet that share a column the first contact of each landing is compared."
    )
    rows = show.records(overlay.get("contact_overlay_summary"))
    return show.table_of("Agreement of the contacts", rows, AGREEMENT, text_columns=3, note=note)


def unmatched_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """Every contact that was missed or invented, and why if that is known."""
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
    return show.table_of(
        "Contacts missed or invented", show.records(out, MOST_UNMATCHED), columns, text_columns=5,
        note=show.more(out, MOST_UNMATCHED, "contact_overlay"),
    )  # fmt: skip


def thresholds_table(overlay: Mapping[str, pd.DataFrame]) -> show.Table | None:
    """How bias and scatter depend on the threshold of the force."""
    columns: show.Columns = {
        **{name: show.text(name) for name in ("recording", "column")},
        "threshold": lambda row: show.significant(row["threshold"], 3),
        "unit": lambda row: str(row["unit"]).replace("body_weight", "body weights"),
        **{name: show.counted(f"n_{name}") for name in UNMATCHED},
        "bias (ms)": show.decimals("bias_s", 2, 1e3),
        "robust sd (ms)": show.decimals("robust_sd_s", 2, 1e3),
    }
    rows = show.records(overlay.get("contact_overlay_thresholds"))
    title = "The same at other thresholds of the force"
    return show.table_of(title, rows, columns, text_columns=2)


def _ms(value: Any) -> str:
    return show.fixed(show.scaled(value, 1e3), 2)


Checks = Sequence[Mapping[str, Any]]

STATUS = {
    status: f"{sign}{show.NO_BREAK_SPACE}{status}"
    for status, sign in {"good": "●", "look": "◐", "poor": "○", "not known": "–"}.items()
}
WORSE = ("good", "not known", "look", "poor")
# The lights of the first screen: how the names of the checks begin that each stands for.
LIGHTS = {
    "Recordings": ("frames seen", "swaps", "noise"),
    "Landings": ("touchdowns", "error of a contact", "orders"),
    "Stability": ("sections move", "drift"),
}
MOST_FAULTS = 30
MOST_EXCLUDED = 500


def summary(checks: Checks | None) -> tuple[str | None, str]:
    """Say how many checks are good and poor, and name those that are not good, the worst first."""
    if not checks:
        return None, ""
    counts = Counter(str(check["status"]) for check in checks)
    poor = f", {counts['poor']} poor" if counts["poor"] else ""
    others = [
        f"{status}: {check['what']}"
        for status in ("poor", "look", "not known")
        for check in checks
        if check["status"] == status
    ]
    return f"{counts['good']} of {len(checks)} good{poor}", "; ".join(others)


def quality_table(checks: Checks | None) -> show.Table | None:
    """One row a check: what was found, what would be good and what poor."""
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
    return show.table_of("Can these data be trusted?", checks or (), columns, text_columns=3)


def _limits(check: Mapping[str, Any]) -> tuple[str, str]:
    good, poor = float(check["good"]), float(check["poor"])
    signs = ("≤", ">") if good <= poor else ("≥", "<")
    unit = str(check["unit"])
    none = good == 0.0 and signs[0] == "≤"  # nothing is less than none
    return (
        ("" if none else f"{signs[0]} ") + show.with_unit(f"{good:g}", unit),
        f"{signs[1]} {show.with_unit(f'{poor:g}', unit)}",
    )


def faults_table(faults: pd.DataFrame | None) -> show.Table | None:
    """One row a fault of the recordings, the first thirty."""
    columns = {
        "recording": show.text("recording"),
        "fault": show.text("kind"),
        "marker": show.text("marker"),
        "remark": show.text("remark"),
        "from (s)": show.decimals("start_s", 2),
        "to (s)": show.decimals("stop_s", 2),
    }
    return show.table_of(
        "Faults of the recordings", show.records(faults, MOST_FAULTS), columns, text_columns=4,
        note=show.more(faults, MOST_FAULTS, "faults"),
    )  # fmt: skip


def remarks_table(remarks: pd.DataFrame | None) -> show.Table | None:
    """One row a remark on a recording: what was guessed or put right, the first thirty."""
    columns = {name: show.text(name) for name in ("recording", "remark")}
    return show.table_of(
        "Remarks on the recordings", show.records(remarks, MOST_FAULTS), columns, text_columns=2,
        note=show.more(remarks, MOST_FAULTS, "remarks"),
    )  # fmt: skip


def lights(checks: Checks | None) -> list[tuple[str, str, str]]:
    """Return name, worst status and remark of each of `LIGHTS` that has checks."""
    shown = []
    for name, words in LIGHTS.items():
        own = [check for check in checks or () if str(check["what"]).startswith(words)]
        if own:
            worst = max(own, key=lambda check: WORSE.index(str(check["status"])))
            told, status = f"{worst['what']}: {worst['remark']}", str(worst["status"])
            shown.append((name, status, f"all {len(own)} checks" if status == "good" else told))
    return shown


def excluded_table(
    touchdowns: pd.DataFrame | None, levelled: Sequence[Recording] = ()
) -> show.Table | None:
    """One row a descent that is not used, with its reason and the heights of its feet."""
    from markupsafe import Markup

    by_name = {recording.name: recording for recording in levelled}
    out = None if touchdowns is None else touchdowns[excluded(touchdowns)]
    columns: dict[str, show.Cell] = {
        "recording": show.text("recording"),
        "reason": show.text("reason"),
        "descent": show.counted("index"),
        "time (s)": show.decimals("t_pre_s", 2),
    }
    if by_name:
        columns["feet, and when they touched"] = lambda row: Markup(
            small_plot(by_name.get(str(row["recording"])), row)
        )
    return show.table_of(
        "Every descent that is not used", show.records(out, MOST_EXCLUDED), columns,
        text_columns=2, note=show.more(out, MOST_EXCLUDED, "touchdowns"),
    )  # fmt: skip
