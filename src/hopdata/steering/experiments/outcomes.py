"""The outcomes of all runs in a table: success rates and hops to the goal, with intervals."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, pd
from hopdata.blas import one_blas_thread
from hopdata.rigid import wrapped
from hopdata.steering.excitation import BOOTSTRAP
from hopdata.steering.experiments import tasks
from hopdata.steering.models.tabulated import FrameChangeMap
from hopdata.steering.trial import TrueFrameChanges

# Intervals for few runs: of a rate, of a median, of a ratio of medians.


def rate_interval(successes: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a rate after Clopper and Pearson (1934), never too narrow.

    Parameters
    ----------
    successes, runs : int
    confidence : float
        Of the two-sided interval.
    """
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    failures = runs - successes
    low = 0.0 if successes == 0 else float(betaincinv(successes, failures + 1, tail))
    high = 1.0 if failures == 0 else float(betaincinv(successes + 1, failures, 1 - tail))
    return low, high


def median_interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a median by order statistics, whatever the distribution.

    Parameters
    ----------
    values : (n,) array
    confidence : float
        At least this; NaN if `values` are too few for it.
    """
    from scipy.special import bdtr

    ordered = np.sort(np.asarray(values, dtype=float))
    n = len(ordered)
    outside = bdtr(np.arange(max(n, 1)), max(n, 1), 0.5)  # P(at most r of n are below the median)
    far = np.flatnonzero(outside <= (1 - confidence) / 2)
    if n == 0 or not len(far):
        return float("nan"), float("nan")
    r = int(far[-1])
    return float(ordered[r]), float(ordered[n - 1 - r])


def ratio_interval(
    values: ArrayLike,
    others: ArrayLike,
    *,
    rng: np.random.Generator,
    confidence: float = 0.95,
    draws: int = 2000,
) -> tuple[float, float, float]:
    """Return the ratio of two medians over paired runs, with its bootstrap interval.

    Parameters
    ----------
    values, others : (n,) arrays
        Pairs: both of one start.
    rng : numpy Generator
        Source of the draws of pairs.
    confidence : float
    draws : int

    Returns
    -------
    ratio, low, high : float
        NaN without pairs; the interval, too, if they are so few that the medians have none.
    """
    pairs = np.column_stack([np.asarray(values, dtype=float), np.asarray(others, dtype=float)])
    if not len(pairs):
        return float("nan"), float("nan"), float("nan")
    drawn = np.median(pairs[rng.integers(0, len(pairs), (draws, len(pairs)))], axis=1)
    tail = (1 - confidence) / 2
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [tail, 1 - tail])
    medians = np.median(pairs, axis=0)
    if np.isnan(median_interval(pairs[:, 0], confidence)[0]):  # a few draws would look certain
        low = high = np.nan
    return float(medians[0] / medians[1]), float(low), float(high)


# What is asked of whom: the least share of runs that succeed.
ASKED = {
    ("origin", tasks.FACING, tasks.PRINTED): 24 / 30,
    ("turn", tasks.ANY, tasks.PRINTED): 1.0,
    ("origin", tasks.ANY, tasks.PLANNER): 27 / 30,
    ("origin_board", tasks.ANY, tasks.PLANNER): 24 / 30,
}
# The most hops, in those of the policy that knows the true map.
ASKED_RATIO = {
    ("origin", tasks.ANY, tasks.PLANNER): 1.3,
    ("origin_board", tasks.ANY, tasks.PLANNER): 1.3,
}

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
    rows = []
    for key, group in runs.groupby(GROUP, sort=False):
        best = runs[
            (runs["experiment"] == key[0]) & (runs["start"] == key[1])
            & (runs["controller"] == tasks.CEILING)
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
    ways = {"late": tasks.LATE, "left": tasks.LEFT, "fell": tasks.FELL}
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
        **{name: int(reasons.get(reason, 0)) for name, reason in ways.items()},
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


# What was observed and learned against what the simulator knows.

SAME_STANCE_S = 0.1  # a sixth of a hop
COMPONENTS = (("x", "mm", 1e3), ("y", "mm", 1e3), ("heading", "deg", 180 / np.pi))

Score: TypeAlias = tuple[float, str, str]  # value, unit, what it is


@one_blas_thread()
def truth_entries(
    motion: pd.DataFrame,
    true_motion: pd.DataFrame,
    stances: pd.DataFrame,
    true_stances: pd.DataFrame,
    model: FrameChangeMap,
    true_map: TrueFrameChanges,
) -> dict[str, dict[str, Any]]:
    """Return name to ``value, unit, what`` of each score.

    Parameters
    ----------
    motion, true_motion : DataFrame
        One row a frame: pose and ``boom_angle_rad``; the true one with ``tilt_rad``.
    stances, true_stances : DataFrame
        One row a stance, ``time_s`` and ``follows``: whether the stance before is a hop before.
    model : FrameChangeMap
    true_map : TrueFrameChanges
    """
    scores = {
        **_pose_scores(motion, true_motion),
        **_stance_scores(stances, true_stances),
        **_model_scores(model, true_map),
    }
    return {
        name: {"value": float(value), "unit": unit, "what": what}
        for name, (value, unit, what) in scores.items()
    }


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def _pose_scores(motion: pd.DataFrame, true: pd.DataFrame) -> dict[str, Score]:
    away = motion[["x_m", "y_m"]].to_numpy() - true[["x_m", "y_m"]].to_numpy()
    turned = wrapped((motion["heading_rad"] - true["heading_rad"]).to_numpy())
    boom = wrapped((motion["boom_angle_rad"] - true["boom_angle_rad"]).to_numpy())
    offset, tilt = float(np.nanmean(turned)), true["tilt_rad"].to_numpy()
    heading = "heading, rms error about its mean"
    return {
        "position_rms": (1e3 * _rms(away), "mm", "position per axis, rms error"),
        "heading_rms": (1e3 * _rms(turned - offset), "mrad", heading),
        "heading_offset": (1e3 * offset, "mrad", "heading, mean error"),
        "boom_angle_rms": (1e3 * _rms(boom), "mrad", "boom angle, rms error"),
        "tilt_rms": (1e3 * _rms(tilt), "mrad", "tilt, rms"),
        "frames_without_pose": (motion["x_m"].isna().sum(), "1", "frames without a pose"),
    }


def _stance_scores(stances: pd.DataFrame, true: pd.DataFrame) -> dict[str, Score]:
    """Pairs of stances that were missed, and that were invented."""
    found, real = _pair_times(stances), _pair_times(true)
    same = np.abs(found[:, None] - real).max(axis=2, initial=0.0) <= SAME_STANCE_S
    missed, invented = (~same.any(axis=0)).sum(), (~same.any(axis=1)).sum()
    return {
        "true_pairs": (len(real), "1", "consecutive stances, true pairs"),
        "missed_pairs": (missed, "1", "pairs of stances missed"),
        "invented_pairs": (invented, "1", "pairs of stances invented"),
    }


def _pair_times(stances: pd.DataFrame) -> FloatArray:
    time, second = stances["time_s"].to_numpy(), np.flatnonzero(stances["follows"].astype(bool))
    return np.column_stack([time[second - 1], time[second]])


def _model_scores(model: FrameChangeMap, true_map: TrueFrameChanges) -> dict[str, Score]:
    """Errors of the learned map on the grid of the true one, averaged over the swing before."""
    angle, swing = np.meshgrid(true_map.boom_angle_rad, true_map.swing_rad, indexing="ij")
    true = true_map.average().reshape(-1, 3)
    errors = model.change(angle.ravel(), swing.ravel()) - true
    scores: dict[str, Score] = {}
    for (name, unit, factor), error, map_ in zip(COMPONENTS, errors.T, true.T, strict=True):
        explained = 1 - np.mean(error**2) / np.var(map_)
        what = f"frame change in {name}"
        scores[f"model_{name}_rms"] = factor * _rms(error), unit, f"{what}, rms error of the model"
        scores[f"model_{name}_r2"] = explained, "1", f"{what}, share of the true map explained (R2)"
    return scores
