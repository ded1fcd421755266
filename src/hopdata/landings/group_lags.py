"""How long one foot touches before another, over the subjects of a group."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.landings.contact_lags import CONFIDENCE

#: Fewest subjects of an interval over subjects.
#: Unit: subjects. Origin: derived: two have a scatter.
LEAST = 2

GROUP_LAG_COLUMNS = (
    "condition",
    "foot",
    "other",
    "subjects",
    "mean_s",
    "low_s",
    "high_s",
    "common_s",
    "median_abs_s",
)

DIFFERENCE_COLUMNS = (
    "condition_a",
    "condition_b",
    "foot",
    "other",
    "subjects",
    "difference_s",
    "low_s",
    "high_s",
    "common_s",
)


def lags_over_subjects(lags: pd.DataFrame) -> pd.DataFrame:
    """Return the mean lag of each two feet over the subjects of each condition.

    A subject is one number, its mean lag, however many landings it has: landings of one
    subject are no independent evidence on others.

    Parameters
    ----------
    lags : DataFrame
        The rows of `hopdata.landings.contact_lags.lag_table` of each study, with the
        columns ``subject`` and ``condition``, one study for each pair of these.

    Returns
    -------
    DataFrame
        A row for each condition and each two feet, in the order of `lags`. Times are
        in s:

        - ``subjects``: those in which both feet were timed.
        - ``mean_s``: mean of their mean lags.
        - ``low_s``, ``high_s``: 95 % interval of the mean by their scatter (Student's
          factor); NaN of one subject. Errors of a subject's own mean are part of the
          scatter, but for those that all subjects share.
        - ``common_s``: error that all subjects may share, as those in shoes alike do:
          the mean of their ``common_s``, an upper limit. It is no part of the interval.
          NaN where it is known of none.
        - ``median_abs_s``: mean of the subjects' medians without their sign.
    """
    rows = []
    for key, some in lags.groupby(["condition", "foot", "other"], sort=False):
        mean_s, low_s, high_s = _mean_with_interval(some["mean_s"].to_numpy(float))
        common_s = _mean_of_known(some["common_s"].to_numpy(float))
        median_abs_s = float(some["median_abs_s"].mean())
        rows.append((*key, len(some), mean_s, low_s, high_s, common_s, median_abs_s))
    return pd.DataFrame(rows, columns=list(GROUP_LAG_COLUMNS))


def lag_differences(lags: pd.DataFrame) -> pd.DataFrame:
    """Return the differences of mean lags between conditions, within subjects.

    Parameters
    ----------
    lags : DataFrame
        As for `lags_over_subjects`.

    Returns
    -------
    DataFrame
        A row for each two conditions and each two feet that two subjects or more have
        in both. ``difference_s`` is the mean over these subjects of the lag in
        ``condition_a`` less that in ``condition_b``; ``low_s`` and ``high_s`` its 95 %
        interval by their scatter; ``common_s`` the error that all may share: the root
        of the sum of squares of both conditions', an upper limit. It is less where
        shoes and markers are the same in both.
    """
    rows = []
    conditions = list(dict.fromkeys(lags["condition"]))
    for a, b in combinations(conditions, 2):
        of_a = lags[lags["condition"] == a]
        of_b = lags[lags["condition"] == b]
        both = of_a.merge(of_b, on=["subject", "foot", "other"], suffixes=("_a", "_b"))
        for key, some in both.groupby(["foot", "other"], sort=False):
            if len(some) < LEAST:
                continue
            differences_s = (some["mean_s_a"] - some["mean_s_b"]).to_numpy(float)
            interval = _mean_with_interval(differences_s)
            of_both_s = np.hypot(some["common_s_a"], some["common_s_b"])
            common_s = _mean_of_known(of_both_s.to_numpy(float))
            rows.append((a, b, *key, len(some), *interval, common_s))
    return pd.DataFrame(rows, columns=list(DIFFERENCE_COLUMNS))


def _mean_with_interval(values: FloatArray) -> tuple[float, float, float]:
    """Return the mean of some subjects, and the ends of its interval."""
    from scipy.special import stdtrit

    mean = float(values.mean())
    if len(values) < LEAST:
        return mean, float("nan"), float("nan")
    error = float(values.std(ddof=1)) / np.sqrt(len(values))
    half = float(stdtrit(len(values) - 1, 0.5 + CONFIDENCE / 2)) * error
    return mean, mean - half, mean + half


def _mean_of_known(values: FloatArray) -> float:
    """Return the mean of the values that are known; NaN if none is."""
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan")
    return float(known.mean())
