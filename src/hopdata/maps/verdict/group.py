"""What the verdicts of many subjects say together: a random-effects model of the squared size.

A size is never negative, so sizes of subjects without a difference do not average to none. Its
square has an unbiased estimate that may be negative, T less what noise adds; that is what is
averaged, and the mean's root is the rms size over subjects. Between-subject variance by Paule and
Mandel, errors by Hartung and Knapp, not below those of the model (Röver, Knapp and Friede 2015).

What smooth terms leave in the kinks of a study it leaves in those of every subject alike, and does
not average out: so what the subjects' verdicts grant, less what noise adds to it, is granted to the
group as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.maps.draws import named_generator
from hopdata.maps.verdict.judge import CANNOT_TELL, DIFFERENT, NO_DIFFERENCE

_DRAWS = 20_000
LEAST_SUBJECTS = 3  # of fewer a variance between subjects cannot be told


@dataclass(frozen=True)
class Combined:
    """Random-effects mean of squared sizes, or of their differences.

    Attributes
    ----------
    n
        Number of subjects.
    mean, error
        Of the squared size, with the error of the mean.
    between
        Standard deviation between subjects, of the squared size.
    i2, q, q_p_value
        Share of the scatter that is between subjects, Cochran's Q, and its p-value.
    p_value
        Two-sided, of a mean of zero.
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
    """What a group says: `low`, `high` and `upper_bound` as for a study, of the rms over subjects.

    Attributes
    ----------
    conclusion, sentence
        As of a study.
    estimate, low, high, upper_bound, granted
        Sizes, as shares of the map.
    combined
        The model behind them.
    """

    conclusion: str
    sentence: str
    estimate: float
    low: float
    high: float
    upper_bound: float
    granted: float
    combined: Combined


def combine(squared: FloatArray, variance: FloatArray) -> Combined:
    """Return the random-effects mean of (n,) squared sizes with these variances.

    Raises
    ------
    AnalysisError
        If there are fewer than `LEAST_SUBJECTS`.
    """
    from scipy.stats import chi2, t
    from statsmodels.stats.meta_analysis import combine_effects

    number = len(squared)
    if number < LEAST_SUBJECTS:
        raise AnalysisError(
            f"group: expected {LEAST_SUBJECTS} subjects with an answer or more, found {number}"
        )
    found = combine_effects(squared, variance, method_re="iterated", atol=1e-12, maxiter=200)
    mean = float(found.mean_effect_re)
    error = float(max(found.sd_eff_w_re, found.sd_eff_w_re_hksj))
    return Combined(
        n=number,
        mean=mean,
        error=error,
        between=float(np.sqrt(max(0.0, found.tau2))),
        i2=float(max(0.0, found.i2)),
        q=float(found.q),
        q_p_value=float(chi2.sf(found.q, number - 1)),
        p_value=float(2.0 * t.sf(abs(mean / error), number - 1)),
    )


def variances(members: pd.DataFrame) -> FloatArray:
    """Return the variances of (n,) squared sizes, all for the mean size.

    Each for its own size would give those that chance made small the most weight.
    """
    size = max(0.0, float(members["squared"].mean()))
    null, along = (members[name].to_numpy(float) for name in ("squared_error", "along_error"))
    return np.asarray(null**2 + 4.0 * size * along**2)


def judge_group(
    members: pd.DataFrame, *, seed: int, margin: float = 0.2, confidence: float = 0.95
) -> GroupVerdict:
    """Say what the subjects show together.

    Parameters
    ----------
    members
        One row an answered study: `subject`, and `squared`, `squared_error`, `along_error` and
        `granted_squared` of its verdict.
    seed
        Of the draws of the sum of two errors.
    margin, confidence
        As of a study.

    Raises
    ------
    AnalysisError
        If there are too few subjects.
    """
    # Of a subject with several conditions their mean, whose errors are independent.
    parts = members.assign(variance=variances(members)).groupby("subject", sort=False)
    subjects = parts[["squared", "variance", "granted_squared"]].mean()
    of_means = subjects["variance"] / parts.size()
    found = combine(subjects["squared"].to_numpy(float), of_means.to_numpy(float))
    # With an error of its own: a mean of squares, none of which is known well.
    allowed = subjects["granted_squared"].to_numpy(float)
    least_known = allowed.mean() + allowed.std(ddof=1) / np.sqrt(len(allowed))
    granted = float(np.sqrt(max(0.0, least_known)))
    generator = named_generator(seed, "group")
    chance = found.error * generator.standard_t(found.n - 1, _DRAWS)
    left = (granted * generator.standard_normal(_DRAWS)) ** 2
    share = (1.0 - confidence) / 2.0
    least = found.mean - float(np.quantile(chance + left, 1.0 - share))
    low, high, bound = (
        float(np.sqrt(max(0.0, square)))
        for square in (least, *(max(found.mean, 0.0) - np.quantile(chance, [share, 2.0 * share])))
    )
    high, bound = high + granted, bound + granted
    estimate = float(np.sqrt(max(0.0, found.mean)))
    conclusion = DIFFERENT if low > 0 else NO_DIFFERENCE if bound <= margin else CANNOT_TELL
    size, ends, most = (f"{100 * one:.2g} %" for one in (estimate, low, bound))
    sure, of_all = f"{100 * confidence:g} %", f"Over {found.n} subjects"
    what = "the maps of the contact orders"
    said = {
        DIFFERENT: f"{of_all} {what} are different: by {size} of the map ({sure} interval {ends} "
        f"to {100 * high:.2g} %).",
        NO_DIFFERENCE: f"{of_all} no difference between {what} larger than {most} of the map, at "
        f"{sure} confidence.",
        CANNOT_TELL: f"{of_all} the data cannot tell: no difference between {what} was found, but "
        f"one of up to {most} of the map cannot be excluded, and {100 * margin:g} % was wanted.",
    }
    return GroupVerdict(conclusion, said[conclusion], estimate, low, high, bound, granted, found)


def compare_conditions(members: pd.DataFrame) -> pd.DataFrame:
    """Compare the conditions within subjects, two at a time.

    Returns
    -------
    DataFrame
        A row for each two conditions that `LEAST_SUBJECTS` have both of: `n`, the rms `size_a` and
        `size_b` over these subjects, the mean difference of the squares with its error, the
        p-value, and the same after Holm for the number of rows.
    """
    from statsmodels.stats.multitest import multipletests

    rows = []
    by_condition = {
        name: part.assign(variance=variances(part)).set_index("subject")[["squared", "variance"]]
        for name, part in members.groupby("condition", sort=False)
    }
    for a, b in combinations(by_condition, 2):
        both = by_condition[a].join(by_condition[b].add_suffix("_b"), how="inner")
        if len(both) < LEAST_SUBJECTS:
            continue
        one, variance, other, variance_b = both.to_numpy(float).T
        found = combine(one - other, variance + variance_b)
        sizes = (np.sqrt(max(0.0, float(part.mean()))) for part in (one, other))
        rows.append((a, b, found.n, *sizes, found.mean, found.error, found.p_value))
    names = (
        "condition_a",
        "condition_b",
        "n",
        "size_a",
        "size_b",
        "difference",
        "error",
        "p_value",
    )
    table = pd.DataFrame(rows, columns=names)
    holm = multipletests(table["p_value"], method="holm")[1] if rows else []
    return table.assign(p_holm=holm)
