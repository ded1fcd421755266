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
    count_touchdowns,
    score_contacts,
    score_floor,
    score_sections,
    score_states,
)
from hopdata.maps.truth.maps import Entries, entry, score_estimates, score_verdict
from hopdata.maps.truth.scaling import score_maps, score_scaling

# Models of Fig. 2.4 in words.
MODELS = {
    "specialised": "affine models specialised to the orders",
    "near": "affine model of the near touchdowns",
    "all": "affine model of all touchdowns",
    "far": "affine model of the far touchdowns",
    "specialised_mean": "means specialised to the orders",
    "mean": "mean of all touchdowns",
}


@one_blas_thread()
def score(
    known: Mapping[str, KnownRecording],
    *,
    feet: Sequence[str],
    tables: Mapping[str, pd.DataFrame],
    sections: Mapping[str, Any],
    touchdowns: pd.DataFrame,
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
    touchdowns
        The study's own touchdown table, whose used and excluded rows are counted.
    prediction_summary, distance_summary
        Tables of the same names.
    exact
        Tables ``map_errors``, ``state_errors``, ``scaling_study``, ``estimate_errors`` and
        ``verdict_errors`` of a study that is simulated as a whole.
    """
    if not known:
        return {}
    entries: Entries = score_verdict(exact["verdict_errors"]) if exact else {}
    for method, table in tables.items():
        entries |= score_contacts(known, table, feet=feet, method=method)
    entries |= count_touchdowns(touchdowns)
    entries |= score_sections(known, sections)
    entries |= score_floor(known)
    entries |= score_predictions(prediction_summary)
    entries |= score_distances(distance_summary)
    if exact:
        entries |= score_states(exact["state_errors"])
        entries |= score_maps(exact["map_errors"])
        entries |= score_scaling(exact["scaling_study"])
        entries |= score_estimates(exact["estimate_errors"])
    return entries


def score_predictions(summary: pd.DataFrame) -> Entries:
    """Say what the prediction errors show, of the models that could be fitted."""
    mse = dict(zip(summary["model"], summary["median"], strict=True))
    entries = {
        f"mse_{model}": entry(
            value, "units²", f"Median prediction error, {MODELS.get(model, model)}"
        )
        for model, value in mse.items()
    }
    if {"specialised", "specialised_mean"} <= mse.keys():
        ratio = mse["specialised"] / mse["specialised_mean"]
        what = "Median MSE of the specialised affine models over that of their mean predictors"
        entries["specialised_over_mean"] = entry(ratio, "1", what)
    if {"all", "specialised"} <= mse.keys():
        what = "Median MSE of the unspecialised over that of the specialised affine models"
        entries["all_over_specialised"] = entry(mse["all"] / mse["specialised"], "1", what)
    if {"near", "all", "far"} <= mse.keys():
        ordered = bool(mse["near"] < mse["all"] < mse["far"])
        what = "Whether the unspecialised models order as near < all < far"
        entries["near_below_all_below_far"] = entry(ordered, "yes/no", what)
    return entries


def score_distances(summary: pd.DataFrame) -> Entries:
    """Say how far random subspaces stand from all others, and what cross-class looks like."""
    rows = {row["kind"]: row for _, row in summary.iterrows()}
    others = [row["q95"] for kind, row in rows.items() if kind != "random"]
    entries = {}
    if "random" in rows and others:
        what = "5 % quantile of the random distances minus the largest 95 % quantile of the others"
        entries["random_clearance"] = entry(rows["random"]["q05"] - max(others), "rad", what)
    if "cross_class" in rows:
        what = "AUC of cross-class against in-class distances (in-class draws share a pool)"
        entries["cross_class_auc"] = entry(rows["cross_class"]["auc_against_in_class"], "1", what)
    return entries
