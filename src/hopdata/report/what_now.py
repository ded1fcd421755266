"""What to do about a study that cannot tell: its limits, with the advice on each.

The verdict names its limits (`hopdata.maps.verdict.what_now`). The advice on them is
said in ``messages.toml`` alone, from which docs/cannot_tell.md has it, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hopdata import __version__
from hopdata.messages import Message
from hopdata.report import formatting as show
from hopdata.report.verdict import Verdict, at_most, notes_of, reason_of, told

# The documentation of this version.
_DOCUMENTS = f"https://github.com/hopdata/hopdata/blob/v{__version__}/docs"

#: The advice on all limits, in the documentation of this version.
DOCUMENTATION = f"{_DOCUMENTS}/cannot_tell.md"

#: How often answers err, kind of study by kind of study.
CAMPAIGN = f"{_DOCUMENTS}/verdict_campaign.md"

# The cause that no further landings of the same kind mend.
ONE_ORDER = "maps.none_for_one_order"

# The advice on more landings.
MORE_LANDINGS = "report.advice_landings"

# The same where none was left out.
MORE_OF_ALL_USED = "report.advice_landings_all_used"

# The advice on a limit by its cause.
OF_CAUSE = {
    "estimate": "report.advice_estimate",
    "landings": MORE_LANDINGS,
    "noise": "report.advice_noise",
    "posture": "report.advice_posture",
    "spread": "report.advice_spread",
    "drift": "report.advice_drift",
    "sections": "report.advice_sections",
    "saturation": "report.advice_saturation",
    "orders": "report.advice_orders",
}

# The advice on a limit by its code, where it is not that of its cause.
OF_CODE = {
    "maps.limit_landings_no": "report.advice_landings_no",
    "maps.limit_spread": "report.advice_far_apart",
    "maps.limit_spread_few": MORE_LANDINGS,
    ONE_ORDER: "report.advice_one_order",
}

# What each of these limits is called where studies of a group are counted.
LIMITS = {
    "report.advice_landings": "report.limit_landings",
    "report.advice_landings_no": "report.limit_landings_no",
    "report.advice_estimate": "report.limit_estimate",
    "report.advice_spread": "report.limit_spread",
    "report.advice_noise": "report.limit_noise",
    "report.advice_posture": "report.limit_posture",
    "report.advice_drift": "report.limit_drift",
    "report.advice_sections": "report.limit_sections",
    "report.advice_orders": "report.limit_orders",
    "report.advice_one_order": "report.limit_one_order",
    "report.advice_far_apart": "report.limit_far_apart",
    "report.advice_saturation": "report.limit_saturation",
}

# Reasons why there is no number that name no limit: the advice on each.
OF_REASON = {
    "maps.copies": "report.advice_copies",
    "maps.body_at_rest": "report.advice_still",
    "maps.outcome_constant": "report.advice_still",
    "maps.too_few_feet": "report.advice_feet",
}

# Feet of a body with a single kink.
TWO = 2


@dataclass(frozen=True)
class Limit:
    """A limit of a study, in words, with what to do about it."""

    said: Message | str
    advice: Message | str


def limits(verdict: Verdict | None, *, excluded: int | None = None) -> list[Limit]:
    """Return what limits a study that cannot tell, the cause that costs most first.

    Advice that two limits share is given once. Of landings that were left out it is
    said how to get them back, unless it is known that none was (`excluded` is 0).
    """
    known = verdict or {}
    causes = known.get("what_now") or []
    found = []
    waiting = _codes(causes)
    for cause in causes:
        code = _advice_on(cause)
        advice: Message | str = ""
        if code in waiting:
            waiting.remove(code)
            if code == MORE_LANDINGS and excluded == 0:
                code = MORE_OF_ALL_USED
            advice = Message(code)
        found.append(Limit(told(cause, str(cause.get("said", ""))), advice))
    if not found:
        found = _of_reasons(known)
    return found


def _codes(causes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the codes of the advice on these limits, each once."""
    codes = dict.fromkeys(_advice_on(cause) for cause in causes)
    codes.pop("", None)
    if OF_CODE[ONE_ORDER] in codes:
        # More landings in the same order are of no use.
        codes.pop(MORE_LANDINGS, None)
    return list(codes)


def _advice_on(cause: Mapping[str, Any]) -> str:
    """Return the code of the advice on a limit; empty if it names no known cause."""
    of_its_code = OF_CODE.get(str(cause.get("code")))
    return of_its_code or OF_CAUSE.get(str(cause.get("cause")), "")


def _of_reasons(verdict: Verdict) -> list[Limit]:
    """Return the reasons why there is no number, if they name no limit."""
    found = []
    for note in notes_of(verdict):
        code = OF_REASON.get(note.code)
        if code is not None:
            found.append(Limit(reason_of(note), Message(code)))
    return found


def further_advice(
    verdict: Verdict | None, *, excluded: int = 0, landings: int = 0
) -> list[Message]:
    """Return what else a study that cannot tell should know.

    That is how many landings were left out, what two feet cannot show, what stands
    already, and that the margin is not to be moved afterwards.

    Parameters
    ----------
    verdict : mapping, optional
        Contents of ``verdict.json``; of another answer, nothing is returned.
    excluded, landings : int
        Landings that were left out, of how many.
    """
    if not cannot_tell(verdict):
        return []
    known = verdict or {}
    said = []
    if excluded:
        values = {"excluded": show.count(excluded), "landings": show.count(landings)}
        said.append(Message("report.what_now_lost", values))
    # Where the study itself tells how many landings it takes, that counts.
    if known.get("n_feet") == TWO and known.get("landings_needed") is None:
        advice = Message("report.advice_two_feet")
        said.append(Message("report.what_now_body", {"advice": advice}))
    said.append(_what_stands(known))
    if known.get("effect") is not None:
        said.append(Message("report.advice_margin"))
    return said


def cannot_tell(verdict: Verdict | None) -> bool:
    """Return whether this is the answer of a study."""
    return (verdict or {}).get("conclusion") == "cannot tell"


def _what_stands(verdict: Verdict) -> Message:
    """Return what a study without an answer has shown all the same."""
    code = "report.what_now_bound"
    size = verdict.get("effect") or {}
    if size and size.get("upper_bound") is None:
        code = "report.what_now_average"
        size = verdict.get("effect_over_landings") or {}
    if size.get("upper_bound") is None:
        return Message("report.what_now_without")
    values = {
        "bound": at_most(size["upper_bound"]),
        "confidence": show.percent(100 * verdict["confidence"]),
    }
    return Message(code, values)


def decisive(verdict: Verdict | None) -> list[Message | str]:
    """Return what the head of the page says limits a study that cannot tell.

    It is the cause that costs most, and the next if the first is that there is one
    order only.
    """
    causes = (verdict or {}).get("what_now") or []
    shown = causes[:1]
    if shown and shown[0].get("code") == ONE_ORDER:
        shown = causes[:2]
    return [told(cause, str(cause.get("said", ""))) for cause in shown]


# What limits a group: its studies, counted.

# Most studies that a limit names.
MOST_NAMED = 5

# Answers of studies that need no advice.
ANSWERS = ("different", "no difference")


def limits_of_group(rows: Sequence[Mapping[str, Any]]) -> list[Limit]:
    """Return what limits the studies of a group that cannot tell, most frequent first.

    Parameters
    ----------
    rows : sequence of mappings
        A row for each study, with the ``what_now`` of its verdict, if it is known, and
        ``excluded``, how many of its landings were left out.
    """
    lost = {study_name(row) for row in rows if row.get("excluded") != 0}
    subjects: dict[str, list[str]] = {}
    for row in rows:
        if not row["reason"] and row["conclusion"] in ANSWERS:
            continue
        for code in _codes(row.get("what_now") or []):
            subjects.setdefault(code, []).append(study_name(row))
    ordered = sorted(subjects.items(), key=lambda item: -len(item[1]))
    found = []
    for code, of_limit in ordered:
        values = {
            "limit": Message(LIMITS[code]),
            "studies": f"{len(of_limit)} of {len(rows)} studies ({_listed(of_limit)})",
        }
        advice = code
        if code == MORE_LANDINGS and not lost.intersection(of_limit):
            advice = MORE_OF_ALL_USED
        found.append(Limit(Message("report.group_limit", values), Message(advice)))
    return found


def study_name(row: Mapping[str, Any]) -> str:
    """Return the subject of a study of a group, and its condition if it has one."""
    return ", ".join(part for part in (row["subject"], row["condition"]) if part)


def _listed(names: Sequence[str]) -> str:
    listed = "; ".join(names[:MOST_NAMED])
    more = len(names) - MOST_NAMED
    return f"{listed} and {more} others" if more > 0 else listed


def advice_to_group(group: Mapping[str, Any]) -> list[Message]:
    """Return what else a group that cannot tell should know; else nothing.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    """
    if group["conclusion"] in ANSWERS:
        return []
    said = []
    rows = group["members"]
    feet = {len(row["contacts"]["feet"]) for row in rows if row.get("contacts")}
    if feet == {TWO} and not any(row.get("landings_needed") for row in rows):
        advice = Message("report.advice_two_feet")
        said.append(Message("report.group_two_feet", {"advice": advice}))
    said.append(Message("report.advice_group"))
    effect = group["effect"]
    if effect is not None:
        values = {
            "bound": at_most(effect["upper_bound"]),
            "confidence": show.percent(100 * group["confidence"]),
        }
        said.append(Message("report.group_stands_bound", values))
    elif any(one["effect"] for one in group.get("by_condition", [])):
        said.append(Message("report.group_stands_conditions"))
    elif feet:
        said.append(Message("report.group_stands_contacts"))
    return said
