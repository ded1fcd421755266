"""Which frames have all feet up or down, and which belong to a landing.

A foot at rest trembles with the noise of the cameras, so a plain threshold at three
sigmas says "up" in some frames of every stance. These frames would outweigh the tails
from which the sections are made. The states here therefore have hysteresis: a height is
clear of the ground in a run of frames above the threshold that also reaches three times
as high.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts.descents import descents
from hopdata.recording import Recording

_CLEAR = (
    3.0  # height above ground, in thresholds, that a run of frames must reach to be up
)


@dataclass(frozen=True)
class Heights:
    """Heights of one recording; all three are NaN where a foot or the body is not seen.

    Parameters
    ----------
    min_foot, max_foot, body : (N,) array
        Lowest foot, highest foot and mean body marker, m.
    """

    min_foot: FloatArray
    max_foot: FloatArray
    body: FloatArray

    @property
    def seen(self) -> BoolArray:
        """Frames in which everything is seen, (N,)."""
        return np.isfinite(self.body)

    def landing(self, min_foot_m: float, max_foot_m: float) -> BoolArray:
        """Mark the frames of landings by plain thresholds, (N,): see `landing_frames`."""
        return landing_frames(
            self.body, self.min_foot > min_foot_m, self.max_foot < max_foot_m
        )[0]


@dataclass(frozen=True)
class Frames:
    """Frames pooled over recordings; everything is seen in each of them.

    Parameters
    ----------
    body : (F,) array
        Mean height of the body markers, m.
    all_up, all_down : (F,) bool array
        Whether all feet are up, and whether all are down.
    """

    body: FloatArray
    all_up: BoolArray
    all_down: BoolArray


def heights_of(recording: Recording) -> Heights:
    """Return lowest foot, highest foot and body height in each frame of a levelled recording."""
    feet = recording.feet[:, :, 2]
    lowest, highest, body = feet.min(axis=1), feet.max(axis=1), recording.body_height
    unseen = ~np.isfinite(lowest + body)
    return Heights(*(np.where(unseen, np.nan, h) for h in (lowest, highest, body)))


def pool_frames(
    heights: Sequence[Heights],
    *,
    min_foot_m: float,
    max_foot_m: float,
    ground_m: float,
    landings_only: bool = False,
) -> Frames:
    """Decide each frame's state and pool the recordings.

    Parameters
    ----------
    heights : sequence of Heights
        One for each recording.
    min_foot_m, max_foot_m : float
        Thresholds: the lowest (highest) foot is up above this height, m.
    ground_m : float
        Height of the ground, m, above which the hysteresis is measured.
    landings_only : bool
        Keep only the descents of the body in which the feet go from all up to all down.
        From the first frame with all down to the nadir, the feet are assumed to stay
        down, because a heel that rises early is not part of the landing.
    """
    parts = []
    for h in heights:
        all_up = clear_of_ground(h.min_foot, threshold_m=min_foot_m, ground_m=ground_m)
        some_up = clear_of_ground(h.max_foot, threshold_m=max_foot_m, ground_m=ground_m)
        parts.append(kept_frames(h.body, all_up, h.seen & ~some_up, landings_only))
    return Frames(*map(pooled, zip(*parts, strict=True)))


def kept_frames(
    body: FloatArray, all_up: BoolArray, all_down: BoolArray, landings_only: bool
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return body height and states of the frames that count: see `pool_frames`."""
    keep = np.isfinite(body)
    if landings_only:
        keep, landed = landing_frames(body, all_up, all_down)
        all_up, all_down = all_up & ~landed, all_down | landed
    return body[keep], all_up[keep], all_down[keep]


def pooled(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Join arrays along the first axis; do not copy a single one, since it may be large."""
    return np.concatenate(parts) if len(parts) > 1 else parts[0]


def clear_of_ground(
    height: FloatArray, *, threshold_m: float, ground_m: float
) -> BoolArray:
    """Mark runs of frames above the threshold that reach three times as high, (N,).

    An unseen frame (NaN) is not marked and does not end a run.
    """
    clear = np.zeros(len(height), dtype=bool)
    seen = np.flatnonzero(np.isfinite(height))
    if len(seen) == 0:
        return clear
    above = height[seen] > threshold_m
    high = above & (height[seen] > ground_m + _CLEAR * (threshold_m - ground_m))
    run = np.cumsum(above & ~np.concatenate([[False], above[:-1]]))
    rises = np.zeros(run[-1] + 1, dtype=bool)
    rises[run[high]] = True
    clear[seen] = above & rises[run]
    return clear


def landing_frames(
    body: FloatArray, all_up: BoolArray, all_down: BoolArray
) -> tuple[BoolArray, BoolArray]:
    """Find the descents, from apex to nadir, that go from all feet up to all feet down.

    Parameters
    ----------
    body : (N,) array
        Body height, m; NaN where not seen.
    all_up, all_down : (N,) bool array
        Whether all feet are up, and whether all are down.

    Returns
    -------
    in_descent, landed : (N,) bool array
        Seen frames of these descents, and those of them from the first with all feet
        down on.
    """
    in_descent, landed = (
        np.zeros(len(body), dtype=bool),
        np.zeros(len(body), dtype=bool),
    )
    for apex, nadir in descents(body):
        frames = apex + np.flatnonzero(np.isfinite(body[apex : nadir + 1]))
        down = np.flatnonzero(all_down[frames])
        if all_up[apex] and len(down):
            in_descent[frames] = True
            landed[frames[down[0] :]] = True
    return in_descent, landed
