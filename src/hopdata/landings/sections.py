"""Poincare sections: body heights above which all feet are up and below which all are down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings.contact_frames import BoolArray, Frames, heights_of, pool_frames
from hopdata.landings.modes import GroundMode
from hopdata.landings.thresholds import Thresholds, select_thresholds
from hopdata.recordings.recording import Recording

FRAMES = {"all": False, "landings": True}  # whether those of landings alone count
_LEAST_FRAMES = 5  # with all feet up, and with all down: fewer are not hopping


@dataclass(frozen=True)
class Sections:
    """Thresholds of foot height, and the two sections.

    Parameters
    ----------
    pre_height_m, post_height_m : float
        Mean height of the body markers at the pre- and post-touchdown section, m.
    min_foot_threshold_m, max_foot_threshold_m : float
        Height of the lowest (highest) foot above which all feet (some feet) are up, m.
    ground_m : float
        Ground mode of the heights of all feet together, m.
    min_foot_mode, max_foot_mode : GroundMode
        Ground mode of the lowest and of the highest foot.
    threshold_sigmas : float
        Deviations from a mode to its upper knee.
    tail_fraction : float
        Share of frames that may be on the wrong side of a section.
    frames : {"all", "landings"}
        Frames that the sections are made from.
    decided : dict
        ``"data"`` or ``"config"`` for each of the four heights above.
    n_frames : int
        Frames in which all feet and the body are seen.
    n_used : int
        Those among them that the sections are made from.
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
    n_frames: int
    n_used: int

    @property
    def landings_only(self) -> bool:
        """Whether the frames of landings alone count."""
        return chosen("sections.frames", self.frames, FRAMES)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and dictionaries, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Sections:
        """Make the sections from what `to_dict` gave."""
        modes = {k: GroundMode(**fields[k]) for k in ("min_foot_mode", "max_foot_mode")}
        return cls(**{**fields, **modes})


@one_blas_thread()
def select_sections(
    recordings: Sequence[Recording],
    *,
    frames: str = "all",
    tail_fraction: float = 0.0003,
    threshold_sigmas: float = 3.0,
    bandwidth_m: float | None = None,
    min_foot_threshold_m: float | None = None,
    max_foot_threshold_m: float | None = None,
    pre_height_m: float | None = None,
    post_height_m: float | None = None,
) -> Sections:
    """Select the pre- and post-touchdown section from all recordings of a study.

    The thresholds are the upper knees of the ground modes of the lowest and the highest foot.
    The pre section is the height that the body hardly ever exceeds while some foot is down,
    the post section the height that it hardly ever falls below while some foot is up.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor (see `hopdata.landings.floor.level`), each with feet and body.
    frames : {"all", "landings"}
        Use all frames, or only descents of the body, from apex to nadir, in which the feet go
        from all up to all down: for animals that also stand on feet which are not followed.
    tail_fraction : float
        "Hardly ever" as a share of the frames in question, 0 to 0.1.
    threshold_sigmas : float
        Deviations of the left flank from a mode to its knee, > 0.
    bandwidth_m : float, optional
        Bandwidth for the place of the modes, m; by default from the data.
    min_foot_threshold_m, max_foot_threshold_m, pre_height_m, post_height_m : float, optional
        Values to use instead of those from the data, m.

    Raises
    ------
    AnalysisError
        The feet never leave the ground together or never stand on it together, no descent is
        a landing, or the pre section is not above the post section.
    ValueError
        An option is out of its range.

    Notes
    -----
    Dissertation Sec. 2.2.2, with its two conditions the right way round: above the pre section
    all feet are up, below the post section all are down. Each is a tail quantile of the frames
    that would contradict it: those with some foot down, and those with some foot up. A touchdown
    crosses few frames, so the share of touchdowns that lose a foot beyond a section is much
    larger than the share of frames (one or two per cent at the default). A foot between the ground
    and its threshold counts as down while the body still rides up to that much higher than at
    contact; the section lies in between, and the middle is taken. With a threshold from the
    configuration a foot below it *is* down, and nothing is taken off.
    """
    _check_options(recordings, frames, tail_fraction, threshold_sigmas)
    heights = [heights_of(recording) for recording in recordings]
    thresholds = select_thresholds(
        recordings,
        heights,
        sigmas=threshold_sigmas,
        bandwidth_m=bandwidth_m,
        min_foot_m=min_foot_threshold_m,
        max_foot_m=max_foot_threshold_m,
    )
    pooled = pool_frames(
        heights,
        min_foot_m=thresholds.min_foot_m,
        max_foot_m=thresholds.max_foot_m,
        ground_m=thresholds.ground_m,
        landings_only=FRAMES[frames],
    )
    if pre_height_m is None or post_height_m is None:
        _require_hopping(pooled, thresholds, frames)
    pre = _pre_height(pooled, thresholds, tail_fraction) if pre_height_m is None else pre_height_m
    post = (
        _post_height(pooled, thresholds, tail_fraction) if post_height_m is None else post_height_m
    )
    _require_order(pre, post)
    given = {
        "min_foot_threshold_m": min_foot_threshold_m,
        "max_foot_threshold_m": max_foot_threshold_m,
        "pre_height_m": pre_height_m,
        "post_height_m": post_height_m,
    }
    return Sections(
        pre_height_m=pre,
        post_height_m=post,
        min_foot_threshold_m=thresholds.min_foot_m,
        max_foot_threshold_m=thresholds.max_foot_m,
        ground_m=thresholds.ground_m,
        min_foot_mode=thresholds.min_foot_mode,
        max_foot_mode=thresholds.max_foot_mode,
        threshold_sigmas=threshold_sigmas,
        tail_fraction=tail_fraction,
        frames=frames,
        decided={name: "data" if value is None else "config" for name, value in given.items()},
        n_frames=sum(int(h.seen.sum()) for h in heights),
        n_used=len(pooled.body),
    )


def _pre_height(frames: Frames, thresholds: Thresholds, tail_fraction: float) -> float:
    """Height that the body hardly ever exceeds while some foot is down, m."""
    some_down = frames.body[~frames.all_up]
    return float(np.quantile(some_down, 1.0 - tail_fraction) - 0.5 * thresholds.min_foot_excess_m)


def _post_height(frames: Frames, thresholds: Thresholds, tail_fraction: float) -> float:
    """Height that the body hardly ever falls below while some foot is up, m."""
    some_up = frames.body[~frames.all_down]
    return float(np.quantile(some_up, tail_fraction) - 0.5 * thresholds.max_foot_excess_m)


def _require_hopping(pooled: Frames, thresholds: Thresholds, frames: str) -> None:
    """Raise an error unless the feet are all up in some frames and all down in others."""
    n_up, n_down = int(pooled.all_up.sum()), int(pooled.all_down.sum())
    if min(n_up, n_down) >= _LEAST_FRAMES:
        _require_both("min_foot_threshold_m", thresholds.min_foot_m, "up", pooled.all_up)
        _require_both("max_foot_threshold_m", thresholds.max_foot_m, "down", pooled.all_down)
        return
    if FRAMES[frames]:
        raise AnalysisError(
            "sections: expected descents of the body in which the feet go from all up to all "
            f"down, found none (all up: lowest foot above {thresholds.min_foot_m:.4f} m; all "
            f"down: highest foot below {thresholds.max_foot_m:.4f} m); set "
            "sections.min_foot_threshold_m and sections.max_foot_threshold_m"
        )
    where, name, value, n = (
        ("leave", "min_foot_threshold_m", thresholds.min_foot_m, n_up)
        if n_up < n_down
        else ("stand on", "max_foot_threshold_m", thresholds.max_foot_m, n_down)
    )
    walks = "; a walk, in which some foot is always down, has no landing on several feet"
    raise AnalysisError(
        f"sections: the feet never {where} the ground together: expected at least "
        f"{_LEAST_FRAMES} frames, found {n} of {len(pooled.body)} (threshold {value:.4f} m); "
        f"check the foot markers and the floor, or set sections.{name}"
        f"{walks if where == 'leave' else ''}"
    )


def _require_both(name: str, threshold_m: float, state: str, frames: BoolArray) -> None:
    """Raise an error if the threshold puts all feet into one state in every frame."""
    if frames.all():
        raise AnalysisError(
            f"sections.{name}: expected a height that divides the frames, found "
            f"{threshold_m:.4f} m with all feet {state} in all {len(frames)} frames"
        )


def _require_order(pre_m: float, post_m: float) -> None:
    """Raise an error unless the pre section is above the post section."""
    if not pre_m > post_m:
        raise AnalysisError(
            f"sections: expected the pre section above the post section, found {pre_m:.4f} m "
            f"and {post_m:.4f} m; set sections.pre_height_m and sections.post_height_m, or "
            "sections.frames to landings if the body also stands on feet that are not followed"
        )


def _check_options(
    recordings: Sequence[Recording], frames: str, tail_fraction: float, threshold_sigmas: float
) -> None:
    """Raise an error for an option that is out of its range."""
    if not recordings:
        raise ValueError("recordings: expected at least one, found none")
    require_choice("sections.frames", frames, FRAMES)
    if not 0 <= tail_fraction <= 0.1:
        raise ValueError(f"tail_fraction: expected 0 to 0.1, found {tail_fraction}")
    if not threshold_sigmas > 0:
        raise ValueError(f"threshold_sigmas: expected more than 0, found {threshold_sigmas}")
