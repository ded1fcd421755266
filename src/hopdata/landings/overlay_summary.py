"""How well found contacts agree with external ones: counts, bias, scatter, for each column."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.contact_overlay import (
    INVENTED,
    MATCHED,
    MISSED,
    NOT_COMPARED,
    OTHER_FOOT,
)

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

CONFIDENCE = 0.95
MAD_TO_SD = 1.482602218505602  # of a normal
ALL = "all"


def summarise_overlay(table: pd.DataFrame) -> pd.DataFrame:
    """Count and measure the agreement of each column of each recording, and of all together.

    Parameters
    ----------
    table : pandas.DataFrame
        As `compare_contacts` makes it, of one or more recordings and columns.

    Returns
    -------
    pandas.DataFrame
        recording (``all`` where several share a column), source, column, feet, first_feet (which of
        the feet touched first, and how often), n_external (contacts of these feet), n_matched,
        n_excluded (of them in excluded touchdowns), n_missed, n_invented, n_other_foot,
        n_not_compared; bias_s (median of the differences of matched contacts), bias_low_s and
        bias_high_s (95 % interval by order statistics), robust_sd_s (from the median absolute
        deviation), sd_s, largest_s (largest distance from the bias), scatter_over_se (robust sd of
        the distances from the bias in their standard errors: 1 if those are right).
    """
    import pandas as pd

    keys = ["source", "column", "feet"]
    rows = [
        {"recording": recording, **dict(zip(keys, key, strict=True)), **_measures(group)}
        for (recording, *key), group in table.groupby(["recording", *keys], sort=False)
    ]
    rows += [
        {"recording": ALL, **dict(zip(keys, key, strict=True)), **_measures(group)}
        for key, group in table.groupby(keys, sort=False)
        if len(group["recording"].unique()) > 1
    ]
    return pd.DataFrame(rows)


def median_interval(values: FloatArray, *, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval for the median that needs no model: two order statistics.

    Parameters
    ----------
    values : (n,) array
        Independent draws.
    confidence : float
        Least probability that the interval covers the median.

    Returns
    -------
    low, high : float
        NaN where n is too small for this confidence.
    """
    from scipy.stats import binom

    n = len(values)
    below = int(binom.ppf((1 - confidence) / 2, n, 0.5)) if n else 0
    if below < 1:
        return float("nan"), float("nan")
    ordered = np.sort(values)
    return float(ordered[below - 1]), float(ordered[n - below])


def robust_sd(values: FloatArray) -> float:
    """Estimate the sd from the median absolute deviation; NaN for fewer than two values."""
    if len(values) < 2:
        return float("nan")
    return float(MAD_TO_SD * np.median(np.abs(values - np.median(values))))


def _measures(group: pd.DataFrame) -> dict[str, Any]:
    status = group["status"]
    matched = group[status == MATCHED]
    difference = matched["difference_s"].to_numpy(dtype=np.float64)
    n = len(difference)
    bias = float(np.median(difference)) if n else float("nan")
    low, high = median_interval(difference)
    first = matched["first_foot"].value_counts()
    error = matched["se_s"].to_numpy(dtype=np.float64)
    return {
        "first_feet": ", ".join(f"{foot} {count}" for foot, count in sorted(first.items())),
        "n_external": int(status.isin([MATCHED, MISSED]).sum()),
        "n_matched": n,
        "n_excluded": int(matched["excluded"].astype(bool).sum()),
        "n_missed": int((status == MISSED).sum()),
        "n_invented": int((status == INVENTED).sum()),
        "n_other_foot": int((status == OTHER_FOOT).sum()),
        "n_not_compared": int((status == NOT_COMPARED).sum()),
        "bias_s": bias,
        "bias_low_s": low,
        "bias_high_s": high,
        "robust_sd_s": robust_sd(difference),
        "sd_s": float(np.std(difference, ddof=1)) if n > 1 else float("nan"),
        "largest_s": float(np.abs(difference - bias).max()) if n else float("nan"),
        "scatter_over_se": robust_sd((difference - bias) / error),
    }
