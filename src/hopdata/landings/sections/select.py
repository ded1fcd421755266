"""Poincare sections: above one all feet are up, below the other all are down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, Shown, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, counted, require_choice
from hopdata.landings.contacts.descents import LANDED
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.contacts.tables import contacts_of
from hopdata.landings.sections.densities import (
    finite,
    kde,
    normal_bandwidth,
    usual_bandwidth,
)
from hopdata.landings.sections.depth import Depth, choose_depth
from hopdata.landings.sections.frames import (
    Frames,
    Heights,
    heights_of,
    pool_frames,
    pooled,
)
from hopdata.landings.sections.from_densities import heights_from_densities, upper_knee
from hopdata.landings.sections.from_landings import (
    FIRST_CONTACT,
    LAST_CONTACT,
    LOWEST,
    TOP,
    fall_speed,
    heights_from_landings,
    holds,
    landing_heights,
)
from hopdata.landings.sections.modes import GroundMode, ground_mode
from hopdata.messages import Message
from hopdata.recording import Recording, place_of

FRAMES = {"all": False, "landings": True}  # whether only frames of landings count
FEET = ("min_foot", "max_foot")

#: Least height of a knee above its mode: no floor is known more accurately.
#: Unit: m. Origin: chosen.
LEAST_KNEE_M = 3e-4

#: Fewest frames with all feet up, and with all down, in a hopping gait.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 5

#: Share of the descents in which each foot lands if feet land in turn; fewer are of a
#: foot that hardly lands.
#: Unit: 1. Origin: chosen.
LEAST_TOUCHES = 0.1

#: Range of the body's height, as a share of the recording's scale, below which feet
#: that never land together are those of a walk.
#: Unit: 1. Origin: chosen: a walker's body moves by some 0.03 to 0.06.
LEAST_BOUNCE = 0.08

#: Share of the landings of two feet beyond which they land together.
#: Unit: 1. Origin: chosen.
MOSTLY = 0.5

#: Bandwidth of the densities of feet, in deviations of the ground mode; it widens the
#: mode by 12 %.
#: Unit: deviations. Origin: chosen.
FOOT_BANDWIDTH = 0.5

#: Smallest bandwidth of the densities of feet, as a share of the range of heights, for
#: data without noise.
#: Unit: 1. Origin: chosen.
FINEST_BANDWIDTH = 1e-5

#: Quantile of the speeds of the fall at a section that gives its large leverage.
#: Unit: 1. Origin: convention: one landing in twenty is slower.
SLOW = 0.05

# Reach of a curve beyond its heights, in bandwidths.
REACH_OF_FEET = 4
REACH_OF_BODIES = 3


@dataclass(frozen=True, repr=False)
class Sections(Shown):
    """Thresholds of foot height, and the two sections.

    Parameters
    ----------
    pre_height_m, post_height_m : float
        Mean height of the body markers at the pre- and post-touchdown section, m.
    min_foot_threshold_m, max_foot_threshold_m : float
        Height of the lowest (highest) foot above which all feet (some feet) are up, m.
    ground_m : float
        Ground mode of the pooled heights of all feet, m.
    min_foot_mode, max_foot_mode : GroundMode
        Ground mode of the lowest and of the highest foot.
    rule : {"landings", "printed"}
        How the sections were chosen.
    bandwidth_m : float or None
        Bandwidth of the densities by which they were chosen, m; None if both heights
        were given.
    threshold_sigmas : float
        Deviations from a mode to its upper knee, with the rule ``"landings"``.
    frames : {"all", "landings"}
        Frames whose body heights are pooled.
    chosen_by : dict
        ``"data"`` or ``"config"`` for each of the four heights above.
    landing_shares : dict
        Share of the landings of all feet that the ``"pre"`` and the ``"post"`` section
        hold; None if there are no landings.
    pre_speed_m_s, post_speed_m_s : float or None
        Median speed of the fall as a landing passes the section, m/s. An error in
        height shifts the instant of the passage by that error over this speed.
    instant_shift_s_m : dict
        For the ``"pre"`` and the ``"post"`` section, how much an error in height shifts
        the instant of the passage, s/m: ``usual``, the median over the landings, and
        ``large``, their 95 % quantile. None where the body hardly falls, and without
        landings.
    depth : dict
        How the rule ``"landings"`` chose among the post sections that hold nearly as
        many landings: ``shallowest_m`` and ``deepest_m``, and what `Depth` has (see
        `hopdata.landings.sections.depth`). Empty if nothing was chosen.
    n_landings : int
        Number of landings of all feet.
    n_frames : int
        Number of frames in which all feet and the body are seen.
    n_used : int
        Number of these frames that are pooled.
    other_rule : dict
        The same recordings by the other rule: ``rule``, ``pre_height_m`` and
        ``post_height_m``; if it has no heights, ``note`` says why. Empty if it was not
        asked for.
    """

    pre_height_m: float
    post_height_m: float
    min_foot_threshold_m: float
    max_foot_threshold_m: float
    ground_m: float
    min_foot_mode: GroundMode
    max_foot_mode: GroundMode
    rule: str
    bandwidth_m: float | None
    threshold_sigmas: float
    frames: str
    chosen_by: dict[str, str]
    landing_shares: dict[str, float | None]
    pre_speed_m_s: float | None
    post_speed_m_s: float | None
    instant_shift_s_m: dict[str, dict[str, float | None]]
    depth: dict[str, Any]
    n_landings: int
    n_frames: int
    n_used: int
    other_rule: dict[str, Any]

    def pooled(self, heights: Sequence[Heights]) -> Frames:
        """Pool the frames whose body heights count, each with its state."""
        return pool_frames(
            heights,
            min_foot_m=self.min_foot_threshold_m,
            max_foot_m=self.max_foot_threshold_m,
            ground_m=self.ground_m,
            landings_only=chosen("sections.frames", self.frames, FRAMES),
        )

    def _told(self) -> str:
        """Describe the heights of the two sections."""
        pre_mm, post_mm = 1e3 * self.pre_height_m, 1e3 * self.post_height_m
        return f"{pre_mm:.1f} mm before, {post_mm:.1f} mm after the landing"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and dictionaries, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Sections:
        """Make the sections from the fields that `to_dict` returns."""
        made = dict(fields)
        for name in ("min_foot_mode", "max_foot_mode"):
            made[name] = GroundMode(**fields[name])
        return cls(**made)


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
        _require_both(
            "min_foot_threshold_m", sections.min_foot_threshold_m, "up", frames.all_up
        )
    if sections.chosen_by["max_foot_threshold_m"] == "config":
        _require_both(
            "max_foot_threshold_m",
            sections.max_foot_threshold_m,
            "down",
            frames.all_down,
        )
    if _both_given(sections):
        return replace(sections, bandwidth_m=None)
    if len(material.of_landings) == 0:
        raise _no_landing(material, frames, sections)
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
    _require_hopping(frames, sections)
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


def _no_landing(
    material: _Material, frames: Frames, sections: Sections
) -> AnalysisError:
    """Return the error that says which feet land, if never all of them do.

    If none does, the heights of the feet may say why: `_require_hopping` raises its own
    error.
    """
    feet = material.recordings[0].names("foot")
    landed = np.concatenate(
        [contacts_of(table).status == LANDED for table in material.landings]
    )
    touches = landed.sum(axis=0)
    descents = len(landed)
    groups = feet_in_turn(landed)
    if groups:
        told = []
        for own in groups:
            count = np.count_nonzero(landed[:, own].all(axis=1))
            told.append(f"{' and '.join(feet[foot] for foot in own)} in {count}")
        values = {
            "descents": descents,
            "groups": "; ".join(told),
            "first": ", ".join(feet[foot] for foot in groups[0]),
        }
        return AnalysisError(Message("landings.feet_land_in_turn", values))
    bodies = pooled([one.body for one in material.heights])
    low_m, high_m = np.nanquantile(bodies, [0.01, 0.99])
    if touches.max() > 0 and high_m - low_m < LEAST_BOUNCE * material.scale:
        values = {
            "descents": descents,
            "mm": 1e3 * (high_m - low_m),
            "place": place_of(material.recordings[0]),
        }
        return AnalysisError(Message("landings.looks_like_a_walk", values))
    if touches.max() > 0:
        change = "record more, or take feet that hardly land off markers.feet"
    else:
        _require_hopping(frames, sections)
        change = "if they stand above z = 0, raise touchdowns.down_height_m above that"
    counts = zip(feet, touches, strict=True)
    each = ", ".join(f"{foot} in {count}" for foot, count in counts)
    return AnalysisError(
        "sections: expected landings in which the contact of every foot is found, "
        f"found none in {counted(descents, 'descent')} of the body ({each}); "
        f"{change}, or set sections.pre_height_m and sections.post_height_m"
    )


def feet_in_turn(landed: BoolArray) -> list[list[int]]:
    """Return the groups of feet that land together, if one group lands after another.

    Parameters
    ----------
    landed : (L, F) bool array
        Which of the feet land in which descent of the body.

    Returns
    -------
    list of lists of int
        Numbers of the feet of each group; empty unless there are two groups or more of
        two feet or more, and one lands in most of the descents of each foot.
    """
    from scipy.sparse.csgraph import connected_components

    together = landed.T.astype(np.int64) @ landed
    touches = together.diagonal()
    if not len(landed) or touches.min() < LEAST_TOUCHES * len(landed):
        return []
    fewer = np.minimum(touches[:, None], touches)
    n_groups, group_of = connected_components(together > MOSTLY * fewer)
    groups = [np.flatnonzero(group_of == group).tolist() for group in range(n_groups)]
    if n_groups < 2 or min(map(len, groups)) < 2:
        return []
    return groups


def _require_hopping(frames: Frames, sections: Sections) -> None:
    """Raise an error unless the feet are all up in some frames, all down in others."""
    n_up = int(frames.all_up.sum())
    n_down = int(frames.all_down.sum())
    lowest_m = sections.min_foot_threshold_m
    highest_m = sections.max_foot_threshold_m
    if min(n_up, n_down) >= LEAST_FRAMES:
        _require_both("min_foot_threshold_m", lowest_m, "up", frames.all_up)
        _require_both("max_foot_threshold_m", highest_m, "down", frames.all_down)
        return
    narrower = ""
    if sections.rule == "printed":
        narrower = ", or a smaller sections.bandwidth_m"
    if FRAMES[sections.frames]:
        raise AnalysisError(
            "sections: expected descents of the body in which the feet go from all up "
            f"to all down, found none (all up: lowest foot above {lowest_m:.4f} m; all "
            f"down: highest foot below {highest_m:.4f} m); in a walk the body need not "
            "sink when a foot lands; otherwise set sections.min_foot_threshold_m and "
            f"sections.max_foot_threshold_m{narrower}"
        )
    if n_up < n_down:
        where = "leave"
        key = "min_foot_threshold_m"
        threshold_m = lowest_m
        n = n_up
        walks = (
            "; a walk, in which some foot is always down, has no landing on several "
            "feet: `hopdata contacts` times it"
        )
    else:
        where = "stand on"
        key = "max_foot_threshold_m"
        threshold_m = highest_m
        n = n_down
        walks = ""
    raise AnalysisError(
        f"sections: the feet never {where} the ground together: expected at least "
        f"{LEAST_FRAMES} frames, found {n} of {len(frames.body)} (threshold "
        f"{threshold_m:.4f} m); check the foot markers, or set sections.{key}"
        f"{narrower}{walks}"
    )


def _require_both(name: str, threshold_m: float, state: str, frames: BoolArray) -> None:
    """Raise an error if the threshold puts all feet into one state in every frame."""
    if frames.all():
        found = f"{threshold_m:.4f} m with all feet {state} in all {len(frames)} frames"
        raise AnalysisError.at(
            f"sections.{name}", "a height that divides the frames", found
        )


# Tables behind the figure of the sections: densities of heights, and a sample of
# frames.


@one_blas_thread()
def section_densities(
    recordings: Sequence[Recording],
    sections: Sections,
    landings: Mapping[str, pd.DataFrame],
    *,
    nodes: int = 1024,
) -> pd.DataFrame:
    """Estimate densities of heights of feet, of the body given the feet, in landings.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings from which the sections were selected, above the floor.
    sections : Sections
        Sections whose thresholds divide the frames and determine which are used.
    landings : mapping
        Landings of each recording by name.
    nodes : int
        Nodes of each curve, >= 2.

    Returns
    -------
    DataFrame
        Columns curve, height_m and density_per_m, with `nodes` rows for each curve. The
        curves ``min_foot`` and ``max_foot`` are of all frames. The curves ``body_all``,
        ``body_given_all_up``, ``body_given_all_down``, ``body_given_some_down`` and
        ``body_given_some_up`` are of the pooled frames. The curves ``top``,
        ``first_contact``, ``last_contact`` and ``lowest`` are of the body's heights in
        landings of all feet. A condition that fewer than two frames or landings meet,
        or that leaves only one height, has no curve. The curves by which the rule chose
        have its bandwidth.
    """
    heights = [heights_of(recording) for recording in recordings]
    in_each = [landing_heights(one, landings[one.name]) for one in recordings]
    of_landings = np.concatenate(in_each)
    frames = sections.pooled(heights)
    bodies = {
        "body_all": frames.body,
        "body_given_all_up": frames.body[frames.all_up],
        "body_given_all_down": frames.body[frames.all_down],
        "body_given_some_down": frames.body[~frames.all_up],
        "body_given_some_up": frames.body[~frames.all_down],
    }
    in_landings = {
        "top": of_landings[:, TOP],
        "first_contact": of_landings[:, FIRST_CONTACT],
        "last_contact": of_landings[:, LAST_CONTACT],
        "lowest": of_landings[:, LOWEST],
    }
    bodies = _with_spread(bodies)
    in_landings = _with_spread(in_landings)
    feet = {foot: finite(pooled([getattr(h, foot) for h in heights])) for foot in FEET}
    range_m = feet["max_foot"].max() - feet["min_foot"].min()
    finest_m = FINEST_BANDWIDTH * float(range_m)
    foot_widths = []
    for foot in FEET:
        sigma_m = getattr(sections, f"{foot}_mode").sigma_m
        foot_widths.append(max(FOOT_BANDWIDTH * sigma_m, finest_m))
    body_widths = [normal_bandwidth(one) for one in bodies.values()]
    landing_widths = [
        usual_bandwidth([one], np.ptp(one)) for one in in_landings.values()
    ]
    if sections.bandwidth_m is not None and sections.rule == "landings":
        landing_widths = [sections.bandwidth_m] * len(in_landings)
    if sections.bandwidth_m is not None and sections.rule == "printed":
        foot_widths = [sections.bandwidth_m] * len(feet)
        body_widths = [sections.bandwidth_m] * len(bodies)
    tables = [
        *_curves(feet, foot_widths, REACH_OF_FEET, nodes),
        *_curves(bodies, body_widths, REACH_OF_BODIES, nodes),
        *_curves(in_landings, landing_widths, REACH_OF_BODIES, nodes),
    ]
    return pd.concat(tables, ignore_index=True)


def _with_spread(groups: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the groups of heights that have a density: two or more that differ."""
    kept = {}
    for name, heights in groups.items():
        if len(heights) > 1 and np.ptp(heights) > 0:
            kept[name] = heights
    return kept


def _curves(
    groups: Mapping[str, FloatArray], widths: Sequence[float], reach: float, nodes: int
) -> list[pd.DataFrame]:
    """Return densities of groups of heights; the grid extends by `reach` widths."""
    margin = reach * max(widths, default=0.0)
    low = min(map(np.min, groups.values()), default=0.0) - margin
    high = max(map(np.max, groups.values()), default=0.0) + margin
    grid = np.linspace(low, high, nodes)
    tables = []
    for (name, heights), width in zip(groups.items(), widths, strict=True):
        density = kde(heights, bandwidth=width, grid=grid)
        columns = {"curve": name, "height_m": grid, "density_per_m": density}
        tables.append(pd.DataFrame(columns))
    return tables


def section_frames(
    recordings: Sequence[Recording], sections: Sections, max_rows: int = 20000
) -> pd.DataFrame:
    """Tabulate heights of feet and body, and the state, in every k-th frame.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor.
    sections : Sections
        Sections whose thresholds define a landing.
    max_rows : int
        Largest number of rows; k is the smallest step that keeps to it.

    Returns
    -------
    DataFrame
        Columns min_foot_m, max_foot_m and body_m, for frames in which all three are
        seen, and landing: whether the body is on its way from all feet up to all feet
        down.
    """
    heights = [heights_of(recording) for recording in recordings]
    columns = {}
    for name in (*FEET, "body"):
        in_each = [getattr(one, name)[one.seen] for one in heights]
        columns[f"{name}_m"] = np.concatenate(in_each)
    low_m = sections.min_foot_threshold_m
    high_m = sections.max_foot_threshold_m
    landing = [one.landing(low_m, high_m)[one.seen] for one in heights]
    columns["landing"] = np.concatenate(landing)
    stride = max(1, -(-len(columns["body_m"]) // max_rows))
    return pd.DataFrame({name: values[::stride] for name, values in columns.items()})
