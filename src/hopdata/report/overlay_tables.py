"""Tables of the contacts that are known from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hopdata.report.formatting import MISSING, count, fixed, significant
from hopdata.report.table import Table, scaled

if TYPE_CHECKING:
    import pandas as pd

MOST_UNMATCHED = 60
UNMATCHED = ("missed", "invented")


def agreement_table(overlay: Mapping[str, pd.DataFrame]) -> Table | None:
    """One row a column and recording: counts, bias with its interval, scatter."""
    summary = overlay.get("contact_overlay_summary")
    if summary is None or summary.empty:
        return None
    head = (
        "recording", "column", "feet", "known", "matched", "of these excluded", "missed",
        "invented", "of other feet", "not compared", "bias (ms)", "95 % interval (ms)",
        "robust sd (ms)", "largest from bias (ms)", "scatter / standard error",
    )  # fmt: skip
    counts = ("external", "matched", "excluded", "missed", "invented", "other_foot", "not_compared")
    rows = tuple(
        (
            *(str(row[key]) for key in ("recording", "column", "feet")),
            *(count(row[f"n_{key}"]) for key in counts),
            _ms(row["bias_s"]),
            f"{_ms(row['bias_low_s'])} to {_ms(row['bias_high_s'])}",
            _ms(row["robust_sd_s"]),
            _ms(row["largest_s"]),
            fixed(row["scatter_over_se"], 2),
        )
        for row in summary.to_dict("records")
    )
    note = (
        "Contact found less contact known: the median, and the deviation by the median absolute "
        "deviation. All counts are of contacts; those excluded are of descents that are not used. "
        "Of feet that share a column the first contact of each landing is compared."
    )
    return Table("Agreement of the contacts", head, rows, text_columns=3, note=note)


def unmatched_table(overlay: Mapping[str, pd.DataFrame]) -> Table | None:
    """Every contact that was missed or invented, and why if that is known."""
    contacts = overlay.get("contact_overlay")
    if contacts is None:
        return None
    out = contacts[contacts["status"].isin(UNMATCHED)]
    if out.empty:
        return None
    rows = tuple(_unmatched(row) for row in out.head(MOST_UNMATCHED).to_dict("records"))
    left = len(out) - len(rows)
    note = f"{left} more stand in contact_overlay.csv." if left > 0 else ""
    head = ("recording", "column", "contact", "descent", "reason", "time (s)")
    return Table("Contacts missed or invented", head, rows, text_columns=5, note=note)


def _unmatched(row: Mapping[Any, Any]) -> tuple[str, ...]:
    known = row["status"] == "missed"
    index = row["index"]
    return (
        str(row["recording"]),
        str(row["column"]),
        str(row["status"]),
        MISSING if index != index else count(int(index)),
        str(row["reason"] or MISSING),
        fixed(row["external_s" if known else "found_s"], 3),
    )


def thresholds_table(overlay: Mapping[str, pd.DataFrame]) -> Table | None:
    """How bias and scatter depend on the threshold of the force."""
    table = overlay.get("contact_overlay_thresholds")
    if table is None or table.empty:
        return None
    rows = tuple(
        (
            str(row["recording"]),
            str(row["column"]),
            significant(row["threshold"], 3),
            str(row["unit"]).replace("body_weight", "body weights"),
            *(count(row[f"n_{key}"]) for key in UNMATCHED),
            _ms(row["bias_s"]),
            _ms(row["robust_sd_s"]),
        )
        for row in table.to_dict("records")
    )
    head = ("recording", "column", "threshold", "unit", *UNMATCHED, "bias (ms)", "robust sd (ms)")
    return Table("The same at other thresholds of the force", head, rows, text_columns=2)


def _ms(value: Any) -> str:
    return fixed(scaled(value, 1e3), 2)
