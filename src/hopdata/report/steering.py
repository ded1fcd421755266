"""The steering study on a page of its own, or as sections of the study's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hopdata.jobs import read_json, read_table
from hopdata.report import result_tables, steering_tables
from hopdata.report.formatting import MISSING, count, fixed, is_missing, with_unit
from hopdata.report.inputs import SteeringInputs, read_figures
from hopdata.report.pictures import Picture, picture_of
from hopdata.report.rendering import TEMPLATES, as_yaml, environment
from hopdata.report.table import Table, mapping_table

# The figures that have a section of their own; any other stands with the model.
EXPERIMENT_FIGURES = (
    "steering_outcomes",
    "fig3_5_origin",
    "fig3_6_turn",
    "fig3_8_origin_board",
    "fig3_9_turn_board",
    "steering_film",
)
# Controllers whose runs are drawn: those that a study may recommend.
DRAWN = {"planner": "the planner", "globalised": "the globalised controller"}
SHOWN_ELSEWHERE = ("study", "config", "inputs", "versions", "stage_seconds")


@dataclass(frozen=True)
class SteeringContent:
    """The sections as the templates need them."""

    highlights: list[tuple[str, str, str]]
    pictures: Mapping[str, list[Picture]]
    tables: Mapping[str, Table | None]
    notes: Sequence[str] = field(default_factory=tuple)


def steering_content(inputs: SteeringInputs) -> SteeringContent:
    """Make tables and pictures ready to print.

    Raises
    ------
    ConfigError
        If a caption names a fact that does not exist.
    """
    facts = steering_facts(inputs)
    pictures: dict[str, list[Picture]] = {"experiments": [], "model": []}
    for figure in inputs.figures:
        place = "experiments" if figure.name in EXPERIMENT_FIGURES else "model"
        pictures[place].append(picture_of(figure, facts))
    return SteeringContent(
        highlights=_highlights(inputs),
        pictures=pictures,
        tables={
            "outcomes": steering_tables.outcomes_table(inputs.outcomes),
            "observed": steering_tables.observed_table(inputs.counts),
            "left_out": steering_tables.left_out_table(inputs.counts),
            "model": steering_tables.model_table(inputs.scores),
            "truth": result_tables.truth_table(inputs.truth),
        },
        notes=tuple(inputs.notes),
    )


def build_steering_report(inputs: SteeringInputs) -> str:
    """Build the page of the steering: a complete HTML document that loads nothing.

    Raises
    ------
    ConfigError
        If a caption names a fact that does not exist.
    """
    record = inputs.provenance or {}
    others = {key: value for key, value in record.items() if key not in SHOWN_ELSEWHERE}
    versions = record.get("versions") or {}
    return (
        environment()
        .get_template("steering.html.j2")
        .render(
            study=inputs.study,
            style=(TEMPLATES / "report.css").read_text(encoding="utf-8"),
            steering=steering_content(inputs),
            tables={
                "origin": mapping_table("Run", ("what", "value"), others),
                "digests": mapping_table(
                    "Inputs", ("source file", "SHA-256"), record.get("inputs") or {}
                ),
                "versions": mapping_table("Versions", ("package", "version"), versions),
                "times": result_tables.times_table(record.get("stage_seconds") or {}),
            },
            config=as_yaml(record.get("config")),
        )
    )


def read_steering(
    study: str, files: Mapping[str, Any], *, provenance: Mapping[str, Any] | None = None
) -> SteeringInputs:
    """Read what the page shows.

    Parameters
    ----------
    study : str
    files : mapping
        Paths: ``figures`` and ``captions`` (several), ``counts``, ``scores``, and of a simulated
        robot ``outcomes``, ``truth``.
    provenance : mapping, optional
    """
    notes = []
    if not files.get("outcomes"):
        notes.append(
            "No experiment was made: the frame changes are those of a recorded robot, and there is "
            "no simulation of it to steer."
        )
    return SteeringInputs(
        study=study,
        figures=read_figures(files["figures"], files["captions"]),
        outcomes=read_table(files["outcomes"]) if files.get("outcomes") else None,
        counts=read_json(files["counts"]),
        scores=read_table(files["scores"]),
        truth=read_json(files["truth"]) if files.get("truth") else None,
        provenance=provenance,
        notes=notes,
    )


def read_sections(config: Mapping[str, Any], files: Mapping[str, Any]) -> SteeringInputs | None:
    """Read the same for the study's page, from files whose names begin with ``steering_``.

    None if the configuration does not want them there.
    """
    if not config["steering"]["in_report"]:
        return None
    prefix = "steering_"
    own = {name.removeprefix(prefix): path for name, path in files.items() if prefix in name}
    return read_steering(config["study"], own)


def steering_facts(inputs: SteeringInputs) -> dict[str, Any]:
    """Gather what captions may name.

    Returns
    -------
    dict
        ``starts`` (runs of each experiment and controller), ``share`` and ``hops``: mappings from
        "experiment start controller" to text, "not known" where there is none; ``training_hops``;
        ``shown`` and ``controller``: the controller whose runs are drawn, as in the tables and as
        in a sentence.
    """
    rows = [] if inputs.outcomes is None else inputs.outcomes.to_dict("records")
    share: dict[str, str] = {}
    for row in rows:
        key = f"{row['experiment']} {row['start']} {row['controller']}"
        share[key] = f"{count(row['succeeded'])} of {count(row['runs'])}"
    shown = next((row["controller"] for row in rows if row["controller"] in DRAWN), "")
    hops = None if inputs.scores is None else inputs.scores["training_hops"].iloc[0]
    return {
        "starts": count(rows[0]["runs"]) if rows else MISSING,
        "share": share,
        "training_hops": count(hops),
        "shown": shown,
        "controller": DRAWN.get(shown, "the recommended controller"),
    }


def _highlights(inputs: SteeringInputs) -> list[tuple[str, str, str]]:
    """Name, value and remark of each key number."""
    cards = []
    rows = [] if inputs.outcomes is None else inputs.outcomes.to_dict("records")
    for row in rows:
        if is_missing(row["asked_rate"]):
            continue
        name = (
            f"{steering_tables.EXPERIMENTS[row['experiment']]}, "
            f"{steering_tables.CONTROLLERS[row['controller']]}"
        )
        low, high = (fixed(100 * row[key], 0) for key in ("rate_low", "rate_high"))
        hops = "" if is_missing(row["hops"]) else f"; median {fixed(row['hops'], 1)} hops"
        cards.append(
            (
                name[0].upper() + name[1:],
                f"{count(row['succeeded'])} of {count(row['runs'])}",
                f"{steering_tables.STARTS[row['start']]}; {low} to {high} %{hops}",
            )
        )
    used = sum(entry["used"] for entry in inputs.counts or ())
    pairs = sum(entry["pairs"] for entry in inputs.counts or ())
    cards.append(("Hops used", count(used), f"of {count(pairs)}; what was left out stands below"))
    for key, name in (("heading_rms", "Error of the heading"), ("boom_angle_rms", "Boom angle")):
        entry = (inputs.truth or {}).get(key)
        if entry:
            text = with_unit(fixed(entry["value"], 1), str(entry["unit"]))
            cards.append((name, text, "rms, against the simulator"))
    return cards
