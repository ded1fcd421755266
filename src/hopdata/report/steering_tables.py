"""Tables of the steering study: outcomes, what was observed, how well the model predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hopdata.report.formatting import MISSING, count, fixed, is_missing, significant
from hopdata.report.table import Table, scaled

if TYPE_CHECKING:
    import pandas as pd

CONTROLLERS = {
    "printed": "printed",
    "planner": "planner",
    "globalised": "globalised",
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
