"""The report: one HTML page that needs no other file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hopdata.report import landing_tables, overlay_tables, quality, result_tables, verdict
from hopdata.report.facts import study_facts
from hopdata.report.formatting import MISSING, count, significant
from hopdata.report.inputs import ReportFigure, ReportInputs
from hopdata.report.pictures import Picture, picture_of
from hopdata.report.rendering import TEMPLATES, as_yaml, environment
from hopdata.report.steering import steering_content
from hopdata.report.table import Table, mapping_table

if TYPE_CHECKING:
    import pandas as pd

GAPS = "recording_gaps"
# The figures that have a section of their own; any other stands at the end.
PLACES = {
    "verdict": "verdict",
    "fig2_2_sections": "sections",
    "fig2_3_schedule": "touchdowns",
    "fig2_4_prediction": "prediction",
    "fig2_5_distances": "distances",
    "contact_overlay": "overlay",
    "map_matrices": "prediction",
    "stability": "quality",
    "worst_landings": "quality",
    GAPS: "quality",
    "map_errors": "truth",
    "scaling_study": "truth",
}
SHOWN_ELSEWHERE = ("study", "config", "inputs", "versions", "stage_seconds")


def build_report(inputs: ReportInputs) -> str:
    """Build the page of a study.

    Parameters
    ----------
    inputs : ReportInputs
        Tables and figures; parts that are missing are said to be missing, in words.

    Returns
    -------
    str
        A complete HTML document: style and figures are inside, nothing is loaded from elsewhere.

    Raises
    ------
    ConfigError
        If a caption names a fact that does not exist.
    """
    facts = study_facts(inputs)
    all_seen = _all_seen(inputs)
    shown = [f for f in inputs.figures if not (all_seen and f.name == GAPS)]
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            study=inputs.study,
            facts=facts,
            highlights=_highlights(facts, inputs),
            style=(TEMPLATES / "report.css").read_text(encoding="utf-8"),
            pictures=_pictures(shown, facts),
            all_seen=all_seen,
            tables=_tables(inputs),
            notes=[_note(note) for note in (*inputs.notes, *_floor_notes(inputs.floors))],
            verdict_notes=[_note(note) for note in verdict.notes(inputs.verdict)],
            config=as_yaml((inputs.provenance or {}).get("config")),
            count=count,
            steering=None if inputs.steering is None else steering_content(inputs.steering),
        )
    )


def _all_seen(inputs: ReportInputs) -> bool:
    """Whether there is neither a gap nor a fault, so that a figure of them would be empty."""
    seen = [item.get("seen") == 1.0 for item in inputs.recordings]
    return bool(seen) and all(seen) and inputs.faults is not None and inputs.faults.empty


def _highlights(facts: Mapping[str, Any], inputs: ReportInputs) -> list[tuple[str, str, str]]:
    """Name, value and remark of each key number; the value is a dash where it is not known."""
    frames = f"{count(facts['n_frames'])} frames" if facts["n_frames"] else ""
    between = f"pre section {facts['pre']}, post section {facts['post']}"
    feet = max((item.get("n_feet") or 0 for item in inputs.recordings), default=0)
    possible = f"of {count(math.factorial(feet))} possible, in the touchdowns used"
    of_all = [possible] if feet > 1 else []
    apart = [f"median spread of contacts {facts['spread']}"] if facts["spread"] else []
    cards = [
        ("Difference of the maps", facts["verdict"]["difference"], facts["verdict"]["remark"]),
        ("Quality of the data", *quality.summary(inputs.quality)),
        ("Recordings", count(facts["n_recordings"]), frames),
        ("Touchdowns used", count(facts["n_used"]), _of_landings(facts)),
        ("Contact orders seen", count(facts["n_schedules"]), "; ".join(of_all + apart)),
        ("Travel through the touchdown", facts["travel"], between if facts["travel"] else ""),
        (
            "Units of length and time",
            facts["units"],
            "position and velocity errors weigh alike" if facts["units"] else "",
        ),
        ("Affine model over mean", *_gain(inputs.prediction)),
    ]
    if inputs.prediction is not None:
        cards.append(("One model over one per order", *_price_of_one(inputs.prediction)))
    for method, (share, of_all) in facts["labels_right"].items():
        missed = f"; {of_all} of all true landings" if of_all else ""
        cards.append((f"Orders right, {method}", share, f"of those used{missed}"))
    return [(name, _known(value), remark) for name, value, remark in cards]


def _of_landings(facts: Mapping[str, Any]) -> str:
    """Say of how many landings these are, and of how many descents of the body those."""
    if not facts["n_descents"]:
        return ""
    landings, others = facts["n_landings"], facts["n_not_landed"]
    found = f"of {count(landings)} landing{'' if landings == 1 else 's'}"
    found += f", {count(facts['n_excluded'])} excluded"
    of_descents = f"; in {count(others)} more of {count(facts['n_descents'])} descents"
    return found + (f"{of_descents} no foot of the study landed" if others else "")


def _known(value: str | None) -> str:
    return "not known" if value in (None, "", MISSING) else str(value)


def _price_of_one(prediction: pd.DataFrame) -> tuple[str | None, str]:
    """Error of the unspecialised affine model over that of the specialised ones."""
    medians = dict(zip(prediction["model"].astype(str), prediction["median"], strict=True))
    one, many = medians.get("all", 0), medians.get("specialised", 0)
    if not (one > 0 and many > 0):
        return None, "needs an affine model of each order"
    return significant(
        one / many, 3
    ), "ratio of median MSE; curvature alone also raises it above 1: see the verdict"


def _gain(prediction: pd.DataFrame | None) -> tuple[str | None, str]:
    """Error of the affine model over that of the mean, specialised where these were fitted."""
    if prediction is None:
        return None, ""
    medians = dict(zip(prediction["model"].astype(str), prediction["median"], strict=True))
    for affine, mean, which in (("specialised", "specialised_mean", "both specialised"),
                                ("all", "mean", "both unspecialised")):  # fmt: skip
        if medians.get(affine, 0) > 0 and medians.get(mean, 0) > 0:
            return significant(medians[affine] / medians[mean], 2), f"ratio of median MSE, {which}"
    return None, ""


def _pictures(
    figures: Sequence[ReportFigure], facts: Mapping[str, Any]
) -> dict[str, list[Picture]]:
    """Pictures by the section that they stand in."""
    placed: dict[str, list[Picture]] = {place: [] for place in (*PLACES.values(), "others")}
    for figure in figures:
        placed[PLACES.get(figure.name, "others")].append(picture_of(figure, facts))
    return placed


def _tables(inputs: ReportInputs) -> dict[str, Table | None]:
    record = inputs.provenance or {}
    others = {key: value for key, value in record.items() if key not in SHOWN_ELSEWHERE}
    digests = ("source file", "SHA-256")
    return {
        "test": verdict.table_of_test(inputs.verdict),
        "windows": verdict.windows_table(inputs.verdict),
        "quality": quality.quality_table(inputs.quality),
        "faults": quality.faults_table(inputs.faults),
        "remarks": quality.remarks_table(inputs.remarks),
        "excluded": quality.excluded_table(inputs.touchdowns),
        "recordings": landing_tables.recordings_table(inputs.recordings),
        "filled": landing_tables.filled_table(inputs.filled, inputs.touchdowns),
        "floor": landing_tables.floor_table(inputs.floors),
        "sections": landing_tables.sections_table(inputs.sections),
        "schedules": landing_tables.schedules_table(inputs.touchdowns),
        "exclusions": landing_tables.exclusions_table(inputs.touchdowns),
        "overlay": overlay_tables.agreement_table(inputs.overlay),
        "unmatched": overlay_tables.unmatched_table(inputs.overlay),
        "thresholds": overlay_tables.thresholds_table(inputs.overlay),
        "prediction": result_tables.prediction_table(inputs.prediction),
        "distances": result_tables.distances_table(inputs.distances),
        "truth": result_tables.truth_table(inputs.truth),
        "origin": mapping_table("Run", ("what", "value"), others),
        "digests": mapping_table("Inputs", digests, record.get("inputs") or {}),
        "versions": mapping_table("Versions", ("package", "version"), record.get("versions") or {}),
        "times": result_tables.times_table(record.get("stage_seconds") or {}),
    }


def _floor_notes(floors: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Say which floor models are of a lower degree than asked for, and why."""
    return [
        f"floor of {name}: degree {floor['degree']} instead of {floor['degree_wanted']}"
        + (f" ({floor['note']})" if floor.get("note") else "")
        for name, floor in floors.items()
        if floor.get("degree", 0) < floor.get("degree_wanted", 0)
    ]


def _note(note: str | Mapping[str, Any]) -> str:
    if isinstance(note, str):
        return note
    what, reason = str(note.get("what", "")), str(note.get("reason", ""))
    return f"{what}: {reason}" if what and reason else what or reason
