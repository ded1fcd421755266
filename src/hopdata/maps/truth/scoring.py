"""Accuracy of a synthetic study against its truth: the content of ``truth.json``.

Everything here compares what the pipeline found with what the simulator knew. Each entry is
``name -> {"value", "unit", "what"}``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.arrays import pd
from hopdata.blas import one_blas_thread
from hopdata.maps.truth.landings import (
    KnownRecording,
    score_contacts,
    score_floor,
    score_sections,
    score_states,
)
from hopdata.maps.truth.maps import Entries, entry, score_estimates, score_verdict
from hopdata.maps.truth.scaling import score_scaling


@one_blas_thread()
def score(
    known: Mapping[str, KnownRecording],
    *,
    feet: Sequence[str],
    tables: Mapping[str, pd.DataFrame],
    sections: Mapping[str, Any],
    prediction_summary: pd.DataFrame,
    distance_summary: pd.DataFrame,
    exact: Mapping[str, pd.DataFrame] | None = None,
) -> Entries:
    """Score a study against the truth of its recordings.

    Parameters
    ----------
    known
        Recording name -> what is known of it; without any there is nothing to score.
    feet
        Names of the n feet, in the order of the truth.
    tables
        Method (``"kink"``, ``"velocity_minimum"``) -> touchdown table of all recordings.
    sections
        Content of ``sections.json``.
    prediction_summary, distance_summary
        Tables of the same names.
    exact
        Tables ``state_errors``, ``scaling_study``, ``estimate_errors`` and
        ``verdict_errors`` of a study that is simulated as a whole.
    """
    if not known:
        return {}
    entries: Entries = score_verdict(exact["verdict_errors"]) if exact else {}
    for method, table in tables.items():
        entries |= score_contacts(known, table, feet=feet, method=method)
    entries |= score_sections(known, sections)
    entries |= score_floor(known)
    entries |= score_predictions(prediction_summary)
    entries |= score_distances(distance_summary)
    if exact:
        entries |= score_states(exact["state_errors"])
        entries |= score_scaling(exact["scaling_study"])
        entries |= score_estimates(exact["estimate_errors"])
    return entries


def score_predictions(summary: pd.DataFrame) -> Entries:
    """Say whether the prediction errors order as the closeness to the simultaneous contact."""
    mse = dict(zip(summary["model"], summary["median"], strict=True))
    if not {"near", "all", "far"} <= mse.keys():
        return {}
    ordered = bool(mse["near"] < mse["all"] < mse["far"])
    what = "Whether the unspecialised models order as near < all < far"
    return {"near_below_all_below_far": entry(ordered, "yes/no", what)}


def score_distances(summary: pd.DataFrame) -> Entries:
    """Say how far random subspaces stand from all others."""
    rows = summary.set_index("kind")
    others = rows.drop(index="random", errors="ignore")["q95"]
    if "random" not in rows.index or others.empty:
        return {}
    what = "5 % quantile of the random distances minus the largest 95 % quantile of the others"
    clearance = rows.loc["random", "q05"] - others.max()
    return {"random_clearance": entry(clearance, "rad", what)}
