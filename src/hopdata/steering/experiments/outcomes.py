"""The outcomes of all runs in a table: success rates and hops to the goal, with intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.steering.experiments.intervals import median_interval, rate_interval, ratio_interval
from hopdata.steering.experiments.policies import CEILING, PLANNER, PRINTED
from hopdata.steering.experiments.tasks import ANY, FACING, FELL, LATE, LEFT
from hopdata.steering.streams import BOOTSTRAP

if TYPE_CHECKING:
    import pandas as pd

# What is asked of whom: the least share of runs that succeed.
ASKED = {
    ("origin", FACING, PRINTED): 24 / 30,
    ("turn", ANY, PRINTED): 1.0,
    ("origin", ANY, PLANNER): 27 / 30,
    ("origin_board", ANY, PLANNER): 24 / 30,
}
# The most hops, in those of the policy that knows the true map.
ASKED_RATIO = {("origin", ANY, PLANNER): 1.3, ("origin_board", ANY, PLANNER): 1.3}

GROUP = ["experiment", "start", "controller"]


def outcome_table(runs: pd.DataFrame, *, seed: int, confidence: float = 0.95) -> pd.DataFrame:
    """Sum up runs, one row for each experiment, start and controller.

    Parameters
    ----------
    runs : DataFrame
        One row a run, as from `hopdata.steering.experiments.study.run_experiment`.
    seed : int
        Of the bootstrap of ratios.
    confidence : float
        Of all intervals.

    Returns
    -------
    DataFrame
        ``experiment, start, controller, runs, succeeded, rate`` and its interval
        ``rate_low, rate_high``; ``hops`` (median over the runs that succeeded) with
        ``hops_low, hops_high``; ``late, left, fell`` (runs that failed so); ``stances, blind``
        (stances planned at, and those at which nothing was known); ``paired_starts, hops_ratio,
        ratio_low, ratio_high`` (hops over those of the policy that knows the map, over starts from
        which both succeeded); ``asked_rate, asked_ratio`` (NaN where nothing is asked) and ``met``
        (whether all that is asked holds; empty where nothing is).
    """
    import pandas as pd

    rows = []
    for key, group in runs.groupby(GROUP, sort=False):
        best = runs[
            (runs["experiment"] == key[0]) & (runs["start"] == key[1])
            & (runs["controller"] == CEILING)
        ]  # fmt: skip
        rows.append(_row(key, group, best, seed, confidence))
    return pd.DataFrame(rows)


def _row(
    key: Any, group: pd.DataFrame, best: pd.DataFrame, seed: int, confidence: float
) -> dict[str, Any]:
    succeeded = group["success"].astype(bool)
    hops = group.loc[succeeded, "hops"].to_numpy(dtype=float)
    rate_low, rate_high = rate_interval(int(succeeded.sum()), len(group), confidence)
    hops_low, hops_high = median_interval(hops, confidence)
    reasons = group["reason"].value_counts()
    row = {
        **dict(zip(GROUP, key, strict=True)),
        "runs": len(group),
        "succeeded": int(succeeded.sum()),
        "rate": float(succeeded.mean()),
        "rate_low": rate_low,
        "rate_high": rate_high,
        "hops": float(np.median(hops)) if len(hops) else float("nan"),
        "hops_low": hops_low,
        "hops_high": hops_high,
        "late": int(reasons.get(LATE, 0)),
        "left": int(reasons.get(LEFT, 0)),
        "fell": int(reasons.get(FELL, 0)),
        "stances": int(group["stances"].sum()),
        "blind": int(group["blind"].sum()),
    }
    row |= _ratio(group[succeeded], best[best["success"].astype(bool)], seed, confidence)
    asked = {"asked_rate": ASKED.get(key, np.nan), "asked_ratio": ASKED_RATIO.get(key, np.nan)}
    return row | asked | {"met": _met(row, asked)}


def _ratio(group: pd.DataFrame, best: pd.DataFrame, seed: int, confidence: float) -> dict[str, Any]:
    pairs = group.merge(best, on="run", suffixes=("", "_best"))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(BOOTSTRAP,)))
    ratio, low, high = ratio_interval(
        pairs["hops"], pairs["hops_best"], rng=rng, confidence=confidence
    )
    return {
        "paired_starts": len(pairs), "hops_ratio": ratio, "ratio_low": low, "ratio_high": high
    }  # fmt: skip


def _met(row: dict[str, Any], asked: dict[str, float]) -> str:
    if np.isnan(asked["asked_rate"]):
        return ""
    often = row["rate"] >= asked["asked_rate"] - 1e-9
    soon = np.isnan(asked["asked_ratio"]) or row["hops_ratio"] <= asked["asked_ratio"]
    return "yes" if often and soon else "no"
