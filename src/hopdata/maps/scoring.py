"""Accuracy of a synthetic study against its truth: the content of ``truth.json``.

Everything here compares what the pipeline found with what the simulator knew. Each entry is
``name -> {"value", "unit", "what"}``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pandas as pd

#: A touchdown and a true landing are the same if their mean contact instants are this close.
MATCH_WITHIN_S = 0.1

Floats = NDArray[np.float64]
Entry = dict[str, Any]
Entries = dict[str, Entry]


class TruthOfRecording(Protocol):
    """What scoring reads of `hopdata.recordings.truth.Truth`."""

    contact_times: Floats
    complete: NDArray[np.bool_]
    foot_down: NDArray[np.bool_]
    body_height: Floats
    contact_points: Floats
    floor_at_contacts: Floats


class Floor(Protocol):
    """What scoring asks of `hopdata.landings.surface.FloorModel`."""

    def height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Height of the floor at places (x, y), m."""


@dataclass(frozen=True)
class KnownRecording:
    """What is known of one synthetic recording with L landings, N frames and n feet.

    Attributes
    ----------
    contact_times
        (L, n) true contact instants in s, NaN where a foot did not touch.
    complete
        (L,) whether all feet came to stand together.
    foot_down
        (N, n) whether each foot truly stands, per frame.
    body_height
        (N,) true mean height of the body markers above the floor, m.
    floor_at_contacts, floor_model
        (L, n) true floor heights at the contact points and those of the fitted model, m; None
        where no model was fitted.
    """

    contact_times: Floats
    complete: NDArray[np.bool_]
    foot_down: NDArray[np.bool_]
    body_height: Floats
    floor_at_contacts: Floats | None = None
    floor_model: Floats | None = None


def known_recording(truth: TruthOfRecording, floor: Floor) -> KnownRecording:
    """Join the truth of a recording and the floor that was fitted to it."""
    points = np.asarray(truth.contact_points)
    return KnownRecording(
        contact_times=truth.contact_times,
        complete=truth.complete,
        foot_down=truth.foot_down,
        body_height=truth.body_height,
        floor_at_contacts=truth.floor_at_contacts,
        floor_model=floor.height(points[..., 0], points[..., 1]),
    )


def score(
    known: Mapping[str, KnownRecording],
    *,
    feet: Sequence[str],
    tables: Mapping[str, pd.DataFrame],
    pre_height_m: float,
    post_height_m: float,
    tail_fraction: float,
    prediction_summary: pd.DataFrame,
    distance_summary: pd.DataFrame,
) -> Entries:
    """Score a study against the truth of its recordings.

    Parameters
    ----------
    known
        Recording name -> what is known of it; without any there is nothing to score.
    feet
        Names of the n feet, in the order of the truth.
    tables
        Method (``"kink"``, ``"velocity_minimum"``) -> touchdown table of all recordings; the
        first is the study's own, whose usable and excluded touchdowns are counted.
    pre_height_m, post_height_m, tail_fraction
        The sections found and the tail fraction behind them.
    prediction_summary, distance_summary
        Tables of the same names.
    """
    if not known:
        return {}
    entries: Entries = {}
    for method, table in tables.items():
        entries |= score_contacts(known, table, feet=feet, method=method)
    for table in list(tables.values())[:1]:
        entries |= count_touchdowns(table)
    entries |= score_sections(known, pre_height_m, post_height_m, tail_fraction)
    entries |= score_floor(known)
    entries |= score_predictions(prediction_summary)
    entries |= score_distances(distance_summary)
    return entries


def score_contacts(
    known: Mapping[str, KnownRecording], table: pd.DataFrame, *, feet: Sequence[str], method: str
) -> Entries:
    """Score the mode schedules and contact instants of the usable touchdowns of one method.

    A touchdown without a true landing within `MATCH_WITHIN_S`, or whose true landing did not
    bring all feet down, counts as labelled wrongly.
    """
    usable = table[~table["excluded"].astype(bool)]
    found = usable[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    true = _true_contacts(known, usable["recording"].to_numpy(str), found)
    labels = usable["schedule"].astype("string").fillna("").to_numpy(str)
    right = labels == np.array([schedule_of(row) for row in true], dtype=str)
    errors = found - true
    errors = errors[np.isfinite(errors)]
    unmatched = np.isnan(true).all(axis=1).sum()
    share, bias = _mean(right), _mean(errors)
    rms = np.sqrt(_mean((errors - bias) ** 2))
    who = f"{method} method, usable touchdowns"
    return {
        f"labels_right_{method}": _entry(share, "1", f"Share of right mode schedules, {who}"),
        f"contact_rms_{method}": _entry(
            1e3 * rms, "ms", f"Rms error of the contact instants after the common bias, {who}"
        ),
        f"contact_bias_{method}": _entry(
            1e3 * bias, "ms", f"Mean of found minus true contact instants, {who}"
        ),
        f"unmatched_{method}": _entry(
            int(unmatched), "touchdowns", f"Touchdowns without a true landing nearby, {who}"
        ),
    }


def schedule_of(contact_times: Floats) -> str:
    """Return the mode schedule of (n,) contact instants, e.g. ``"2>3>1"``; empty with a NaN."""
    if not np.isfinite(contact_times).all():
        return ""
    return ">".join(str(foot + 1) for foot in np.argsort(contact_times, kind="stable"))


def count_touchdowns(table: pd.DataFrame) -> Entries:
    """Count the usable touchdowns, and the excluded ones by reason."""
    excluded = table["excluded"].astype(bool)
    usable = int((~excluded).sum())
    entries = {"touchdowns_usable": _entry(usable, "touchdowns", "Touchdowns used in the study")}
    reasons = table.loc[excluded, "reason"].astype("string").fillna("no reason given")
    for reason, count in sorted(reasons.value_counts().items()):
        name = "excluded_" + str(reason).replace(" ", "_")
        entries[name] = _entry(int(count), "touchdowns", f"Touchdowns excluded: {reason}")
    return entries


def score_sections(
    known: Mapping[str, KnownRecording],
    pre_height_m: float,
    post_height_m: float,
    tail_fraction: float,
) -> Entries:
    """Compare the sections with those that the true foot states give by the same tail rule.

    Above the pre section all but the tail fraction of the frames have all feet up; below the
    post section all but it have all feet down.
    """
    pairs = [(item.body_height, item.foot_down) for item in known.values()]
    height = np.concatenate([height for height, _ in pairs])
    down = np.concatenate([down for _, down in pairs])
    seen = np.isfinite(height)
    pre = _quantile(height[seen & down.any(axis=1)], 1 - tail_fraction)
    post = _quantile(height[seen & ~down.all(axis=1)], tail_fraction)
    travel = 1e3 * (pre_height_m - post_height_m)
    entries = {"body_travel": _entry(travel, "mm", "Height between the pre and the post section")}
    for name, found, true in (("pre", pre_height_m, pre), ("post", post_height_m, post)):
        what = f"{name} section found minus that of the true foot states"
        entries[f"section_{name}_true"] = _entry(true, "m", f"{name} section, true foot states")
        entries[f"section_{name}_error"] = _entry(1e3 * (found - true), "mm", what)
    return entries


def score_floor(known: Mapping[str, KnownRecording]) -> Entries:
    """Compare the floor models with the floor, each after its mean difference is removed."""
    differences = []
    for item in known.values():
        if item.floor_at_contacts is not None and item.floor_model is not None:
            difference = item.floor_model - item.floor_at_contacts
            difference = difference[np.isfinite(difference)]
            differences.append(difference - _mean(difference))
    if not differences:
        return {}
    rms = np.sqrt(_mean(np.concatenate(differences) ** 2))
    what = "Rms of fitted minus true floor height at the contacts, mean difference removed"
    return {"floor_residual_rms": _entry(1e3 * rms, "mm", what)}


def score_predictions(summary: pd.DataFrame) -> Entries:
    """Say what the prediction errors show, of the models that could be fitted."""
    mse = dict(zip(summary["model"], summary["median"], strict=True))
    entries = {
        f"mse_{model}": _entry(value, "squared units", f"Median prediction error, model {model}")
        for model, value in mse.items()
    }
    if {"specialised", "specialised_mean"} <= mse.keys():
        ratio = mse["specialised"] / mse["specialised_mean"]
        what = "Median MSE of the specialised affine models over that of their mean predictors"
        entries["specialised_over_mean"] = _entry(ratio, "1", what)
    if {"all", "specialised"} <= mse.keys():
        what = "Median MSE of the unspecialised over that of the specialised affine models"
        entries["all_over_specialised"] = _entry(mse["all"] / mse["specialised"], "1", what)
    if {"near", "all", "far"} <= mse.keys():
        ordered = bool(mse["near"] < mse["all"] < mse["far"])
        what = "Whether the unspecialised models order as near < all < far"
        entries["near_below_all_below_far"] = _entry(ordered, "yes/no", what)
    return entries


def score_distances(summary: pd.DataFrame) -> Entries:
    """Say how far random subspaces stand from all others, and what cross-class looks like."""
    rows = {row["kind"]: row for _, row in summary.iterrows()}
    others = [row["q95"] for kind, row in rows.items() if kind != "random"]
    entries = {}
    if "random" in rows and others:
        what = "5 % quantile of the random distances minus the largest 95 % quantile of the others"
        entries["random_clearance"] = _entry(rows["random"]["q05"] - max(others), "rad", what)
    if "cross_class" in rows:
        what = "AUC of cross-class against in-class distances (in-class draws share a pool)"
        entries["cross_class_auc"] = _entry(rows["cross_class"]["auc_against_in_class"], "1", what)
    return entries


def _true_contacts(
    known: Mapping[str, KnownRecording], recordings: NDArray[np.str_], found: Floats
) -> Floats:
    """Return the true instants (m, n) of the landings nearest to those found; NaN without one."""
    true = np.full_like(found, np.nan)
    for name, item in known.items():
        rows = np.flatnonzero(recordings == name)
        touched = np.isfinite(item.contact_times).any(axis=1)
        landings = np.flatnonzero(touched & np.asarray(item.complete, bool))
        if not (rows.size and landings.size):
            continue
        instants = item.contact_times[landings]
        gaps = np.abs(found[rows].mean(axis=1)[:, None] - np.nanmean(instants, axis=1)[None, :])
        nearest = gaps.argmin(axis=1)
        close = gaps[np.arange(len(rows)), nearest] <= MATCH_WITHIN_S
        true[rows[close]] = instants[nearest[close]]
    return true


def _quantile(values: Floats, fraction: float) -> float:
    return float(np.quantile(values, fraction)) if values.size else float("nan")


def _mean(values: NDArray[Any]) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def _entry(value: float | int | bool, unit: str, what: str) -> Entry:
    """Return one entry; a value that could not be computed is None, which JSON can hold."""
    if isinstance(value, bool | int):
        return {"value": value, "unit": unit, "what": what}
    return {"value": float(value) if np.isfinite(value) else None, "unit": unit, "what": what}
