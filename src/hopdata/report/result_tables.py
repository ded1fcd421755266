"""Tables of prediction, distances, accuracy and time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hopdata.report.formatting import common_scale, count, fixed, percent, plain
from hopdata.report.table import Table, scaled

if TYPE_CHECKING:
    import pandas as pd

MODEL_NAMES = {
    "specialised": "affine (specialised)",
    "near": "affine (near)",
    "all": "affine (all)",
    "far": "affine (far)",
    "specialised_mean": "mean (specialised)",
    "mean": "mean (all)",
}
KIND_NAMES = {
    "in_class": "in-class",
    "cross_class": "cross-class",
    "noised_identity": "noised identity",
    "random": "random",
}


def prediction_table(summary: pd.DataFrame | None) -> Table | None:
    """One row a model, in the printed order; a model that was not fitted is listed as such."""
    if summary is None or summary.empty:
        return None
    found = {str(row["model"]): row for row in summary.to_dict("records")}
    quantiles = ("p2_5", "q25", "median", "q75", "p97_5")
    scale, power = common_scale([row.get("median") for row in found.values()])
    rows = []
    for model in dict.fromkeys((*MODEL_NAMES, *found)):
        row: Mapping[Any, Any] = found.get(model, {})
        rows.append(
            (
                MODEL_NAMES.get(model, model),
                count(row.get("n_classes")),
                count(row.get("n_train")),
                count(row.get("n_test")),
                *(fixed(scaled(row.get(q), 1 / scale), 2) for q in quantiles),
                fixed(row.get("worst_position_mm"), 1),
                fixed(row.get("worst_velocity_m_s"), 3),
            )
        )
    head = (
        "model",
        "classes",
        "train",
        "test",
        *map(percent, (2.5, 25)),
        "median",
        *map(percent, (75, 97.5)),
    )
    worst = ("worst position (mm)", "worst velocity (m/s)")
    note = f"Quantiles over the bootstraps of the combined MSE, in {power}units²."
    note += " A dash: not fitted, too few touchdowns." if len(found) < len(MODEL_NAMES) else ""
    return Table("Prediction errors", (*head, *worst), tuple(rows), note=note)


def distances_table(summary: pd.DataFrame | None) -> Table | None:
    """One row a kind of distance; a kind without pairs is listed with zero pairs."""
    if summary is None or summary.empty:
        return None
    found = {str(row["kind"]): row for row in summary.to_dict("records")}
    quantiles = ("q05", "q25", "median", "q75", "q95")
    rows = []
    for kind in dict.fromkeys((*KIND_NAMES, *found)):
        row: Mapping[Any, Any] = found.get(kind, {})
        rows.append(
            (
                KIND_NAMES.get(kind, kind),
                count(row.get("n", 0)),
                *(fixed(row.get(key), 3) for key in ("mean", "sd", *quantiles)),
                fixed(row.get("auc_against_in_class"), 3),
            )
        )
    head = (
        "pairs of subspaces",
        "n",
        "mean",
        "sd",
        *map(percent, (5, 25)),
        "median",
        *map(percent, (75, 95)),
    )
    note = "Arc lengths in rad. AUC: probability that such a distance exceeds an in-class one."
    return Table("Arc-length distances", (*head, "AUC"), tuple(rows), note=note)


def truth_table(truth: Mapping[str, Mapping[str, Any]] | None) -> Table | None:
    """One row a measure: what was found against what the simulator knew."""
    if not truth:
        return None
    rows = tuple(
        (str(entry.get("what") or name), plain(entry.get("value")), _unit(entry.get("unit")))
        for name, entry in truth.items()
    )
    return Table("Found against known", ("quantity", "value", "unit"), rows)


def times_table(seconds: Mapping[str, Any]) -> Table | None:
    """Time of each job, longest first."""
    ordered = sorted(seconds.items(), key=lambda item: -float(item[1]))
    rows = tuple((name, fixed(value, 2)) for name, value in ordered)
    return Table("Time per job", ("job", "time (s)"), rows) if rows else None


def _unit(unit: Any) -> str:
    return "" if unit in (None, "1", "yes/no") else str(unit)
