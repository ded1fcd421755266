"""The verdict over many subjects: a random-effects model of the squared size.

A size is never negative, so the sizes of subjects without a difference do not average
to zero. The square of the size has an unbiased estimate that may be negative: T less
the contribution of noise. This estimate is averaged, and the root of the mean is the
rms size over subjects. All subjects have equal weight: a study in which chance made the
difference large also has a large error, so weights by error would make the mean too
small. The between-subject variance is that of Paule and Mandel; errors are those of
Hartung and Knapp, but not below those of the model (Röver, Knapp and Friede 2015).

Residual smooth terms shift the kinks of every subject alike, so their effect does not
average out. The ends of the interval therefore allow for as much as in a single study.

The interval of the mean is wide if subjects differ from each other, even if each shows
a clear difference of its own. A group is therefore also "different" if more of its
studies are different than false alarms explain.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.maps.verdict.judge import DIFFERENT, conclude, percent, sentence
from hopdata.maps.verdict.model import one_landing, upper_ends

LEAST_SUBJECTS = 3  # fewer give no estimate of the variance between subjects


@dataclass(frozen=True)
class Combined:
    """Random-effects mean of squared sizes, or of their differences.

    Attributes
    ----------
    n
        Number of subjects.
    mean, error
        Mean of the squared size, and its standard error.
    between
        Standard deviation of the squared size between subjects.
    i2, q, q_p_value
        Share of the scatter that is between subjects, Cochran's Q, and its p-value.
    p_value
        Two-sided p-value for a mean of zero.
    """

    n: int
    mean: float
    error: float
    between: float
    i2: float
    q: float
    q_p_value: float
    p_value: float


@dataclass(frozen=True)
class GroupVerdict:
    """The verdict on a group, about the rms size over its subjects.

    Attributes
    ----------
    conclusion, sentence
        As for a study.
    estimate, low, high, upper_bound
        Size, interval and bound as for a study, as shares of the map.
    alone, alone_p_value
        Number of studies that are different on their own, and the probability of at
        least as many false alarms.
    combined
        The random-effects mean behind these.
    """

    conclusion: str
    sentence: str
    estimate: float
    low: float
    high: float
    upper_bound: float
    alone: int
    alone_p_value: float
    combined: Combined


def combine(squared: FloatArray, variance: FloatArray) -> Combined:
    """Return the random-effects mean of squared sizes (n,) with these variances.

    Raises
    ------
    AnalysisError
        If there are fewer than `LEAST_SUBJECTS`.
    """
    from scipy.stats import chi2, t
    from statsmodels.stats.meta_analysis import combine_effects

    number = len(squared)
    if number < LEAST_SUBJECTS:
        raise AnalysisError.at(
            "group", f"{LEAST_SUBJECTS} subjects with an answer or more", number
        )
    found = combine_effects(
        squared, variance, method_re="iterated", atol=1e-12, maxiter=200
    )
    mean, q = float(found.mean_effect_re), float(found.q)
    error = float(max(found.sd_eff_w_re, found.sd_eff_w_re_hksj))
    between = float(np.sqrt(max(0.0, found.tau2)))
    i2 = max(0.0, 1.0 - (number - 1) / q) if q > 0.0 else 0.0
    p_values = (
        float(chi2.sf(q, number - 1)),
        float(2.0 * t.sf(abs(mean / error), number - 1)),
    )
    return Combined(number, mean, error, between, i2, q, *p_values)


def variance(members: pd.DataFrame) -> float:
    """Return the variance of the squared size of a typical one of these studies."""
    size = max(0.0, float(members["squared"].mean()))
    null, along = members["squared_error"], members["along_error"]
    return float((null**2).mean() + 4.0 * size * (along**2).mean())


def judge_group(
    members: pd.DataFrame, *, margin: float = 0.2, confidence: float = 0.95
) -> GroupVerdict:
    """Judge a group of subjects.

    Parameters
    ----------
    members
        One row per study with an answer: `subject`, and `conclusion`, `squared`,
        `squared_error`, `along_error`, `allowed` and `left` of its verdict.
    margin, confidence
        As for a study.

    Raises
    ------
    AnalysisError
        If there are too few subjects.
    """
    from scipy.stats import binom, t

    # A subject counts by the mean over its conditions, whose errors are independent.
    parts = members.groupby("subject", sort=False)
    of_mean = variance(members) * float((1.0 / parts.size()).mean())
    squared = parts["squared"].mean().to_numpy(float)
    found = combine(squared, np.full(len(squared), of_mean))
    near, up = found.error * t.isf(
        [(1.0 - confidence) / 2.0, 1.0 - confidence], found.n - 1
    )
    estimate, *ends = np.sqrt(max(0.0, found.mean) + np.array([0.0, near, up])).tolist()
    allowed, left = np.sqrt((members[["allowed", "left"]] ** 2).mean()).tolist()
    low = max(0.0, float(np.sqrt(max(0.0, found.mean - near))) - left)
    low /= 1.0 + one_landing(allowed)
    high, bound = upper_ends(ends, allowed)
    sizes = (estimate, low, high, bound)
    alone = int((members["conclusion"] == DIFFERENT).sum())
    chance = float(binom.sf(alone - 1, len(members), 1.0 - confidence))
    conclusion = (
        DIFFERENT if chance < 1.0 - confidence else conclude(low, bound, margin)
    )
    said = sentence(conclusion, sizes, "the contact orders", confidence, margin)
    said = f"Over {found.n} subjects {said[0].lower()}{said[1:]}"
    more = ", more than false alarms explain" * (
        conclusion == DIFFERENT and not low > 0.0
    )
    said += f" Different on their own: {alone} of {len(members)} studies{more}."
    return GroupVerdict(conclusion, said, *sizes, alone, chance, found)


def compare_conditions(
    members: pd.DataFrame, *, confidence: float = 0.95
) -> pd.DataFrame:
    """Compare the conditions within subjects, two at a time.

    Returns
    -------
    DataFrame
        One row per pair of conditions that at least `LEAST_SUBJECTS` subjects share:
        their number `n`; the rms sizes `size_a` and `size_b` over these subjects; the
        mean `difference` of the squares and its interval `low` to `high`, which allows
        for residual smooth terms; `p_value` of no difference, if residual smooth terms
        are the same in both; and `p_holm`, corrected by Holm's method for the number of
        rows.
    """
    from scipy.stats import t
    from statsmodels.stats.multitest import multipletests

    rows, left = [], float(np.sqrt((members["left"] ** 2).mean()))
    parts = dict(list(members.groupby("condition", sort=False)))
    for a, b in combinations(parts, 2):
        both = parts[a].merge(parts[b], on="subject", suffixes=("", "_b"))
        if len(both) < LEAST_SUBJECTS:
            continue
        differences = (both["squared"] - both["squared_b"]).to_numpy(float)
        found = combine(
            differences, np.full(len(both), variance(parts[a]) + variance(parts[b]))
        )
        sizes = [
            np.sqrt(max(0.0, both[name].mean())) for name in ("squared", "squared_b")
        ]
        near = t.isf((1.0 - confidence) / 2.0, found.n - 1) * found.error + left * sum(
            sizes
        )
        ends = (found.mean, found.mean - near, found.mean + near, found.p_value)
        rows.append((a, b, found.n, *sizes, *ends))
    names = [
        "condition_a",
        "condition_b",
        "n",
        "size_a",
        "size_b",
        "difference",
        "low",
        "high",
    ]
    table = pd.DataFrame(rows, columns=[*names, "p_value"])
    return table.assign(
        p_holm=multipletests(table["p_value"], method="holm")[1] if rows else []
    )


def told_apart(conditions: pd.DataFrame, *, confidence: float = 0.95) -> str:
    """Return a sentence on the conditions that differ, with their sizes; empty if none do."""
    sure = (conditions["low"] * conditions["high"] > 0) & (
        conditions["p_holm"] < 1 - confidence
    )
    pairs = [
        " and ".join(
            f"{row[f'condition_{one}']} ({percent(row[f'size_{one}'])})" for one in "ab"
        )
        for row in conditions[sure].to_dict("records")
    ]
    return f" Conditions differ: {'; '.join(pairs)}." if pairs else ""
