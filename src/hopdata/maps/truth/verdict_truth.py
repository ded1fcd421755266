"""The verdict's effect against the exact maps of a simulated study."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.truth.entries import Entries, entry
from hopdata.maps.truth.exact_map import exact_map
from hopdata.maps.truth.map_differences import input_root, relative_difference

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


@one_blas_thread()
def true_effect(exact: Mapping[str, Any], states: Floats, *, time_unit_s: float) -> float:
    """Return the relative difference of the exact maps as the verdict measures it.

    Rms over the pairs of schedules, for the study's inputs; outputs as displacements of markers.

    Parameters
    ----------
    exact
        Content of ``exact_maps.json``.
    states
        (n, 6B) true marker states of the study's landings at the pre section, m and m/s.
    time_unit_s
        Unit of time that weighs velocities against positions.
    """
    in_body = exact_map(exact, states, shape=np.empty((0, 3)), time_unit_s=time_unit_s)
    root, units = input_root(in_body.inputs), 1.0 / in_body.weights
    maps = np.array(exact["maps"], float)
    mean = maps.mean(axis=0)
    squares = [
        relative_difference(mean + a - b, mean, root=root, units=units) ** 2
        for a, b in combinations(maps, 2)
    ]
    return float(np.sqrt(np.mean(squares)))


def verdict_errors(true: float, verdict: Mapping[str, Any]) -> pd.DataFrame:
    """Return one row: the true effect beside that of ``verdict.json`` (empty without an answer).

    Returns
    -------
    DataFrame
        Columns true_effect, estimate, low, high, upper_bound, detectable, p_value, conclusion.
    """
    import pandas as pd

    columns = ["true_effect", "estimate", "low", "high", "upper_bound", "detectable"]
    effect, test = verdict["effect"], verdict["test"]
    if effect is None or test is None:
        return pd.DataFrame(columns=[*columns, "p_value", "conclusion"])
    row = {"true_effect": true} | {name: effect[name] for name in columns[1:]}
    row |= {"p_value": test["p_value"], "conclusion": verdict["conclusion"]}
    return pd.DataFrame([row])


def score_verdict(errors: pd.DataFrame) -> Entries:
    """Say how the verdict's effect compares with the true one."""
    if errors.empty:
        return {}
    row = errors.iloc[0]
    inside = bool(row["low"] <= row["true_effect"] <= row["high"])
    return {
        "verdict_true_effect": entry(
            float(row["true_effect"]),
            "1",
            "True relative difference of the maps of the contact orders",
        ),
        "verdict_effect": entry(
            float(row["estimate"]), "1", "Relative difference of these maps that the verdict found"
        ),
        "verdict_p_value": entry(
            float(row["p_value"]), "1", "p-value of the verdict's test of the kinks"
        ),
        "verdict_interval_covers": entry(
            inside, "yes/no", "Whether the verdict's interval holds the true difference"
        ),
    }
