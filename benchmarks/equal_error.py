"""Times at equal error, and their ratios."""

from __future__ import annotations

import numpy as np
import pandas as pd

EQUAL_ERROR = 1e-9
SMALLEST = 1e-17  # an error of zero, on a logarithmic axis
OURS, OUR_CALL, OUR_BATCH = "hopdata", "hopdata, call", "hopdata, batch"


def time_at(rows: pd.DataFrame, error: float) -> float:
    """Interpolate the time at an error, on logarithmic axes, along the least times so far, us.

    NaN where the error is not reached. Where even the loosest tolerance does better, its time.
    """
    done = rows[rows["time_median_us"].notna() & rows["error_max"].notna()]
    if done.empty or done["error_max"].min() > error:
        return np.nan
    by_error = done.sort_values("error_max")
    envelope = np.minimum.accumulate(by_error["time_median_us"])
    errors = np.log(np.maximum(by_error["error_max"], SMALLEST))
    return float(np.exp(np.interp(np.log(error), errors, np.log(envelope))))


def ratios(table: pd.DataFrame, error: float = EQUAL_ERROR) -> pd.DataFrame:
    """Return one row a scene and solver: its time at an error over ours.

    Ours is our fastest method: in a call of its own (``ratio``), and in a batch
    (``ratio_to_batch``). A ratio above 1 says that ours is faster. ``best_of_package`` marks the
    fastest solver of each package.
    """
    parts = []
    keys = ["scene", "package", "way", "method"]
    for key, rows in table.groupby(keys, sort=False, dropna=False):
        parts.append(dict(zip(keys, key, strict=True)) | {
            "error": error, "time_us": time_at(rows, error), "least_error": rows["error_max"].min(),
        })  # fmt: skip
    result = pd.DataFrame(parts)
    for way, column in ((OUR_CALL, "ratio"), (OUR_BATCH, "ratio_to_batch")):
        ours = result[result["way"] == way].groupby("scene")["time_us"].min()
        result[column] = result["time_us"] / result["scene"].map(ours)
    best = result.groupby(["scene", "package"])["time_us"].transform("min")
    result["best_of_package"] = result["time_us"] == best
    result["note"] = np.where(
        result["time_us"].notna(), "",
        np.where(result["least_error"].isna(), "no result", "does not reach the error"),
    )  # fmt: skip
    return result


def best_of_way(ratio_table: pd.DataFrame) -> pd.Series:
    """Mark in each scene the fastest method of each way; the most exact, where none gets there."""
    ranked = ratio_table.sort_values(["time_us", "least_error"], na_position="last")
    first = ranked.groupby(["scene", "way"]).head(1).index
    return pd.Series(ratio_table.index.isin(first), index=ratio_table.index)
