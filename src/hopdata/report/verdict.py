"""The verdict on the page, what it can and cannot show, and the page of a group of verdicts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata import __version__
from hopdata.report import formatting as show
from hopdata.report.inputs import ReportFigure, picture_of, rendered

Verdict = Mapping[str, Any]

OF_WHAT = {"effect": "the map", "jump": "the outcome's variation, as a jump"}
ENDS = ("estimate", "low", "high", "upper_bound")


def meaning(verdict: Verdict | None) -> str:
    """Return what the quantity that decided a verdict is, and what it cannot show."""
    return str(show.NOTES[f"meaning_of_{(verdict or {}).get('decided_by', 'effect')}"])


def verdict_facts(
    verdict: Verdict | None, truth: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """Return texts on the verdict; all keys are always present, None if unknown.

    Returns
    -------
    dict
        ``sentence``; ``outlook``, what these data could have shown; ``difference``, the
        effect with its interval; ``true``, the true effect in a simulation; ``remark``,
        the deciding bound; ``confidence``, ``power``; ``conclusion``; ``found``,
        whether an effect was estimated at all; ``jumps``, whether a jump of the outcome
        decided; ``allowed``, by how much orders of one smooth map may seem to differ;
        ``detectable``, None if nothing could have been seen.
    """
    known: Verdict = verdict or {}
    effect = known.get(known.get("decided_by", "effect"))
    facts: dict[str, Any] = {
        "sentence": known.get("sentence"),
        "outlook": known.get("outlook"),
        "conclusion": known.get("conclusion"),
        "found": effect is not None,
        "jumps": known.get("decided_by") == "jump",
        "allowed": None,
        "detectable": None,
        "difference": None,
        "true": None,
        "remark": str(known.get("conclusion", "")),
        "confidence": show.percent(100 * known["confidence"]) if known else None,
        "power": show.percent(100 * known["power"]) if known else None,
    }
    if effect is None:
        return facts
    estimate, low, high, bound = (
        show.significant(100 * effect[key], 2) for key in ENDS
    )
    most, none = (
        show.with_unit(text, "%") for text in (bound, f"{100 * known['margin']:g}")
    )
    bounded = f"; one-sided bound {most}, less than {none} counts as none"
    true: Any = (truth or {}).get("verdict_true_effect", {}).get("value")
    facts["true"] = None if show.is_missing(true) else _percent(float(true))
    if effect.get("allowed") is not None:
        facts["allowed"] = _percent(effect["allowed"])
    if effect["detectable"] <= 1.0:
        facts["detectable"] = _percent(effect["detectable"])
    return facts | {
        "difference": show.with_unit(f"{estimate} ({low} to {high})", "%"),
        "remark": f"of {OF_WHAT[known.get('decided_by', 'effect')]}, {facts['confidence']} interval"
        + ("" if known["conclusion"] == "different" else bounded)
        + (f"; true in this simulation: {facts['true']}" if facts["true"] else ""),
    }


# The page of a group: answer, forest plot, conditions, and every member with its link.

CONDITIONS: show.Columns = {
    "conditions": lambda row: f"{row['condition_a']} − {row['condition_b']}",
    "subjects": show.counted("n"),
    "rms of the first (%)": show.decimals("size_a", 1, 100.0),
    "rms of the second (%)": show.decimals("size_b", 1, 100.0),
    "difference of squares (%²)": show.decimals("difference", 1, 1e4),
    "from (%²)": show.decimals("low", 1, 1e4),
    "to (%²)": show.decimals("high", 1, 1e4),
    "p": lambda row: show.significant(row["p_value"], 2),
    "p after Holm": lambda row: show.significant(row["p_holm"], 2),
}


def build_group_page(group: Mapping[str, Any], figures: Sequence[ReportFigure]) -> str:
    """Build the page of a group.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    figures : sequence of ReportFigure
        The forest plot.
    """
    rows = group["members"]
    title = "Conditions compared within subjects"
    return rendered(
        "group.html.j2",
        group=group,
        highlights=_highlights(group),
        pictures=[picture_of(figure, {}) for figure in figures],
        further=list(dict.fromkeys(key for row in rows for key in row["further"])),
        has_conditions=len({row["condition"] for row in rows}) > 1,
        members=[_member(row) for row in rows],
        conditions=show.table_of(title, group["conditions"], CONDITIONS),
        version=__version__,
    )


def _highlights(group: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    rows, effect = group["members"], group["effect"]
    answers = Counter(
        "no answer" if row["reason"] else row["conclusion"] for row in rows
    )
    said = ", ".join(f"{count} {what}" for what, count in sorted(answers.items()))
    cards = [
        ("Studies judged", f"{len(rows) - answers['no answer']} of {len(rows)}", said)
    ]
    if effect is None:
        return cards
    model = effect["combined"]
    ends = f"{_percent(effect['low'])} to {_percent(effect['high'])}"
    of_q = f"Q = {show.significant(model['q'])}, p = {show.significant(model['q_p_value'], 2)}"
    return [
        (
            "Difference over subjects (rms)",
            _percent(effect["estimate"]),
            f"interval {ends}",
        ),
        ("At most", _percent(effect["upper_bound"]), "one-sided bound of the rms"),
        *cards,
        ("Between subjects (I²)", _percent(model["i2"]), of_q),
    ]


def _percent(share: float) -> str:
    return show.with_unit(show.significant(100 * share, 2), "%")


def _member(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the cells of a member, and a summary of its checks."""
    checks = row.get("quality", [])
    statuses = Counter(status for _, status in checks)
    needed, of = row.get("landings_needed") or 0, "jump_" * ("jump_low" in row)
    is_lacking = row.get("conclusion") != "different" and needed > row.get(
        "landings", 0
    )
    return {
        **row,
        "needed": show.count(needed) if is_lacking else "",
        "size": None
        if row["reason"]
        else "a jump of " * bool(of) + _percent(row[f"{of}estimate"]),
        "ends": " to ".join(
            _percent(row[of + k]) for k in ("low", "high") if not row["reason"]
        ),
        "checks": ", ".join(
            f"{statuses[one]} {one}"
            for one in ("good", "look", "poor")
            if statuses[one]
        ),
        "poor": "; ".join(what for what, status in checks if status == "poor"),
    }
