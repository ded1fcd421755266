"""The steering study on a page of its own, or as sections of the study's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hopdata.arrays import pd
from hopdata.jobs import read_json, read_table
from hopdata.report import formatting as show
from hopdata.report import tables as result_tables
from hopdata.report.inputs import (
    Picture,
    SteeringInputs,
    as_yaml,
    picture_of,
    read_figures,
    rendered,
)

# Tables of the steering study: outcomes, what was observed, how well the model predicts.

CONTROLLERS = {"printed": "printed", "planner": "planner", "ceiling": "knows the true map"}
EXPERIMENTS = {
    "origin": "origin, free",
    "turn": "half turn, free",
    "origin_board": "origin, board in the way",
    "turn_board": "half turn, board in the way",
}
STARTS = {"facing": "facing the origin", "any": "any heading"}


def outcomes_table(outcomes: pd.DataFrame | None) -> show.Table | None:
    """One row for each experiment, start and controller."""
    columns: show.Columns = {
        "experiment": lambda row: EXPERIMENTS.get(str(row["experiment"]), str(row["experiment"])),
        "start": lambda row: STARTS.get(str(row["start"]), str(row["start"])),
        "controller": lambda row: CONTROLLERS.get(str(row["controller"]), str(row["controller"])),
        "succeeded": _succeeded,
        "share (%)": _ranged("rate", "rate_low", "rate_high", 0, 100),
        "hops": _ranged("hops", "hops_low", "hops_high", 1),
        "hops of those that knew": _ranged("hops_ratio", "ratio_low", "ratio_high", 2),
        "not in time": show.counted("late"),
        "left again": show.counted("left"),
        "fell": show.counted("fell"),
        "target": _asked,
        "met": show.text("met"),
    }
    note = (
        "Brackets: intervals (Clopper-Pearson; of the median by order statistics; of ratios by a "
        "paired bootstrap). Hops: median over the runs that succeeded, and as a multiple of the "
        "hops of the policy that knows the true map, from the same starts."
    )
    rows = show.records(outcomes)
    return show.table_of("Outcomes of the experiments", rows, columns, text_columns=3, note=note)


def _succeeded(row: Mapping[Any, Any]) -> str:
    return f"{show.count(row['succeeded'])} of {show.count(row['runs'])}"


def _ranged(key: str, low: str, high: str, digits: int, factor: float = 1.0) -> show.Cell:
    """Return what shows a number times a factor with its interval, if this is known."""

    def cell(row: show.Row) -> str:
        shown, first, last = (
            show.fixed(show.scaled(row[name], factor), digits) for name in (key, low, high)
        )
        return shown if show.MISSING in (shown, first, last) else f"{shown} ({first} to {last})"

    return cell


def _asked(row: Mapping[Any, Any]) -> str:
    if show.is_missing(row["asked_rate"]):
        return show.MISSING
    asked = f"{show.significant(show.scaled(row['asked_rate'], 100), 3)} %"
    if show.is_missing(row["asked_ratio"]):
        return asked
    return f"{asked}, {show.significant(row['asked_ratio'], 2)} times the hops"


def observed_table(counts: Sequence[Mapping[str, Any]] | None) -> show.Table | None:
    """One row a recording: frames, stances and hops, and how many of these are used."""
    columns: show.Columns = {
        "recording": show.text("recording"),
        "frames": lambda entry: show.count(sum(entry["frames"].values())),
        "stances": show.counted("stances"),
        "hops": show.counted("pairs"),
        "hops used": show.counted("used"),
    }
    return show.table_of("What was observed", counts or (), columns)


def left_out_table(counts: Sequence[Mapping[str, Any]] | None) -> show.Table | None:
    """One row a recording and reason: frames, stances and hops that were left out."""
    rows = tuple(
        (str(entry["recording"]), what, reason, show.count(number))
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
    return show.Table("What was left out, or leans on other frames", head, rows, text_columns=3)


def model_table(scores: pd.DataFrame | None) -> show.Table | None:
    """One row a set and component: how well the hops that were not learned from are predicted."""
    columns: show.Columns = {
        "frame change": show.text("component"),
        "set": show.counted("set"),
        "R2": show.decimals("r2", 3),
        "rms error": lambda row: f"{show.fixed(row['rmse'], 2)} {row['unit']}",
        "within 95 % (%)": show.decimals("coverage", 1, 100),
        "hops learned": show.counted("training_hops"),
        "hops tested": show.counted("test_hops"),
    }
    note = (
        "On the hops that were not learned from; chance at each hop is part of the error. Each "
        "random set of hops gives a model; the starts of experiments take turns with them."
    )
    title = "How well the model predicts a hop"
    return show.table_of(title, show.records(scores), columns, note=note)


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


@dataclass(frozen=True)
class SteeringContent:
    """The sections as the templates need them."""

    highlights: list[tuple[str, str, str]]
    pictures: Mapping[str, list[Picture]]
    tables: Mapping[str, show.Table | None]
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
    return rendered(
        "steering.html.j2",
        study=inputs.study,
        steering=steering_content(inputs),
        tables=result_tables.record_tables(record),
        config=as_yaml(record.get("config")),
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
        share[key] = _succeeded(row)
    shown = next((row["controller"] for row in rows if row["controller"] in DRAWN), "")
    hops = None if inputs.scores is None else inputs.scores["training_hops"].iloc[0]
    return {
        "starts": show.count(rows[0]["runs"]) if rows else show.MISSING,
        "share": share,
        "training_hops": show.count(hops),
        "shown": shown,
        "controller": DRAWN.get(shown, "the recommended controller"),
    }


def _highlights(inputs: SteeringInputs) -> list[tuple[str, str, str]]:
    """Name, value and remark of each key number."""
    cards = []
    rows = [] if inputs.outcomes is None else inputs.outcomes.to_dict("records")
    for row in rows:
        if show.is_missing(row["asked_rate"]):
            continue
        name = f"{EXPERIMENTS[row['experiment']]}, {CONTROLLERS[row['controller']]}"
        low, high = (show.fixed(100 * row[key], 0) for key in ("rate_low", "rate_high"))
        hops = "" if show.is_missing(row["hops"]) else f"; median {show.fixed(row['hops'], 1)} hops"
        cards.append(
            (
                name[0].upper() + name[1:],
                _succeeded(row),
                f"{STARTS[row['start']]}; {low} to {high} %{hops}",
            )
        )
    used = sum(entry["used"] for entry in inputs.counts or ())
    pairs = sum(entry["pairs"] for entry in inputs.counts or ())
    cards.append(
        ("Hops used", show.count(used), f"of {show.count(pairs)}; what was left out stands below")
    )
    for key, name in (("heading_rms", "Error of the heading"), ("boom_angle_rms", "Boom angle")):
        entry = (inputs.truth or {}).get(key)
        if entry:
            text = show.with_unit(show.fixed(entry["value"], 1), str(entry["unit"]))
            cards.append((name, text, "rms, against the simulator"))
    return cards
