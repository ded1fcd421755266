"""The sections: densities, thresholds, heights and Fig. 2.2 (items 21 to 25)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.labelling.agreement import MOST, NEARLY_ALL, agrees, built
from hopdata.dissertation.labelling.sample_by_both import heights_in, inside_transition
from hopdata.dissertation.rows import Agreement, Row

if TYPE_CHECKING:
    from hopdata.dissertation.labelling.sample_by_both import Both
    from hopdata.landings.sections.frames import Heights
    from hopdata.recording import Recording
    from hopdata.truth import Truth
    from hopdata.walk import Study

#: Bandwidths of the densities with which the printed rule is run, m: a hundredfold.
#: Unit: m. Origin: chosen.
BANDWIDTHS_M = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)


def level_sets(both: Both) -> Row:
    """Item 21: each landing passes both heights, once, on its way down."""
    shares = {}
    speeds = {}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        sections = found.sections
        times = found.touchdowns[["t_pre_s", "t_post_s"]].to_numpy(float)
        passed = np.isfinite(times).all(axis=1)
        n_landings = int(both.truth.complete.sum())
        shares[name] = 100 * float(passed.sum() / n_landings)
        slowest = min(sections.pre_speed_m_s or 0.0, sections.post_speed_m_s or 0.0)
        speeds[name] = slowest
    values = {
        "printed_share": shares["printed"],
        "ours_share": shares["ours"],
        "printed_speed": speeds["printed"],
        "ours_speed": speeds["ours"],
    }
    are_sections = min(shares.values()) >= 100 * NEARLY_ALL and min(speeds.values()) > 0
    return Row(21, agrees(are_sections), values)


def two_modes(both: Both) -> Row:
    """Item 22: the densities of the lowest and the highest foot have two modes."""
    heights = heights_in(both.recording)
    width_m = float(both.printed.sections.bandwidth_m or 0.0)
    values = {"bandwidth": 1e3 * width_m}
    two_modes = []
    for name, foot in (("lowest", heights.min_foot), ("highest", heights.max_foot)):
        lower_m, upper_m, ratio, dip = _modes(foot, width_m)
        values[f"{name}_lower"] = 1e3 * lower_m
        values[f"{name}_upper"] = 1e3 * upper_m
        values[f"{name}_ratio"] = ratio
        values[f"{name}_dip"] = 100 * dip
        two_modes.append(dip < 1 < ratio)
    return Row(22, agrees(all(two_modes)), values)


def _modes(
    heights: FloatArray, bandwidth_m: float
) -> tuple[float, float, float, float]:
    """Return both modes, m, the ratio of their densities, and the dip between them.

    The modes are the highest points of the density below and above half of the range;
    the dip is the lowest density between them, relative to that of the upper one.
    """
    from hopdata.landings.sections.densities import finite, grid_of, kde

    known = finite(heights)
    grid = grid_of(known, bandwidth_m)
    density = kde(known, bandwidth=bandwidth_m, grid=grid)
    half = len(grid) // 2
    low = int(np.argmax(density[:half]))
    high = half + int(np.argmax(density[half:]))
    dip = float(density[low:high].min() / density[high])
    ratio = float(density[low] / density[high])
    return float(grid[low]), float(grid[high]), ratio, dip


def thresholds(both: Both) -> Row:
    """Item 23: thresholds of the feet, over bandwidths; frames whose state is right."""
    heights = heights_in(both.recording)
    lowest = []
    highest = []
    for width_m in BANDWIDTHS_M:
        found = _by_knees(heights, width_m)
        lowest.append(1e3 * found["min_foot_threshold_m"])
        highest.append(1e3 * found["max_foot_threshold_m"])
    printed = both.printed.sections
    ours = both.ours.sections
    values = {
        "printed_low": 1e3 * printed.min_foot_threshold_m,
        "printed_high": 1e3 * printed.max_foot_threshold_m,
        "bandwidth": 1e3 * float(printed.bandwidth_m or 0.0),
        "narrow": 1e3 * BANDWIDTHS_M[0],
        "wide": 1e3 * BANDWIDTHS_M[-1],
        "low_from": lowest[0],
        "low_to": lowest[-1],
        "high_from": highest[0],
        "high_to": highest[-1],
        "printed_right": 100 * _states_right(both, printed),
        "low": 1e3 * ours.min_foot_threshold_m,
        "high": 1e3 * ours.max_foot_threshold_m,
        "right": 100 * _states_right(both, ours),
    }
    return Row(23, Agreement.BUILT, values, "bandwidth")


def _states_right(both: Both, sections: Any) -> float:
    """Return the share of frames whose "all up" and "all down" are both right."""
    heights = heights_in(both.recording)
    n_down = both.truth.foot_down.sum(axis=1)
    all_up = heights.min_foot > sections.min_foot_threshold_m
    all_down = heights.max_foot < sections.max_foot_threshold_m
    n_feet = both.truth.foot_down.shape[1]
    right = (all_up == (n_down == 0)) & (all_down == (n_down == n_feet))
    return float(right[heights.seen].mean())


def _by_knees(heights: Heights, bandwidth_m: float) -> dict[str, float]:
    """Return thresholds and sections by the printed rule, m."""
    from hopdata.landings.sections.densities import finite
    from hopdata.landings.sections.frames import pool_frames
    from hopdata.landings.sections.from_densities import (
        heights_from_densities,
        upper_knee,
    )
    from hopdata.landings.sections.modes import ground_mode

    lowest_m = upper_knee(finite(heights.min_foot), bandwidth_m)
    highest_m = upper_knee(finite(heights.max_foot), bandwidth_m)
    frames = pool_frames(
        [heights],
        min_foot_m=lowest_m,
        max_foot_m=highest_m,
        ground_m=ground_mode(heights.min_foot).height_m,
    )
    pre_m, post_m = heights_from_densities(frames, bandwidth_m)
    return {
        "min_foot_threshold_m": lowest_m,
        "max_foot_threshold_m": highest_m,
        "pre_height_m": pre_m,
        "post_height_m": post_m,
    }


def section_heights(both: Both, again: Sequence[tuple[Recording, Truth]]) -> Row:
    """Item 24: heights of the sections, and whether they keep what the text says."""
    heights = heights_in(both.recording)
    by_width = [_by_knees(heights, width_m) for width_m in BANDWIDTHS_M]
    width_m = float(both.printed.sections.bandwidth_m or 0.0)
    others = [_by_knees(heights_in(recording), width_m) for recording, _ in again]
    values: dict[str, Any] = {
        "narrow": 1e3 * BANDWIDTHS_M[0],
        "wide": 1e3 * BANDWIDTHS_M[-1],
        "bandwidth": 1e3 * width_m,
        "again_pre": [1e3 * one["pre_height_m"] for one in others],
        "again_post": [1e3 * one["post_height_m"] for one in others],
    }
    for side in ("pre", "post"):
        each_mm = [1e3 * one[f"{side}_height_m"] for one in by_width]
        values[f"{side}_from"] = min(each_mm)
        values[f"{side}_to"] = max(each_mm)
    kept = {}
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        sections = found.sections
        values[f"{name}_pre"] = 1e3 * sections.pre_height_m
        values[f"{name}_post"] = 1e3 * sections.post_height_m
        travel_m = sections.pre_height_m - sections.post_height_m
        values[f"{name}_travel"] = 1e3 * travel_m
        kept[name] = _landings_inside(both, found)
        values[f"{name}_inside"] = 100 * kept[name]
        values[f"{name}_all_down"] = 100 * _down_below(both, sections.post_height_m)
    ensured = values["printed_all_down"] >= 100 * NEARLY_ALL
    holds = ensured and kept["printed"] >= NEARLY_ALL
    agreement = Agreement.DIFFERS
    if values["printed_all_down"] >= 100 * MOST:
        agreement = agrees(holds, Agreement.PARTLY)
    return Row(24, agreement, values, "among_contacts")


def _down_below(both: Both, post_m: float) -> float:
    """Return the share of frames below the post section with all feet down."""
    below = heights_in(both.recording).body < post_m
    return float(both.truth.foot_down[below].all(axis=1).mean())


def _landings_inside(both: Both, found: Study) -> float:
    """Return the share of true landings whose contacts lie between the sections."""
    inside = inside_transition(both, found.touchdowns)
    return float(inside.sum() / both.truth.complete.sum())


def section_figure(both: Both) -> Row:
    """Item 25: Fig. 2.2 by both methods."""
    heights = heights_in(both.recording)
    values = {
        "frames": int(heights.seen.sum()),
        "printed_pre": 1e3 * both.printed.sections.pre_height_m,
        "printed_post": 1e3 * both.printed.sections.post_height_m,
        "pre": 1e3 * both.ours.sections.pre_height_m,
        "post": 1e3 * both.ours.sections.post_height_m,
    }
    ordered = all(
        one.sections.pre_height_m > one.sections.post_height_m
        for one in (both.printed, both.ours)
    )
    return Row(25, built(ordered), values)
