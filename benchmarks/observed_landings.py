"""Landings as motion capture would see them, without the rest of the recordings.

The robot's true motion about each landing is sampled at random phases of the frames,
with noise, and goes through the same fits as a recording. As in a recording, frames
beyond the measured contacts are left out. Thus errors of the states have the size and
correlations that they have in the pipeline, at a small part of its cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hopdata.hybrid import System, solve_batch
from hopdata.landings.states.fits import section_states
from hopdata.scenes.body import N_STATES
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis.camera import fixed_markers
from hopdata.synthesis.hops import Hop, padded
from hopdata.synthesis.landings import (
    NOT_YET,
    SectionHeights,
    TrueLandings,
    landing_system,
    landing_vectors,
)
from hopdata.synthesis.trial import Trial

APART_S = 1.0


@dataclass(frozen=True)
class SeenLandings:
    """Marker states (n, 6B) before and after, m and m/s, and contact instants (n, feet), s.

    `rows` (n,) are the indices of these landings among those to be observed.
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
    """Observe L whole landings as those of one recording, frame by frame.

    Landings whose states cannot be fitted are left out. `times` (L, W), s, and `motion`
    (L, W, 12) come from `true_states` and extend beyond the post section
    (`landings.states.fits.WINDOWS_S`). `spoil` is a further disturbance of the tracks
    (L, W, B, 3).
    """
    tracks = tracks_of(motion, sections.points_m)
    tracks += noise_m * rng.standard_normal(tracks.shape)
    tracks = tracks if spoil is None else spoil(tracks)
    contact = landings.contact_s
    seen = contact + instant_noise_s * rng.standard_normal(contact.shape)
    start = APART_S * np.arange(len(times))

    def states(
        side: str, at_s: np.ndarray, contact_s: np.ndarray, height_m: float
    ) -> np.ndarray:
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


# States of a simulated body about each landing, frame by frame.
#
# The robot itself is integrated from an apex through the landing and beyond. Before the
# apex, where a recording shows the robot without that apex's kick, it is integrated
# backwards: a flight reversed in time is a flight. (A control is led to the apexes of
# the hopper's gait, so this is the gait's own flight.)

PHASES = 16  # of the frames; each landing has one of them
BACK_S = 0.14  # before the apex; the flight lasts about 0.15 s there
RTOL, ATOL = 1e-6, 1e-9
NO_HEIGHT_M = -1e3  # of a section that is never reached


@dataclass(frozen=True)
class Apexes:
    """Starts of L landings: states (L, 12) before and after the kick, preloads (L, n), N."""

    before: np.ndarray
    after: np.ndarray
    preloads_n: np.ndarray

    def __len__(self) -> int:
        return len(self.after)

    def some(self, rows: np.ndarray) -> Apexes:
        """Return the given rows."""
        return Apexes(self.before[rows], self.after[rows], self.preloads_n[rows])


def apexes_of(trial: Trial) -> Apexes:
    """Return the apexes of a trial whose landings stood and that it reached by free flight."""
    starts = np.asarray(trial.hop_start_s)
    ends = starts + [hop.end_time_s for hop in trial.hops]
    flown = np.isclose(ends[:-1], starts[1:], rtol=0.0, atol=1e-9)
    pairs = zip(trial.hops[:-1], trial.hops[1:], flown, strict=True)
    kept = [(old, new) for old, new, joined in pairs if joined and _stood(new)]
    return Apexes(
        np.array([old.end_state for old, _ in kept]),
        np.array([new.start_state for _, new in kept]),
        np.array([new.preloads_n for _, new in kept]),
    )


def true_states(
    scene: Scene,
    control: Control,
    apexes: Apexes,
    *,
    until_s: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (L, W) from the apexes, s, at random phases, and the states (L, W, 12).

    States are NaN from the next apex on.
    """
    count = round((BACK_S + until_s) * rate_hz)
    back = round(BACK_S * rate_hz)
    phases = rng.uniform(0.0, 1.0 / rate_hz, PHASES)
    group = rng.integers(0, PHASES, len(apexes))
    times = (np.arange(count) - back) / rate_hz + phases[group][:, None]
    states = np.full((*times.shape, N_STATES), np.nan)
    for number in np.flatnonzero(np.bincount(group, minlength=PHASES)):
        rows = np.flatnonzero(group == number)
        states[rows] = states_at(scene, control, apexes.some(rows), times[rows[0]])
    return times, states


def tracks_of(states: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return noise-free markers (L, W, B, 3), m, for states (L, W, 12)."""
    flat = fixed_markers(states.reshape(-1, N_STATES), points_m)
    return flat.reshape(*states.shape[:2], *points_m.shape)


def states_at(
    scene: Scene, control: Control, apexes: Apexes, times_s: np.ndarray
) -> np.ndarray:
    """Return states (L, W, 12) at increasing times (W,) relative to the apex, s."""
    vectors = landing_vectors(
        scene, control, apexes.preloads_n, point_m=np.zeros(3), height_m=NO_HEIGHT_M
    )
    own = scene.system(control)
    early = times_s < 0
    back = _turned_round(
        _flown(own, _turned_round(apexes.before), vectors, -times_s[early][::-1])
    )
    ahead = _flown(own, apexes.after, vectors, times_s[~early])
    return np.concatenate([back[:, ::-1], ahead], axis=1)


def _flown(
    own: System, states: np.ndarray, vectors: np.ndarray, times_s: np.ndarray
) -> np.ndarray:
    system = landing_system(own)
    unknown = np.full((len(states), system.n_states - own.n_states), NOT_YET)
    solution = solve_batch(
        system, (0.0, float(times_s[-1])), np.hstack([padded(states, own), unknown]),
        params=vectors,
        mode=[0] * system.n_modes, rtol=RTOL, atol=ATOL, t_eval=times_s, workers=1,
    )  # fmt: skip
    assert solution.y is not None
    return np.moveaxis(solution.y[:, :N_STATES], 1, 2)


def _turned_round(states: np.ndarray) -> np.ndarray:
    return states * np.repeat([1.0, -1.0], 6)


def _stood(hop: Hop) -> bool:
    return hop.all_stood() and not hop.fell
