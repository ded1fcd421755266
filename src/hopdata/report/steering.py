"""The steering study on a page of its own, or as sections of the study's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hopdata.jobs import read_json, read_table
from hopdata.report import tables as result_tables
from hopdata.report.formatting import (
    MISSING,
    Table,
    count,
    fixed,
    is_missing,
    mapping_table,
    scaled,
    significant,
    with_unit,
)
from hopdata.report.inputs import (
    TEMPLATES,
    Picture,
    SteeringInputs,
    as_yaml,
    environment,
    picture_of,
    read_figures,
)

if TYPE_CHECKING:
    import pandas as pd

# Tables of the steering study: outcomes, what was observed, how well the model predicts.

CONTROLLERS = {
    "printed": "printed",
    "planner": "planner",
    "ceiling": "knows the true map",
}
EXPERIMENTS = {
    "origin": "origin, free",
    "turn": "half turn, free",
    "origin_board": "origin, board in the way",
    "turn_board": "half turn, board in the way",
}
STARTS = {"facing": "facing the origin", "any": "any heading"}


def outcomes_table(outcomes: pd.DataFrame | None) -> Table | None:
    """One row for each experiment, start and controller."""
    if outcomes is None or outcomes.empty:
        return None
    rows = tuple(_outcome(row) for row in outcomes.to_dict("records"))
    head = (
        "experiment",
        "start",
        "controller",
        "succeeded",
        "share (%)",
        "hops",
        "hops of those that knew",
        "not in time",
        "left again",
        "fell",
        "target",
        "met",
    )
    note = (
        "Brackets: intervals (Clopper-Pearson; of the median by order statistics; of ratios by a "
        "paired bootstrap). Hops: median over the runs that succeeded, and as a multiple of the "
        "hops of the policy that knows the true map, from the same starts."
    )
    return Table("Outcomes of the experiments", head, rows, text_columns=3, note=note)


def _outcome(row: Mapping[Any, Any]) -> tuple[str, ...]:
    rate, low, high = (scaled(row[key], 100) for key in ("rate", "rate_low", "rate_high"))
    return (
        EXPERIMENTS.get(str(row["experiment"]), str(row["experiment"])),
        STARTS.get(str(row["start"]), str(row["start"])),
        CONTROLLERS.get(str(row["controller"]), str(row["controller"])),
        f"{count(row['succeeded'])} of {count(row['runs'])}",
        _ranged(rate, low, high, 0),
        _ranged(row["hops"], row["hops_low"], row["hops_high"], 1),
        _ranged(row["hops_ratio"], row["ratio_low"], row["ratio_high"], 2),
        *(count(row[key]) for key in ("late", "left", "fell")),
        _asked(row),
        MISSING if is_missing(row["met"]) or not row["met"] else str(row["met"]),
    )


def _ranged(value: Any, low: Any, high: Any, decimals: int) -> str:
    if is_missing(value):
        return MISSING
    text = fixed(value, decimals)
    known = not is_missing(low) and not is_missing(high)
    return f"{text} ({fixed(low, decimals)} to {fixed(high, decimals)})" if known else text


def _asked(row: Mapping[Any, Any]) -> str:
    if is_missing(row["asked_rate"]):
        return MISSING
    asked = f"{significant(scaled(row['asked_rate'], 100), 3)} %"
    if is_missing(row["asked_ratio"]):
        return asked
    return f"{asked}, {significant(row['asked_ratio'], 2)} times the hops"


def observed_table(counts: Sequence[Mapping[str, Any]] | None) -> Table | None:
    """One row a recording: frames, stances and hops, and how many of these are used."""
    if not counts:
        return None
    rows = tuple(
        (
            str(entry["recording"]),
            count(sum(entry["frames"].values())),
            count(entry["stances"]),
            count(entry["pairs"]),
            count(entry["used"]),
        )
        for entry in counts
    )
    head = ("recording", "frames", "stances", "hops", "hops used")
    return Table("What was observed", head, rows)


def left_out_table(counts: Sequence[Mapping[str, Any]] | None) -> Table | None:
    """One row a recording and reason: frames, stances and hops that were left out."""
    rows = tuple(
        (str(entry["recording"]), what, reason, count(number))
        for entry in counts or ()
        for what, numbers in (
            ("frames", {k: v for k, v in entry["frames"].items() if k != "seen"}),
            ("stances and hops", entry["rejected"]),
            ("hops", entry["excluded"]),
        )
        for reason, number in numbers.items()
        if number
    )
    if not rows:
        return None
    head = ("recording", "what", "reason", "number")
    return Table("What was left out, or leans on other frames", head, rows, text_columns=3)


def model_table(scores: pd.DataFrame | None) -> Table | None:
    """One row a set and component: how well the hops that were not learned from are predicted."""
    if scores is None or scores.empty:
        return None
    rows = tuple(
        (
            str(row["component"]),
            count(row["set"]),
            fixed(row["r2"], 3),
            f"{fixed(row['rmse'], 2)} {row['unit']}",
            fixed(scaled(row["coverage"], 100), 1),
            count(row["training_hops"]),
            count(row["test_hops"]),
        )
        for row in scores.to_dict("records")
    )
    head = (
        "frame change",
        "set",
        "R2",
        "rms error",
        "within 95 % (%)",
        "hops learned",
        "hops tested",
    )
    note = (
        "On the hops that were not learned from; chance at each hop is part of the error. Each "
        "random set of hops gives a model; the starts of experiments take turns with them."
    )
    return Table("How well the model predicts a hop", head, rows, note=note)


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
DRAWN = {"planner": "the planner"}
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
            "outcomes": outcomes_table(inputs.outcomes),
            "observed": observed_table(inputs.counts),
            "left_out": left_out_table(inputs.counts),
            "model": model_table(inputs.scores),
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
        name = f"{EXPERIMENTS[row['experiment']]}, {CONTROLLERS[row['controller']]}"
        low, high = (fixed(100 * row[key], 0) for key in ("rate_low", "rate_high"))
        hops = "" if is_missing(row["hops"]) else f"; median {fixed(row['hops'], 1)} hops"
        cards.append(
            (
                name[0].upper() + name[1:],
                f"{count(row['succeeded'])} of {count(row['runs'])}",
                f"{STARTS[row['start']]}; {low} to {high} %{hops}",
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
