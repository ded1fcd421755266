"""The quality of the data: checks, faults, and every touchdown that was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hopdata.report.formatting import MISSING, NO_BREAK_SPACE, count, fixed, significant, with_unit
from hopdata.report.landing_tables import excluded
from hopdata.report.table import Table

if TYPE_CHECKING:
    import pandas as pd

Checks = Sequence[Mapping[str, Any]]

STATUS = {
    status: f"{sign}{NO_BREAK_SPACE}{status}"
    for status, sign in {"good": "●", "look": "◐", "poor": "○", "not known": "–"}.items()
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


def quality_table(checks: Checks | None) -> Table | None:
    """One row a check: what was found, what would be good and what poor."""
    if not checks:
        return None
    rows = tuple(
        (
            str(check["what"]),
            STATUS.get(str(check["status"]), str(check["status"])),
            str(check["remark"]),
            with_unit(significant(check["value"], 3), str(check["unit"])),
            *_limits(check),
        )
        for check in checks
    )
    head = ("check", "status", "remark", "found", "good", "poor")
    return Table("Can these data be trusted?", head, rows, text_columns=3)


def _limits(check: Mapping[str, Any]) -> tuple[str, str]:
    good, poor = float(check["good"]), float(check["poor"])
    signs = ("≤", ">") if good <= poor else ("≥", "<")
    unit = str(check["unit"])
    none = good == 0.0 and signs[0] == "≤"  # nothing is less than none
    return (
        ("" if none else f"{signs[0]} ") + with_unit(f"{good:g}", unit),
        f"{signs[1]} {with_unit(f'{poor:g}', unit)}",
    )


def faults_table(faults: pd.DataFrame | None) -> Table | None:
    """One row a fault of the recordings, the first thirty."""
    if faults is None or faults.empty:
        return None
    rows = tuple(
        (
            str(row["recording"]),
            str(row["kind"]),
            _text(row["marker"]),
            _text(row["remark"]),
            fixed(row["start_s"], 2),
            fixed(row["stop_s"], 2),
        )
        for row in faults.head(MOST_FAULTS).to_dict("records")
    )
    left = len(faults) - len(rows)
    note = f"{count(left)} more in tables/faults.csv." if left > 0 else ""
    head = ("recording", "fault", "marker", "remark", "from (s)", "to (s)")
    return Table("Faults of the recordings", head, rows, text_columns=4, note=note)


def remarks_table(remarks: pd.DataFrame | None) -> Table | None:
    """One row a remark on a recording: what was guessed or put right, the first thirty."""
    if remarks is None or remarks.empty:
        return None
    shown = remarks.head(MOST_FAULTS).to_dict("records")
    rows = tuple((str(row["recording"]), str(row["remark"])) for row in shown)
    left = len(remarks) - len(rows)
    note = f"{count(left)} more in tables/remarks.csv." if left > 0 else ""
    head = ("recording", "remark")
    return Table("Remarks on the recordings", head, rows, text_columns=2, note=note)


def excluded_table(touchdowns: pd.DataFrame | None) -> Table | None:
    """One row a descent that is not used, with its reason."""
    if touchdowns is None or touchdowns.empty:
        return None
    out = touchdowns[excluded(touchdowns)]
    if out.empty:
        return None
    rows = tuple(
        (str(row["recording"]), _text(row["reason"]), count(row["index"]), fixed(row["t_pre_s"], 2))
        for row in out.head(MOST_EXCLUDED).to_dict("records")
    )
    left = len(out) - len(rows)
    note = f"{count(left)} more in tables/touchdowns.csv." if left > 0 else ""
    head = ("recording", "reason", "descent", "time (s)")
    return Table("Every descent that is not used", head, rows, text_columns=2, note=note)


def _text(value: Any) -> str:
    """Return a text; where a table holds none, a dash."""
    return str(value) if isinstance(value, str) and value else MISSING
