"""The verdict over many subjects: a random-effects model of the squared size.

A size is never negative, so the sizes of subjects without a difference do not average
to zero. The square of the size has an unbiased estimate that may be negative: T less
the contribution of noise. This estimate is averaged, and the root of the mean is the
rms size over subjects. All subjects have equal weight: a study in which chance made the
difference large also has a large error, so weights by error would make the mean too
small. Nor has each its own error: the error of a square grows with the size that chance
gave, so all have the mean one (`variance`). With equal variances the between-subject
variance of Paule and Mandel is the scatter beyond them, and the error of Hartung and
Knapp, not below that of the model (Röver, Knapp and Friede 2015), has a closed form.

Residual smooth terms shift the kinks of every subject alike, so their effect does not
average out. The ends of the interval therefore allow for as much as in a single study.

The interval of the mean is wide if subjects differ from each other, even if each shows
a clear difference of its own. A group is therefore also "different" if more of its
studies are different than false alarms explain.

These are two tests of one group, which share its level (Bonferroni): together they err
in at most 1 - confidence of the groups without a difference. A number of studies is
discrete, so its test has the level that it attains, and the mean has the rest. Halves
would cost more: with 6 or 7 subjects two studies that differ would not be enough.

Conditions are not pooled: an rms over a condition that differs and one that does not is
true of neither. Each has its own answer, and their difference an interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.maps.verdict.judge import conclude
from hopdata.maps.verdict.model import one_landing, upper_ends
from hopdata.maps.verdict.signs import level_of
from hopdata.maps.verdict.words import (
    DIFFERENT,
    as_given,
    at_least,
    at_most,
    percent,
    sentence,
)
from hopdata.messages import Message

#: Least number of subjects of a group.
#: Unit: subjects. Origin: chosen: fewer give no estimate of the variance between them.
LEAST_SUBJECTS = 3

#: Least share of a group's level that the test of the mean has.
#: Unit: 1. Origin: chosen: two of 7 studies and three of 16 are then still enough,
#: which false alarms give in 4.4 and 4.3 % of groups.
LEAST_OF_MEAN = 0.1

#: A probability of false alarms below this is said to be at most this.
#: Unit: 1. Origin: chosen: more digits than a reader needs.
LEAST_CHANCE = 0.001


@dataclass(frozen=True)
class Combined:
    """Random-effects mean of squared sizes, or of their differences.

    Attributes
    ----------
    n
        Number of subjects.
    mean, error
        Mean of the squared size, and its standard error.
    variance
        Variance that noise gives the square of a subject; the same for all.
    between
        Standard deviation of the squared size between subjects.
    i2, q, q_p_value
        Share of the scatter that is between subjects, Cochran's Q (the sum of the
        squared deviations over `variance`), and its p-value.
    p_value
        Two-sided p-value for a mean of zero.
    """

    n: int
    mean: float
    error: float
    variance: float
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


def combine(squared: FloatArray, variance: float) -> Combined:
    """Return the random-effects mean of squared sizes (n,) that all have this variance.

    Raises
    ------
    AnalysisError
        If there are fewer than `LEAST_SUBJECTS`.
    """
    from scipy.stats import chi2, t

    number = len(squared)
    if number < LEAST_SUBJECTS:
        raise AnalysisError.at(
            "group", f"{LEAST_SUBJECTS} subjects with an answer or more", number
        )
    others = number - 1
    mean = float(np.mean(squared))
    scatter = float(np.var(squared, ddof=1))
    q = others * scatter / variance
    beyond = max(0.0, scatter - variance)
    error = float(np.sqrt(max(scatter, variance) / number))
    i2 = 0.0
    if beyond > 0.0:
        i2 = beyond / scatter
    return Combined(
        n=number,
        mean=mean,
        error=error,
        variance=variance,
        between=float(np.sqrt(beyond)),
        i2=i2,
        q=q,
        q_p_value=float(chi2.sf(q, others)),
        p_value=float(2.0 * t.sf(abs(mean / error), others)),
    )


def variance(members: pd.DataFrame) -> float:
    """Return the variance of the squared size of a typical one of these studies."""
    size = max(0.0, float(members["squared"].mean()))
    of_none = (members["squared_error"] ** 2).mean()
    of_size = 4.0 * size * (members["along_error"] ** 2).mean()
    return float(of_none + of_size)


def joint_level(number: int, confidence: float) -> tuple[int, float]:
    """Return how two tests of a group share its level, 1 - confidence.

    Parameters
    ----------
    number
        Of studies, one for each subject.
    confidence
        As for a study.

    Returns
    -------
    fewest
        Number of studies that are different on their own from which on the group is:
        as many false alarms are so rare that the mean has `LEAST_OF_MEAN` left.
    of_mean
        Level of the lower end of the mean: what they leave, at most one tail of a
        two-sided interval.
    """
    from scipy.stats import binom

    level = 1.0 - confidence
    numbers = np.arange(1, number + 2)
    attained = binom.sf(numbers - 1, number, level)
    enough = int(np.argmax(attained < level * (1.0 - LEAST_OF_MEAN)))
    return int(numbers[enough]), float(min(level / 2.0, level - attained[enough]))


def jumps_that_hold(p_values: ArrayLike, *, confidence: float = 0.95) -> int:
    """Return how many jumps hold together, by Holm's method over all studies.

    In at most 1 - `confidence` of the groups whose outcomes do not jump one holds: of
    single studies, each with its own level, one in a hundred would jump by chance.

    Parameters
    ----------
    p_values
        (n,) p-value of the jump of each study with an answer; NaN where no jump is
        found.
    confidence
        As for a study.
    """
    from statsmodels.stats.multitest import multipletests

    found = np.nan_to_num(np.asarray(p_values, float), nan=1.0)
    if not len(found):
        return 0
    holds = multipletests(found, alpha=level_of(confidence), method="holm")[0]
    return int(np.count_nonzero(holds))


def judge_group(
    members: pd.DataFrame, *, margin: float = 0.2, confidence: float = 0.95
) -> GroupVerdict:
    """Judge a group of subjects in one condition.

    Parameters
    ----------
    members
        One row per subject with an answer: `conclusion`, `squared`, `squared_error`,
        `along_error`, `allowed` and `left` of its verdict.
    margin, confidence
        As for a study.

    Raises
    ------
    AnalysisError
        If there are too few subjects, or if a size is missing or infinite.
    """
    from scipy.stats import binom, t

    _require_sizes(members)
    found = combine(members["squared"].to_numpy(float), variance(members))

    fewest, of_mean = joint_level(found.n, confidence)
    tails = [of_mean, (1.0 - confidence) / 2.0, 1.0 - confidence]
    below, two_sided, one_sided = found.error * t.isf(tails, found.n - 1)
    mean = max(0.0, found.mean)
    estimate, *ends = np.sqrt(mean + np.array([0.0, two_sided, one_sided])).tolist()
    allowed = _rms(members["allowed"])
    left = _rms(members["left"])
    low_of_mean = float(np.sqrt(max(0.0, found.mean - below)))
    low = max(0.0, low_of_mean - left) / (1.0 + one_landing(allowed))
    high, bound = upper_ends(ends, allowed)

    alone = int((members["conclusion"] == DIFFERENT).sum())
    chance = float(binom.sf(alone - 1, len(members), 1.0 - confidence))
    conclusion = conclude(low, bound, margin)
    if alone >= fewest:
        conclusion = DIFFERENT
    compared = Message("maps.all_contact_orders")
    sizes = (estimate, low, high, bound)
    counts: dict[str, Any] = {"number": alone, "studies": len(members)}
    if alone:
        counts["chance"] = percent(max(chance, LEAST_CHANCE))
    if conclusion == DIFFERENT and not low > 0.0:
        of_all = {
            "compared": compared,
            "size": percent(estimate),
            "confidence": as_given(confidence),
            "low": at_least(low),
            "high": at_most(high),
        }
        said = Message("maps.alone_decides", {**counts, **of_all})
    else:
        answer = sentence(
            conclusion, sizes, compared, confidence, margin, subjects=found.n
        )
        code = "maps.alone"
        if alone >= fewest:
            code = "maps.alone_too"
        elif alone:
            code = "maps.alone_by_chance"
        said = Message(code, {"answer": answer, **counts})
    return GroupVerdict(
        conclusion=conclusion,
        sentence=str(said),
        estimate=estimate,
        low=low,
        high=high,
        upper_bound=bound,
        alone=alone,
        alone_p_value=chance,
        combined=found,
    )


def _require_sizes(members: pd.DataFrame) -> None:
    """Raise an `AnalysisError` on the first size that is not a finite number."""
    for column in _SIZES:
        is_known = np.isfinite(members[column].to_numpy(float))
        if not is_known.all():
            row = int(np.argmin(is_known))
            place = f"members, column {column}, row {row + 1}"
            found = members[column].iloc[row]
            raise AnalysisError.at(place, "a finite number", found)


_SIZES = ("squared", "squared_error", "along_error", "allowed", "left")


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

    conditions = dict(list(members.groupby("condition", sort=False)))
    rows = []
    for a, b in combinations(conditions, 2):
        both = conditions[a].merge(conditions[b], on="subject", suffixes=("", "_b"))
        if len(both) < LEAST_SUBJECTS:
            continue
        differences = (both["squared"] - both["squared_b"]).to_numpy(float)
        of_difference = variance(conditions[a]) + variance(conditions[b])
        found = combine(differences, of_difference)
        size_a = np.sqrt(max(0.0, both["squared"].mean()))
        size_b = np.sqrt(max(0.0, both["squared_b"].mean()))

        # What smooth terms leave moves a square by this, times the size.
        left_a, left_b = (_rms(conditions[one]["left"]) for one in (a, b))
        by_chance = t.isf((1.0 - confidence) / 2.0, found.n - 1) * found.error
        reach = by_chance + left_a * size_a + left_b * size_b
        low = found.mean - reach
        high = found.mean + reach
        rows.append(
            (a, b, found.n, size_a, size_b, found.mean, low, high, found.p_value)
        )
    table = pd.DataFrame(rows, columns=list(_CONDITION_COLUMNS))
    corrected: Any = []
    if rows:
        corrected = multipletests(table["p_value"], method="holm")[1]
    return table.assign(p_holm=corrected)


_CONDITION_COLUMNS = (
    "condition_a",
    "condition_b",
    "n",
    "size_a",
    "size_b",
    "difference",
    "low",
    "high",
    "p_value",
)


def _rms(values: pd.Series) -> float:
    return float(np.sqrt((values**2).mean()))


def differ(row: Mapping[str, Any], *, confidence: float = 0.95) -> bool:
    """Tell whether two conditions differ, by a row of `compare_conditions`.

    The p-value does not allow for smooth terms that leave more in one condition, and
    the interval not for the number of comparisons, so both have to say so.
    """
    excludes_zero = row["low"] * row["high"] > 0.0
    return bool(excludes_zero and row["p_holm"] < 1.0 - confidence)


def conditions_said(conditions: pd.DataFrame, *, confidence: float = 0.95) -> str:
    """Return sentences on the conditions that differ, and on those not shown to."""
    said: dict[str, list[str]] = {
        "maps.conditions_differ": [],
        "maps.conditions_alike": [],
    }
    pair = "maps.two_conditions"
    if len(conditions) == 1:
        # A single p-value needs no adjustment.
        pair = "maps.only_two_conditions"
    for one in conditions.to_dict("records"):
        row = {str(name): value for name, value in one.items()}
        values = {
            "a": row["condition_a"],
            "b": row["condition_b"],
            "size_a": percent(row["size_a"]),
            "size_b": percent(row["size_b"]),
            "confidence": as_given(confidence),
            "p": f"{row['p_holm']:.2g}",
            "subjects": row["n"],
        }
        for name in ("difference", "low", "high"):
            values[name] = f"{row[name]:.2g}"
        code = "maps.conditions_alike"
        if differ(row, confidence=confidence):
            code = "maps.conditions_differ"
        said[code].append(str(Message(pair, values)))
    return " ".join(
        str(Message(code, {"pairs": "; ".join(pairs)}))
        for code, pairs in said.items()
        if pairs
    )
