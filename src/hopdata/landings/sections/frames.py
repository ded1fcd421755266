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

#: Height above the ground, in thresholds, that a run of frames must reach to be up.
#: Unit: thresholds. Origin: chosen.
CLEAR = 3.0


@dataclass(frozen=True)
class Heights:
    """Heights of one recording; NaN where a foot or the body is not seen.

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
        """Mark frames of landings by plain thresholds, (N,): see `landing_frames`."""
        all_up = self.min_foot > min_foot_m
        all_down = self.max_foot < max_foot_m
        in_descent, _ = landing_frames(self.body, all_up, all_down)
        return in_descent


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
    """Return the heights in each frame of a levelled recording."""
    feet = recording.feet[:, :, 2]
    lowest = feet.min(axis=1)
    highest = feet.max(axis=1)
    body = recording.body_height
    unseen = ~np.isfinite(lowest + body)
    return Heights(
        min_foot=np.where(unseen, np.nan, lowest),
        max_foot=np.where(unseen, np.nan, highest),
        body=np.where(unseen, np.nan, body),
    )


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
    for one in heights:
        all_up = clear_of_ground(
            one.min_foot, threshold_m=min_foot_m, ground_m=ground_m
        )
        some_up = clear_of_ground(
            one.max_foot, threshold_m=max_foot_m, ground_m=ground_m
        )
        all_down = one.seen & ~some_up
        parts.append(kept_frames(one.body, all_up, all_down, landings_only))
    body, all_up, all_down = (pooled(column) for column in zip(*parts, strict=True))
    return Frames(body, all_up, all_down)


def kept_frames(
    body: FloatArray, all_up: BoolArray, all_down: BoolArray, landings_only: bool
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return body height and states of the frames that count: see `pool_frames`."""
    keep = np.isfinite(body)
    if landings_only:
        keep, landed = landing_frames(body, all_up, all_down)
        all_up = all_up & ~landed
        all_down = all_down | landed
    return body[keep], all_up[keep], all_down[keep]


def pooled(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Join arrays along the first axis; a single one is large and not copied."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts)


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
    high = above & (height[seen] > ground_m + CLEAR * (threshold_m - ground_m))
    begins = above & ~np.concatenate([[False], above[:-1]])
    run = np.cumsum(begins)  # number of the run that a frame above belongs to
    reaches = np.zeros(run[-1] + 1, dtype=bool)
    reaches[run[high]] = True
    clear[seen] = above & reaches[run]
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
    in_descent = np.zeros(len(body), dtype=bool)
    landed = np.zeros(len(body), dtype=bool)
    for apex, nadir in descents(body):
        frames = apex + np.flatnonzero(np.isfinite(body[apex : nadir + 1]))
        down = np.flatnonzero(all_down[frames])
        if all_up[apex] and len(down):
            in_descent[frames] = True
            landed[frames[down[0] :]] = True
    return in_descent, landed
