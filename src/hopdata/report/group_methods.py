"""The methods paragraph of a paper on a group of studies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata import __version__
from hopdata.errors import counted
from hopdata.messages import Message
from hopdata.report.methods import Methods, references

# How each is cited in the text, by its key among the references.
CITED = {
    "paule1982": "Paule and Mandel 1982",
    "hartung2001": "Hartung and Knapp 2001",
    "rover2015": "Röver et al. 2015",
    "holm1979": "Holm 1979",
    "seabold2010": "Seabold and Perktold 2010",
}


def group_methods(group: Mapping[str, Any]) -> Methods:
    """Return the methods paragraph of a group: how its studies were put together.

    What was done in each study is said on the study's own page.

    Parameters
    ----------
    group : mapping
        Contents of ``group.json``.
    """
    rows = group["members"]
    judged = sum(not row["reason"] for row in rows)
    conditions = {row["condition"] for row in rows} - {""}
    values: dict[str, Any] = {
        "studies": f"{len(rows)} studies",
        "subjects": counted(len({row["subject"] for row in rows}), "subject"),
        "conditions": "",
        "judged": judged,
        "version": __version__,
        "margin": f"{100 * group['margin']:g} %",
        **CITED,
    }
    if conditions:
        values["conditions"] = f" in {counted(len(conditions), 'condition')}"
    said = [Message("report.methods_group_studies", values)]
    by_condition = [one for one in group.get("by_condition", []) if one["effect"]]
    if group["effect"] is None and not by_condition:
        said.append(Message("report.methods_group_none", values))
    else:
        if by_condition:
            said.append(Message("report.methods_group_each"))
        said.append(Message("report.methods_group_model", values))
        alpha = 1.0 - group["confidence"]
        values["confidence"] = f"{100 * group['confidence']:g} %"
        values["chance"] = f"{90 * alpha:.3g} %"
        values["tail"] = f"{50 * alpha:.3g} %"
        values["both"] = f"{100 * alpha:.3g} %"
        values["alpha"] = f"{alpha:.3g}"
        values["allowed"] = _rms(rows, "allowed", by_condition)
        values["left"] = _rms(rows, "left", by_condition)
        said.append(Message("report.methods_group_interval", values))
    if group["conditions"]:
        said.append(Message("report.methods_group_conditions", values))
    said.append(Message("report.methods_group_record", values))
    text = " ".join(str(one) for one in said)
    return Methods(text, references(text, CITED, __version__))


def _rms(
    rows: Sequence[Mapping[str, Any]],
    key: str,
    by_condition: Sequence[Mapping[str, Any]],
) -> str:
    """Return the rms of a size over the studies with an answer, of each condition."""
    names = [one["condition"] for one in by_condition]
    if not names:
        return f"{_rms_of(rows, key):.3f}"
    each = []
    for name in names:
        own = [row for row in rows if row["condition"] == name]
        each.append(f"{_rms_of(own, key):.3f} ({name})")
    return ", ".join(each)


def _rms_of(rows: Sequence[Mapping[str, Any]], key: str) -> float:
    squares = [row[key] ** 2 for row in rows if not row["reason"]]
    return math.sqrt(sum(squares) / len(squares))
