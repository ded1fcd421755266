"""The choice of the sections of a study, by either of two rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, require_choice
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.sections.densities import finite, usual_bandwidth
from hopdata.landings.sections.depth import Depth, choose_depth
from hopdata.landings.sections.frames import Heights, heights_of, pooled
from hopdata.landings.sections.from_densities import heights_from_densities, upper_knee
from hopdata.landings.sections.from_landings import (
    fall_speed,
    heights_from_landings,
    holds,
    landing_heights,
)
from hopdata.landings.sections.modes import ground_mode
from hopdata.landings.sections.poincare import FRAMES, Sections
from hopdata.landings.sections.refused import no_landing, require_both, require_hopping
from hopdata.recording import Recording

#: Least height of a knee above its mode: no floor is known more accurately.
#: Unit: m. Origin: chosen.
LEAST_KNEE_M = 3e-4

#: Quantile of the speeds of the fall at a section that gives its large leverage.
#: Unit: 1. Origin: convention: one landing in twenty is slower.
SLOW = 0.05


@one_blas_thread()
def select_sections(  # noqa: PLR0913 (the data, and the options of the rules)
    recordings: Sequence[Recording],
    *,
    landings: Mapping[str, pd.DataFrame] | None = None,
    rule: str = "landings",
    frames: str = "all",
    threshold_sigmas: float = 3.0,
    bandwidth_m: float | None = None,
    min_foot_threshold_m: float | None = None,
    max_foot_threshold_m: float | None = None,
    pre_height_m: float | None = None,
    post_height_m: float | None = None,
    depth_share: float | None = None,
    states: Mapping[str, Any] | None = None,
    compare: bool = False,
) -> Sections:
    """Select the pre- and post-touchdown sections from all recordings of a study.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor (see `hopdata.landings.floor.level`), each with feet and body.
    landings : mapping, optional
        Landings of each recording by name, from
        `hopdata.landings.contacts.find.find_study_landings`; by default found here.
    rule : {"landings", "printed"}
        ``"landings"``: the heights of the body in landings choose the sections (see
        `hopdata.landings.sections.from_landings`). ``"printed"``: knees of the
        densities of all frames do (see `hopdata.landings.sections.from_densities`).
    frames : {"all", "landings"}
        Frames whose densities of body height are drawn, and count for the rule
        ``"printed"``: all frames, or only descents of the body, from apex to nadir, in
        which the feet go from all up to all down. The latter is for animals that also
        stand on feet that are not followed.
    threshold_sigmas : float
        With the rule ``"landings"``, distance from a ground mode to its threshold, in
        deviations of the left flank, > 0.
    bandwidth_m : float, optional
        Bandwidth of all densities by which the rule chooses, m; by default from the
        data.
    min_foot_threshold_m, max_foot_threshold_m, pre_height_m, post_height_m : float,
    optional
        Values to use instead of those from the data, m.
    depth_share : float, optional
        Place of the post section between the shallowest and the deepest height that
        hold the landings, 0 to 1, with the rule ``"landings"``; by default the study's
        own errors choose it.
    states : mapping, optional
        Options of the states by whose errors it is chosen: see
        `hopdata.landings.sections.depth.choose_depth`.
    compare : bool
        Whether to add the heights that the other rule chooses.

    Raises
    ------
    AnalysisError
        If there is no landing of all feet; with the rule ``"printed"``, if the feet
        never leave the ground together or never stand on it together, or if no descent
        is a landing. If the pre section is not above the post section, or the bandwidth
        does not suit the heights.
    ConfigError
        If `rule` or `frames` is unknown.
    """
    require_choice("sections.rule", rule, RULES)
    require_choice("sections.frames", frames, FRAMES)
    given = {
        "min_foot_threshold_m": min_foot_threshold_m,
        "max_foot_threshold_m": max_foot_threshold_m,
        "pre_height_m": pre_height_m,
        "post_height_m": post_height_m,
    }
    if landings is None:
        tables = find_study_landings(recordings)
    else:
        tables = [landings[one.name] for one in recordings]
    heights = [heights_of(recording) for recording in recordings]
    pairs = zip(recordings, tables, strict=True)
    in_each = [landing_heights(recording, table) for recording, table in pairs]
    of_landings = np.concatenate(in_each)
    scale = float(np.median([recording.scale for recording in recordings]))
    every_foot = pooled([recording.feet[:, :, 2] for recording in recordings])
    decided = {}
    start_m = {}  # NaN for what the rule has to find
    for name, value in given.items():
        decided[name] = "data" if value is None else "config"
        start_m[name] = np.nan if value is None else value
    start = Sections(
        **start_m,
        ground_m=ground_mode(every_foot, scale=scale).height_m,
        min_foot_mode=ground_mode(pooled([h.min_foot for h in heights]), scale=scale),
        max_foot_mode=ground_mode(pooled([h.max_foot for h in heights]), scale=scale),
        rule=rule,
        bandwidth_m=bandwidth_m,
        threshold_sigmas=threshold_sigmas,
        frames=frames,
        chosen_by=decided,
        landing_shares={},
        pre_speed_m_s=None,
        post_speed_m_s=None,
        instant_shift_s_m={},
        depth={},
        n_landings=len(of_landings),
        n_frames=sum(int(h.seen.sum()) for h in heights),
        n_used=0,
        other_rule={},
    )
    material = _Material(
        recordings, tables, heights, of_landings, scale, depth_share, states
    )
    sections = RULES[rule](start, material)
    if not sections.pre_height_m > sections.post_height_m:
        found = (
            f"{sections.pre_height_m:.4f} m and {sections.post_height_m:.4f} m; "
            "set sections.pre_height_m and sections.post_height_m"
        )
        if rule == "printed":
            found += ", or sections.rule to landings"
        raise AnalysisError.at(
            "sections", "the pre section above the post section", found
        )
    if compare:
        sections = replace(sections, other_rule=_beside(start, material))
    pre_speed_m_s = _fall_speeds(sections.pre_height_m, material)
    post_speed_m_s = _fall_speeds(sections.post_height_m, material)
    return replace(
        sections,
        landing_shares={
            "pre": _share_held(sections.pre_height_m, of_landings, "pre"),
            "post": _share_held(sections.post_height_m, of_landings, "post"),
        },
        pre_speed_m_s=_usual(pre_speed_m_s),
        post_speed_m_s=_usual(post_speed_m_s),
        instant_shift_s_m={
            "pre": instant_shift(pre_speed_m_s),
            "post": instant_shift(post_speed_m_s),
        },
    )


@dataclass(frozen=True)
class _Material:
    """What a rule may choose from; heights in frames, and in landings (L, 6)."""

    recordings: Sequence[Recording]
    landings: Sequence[pd.DataFrame]
    heights: Sequence[Heights]
    of_landings: FloatArray
    scale: float
    depth_share: float | None
    states: Mapping[str, Any] | None


def _by_landings(sections: Sections, material: _Material) -> Sections:
    """Fill in what is not given (NaN) by the rule `landings`."""
    floor_m = LEAST_KNEE_M * material.scale
    lowest = sections.min_foot_mode
    highest = sections.max_foot_mode
    sigmas = sections.threshold_sigmas
    sections = _filled(
        sections,
        min_foot_threshold_m=max(lowest.knee(sigmas), lowest.height_m + floor_m),
        max_foot_threshold_m=max(highest.knee(sigmas), highest.height_m + floor_m),
    )
    frames = sections.pooled(material.heights)
    sections = replace(sections, n_used=len(frames.body))
    if sections.chosen_by["min_foot_threshold_m"] == "config":
        require_both(
            "min_foot_threshold_m", sections.min_foot_threshold_m, "up", frames.all_up
        )
    if sections.chosen_by["max_foot_threshold_m"] == "config":
        require_both(
            "max_foot_threshold_m",
            sections.max_foot_threshold_m,
            "down",
            frames.all_down,
        )
    if _both_given(sections):
        return replace(sections, bandwidth_m=None)
    if len(material.of_landings) == 0:
        raise no_landing(material.recordings, material.landings, sections)
    held = heights_from_landings(material.of_landings, sections.bandwidth_m)
    sections = replace(sections, bandwidth_m=held.bandwidth_m)
    sections = _filled(sections, pre_height_m=held.pre_m)
    if sections.chosen_by["post_height_m"] == "config":
        return sections
    if material.depth_share is None:
        depth = choose_depth(
            material.recordings,
            material.landings,
            pre_m=sections.pre_height_m,
            shallow_m=held.shallow_m,
            deep_m=held.deep_m,
            states=material.states,
        )
    else:
        depth = Depth(material.depth_share, (), 0)
    post_m = held.shallow_m - depth.share * (held.shallow_m - held.deep_m)
    found = {
        "shallowest_m": held.shallow_m,
        "deepest_m": held.deep_m,
        "share": depth.share,
        "misfit": list(depth.misfit),
        "n_landings": depth.n_landings,
    }
    return replace(_filled(sections, post_height_m=post_m), depth=found)


def _by_densities(sections: Sections, material: _Material) -> Sections:
    """Fill in what is not given (NaN) by the rule `printed`."""
    min_foot = pooled([h.min_foot[h.seen] for h in material.heights])
    max_foot = pooled([h.max_foot[h.seen] for h in material.heights])
    bandwidth_m = sections.bandwidth_m
    if bandwidth_m is None:
        body = pooled([h.body[h.seen] for h in material.heights])
        range_m = float(max(np.ptp(body), np.ptp(max_foot)))
        bandwidth_m = usual_bandwidth([min_foot, max_foot, body], range_m)
    sections = _filled(
        sections,
        min_foot_threshold_m=upper_knee(min_foot, bandwidth_m),
        max_foot_threshold_m=upper_knee(max_foot, bandwidth_m),
    )
    frames = sections.pooled(material.heights)
    sections = replace(sections, n_used=len(frames.body), bandwidth_m=bandwidth_m)
    if _both_given(sections):
        return sections
    require_hopping(frames, sections)
    pre_m, post_m = heights_from_densities(frames, bandwidth_m)
    return _filled(sections, pre_height_m=pre_m, post_height_m=post_m)


RULES = {"landings": _by_landings, "printed": _by_densities}


def _filled(sections: Sections, **values_m: float) -> Sections:
    """Return the sections with those of the values, m, that are not given (NaN)."""
    missing: dict[str, Any] = {}
    for name, value_m in values_m.items():
        if np.isnan(getattr(sections, name)):
            missing[name] = value_m
    return replace(sections, **missing)


def _both_given(sections: Sections) -> bool:
    """Tell whether both heights come from the configuration."""
    decided = sections.chosen_by
    return decided["pre_height_m"] == decided["post_height_m"] == "config"


def _beside(start: Sections, material: _Material) -> dict[str, Any]:
    """Return what the other rule chooses from the same material, or why it cannot."""
    other = "printed" if start.rule == "landings" else "landings"
    # A bandwidth that was given suits the densities of one rule only.
    free = replace(
        start, rule=other, pre_height_m=np.nan, post_height_m=np.nan, bandwidth_m=None
    )
    decided = start.chosen_by | {"pre_height_m": "data", "post_height_m": "data"}
    try:
        found = RULES[other](replace(free, chosen_by=decided), material)
    except AnalysisError as error:
        return {
            "rule": other,
            "pre_height_m": None,
            "post_height_m": None,
            "note": str(error),
        }
    heights = {"pre_height_m": found.pre_height_m, "post_height_m": found.post_height_m}
    return {"rule": other, **heights}


def _share_held(height_m: float, of_landings: FloatArray, side: str) -> float | None:
    """Return the share of landings (L, 6) that a section holds; None without any."""
    if len(of_landings) == 0:
        return None
    return float(np.mean(holds(height_m, of_landings, side)))


def _fall_speeds(height_m: float, material: _Material) -> FloatArray:
    """Return the speeds of the falls past a height, m/s."""
    pairs = zip(material.recordings, material.landings, strict=True)
    speeds = [fall_speed(recording, table, height_m) for recording, table in pairs]
    return finite(np.concatenate(speeds))


def _usual(speeds_m_s: FloatArray) -> float | None:
    """Return the median; None without any."""
    if len(speeds_m_s) == 0:
        return None
    return float(np.median(speeds_m_s))


def instant_shift(speeds_m_s: FloatArray) -> dict[str, float | None]:
    """Return how much an error in height shifts the instant of a passage, s/m.

    Parameters
    ----------
    speeds_m_s : (L,) array
        Speeds of the falls past a section, m/s.

    Returns
    -------
    dict
        ``usual``, the median over the landings, and ``large``, their 95 % quantile;
        None where the body does not fall, and without landings.
    """
    found: dict[str, float | None] = {}
    for name, quantile in (("usual", 0.5), ("large", SLOW)):
        found[name] = None
        if len(speeds_m_s) > 0:
            slow_m_s = float(np.quantile(speeds_m_s, quantile))
            if slow_m_s > 0:
                found[name] = 1.0 / slow_m_s
    return found
