"""Accuracy of a synthetic study against its truth: the content of ``truth.json``.

These functions compare the results of the pipeline with the facts of the simulator.
Each entry is ``name -> {"value", "unit", "what"}``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import chosen
from hopdata.landings.contacts.descents import descents
from hopdata.landings.floor_surface import FloorModel
from hopdata.landings.overlay import match_instants
from hopdata.landings.schedules import AMBIGUOUS, schedule_names
from hopdata.landings.sections.frames import Frames, kept_frames
from hopdata.landings.sections.from_densities import heights_from_densities
from hopdata.landings.sections.from_landings import (
    heights_at_contacts,
    heights_from_landings,
)
from hopdata.landings.sections.poincare import FRAMES
from hopdata.maps.coordinates import split_states
from hopdata.maps.truth import maps
from hopdata.maps.truth.maps import Entries, entry, mean
from hopdata.maps.truth.scaling import score_scaling
from hopdata.recording import Recording
from hopdata.truth import Truth

# Matching of touchdowns found with true landings, one to one, by time.

#: A touchdown matches a true landing if their mean contact instants differ by at most
#: this.
#: Unit: s. Origin: chosen.
MATCH_WITHIN_S = 0.1


def match_landings(found: FloatArray, true: FloatArray) -> IntArray:
    """Match touchdowns with landings by their mean contact instants.

    Parameters
    ----------
    found : (m, n) array
        Contact instants of the touchdowns, s; NaN where a foot has none.
    true : (L, n) array
        Contact instants of the landings, s.

    Returns
    -------
    (m,) array
        Number of the landing for each touchdown, or -1 if there is none. If several
        touchdowns are near one landing, only the closest is matched (`match_instants`).
    """
    found_mean = np.ma.masked_invalid(found).mean(axis=1)
    true_mean = np.ma.masked_invalid(true).mean(axis=1)
    rows, landings = match_instants(
        found_mean.compressed(), true_mean.compressed(), window_s=MATCH_WITHIN_S
    )
    # Rows and landings are counted among those that have an instant.
    has_found = np.flatnonzero(~np.ma.getmaskarray(found_mean))
    has_true = np.flatnonzero(~np.ma.getmaskarray(true_mean))
    landing_of = np.full(len(found), -1)
    landing_of[has_found[rows]] = has_true[landings]
    return landing_of


def score_contacts(
    known: Mapping[str, Truth], table: pd.DataFrame, *, feet: Sequence[str], method: str
) -> Entries:
    """Score the mode schedules and contact instants of one method.

    The entries give the share of correct schedules among the touchdowns used and among
    all true landings; in the latter an excluded or missed landing counts as incorrect.
    Touchdowns of recordings without a truth are not scored. A touchdown counts as
    incorrect if no true landing is near it, or if another touchdown is closer to that
    landing.

    Parameters
    ----------
    known
        Recording name -> its truth; L landings in all.
    table
        Touchdowns of all recordings.
    feet
        Names of the n feet, in the order of the truth.
    method
        Suffix of the entries' names.
    """
    is_used = ~table["excluded"].astype(bool)
    usable = table[is_used & table["recording"].isin(list(known))]
    found = usable[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    true = _true_contacts(known, usable["recording"].to_numpy(str), found)
    n_matched = int(np.isfinite(true).any(axis=1).sum())
    n_landings = sum(int(_landed(item).sum()) for item in known.values())

    labels = usable["schedule"].astype("string").fillna("").to_numpy(str)
    true_labels = np.array(schedule_names(true), dtype=str)
    right = (labels == true_labels) & (labels != "")
    unambiguous = (usable["order_class"] != AMBIGUOUS).to_numpy()
    right_of_all = float("nan")
    if n_landings:
        right_of_all = right.sum() / n_landings

    differences = found - true
    errors = differences[np.isfinite(differences)]
    bias = mean(errors)
    rms = np.sqrt(mean((errors - bias) ** 2))
    values = {
        "labels_right": mean(right),
        "labels_right_unambiguous": mean(right[unambiguous]),
        "labels_right_of_all": right_of_all,
        "contact_rms": 1e3 * rms,
        "contact_bias": 1e3 * bias,
        "landings_not_used": n_landings - n_matched,
        "unmatched": len(usable) - n_matched,
    }
    who = f"{method.replace('_', ' ')} method"
    entries = {}
    for name, (unit, what) in maps.TOLD["contacts"].items():
        entries[f"{name}_{method}"] = entry(values[name], unit, f"{what}, {who}")
    return entries


def score_sections(
    known: Mapping[str, Truth],
    sections: Mapping[str, Any],
    recordings: Mapping[str, Recording],
) -> Entries:
    """Compare the sections with those of the same rule for true contacts or states.

    Parameters
    ----------
    known
        Recording name -> its truth.
    sections
        Content of ``sections.json``. A height set in the configuration gets no error.
    recordings
        Recording name -> the recording, of which only the times are used.
    """
    if sections["rule"] == "landings":
        what = "true contacts"
        each = [_true_heights(item, recordings[name]) for name, item in known.items()]
        heights = np.concatenate(each)
        if len(heights) == 0:
            return {}
        held = heights_from_landings(heights, sections["bandwidth_m"])
        # The study's own errors chose the depth: the truth has none.
        share = sections.get("depth", {}).get("share", 0.0)
        pre_m = held.pre_m
        post_m = held.shallow_m - share * (held.shallow_m - held.deep_m)
    else:
        what = "true foot states"
        each_frames = [
            _true_frames(item, sections["frames"]) for item in known.values()
        ]
        frames = Frames(*map(np.concatenate, zip(*each_frames, strict=True)))
        pre_m, post_m = heights_from_densities(frames, sections["bandwidth_m"])
    entries: Entries = {}
    for name, height_m in {"pre": pre_m, "post": post_m}.items():
        told = f"{name} section, {what}"
        entries[f"section_{name}_true"] = entry(height_m, "m", told)
        if sections["chosen_by"][f"{name}_height_m"] == "data":
            error = 1e3 * (sections[f"{name}_height_m"] - height_m)
            told = f"{name} section found minus that of the {what}"
            entries[f"section_{name}_error"] = entry(error, "mm", told)
    return entries


def _true_heights(item: Truth, recording: Recording) -> FloatArray:
    """Return the body's true heights in the landings, (L, 6): see `landing_heights`."""
    turns = np.array(descents(item.body_height), dtype=np.int64).reshape(-1, 2)
    spans = recording.time[turns]
    instants = item.contact_times[_landed(item)]
    if len(spans) == 0 or len(instants) == 0:
        return np.empty((0, 6))
    # The last descent that began before the first contact.
    descent = np.searchsorted(spans[:, 0], instants.min(axis=1)) - 1
    inside = (descent >= 0) & (instants.max(axis=1) <= spans[descent, 1])
    return heights_at_contacts(
        recording.time,
        item.body_height,
        spans[descent[inside]],
        instants[inside],
        time_scale=recording.time_scale,
    )


def _true_frames(item: Truth, frames: str) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return body height and foot states of the frames that the rule `printed` uses."""
    landings_only = chosen("sections.frames", frames, FRAMES)
    n_down = item.foot_down.sum(axis=1)
    all_up = n_down == 0
    all_down = n_down == item.foot_down.shape[1]
    return kept_frames(item.body_height, all_up, all_down, landings_only)


def score_floor(
    known: Mapping[str, Truth], floors: Mapping[str, FloorModel]
) -> Entries:
    """Compare the floor models with the true floor, but for the mean of each."""
    differences = []
    for name, item in known.items():
        x, y = np.moveaxis(item.contact_points, -1, 0)
        difference = floors[name].height(x, y) - item.floor_at_contacts
        known_difference = difference[np.isfinite(difference)]
        differences.append(known_difference - mean(known_difference))
    rms = np.sqrt(mean(np.concatenate(differences) ** 2))
    unit, what = maps.TOLD["study"]["floor_residual_rms"]
    return {"floor_residual_rms": entry(1e3 * rms, unit, what)}


def _landed(item: Truth) -> BoolArray:
    """Return whether all feet came to stand in each landing, (L,)."""
    all_touched = np.isfinite(item.contact_times).all(axis=1)
    return np.logical_and(all_touched, item.complete)


def _true_contacts(
    known: Mapping[str, Truth], recordings: NDArray[np.str_], found: FloatArray
) -> FloatArray:
    """Return true instants (m, n) of the touchdowns found; NaN if none matches."""
    true = np.full_like(found, np.nan)
    for name, item in known.items():
        rows = np.flatnonzero(recordings == name)
        instants = item.contact_times[_landed(item)]
        landing = match_landings(found[rows], instants)
        matched = landing >= 0
        true[rows[matched]] = instants[landing[matched]]
    return true


# Errors of the states at the sections, for a study whose true landings are known.


def true_rows(
    pairs: Any,
    table: pd.DataFrame,
    true: Any,
    contacts: Mapping[str, FloatArray],
    feet: Sequence[str],
) -> IntArray:
    """Return the row of `true` that corresponds to each row of `pairs`, (n,), or -1.

    Parameters
    ----------
    pairs, true
        Measured and true `Pairs`; the touchdown of the true ones is the number of the
        landing in the truth, from 1.
    table
        The study's touchdowns.
    contacts
        Recording -> true contact instants (L, feet), s.
    feet
        Names of the feet, in the order of the truth.
    """
    columns = [f"contact_{foot}_s" for foot in feet]
    by_touchdown = table.set_index(["recording", "touchdown"])[columns]
    numbers = pairs.touchdown.tolist()
    touchdowns = list(zip(pairs.recording.tolist(), numbers, strict=True))
    found = by_touchdown.loc[touchdowns].to_numpy(float)

    landings = zip(true.recording.tolist(), true.touchdown.tolist(), strict=True)
    row_of = {landing: row for row, landing in enumerate(landings)}
    rows = np.full(len(found), -1)
    for name, instants in contacts.items():
        of_recording = np.flatnonzero(pairs.recording == name)
        numbers = match_landings(found[of_recording], instants).tolist()
        rows[of_recording] = [row_of.get((name, number + 1), -1) for number in numbers]
    return rows


@one_blas_thread()
def state_errors(pairs: Any, true: Any, rows: IntArray) -> pd.DataFrame:
    """Return the errors of the states at the sections.

    Each touchdown's home frame is first fitted to the true states, at both sections at
    once, by a shift in the plane and a turn about the vertical.

    Returns
    -------
    DataFrame
        Columns section (``pre``, ``post``), landings, position_rms_mm,
        velocity_rms_mm_s; errors are per coordinate of a marker.
    """
    known = np.flatnonzero(rows >= 0)
    sections = ("pre", "post")
    # Positions and velocities (n, B, 3) at both sections.
    measured = [split_states(pairs.x[known]), split_states(pairs.y[known])]
    exact = [split_states(true.x[rows[known]]), split_states(true.y[rows[known]])]

    exact_positions = np.concatenate([positions for positions, _ in exact], axis=1)
    positions = np.concatenate([positions for positions, _ in measured], axis=1)
    turn = _plane_turns(exact_positions, positions)
    apart = [m[0] - e[0] @ turn for m, e in zip(measured, exact, strict=True)]
    in_plane = np.concatenate([one[..., :2] for one in apart], axis=1)
    shift = np.zeros((len(known), 1, 3))
    shift[..., :2] = in_plane.mean(axis=1, keepdims=True)

    table = []
    for number, section in enumerate(sections):
        position_errors = apart[number] - shift
        velocity_errors = measured[number][1] - exact[number][1] @ turn
        position_rms = 1e3 * np.sqrt(mean(position_errors**2))
        velocity_rms = 1e3 * np.sqrt(mean(velocity_errors**2))
        table.append((section, len(known), position_rms, velocity_rms))
    columns = ["section", "landings", "position_rms_mm", "velocity_rms_mm_s"]
    return pd.DataFrame(table, columns=columns)


def _plane_turns(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the turns (n, 3, 3) of the plane from `source` to `target` points.

    Both are (n, k, 3), and the turns are for row vectors.
    """
    a = source[..., :2] - source[..., :2].mean(axis=1, keepdims=True)
    b = target[..., :2] - target[..., :2].mean(axis=1, keepdims=True)
    along = (a * b).sum(axis=(1, 2))
    across = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1)
    length = np.hypot(along, across)
    turn = np.tile(np.eye(3), (len(a), 1, 1))
    turn[:, 0, 0] = along / length
    turn[:, 1, 1] = along / length
    turn[:, 0, 1] = across / length
    turn[:, 1, 0] = -across / length
    return turn


def score_states(errors: pd.DataFrame) -> Entries:
    """Return entries on the errors of positions and velocities at the sections."""
    entries: Entries = {}
    for row in errors.to_dict("records"):
        section = row["section"]
        for name, (unit, what) in maps.TOLD["states"].items():
            column = f"{name}_{unit.replace('/', '_')}"
            told = what.format(section=section)
            entries[f"{name}_{section}"] = entry(row[column], unit, told)
    return entries


@one_blas_thread()
def score(  # noqa: PLR0913 - every kind of result that is scored
    known: Mapping[str, Truth],
    *,
    floors: Mapping[str, FloorModel],
    feet: Sequence[str],
    tables: Mapping[str, pd.DataFrame],
    sections: Mapping[str, Any],
    recordings: Mapping[str, Recording],
    prediction_summary: pd.DataFrame,
    distance_summary: pd.DataFrame | None = None,
    exact: Mapping[str, pd.DataFrame] | None = None,
    without_exact_maps: str = "",
) -> Entries:
    """Score a study against the truth of its recordings.

    Parameters
    ----------
    known
        Recording name -> its truth; if empty, there is nothing to score.
    floors
        Recording name -> its fitted floor.
    feet
        Names of the n feet, in the order of the truth.
    tables
        Method (``"kink"``, ``"velocity_minimum"``) -> touchdown table of all
        recordings.
    sections
        Content of ``sections.json``.
    recordings
        Recording name -> the recording, of which only the times are used.
    prediction_summary, distance_summary
        Tables of the same names; without the second, distances are not scored.
    exact
        Tables ``state_errors``, ``scaling_study``, ``estimate_errors`` and
        ``verdict_errors``, if all recordings of the study are simulated.
    without_exact_maps
        Why these have no exact maps to compare with; empty if they have.
    """
    if not known:
        return {}
    entries: Entries = {}
    if without_exact_maps:
        unit, what = maps.TOLD["study"]["exact_maps"]
        said = what.format(reason=without_exact_maps)
        entries["exact_maps"] = entry(False, unit, said)
    if exact:
        entries |= maps.score_verdict(exact["verdict_errors"])
    else:
        entries |= recorded_effect(known)
    for method, table in tables.items():
        entries |= score_contacts(known, table, feet=feet, method=method)
    entries |= score_sections(known, sections, recordings)
    entries |= score_floor(known, floors)
    entries |= score_predictions(prediction_summary)
    if distance_summary is not None:
        entries |= score_distances(distance_summary)
    if exact:
        entries |= score_states(exact["state_errors"])
        entries |= score_scaling(exact["scaling_study"])
        entries |= maps.score_estimates(exact["estimate_errors"])
    return entries


def recorded_effect(known: Mapping[str, Truth]) -> Entries:
    """Return the true difference of the maps that the files state, if they agree.

    It holds between the sections for which it was computed; see
    `hopdata.truth.Truth.true_effect`.
    """
    stated = [truth.true_effect for truth in known.values()]
    if not stated or not np.allclose(stated, stated[0], atol=1e-9):
        return {}
    unit, what = maps.TOLD["recording"]["recorded_true_effect"]
    return {"recorded_true_effect": entry(stated[0], unit, what)}


def score_predictions(summary: pd.DataFrame) -> Entries:
    """Return an entry on whether errors grow away from simultaneous contact."""
    mse = dict(zip(summary["model"], summary["median_mse"], strict=True))
    if not {"near", "all", "far"} <= mse.keys():
        return {}
    ordered = bool(mse["near"] < mse["all"] < mse["far"])
    unit, what = maps.TOLD["study"]["near_below_all_below_far"]
    return {"near_below_all_below_far": entry(ordered, unit, what)}


def score_distances(summary: pd.DataFrame) -> Entries:
    """Return an entry on the gap between random distances and all others."""
    rows = summary.set_index("kind")
    others = rows.drop(index="random", errors="ignore")["q95"]
    if "random" not in rows.index or others.empty:
        return {}
    clearance = rows.loc["random", "q05"] - others.max()
    unit, what = maps.TOLD["study"]["random_clearance"]
    return {"random_clearance": entry(clearance, unit, what)}
