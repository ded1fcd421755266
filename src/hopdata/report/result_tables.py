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


# Beginnings of names in truth.json that compare with no truth and stand elsewhere on the page.
NOT_COMPARED = (
    "mse_",
    "excluded_",
    "touchdowns_usable",
    "touchdowns_ambiguous",
    "body_travel",
    "specialised_over_mean",
    "all_over_specialised",
    "cross_class_auc",
)
SHARES = ("labels_right_",)
COUNTED = ("landings", "touchdowns")


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
    note += (
        f" Worst position and velocity: {percent(97.5)} of the bootstraps keep below these with "
        "the rms error of the coordinate of a marker that they predict worst."
    )
    note += (
        " Classes: groups of touchdowns with a model of their own; train and test: touchdowns in "
        "each bootstrap."
    )
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
        "subspaces",
        "pairs",
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
    rows = tuple(
        (_capital(str(entry.get("what") or name)), *_measured(name, entry))
        for name, entry in (truth or {}).items()
        if not name.startswith(NOT_COMPARED)
    )
    return Table("Found against known", ("quantity", "value", "unit"), rows) if rows else None


def _measured(name: str, entry: Mapping[str, Any]) -> tuple[str, str]:
    """Return value and unit as on the rest of the page: lengths in mm, shares in per cent."""
    value, unit = entry.get("value"), str(entry.get("unit") or "")
    if name.startswith(SHARES):
        return fixed(scaled(value, 100), 1), "%"
    if unit == "m":
        return plain(scaled(value, 1e3)), "mm"
    if unit in COUNTED:
        return count(value), unit
    return plain(value), "" if unit in ("1", "yes/no") else unit


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def times_table(seconds: Mapping[str, Any]) -> Table | None:
    """Time of each job, longest first."""
    ordered = sorted(seconds.items(), key=lambda item: -float(item[1]))
    rows = tuple((name, fixed(value, 2)) for name, value in ordered)
    return Table("Time per job", ("job", "time (s)"), rows) if rows else None
