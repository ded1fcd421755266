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
from hopdata.landings.sections.select import FRAMES
from hopdata.maps.coordinates import split_states
from hopdata.maps.truth import maps
from hopdata.maps.truth.maps import Entries, entry, mean
from hopdata.maps.truth.scaling import score_scaling
from hopdata.recording import Recording, Truth

# Matching of touchdowns found with true landings, one to one, by time.

#: A touchdown matches a true landing if their mean contact instants differ by at most
#: this.
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
    landing = np.full(len(found), -1)
    means = [np.ma.masked_invalid(one).mean(axis=1) for one in (found, true)]
    timed = [np.flatnonzero(~np.ma.getmaskarray(mean)) for mean in means]
    own, theirs = (mean.compressed() for mean in means)
    rows, matched = match_instants(own, theirs, window_s=MATCH_WITHIN_S)
    landing[timed[0][rows]] = timed[1][matched]
    return landing


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
    usable = table[
        ~table["excluded"].astype(bool) & table["recording"].isin(list(known))
    ]
    found = usable[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    true = _true_contacts(known, usable["recording"].to_numpy(str), found)
    labels = usable["schedule"].astype("string").fillna("").to_numpy(str)
    right = (labels == np.array(schedule_names(true), dtype=str)) & (labels != "")
    sure = (usable["class"] != AMBIGUOUS).to_numpy()
    n_landings = sum(int(_landed(item).sum()) for item in known.values())
    matched = int(np.isfinite(true).any(axis=1).sum())
    errors = found - true
    errors = errors[np.isfinite(errors)]
    bias = mean(errors)
    rms = np.sqrt(mean((errors - bias) ** 2))
    of_all = right.sum() / n_landings if n_landings else float("nan")
    who = f"{method.replace('_', ' ')} method"
    values = (mean(right), mean(right[sure]), of_all, 1e3 * rms, 1e3 * bias)
    counts, told = (n_landings - matched, len(usable) - matched), maps.TOLD["contacts"]
    return {
        f"{name}_{method}": entry(value, unit, f"{what}, {who}")
        for (name, (unit, what)), value in zip(
            told.items(), values + counts, strict=True
        )
    }


def score_sections(
    known: Mapping[str, Truth],
    sections: Mapping[str, Any],
    recordings: Mapping[str, Recording],
) -> Entries:
    """Compare the sections with those that the same rule gives for the true contacts or states.

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
        pre_m, post_m, _ = heights_from_landings(heights, sections["bandwidth_m"])
    else:
        what = "true foot states"
        pooled = [_true_frames(item, sections["frames"]) for item in known.values()]
        frames = Frames(*map(np.concatenate, zip(*pooled, strict=True)))
        pre_m, post_m = heights_from_densities(frames, sections["bandwidth_m"])
    entries: Entries = {}
    for name, height_m in {"pre": pre_m, "post": post_m}.items():
        entries[f"section_{name}_true"] = entry(
            height_m, "m", f"{name} section, {what}"
        )
        if sections["decided"][f"{name}_height_m"] == "data":
            error = 1e3 * (sections[f"{name}_height_m"] - height_m)
            told = f"{name} section found minus that of the {what}"
            entries[f"section_{name}_error"] = entry(error, "mm", told)
    return entries


def _true_heights(item: Truth, recording: Recording) -> FloatArray:
    """Return the body's true heights in the landings, (L, 6): see `landing_heights`."""
    turns = np.array(descents(item.body_height), dtype=np.int64).reshape(-1, 2)
    spans = recording.time[turns]
    instant = item.contact_times[_landed(item)]
    if len(spans) == 0 or len(instant) == 0:
        return np.empty((0, 6))
    number = np.searchsorted(spans[:, 0], instant.min(axis=1)) - 1
    inside = (number >= 0) & (instant.max(axis=1) <= spans[number, 1])
    return heights_at_contacts(
        recording.time,
        item.body_height,
        spans[number[inside]],
        instant[inside],
        pace=recording.pace,
    )


def _true_frames(item: Truth, frames: str) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return body height and foot states of the frames that the rule `printed` uses."""
    n_down, landings_only = (
        item.foot_down.sum(axis=1),
        chosen("sections.frames", frames, FRAMES),
    )
    all_down = n_down == item.foot_down.shape[1]
    return kept_frames(item.body_height, n_down == 0, all_down, landings_only)


def score_floor(
    known: Mapping[str, Truth], floors: Mapping[str, FloorModel]
) -> Entries:
    """Compare the floor models with the true floor, without the mean difference of each."""
    differences = []
    for name, item in known.items():
        x, y = np.moveaxis(item.contact_points, -1, 0)
        difference = floors[name].height(x, y) - item.floor_at_contacts
        difference = difference[np.isfinite(difference)]
        differences.append(difference - mean(difference))
    rms = np.sqrt(mean(np.concatenate(differences) ** 2))
    return {
        "floor_residual_rms": entry(
            1e3 * rms, *maps.TOLD["study"]["floor_residual_rms"]
        )
    }


def _landed(item: Truth) -> BoolArray:
    """Return whether all feet came to stand in each landing, (L,)."""
    touched = np.isfinite(item.contact_times).sum(axis=1) == item.contact_times.shape[1]
    return np.logical_and(touched, item.complete)


def _true_contacts(
    known: Mapping[str, Truth], recordings: NDArray[np.str_], found: FloatArray
) -> FloatArray:
    """Return the true instants (m, n) of the touchdowns found; NaN if no landing matches."""
    true = np.full_like(found, np.nan)
    for name, item in known.items():
        rows = np.flatnonzero(recordings == name)
        instants = item.contact_times[_landed(item)]
        landing = match_landings(found[rows], instants)
        true[rows[landing >= 0]] = instants[landing[landing >= 0]]
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
        Measured and true `Pairs`; the index of the true ones is the number of the
        landing.
    table
        The study's touchdowns.
    contacts
        Recording -> true contact instants (L, feet), s.
    feet
        Names of the feet, in the order of the truth.
    """
    keyed = table.set_index(["recording", "index"])[
        [f"contact_{foot}_s" for foot in feet]
    ]
    keys = list(zip(pairs.recording.tolist(), pairs.index.tolist(), strict=True))
    found = keyed.loc[keys].to_numpy(float)
    numbers = zip(true.recording.tolist(), true.index.tolist(), strict=True)
    places = {key: row for row, key in enumerate(numbers)}
    rows = np.full(len(found), -1)
    for name, instants in contacts.items():
        mine = np.flatnonzero(pairs.recording == name)
        landing = match_landings(found[mine], instants)
        rows[mine] = [places.get((name, int(number)), -1) for number in landing]
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
    mine = [split_states(states[known]) for states in (pairs.x, pairs.y)]
    truly = [split_states(states[rows[known]]) for states in (true.x, true.y)]
    places = (
        np.concatenate([one[0] for one in states], axis=1) for states in (truly, mine)
    )
    turn = _plane_turns(*places)
    offset = np.zeros((len(known), 1, 3))
    both = [(m[0] - t[0] @ turn)[..., :2] for m, t in zip(mine, truly, strict=True)]
    offset[..., :2] = np.concatenate(both, axis=1).mean(axis=1, keepdims=True)
    table = []
    for section, measured, known_state in zip(
        ("pre", "post"), mine, truly, strict=True
    ):
        position = measured[0] - known_state[0] @ turn - offset
        velocity = measured[1] - known_state[1] @ turn
        rms = [1e3 * np.sqrt(mean(errors**2)) for errors in (position, velocity)]
        table.append((section, len(known), *rms))
    columns = ["section", "landings", "position_rms_mm", "velocity_rms_mm_s"]
    return pd.DataFrame(table, columns=columns)


def _plane_turns(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the turns (n, 3, 3) of the plane, for row vectors, from `source` to `target` points.

    Both are (n, k, 3).
    """
    a, b = (
        p[..., :2] - p[..., :2].mean(axis=1, keepdims=True) for p in (source, target)
    )
    along = (a * b).sum(axis=(1, 2))
    across = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1)
    length = np.hypot(along, across)
    turn = np.tile(np.eye(3), (len(a), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = along / length
    turn[:, 0, 1], turn[:, 1, 0] = across / length, -across / length
    return turn


def score_states(errors: pd.DataFrame) -> Entries:
    """Return entries on the errors of positions and velocities at the sections."""
    entries: Entries = {}
    for row in errors.to_dict("records"):
        section = row["section"]
        for name, (unit, what) in maps.TOLD["states"].items():
            value = row[f"{name}_{unit.replace('/', '_')}"]
            entries[f"{name}_{section}"] = entry(
                value, unit, what.format(section=section)
            )
    return entries


@one_blas_thread()
def score(
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
    """
    if not known:
        return {}
    entries: Entries = maps.score_verdict(exact["verdict_errors"]) if exact else {}
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


def score_predictions(summary: pd.DataFrame) -> Entries:
    """Return an entry on whether prediction errors grow with distance from simultaneous contact."""
    mse = dict(zip(summary["model"], summary["median"], strict=True))
    if not {"near", "all", "far"} <= mse.keys():
        return {}
    ordered, name = (
        bool(mse["near"] < mse["all"] < mse["far"]),
        "near_below_all_below_far",
    )
    return {name: entry(ordered, *maps.TOLD["study"][name])}


def score_distances(summary: pd.DataFrame) -> Entries:
    """Return an entry on the gap between random distances and all others."""
    rows = summary.set_index("kind")
    others = rows.drop(index="random", errors="ignore")["q95"]
    if "random" not in rows.index or others.empty:
        return {}
    clearance = rows.loc["random", "q05"] - others.max()
    return {
        "random_clearance": entry(clearance, *maps.TOLD["study"]["random_clearance"])
    }
