"""The methods paragraph of a paper: what was done with this study, in its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdata.arrays import Shown
from hopdata.errors import counted
from hopdata.messages import Message

BIBTEX = Path(__file__).with_name("references.bib")
# Packages whose versions a paper states.
STATED = ("numpy", "scipy", "numba", "snakemake")
# A method that finds the contacts -> how it is said.
FOUND_BY = {
    "kink": "report.methods_by_kink",
    "velocity_minimum": "report.methods_by_minimum",
    "velocity_minimum_parabola": "report.methods_by_minimum",
}
# Key of the reference to hopdata itself, which the text names by its version.
ITSELF = "hopdata"
# How each is cited in the text, by its key among the references.
CITED = {
    "burden2016": "Burden et al. 2016",
    "hemerik2020": "Hemerik et al. 2020",
    "westfall1993": "Westfall and Young 1993",
    "patterson1971": "Patterson and Thompson 1971",
    "carroll2006": "Carroll et al. 2006",
}


@dataclass(frozen=True, repr=False)
class Methods(Shown):
    """A methods paragraph.

    Attributes
    ----------
    text
        Plain sentences with the numbers of the study.
    bibtex
        The references that it cites, as BibTeX.
    """

    text: str
    bibtex: str

    def told(self) -> str:
        """Return the paragraph."""
        return self.text

    def __str__(self) -> str:
        """Return paragraph and references."""
        return f"{self.text}\n\n{self.bibtex}".rstrip("\n")


def methods(
    facts: Mapping[str, Any],
    verdict: Mapping[str, Any] | None,
    recordings: Sequence[Mapping[str, Any]],
    provenance: Mapping[str, Any] | None,
) -> Methods:
    """Return the methods paragraph of a study.

    Parameters
    ----------
    facts : mapping
        From `hopdata.report.page.study_facts`.
    verdict : mapping, optional
        Contents of ``verdict.json``.
    recordings : sequence of mappings
        See `hopdata.report.inputs.ReportInputs`.
    provenance : mapping, optional
        Configuration, seed and versions; what is not known is left out.
    """
    record = provenance or {}
    parts = [
        _of_recordings(facts, recordings),
        _of_contacts(facts),
        _of_sections(facts),
        *_of_verdict(verdict or {}),
        _of_software(record),
    ]
    text = " ".join(str(part) for part in parts if part)
    return Methods(text.replace("\u00a0", " "), _cited_in(text, record))


def _cited_in(text: str, record: Mapping[str, Any]) -> str:
    """Return the references that a text cites, and hopdata itself."""
    entries = BIBTEX.read_text(encoding="utf-8").split("\n@")
    every = [entries[0], *(f"@{one}" for one in entries[1:])]
    found = []
    for entry in every:
        key = entry.partition("{")[2].partition(",")[0]
        if key == ITSELF or CITED[key] in text:
            found.append(entry.strip())
    version = (record.get("versions") or {}).get("hopdata")
    of_version = f"  version = {{{version}}},\n" if version else ""
    return "\n".join(found).replace("  version = {},\n", of_version) + "\n"


def _of_recordings(
    facts: Mapping[str, Any], recordings: Sequence[Mapping[str, Any]]
) -> Message | None:
    """Say what was recorded, or simulated."""
    rates = sorted({one["rate_hz"] for one in recordings if one.get("rate_hz")})
    if not rates or not facts["n_frames"]:
        return None
    one = recordings[0]
    values = {
        "recordings": counted(facts["n_recordings"], "recording"),
        "frames": f"{facts['n_frames']:,}",
        "rate": " and ".join(f"{rate:g}" for rate in rates),
        "body": one.get("n_body"),
        "feet": one.get("n_feet"),
    }
    if facts["simulated"]:
        return Message("report.methods_simulated", values)
    return Message("report.methods_recordings", values)


def _of_contacts(facts: Mapping[str, Any]) -> Message | None:
    if facts["n_used"] is None:
        return None
    number = facts["n_schedules"]
    values = {
        "landings": f"{facts['n_landings']:,}",
        "used": f"{facts['n_used']:,}",
        "excluded": f"{facts['n_excluded']:,}",
        "orders": "in one order" if number == 1 else f"in {number} orders",
        "how": Message(FOUND_BY.get(str(facts["method"]), "report.methods_by_other")),
    }
    name = "report.methods_contacts"
    if facts["n_excluded"] == 0:
        name = "report.methods_contacts_all"
    return Message(name, values)


def _of_sections(facts: Mapping[str, Any]) -> Message | None:
    if not facts["pre"] or not facts["post"]:
        return None
    values = {"pre": facts["pre"], "post": facts["post"]}
    return Message("report.methods_sections", values)


def _of_verdict(verdict: Mapping[str, Any]) -> list[Message]:
    """Say how the answer was found; of a study without a size, that there is none."""
    if not verdict:
        return []
    effect = verdict.get("effect")
    jump_decides = verdict.get("decided_by") == "jump"
    if effect is None and not jump_decides:
        return [_not_judged(verdict)]
    known = verdict.get("n_landings") or 0
    n_fitted = verdict.get("n_window") or known
    counts: dict[str, Any] = {"landings": f"{known:,}", "fitted": f"{n_fitted:,}"}
    counts["far_off"] = _far_off(verdict)
    fitted = Message("report.methods_landings_all", counts)
    if n_fitted < known:
        fitted = Message("report.methods_landings_nearest", counts)
    values = {
        "flips": f"{verdict.get('flips') or 0:,}",
        "confidence": f"{100 * verdict['confidence']:g} %",
        "margin": f"{100 * verdict['margin']:g} %",
        "fitted": fitted,
        **CITED,
    }
    said = [Message("report.methods_map", values)]
    if jump_decides:
        said.append(Message("report.methods_jump", values))
    elif effect is not None:
        values["allowed"] = f"{100 * effect.get('allowed', 0.0):.0f} %"
        said.append(Message("report.methods_size", values))
    return said


def _far_off(verdict: Mapping[str, Any]) -> Message | str:
    """Say how many landings the verdict left out as far off; nothing if none."""
    rows = [len(some) for some in (verdict.get("gross_errors") or {}).values()]
    if not rows:
        return ""
    return Message("report.methods_far_off", {"count": f"{sum(rows):,}"})


def _not_judged(verdict: Mapping[str, Any]) -> Message:
    """Say that no maps were compared, and why."""
    so_far = verdict.get("so_far") or {}
    orders = so_far.get("orders") or []
    known = verdict.get("n_landings") or 0
    few = known < so_far.get("least_landings", 0)
    values = {"landings": f"{known:,}", "least": so_far.get("least_landings")}
    if few and len(orders) == 1:
        return Message("report.methods_few_of_one_order", values)
    if few:
        return Message("report.methods_few", values)
    if len(orders) == 1:
        return Message("report.methods_one_order")
    return Message("report.methods_not_judged")


def _of_software(record: Mapping[str, Any]) -> Message | None:
    versions = record.get("versions") or {}
    if "hopdata" not in versions:
        return None
    others = [f"{name} {versions[name]}" for name in STATED if name in versions]
    values = {
        "version": versions["hopdata"],
        "others": ", ".join(others),
        "seed": (record.get("config") or {}).get("seed", 0),
    }
    return Message("report.methods_software", values)
