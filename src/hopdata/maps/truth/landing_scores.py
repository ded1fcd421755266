"""Accuracy of the landing stages against the truth: contacts, schedules, sections, floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import chosen
from hopdata.landings.contact_frames import landing_frames
from hopdata.landings.schedules import AMBIGUOUS, schedule_names
from hopdata.landings.sections import FRAMES
from hopdata.maps.truth.entries import Entries, entry, mean, quantile
from hopdata.maps.truth.matching import match_landings

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


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


def score_contacts(
    known: Mapping[str, KnownRecording], table: pd.DataFrame, *, feet: Sequence[str], method: str
) -> Entries:
    """Score the mode schedules and contact instants of one method.

    Two shares of right schedules are given: of the touchdowns used, and of all true landings,
    where an excluded or missed landing counts as not right. Touchdowns of recordings without a
    truth are not scored; one without a true landing nearby, or beside a closer one, is wrong.

    Parameters
    ----------
    known
        Recording name -> what is known of it; L landings in all.
    table
        Touchdowns of all recordings.
    feet
        Names of the n feet, in the order of the truth.
    method
        Suffix of the entries' names.
    """
    usable = table[~table["excluded"].astype(bool) & table["recording"].isin(list(known))]
    found = usable[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    true = _true_contacts(known, usable["recording"].to_numpy(str), found)
    labels = usable["schedule"].astype("string").fillna("").to_numpy(str)
    right = (labels == np.array(schedule_names(true), dtype=str)) & (labels != "")
    sure = ~_ambiguous(usable)
    n_landings = sum(int(_landed(item).sum()) for item in known.values())
    matched = int(np.isfinite(true).any(axis=1).sum())
    errors = found - true
    errors = errors[np.isfinite(errors)]
    bias = mean(errors)
    rms = np.sqrt(mean((errors - bias) ** 2))
    of_all = right.sum() / n_landings if n_landings else float("nan")
    who = f"{method.replace('_', ' ')} method"
    return {
        f"labels_right_{method}": entry(
            mean(right), "1", f"Share of right mode schedules among the touchdowns used, {who}"
        ),
        f"labels_right_unambiguous_{method}": entry(
            mean(right[sure]), "1", f"The same share among those not ambiguous, {who}"
        ),
        f"labels_right_of_all_{method}": entry(
            float(of_all), "1", f"Right mode schedules over all true landings, {who}"
        ),
        f"contact_rms_{method}": entry(
            1e3 * rms, "ms", f"Rms error of the contact instants after the common bias, {who}"
        ),
        f"contact_bias_{method}": entry(
            1e3 * bias, "ms", f"Mean of found minus true contact instants, {who}"
        ),
        f"landings_not_used_{method}": entry(
            n_landings - matched, "landings", f"True landings excluded or missed, {who}"
        ),
        f"unmatched_{method}": entry(
            len(usable) - matched, "touchdowns", f"Touchdowns used without a true landing, {who}"
        ),
    }


def count_touchdowns(table: pd.DataFrame) -> Entries:
    """Count the touchdowns used, and the excluded ones by reason."""
    excluded = table["excluded"].astype(bool)
    usable = int((~excluded).sum())
    entries = {"touchdowns_usable": entry(usable, "touchdowns", "Touchdowns used in the study")}
    if "class" in table:
        ambiguous = int((~excluded & _ambiguous(table)).sum())
        what = "Used touchdowns whose order is ambiguous"
        entries["touchdowns_ambiguous"] = entry(ambiguous, "touchdowns", what)
    reasons = table.loc[excluded, "reason"].astype("string").fillna("no reason given")
    for reason, count in sorted(reasons.value_counts().items()):
        name = "excluded_" + str(reason).replace(" ", "_")
        entries[name] = entry(int(count), "touchdowns", f"Touchdowns excluded: {reason}")
    return entries


def _ambiguous(table: pd.DataFrame) -> Bools:
    """Mark the touchdowns of the class ambiguous, (n,); none in a table without classes."""
    classes = table.get("class")
    if classes is None:
        return np.zeros(len(table), dtype=bool)
    return np.asarray(classes == AMBIGUOUS, dtype=bool)


def score_sections(known: Mapping[str, KnownRecording], sections: Mapping[str, Any]) -> Entries:
    """Compare the sections with those that the true foot states give by the same rule.

    Parameters
    ----------
    known
        Recording name -> what is known of it.
    sections
        Content of ``sections.json``. A height that the configuration gave has no error.
    """
    pooled = [_true_frames(item, sections["frames"]) for item in known.values()]
    height, all_up, all_down = (np.concatenate(part) for part in zip(*pooled, strict=True))
    tail = sections["tail_fraction"]
    true = {
        "pre": quantile(height[~all_up], 1 - tail),
        "post": quantile(height[~all_down], tail),
    }
    travel = 1e3 * (sections["pre_height_m"] - sections["post_height_m"])
    entries = {"body_travel": entry(travel, "mm", "Height between the pre and the post section")}
    for name, height_m in true.items():
        entries[f"section_{name}_true"] = entry(height_m, "m", f"{name} section, true foot states")
        if sections["decided"][f"{name}_height_m"] == "data":
            error = 1e3 * (sections[f"{name}_height_m"] - height_m)
            what = f"{name} section found minus that of the true foot states"
            entries[f"section_{name}_error"] = entry(error, "mm", what)
    return entries


def _true_frames(item: KnownRecording, frames: str) -> tuple[Floats, Bools, Bools]:
    """Body height and foot states of the frames that the section rule looks at."""
    keep = np.isfinite(item.body_height)
    n_down = item.foot_down.sum(axis=1)
    all_up, all_down = n_down == 0, n_down == item.foot_down.shape[1]
    if chosen("sections.frames", frames, FRAMES):
        keep, landed = landing_frames(item.body_height, all_up, all_down)
        all_up, all_down = all_up & ~landed, all_down | landed
    return item.body_height[keep], all_up[keep], all_down[keep]


def score_floor(known: Mapping[str, KnownRecording]) -> Entries:
    """Compare the floor models with the floor, each after its mean difference is removed."""
    differences = []
    for item in known.values():
        if item.floor_at_contacts is not None and item.floor_model is not None:
            difference = item.floor_model - item.floor_at_contacts
            difference = difference[np.isfinite(difference)]
            differences.append(difference - mean(difference))
    if not differences:
        return {}
    rms = np.sqrt(mean(np.concatenate(differences) ** 2))
    what = "Rms of fitted minus true floor height at the contacts, mean difference removed"
    return {"floor_residual_rms": entry(1e3 * rms, "mm", what)}


def _landed(item: KnownRecording) -> Bools:
    """Mark the landings in which all feet came to stand, (L,)."""
    touched = np.isfinite(item.contact_times).sum(axis=1) == item.contact_times.shape[1]
    return np.logical_and(touched, item.complete)


def _true_contacts(
    known: Mapping[str, KnownRecording], recordings: NDArray[np.str_], found: Floats
) -> Floats:
    """Return the true instants (m, n) of the landings that were found; NaN without one."""
    true = np.full_like(found, np.nan)
    for name, item in known.items():
        rows = np.flatnonzero(recordings == name)
        instants = item.contact_times[_landed(item)]
        landing = match_landings(found[rows], instants)
        true[rows[landing >= 0]] = instants[landing[landing >= 0]]
    return true
