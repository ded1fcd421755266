"""Where landings are: descents of the body, and those that only the feet show.

The results are of an animal of 1 m, on which everything here was tuned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import AnalysisError
from hopdata.landings.contacts import descents, shallow, steps
from hopdata.landings.contacts.noise import height_noise
from hopdata.recording import Recording

#: Height below which a foot is down, as a share of the median descent of the body.
#: Unit: 1. Origin: chosen.
DOWN_SHARE = 0.15

#: Least height below which a foot is down, in standard deviations of the noise.
#: Unit: standard deviations. Origin: chosen.
DOWN_SIGMAS = 4.0


@dataclass(frozen=True)
class Descending:
    """The descents of a recording, for an animal of 1 m, on which all was tuned.

    Parameters
    ----------
    recording : Recording
        At its own size.
    spans : (L, 2) array
        Apex and nadir of each descent, s, or when feet that land later are surely down.
    hidden : (L,) bool array
        Whether only the feet show the landing.
    down_m : float
        Height to which a foot must sink to have landed, m.
    steps : Steps, optional
        Descents of the feet, if landings were looked for in these.
    stranger : (L, n) bool array
        Feet that do not land in a landing which only other feet show.
    """

    recording: Recording
    spans: FloatArray
    hidden: BoolArray
    down_m: float
    steps: steps.Steps | None
    stranger: BoolArray


def descents_of(
    recording: Recording, down_height_m: float | None, *, of_feet: bool
) -> Descending:
    """Find the descents of the body, and the landings that none of them shows."""
    n_feet = len(recording.names("foot"))
    least_feet = 1 if of_feet else 2
    if n_feet < least_feet:
        raise AnalysisError.at(
            recording.name, f"at least {least_feet} foot markers", n_feet
        )
    time_scale = recording.time_scale
    time = recording.time / time_scale
    heights = recording.feet[:, :, 2] / recording.scale
    body = body_height(recording)
    falls = descents.descents(body, time, longest=descents.HIDDEN_S)
    noise_m = height_noise(heights)
    of_each_foot, fall_m = steps.find_steps(time, heights, noise_m=noise_m)
    falls = shallow.with_shallow_falls(time, heights, body, falls, of_each_foot)
    if of_feet:
        falls = steps.clear_falls(body, falls)
    seen_spans = time[np.array(falls, dtype=np.int64).reshape(-1, 2)]
    if not down_height_m:
        down_height_m = usual_down_height(recording, seen_spans * time_scale)
    down_m = down_height_m / recording.scale
    found = None
    if of_feet:
        found = of_each_foot
        low_m = max(steps.LOW_SHARE * fall_m, steps.LEAST_FALL_SIGMAS * noise_m)
        down_m = max(down_m, low_m)
        seen_spans, is_shown = steps.shown_by_body(found, seen_spans)
        more_spans, own = steps.landings_of(found.take(~is_shown), n_feet)
    else:
        more_spans = descents.find_hidden_landings(
            time, heights, body, seen_spans, down_height_m=down_m
        )
        own = np.ones((len(more_spans), n_feet), dtype=bool)
    both = np.concatenate([seen_spans, more_spans])
    all_own = np.concatenate([np.ones((len(seen_spans), n_feet), dtype=bool), own])
    order = np.argsort(both[:, 0], kind="stable")
    return Descending(
        recording,
        spans=both[order],
        hidden=order >= len(seen_spans),
        down_m=down_m,
        steps=found,
        stranger=~all_own[order],
    )


def body_height(recording: Recording) -> FloatArray:
    """Return the height of the body (N,), m, of an animal of 1 m; NaN without one."""
    if not recording.indices("body"):
        return np.full(len(recording.time), np.nan)
    return np.asarray(recording.body_height / recording.scale)


def whole_spans(spans: FloatArray) -> descents.Transitions:
    """Return transitions from the apex to the nadir of each descent (L, 2), s."""
    no_gap = np.full(len(spans), np.nan)
    return descents.Transitions(spans[:, 0], spans[:, 1], no_gap, no_gap)


def usual_down_height(recording: Recording, spans: FloatArray) -> float:
    """Return the height, m, below which a foot is down.

    `spans` (L, 2), s, are apex and nadir of the body's descents.
    """
    # The instants are those of frames, but for rounding: half a frame earlier finds the
    # same ones.
    half_frame_s = 0.5 * float(np.min(np.diff(recording.time)))
    apex = np.searchsorted(recording.time, spans[:, 0] - half_frame_s)
    nadir = np.searchsorted(recording.time, spans[:, 1] - half_frame_s)
    falls_m = np.empty(0)
    if len(spans):
        falls_m = recording.body_height[apex] - recording.body_height[nadir]
    usual_fall_m = 0.0
    if np.isfinite(falls_m).any():
        usual_fall_m = float(np.nanmedian(falls_m))
    noise_m = height_noise(recording.feet[:, :, 2], scale=recording.scale)
    return max(DOWN_SHARE * usual_fall_m, DOWN_SIGMAS * noise_m)
