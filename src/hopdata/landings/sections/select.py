"""Poincare sections: body heights above which all feet are up and below which all are down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, Shown, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings.contacts.descents import CONTINUED_S, HIDDEN_S, LANDED
from hopdata.landings.contacts.find import contacts_of, find_landings
from hopdata.landings.sections.frames import Frames, Heights, heights_of, pool_frames, pooled
from hopdata.landings.sections.modes import GroundMode, finite, ground_mode, kde, normal_bandwidth
from hopdata.recording import Recording

FRAMES = {"all": False, "landings": True}  # whether only frames of landings count
FEET = ("min_foot", "max_foot")
LEAST_KNEE_M = 3e-4  # least height of a knee above its mode: no floor is known more accurately
_LEAST_FRAMES = 5  # fewest frames with all feet up, and with all down, in a hopping gait


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
    threshold_sigmas : float
        Deviations from a mode to its upper knee.
    tail_fraction : float
        Share of frames that may be on the wrong side of a section.
    frames : {"all", "landings"}
        Frames from which the sections are selected.
    decided : dict
        ``"data"`` or ``"config"`` for each of the four heights above; ``"contacts"`` for a section
        that was moved because it lost too many landings.
    held : dict
        Share of the landings of all feet that the ``"pre"`` and the ``"post"`` section hold.
    n_frames : int
        Number of frames in which all feet and the body are seen.
    n_used : int
        Number of these frames from which the sections are selected.
    """

    pre_height_m: float
    post_height_m: float
    min_foot_threshold_m: float
    max_foot_threshold_m: float
    ground_m: float
    min_foot_mode: GroundMode
    max_foot_mode: GroundMode
    threshold_sigmas: float
    tail_fraction: float
    frames: str
    decided: dict[str, str]
    held: dict[str, float | None]
    n_frames: int
    n_used: int

    def pooled(self, heights: Sequence[Heights]) -> Frames:
        """Pool the frames from which the sections are selected, each with its state."""
        return pool_frames(
            heights,
            min_foot_m=self.min_foot_threshold_m,
            max_foot_m=self.max_foot_threshold_m,
            ground_m=self.ground_m,
            landings_only=chosen("sections.frames", self.frames, FRAMES),
        )

    def told(self) -> str:
        """Describe the heights of the two sections."""
        pre_mm, post_mm = 1e3 * self.pre_height_m, 1e3 * self.post_height_m
        return f"{pre_mm:.1f} mm before, {post_mm:.1f} mm after the landing"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and dictionaries, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Sections:
        """Make the sections from the fields that `to_dict` returns."""
        modes = {k: GroundMode(**fields[k]) for k in ("min_foot_mode", "max_foot_mode")}
        return cls(**{**fields, **modes})


@one_blas_thread()
def select_sections(
    recordings: Sequence[Recording],
    *,
    landings: Mapping[str, pd.DataFrame] | None = None,
    frames: str = "all",
    tail_fraction: float = 0.0003,
    threshold_sigmas: float = 3.0,
    bandwidth_m: float | None = None,
    min_foot_threshold_m: float | None = None,
    max_foot_threshold_m: float | None = None,
    pre_height_m: float | None = None,
    post_height_m: float | None = None,
) -> Sections:
    """Select the pre- and post-touchdown sections from all recordings of a study.

    The thresholds are the upper knees of the ground modes of the lowest and the highest foot.
    The pre section is the height that the body hardly ever exceeds while some foot is down. The
    post section is the height that it hardly ever falls below while some foot is up.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor (see `hopdata.landings.floor.level`), each with feet and body.
    landings : mapping, optional
        Landings of each recording by name, from
        `hopdata.landings.contacts.find.find_landings`; by default found here.
    frames : {"all", "landings"}
        Use all frames, or only descents of the body, from apex to nadir, in which the feet go
        from all up to all down. The latter is for animals that also stand on feet that are not
        followed.
    tail_fraction : float
        Meaning of "hardly ever", as a share of the frames in question, 0 to 0.1.
    threshold_sigmas : float
        Distance from a mode to its knee, in deviations of the left flank, > 0.
    bandwidth_m : float, optional
        Bandwidth for the place of the modes, m; by default from the data.
    min_foot_threshold_m, max_foot_threshold_m, pre_height_m, post_height_m : float, optional
        Values to use instead of those from the data, m.

    Raises
    ------
    AnalysisError
        If the feet never leave the ground together or never stand on it together, if no descent is
        a landing, or if the pre section is not above the post section.
    ConfigError
        If `frames` is unknown.

    Notes
    -----
    See Sec. 2.2.2 of the dissertation, with its two conditions the right way round: all feet are up
    above the pre section, and all are down below the post section. Each section is a tail quantile
    of the frames that would contradict it: frames with some foot down, and frames with some foot
    up. A touchdown crosses few frames, so the share of touchdowns that lose a foot beyond a section
    is much larger than the share of frames (one or two per cent at the default).

    A foot between the ground and its threshold counts as down while the body may still be higher
    than at contact, by at most that distance. The section lies within this range, and its middle is
    taken. If the threshold comes from the configuration, a foot below it *is* down, and nothing is
    subtracted.

    If a section loses many more landings than this, feet and thresholds disagree on what is down (a
    runner's sole gives after its contact). The section then moves to the nearest height that holds
    almost all landings, judged by their contacts (see `holds`).
    """
    require_choice("sections.frames", frames, FRAMES)
    heights = [heights_of(recording) for recording in recordings]
    scale = float(np.median([recording.scale for recording in recordings]))
    by: Any = {"bandwidth_m": bandwidth_m, "scale": scale}
    modes = [ground_mode(pooled([getattr(h, foot) for h in heights]), **by) for foot in FEET]
    every = ground_mode(pooled([r.feet[:, :, 2] for r in recordings]), **by)
    knees = [max(m.knee(threshold_sigmas), m.height_m + LEAST_KNEE_M * scale) for m in modes]
    given = {
        "min_foot_threshold_m": min_foot_threshold_m,
        "max_foot_threshold_m": max_foot_threshold_m,
        "pre_height_m": pre_height_m,
        "post_height_m": post_height_m,
    }
    taken = zip(knees, given.values(), strict=False)
    lowest, highest = (knee if own is None else own for knee, own in taken)
    # How far above the ground a foot may be and still count as down, unless its threshold is given.
    excess = [max(knee - every.height_m, 0.0) for knee in knees]
    decided = {name: "data" if value is None else "config" for name, value in given.items()}
    sections = Sections(
        pre_height_m=np.nan, post_height_m=np.nan, held={}, n_used=0, min_foot_threshold_m=lowest,
        max_foot_threshold_m=highest, ground_m=every.height_m, min_foot_mode=modes[0],
        max_foot_mode=modes[1], threshold_sigmas=threshold_sigmas, tail_fraction=tail_fraction,
        frames=frames, decided=decided, n_frames=sum(int(h.seen.sum()) for h in heights),
    )  # fmt: skip
    frames_used = sections.pooled(heights)
    if pre_height_m is None or post_height_m is None:
        _require_hopping(frames_used, sections)
    pre, post = pre_height_m, post_height_m
    if pre is None:  # hardly ever exceeded while some foot is down
        highest_body = np.quantile(frames_used.body[~frames_used.all_up], 1.0 - tail_fraction)
        pre = float(highest_body - 0.5 * excess[0] * (min_foot_threshold_m is None))
    if post is None:  # hardly ever reached while some foot is up
        lowest_body = np.quantile(frames_used.body[~frames_used.all_down], tail_fraction)
        post = float(lowest_body - 0.5 * excess[1] * (max_foot_threshold_m is None))
    landings = landings or {one.name: find_landings(one) for one in recordings}
    known = np.concatenate([landing_heights(one, landings[one.name]) for one in recordings])
    sections = replace(sections, n_used=len(frames_used.body), pre_height_m=pre, post_height_m=post)
    sections = _held(sections, known / scale, scale)
    if not sections.pre_height_m > sections.post_height_m:
        found = f"{sections.pre_height_m:.4f} m and {sections.post_height_m:.4f} m; set "
        found += "sections.pre_height_m and sections.post_height_m, or sections.frames to landings"
        found += " if the body also stands on feet that are not followed"
        raise AnalysisError.at("sections", "the pre section above the post section", found)
    return sections


def _held(sections: Sections, landings: FloatArray, scale: float) -> Sections:
    """Move sections that lose too many landings (L, 4), in `scale` m, and add what each holds."""
    heights = {"pre": sections.pre_height_m / scale, "post": sections.post_height_m / scale}
    decided = dict(sections.decided)
    held = dict[str, float | None](pre=None, post=None)
    least = 1.0 - max(LOST_PER_TAIL * sections.tail_fraction, LEFT_LOSS)
    for side in heights if len(landings) else ():
        share = float(np.mean(holds(heights[side], landings, side)))
        if share < least and decided[f"{side}_height_m"] == "data":
            heights[side] = nearest_holding(heights[side], landings, side)
            share = float(np.mean(holds(heights[side], landings, side)))
            decided[f"{side}_height_m"] = "contacts"
        held[side] = share
    moved: Any = {f"{side}_height_m": height * scale for side, height in heights.items()}
    return replace(sections, **moved, decided=decided, held=held)


def _require_hopping(pooled: Frames, sections: Sections) -> None:
    """Raise an error unless the feet are all up in some frames and all down in others."""
    n_up, n_down = int(pooled.all_up.sum()), int(pooled.all_down.sum())
    lowest, highest = sections.min_foot_threshold_m, sections.max_foot_threshold_m
    if min(n_up, n_down) >= _LEAST_FRAMES:
        _require_both("min_foot_threshold_m", lowest, "up", pooled.all_up)
        _require_both("max_foot_threshold_m", highest, "down", pooled.all_down)
        return
    if FRAMES[sections.frames]:
        raise AnalysisError(
            "sections: expected descents of the body in which the feet go from all up to all "
            f"down, found none (all up: lowest foot above {lowest:.4f} m; all down: highest foot "
            f"below {highest:.4f} m); in a walk the body need not sink when a foot lands; "
            "otherwise set sections.min_foot_threshold_m and sections.max_foot_threshold_m"
        )
    where, name, value, n = "stand on", "max_foot_threshold_m", highest, n_down
    if n_up < n_down:
        where, name, value, n = "leave", "min_foot_threshold_m", lowest, n_up
    walks = "; a walk, in which some foot is always down, has no landing on several feet"
    raise AnalysisError(
        f"sections: the feet never {where} the ground together: expected at least "
        f"{_LEAST_FRAMES} frames, found {n} of {len(pooled.body)} (threshold {value:.4f} m); "
        f"check the foot markers, or set sections.{name}{walks if where == 'leave' else ''}"
    )


def _require_both(name: str, threshold_m: float, state: str, frames: BoolArray) -> None:
    """Raise an error if the threshold puts all feet into one state in every frame."""
    if frames.all():
        found = f"{threshold_m:.4f} m with all feet {state} in all {len(frames)} frames"
        raise AnalysisError.at(f"sections.{name}", "a height that divides the frames", found)


# Landings that a section holds: a foot is down from the instant of its contact on.
#
# A pre section holds a landing that begins above it and has its first contact below it, or so
# little above it that the flight can be continued. A post section holds a landing with all contacts
# above it that continues below it. Heights of feet show only roughly where this is: a heel, or a
# sole that gives, may lie within its threshold long before or after its contact.

#: Share of landings that a section may lose, per share of frames on its wrong side; and the share
#: that the height it moves to may lose if it loses more.
LOST_PER_TAIL, LEFT_LOSS = 150.0, 0.015
_INSIDE_M = 1e-3  # margin of a moved section inside the heights that hold as many, if it fits
#: Columns of `landing_heights` that bound a section (contact and turning point), and its sign.
_BOUNDS = {"pre": (1, 0, 1.0), "post": (2, 3, -1.0)}


def landing_heights(recording: Recording, landings: pd.DataFrame) -> FloatArray:
    """Return body heights in the landings of all feet: apex, first and last contact, nadir.

    Parameters
    ----------
    recording : Recording
        Levelled, with feet and body; it may be a part of the recording with these landings.
    landings : pandas.DataFrame
        Landings from `hopdata.landings.contacts.find.find_landings`.

    Returns
    -------
    ndarray
        (L, 4) mean heights of the body markers, m, for the landings that the recording shows. The
        height of the first contact is taken as far down as the flight can be continued.
    """
    contacts = contacts_of(landings)
    whole = (contacts.status == LANDED).all(axis=1) & np.isfinite(contacts.instant).all(axis=1)
    instant, spans = contacts.instant[whole], landings[["begin_s", "end_s"]].to_numpy(float)[whole]
    first = instant.min(axis=1) + CONTINUED_S * recording.pace
    ends = np.clip(np.column_stack([first, instant.max(axis=1)]), spans[:, :1], spans[:, 1:])
    at = np.insert(spans, 1, ends.T, axis=1)
    seen = np.isfinite(recording.body_height)
    time, height = recording.time[seen], recording.body_height[seen]
    if len(time) < 2:
        return np.empty((0, 4))
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    gap = time[after] - time[after - 1]
    shown = (at >= time[0]) & (at <= time[-1]) & (gap <= HIDDEN_S * recording.pace)
    return np.interp(at[shown.all(axis=1)], time, height)


def holds(height_m: float, landings: FloatArray, side: str) -> BoolArray:
    """Mark the landings (L, 4) that a section at this height, m, holds, (L,), by its `side`."""
    contact, turn, sign = _BOUNDS[side]
    reached = sign * landings[:, contact] <= sign * height_m
    return np.asarray(reached & (sign * height_m <= sign * landings[:, turn]))


def nearest_holding(height_m: float, landings: FloatArray, side: str) -> float:
    """Return the nearest height, m, that loses few of the landings (L, 4), or the fewest."""
    contact, turn, sign = _BOUNDS[side]
    edges = np.unique(landings[:, [contact, turn]])
    middles = 0.5 * (edges[1:] + edges[:-1])
    low, high = sign * landings[:, contact], sign * landings[:, turn]
    low, high = np.sort(low[low <= high]), np.sort(high[low <= high])
    begun = np.searchsorted(low, sign * middles, side="right")
    losses = 1.0 - (begun - np.searchsorted(high, sign * middles)) / len(landings)
    few = losses <= max(losses.min(initial=1.0), LEFT_LOSS)
    margin = np.minimum(0.5 * (edges[1:] - edges[:-1]), _INSIDE_M)[few]
    inside = np.clip(height_m, edges[:-1][few] + margin, edges[1:][few] - margin)
    return float(inside[np.argmin(np.abs(inside - height_m))]) if few.any() else height_m


# Tables behind the figure of the sections: densities of heights, and a sample of frames.

_FOOT_BANDWIDTH = 0.5  # bandwidth in deviations of the ground mode, which it widens by 12 %
_FINEST = 1e-5  # smallest bandwidth, as a share of the range of heights


@one_blas_thread()
def section_densities(
    recordings: Sequence[Recording], sections: Sections, *, nodes: int = 1024
) -> pd.DataFrame:
    """Estimate densities of foot heights, and of body height given the state of the feet.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings from which the sections were selected, above the floor.
    sections : Sections
        Sections whose thresholds divide the frames and determine which are used.
    nodes : int
        Nodes of each curve, >= 2.

    Returns
    -------
    DataFrame
        Columns curve, height_m and density_per_m, with `nodes` rows for each curve. The curves
        ``min_foot`` and ``max_foot`` are of all frames. The curves ``body_all``,
        ``body_given_all_up``, ``body_given_all_down``, ``body_given_some_down`` and
        ``body_given_some_up`` are of the frames from which the sections are selected. A condition
        that fewer than two frames meet, or that leaves only one height, has no curve.
    """
    heights = [heights_of(recording) for recording in recordings]
    frames = sections.pooled(heights)
    bodies = {
        "body_all": frames.body,
        "body_given_all_up": frames.body[frames.all_up],
        "body_given_all_down": frames.body[frames.all_down],
        "body_given_some_down": frames.body[~frames.all_up],
        "body_given_some_up": frames.body[~frames.all_down],
    }
    bodies = {name: body for name, body in bodies.items() if len(body) > 1 and np.ptp(body) > 0}
    feet = {foot: finite(pooled([getattr(h, foot) for h in heights])) for foot in FEET}
    least = _FINEST * float(feet["max_foot"].max() - feet["min_foot"].min())  # without noise
    sigmas = [getattr(sections, f"{foot}_mode").sigma_m for foot in FEET]
    tables = _curves(feet, [max(_FOOT_BANDWIDTH * sigma, least) for sigma in sigmas], 4, nodes)
    tables += _curves(bodies, [*map(normal_bandwidth, bodies.values())], 3, nodes)
    return pd.concat(tables, ignore_index=True)


def _curves(
    groups: Mapping[str, FloatArray], widths: Sequence[float], reach: float, nodes: int
) -> list[pd.DataFrame]:
    """Return the densities of groups of heights, on one grid that extends by `reach` widths."""
    margin = reach * max(widths, default=0.0)
    low = min(map(np.min, groups.values()), default=0.0) - margin
    high = max(map(np.max, groups.values()), default=0.0) + margin
    grid = np.linspace(low, high, nodes)
    tables = []
    for (name, heights), width in zip(groups.items(), widths, strict=True):
        density = kde(heights, bandwidth=width, grid=grid)
        tables.append(pd.DataFrame({"curve": name, "height_m": grid, "density_per_m": density}))
    return tables


def section_frames(
    recordings: Sequence[Recording], sections: Sections, max_rows: int = 20000
) -> pd.DataFrame:
    """Tabulate lowest foot, highest foot, body height and landing state in every k-th frame.

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
        Columns min_foot_m, max_foot_m and body_m, for frames in which all three are seen, and
        landing: whether the body is on its way from all feet up to all feet down.
    """
    heights = [heights_of(recording) for recording in recordings]
    columns = {
        f"{name}_m": np.concatenate([getattr(h, name)[h.seen] for h in heights])
        for name in (*FEET, "body")
    }
    low, high = sections.min_foot_threshold_m, sections.max_foot_threshold_m
    columns["landing"] = np.concatenate([h.landing(low, high)[h.seen] for h in heights])
    stride = max(1, -(-len(columns["body_m"]) // max_rows))
    return pd.DataFrame({name: values[::stride] for name, values in columns.items()})
