"""The page of the steering study."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdata.arrays import pd
from hopdata.report import formatting as show
from hopdata.report import tables as result_tables
from hopdata.report.inputs import PageInputs, as_yaml, placed_pictures, rendered
from hopdata.steering.control.forecast import warning
from hopdata.steering.experiments.examples import shown_run

_FOLDER = Path(__file__).parent
#: Texts that readers see in place of names.
WORDS: dict[str, Any] = tomllib.loads((_FOLDER / "words.toml").read_text("utf-8"))
CONTROLLERS: dict[str, str] = WORDS["controllers"]
EXPERIMENTS: dict[str, str] = WORDS["experiments"]
RUN_BY: dict[str, str] = WORDS["run_by"]
PLACES: dict[str, str] = WORDS["places"]
NOTES: dict[str, str] = WORDS["notes"]


@dataclass(frozen=True)
class SteeringInputs(PageInputs):
    """Further contents of the steering page.

    Parameters
    ----------
    outcomes, horizons : DataFrame, optional
        ``outcomes.csv``, ``horizons.csv``.
    counts : sequence of mappings, optional
        ``observed.json``: for each recording, frames, stances and hops, and what was
        left out.
    scores : DataFrame, optional
        ``model_scores.csv``.
    examples : DataFrame, optional
        ``examples.csv``: the runs that the figures show.
    """

    outcomes: pd.DataFrame | None = None
    horizons: pd.DataFrame | None = None
    counts: Sequence[Mapping[str, Any]] | None = None
    scores: pd.DataFrame | None = None
    examples: pd.DataFrame | None = None


# Tables of the steering study: outcomes, observations, and how well the model predicts.

# The controller of which something is required.
PLANNER = "planner"


def outcomes_table(outcomes: pd.DataFrame | None) -> show.Table | None:
    """Return one row for each experiment and controller."""
    columns: show.Columns = {
        "experiment": _named("experiment", EXPERIMENTS),
        "controller": _named("controller", CONTROLLERS),
        "worst seed": _of_seed("worst_rate"),
        "median seed": _of_seed("median_rate"),
        "hops": show.decimals("hops", 1),
        "ratio to the true map": show.decimals("ratio", 2),
        "ratio in the worst seed": show.decimals("worst_ratio", 2),
        "not in time": show.counted("late"),
        "fell": show.counted("fell"),
        "touched the board": show.counted("touched"),
        "met": show.text("met"),
    }
    rows = show.records(outcomes)
    title = "Outcomes of the experiments"
    note = NOTES["outcomes"]
    if any(row["controller"] == PLANNER for row in rows):
        note += NOTES["outcomes_of_planner"]
    return show.table_of(title, rows, columns, text_columns=2, note=note)


def _named(key: str, names: Mapping[str, str]) -> show.Cell:
    """Return a function that shows a name as readers know it."""
    return lambda row: names.get(str(row[key]), str(row[key]))


def _of_seed(name: str) -> show.Cell:
    """Return a function that shows a seed's fraction of runs as a count."""

    def cell(row: show.Row) -> str:
        starts = row["runs"] / row["seeds"]
        succeeded = show.significant(row[name] * starts, 3)
        return f"{succeeded} of {show.count(round(starts))}"

    return cell


def horizons_table(horizons: pd.DataFrame | None) -> show.Table | None:
    """Return one row for each horizon of the printed controller."""
    columns: show.Columns = {
        "horizon (hops)": show.counted("horizon"),
        "succeeded": lambda row: (
            f"{show.count(row['succeeded'])} of {show.count(row['runs'])}"
        ),
        "hops": show.decimals("hops", 1),
    }
    note = "Same starts and same random disturbances: only the horizon differs."
    title = "The printed controller to the origin, by its horizon"
    return show.table_of(title, show.records(horizons), columns, note=note)


def observed_table(counts: Sequence[Mapping[str, Any]] | None) -> show.Table | None:
    """Return one row per recording: frames, stances, hops, and the hops used."""
    columns: show.Columns = {
        "recording": show.text("recording"),
        "frames": lambda entry: show.count(sum(entry["frames"].values())),
        "stances": show.counted("stances"),
        "hops": show.counted("pairs"),
        "hops used": show.counted("used"),
    }
    return show.table_of("What was observed", counts or (), columns)


def left_out_table(counts: Sequence[Mapping[str, Any]] | None) -> show.Table | None:
    """Return one row per recording and reason: what was left out."""
    rows = []
    for entry in counts or ():
        unseen = {key: n for key, n in entry["frames"].items() if key != "seen"}
        for what, numbers in (
            ("frames", unseen),
            ("stances and hops", entry["rejected"]),
            ("hops", entry["excluded"]),
        ):
            for reason, number in numbers.items():
                if number:
                    name = str(entry["recording"])
                    rows.append((name, what, reason, show.count(number)))
    if not rows:
        return None
    title = "Left out, or relying on other frames"
    head = ("recording", "what", "reason", "number")
    return show.Table(title, head, tuple(rows), text_columns=3)


def model_table(scores: pd.DataFrame | None) -> show.Table | None:
    """Return one row per set and component: how well other hops are predicted."""
    columns: show.Columns = {
        "frame change": show.text("component"),
        "seed": show.counted("seed"),
        "observed as": show.text("observation"),
        "R2": show.decimals("r2", 3),
        "rms error": lambda row: f"{show.fixed(row['rmse'], 2)} {row['unit']}",
        "within 95 % (%)": show.decimals("coverage", 1, 100),
        "hops learned": show.counted("training_hops"),
        "hops tested": show.counted("test_hops"),
    }
    title = "How well the model predicts a hop"
    note = NOTES["model"]
    return show.table_of(title, show.records(scores), columns, note=note)


def build_steering_report(inputs: SteeringInputs) -> str:
    """Build the page of the steering study: an HTML document that loads nothing.

    Raises
    ------
    ConfigError
        If a caption names a fact that does not exist.
    """
    record = inputs.provenance or {}
    facts = steering_facts(inputs)
    notes = list(inputs.notes)
    if inputs.outcomes is None:
        notes.append(NOTES["no_experiment"])
    notes.extend(_forecasts(inputs.scores))
    return rendered(
        "steering.html.j2",
        own=_FOLDER / "templates",
        study=inputs.study,
        highlights=_highlights(inputs),
        pictures=placed_pictures(inputs.figures, facts, PLACES, "model"),
        tables={
            "outcomes": outcomes_table(inputs.outcomes),
            "horizons": horizons_table(inputs.horizons),
            "observed": observed_table(inputs.counts),
            "left_out": left_out_table(inputs.counts),
            "model": model_table(inputs.scores),
            "truth": result_tables.truth_table(inputs.truth),
            **result_tables.record_tables(record),
        },
        notes=notes,
        config=as_yaml(record.get("config")),
    )


def _forecasts(scores: pd.DataFrame | None) -> Iterator[str]:
    """Yield what is said of models that will probably not reach a point."""
    if scores is None:
        return
    for (seed, observation), of_model in scores.groupby(["seed", "observation"]):
        said = warning(of_model)
        if said is not None:
            yield f"Seed {seed}, observed as {observation}: {said}"


def steering_facts(inputs: SteeringInputs) -> dict[str, Any]:
    """Gather the facts that captions may use.

    Returns
    -------
    dict
        ``starts`` (runs of each experiment, controller and seed) and ``seeds``;
        ``share``, texts by "experiment controller"; ``training_hops``; ``has_planner``
        and ``has_horizons``, whether the planner and other horizons were tried;
        ``examples``, the run shown of each experiment: None if there is none, else its
        ``controller``, ``by`` (words), ``success`` and ``predicted`` (whether the
        controller predicts), and ``beside``, the run of another controller from the
        same start (``by`` and ``success``) or None.
    """
    rows = show.records(inputs.outcomes)
    starts = show.MISSING
    seeds = show.MISSING
    if rows:
        starts = show.count(rows[0]["runs"] / rows[0]["seeds"])
        seeds = show.count(rows[0]["seeds"])
    in_median_seed = _of_seed("median_rate")
    shares = {}
    for row in rows:
        shares[f"{row['experiment']} {row['controller']}"] = in_median_seed(row)
    training_hops = None
    if inputs.scores is not None:
        training_hops = inputs.scores["training_hops"].iloc[0]
    return {
        "has_planner": any(row["controller"] == PLANNER for row in rows),
        "has_horizons": inputs.horizons is not None and not inputs.horizons.empty,
        "examples": {name: _example(inputs.examples, name) for name in EXPERIMENTS},
        "starts": starts,
        "seeds": seeds,
        "share": shares,
        "training_hops": show.count(training_hops),
    }


def _example(examples: pd.DataFrame | None, experiment: str) -> dict[str, Any] | None:
    """Return facts of the run that is shown of an experiment; None if none is."""
    if examples is None:
        return None
    run = shown_run(examples, experiment)
    if run.empty:
        return None
    controller = str(run["controller"].iloc[0])
    is_other = examples["controller"] != controller
    other = examples[(examples["experiment"] == experiment) & is_other]
    beside = None
    if not other.empty:
        by = RUN_BY[str(other["controller"].iloc[0])]
        beside = {"by": by, "success": bool(other["success"].iloc[0])}
    return {
        "beside": beside,
        "controller": controller,
        "by": RUN_BY[controller],
        "success": bool(run["success"].iloc[0]),
        "predicted": bool(run.loc[run["curve"] == "response", "x_m"].notna().any()),
    }


def _highlights(inputs: SteeringInputs) -> list[tuple[str, str, str]]:
    """Return name, value and remark of each key number."""
    cards = []
    rows = show.records(inputs.outcomes)
    tried = {row["controller"] for row in rows}
    first = next((name for name in RUN_BY if name in tried), None)
    in_worst_seed = _of_seed("worst_rate")
    for row in rows:
        if first is None or row["controller"] != first:
            continue
        experiment = EXPERIMENTS[row["experiment"]]
        name = experiment[0].upper() + experiment[1:]
        seeds = "one seed"
        if row["seeds"] > 1:
            seeds = f"worst of {row['seeds']} seeds"
        hops = show.fixed(row["hops"], 0)
        remark = f"{RUN_BY[first]}, {seeds}; median {hops} hops; simulated"
        cards.append((name, in_worst_seed(row), remark))

    used = sum(entry["used"] for entry in inputs.counts or ())
    pairs = sum(entry["pairs"] for entry in inputs.counts or ())
    left_out = f"of {show.count(pairs)}; those left out are listed below"
    cards.append(("Hops used", show.count(used), left_out))

    truth = inputs.truth or {}
    errors = {"heading_rms": "Error of the heading", "boom_angle_rms": "Boom angle"}
    for key, name in errors.items():
        if key in truth:
            value = show.fixed(truth[key]["value"], 1)
            text = show.with_unit(value, str(truth[key]["unit"]))
            cards.append((name, text, "rms, against the simulator"))
    return cards
