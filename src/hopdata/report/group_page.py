"""The page of a group: its answer, forest plot, conditions, and all its studies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.messages import Message
from hopdata.report import formatting as show
from hopdata.report.group import by_answer, contacts_table, lags_tables, summaries
from hopdata.report.group_methods import group_methods
from hopdata.report.inputs import ReportFigure, picture_of, rendered
from hopdata.report.verdict import at_least, at_most, percent
from hopdata.report.what_now import (
    DOCUMENTATION,
    advice_to_group,
    cannot_tell,
    limits_of_group,
)

OF_CONDITION: show.Columns = {
    "condition": lambda row: str(row["condition"]),
    "subjects": show.counted("subjects"),
    "answer": lambda row: str(row["conclusion"]),
    "rms (%)": show.decimals("estimate", 1, 100.0),
    "from (%)": show.decimals("low", 1, 100.0),
    "to (%)": show.decimals("high", 1, 100.0),
    "at most (%)": show.decimals("upper_bound", 1, 100.0),
    "I² (%)": show.decimals("i2", 0, 100.0),
    "p of Q": lambda row: show.p_value(row["q_p_value"]),
}
CONDITIONS: show.Columns = {
    "conditions": lambda row: f"{row['condition_a']} − {row['condition_b']}",
    "subjects": show.counted("n"),
    "rms of the first (%)": show.decimals("size_a", 1, 100.0),
    "rms of the second (%)": show.decimals("size_b", 1, 100.0),
    "difference of squares": show.decimals("difference", 3),
    "from": show.decimals("low", 3),
    "to": show.decimals("high", 3),
    "p": lambda row: show.p_value(row["p_value"]),
    "p after Holm": lambda row: show.p_value(row["p_holm"]),
}


def _columns_of(conditions: Sequence[Mapping[str, Any]]) -> show.Columns:
    """Return the columns of the comparisons; a single p-value is not adjusted."""
    columns = dict(CONDITIONS)
    if len(conditions) == 1:
        del columns["p after Holm"]
    return columns


def build_group_page(
    group: Mapping[str, Any],
    figures: Sequence[ReportFigure],
    *,
    one_by_one: bool = True,
) -> str:
    """Build the page of a group.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    figures : sequence of ReportFigure
        The sizes of its studies.
    one_by_one : bool
        Whether the studies can be read one by one. If there are too many, the page
        sums them up, and lists those of each answer folded.
    """
    rows = group["members"]
    title = "Conditions compared within subjects"
    members: Any = [_member(row) for row in rows]
    saturate = any(row.get("saturates") for row in rows)
    judged = [row for row in rows if not row["reason"]]
    facts = {
        "one_by_one": one_by_one,
        "some_saturate": saturate,
        "n": len(judged),
        "confidence": show.percent(100 * group["confidence"]),
        "margin": show.percent(100 * group["margin"]),
        "of_all": group["effect"] is not None,
        "of_conditions": any(one["effect"] for one in group.get("by_condition", [])),
    }
    reasons = {row["reason"] for row in rows}
    if len(reasons) == 1:  # the sentence at the top of the page says it once
        members = [{**cells, "reason_told": ""} for cells in members]
    summed: list[show.Table] = []
    if not one_by_one:
        summed = summaries(rows)
        answers = by_answer(rows).items()
        members = {one: [_member(row) for row in some] for one, some in answers}
    return rendered(
        "group.html.j2",
        group=group,
        highlights=_highlights(group),
        pictures=[picture_of(one, facts) for one in figures],
        one_by_one=one_by_one,
        methods=group_methods(group),
        some_without=any(row["reason"] for row in rows),
        some_saturate=saturate,
        summaries=summed,
        further=list(dict.fromkeys(key for row in rows for key in row["further"])),
        has_conditions=len({row["condition"] for row in rows}) > 1,
        members=members,
        limits=limits_of_group(rows) if cannot_tell(group) else [],
        advice=advice_to_group(group),
        documentation=DOCUMENTATION,
        contacts=contacts_table(rows),
        lags=lags_tables(group),
        conditions=show.table_of(
            title, group["conditions"], _columns_of(group["conditions"])
        ),
        by_condition=show.table_of(
            "Over the subjects of each condition", _of_conditions(group), OF_CONDITION
        ),
    )


def _of_conditions(group: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the size of each condition, empty where too few subjects have one."""
    rows = []
    for one in group.get("by_condition", []):
        effect = one["effect"] or {}
        sizes = ("estimate", "low", "high", "upper_bound")
        row = {**one, **{name: effect.get(name) for name in sizes}}
        model = effect.get("combined") or {}
        row |= {name: model.get(name) for name in ("i2", "q_p_value")}
        rows.append(row)
    return rows


def _highlights(group: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return name, value and remark of each key number of a group."""
    rows = group["members"]
    effect = group["effect"]
    answers = Counter(row["conclusion"] for row in rows if not row["reason"])
    judged = f"{answers.total()} of {len(rows)}"
    said = ", ".join(f"{count} {what}" for what, count in sorted(answers.items()))
    studies = ("Studies judged", judged, said)
    if effect is None:
        return [*_of_each(group), studies]
    model = effect["combined"]
    q = show.significant(model["q"])
    p = show.told_p_value(model["q_p_value"])
    return [
        *_sizes(group, group["confidence"], "Difference over subjects"),
        studies,
        (
            "Between subjects (I²)",
            percent(model["i2"]),
            f"Q = {q}, {p}; what smooth terms leave counts, too",
        ),
    ]


def _of_each(group: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the size of each condition that has one."""
    found = []
    for one in group.get("by_condition", []):
        if one["effect"] is not None:
            name = f"{one['condition']}: difference over {one['subjects']} subjects"
            found += _sizes(one, group["confidence"], name)
    return found


def _sizes(
    answered: Mapping[str, Any], confidence: float, name: str
) -> list[tuple[str, str, str]]:
    """Return the size with its interval or, without a difference, first its bound.

    The answer rests on one of the two, and that is the one to print. It is that of a
    group, or of one of its conditions.
    """
    effect = answered["effect"]
    size = percent(effect["estimate"])
    values = {"confidence": show.percent(100 * confidence)}
    if answered["conclusion"] == "different":
        values["interval"] = f"{at_least(effect['low'])} to {at_most(effect['high'])}"
        return [(name, size, str(Message("report.group_interval", values)))]
    bound = f"at most {at_most(effect['upper_bound'])}"
    return [
        (name, bound, str(Message("report.group_at_most", values))),
        ("Its estimate", size, str(Message("report.group_estimate"))),
    ]


def _member(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the cells of a member, and a summary of its checks."""
    checks = row.get("quality", [])
    statuses = Counter(status for _, status in checks)
    counts = []
    for status in ("good", "look", "poor"):
        if statuses[status]:
            counts.append(f"{statuses[status]} {status}")
    cells = dict(row)
    cells["checks"] = ", ".join(counts)
    cells["poor"] = "; ".join(what for what, status in checks if status == "poor")

    needed = row.get("landings_needed") or 0
    cells["needed"] = ""
    if row.get("conclusion") != "different" and needed > row.get("landings", 0):
        cells["needed"] = show.count(needed)

    cells["reason_told"] = f": {row['reason']}"
    cells["size"] = None
    cells["ends"] = ""
    if row["reason"]:
        return cells
    if "jump_low" in row:
        cells["size"] = f"a jump of {percent(row['jump_estimate'])}"
        low = row["jump_low"]
        high = row["jump_high"]
    else:
        cells["size"] = percent(row["estimate"])
        low = row["low"]
        high = row["high"]
    if row.get("saturates"):
        over = percent(row["over_landings_estimate"])
        cells["size"] += f" (over the landings {over})"
    if high is None:
        cells["ends"] = f"at least {at_least(low)}"
        return cells
    cells["ends"] = f"{at_least(low)} to {at_most(high)}"
    if row["conclusion"] != "different":
        cells["ends"] = f"at most {at_most(row['upper_bound'])}"
    return cells
