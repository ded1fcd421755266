"""The labels: which contact order, and which touchdowns count (items 26 to 29)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.labelling.agreement import NEARLY_ALL, agrees, built
from hopdata.dissertation.labelling.sample_by_both import (
    inside_transition,
    instants_of,
    true_contacts,
    used_of,
)
from hopdata.dissertation.rows import Agreement, Row

if TYPE_CHECKING:
    from hopdata.arrays import pd
    from hopdata.dissertation.labelling.sample_by_both import Both
    from hopdata.recording import Recording


@dataclass(frozen=True)
class _Score:
    """Share of right orders and of ties, in per cent; bias and deviation, ms."""

    right: float
    ties: float
    bias: float
    deviation: float


def _scored(both: Both, instants: FloatArray) -> _Score:
    """Score contacts (m, n), s, against the truth."""
    from hopdata.landings.schedules import schedule_names

    true = true_contacts(both, instants)
    labels = np.array(schedule_names(instants), dtype=str)
    known = np.array(schedule_names(true), dtype=str)
    right = (labels == known) & (known != "")
    ordered = np.sort(instants, axis=1)
    ties = (np.diff(ordered, axis=1) < 1e-9).any(axis=1)
    errors_ms = 1e3 * (instants - true)
    errors_ms = errors_ms[np.isfinite(errors_ms)]
    return _Score(
        right=100 * float(right.mean()),
        ties=100 * float(ties.mean()),
        bias=float(errors_ms.mean()),
        deviation=float(errors_ms.std()),
    )


def velocity_minimum(both: Both) -> Row:
    """Item 26: the printed label, beside the order by the feet's heights."""
    from hopdata.landings.touchdowns import touchdown_table

    (contacts,) = both.printed.contacts.values()
    sections = both.ours.sections
    at_ours = touchdown_table(
        both.recording,
        pre_height_m=sections.pre_height_m,
        post_height_m=sections.post_height_m,
        landings=contacts,
        method="velocity_minimum",
    )
    used = used_of(both.printed.touchdowns)
    threshold_m = both.printed.sections.max_foot_threshold_m
    (uneven,) = both.printed.imported
    printed = _scored(both, instants_of(both, used))
    elsewhere = _scored(both, instants_of(both, used_of(at_ours)))
    level = _scored(both, _first_below(both.recording, used, threshold_m))
    raw = _scored(both, _first_below(uneven, used, threshold_m))
    kink = _scored(both, instants_of(both, used_of(both.ours.touchdowns)))
    values = {
        "right": printed.right,
        "ties": printed.ties,
        "bias": -printed.bias,
        "deviation": printed.deviation,
        "at_ours": elsewhere.right,
        "by_height": level.right,
        "by_raw_height": raw.right,
        "kink": kink.right,
    }
    agreement = Agreement.DIFFERS
    if is_higher(printed.right, raw.right, len(used)):
        better = is_higher(printed.right, level.right, len(used))
        agreement = agrees(better, Agreement.PARTLY)
    return Row(26, agreement, values, "whole_frames")


def is_higher(percent: float, other: float, number: int) -> bool:
    """Tell whether one share is higher than another by two standard errors."""
    shares = np.array([percent, other]) / 100
    error = np.sqrt((shares * (1 - shares)).sum() / number)
    return bool(shares[0] - shares[1] > 2 * error)


def _first_below(
    recording: Recording, table: pd.DataFrame, threshold_m: float
) -> FloatArray:
    """Return the first frame of each transition with the foot down, (m, n), s.

    A foot is down below the threshold; NaN where it never is.
    """
    heights = recording.feet[:, :, 2]
    found = np.full((len(table), heights.shape[1]), np.nan)
    spans = table[["t_pre_s", "t_post_s"]].to_numpy(float)
    first, stop = np.searchsorted(recording.time, spans).T
    for row, (begin, end) in enumerate(zip(first, stop, strict=True)):
        # A foot may come down a little later than the section.
        after = slice(begin, 2 * end - begin)
        down = heights[after] < threshold_m
        landed = down.any(axis=0)
        found[row, landed] = recording.time[begin + down.argmax(axis=0)[landed]]
    return found


def default_labels(both: Both) -> Row:
    """Item 27: the order of the contacts decides the class of a touchdown."""
    printed = _scored(both, instants_of(both, used_of(both.printed.touchdowns)))
    kink = _scored(both, instants_of(both, used_of(both.ours.touchdowns)))
    n_true = int(both.truth.complete.sum())
    n_used = len(used_of(both.ours.touchdowns))
    values = {
        "printed_right": printed.right,
        "right": kink.right,
        "bias": kink.bias,
        "deviation": kink.deviation,
        "used": n_used,
        "landings": n_true,
        "schedules": used_of(both.ours.touchdowns)["schedule"].nunique(),
        "printed_schedules": used_of(both.printed.touchdowns)["schedule"].nunique(),
    }
    return Row(27, Agreement.BUILT, values, "frames")


def excluded(both: Both) -> Row:
    """Item 28: touchdowns with a foot outside the transition."""
    values: dict[str, Any] = {"landings": int(both.truth.complete.sum())}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        table = found.touchdowns
        used = used_of(table)
        inside = inside_transition(both, used)
        values[f"{name}_excluded"] = len(table) - len(used)
        values[f"{name}_used"] = len(used)
        values[f"{name}_outside"] = int((~inside).sum())
    # The minimum leads the contact, so contacts beyond the post section pass as inside.
    all_excluded = (
        values["printed_outside"] <= (1 - NEARLY_ALL) * values["printed_used"]
    )
    agreement = Agreement.DIFFERS
    if values["printed_outside"] < values["printed_excluded"]:
        agreement = agrees(all_excluded, Agreement.PARTLY)
    return Row(28, agreement, values, "lead")


def schedule_figure(both: Both) -> Row:
    """Item 29: the plus of each foot, and the minimum of its velocity."""
    values: dict[str, Any] = {}
    examples = examples_of(both)
    for name in ("printed", "ours"):
        example = examples[f"{name}_example"]
        shown = examples[f"{name}_touchdown"].iloc[0]
        values[name] = _above_minimum(example, shown)
        values[f"{name}_order"] = str(shown["schedule"]).replace(">", ", ")
    on_minima = values["printed"] < 1e-9 < values["ours"]
    return Row(29, built(on_minima), values, "kink")


def _above_minimum(example: pd.DataFrame, touchdown: pd.Series) -> float:
    """Return how far above its smallest velocity a foot's plus lies at most, m/s."""
    end_s = float(touchdown["t_post_s"] - touchdown["t_pre_s"])
    most = 0.0
    for foot, rows in example.groupby("foot", sort=False):
        time = rows["time_s"].to_numpy(float)
        velocity = rows["velocity_m_s"].to_numpy(float)
        instant = float(touchdown[f"contact_{foot}_s"] - touchdown["t_pre_s"])
        inside = (time >= 0) & (time <= end_s)
        at_plus = float(np.interp(instant, time, velocity))
        most = max(most, at_plus - float(velocity[inside].min()))
    return most


def examples_of(both: Both) -> dict[str, pd.DataFrame]:
    """Return one landing by both methods: its samples, and its row of touchdowns."""
    from hopdata.landings.contacts.velocity_minimum import example_touchdown

    recordings = [both.recording]
    printed = both.printed.touchdowns
    example = example_touchdown(recordings, printed)
    shown = printed[printed["touchdown"] == example["touchdown"].iloc[0]]
    ours = used_of(both.ours.touchdowns)
    nearest = (ours["t_pre_s"] - float(shown["t_pre_s"].iloc[0])).abs().idxmin()
    same = ours.loc[[nearest]]
    return {
        "printed_example": example,
        "printed_touchdown": shown,
        "ours_example": example_touchdown(recordings, same),
        "ours_touchdown": same,
    }
