"""The quality of the data: checks, faults, and every touchdown that was left out."""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata import __version__
from hopdata.report.formatting import (
    MISSING,
    NO_BREAK_SPACE,
    Table,
    count,
    fixed,
    scaled,
    significant,
    with_unit,
)
from hopdata.report.tables import excluded

if TYPE_CHECKING:
    import pandas as pd

# The page on one recording: one HTML file that needs no other.

TEMPLATES = Path(__file__).with_name("templates")
DEFAULT_WIDTH_PT = 496.0


@dataclass(frozen=True)
class SvgPicture:
    """An SVG with its title and caption."""

    svg: bytes
    title: str
    caption: str

    @property
    def source(self) -> str:
        """The picture as a data URL."""
        return "data:image/svg+xml;base64," + base64.b64encode(self.svg).decode("ascii")

    @property
    def width_pt(self) -> float:
        """Width on paper that the SVG asks for."""
        found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', self.svg[:4000])
        return float(found.group(1)) if found else DEFAULT_WIDTH_PT


@dataclass(frozen=True)
class InspectionPage:
    """What the page shows.

    Parameters
    ----------
    title : str
        Name of the file.
    answer : str
        One sentence: what was found.
    highlights : sequence of (name, value, remark)
        Facts on top.
    notes : sequence of str
        What the reader should look at.
    pictures : sequence of SvgPicture
        Figures.
    tables : sequence of Table
        Tables.
    """

    title: str
    answer: str
    highlights: Sequence[tuple[str, str, str]]
    notes: Sequence[str]
    pictures: Sequence[SvgPicture]
    tables: Sequence[Table]


def build_inspection_page(page: InspectionPage) -> str:
    """Write the page as a complete HTML document."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("inspection.html.j2").render(
        title=page.title,
        answer=page.answer,
        highlights=page.highlights,
        notes=page.notes,
        pictures=page.pictures,
        tables=page.tables,
        style=(TEMPLATES / "report.css").read_text(encoding="utf-8"),
        version=__version__,
    )


# Tables of the contacts that are known from elsewhere.

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
