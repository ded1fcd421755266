"""Studies of a group: each member gets its own study, and one page shows them all."""

from __future__ import annotations

import logging
import math
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hopdata import __version__
from hopdata.arrays import pd
from hopdata.errors import AnalysisError, HopdataError
from hopdata.messages import Message

logger = logging.getLogger("hopdata")
# Most studies that a page shows one by one; it sums up more of them.
MOST_ONE_BY_ONE = 100
# The size and its ends, which a row also has over the landings: that of the contact is
# another where the difference saturates.
SIZES = ("estimate", "low", "high", "upper_bound")
# Answers, as `hopdata.maps.verdict.words` has them, which takes SciPy to import.
DIFFERENT = "different"
NO_DIFFERENCE = "no difference"
CANNOT_TELL = "cannot tell"
# Most subjects that a sentence names.
MOST_NAMED = 5


def run_member(member: Mapping[str, Any], folder: Path) -> None:
    """Run the study of a member; write results, page and row to `folder`.

    If the study has no answer, its row and its page give the reason. Only a lack of
    memory or disk space raises an error.
    """
    from hopdata.jobs import write_json

    name = member["config"]["study"]
    row = {key: member[key] for key in ("subject", "condition", "further")}
    reason = ""
    try:
        reason = _study_of(member, folder, row)
    except (OSError, MemoryError):
        raise
    except HopdataError as error:
        reason = " ".join(str(error).split())
        _write_page_without_answer(name, reason, folder)
    except Exception as error:
        logger.error("unexpected error\n%s", traceback.format_exc())
        text = " ".join(str(error).split())
        reason = f"unexpected {type(error).__name__}: {text}"
        _write_page_without_answer(name, reason, folder)
    write_json(folder / "member.json", {"name": name, **row, "reason": reason})


def _study_of(member: Mapping[str, Any], folder: Path, row: dict[str, Any]) -> str:
    """Run a study, write it, and complete the row; return why it has no answer."""
    from hopdata.config.loading import load_config
    from hopdata.walk import Study

    reason = ""
    study = Study(load_config(member["config"]))
    # They are known even if the rest of the study fails.
    row["contacts"] = contacts_of(study.touchdowns)
    row["lags"] = _lags_of(study.touchdowns)
    verdict = study.verdict
    if verdict.effect is None:
        reason = "; ".join(note.reason for note in verdict.notes)
    else:
        row |= verdict.effect.to_dict()
    if verdict.jump and verdict.decided_by == "jump":
        row |= {f"jump_{key}": value for key, value in verdict.jump.to_dict().items()}
    study.save(folder)
    drawn = None
    if "svg" in study.config["figures"]["formats"]:
        drawn = folder / "figures"
    study.report(folder / "report.html", drawn=drawn)
    checks = study.quality.to_dict("records")
    row["conclusion"] = verdict.conclusion
    row["saturates"] = verdict.saturates
    if verdict.effect_over_landings is not None:
        of_landings = asdict(verdict.effect_over_landings)
        row |= {f"over_landings_{size}": of_landings[size] for size in SIZES}
    row["landings"] = verdict.n_landings
    row["excluded"] = landings_left_out(study.touchdowns)
    row["landings_needed"] = verdict.landings_needed
    row["decided_by"] = verdict.decided_by
    row["quality"] = [[check["what"], check["status"]] for check in checks]
    row["what_now"] = list(verdict.what_now)
    return reason


def landings_left_out(touchdowns: pd.DataFrame) -> int:
    """Return of how many landings the maps of a study know nothing, by its table.

    Descents in which no foot of the study lands are none.
    """
    from hopdata.report.tables import NO_FOOT_LANDED, excluded

    landed = touchdowns["reason"] != NO_FOOT_LANDED
    return int((landed & excluded(touchdowns)).sum())


def contacts_of(touchdowns: pd.DataFrame) -> dict[str, Any]:
    """Return what is known of the contacts of a study, whatever its verdict.

    Parameters
    ----------
    touchdowns : DataFrame
        The table of touchdowns of the study.

    Returns
    -------
    dict
        ``landings``, those in which a foot of the study lands, also if none could be
        timed, as the page of the study counts them; ``timed``, those of them whose
        contacts are all known, also if the maps do not use them; ``feet``, a list
        of ``foot``, ``se_s`` (median standard error, s) and ``common_s`` (error that
        all contacts of the foot may share, s), None if not known; ``orders``, a list of
        ``order``, ``seen`` and ``sure`` (landings), the most frequent first.
    """
    from hopdata.feet import foot_names, with_foot_names
    from hopdata.report.tables import NO_FOOT_LANDED

    names = foot_names(touchdowns.columns)
    instants = touchdowns[[f"contact_{name}_s" for name in names]]
    timed = touchdowns[instants.notna().all(axis=1)]
    landed = touchdowns["reason"] != NO_FOOT_LANDED
    feet = []
    for name in names:
        error_s = timed[f"se_{name}_s"].median() if f"se_{name}_s" in timed else None
        common_s = None
        if f"common_{name}_s" in timed:
            common_s = timed[f"common_{name}_s"].max()
        feet.append(
            {"foot": name, "se_s": _known(error_s), "common_s": _known(common_s)}
        )
    ordered = timed[timed["schedule"].fillna("") != ""]
    orders: list[dict[str, Any]] = []
    for schedule, own in ordered.groupby("schedule"):
        sure = own["order_class"] != "ambiguous"
        order = with_foot_names(str(schedule), names)
        orders.append({"order": order, "seen": len(own), "sure": int(sure.sum())})
    orders.sort(key=lambda one: (-one["seen"], one["order"]))
    return {
        "landings": int(landed.sum()),
        "timed": len(timed),
        "feet": feet,
        "orders": orders,
    }


def _lags_of(touchdowns: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the lags of each two feet of a study, None where a number is not known."""
    from hopdata.landings.contact_lags import lags_of_touchdowns

    return _rows_of(lags_of_touchdowns(touchdowns))


def _rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as JSON can hold them."""
    rows = []
    for record in table.to_dict("records"):
        row = {}
        for name, value in record.items():
            row[str(name)] = _known(value) if isinstance(value, float) else value
        rows.append(row)
    return rows


def _known(value: float | None) -> float | None:
    """Return a number that JSON can hold; None if it is not known."""
    if value is None or not math.isfinite(value):
        return None
    return float(value)


def _write_page_without_answer(name: str, reason: str, folder: Path) -> None:
    from hopdata.jobs import whole_file
    from hopdata.report.inputs import ReportInputs
    from hopdata.report.page import build_report

    page = build_report(ReportInputs(study=name, notes=[f"No answer: {reason}"]))
    with whole_file(folder / "report.html") as draft:
        draft.write_text(page, encoding="utf-8")


def put_together(
    rows: Sequence[Mapping[str, Any]], group: Mapping[str, Any]
) -> dict[str, Any]:
    """Combine the members' rows into the content of ``group.json``.

    Returns
    -------
    dict
        ``sentence``, ``conclusion``, ``effect`` (see `GroupVerdict`; None with a reason
        in the sentence, or if there are conditions), ``by_condition`` (for each of two
        conditions or more its ``condition``, ``subjects``, ``conclusion``, ``sentence``
        and ``effect``), ``conditions`` (rows of `compare_conditions`), ``lags`` and
        ``lag_differences`` (rows of `hopdata.landings.group_lags`), ``members`` and the
        ``version`` of hopdata.
    """
    from hopdata.maps.verdict.group import LEAST_SUBJECTS, judge_group

    answered = pd.DataFrame([row for row in rows if not row["reason"]])
    answer: dict[str, Any] = {"by_condition": [], "conditions": []}
    try:
        _require_answers(rows, answered)
        if len({row["condition"] for row in rows}) > 1:
            answer |= _of_conditions(rows, answered, group["verdict"])
        elif len(answered) < LEAST_SUBJECTS:
            beside = _beside(rows, group["verdict"]["confidence"])
            sentence = " ".join([_few_said(answered), *beside])
            answer |= {"conclusion": CANNOT_TELL, "sentence": sentence, "effect": None}
        else:
            effect = judge_group(answered, **group["verdict"])
            beside = _beside(rows, group["verdict"]["confidence"])
            sentence = " ".join([effect.sentence, *beside])
            answer |= {"conclusion": effect.conclusion, "sentence": sentence}
            answer["effect"] = asdict(effect)
    except AnalysisError as error:
        sentence = f"These data cannot tell: {error}."
        answer |= {"conclusion": CANNOT_TELL, "sentence": sentence, "effect": None}
    return {
        "conclusion": answer["conclusion"],
        "sentence": answer["sentence"],
        "effect": answer["effect"],
        "study": group["study"],
        "version": __version__,
        "margin": group["verdict"]["margin"],
        "confidence": group["verdict"]["confidence"],
        "members": list(rows),
        "by_condition": answer["by_condition"],
        "conditions": answer["conditions"],
        **_lags_of_group(rows),
    }


def _lags_of_group(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the lags of the feet over subjects, and between conditions.

    They do not need the answer of a study. Rows of earlier versions have none.
    """
    from hopdata.landings.group_lags import lag_differences, lags_over_subjects

    lags = [
        {"subject": row["subject"], "condition": row["condition"], **lag}
        for row in rows
        for lag in row.get("lags", [])
    ]
    if not lags:
        return {"lags": [], "lag_differences": []}
    table = pd.DataFrame(lags)
    table["common_s"] = table["common_s"].astype(float)
    return {
        "lags": _rows_of(lags_over_subjects(table)),
        "lag_differences": _rows_of(lag_differences(table)),
    }


def _of_conditions(
    rows: Sequence[Mapping[str, Any]],
    answered: pd.DataFrame,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Judge each condition, and compare them within subjects.

    They are not pooled: what is true of all together may be true of none.
    """
    from hopdata.maps.verdict.group import compare_conditions, conditions_said

    names = list(dict.fromkeys(row["condition"] for row in rows))
    judged = [_of_one(name, answered, options) for name in names]
    confidence = options["confidence"]
    compared = compare_conditions(answered, confidence=confidence)
    said = [
        str(
            Message(
                "maps.in_condition",
                {"condition": one["condition"], "answer": one["sentence"]},
            )
        )
        for one in judged
    ]
    said += _beside(rows, confidence)
    between = conditions_said(compared, confidence=confidence)
    if between:
        said.append(between)
    return {
        "conclusion": _conclusion_of([one["conclusion"] for one in judged]),
        "sentence": " ".join(said),
        "effect": None,
        "by_condition": judged,
        "conditions": compared.to_dict("records"),
    }


def _of_one(
    condition: str, answered: pd.DataFrame, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the answer of one condition."""
    from hopdata.maps.verdict.group import LEAST_SUBJECTS, judge_group

    members = answered[answered["condition"] == condition]
    found: dict[str, Any] = {"condition": condition, "subjects": len(members)}
    if len(members) < LEAST_SUBJECTS:
        return {
            **found,
            "conclusion": CANNOT_TELL,
            "sentence": _few_said(members),
            "effect": None,
        }
    try:
        effect = judge_group(members, **options)
    except AnalysisError as error:
        sentence = f"These data cannot tell: {error}."
        return {
            **found,
            "conclusion": CANNOT_TELL,
            "sentence": sentence,
            "effect": None,
        }
    return {
        **found,
        "conclusion": effect.conclusion,
        "sentence": effect.sentence,
        "effect": asdict(effect),
    }


def _few_said(members: pd.DataFrame) -> str:
    """Return the answers of the subjects, who are too few for one over subjects."""
    from hopdata.maps.verdict.group import LEAST_SUBJECTS

    values = {"number": len(members), "least": LEAST_SUBJECTS}
    if members.empty:
        return str(Message("maps.group_of_none", values))
    answers = [
        f"{row.subject}: {row.conclusion}" for row in members.itertuples(index=False)
    ]
    return str(Message("maps.group_of_few", {**values, "answers": "; ".join(answers)}))


def _conclusion_of(conclusions: Sequence[str]) -> str:
    """Return the conclusion on all conditions: that which holds whatever the others."""
    if DIFFERENT in conclusions:
        return DIFFERENT
    if {*conclusions} == {NO_DIFFERENCE}:
        return NO_DIFFERENCE
    return CANNOT_TELL


def _beside(rows: Sequence[Mapping[str, Any]], confidence: float) -> list[str]:
    """Return sentences on the studies that jump, and on those without an answer."""
    from hopdata.maps.verdict.group import jumps_that_hold
    from hopdata.maps.verdict.words import as_given

    said = []
    jumping = [row for row in rows if row.get("decided_by") == "jump"]
    if jumping:
        answered = [row for row in rows if not row["reason"]]
        p_values = [row.get("jump_p_value", math.nan) for row in answered]
        values = {
            "jumps": len(jumping),
            "hold": jumps_that_hold(p_values, confidence=confidence),
            "confidence": as_given(confidence),
        }
        said.append(str(Message("maps.jumps_of_group", values)))
    without = sum(bool(row["reason"]) for row in rows)
    if without:
        said.append(f"Without an answer: {without} of {len(rows)} studies.")
    return said


def one_by_one(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Tell whether there are so few members that each can be read on the page."""
    return len(rows) <= MOST_ONE_BY_ONE


def _require_answers(rows: Sequence[Mapping[str, Any]], answered: pd.DataFrame) -> None:
    """Refuse a group without answers, or with the same landings as two members."""
    if answered.empty:
        reason = rows[0]["reason"]
        raise AnalysisError(f"no subject has an answer; the first: {reason}")
    # Different landings never have the same effect to the bit.
    same = answered.loc[answered.duplicated("squared", keep=False), "subject"].tolist()
    if same:
        named = ", ".join(same[:MOST_NAMED])
        if len(same) > MOST_NAMED:
            named += f" and {len(same) - MOST_NAMED} others"
        raise AnalysisError(f"expected different landings, found the same in: {named}")
