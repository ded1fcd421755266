"""What the page of a large group says in place of a row for each study at its top."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from hopdata.errors import counted
from hopdata.messages import Message
from hopdata.report import formatting as show
from hopdata.report.what_now import study_name

Row = Mapping[str, Any]
#: In this order the page of a large group shows its studies.
ANSWERS = ("different", "no difference", "cannot tell", "no answer")
# Most reasons, or failed checks, that are listed; rarer ones are counted together.
MOST_LISTED = 12

_ANSWERS: show.Columns = {
    "answer": lambda row: str(row["answer"]),
    "studies": show.counted("n"),
    "share (%)": show.decimals("share", 1, 100.0),
    "median difference (%)": show.decimals("median", 1, 100.0),
    "smallest (%)": show.decimals("smallest", 1, 100.0),
    "largest (%)": show.decimals("largest", 1, 100.0),
}
_COUNTS: show.Columns = {
    "what": lambda row: str(row["what"]),
    "studies": show.counted("n"),
}


def answer_of(row: Row) -> str:
    """Return the answer of a study, one of `ANSWERS`."""
    if row["reason"]:
        return "no answer"
    return str(row["conclusion"])


def by_answer(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the studies of each answer that there is, in the order of `ANSWERS`."""
    found: dict[str, list[Row]] = {answer: [] for answer in ANSWERS}
    for row in rows:
        found[answer_of(row)].append(row)
    return {answer: studies for answer, studies in found.items() if studies}


def summaries(rows: Sequence[Row]) -> list[show.Table]:
    """Return tables of the answers, why there is none, and which checks are poor."""
    tables = [show.table_of("Answers", _answers(rows), _ANSWERS)]
    reasons = Counter(str(row["reason"]) for row in rows if row["reason"])
    poor = Counter(
        what
        for row in rows
        for what, status in row.get("quality", [])
        if status == "poor"
    )
    for title, counts in (("Why there is no answer", reasons), ("Poor checks", poor)):
        tables.append(show.table_of(title, _most(counts), _COUNTS))
    return [table for table in tables if table is not None]


def _answers(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the number of studies of each answer, and their sizes."""
    found = []
    for answer, studies in by_answer(rows).items():
        # A jump is not a difference of derivatives.
        sizes = [
            row["estimate"]
            for row in studies
            if not row["reason"] and "jump_low" not in row
        ]
        entry: dict[str, Any] = {"answer": answer, "n": len(studies)}
        entry["share"] = len(studies) / len(rows)
        entry |= dict.fromkeys(("median", "smallest", "largest"))
        if sizes:
            entry["median"] = median(sizes)
            entry["smallest"] = min(sizes)
            entry["largest"] = max(sizes)
        found.append(entry)
    return found


def _most(counts: Counter[str]) -> list[dict[str, Any]]:
    """Return the most frequent of these texts, and how many studies have others."""
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    found = [{"what": what, "n": n} for what, n in ordered[:MOST_LISTED]]
    rest = ordered[MOST_LISTED:]
    if rest:
        others = f"{len(rest)} others"
        found.append({"what": others, "n": sum(n for _, n in rest)})
    return found


# Orders of a study that are listed; rarer ones are counted together.
MOST_ORDERS = 3

_CONTACTS: show.Columns = {
    "study": study_name,
    "landings timed": lambda row: _timed(row["contacts"]),
    "error of a contact, median (ms)": lambda row: _of_feet(row["contacts"], "se_s"),
    "common error (ms)": lambda row: _of_feet(row["contacts"], "common_s"),
    "orders seen": lambda row: _orders(row["contacts"]),
    "sure": lambda row: _sure(row["contacts"]),
}


def contacts_table(rows: Sequence[Row]) -> show.Table | None:
    """Return what is known of the contacts of each study, whatever its answer.

    It is as the studies wrote it; rows of earlier versions do not have it.
    """
    known = [row for row in rows if row.get("contacts")]
    return show.table_of(
        str(Message("report.group_contacts")),
        known,
        _CONTACTS,
        text_columns=6,
        note=Message("report.group_contacts_note"),
    )


_OF_FEET: show.Columns = {
    "condition": lambda row: str(row["condition"]),
    "lag": lambda row: f"{row['foot']} minus {row['other']}",
    "subjects": show.counted("subjects"),
    "mean (ms)": show.decimals("mean_s", 2, 1e3),
    "from (ms)": show.decimals("low_s", 2, 1e3),
    "to (ms)": show.decimals("high_s", 2, 1e3),
    "common error (ms)": show.decimals("common_s", 2, 1e3),
    "median |lag| (ms)": show.decimals("median_abs_s", 2, 1e3),
}
_BETWEEN: show.Columns = {
    "conditions": lambda row: f"{row['condition_a']} minus {row['condition_b']}",
    "lag": lambda row: f"{row['foot']} minus {row['other']}",
    "subjects": show.counted("subjects"),
    "difference (ms)": show.decimals("difference_s", 2, 1e3),
    "from (ms)": show.decimals("low_s", 2, 1e3),
    "to (ms)": show.decimals("high_s", 2, 1e3),
    "common error (ms)": show.decimals("common_s", 2, 1e3),
}


def lags_tables(group: Row) -> list[show.Table]:
    """Return the lags of the feet over subjects, and their differences, if any.

    Groups of earlier versions have none.
    """
    lags = group.get("lags", [])
    columns = dict(_OF_FEET)
    if len({row["condition"] for row in lags}) < 2:
        del columns["condition"]
    tables = [
        show.table_of(
            str(Message("report.group_lags")),
            lags,
            columns,
            text_columns=len(columns) - 6,
            note=Message("report.group_lags_note"),
        ),
        show.table_of(
            str(Message("report.group_lag_differences")),
            group.get("lag_differences", []),
            _BETWEEN,
            text_columns=2,
            note=Message("report.group_lag_differences_note"),
        ),
    ]
    return [table for table in tables if table is not None]


def _timed(contacts: Row) -> str:
    return f"{show.count(contacts['timed'])} of {show.count(contacts['landings'])}"


def _of_feet(contacts: Row, key: str) -> str:
    """Return an error of each foot in ms; one number if it is the same for all."""
    errors = {}
    for foot in contacts["feet"]:
        error_ms = show.scaled(foot[key], 1e3)
        errors[foot["foot"]] = show.significant(error_ms, 2)
    if len(set(errors.values())) == 1:
        return next(iter(errors.values()))
    return ", ".join(f"{foot} {error}" for foot, error in errors.items())


def _orders(contacts: Row) -> str:
    """Return the orders of a study with their landings, the most frequent first."""
    orders = contacts["orders"]
    told = [
        f"{one['order']}: {show.count(one['seen'])}" for one in orders[:MOST_ORDERS]
    ]
    rarer = orders[MOST_ORDERS:]
    if rarer:
        landings = show.count(sum(one["seen"] for one in rarer))
        told.append(f"{counted(len(rarer), 'rarer order')}: {landings}")
    return "; ".join(told) or show.MISSING


def _sure(contacts: Row) -> str:
    seen = sum(one["seen"] for one in contacts["orders"])
    sure = sum(one["sure"] for one in contacts["orders"])
    if not seen:
        return show.MISSING
    return f"{show.count(sure)} of {show.count(seen)}"
