"""Landings as motion capture would see them, without the rest of the recordings.

The robot's true motion about each landing (`true_tracks`) is seen at random phases of the frames,
with noise, and goes through the same fits as a recording's; as in a recording, frames on the far
side of the contacts as measured are left out. So errors of the states have the size and the
correlations that the pipeline gives them, at a small part of its cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from true_tracks import tracks_of

from hopdata.landings.states.fits import section_states
from hopdata.synthesis.landings import SectionHeights, TrueLandings

APART_S = 1.0


@dataclass(frozen=True)
class SeenLandings:
    """Marker states (n, 6B) before and after, m and m/s, and contact instants (n, feet), s.

    `rows` (n,) are the numbers of these landings among those that were to be seen.
    """

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray
    rows: np.ndarray


def see_landings(
    times: np.ndarray,
    motion: np.ndarray,
    landings: TrueLandings,
    sections: SectionHeights,
    *,
    noise_m: float,
    instant_noise_s: float,
    rng: np.random.Generator,
    spoil: Callable[[np.ndarray], np.ndarray] | None = None,
) -> SeenLandings:
    """Observe L whole landings, as those of one recording, frame by frame.

    Those whose states cannot be fitted are left out. `times` (L, W), s, and `motion` (L, W, 12) are
    of `true_tracks.true_states`, to beyond the post section (`landings.section_fits.WINDOWS_S`).
    `spoil` is what becomes of the tracks (L, W, B, 3) besides.
    """
    tracks = tracks_of(motion, sections.points_m)
    tracks += noise_m * rng.standard_normal(tracks.shape)
    tracks = tracks if spoil is None else spoil(tracks)
    contact = landings.contact_s
    seen = contact + instant_noise_s * rng.standard_normal(contact.shape)
    start = APART_S * np.arange(len(times))

    def states(side: str, at_s: np.ndarray, contact_s: np.ndarray, height_m: float) -> np.ndarray:
        found = section_states(
            (start[:, None] + times).ravel(),
            tracks.reshape(-1, *tracks.shape[2:]),
            start + at_s,
            height_m=height_m,
            side=side,
            contact=start + contact_s,
        )
        both = np.concatenate([found.position, found.velocity], axis=1)
        return both.reshape(len(both), -1)

    before = states("before", landings.pre_time_s, seen.min(axis=1), sections.pre_m)
    after = states("after", landings.post_time_s, seen.max(axis=1), sections.post_m)
    rows = np.flatnonzero(np.isfinite(np.hstack([before, after])).all(axis=1))
    return SeenLandings(before[rows], after[rows], seen[rows], rows)
